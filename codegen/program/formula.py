"""Formulas: expressions that are evaluated beside the sweeps, such as joint forces and outputs."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property

from ..records import dataclass
from .block import Block
from .passes import simplify
from .store import MARGIN
from .transpose import transposed

Row = tuple[int, tuple[int, ...], list[int], list[float]]
"""Target index, of several entries that of the first; links; indices for the slots; numbers."""


@dataclass(eq=False)
class Formula:
    """Formulas of one form, which share one block; what each reads is data.

    Attributes
    ----------
    name : str
        Of its functions.
    target : str
        The result whose entries are written.
    value, tangent : Block
        From arguments, numbers and the records of links; the tangent from their seeds and lanes, too.
    rows : list of (int, tuple of int, list of int, list of float)
        For each formula: target index, links, indices for the slots, numbers.
    places : list of str
        For each formula: its path in the model file.
    """

    name: str
    target: str
    value: Block
    tangent: Block
    rows: list[Row] = field(default_factory=list)
    places: list[str] = field(default_factory=list)

    @cached_property
    def transposed(self) -> Block:
        """From the adjoint of a result to what it adds to those of everything that the result is a function of.

        What the tangent asks to be positive, it asks too.
        """
        made = transposed(self.tangent, f"{self.tangent.name}_transposed", f"transpose of {self.tangent.title}")
        made.stores += [s for s in self.tangent.stores if s[0].memory is MARGIN]
        return simplify(made)
