"""A hinge."""

from __future__ import annotations

from ..entries import Axis
from ..motions import Turn
from .joint_type import Closure, JointType


class Revolute(JointType):
    """Turns about an axis. Of a loop: origins coincide, the axes are parallel."""

    name = "revolute"
    motion = (Turn(axis=0, index=0),)
    closure = Closure(linear=3, angular=2)

    axis: Axis
