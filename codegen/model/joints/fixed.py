"""A joint without freedom."""

from __future__ import annotations

from .joint_type import Closure, JointType


class Fixed(JointType):
    """Holds the child's frame on the joint's frame; of a loop, both faces on each other."""

    name = "fixed"
    closure = Closure(linear=3, angular=3)
