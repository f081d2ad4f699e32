"""A ball and socket."""

from __future__ import annotations

from ..motions import Ball
from .joint_type import Closure, JointType


class Spherical(JointType):
    """Turns about its origin. Of a loop, where it is called ``point`` too: origins coincide."""

    name = "spherical"
    synonyms = ("point",)
    motion = (Ball(coordinate=0, speed=0),)
    closure = Closure(linear=3, angular=0)
