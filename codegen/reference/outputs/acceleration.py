"""Acceleration of a point along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen, along


def acceleration(output: Output, seen: Seen) -> Pair:
    """n . a"""
    (point,) = output.points
    return along(output, seen, seen.acceleration(point))
