"""Joints that rotate about a point."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.motions import Ball
from .quaternion import QuaternionJoint


class Spherical(QuaternionJoint):
    """A spherical joint."""

    motion = (Ball(coordinate=0, speed=0),)
    freedoms, coordinates, quaternion = 3, 4, 0

    @classmethod
    def moved_by(cls, freedoms: Sequence[int]) -> list[int]:
        return list(range(4)) if freedoms else []
