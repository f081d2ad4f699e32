"""Distance of two points."""

from __future__ import annotations

from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import dot, minus
from .measure import RecordMeasure
from .records import Records


def distance(records: Records, output: Output) -> Value:
    """``|x_2 - x_1|``, whose derivative needs a direction."""
    first, second = map(records.position, output.points)
    line = [records.x.let("line", e) for e in minus(second, first)]
    square = records.x.let("square", dot(line, line))
    records.differs(square)
    length: Value = records.x.let("length", records.x.sqrt(square))
    return length


DISTANCE = RecordMeasure(("pose",), distance, pivots=True)
