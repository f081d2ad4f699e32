"""Motion of body frames and of points fixed in bodies; the motion of points follows from the motion of frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....html_tables import html_of, shapes_of, shapes_text
from ..arrays import Array, Indices


@dataclass(init=False, eq=False, repr=False)
class FrameMotion:
    """Motion of body frames relative to the ground, or its derivatives, in the ground frame.

    Arrays of derivatives have the directions first.

    Attributes
    ----------
    names : tuple of str
        The n bodies. If a single body was requested by its name, arrays lack the axis n.
    rotation : ndarray (..., n, 3, 3)
        Matrix that turns body components into ground components.
    position : ndarray (..., n, 3)
        Position of the origin, m.
    angular_velocity : ndarray (..., n, 3)
        Angular velocity, rad/s.
    velocity : ndarray (..., n, 3)
        Velocity of the origin, m/s.
    angular_acceleration : ndarray (..., n, 3) or None
        Angular acceleration, rad/s^2. None unless requested.
    acceleration : ndarray (..., n, 3) or None
        Acceleration of the origin, m/s^2. None unless requested.
    """

    names: tuple[str, ...]
    rotation: Array
    position: Array
    angular_velocity: Array
    velocity: Array
    angular_acceleration: Array | None
    acceleration: Array | None

    def __init__(self, names: tuple[str, ...], frames: Array, accelerations: Array | None):
        self.names = names
        self._frames, self._accelerations = frames, accelerations

    def __getattr__(self, name: str) -> Any:
        """Extracts an array from the results of the C code at its first use."""
        if name not in PLACES:
            raise AttributeError(f"FrameMotion has no attribute {name!r}")
        whole = self._frames if name in OF_FRAMES else self._accelerations
        found = None if whole is None else whole[..., PLACES[name]]
        if name == "rotation" and found is not None:
            found = found.reshape(*found.shape[:-1], 3, 3)
        setattr(self, name, found)
        return found

    def __repr__(self) -> str:
        return _in_words("FrameMotion", self.names, [(name, getattr(self, name)) for name in PLACES])

    def _repr_html_(self) -> str:
        return _in_html(self, [(name, getattr(self, name)) for name in PLACES if name != "rotation"])

    def of(self, places: Indices, ground: bool, tangents: bool) -> FrameMotion:
        """Return the frames of some bodies.

        Parameters
        ----------
        places : ndarray of int
            Indices of the bodies. The number of bodies is the index of the ground.
        ground : bool
            Whether `places` may contain the ground, which does not move.
        tangents : bool
            Whether these are derivatives; those of the ground are zero.

        Returns
        -------
        FrameMotion
            The motions of these bodies.

        Examples
        --------
        >>> q, u = solver.initial
        >>> motion = solver.frames(q)
        >>> motion.of(np.array([1]), ground=False, tangents=False).position.round(3)
        array([[-0.932,  0.   , -0.362]])
        """
        frames, accelerations = self._frames, self._accelerations
        if ground:
            frames = _with_one(frames, 0.0 if tangents else AT_REST)
            accelerations = None if accelerations is None else _with_one(accelerations, 0.0)
        return FrameMotion(
            self.names, frames.take(places, -2), None if accelerations is None else accelerations.take(places, -2)
        )


OF_FRAMES = {
    "rotation": slice(0, 9), "position": slice(9, 12), "angular_velocity": slice(12, 15), "velocity": slice(15, 18),
}  # fmt: skip
PLACES = OF_FRAMES | {"angular_acceleration": slice(0, 3), "acceleration": slice(3, 6)}
"""Indices of the arrays in the 18 numbers of a frame, and in the 6 numbers of its accelerations."""


def _text(x: Array) -> str:
    return np.array2string(x, precision=4, suppress_small=True)


NAMES = 8
"""Number of names in a `repr`."""

YZX, ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
"""Component permutations for cross products."""

AT_REST = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, *[0.0] * 9])
"""The 18 numbers of the ground's frame."""


def _with_one(x: Array, last: Array | float) -> Array:
    """The numbers (..., n, m) with one more row at the end."""
    found = np.empty((*x.shape[:-2], x.shape[-2] + 1, x.shape[-1]), x.dtype)
    found[..., :-1, :], found[..., -1, :] = x, last
    return found


