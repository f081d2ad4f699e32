"""A body on a plane."""

from __future__ import annotations

from typing import ClassVar

from ..axes import Vector, coordinate_axis, cross, least_along, signed_base
from ..entries import Axis
from ..motions import Slide, Turn
from .joint_type import Closure, JointType


class Planar(JointType):
    """Slides along two axes across a normal, x and y if that is z, and turns about the normal.

    Of a loop: the normals are parallel, the origin of `end` lies in the plane through that of `start`.
    """

    name = "planar"
    motion = (Slide(axis=1, index=0), Slide(axis=2, index=1), Turn(axis=0, index=2))
    closure = Closure(linear=1, angular=2)
    triad = True
    misspelt: ClassVar[dict[str, str]] = {"axis": "normal"}

    normal: Axis

    @classmethod
    def axes_of_motion(cls, given: tuple[Vector, ...], defaults: dict[str, float]) -> tuple[Vector, ...]:
        """The normal and two axes across it, right-handed: the frame of a loop's conditions, see `closure_row_names`."""
        (normal,) = given
        along = coordinate_axis(normal)
        if along is None:
            first = cross(signed_base(least_along(normal, defaults)), normal)
            return normal, first, cross(normal, first)
        i, sign = along
        return normal, signed_base((i + 1) % 3), signed_base((i + 2) % 3, sign)
