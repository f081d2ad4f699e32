"""Position and velocity of a point relative to another one, along an axis of the ground."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot, minus
from .measure import RecordMeasure
from .records import Records


def relative_position(records: Records, output: Output) -> Value:
    """``n . (x_2 - x_1)``"""
    n = records.direction(output.axis)
    first, second = map(records.position, output.points)
    return dot(n, [records.x.let("line", e) for e in minus(second, first)])


def relative_velocity(records: Records, output: Output) -> Value:
    """``n . (v_2 - v_1)``"""
    n = records.direction(output.axis)
    first, second = map(records.velocity, output.points)
    return dot(n, [records.x.let("line", e) for e in minus(second, first)])


RELATIVE_POSITION = RecordMeasure(("pose",), relative_position)
RELATIVE_VELOCITY = RecordMeasure(("pose", "kinetic"), relative_velocity)
