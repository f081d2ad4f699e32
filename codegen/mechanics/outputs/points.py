"""Measures of points: position, velocity or acceleration along an axis, absolute or relative; and distance."""

from __future__ import annotations

from collections.abc import Callable

from ...model.outputs import Output
from ...model.places import Point
from ...program.scalar import Value, Vector
from ..spatial import dot, minus
from .measure import RecordMeasure, Write
from .records import Records


def along_axis(of: Callable[[Records, Point], Vector]) -> Write:
    """``n . x`` of a point, or ``n . (x_2 - x_1)`` of two, where `of` gives x along the ground's axes."""

    def write(records: Records, output: Output) -> Value:
        n = records.direction(output.axis)
        values = [of(records, point) for point in output.points]
        if len(values) == 1:
            return dot(n, values[0])
        first, second = values
        return dot(n, [records.x.let("line", e) for e in minus(second, first)])

    return write


def distance(records: Records, output: Output) -> Value:
    """``|x_2 - x_1|``, which has no derivative where the points coincide."""
    first, second = map(records.position, output.points)
    line = [records.x.let("line", e) for e in minus(second, first)]
    square = records.x.let("square", dot(line, line))
    records.differs(square)
    length: Value = records.x.let("length", records.x.sqrt(square))
    return length


POSITION = RecordMeasure(("pose",), along_axis(Records.position))
VELOCITY = RecordMeasure(("pose", "kinetic"), along_axis(Records.velocity))
ACCELERATION = RecordMeasure(("pose", "acceleration"), along_axis(Records.acceleration))
DISTANCE = RecordMeasure(("pose",), distance, pivots=True)
