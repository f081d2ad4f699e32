"""A measure in the generator: the quantities that it reads, and its statements."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...model.expressions import Expression
from ...model.outputs import Output
from ...program.scalar import Value
from ...records import dataclass
from ..structure.system import System
from .records import Records

Write = Callable[[Records, Output], Value]
"""A function that writes the statements of an output's value."""


@dataclass(frozen=True, slots=True)
class RecordMeasure:
    """A measure computed from the records of links and from sums over all links.

    Attributes
    ----------
    reads : tuple of str
        Names of `quantities.QUANTITIES`.
    write : callable (Records, Output) -> Value
    also : callable (Output) -> tuple of str
        Further quantities that a given output reads.
    pivots : bool
        Some states have a value but no derivative; `Records.differs` reports them.
    more : callable (Output, System) -> sequence of Expression
        Expressions that `write` evaluates in addition to the output's own, in the same order for all outputs of one
        form.
    """

    reads: tuple[str, ...]
    write: Write
    also: Callable[[Output], tuple[str, ...]] = lambda output: ()
    pivots: bool = False
    more: Callable[[Output, System], Sequence[Expression]] = lambda output, system: ()


@dataclass(frozen=True, slots=True)
class FormulaMeasure:
    """A measure computed by an expression of the model."""


@dataclass(frozen=True, slots=True)
class EnergyMeasure:
    """A measure that is an entry of the array of energies.

    Attributes
    ----------
    entry : int
        Index in that array.
    """

    entry: int


@dataclass(frozen=True, slots=True)
class DrivingMeasure:
    """The force that a prescribed motion requires, from back substitution."""


Measure = RecordMeasure | FormulaMeasure | EnergyMeasure | DrivingMeasure
