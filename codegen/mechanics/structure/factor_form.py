"""Structure of a factored closure matrix, without its numbers: `ears.orthogonal` determines it, and other blocks use
it to load the factor."""

from __future__ import annotations

from ...records import dataclass


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the factorisation of a closure matrix.

    Attributes
    ----------
    column : int
    unit : list of int
        The row of the only nonzero entry of the column of Q, if there is only one; otherwise empty.
    support : list of int
        If the column has several nonzero entries, their rows.
    above : list of int
        Earlier steps onto which its column was projected.
    """

    column: int
    unit: list[int]
    support: list[int]
    above: list[int]


@dataclass(frozen=True, slots=True)
class FactorForm:
    """Structure of a factored closure matrix; the block that factors it fills this in, for blocks that load the factor.

    Attributes
    ----------
    rows : list of int
        Rows of the closure matrix that may be nonzero, as numbers of conditions.
    steps : list of Step
    """

    rows: list[int]
    steps: list[Step]


NO_FORM = FactorForm([], [])
"""The empty form of a matrix that has not been factored yet."""
