"""Position and velocity of a point relative to another one, along an axis."""

from __future__ import annotations

from typing import Any, ClassVar

from ..entry_reader import EntryReader
from .keys import OptionalAxis, TwoPoints
from .output import Measure, Output, Speaker


class RelativePosition(Measure):
    """From the first point to the second, along an axis of the ground frame, m."""

    name = "relative_position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"relative_position": TwoPoints, "axis": OptionalAxis}
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector in the ground frame"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        first, second = (x.point(p, (cls.name, i), x.name) for i, p in enumerate(getattr(entry, cls.name)))
        return None if first is None or second is None else Output(x.name, cls.name, (first, second), axis)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        first, second = map(say.point, output.points)
        assert output.axis is not None
        return f"{cls.name.replace('_', ' ')} from {first} to {second} along {say.axis(output.axis)}"


class RelativeVelocity(RelativePosition):
    """Its derivative in time, m/s."""

    name = "relative_velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"relative_velocity": TwoPoints, "axis": OptionalAxis}
