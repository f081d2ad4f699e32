"""A slider."""

from __future__ import annotations

from ..entries import Axis
from ..motions import Slide
from .joint_type import Closure, JointType


class Prismatic(JointType):
    """Slides along an axis. Of a loop: the faces are parallel, the origins differ along the axis only."""

    name = "prismatic"
    motion = (Slide(axis=0, index=0),)
    closure = Closure(linear=2, angular=3)

    axis: Axis
