"""Joints that slide along an axis."""

from __future__ import annotations

from typing import ClassVar

from ...model.motions import Motion, Slide
from ...program.scalar import Value
from .axial import Axial


class Prismatic(Axial):
    """A prismatic joint."""

    motion: ClassVar[tuple[Motion, ...]] = (Slide(axis=0, index=0),)
    freedoms, coordinates, slides = 1, 1, True

    def shift(self) -> Value:
        return self.own_coordinate()

    def slide_speed(self) -> Value:
        return self.own_speed()

    def shift_tangent(self) -> Value:
        return self.own_change()
