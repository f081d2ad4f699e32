"""Angular velocity of a body about an axis fixed in the ground or in the body."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot, matvec
from .measure import RecordMeasure
from .records import Records


def angular_velocity(records: Records, output: Output) -> Value:
    """``n . W w``; an axis of the body is first rotated into the axes of its link, along which w is given."""
    (body,) = output.bodies
    (frame,) = output.choice
    n = records.direction(output.axis)
    w = records.angular_velocity(body)
    if frame == "ground":
        return dot(n, records.to_ground(body, w))
    return dot([records.x.let("n", e) for e in matvec(records.body_axes(body), n)], w)


ANGULAR_VELOCITY = RecordMeasure(("pose", "kinetic"), angular_velocity)
