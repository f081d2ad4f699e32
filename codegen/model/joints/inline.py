"""A point on a line."""

from __future__ import annotations

from ..entries import Axis
from ..motions import Ball, Slide
from .joint_type import Closure, JointType


class Inline(JointType):
    """Of a loop: the origin of `end` lies on the axis through that of `start`."""

    name = "inline"
    motion = (Slide(axis=0, index=0), Ball(coordinate=1, speed=1))
    closure = Closure(linear=2, angular=0)
    carries = False

    axis: Axis
