"""Closure of loops at given coordinates and speeds: residuals of position and velocity, and the closure matrix.

A loop joint compares its two faces. Conditions are fixed in the `start` face and taken at one point of the loop, the cut:
the origin of the `end` face. Linear conditions are divided by the loop's characteristic length, so all rows are numbers.

========= ============================================= ==============================================================
condition position residual                             row of the closure matrix, for a relative twist (w, v) at the cut
========= ============================================= ==============================================================
linear    n . (x_end - x_start) / length                n . v / length
parallel  m . r, r along a_start x a_end, abs(r) =      m . w, m perpendicular to the axis
          2 sin(t/2), t the angle between the axes
unturned  m . r, r twice the vector of the relative     m . w
          rotation's unit quaternion, abs(r) =
          2 sin(t/2), t the angle of the rotation
universal a_end . a_start                               w . (a_end x a_start)
coupling  sum of factor q - offset                      the factors, of the speeds themselves
surface   f / abs(grad f) / length, f of x_end - x_start n . v / length, n = grad f / abs(grad f)
          in the start face
========= ============================================= ==============================================================

A sine would also vanish at half a turn, where a revolute or fixed joint would be closed the wrong way round. 2 sin(t/2)
grows up to half a turn, and near closure it equals t. For linear and universal rows the closure matrix is the exact
derivative of the residual; for other rows it is the derivative only where the loop is closed. `Geometry.linear` and
`Geometry.angular` hold the directions n and m.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..model.vectors import Array, cross, turn
from .geometry import Geometry

Frames = tuple[Array, Array]
"""Rotations (body into base components) ``(S, n, 3, 3)`` and origins ``(S, n, 3)``, m."""

COUPLED = 3
"""Row of a coupling's condition among the six rows of a loop."""

HALF_TURN = 1e-12
"""Value of 1 + cos below which a rotation counts as half a turn, whose axis has no definite sign."""


# --- kinematics of all bodies -------------------------------------------------------------------------------------------


def body_frames(geometry: Geometry, q: Array) -> Frames:
    """Frames of all bodies and of the ground (the last) in the ground frame.

    Each round composes every body's frame with that of its current reference body: log n rounds for a chain of n.
    """
    n, S = geometry.ground, len(q)
    R, o = np.empty((S, n + 1, 3, 3)), np.empty((S, n + 1, 3))
    R[:, :n], o[:, :n] = geometry.all_joints.transforms(q)
    R[:, n], o[:, n] = np.eye(3), 0
    base = np.array(geometry.parent)
    while len(open_ := np.flatnonzero(base != n)):
        b = base[open_]
        o[:, open_], R[:, open_] = o[:, b] + turn(R[:, b], o[:, open_]), R[:, b] @ R[:, open_]
        base[open_] = base[b]
    return R, o


def ground_screws(geometry: Geometry, q: Array, frames: Frames) -> tuple[Array, Array]:
    """Unit screws of all speeds about their bodies' origins in the ground frame, ``(S, nu, 3)`` each."""
    w, v = geometry.all_joints.screws(q)
    R = frames[0][:, geometry.speed_body]
    return turn(R, w), turn(R, v)


def shifted(w: Array, v: Array, r: Array) -> Array:
    """Velocities of points, from the twists w, v ``(..., 3, K)`` at other points; r ``(..., 3)`` are the vectors from
    the other points."""
    return v + np.swapaxes(cross(np.swapaxes(w, -1, -2), r[..., None, :]), -1, -2)


# --- conditions ---------------------------------------------------------------------------------------------------------


class PlacedCuts:
    """Conditions of l loops at S configurations: their residuals, and their rates for given motions.

    Every loop has six rows here, three linear and three angular. Rows that are no conditions, or dropped conditions,
    are left out by `kept`. `rows` selects other rows, loop by loop.

    Attributes
    ----------
    point : (S, l, 3) array
        The cuts in the base frame, m.
    n, m : (S, l, 3, 3) array
        Directions of linear and angular rows, base frame, the linear ones divided by the characteristic length.
    residual : (S, l, 6) array
        Position residuals.
    """

    point: Array
    n: Array
    m: Array
    residual: Array

    def __init__(self, geometry: Geometry, loops: Sequence[int], rows: Sequence[Sequence[int]] | None = None) -> None:
        self.loops = list(loops)
        self.lengths = geometry.lengths[self.loops]
        self.couplings = [(n, geometry.couplings[j]) for n, j in enumerate(self.loops) if j in geometry.couplings]
        rows = geometry.kept if rows is None else rows
        self.row_index = np.array([6 * j + r for j, k in enumerate(self.loops) for r in rows[k]], dtype=int)

    def kept(self, six: Array) -> Array:
        """The rows of ``(S, l, 6, ...)`` that are selected conditions, as ``(S, rows, ...)``."""
        return six.reshape(len(six), 6 * six.shape[1], *six.shape[3:])[:, self.row_index]

    def at_cut(self, w: Array, v: Array, o: Array) -> Array:
        """Velocities ``(S, l, f, 3)``, at the cuts, of unit screws w, v ``(S, f, 3)`` about the points o, base
        frame."""
        return v[:, None] + cross(w[:, None], self.point[:, :, None] - o[:, None])

    def matrix(self, w: Array, at_cut: Array, sign: Array, speeds: Sequence[int] | Array) -> Array:
        """The closure matrix of f speeds, ``(S, rows, f)``.

        Parameters
        ----------
        w : (S, f, 3) array
            Angular velocities per unit speed, base frame.
        at_cut : (S, l, f, 3) array
            Velocities at the cuts per unit speed.
        sign : (l, f) array
            1 on the end side of a loop, -1 on its start side, 0 where it does not pass the joint.
        speeds : (f,)
            Indices of the speeds.
        """
        E = np.empty((len(w), len(self.loops), 6, w.shape[1]))
        E[:, :, :3] = self.n @ np.swapaxes(at_cut, -1, -2)
        E[:, :, 3:] = self.m @ np.swapaxes(w, -1, -2)[:, None]
        E *= sign[:, None]
        for n, coupled in self.couplings:
            for s, factor in zip(coupled.speeds, coupled.factors, strict=True):
                E[:, n, COUPLED, np.asarray(speeds) == s] = factor
        return self.kept(E)

    def conditions(self, w: Array, v: Array) -> Array:
        """Rates ``(S, l, 6, K)`` of the rows for relative twists w, v ``(S, l, 3, K)`` at the cuts."""
        return np.concatenate([self.n @ v, self.m @ w], axis=-2)


