"""A slider that turns about its axis."""

from __future__ import annotations

from ..entries import Axis
from ..motions import Slide, Turn
from .joint_type import Closure, JointType


class Cylindrical(JointType):
    """Slides along an axis and turns about it. Of a loop: the axes lie on one line."""

    name = "cylindrical"
    motion = (Slide(axis=0, index=0), Turn(axis=0, index=1))
    closure = Closure(linear=2, angular=2)

    axis: Axis
