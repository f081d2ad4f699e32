"""What an output is, and what the entry of one is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from ..axes import Vector
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Point


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """A named scalar of interest.

    Attributes
    ----------
    measure : str
        What of: a name of `outputs.MEASURES`.
    points, axis, expression, bodies
        Those that it has; the axis is not normalised, bodies are indices of `Model.bodies` or `GROUND`.
    choice : tuple of str
        What its measure lets one choose by words, such as the entry of a matrix.
    """

    name: str
    measure: str
    points: tuple[Point, ...] = ()
    axis: Vector | None = None
    expression: Expression | None = None
    bodies: tuple[int, ...] = ()
    choice: tuple[str, ...] = ()

    def expressions(self) -> Iterator[Expression]:
        for point in self.points:
            yield from point.at
        if self.axis:
            yield from self.axis
        if self.expression:
            yield self.expression

    @property
    def on(self) -> tuple[int, ...]:
        """The bodies that it is about: those of its points, then its own; each once."""
        return tuple(dict.fromkeys((*(p.body for p in self.points), *self.bodies)))


class Speaker(Protocol):
    """Says what an output is made of; see `codegen.listing`."""

    def name(self, body: int) -> str:
        """Of a body, or ``ground``."""

    def point(self, point: Point) -> str:
        """A point."""

    def axis(self, axis: Vector) -> str:
        """A direction."""

    def long(self, expression: Expression) -> str:
        """An expression."""


class Measure:
    """A type of output.

    Attributes
    ----------
    name : str
        The key that it has, or what stands in the place of a mapping.
    keys : dict of str to type
        What a mapping holds; the first key is its name. Without keys it is written as its name alone.
    hints : dict of str to str
        For keys that have to stand beside the first: what to add.
    unit : str
        Empty for what has none, or none that is known.
    """

    name: ClassVar[str]
    keys: ClassVar[dict[str, Any]] = {}
    hints: ClassVar[dict[str, str]] = {}
    unit: ClassVar[str] = ""

    @classmethod
    def unit_of(cls, output: Output) -> str:
        """The unit of an output; `unit`, where all have the same."""
        return cls.unit

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        """The output of an entry (None for one without keys), or None after a problem."""
        return Output(x.name, cls.name)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        """What it is, for people."""
        found = cls.name.replace("_", " ")
        if output.points:
            found += f" of {' and '.join(map(say.point, output.points))}"
        return found if output.axis is None else f"{found} along {say.axis(output.axis)}"
