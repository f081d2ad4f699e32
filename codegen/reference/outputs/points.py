"""Position and velocity of a point along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen, along


def position(output: Output, seen: Seen) -> Pair:
    """n . x"""
    (point,) = output.points
    return along(output, seen, seen.point(point)[0])


def velocity(output: Output, seen: Seen) -> Pair:
    """n . v"""
    (point,) = output.points
    return along(output, seen, seen.point(point)[1])
