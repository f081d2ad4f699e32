"""Position and velocity of a point relative to another one, along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen, along


def relative_position(output: Output, seen: Seen) -> Pair:
    """n . (x_2 - x_1)"""
    first, second = (seen.point(p)[0] for p in output.points)
    return along(output, seen, second - first)


def relative_velocity(output: Output, seen: Seen) -> Pair:
    """n . (v_2 - v_1)"""
    first, second = (seen.point(p)[1] for p in output.points)
    return along(output, seen, second - first)
