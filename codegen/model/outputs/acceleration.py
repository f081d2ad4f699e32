"""Acceleration of a point along an axis."""

from __future__ import annotations

from typing import Any, ClassVar

from .keys import OptionalAxis, OptionalPoint
from .points import Position


class Acceleration(Position):
    """Of a point against the ground, along an axis of it, m/s^2."""

    name = "acceleration"
    unit = "m/s^2"
    keys: ClassVar[dict[str, Any]] = {"acceleration": OptionalPoint, "axis": OptionalAxis}
