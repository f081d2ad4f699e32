"""Distance of two points."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen


def distance(output: Output, seen: Seen) -> Pair:
    """|x_2 - x_1|

    Raises
    ------
    ValueError
        The points coincide, and a derivative is asked for.
    """
    first, second = (seen.point(p)[0] for p in output.points)
    line = second - first
    square = seen.pairs.dot(line, line)
    if square.value == 0 and seen.pairs.k:
        raise ValueError(f"output {output.name}: its two points coincide, so their distance has no derivative")
    return seen.pairs.call("sqrt", square)