class Cuts(PlacedCuts):
    """Cuts computed from the poses of their faces; `place` sets the attributes of `PlacedCuts`."""

    def __init__(self, geometry: Geometry, loops: Sequence[int], rows: Sequence[Sequence[int]] | None = None) -> None:
        super().__init__(geometry, loops, rows)
        g = geometry
        i = np.array(self.loops, dtype=int)
        self.starts, self.ends = (np.array([x[j] for j in self.loops], dtype=int) for x in (g.starts, g.ends))
        self.face_R, self.face_at = g.face_R[:, i], g.face_at[:, i]
        self.linear = g.linear[i] / g.lengths[i, None, None]
        self.angular, self.axis, self.end_axis = g.angular[i], g.axis[i], g.end_axis[i]
        self.whole, self.perpendicular = np.flatnonzero(g.is_whole_turn[i]), np.flatnonzero(g.is_perpendicular[i])
        self.surfaces = [(n, g.surfaces[j]) for n, j in enumerate(self.loops) if j in g.surfaces]

    def faces(self, frames: Frames) -> tuple[Array, Array, Array, Array]:
        """Rotations and origins of the start faces and of the end faces, from the frames of all bodies."""
        R, o = frames
        result = []
        for side, bodies in ((0, self.starts), (1, self.ends)):
            C = R[:, bodies]
            result += [C @ self.face_R[side], o[:, bodies] + turn(C, self.face_at[side])]
        return result[0], result[1], result[2], result[3]

    def place(self, faces: tuple[Array, Array, Array, Array], q: Array) -> Array:
        """Position residuals ``(S, l, 6)``; stores the positions of the cuts and the directions of their conditions."""
        C_s, x_s, C_e, x_e = faces
        back = np.swapaxes(C_s, -1, -2)
        R = back @ C_e
        residual = np.empty((*x_e.shape[:2], 6))
        residual[..., :3] = turn(self.linear, turn(back, x_e - x_s))
        residual[..., 3:] = turn(self.angular, self._rotations(R))
        self.point = x_e
        self.n, self.m = self.linear @ back, self.angular @ back
        if len(self.perpendicular):
            a = self.axis[self.perpendicular]
            b = turn(R[:, self.perpendicular], self.end_axis[self.perpendicular])
            residual[:, self.perpendicular, 3] = np.sum(a * b, axis=-1)
            self.m[:, self.perpendicular, 0] = turn(C_s[:, self.perpendicular], cross(b, a))
        for n, surfaced in self.surfaces:
            distance, normal = surfaced.at(turn(back[:, n], x_e[:, n] - x_s[:, n]))
            m = distance.shape[1]
            residual[:, n, :m] = distance / self.lengths[n]
            self.n[:, n, :m] = turn(C_s[:, n, None], normal) / self.lengths[n]
        for n, coupled in self.couplings:
            residual[:, n, COUPLED] = coupled.open(q)
        self.residual = residual
        return residual

    def _rotations(self, R: Array) -> Array:
        """Relative rotations R ``(S, l, 3, 3)`` from start to end faces, as vectors of length 2 sin(t/2)."""
        b = turn(R, self.axis)
        versine = 1 + (self.axis * b).sum(axis=-1)
        r = cross(self.axis, b) * np.sqrt(2 / np.maximum(versine, HALF_TURN))[..., None]
        if versine.min(initial=1) < HALF_TURN:
            for s, j in np.argwhere(versine < HALF_TURN):
                r[s, j] = 2 * self.angular[j, 0]
        if len(self.whole):
            r[:, self.whole] = 2 * quaternion_vector(R[:, self.whole])
        return r

    def of(self, geometry: Geometry, loops: Sequence[int], rows: Sequence[Sequence[int]] | None = None) -> PlacedCuts:
        """The placed cuts of some loops, selected from the cuts of all loops in this object."""
        found = PlacedCuts(geometry, loops, rows)
        i, other = found.loops, self.lengths[found.loops] / found.lengths
        found.point, found.m = self.point[:, i], self.m[:, i]
        found.n = self.n[:, i] * other[:, None, None]
        found.residual = self.residual[:, i]
        found.residual[..., :3] *= other[:, None]
        return found


def quaternion_vector(R: Array) -> Array:
    """Vector part ``(..., 3)`` of the unit quaternion with positive scalar part, from rotations ``(..., 3, 3)``."""
    vee = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    trace = np.trace(R, axis1=-2, axis2=-1)
    v = vee / (2 * np.sqrt(np.maximum(1 + trace, HALF_TURN)))[..., None]
    for i in map(tuple, np.argwhere(1 + trace < 0.5)):  # near half a turn the symmetric part of R is more accurate
        outer = (R[i] + R[i].T + (1 - trace[i]) * np.eye(3)) / 4
        k = int(np.argmax(np.diag(outer)))
        v[i] = outer[k] / np.sqrt(outer[k, k])
        if v[i] @ vee[i] < 0:
            v[i] = -v[i]
    return v
