"""Poses of bodies over time, and groups of solids that look alike, which are drawn together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array, Indices
from .meshes import Meshes
from .scene import GROUND, Line, Mark, Solid


@dataclass(frozen=True, eq=False)
class Arrows:
    """Vectors at nt times.

    Attributes
    ----------
    places : ndarray (nt, n, 3)
        Their points of application, m, in the ground frame.
    vectors : ndarray (nt, n, 3)
        Components in the ground frame, N or N m; zero where they have no finite value.
    """

    places: Array
    vectors: Array

    @property
    def largest(self) -> float:
        """Length of the longest vector."""
        return float(np.linalg.norm(self.vectors, axis=-1).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the bodies of a scene at nt times.

    Attributes
    ----------
    t : ndarray (nt,)
        Times, s.
    rotation : ndarray (nt, n, 3, 3)
        From body components to ground components.
    position : ndarray (nt, n, 3)
        Origins of the body frames, m.
    shades : dict of str to ndarray (nt, n)
        Displacement, m, of each body's centre of mass per unit of a parameter, by the name of the parameter.
    twist : ndarray (nt, n, 6) or None
        Angular velocities, rad/s, and velocities of the origins, m/s, in the ground frame, where forces need them.
    arrows : dict of str to Arrows
        Forces and torques by their kinds, see `forces.KINDS`.
    """

    t: Array
    rotation: Array
    position: Array
    shades: dict[str, Array] = field(default_factory=dict)
    twist: Array | None = None
    arrows: dict[str, Arrows] = field(default_factory=dict)

    def of(self, body: int, at: Array, i: int) -> Array:
        """Points `at` (..., 3) of a body at time i in the ground frame, m."""
        if body == GROUND:
            return at
        return np.asarray(at @ self.rotation[i, body].T + self.position[i, body])

    def turns(self, body: int) -> Array:
        """Rotations (nt, 3, 3) of a body at all times, from its components to ground components."""
        return np.broadcast_to(np.eye(3), (len(self.t), 3, 3)) if body == GROUND else self.rotation[:, body]

    def many(self, bodies: Indices, at: Array, i: int) -> Array:
        """Positions (n, 3) of points in the ground frame at time i, m; point k is at `at[k]` in the body `bodies[k]`."""
        rotation, position = self._with_ground(i)
        return np.asarray(np.einsum("kij,kj->ki", rotation[bodies], at) + position[bodies])

    def turned(self, bodies: Indices, rotation: Array, i: int) -> Array:
        """Rotations (n, 3, 3) from the frames of n solids to the ground frame at time i; `rotation[k]` is that of solid k in
        the body `bodies[k]`."""
        return np.asarray(self._with_ground(i)[0][bodies] @ rotation)

    def _with_ground(self, i: int) -> tuple[Array, Array]:
        """Rotations and positions of all bodies at time i; the last entry, which index -1 selects, is the ground."""
        rotation = np.concatenate([self.rotation[i], np.eye(3)[None]])
        return rotation, np.concatenate([self.position[i], np.zeros((1, 3))])


@dataclass(frozen=True, eq=False)
class Group:
    """Solids of the same surface and colour.

    Attributes
    ----------
    vertices, faces : ndarray
        Surface of each solid, in its own frame.
    bodies : ndarray (n,)
        The body of each solid.
    rotation, at : ndarray (n, 3, 3), (n, 3)
        The frame of each solid in its body.
    color : str
        ``""`` if the view chooses the colour.
    """

    vertices: Array
    faces: Indices
    bodies: Indices
    rotation: Array
    at: Array
    color: str


def groups_of(solids: Sequence[Solid], meshes: Meshes) -> list[Group]:
    """Groups of solids with the same surface and colour."""
    alike: dict[tuple[object, ...], list[Solid]] = {}
    for s in solids:
        alike.setdefault((s.type, s.sizes.tobytes(), s.color, s.file), []).append(s)
    return [
        Group(
            *meshes.surface(same[0], len(same)), np.array([s.body for s in same]), np.stack([s.rotation for s in same]),
            np.stack([s.at for s in same]), same[0].color,
        )
        for same in alike.values()
    ]  # fmt: skip


def ends_of(lines: Sequence[Line], poses: Poses, i: int) -> Array:
    """Both ends of each line at time i in the ground frame, (n, 2, 3), m."""
    bodies = np.array([x.bodies for x in lines], dtype=np.intp).reshape(-1)
    ends = np.array([x.ends for x in lines]).reshape(-1, 3)
    return poses.many(bodies, ends, i).reshape(-1, 2, 3)


def places_of(marks: Sequence[Mark], poses: Poses, i: int) -> Array:
    """Positions of points at time i in the ground frame, (n, 3), m."""
    bodies = np.array([m.body for m in marks], dtype=np.intp)
    return poses.many(bodies, np.array([m.at for m in marks]).reshape(-1, 3), i)


def quaternions(rotation: Array) -> Array:
    """Unit quaternions (n, 4), w first, of rotations (n, 3, 3); by the largest of the four entries (Shepperd)."""
    r = rotation
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1)
    found = np.empty((len(r), 4))
    for k in range(4):
        rows = np.flatnonzero(squares.argmax(axis=1) == k)
        m, t = r[rows], trace[rows]
        w, (x, y, z) = m[:, 2, 1] - m[:, 1, 2], (m[:, 0, 0], m[:, 1, 1], m[:, 2, 2])
        xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
        wy, wz = m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
        entries = (
            (1 + t, w, wy, wz), (w, 1 + 2 * x - t, xy, xz), (wy, xy, 1 + 2 * y - t, yz), (wz, xz, yz, 1 + 2 * z - t),
        )[k]  # fmt: skip
        found[rows] = np.stack(entries, axis=1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)
