"""Joints that rotate about an axis."""

from __future__ import annotations

from ...model.motions import Turn
from .axial import Axial


class Revolute(Axial):
    """A revolute joint."""

    motion = (Turn(axis=0, index=0),)
    freedoms, coordinates, angle = 1, 1, 0
