"""A nut on a threaded rod."""

from __future__ import annotations

from ..entries import Axis, Expr
from ..motions import Slide, Turn
from .joint_type import JointType


class Screw(JointType):
    """Turns about an axis and slides along it by the pitch, m/rad, times the angle."""

    name = "screw"
    motion = (Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0))
    closes_none = (
        "closes no loop, since its faces do not show how many turns it has made; let it carry a body without mass, and "
        "close the loop with a fixed joint at that body"
    )

    axis: Axis
    pitch: Expr
