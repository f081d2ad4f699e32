"""How frames of bodies and points fixed in them move, and what is linear algebra over it: points from frames, with tangents."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from .arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class FrameMotion:
    """Frames of bodies against the ground, along the ground's axes; or the derivatives of all that, directions first.

    Attributes
    ----------
    names : tuple of str
        Bodies, n of them; asked for one by its name alone, arrays are without the axis n.
    rotation : (..., n, 3, 3)
        Ground components from body components.
    position : (..., n, 3)
        Of the origin, m.
    angular_velocity : (..., n, 3)
        rad/s.
    velocity : (..., n, 3)
        Of the origin, m/s.
    angular_acceleration : (..., n, 3) or None
        rad/s^2; None unless asked for.
    acceleration : (..., n, 3) or None
        Of the origin, without gravity, m/s^2; None unless asked for.
    """

    names: tuple[str, ...]
    rotation: Array
    position: Array
    angular_velocity: Array
    velocity: Array
    angular_acceleration: Array | None = None
    acceleration: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointMotion:
    """Points fixed in bodies, along the ground's axes; or the derivatives of all that, directions first.

    Attributes
    ----------
    names : tuple of str
        Points, n of them, those without a name by their body and place; asked for one alone, arrays are without the axis n.
    position : (..., n, 3)
        m.
    velocity : (..., n, 3)
        m/s.
    acceleration : (..., n, 3) or None
        Without gravity, m/s^2; None unless asked for.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    acceleration: Array | None = None


Motion = TypeVar("Motion", FrameMotion, PointMotion)


def frames_from(frames: Array, accelerations: Array | None, bodies: Any, names: tuple[str, ...]) -> FrameMotion:
    """Frames of some bodies from the numbers of all: (..., 18 nbodies) and (..., 6 nbodies) or None.

    `bodies` is an index of the axis of bodies: a slice, a list, or the number of one, whose arrays are without that axis.
    """
    x = frames.reshape(*frames.shape[:-1], frames.shape[-1] // 18, 18)[..., bodies, :]
    rotation = x[..., :9].reshape(*x.shape[:-1], 3, 3)
    if accelerations is None:
        return FrameMotion(names, rotation, x[..., 9:12], x[..., 12:15], x[..., 15:])
    a = accelerations.reshape(*accelerations.shape[:-1], accelerations.shape[-1] // 6, 6)[..., bodies, :]
    return FrameMotion(names, rotation, x[..., 9:12], x[..., 12:15], x[..., 15:], a[..., :3], a[..., 3:])


def with_ground(frames: FrameMotion, tangents: bool) -> FrameMotion:
    """The ground after the last frame; or its derivatives, which are zero."""

    def extended(name: str, x: Array, axis: int) -> Array:
        of_ground = np.zeros(x.shape[axis + 1 :], x.dtype)
        if name == "rotation" and not tangents:
            np.fill_diagonal(of_ground, 1)
        one = np.broadcast_to(of_ground, (*x.shape[:axis], 1, *of_ground.shape))
        return np.concatenate([x, one], axis=axis)

    return _each(frames, extended)


def taken(frames: FrameMotion, places: Sequence[int]) -> FrameMotion:
    """Frames by their places among some."""
    return _each(frames, lambda _, x, axis: np.take(x, list(places), axis=axis))


def alone(motion: Motion) -> Motion:
    """The motion of the only one, without the axis n."""
    return _each(motion, lambda _, x, axis: np.squeeze(x, axis=axis))


def _each(motion: Motion, f: Callable[[str, Array, int], Array]) -> Motion:
    """A motion with other arrays, each made of its name, the array and which axis n is."""
    made: dict[str, Any] = {}
    for of in fields(motion):
        x = getattr(motion, of.name)
        if of.name != "names" and x is not None:
            made[of.name] = f(of.name, x, x.ndim - (3 if of.name == "rotation" else 2))
    return replace(motion, **made)


def points_on(frames: FrameMotion, r: Array, names: tuple[str, ...]) -> PointMotion:
    """Points r (..., n, 3) of frames, one of each.

    They are at ``x + R r`` and have ``v + omega x R r`` and ``a + alpha x R r + omega x (omega x R r)``.
    """
    s, w = times(frames.rotation, r), frames.angular_velocity
    found = PointMotion(names, frames.position + s, frames.velocity + cross(w, s))
    if frames.acceleration is None or frames.angular_acceleration is None:
        return found
    return replace(
        found, acceleration=frames.acceleration + cross(frames.angular_acceleration, s) + cross(w, cross(w, s))
    )


def point_tangents(
    frames: FrameMotion, along: FrameMotion, r: Array, dr: Array | float, names: tuple[str, ...]
) -> PointMotion:
    """Their derivatives, from those of the frames and dr (k, ..., n, 3)."""
    s, w = times(frames.rotation, r), frames.angular_velocity
    ds, dw = times(along.rotation, r) + times(frames.rotation, dr), along.angular_velocity
    found = PointMotion(names, along.position + ds, along.velocity + cross(dw, s) + cross(w, ds))
    if along.acceleration is None or along.angular_acceleration is None or frames.angular_acceleration is None:
        return found
    turned = cross(along.angular_acceleration, s) + cross(frames.angular_acceleration, ds)
    centripetal = cross(dw, cross(w, s)) + cross(w, cross(dw, s) + cross(w, ds))
    return replace(found, acceleration=along.acceleration + turned + centripetal)


def times(R: Array, r: Array | float) -> Array | float:
    """Matrices times vectors; nothing of nothing."""
    return 0.0 if isinstance(r, float) else (R * r[..., None, :]).sum(axis=-1)


def cross(a: Array, b: Array | float) -> Array | float:
    """Cross products; nothing of nothing."""
    if isinstance(b, float):
        return 0.0
    (ax, ay, az), (bx, by, bz) = (np.moveaxis(x, -1, 0) for x in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


__all__ = ["FrameMotion", "PointMotion", "alone", "frames_from", "point_tangents", "points_on", "taken", "with_ground"]
