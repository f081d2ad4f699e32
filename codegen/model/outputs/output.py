"""What an output is, and what the entry of one is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

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
    point, axis, expression
        Those that it has; the axis is in the ground frame and not normalised.
    """

    name: str
    measure: str
    point: Point | None = None
    axis: Vector | None = None
    expression: Expression | None = None

    def expressions(self) -> Iterator[Expression]:
        if self.point:
            yield from self.point.at
        if self.axis:
            yield from self.axis
        if self.expression:
            yield self.expression


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
    """

    name: ClassVar[str]
    keys: ClassVar[dict[str, Any]] = {}
    hints: ClassVar[dict[str, str]] = {}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        """The output of an entry (None for one without keys), or None after a problem."""
        return Output(x.name, cls.name)
