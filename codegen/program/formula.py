"""Formulas: expressions that are evaluated outside the sweeps, such as joint forces and outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import cached_property

from ..records import dataclass
from .block import Block, Component, Expansion
from .passes import simplify
from .second_order import adjoint, along
from .store import MARGIN, MODES, NUMBER, Store, argument
from .transpose import transposed

Row = tuple[int, tuple[int, ...], list[int], list[float]]
"""Data of one formula: target index (the first, if there are several entries), links, indices for the slots,
numbers."""


@dataclass(eq=False)
class Formula:
    """Formulas of one form. They share one block and differ only in their data.

    Attributes
    ----------
    name : str
        Name of its functions.
    target : str
        The result whose entries are written.
    value, tangent : Block
        The value depends on arguments, numbers and the records of links; the tangent also on seeds and on values per direction.
    rows : list of (int, tuple of int, list of int, list of float)
        For each formula: target index, links, indices for the slots, numbers.
    places : list of str
        For each formula: its path in the model file.
    curvature : callable () -> Block or None
        Returns the block of `twice` if second derivatives may be infinite; otherwise None.
    of_records : tuple of two Block, optional
        The blocks of `adjoint` and `twice` of a formula over records.
    differentiable : Block, optional
        The value of a formula over records, with margins that must be positive where it has a derivative.
    in_loops : bool
        Whether `adjoint` computes gradients with respect to coordinates and speeds, which multipliers of loops balance.
    """

    name: str
    target: str
    value: Block
    tangent: Block
    rows: list[Row] = field(default_factory=list)
    places: list[str] = field(default_factory=list)
    curvature: Callable[[], Block | None] = lambda: None
    of_records: tuple[Block, Block] | None = None
    differentiable: Block | None = None
    in_loops: bool = False

    @cached_property
    def transposed(self) -> Block:
        """The block that computes, from the adjoint of the result, contributions to the adjoints of all values that it reads.

        A margin that must be positive in the tangent must be positive in the transpose, too.
        """
        made = transposed(self.tangent, f"{self.tangent.name}_transposed", f"transpose of {self.tangent.title}")
        made.stores += [s for s in self.tangent.stores if s[0].memory is MARGIN]
        return simplify(made)

    def _adjoint(self) -> Block:
        def place(store: Store) -> Store:
            name = store.name.removeprefix("d")
            return argument(f"{name}_bar" if name == self.target else f"g{name}")

        title = f"adjoint of {self.value.title}"
        return adjoint(self.tangent, f"{self.value.name}_adjoint", title, place, lambda store, name: True)

    @cached_property
    def adjoint(self) -> Block:
        """The block that computes, from the adjoint of the result, contributions to the adjoints of records, or to the
        gradients with respect to coordinates and speeds. Other gradients are not needed."""
        if self.of_records is not None:
            return self.of_records[0]
        made = self._adjoint()
        made.stores = [s for s in made.stores if self.in_loops and s[0].name in ("gq", "gu")]
        return simplify(made)

    @cached_property
    def twice(self) -> Block:
        """The block that computes contributions to the tangents of gradients, from the result's adjoint and its tangent."""
        if self.of_records is not None:
            return self.of_records[1]
        known = self.curvature()
        if known is not None:
            return simplify(known)
        back = self._adjoint()

        def tangent_of(store: Store, name: str) -> Component | None:
            return None if store is NUMBER or store is MODES else (argument(f"d{store.name}", lanes=True), name)

        title = f"tangent of the adjoint of {self.value.title}"
        x = Expansion(f"{self.tangent.name}_twice", title, lambda store, name: True).resume(back)
        return simplify(along(x, tangent_of))
