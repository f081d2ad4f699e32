"""Acceleration of a point along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot
from .measure import RecordMeasure
from .records import Records


def acceleration(records: Records, output: Output) -> Value:
    """``n . W (a + B r)``"""
    (point,) = output.points
    n = records.direction(output.axis)
    return dot(n, records.acceleration(point))


ACCELERATION = RecordMeasure(("pose", "acceleration"), acceleration)
