"""Angular velocity of a body along an axis of the ground or of its own."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot, matvec
from .measure import RecordMeasure
from .records import Records


def angular_velocity(records: Records, output: Output) -> Value:
    """``n . W w``, or the axis turned from the body's axes into those of its link, where w is."""
    (body,) = output.bodies
    (frame,) = output.choice
    n = records.direction(output.axis)
    w = records.angular_velocity(body)
    if frame == "ground":
        return dot(n, records.to_ground(body, w))
    return dot([records.x.let("n", e) for e in matvec(records.body_axes(body), n)], w)


ANGULAR_VELOCITY = RecordMeasure(("pose", "kinetic"), angular_velocity)
