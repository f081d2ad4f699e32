"""Hooke's joint."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..entries import Axis
from ..motions import Turn
from .joint_type import Closure, JointType


class Universal(JointType):
    """Turns about an axis fixed in the parent and one fixed in the child, which are perpendicular.

    Of a loop: origins coincide, the axes, the first fixed in the start face, the second in the end face, are perpendicular.
    """

    name = "universal"
    motion = (Turn(axis=0, index=0), Turn(axis=1, index=1))
    closure = Closure(linear=3, angular=1)

    axes: tuple[Axis, Axis]

    @classmethod
    def wrong_axes(cls, axes: Sequence[Sequence[float]]) -> tuple[str, str] | None:
        a, b = axes
        lengths = math.hypot(*a), math.hypot(*b)
        cosine = sum(x / lengths[0] * (y / lengths[1]) for x, y in zip(a, b, strict=True)) if all(lengths) else 0.0
        if abs(cosine) <= 1e-9:
            return None
        return (
            "axes",
            f"the two axes have cosine {cosine:.3g}; those of a universal joint are perpendicular (to 1e-9)",
        )
