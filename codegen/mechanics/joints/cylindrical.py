"""Joints that slide along an axis and rotate about it."""

from __future__ import annotations

from ...model.motions import Slide, Turn
from ...program.scalar import Value, Vector
from ..stores import DQ, SPEEDS
from .prismatic import Prismatic


class Cylindrical(Prismatic):
    """A cylindrical joint, represented by one link: both partial velocities are constant along its axes."""

    motion = (Slide(axis=0, index=0), Turn(axis=0, index=1))
    freedoms, coordinates, angle = 2, 2, 1

    def turn_speed(self) -> Value:
        return self.x.entry(SPEEDS, 1)

    def displacement(self) -> tuple[Vector, Vector]:
        return self._along_axis(self.x.entry(DQ, 1)), self._along_axis(self.shift_tangent())
