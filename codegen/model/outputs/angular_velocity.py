"""Angular velocity of a body along an axis."""

from __future__ import annotations

from typing import Any, ClassVar, Final

from ..entry_reader import EntryReader
from .keys import OptionalAxis, OptionalBody, word
from .output import Measure, Output, Speaker

FRAMES: Final = ("ground", "body")


class AngularVelocity(Measure):
    """Of a body against the ground, along an axis of the ground frame or of the body, rad/s."""

    name = "angular_velocity"
    unit = "rad/s"
    keys: ClassVar[dict[str, Any]] = {
        "angular_velocity": OptionalBody,
        "axis": OptionalAxis,
        "frame": word(*FRAMES),
    }
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector, in the ground frame or in that of the body"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        body = x.body(entry.angular_velocity, "angular_velocity")
        if body is None:
            return None
        return Output(x.name, cls.name, axis=axis, bodies=(body,), choice=(entry.frame or FRAMES[0],))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        (body,) = map(say.name, output.bodies)
        assert output.axis is not None
        return f"angular velocity of {body} along {say.axis(output.axis)} of the {output.choice[0]}"