@dataclass(slots=True, eq=False, repr=False)
class PointMotion:
    """Motion of points fixed in bodies relative to the ground, or its derivatives, in the ground frame.

    Arrays of derivatives have the directions first.

    Attributes
    ----------
    names : tuple of str
        The n points; a point without a name is called by its body and place. If a single point was requested, arrays
        lack the axis n.
    position : ndarray (..., n, 3)
        Position, m.
    velocity : ndarray (..., n, 3)
        Velocity, m/s.
    acceleration : ndarray (..., n, 3) or None
        Acceleration, m/s^2. None unless requested.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    acceleration: Array | None = None

    def __repr__(self) -> str:
        return _in_words("PointMotion", self.names, self._named())

    def _repr_html_(self) -> str:
        return _in_html(self, self._named())

    def _named(self) -> list[tuple[str, Array | None]]:
        return [(name, getattr(self, name)) for name in ("position", "velocity", "acceleration")]


def _in_words(what: str, names: Sequence[str], arrays: Iterable[tuple[str, Array | None]]) -> str:
    shown = ", ".join(names[:NAMES]) + (f" and {len(names) - NAMES} more" if len(names) > NAMES else "")
    return f"<{what} of {shown}: {shapes_text(arrays)}>"


def _in_html(motion: FrameMotion | PointMotion, arrays: Sequence[tuple[str, Array | None]]) -> str:
    """Vectors of each body or point if there is one state, otherwise shapes."""
    found = [(name, x) for name, x in arrays if x is not None]
    n = len(motion.names)
    if any(x.shape not in ((3,), (n, 3)) for _, x in found):
        return html_of([repr(motion)], ("", "shape", "largest"), shapes_of(found))
    values = [x.reshape(n, 3) for _, x in found]
    rows = ((name, *(_text(x[i]) for x in values)) for i, name in enumerate(motion.names))
    return html_of([repr(motion)], ("", *(name.replace("_", " ") for name, _ in found)), rows)


def frames_from(frames: Array, accelerations: Array | None, bodies: Any, names: tuple[str, ...]) -> FrameMotion:
    """Frames of selected bodies, from the numbers of all bodies: (..., nbodies, 18) and (..., nbodies, 6) or None.

    `bodies` is an index of the body axis: None for all, a list, or one number, which removes the axis.
    """
    if bodies is not None:
        frames = frames[..., bodies, :]
        accelerations = None if accelerations is None else accelerations[..., bodies, :]
    return FrameMotion(names, frames, accelerations)


def alone(motion: PointMotion) -> PointMotion:
    """The motion of a single point, without the axis n."""
    x = motion.acceleration
    return PointMotion(
        motion.names, motion.position[..., 0, :], motion.velocity[..., 0, :], None if x is None else x[..., 0, :]
    )


def points_on(frames: FrameMotion, r: Array, names: tuple[str, ...]) -> PointMotion:
    """Motion of points r (..., n, 3), one in each frame.

    Position ``x + R r``, velocity ``v + omega x R r``, acceleration ``a + alpha x R r + omega x (omega x R r)``.
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
    """Derivatives of the motion of points, from derivatives `along` of the frames and dr (k, ..., n, 3) of the
    places."""
    s, w = times(frames.rotation, r), frames.angular_velocity
    ds, dw = times(along.rotation, r) + times(frames.rotation, dr), along.angular_velocity
    found = PointMotion(names, along.position + ds, along.velocity + cross(dw, s) + cross(w, ds))
    if along.acceleration is None or along.angular_acceleration is None or frames.angular_acceleration is None:
        return found
    turned = cross(along.angular_acceleration, s) + cross(frames.angular_acceleration, ds)
    centripetal = cross(dw, cross(w, s)) + cross(w, cross(dw, s) + cross(w, ds))
    return replace(found, acceleration=along.acceleration + turned + centripetal)


def times(R: Array, r: Array | float) -> Array | float:
    """Matrices times vectors; 0.0 if r is a number."""
    return 0.0 if isinstance(r, float) else np.add.reduce(R * r[..., None, :], axis=-1)


def cross(a: Array, b: Array | float) -> Array | float:
    """Cross products; 0.0 if b is a number."""
    if isinstance(b, float):
        return 0.0
    return a.take(YZX, -1) * b.take(ZXY, -1) - a.take(ZXY, -1) * b.take(YZX, -1)


__all__ = ["FrameMotion", "PointMotion", "alone", "frames_from", "point_tangents", "points_on"]
