"""Motion of joints in floating-point numbers: chains of elementary motions, for all joints of one type at once.

Coordinates of S states are arrays ``(S, nq + 1)`` with a zero at the end. Quantities of m joints of one type are arrays
``(S, m, ...)``. Each kind of elementary motion is a class here; everything else follows from their order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from .motions import Ball, Displacement, Motion, Slide, Turn
from .vectors import Array, U, axis_rotation, cross, quaternion_rotation, skew, turn


@dataclass(slots=True, kw_only=True)
class Step:
    """An elementary motion of m joints, from a frame before it to a frame behind it.

    Attributes
    ----------
    speeds : slice
        Its speeds among those of a joint, see `speeds_of`.
    place : (m,) or (m, c) array
        Indices of its coordinates in q.
    w, v : (m, f, 3) array
        Angular velocity and velocity per unit speed, components of the frame behind it; None for zero.
    """

    speeds: slice
    place: Array
    w: Array | None = None
    v: Array | None = None

    def of(self, rows: Array) -> Self:
        """This step of the chain, restricted to some of the joints in the batch."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "speeds"}
        return replace(self, **{name: x[rows] for name, x in arrays.items() if x is not None})

    def rotation(self, q: Array) -> Array | None:
        """Rotation matrix to components of the frame before the step from components of the frame behind it, ``(S, m,
        3, 3)``."""
        return None

    def back(self, q: Array) -> Array | None:
        """Rotation matrix to components of the frame behind the step from components of the frame before it, ``(S, m,
        3, 3)``."""
        return None

    def shift(self, q: Array) -> Array | None:
        """Origin of the frame behind, components of the frame before, ``(S, m, 3)``, m."""
        return None


@dataclass(slots=True, kw_only=True)
class _Turn(Step):
    K: Array
    KK: Array

    def rotation(self, q: Array) -> Array:
        return axis_rotation(self.K, self.KK, q[:, self.place])

    def back(self, q: Array) -> Array:
        return axis_rotation(self.K, self.KK, -q[:, self.place])


@dataclass(slots=True, kw_only=True)
class _Slide(Step):
    along: Array

    def shift(self, q: Array) -> Array:
        return q[:, self.place, None] * self.along


@dataclass(slots=True, kw_only=True)
class _Ball(Step):
    def rotation(self, q: Array) -> Array:
        return quaternion_rotation(q[:, self.place])

    def back(self, q: Array) -> Array:
        return np.swapaxes(self.rotation(q), -1, -2)


@dataclass(slots=True, kw_only=True)
class _Displacement(Step):
    """A displacement; `v` has components of the frame at the chain's end."""

    def shift(self, q: Array) -> Array:
        return q[:, self.place]


def step(motion: Motion, start: Array, axes: Array, factors: Array) -> Step:
    """The step for an elementary motion of m joints.

    Parameters
    ----------
    start : (m,) array
        Index of each joint's first coordinate in q.
    axes : (m, a, 3) array
        Unit vectors in the joint frame.
    factors : (m, c) array
    """
    speeds, units = speeds_of(motion), np.broadcast_to(U, (len(start), 3, 3))
    match motion:
        case Turn(axis, i):
            K = skew(axes[:, axis])
            return _Turn(speeds=speeds, place=start + i, w=axes[:, axis, None], K=K, KK=K @ K)
        case Slide(axis, i, factor):
            along = axes[:, axis] if factor is None else axes[:, axis] * factors[:, factor, None]
            return _Slide(speeds=speeds, place=start + i, v=along[:, None], along=along)
        case Ball(i, _):
            return _Ball(speeds=speeds, place=start[:, None] + (i + np.arange(4)), w=units)
        case Displacement(i, _):
            return _Displacement(speeds=speeds, place=start[:, None] + (i + np.arange(3)), v=units)


class Chain:
    """The motion of m joints of one type: a chain of elementary motions.

    Parameters
    ----------
    motion : sequence of Motion
    steps : sequence of Step
        One for each elementary motion.

    Attributes
    ----------
    altered : list of int
        Steps whose screws are changed by later steps, see `changed`.
    turns : bool
        Whether the body rotates relative to its parent.
    """

    def __init__(self, motion: Sequence[Motion], steps: Sequence[Step]) -> None:
        self.motion, self.steps = motion, steps
        self.altered = changed(motion)
        self.turns = any(isinstance(m, Turn | Ball) for m in motion)

    def of(self, rows: Array) -> Chain:
        """The chain of some of the joints in this batch."""
        part = copy(self)
        part.steps = [step.of(rows) for step in self.steps]
        return part

    def without_first(self) -> Chain:
        """The chain without its first elementary motion."""
        return Chain(self.motion[1:], self.steps[1:])

    def unit_screws(self, steps: Iterable[int]) -> tuple[Array, Array]:
        """Unit screws w and v ``(m, f, 3)`` of some steps, as if the steps after them did not move; components along the axes
        of the frame that follows each step."""
        m, f = len(self.steps[0].place), max(step.speeds.stop for step in self.steps)
        w, v = np.zeros((m, f, 3)), np.zeros((m, f, 3))
        for step in (self.steps[i] for i in steps):
            if step.w is not None:
                w[:, step.speeds] += step.w
            if step.v is not None:
                v[:, step.speeds] += step.v
        return w, v

    def transforms(self, q: Array) -> tuple[Array | None, Array | None]:
        """Rotation from child to joint frame, and the child's origin in the joint frame; None for identity or zero."""
        R = d = None
        for step in self.steps:
            moved, turned = step.shift(q), step.rotation(q)
            if moved is not None:
                moved = moved if R is None else turn(R, moved)
                d = moved if d is None else d + moved
            if turned is not None:
                R = turned if R is None else R @ turned
        return R, d

    def screws(self, q: Array) -> list[tuple[Array | None, Array | None]]:
        """Unit screws w, v ``(S, m, f, 3)``, about the child's origin, of the steps in `altered`; None for zero.

        The screw of a step is transformed by all motions that follow it.
        """
        first = min(self.altered, default=0) + 1
        followers = [(step.shift(q), step.back(q)) for step in self.steps[first:]]
        found = []
        for i in self.altered:
            w, v = self.steps[i].w, self.steps[i].v
            for moved, back in followers[i + 1 - first :]:
                if moved is not None and w is not None:
                    arm = cross(w, moved[:, :, None])
                    v = arm if v is None else v + arm
                if back is not None:
                    back = back[:, :, None]
                    w = w if w is None else turn(back, w)
                    v = v if v is None else turn(back, v)
            found.append((w, v))
        return found


def speeds_of(motion: Motion) -> slice:
    """The speeds of an elementary motion, among those of its joint."""
    if isinstance(motion, Turn | Slide):
        return slice(motion.index, motion.index + 1)
    return slice(motion.speed, motion.speed + 3)


def changed(motion: Sequence[Motion]) -> list[int]:
    """Indices of motions whose screws change, because later motions rotate them or shift them off their axes."""

    def alters(other: Motion, m: Motion) -> bool:
        if isinstance(m, Displacement):
            return False
        if isinstance(m, Turn | Slide) and isinstance(other, Turn | Slide) and m.axis == other.axis:
            return False
        return isinstance(other, Turn | Ball) or isinstance(m, Turn | Ball)

    return [i for i, m in enumerate(motion) if any(alters(other, m) for other in motion[i + 1 :])]
