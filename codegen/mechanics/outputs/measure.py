"""What a measure is to the generator: the quantities that it reads, and its statements."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...model.expressions import Expression
from ...model.outputs import Output
from ...program.scalar import Value
from ...records import dataclass
from ..structure.system import System
from .records import Records

Write = Callable[[Records, Output], Value]
"""Writes the statements of an output's value."""


@dataclass(frozen=True, slots=True)
class RecordMeasure:
    """A formula over what sweeps leave in the records of links, and over what they sum up.

    Attributes
    ----------
    reads : tuple of str
        Names of `quantities.QUANTITIES`.
    write : callable (Records, Output) -> Value
    also : callable (Output) -> tuple of str
        What some of its outputs read beside that.
    pivots : bool
        There are states with a value and no derivative, told by `Records.differs`.
    more : callable (Output, System) -> sequence of Expression
        Expressions that `write` evaluates beside the output's own, in an order that depends on their places alone.
    """

    reads: tuple[str, ...]
    write: Write
    also: Callable[[Output], tuple[str, ...]] = lambda output: ()
    pivots: bool = False
    more: Callable[[Output, System], Sequence[Expression]] = lambda output, system: ()


@dataclass(frozen=True, slots=True)
class FormulaMeasure:
    """An expression of the model."""


@dataclass(frozen=True, slots=True)
class EnergyMeasure:
    """One of the energies.

    Attributes
    ----------
    entry : int
        Of the array of energies.
    """

    entry: int


@dataclass(frozen=True, slots=True)
class DrivingMeasure:
    """The force that prescribed motion takes, which back substitution has found."""


Measure = RecordMeasure | FormulaMeasure | EnergyMeasure | DrivingMeasure
