"""Joints in motion, on floats: chains of elementary motions, those of many joints of one type at once.

Coordinates come in batches, ``(S, nq + 1)`` with a zero behind; m joints of a type have arrays ``(S, m, ...)``. Each kind of
elementary motion is a class here; everything else follows from their order.
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
    """An elementary motion of m joints.

    Attributes
    ----------
    speeds : slice
        Which of a joint's speeds are its own, see `speeds_of`.
    place : (m,) or (m, c) array
        Its coordinates in q.
    w, v : (m, f, 3) array
        Angular velocity and velocity, in components behind it, of unit speeds; None where there is none.
    """

    speeds: slice
    place: Array
    w: Array | None = None
    v: Array | None = None

    def of(self, rows: Array) -> Self:
        """That of some of the joints."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "speeds"}
        return replace(self, **{name: x[rows] for name, x in arrays.items() if x is not None})

    def rotation(self, q: Array) -> Array | None:
        """Components behind it into components before it, ``(S, m, 3, 3)``."""
        return None

    def back(self, q: Array) -> Array | None:
        """The inverse of `rotation`."""
        return None

    def shift(self, q: Array) -> Array | None:
        """The origin behind it in components before it, ``(S, m, 3)``, m."""
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
    """Its velocities `v` are in components of the chain's end."""

    def shift(self, q: Array) -> Array:
        return q[:, self.place]


def step(motion: Motion, start: Array, axes: Array, factors: Array) -> Step:
    """A motion of m joints.

    Parameters
    ----------
    start : (m,) array
        Where the joints' coordinates begin in q.
    axes : (m, a, 3) array
        Of unit length, in the joint frame.
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
    """The motion of m joints of one type.

    Parameters
    ----------
    motion : sequence of Motion
    steps : sequence of Step
        One for each.

    Attributes
    ----------
    seen : list of int
        Steps that later ones change, see `changed`.
    turns : bool
        Whether a body turns against its parent.
    """

    def __init__(self, motion: Sequence[Motion], steps: Sequence[Step]) -> None:
        self.motion, self.steps = motion, steps
        self.seen = changed(motion)
        self.turns = any(isinstance(m, Turn | Ball) for m in motion)

    def of(self, rows: Array) -> Chain:
        """That of some of the joints."""
        part = copy(self)
        part.steps = [step.of(rows) for step in self.steps]
        return part

    def behind_first(self) -> Chain:
        """Without the first motion."""
        return Chain(self.motion[1:], self.steps[1:])

    def unit_screws(self, steps: Iterable[int]) -> tuple[Array, Array]:
        """Screws of unit speeds, w and v ``(m, f, 3)``, as some of the steps alone cause them, components behind these."""
        m, f = len(self.steps[0].place), max(step.speeds.stop for step in self.steps)
        w, v = np.zeros((m, f, 3)), np.zeros((m, f, 3))
        for step in (self.steps[i] for i in steps):
            if step.w is not None:
                w[:, step.speeds] += step.w
            if step.v is not None:
                v[:, step.speeds] += step.v
        return w, v

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

    def screws(self, q: Array) -> list[tuple[Array | None, Array | None]]:
        """Unit screws of the steps that later ones change, w, v ``(S, m, f, 3)`` about the child's origin, None for zero.

        What a motion does is seen through all that follow it.
        """
        first = min(self.seen, default=0) + 1
        followers = [(step.shift(q), step.back(q)) for step in self.steps[first:]]
        found = []
        for i in self.seen:
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
    """Which of a joint's speeds are those of an elementary motion."""
    if isinstance(motion, Turn | Slide):
        return slice(motion.index, motion.index + 1)
    return slice(motion.speed, motion.speed + 3)


def changed(motion: Sequence[Motion]) -> list[int]:
    """Motions whose screws later ones change: these turn them, or shift them off their axes."""

    def alters(other: Motion, m: Motion) -> bool:
        if isinstance(m, Displacement):
            return False
        if isinstance(m, Turn | Slide) and isinstance(other, Turn | Slide) and m.axis == other.axis:
            return False
        return isinstance(other, Turn | Ball) or isinstance(m, Turn | Ball)

    return [i for i, m in enumerate(motion) if any(alters(other, m) for other in motion[i + 1 :])]
