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
    """

    name: str
    target: str
    value: Block
    tangent: Block
    rows: list[Row] = field(default_factory=list)
    places: list[str] = field(default_factory=list)
    curvature: Callable[[], Block | None] = lambda: None

    @cached_property
    def transposed(self) -> Block:
        """From the adjoint of a result, compute the contributions to the adjoints of everything it depends on.

        A margin that must be positive in the tangent must be positive in the transpose, too.
        """
        made = transposed(self.tangent, f"{self.tangent.name}_transposed", f"transpose of {self.tangent.title}")
        made.stores += [s for s in self.tangent.stores if s[0].memory is MARGIN]
        return simplify(made)

    @cached_property
    def twice(self) -> Block:
        """From the adjoint of a result and its tangent, compute the contributions to the tangents of the gradients."""
        known = self.curvature()
        if known is not None:
            return simplify(known)

        def place(store: Store) -> Store:
            name = store.name.removeprefix("d")
            return argument(f"{name}_bar" if name == self.target else f"g{name}")

        back = adjoint(self.tangent, f"{self.tangent.name}_adjoint", "", place, lambda store, name: True)

        def tangent_of(store: Store, name: str) -> Component | None:
            return None if store is NUMBER or store is MODES else (argument(f"d{store.name}", lanes=True), name)

        title = f"tangent of the adjoint of {self.value.title}"
        x = Expansion(f"{self.tangent.name}_twice", title, lambda store, name: True).resume(back)
        return simplify(along(x, tangent_of))
