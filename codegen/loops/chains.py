"""Joints in motion, on floats: chains of elementary motions, those of many joints of one type at once.

Coordinates come in batches, ``(S, nq + 1)`` with a zero behind; m joints of a type have arrays ``(S, m, ...)``. Each kind of
elementary motion is a class here; everything else follows from their order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..model.motions import Ball, Displacement, Motion, Slide, Turn
from .vectors import Array, U, axis_rotation, cross, quaternion_rotation, skew, turn


class Step(Protocol):
    """An elementary motion of m joints.

    Attributes
    ----------
    speeds : range
        Which of a joint's speeds are its own.
    w, v : (m, f, 3) array
        Angular velocity and velocity, in components behind it, of unit speeds; None where there is none.
    """

    speeds: range
    w: Array | None
    v: Array | None

    def rotation(self, q: Array) -> Array | None:
        """Components behind it into components before it, ``(S, m, 3, 3)``."""

    def back(self, q: Array) -> Array | None:
        """The inverse of `rotation`."""

    def shift(self, q: Array) -> Array | None:
        """The origin behind it in components before it, ``(S, m, 3)``, m."""


class _Turn:
    v = None

    def __init__(self, motion: Turn, start: Array, axes: Array, factors: Array) -> None:
        self.place, axis = start + motion.index, axes[:, motion.axis]
        self.speeds, self.w = range(motion.index, motion.index + 1), axis[:, None]
        self.K = skew(axis)
        self.KK = self.K @ self.K

    def rotation(self, q: Array) -> Array:
        return axis_rotation(self.K, self.KK, q[:, self.place])

    def back(self, q: Array) -> Array:
        return axis_rotation(self.K, self.KK, -q[:, self.place])

    def shift(self, q: Array) -> None:
        return None


class _Slide:
    w = None

    def __init__(self, motion: Slide, start: Array, axes: Array, factors: Array) -> None:
        self.place, self.along = start + motion.index, axes[:, motion.axis]
        if motion.factor is not None:
            self.along = self.along * factors[:, motion.factor, None]
        self.speeds, self.v = range(motion.index, motion.index + 1), self.along[:, None]

    def rotation(self, q: Array) -> None:
        return None

    def back(self, q: Array) -> None:
        return None

    def shift(self, q: Array) -> Array:
        return q[:, self.place, None] * self.along


class _Ball:
    v = None

    def __init__(self, motion: Ball, start: Array, axes: Array, factors: Array) -> None:
        self.place = start[:, None] + (motion.coordinate + np.arange(4))
        self.speeds, self.w = range(motion.speed, motion.speed + 3), np.broadcast_to(U, (len(start), 3, 3))

    def rotation(self, q: Array) -> Array:
        return quaternion_rotation(q[:, self.place])

    def back(self, q: Array) -> Array:
        return np.swapaxes(self.rotation(q), -1, -2)

    def shift(self, q: Array) -> None:
        return None


class _Displacement:
    """Its velocities are in components of the chain's end, so none are behind it."""

    w = v = None

    def __init__(self, motion: Displacement, start: Array, axes: Array, factors: Array) -> None:
        self.place = start[:, None] + (motion.coordinate + np.arange(3))
        self.speeds = range(0)

    def rotation(self, q: Array) -> None:
        return None

    def back(self, q: Array) -> None:
        return None

    def shift(self, q: Array) -> Array:
        return q[:, self.place]


_STEPS = {Turn: _Turn, Slide: _Slide, Ball: _Ball, Displacement: _Displacement}


class Chain:
    """The motion of m joints of one type.

    Parameters
    ----------
    motion : sequence of Motion
    start : (m,) array
        Where the joints' coordinates begin in q.
    axes : (m, a, 3) array
        Of unit length, in the joint frame.
    factors : (m, c) array

    Attributes
    ----------
    w, v : (m, f, 3) array
        Unit screws of the speeds about the child's origin, child components, as far as they are constant.
    changes : bool
        Whether they depend on coordinates.
    """

    def __init__(self, motion: Sequence[Motion], start: Array, axes: Array, factors: Array) -> None:
        self.steps: list[Step] = [_STEPS[type(m)](m, start, axes, factors) for m in motion]
        speeds = max((s.stop for s in map(speeds_of, motion)), default=0)
        self.w, self.v = (np.zeros((len(start), speeds, 3)) for _ in range(2))
        for m, step in zip(motion, self.steps, strict=True):
            if step.w is not None:
                self.w[:, step.speeds] += step.w
            if step.v is not None:
                self.v[:, step.speeds] += step.v
            if isinstance(m, Displacement):
                self.v[:, speeds_of(m)] += U
        self.changes = changes(motion)

    def transforms(self, q: Array) -> tuple[Array | None, Array | None]:
        """Child components into components of the joint frame, and the child's origin there; None where that is the frame's."""
        R = d = None
        for step in self.steps:
            moved, turned = step.shift(q), step.rotation(q)
            if moved is not None:
                moved = moved if R is None else turn(R, moved)
                d = moved if d is None else d + moved
            if turned is not None:
                R = turned if R is None else R @ turned
        return R, d

    def screws(self, q: Array) -> tuple[Array, Array]:
        """Unit screws of the speeds about the child's origin, child components, ``(S, m, f, 3)`` each.

        What a motion does is seen through all that follow it.
        """
        w, v = (np.zeros((len(q), *x.shape)) for x in (self.w, self.v))
        known: list[int] = []
        for step in self.steps:
            if known:
                moved, back = step.shift(q), step.back(q)
                if moved is not None:
                    v[:, :, known] += cross(w[:, :, known], moved[:, :, None])
                if back is not None:
                    w[:, :, known] = turn(back[:, :, None], w[:, :, known])
                    v[:, :, known] = turn(back[:, :, None], v[:, :, known])
            if step.w is not None:
                w[:, :, step.speeds] += step.w
            if step.v is not None:
                v[:, :, step.speeds] += step.v
            known += [s for s in step.speeds if s not in known]
        rest = [s for s in range(w.shape[2]) if s not in known]  # of displacements
        v[:, :, rest] = self.v[:, rest]
        return w, v


def speeds_of(motion: Motion) -> range:
    """Which of a joint's speeds are those of an elementary motion."""
    if isinstance(motion, Turn | Slide):
        return range(motion.index, motion.index + 1)
    return range(motion.speed, motion.speed + 3)


def changes(motion: Sequence[Motion]) -> bool:
    """Whether unit screws depend on coordinates: one is followed by a motion that turns it, or shifts it off its axis."""
    for i, m in enumerate(motion):
        for other in motion[i + 1 :]:
            along = isinstance(m, Turn | Slide) and isinstance(other, Turn | Slide) and m.axis == other.axis
            turned = isinstance(other, Turn | Ball) and not isinstance(m, Displacement)
            shifted = isinstance(other, Slide | Displacement) and isinstance(m, Turn | Ball)
            if (turned or shifted) and not along:
                return True
    return False
