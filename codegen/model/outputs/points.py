"""Position and velocity of a point along an axis."""

from __future__ import annotations

from typing import Any, ClassVar

from ..entry_reader import EntryReader
from .keys import OptionalAxis, OptionalPoint
from .output import Measure, Output


class Position(Measure):
    """Of a point in the ground frame, along an axis, m."""

    name = "position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"position": OptionalPoint, "axis": OptionalAxis}
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector in the ground frame"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        point = x.point(getattr(entry, cls.name), cls.name, x.name)
        return None if point is None else Output(x.name, cls.name, (point,), axis)


class Velocity(Position):
    """Its derivative in time, m/s."""

    name = "velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"velocity": OptionalPoint, "axis": OptionalAxis}
