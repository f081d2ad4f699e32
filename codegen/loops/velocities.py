"""Velocity closure: the conditions of loops on speeds, and dependent speeds computed from independent ones."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..model.model import Model
from ..model.vectors import Array
from .algebraic import Coupled
from .closure import COUPLED, Cuts, body_frames, ground_screws, shifted
from .dependents import ranks
from .ears import Partition
from .geometry import Geometry, padded
from .paths import TwistGroups

PLANAR = 1e-9
"""Relative deviation from a plane up to which motions count as planar."""


def complete_speeds(
    model: Model,
    partition: Partition,
    q: Sequence[float] | Array,
    u: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
) -> Array:
    """Dependent speeds from independent ones, by closing the velocities of one ear after the other.

    Parameters
    ----------
    q : (nq,) array
        Coordinates at which the loops are closed.
    u : (nu,) array
        Speeds; only the independent ones are used.

    Returns
    -------
    (nu,) array
    """
    geometry = Geometry(model.with_turned(partition.turned), p)
    motion = Motion(geometry, padded(q), np.asarray(u, dtype=float)[None, :, None])
    dependent = {s for ear in partition.ears for s in ear.dependent}
    bodies = {int(geometry.speed_body[s]) for s in dependent}
    motion.groups.found([k for k in range(geometry.ground) if k not in bodies], motion.u)
    for ear in partition.ears:
        geometry.follow(ear)
        motion.resolve(motion.closure(ear.loops), ear.dependent)
    return motion.u[0, :, 0]


class Motion:
    """Velocities of K motions at S configurations, computed ear by ear.

    Parameters
    ----------
    own : tuple of two (S, n + 1, 3, K) arrays, optional
        Additional motion of each body relative to its parent: angular velocity and velocity of the origin, ground frame.

    Attributes
    ----------
    u : (S, nu, K) array
        Speeds; dependent ones are valid once `resolve` has computed those of their ear.
    """

    def __init__(self, geometry: Geometry, q: Array, u: Array, own: tuple[Array, Array] | None = None) -> None:
        self.geometry, self.q, self.given, self.own = geometry, q, u, own
        self.frames = body_frames(geometry, q)
        self.screws = ground_screws(geometry, q, self.frames)
        self.restart()

    @cached_property
    def cuts(self) -> Cuts:
        """The cuts of all loops at the given coordinates."""
        found = Cuts(self.geometry, range(len(self.geometry.model.loops)))
        found.place(found.faces(self.frames), self.q)
        return found

    def restart(self) -> None:
        """Forget the dependent speeds of all ears."""
        self.u = self.given.copy()
        self.groups = TwistGroups(self.geometry, self.frames, self.screws, self.u.shape[-1], self.own)

    def closure(self, loops: Sequence[int], rows: Sequence[Sequence[int]] | None = None) -> VelocityClosure:
        """The velocity conditions of an ear, with the speeds that are known so far; `rows` as in `PlacedCuts`."""
        return VelocityClosure(self, loops, rows)

    def resolve(self, closure: VelocityClosure, dependent: Sequence[int]) -> None:
        """Compute the dependent speeds of an ear; its joints then count as known."""
        columns = [closure.column[s] for s in dependent]
        others = [c for c in range(len(closure.speeds)) if c not in columns]
        right = closure.known + closure.E[..., others] @ self.u[:, closure.speeds[others]]
        if columns:
            self.u[:, list(dependent)] = -np.linalg.pinv(closure.E[..., columns], rcond=1e-12) @ right
        self.groups.found(closure.bodies, self.u)


class VelocityClosure:
    """Velocity conditions ``E u + known = 0`` on the speeds of the unknown joints of some loops.

    Attributes
    ----------
    bodies : list of int
        Bodies of the f speeds, those near the cuts first.
    speeds : (f,) array
    column : dict of int to int
        Column of each speed.
    E : (S, rows, f) array
    known : (S, rows, K) array
        Contributions of the known speeds.
    size : (S, K) array
        Sum of the magnitudes of the contributions whose difference `known` is.
    position : (S, rows) array
        Position residuals.
    screws : tuple of two (S, f, 3) arrays
        Unit screws of the speeds about their bodies' origins, ground frame.
    origins : (S, f, 3) array
        Origins of the speeds' bodies, m.
    """

    def __init__(self, motion: Motion, loops: Sequence[int], rows: Sequence[Sequence[int]] | None = None) -> None:
        g, self.loops = motion.geometry, list(loops)
        cuts = motion.cuts.of(g, loops, rows)
        self.position = cuts.kept(cuts.residual)
        self._tolerance = g.tolerance
        self._length = float(np.max(g.lengths[self.loops]))
        moved = [motion.groups.difference(i, cuts.point[:, j]) for j, i in enumerate(loops)]
        known_w, known_v, size = (np.stack([m[i] for m in moved], axis=1) for i in range(3))
        sides = [m[3] for m in moved]
        of_known = [(n, self._of_known(motion, coupled)) for n, coupled in cuts.couplings]
        for n, parts in of_known:
            size[:, n] = np.abs(parts).sum(axis=1)
        self.size = np.max(size, axis=1)
        distance: dict[int, int] = {}
        for start, end in sides:
            for side in (start, end):
                for d, k in enumerate(side):
                    distance[k] = min(d, distance.get(k, d))
        self.bodies = sorted(distance, key=lambda k: distance[k])
        self.speeds = np.array([s for k in self.bodies for s in reversed(g.speeds[k])], dtype=int)
        self.column = {int(s): c for c, s in enumerate(self.speeds)}
        place = {k: i for i, k in enumerate(self.bodies)}
        sign = np.zeros((len(loops), len(self.bodies)))
        for j, (start, end) in enumerate(sides):
            sign[j, [place[k] for k in start]] = -1
            sign[j, [place[k] for k in end]] = 1
        if motion.own is not None:
            w, v = (x[:, self.bodies] for x in motion.own)
            for j in range(len(loops)):
                at_cut = shifted(w, v, cuts.point[:, j, None] - motion.frames[1][:, self.bodies])
                known_w[:, j] += np.einsum("b,sbik->sik", sign[j], w)
                known_v[:, j] += np.einsum("b,sbik->sik", sign[j], at_cut)
        known = cuts.conditions(known_w, known_v)
        for n, parts in of_known:
            known[:, n, COUPLED] = parts.sum(axis=1)
        self.known = cuts.kept(known)
        body = g.speed_body[self.speeds]
        sign = sign[:, [place[int(k)] for k in body]]
        w, v = motion.screws[0][:, self.speeds], motion.screws[1][:, self.speeds]
        self.screws, self.origins = (w, v), motion.frames[1][:, body]
        at_cut = cuts.at_cut(w, v, self.origins)
        self.E = cuts.matrix(w, at_cut, sign, self.speeds)
        self._u = motion.u
        self._passing = [sign[j] != 0 for j in range(len(loops))]
        self._cuts, self._w, self._at_cut, self._known_w, self._known_v = cuts, w, at_cut, known_w, known_v

    @staticmethod
    def _of_known(motion: Motion, coupled: Coupled) -> Array:
        """Contributions of the known speeds to a coupling, one by one, ``(S, n, K)``."""
        groups, body = motion.groups, motion.geometry.speed_body
        known = [i for i, s in enumerate(coupled.speeds) if groups.is_known(int(body[s]))]
        parts: Array = coupled.factors[known, None] * motion.u[:, coupled.speeds[known]]
        return parts

    def disturbance(self, others: Array, configurations: Array) -> tuple[Array, Array]:
        """Contributions ``(S, rows, K)`` of known speeds and of the columns `others`, and the magnitude of their
        terms."""
        E, u = self.E[configurations][..., others], self._u[configurations][:, self.speeds[others]]
        size = self.size[configurations] + np.sum(np.max(np.abs(E), axis=1)[..., None] * np.abs(u), axis=1)
        return self.known[configurations] + E @ u, size

    def reach(self) -> float:
        """Distance of the cuts from the base in characteristic lengths, to which rounding errors are proportional."""
        return float(np.max(np.linalg.norm(self._cuts.point, axis=-1))) / self._length

    def possible(self) -> int:
        """Number of conditions that motions of the joints can violate; for planar motions, those in the plane."""
        cuts = self._cuts
        total = len(cuts.couplings)
        for j, passing in enumerate(self._passing):
            w = np.concatenate([self._w[0, passing].T, self._known_w[0, j]], axis=1)
            v = np.concatenate([self._at_cut[0, j, passing].T, self._known_v[0, j]], axis=1)
            total += _possible(cuts.n[0, j], cuts.m[0, j], w, v, self._tolerance)
        return total

    def scaled(self, geometry: Geometry, length: float) -> Array:
        """The matrix E for displacements in characteristic lengths."""
        return self.E * np.where(geometry.turning[self.speeds], 1.0, length)

    def weighed(self, geometry: Geometry, length: float) -> Array:
        """The matrix `scaled`; for a lone coupling, only the signs of its entries, because ratios must not affect the
        choice of dependents."""
        E = self.scaled(geometry, length)
        return np.sign(E) if is_lone_coupling(geometry, self._cuts.loops) else E


def is_lone_coupling(geometry: Geometry, loops: Sequence[int]) -> bool:
    """Whether the loops are one coupling, whose coordinates are all equally good dependents."""
    return len(loops) == 1 and loops[0] in geometry.couplings


def _possible(n: Array, m: Array, w: Array, v: Array, tolerance: float) -> int:
    """Rank of a loop's linear conditions n ``(3, 3)`` and angular conditions m ``(3, 3)`` for the motions at its cut.

    The motions are all planar or all spatial motions. They are planar if all angular velocities w ``(3, f)`` have one
    direction, and all velocities v ``(3, f)`` are perpendicular to it: this holds at every configuration.
    """
    U, s, _ = np.linalg.svd(w)
    planar = s[0] > 0 and np.max(s[1:], initial=0.0) < max(tolerance, PLANAR) * s[0]
    planar = planar and np.max(np.abs(U[:, 0] @ v)) <= max(tolerance, PLANAR) * np.max(np.abs(v))
    across, along = (U[:, 1:], U[:, :1]) if planar else (np.eye(3), np.eye(3))
    return int(ranks((n @ across)[None])[0] + ranks((m @ along)[None])[0])
