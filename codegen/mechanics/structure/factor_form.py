"""What a factored closure matrix is made of, without its numbers: the form that `ears.orthogonal` finds and others load."""

from __future__ import annotations

from ...records import dataclass


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the elimination of a closure matrix.

    Attributes
    ----------
    column : int
    unit : list of int
        The row of the one entry of a column of Q that is a coordinate direction.
    support : list of int
        Rows of its entries otherwise.
    above : list of int
        Earlier steps that it was projected on.
    """

    column: int
    unit: list[int]
    support: list[int]
    above: list[int]


@dataclass(frozen=True, slots=True)
class FactorForm:
    """What of a factored closure matrix is there: found by the block that factors it, for those that load it.

    Attributes
    ----------
    rows : list of int
        Conditions that can matter, among all.
    steps : list of Step
    """

    rows: list[int]
    steps: list[Step]


NO_FORM = FactorForm([], [])
"""Of what has not been factored yet."""
