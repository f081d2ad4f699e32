"""No joint at all: all six freedoms."""

from __future__ import annotations

from ..motions import Ball, Displacement
from .joint_type import JointType


class Free(JointType):
    """Moves freely: position in the joint's frame, attitude by a quaternion; both velocities are in child components."""

    name = "free"
    motion = (Displacement(coordinate=0, speed=3), Ball(coordinate=3, speed=0))
