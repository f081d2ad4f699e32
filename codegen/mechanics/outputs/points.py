"""Position and velocity of a point along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot
from .measure import RecordMeasure
from .records import Records


def position(records: Records, output: Output) -> Value:
    """``n . x``"""
    (point,) = output.points
    n = records.direction(output.axis)
    return dot(n, records.position(point))


def velocity(records: Records, output: Output) -> Value:
    """``n . v``"""
    (point,) = output.points
    n = records.direction(output.axis)
    return dot(n, records.velocity(point))


POSITION = RecordMeasure(("pose",), position)
VELOCITY = RecordMeasure(("pose", "kinetic"), velocity)
