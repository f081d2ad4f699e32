"""Assembled configurations in the range of some loops, found by random walks along motions that the loops permit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..model.vectors import Array
from .geometry import Geometry, advance
from .paths import PoseGroups
from .rings import LARGEST_STEP, Ring

WALKS = 5
"""Number of walks from the initial configuration, each in its own direction."""

STRIDES = 4
"""Number of steps of a walk; each step ends with closing the loops."""

STRIDE = 0.4
"""Largest component of a step, rad or characteristic lengths."""

CORRECTIONS = 4
"""Number of Newton steps that close the loops after a step."""

DRAWS = 20
"""Number of random sets of independent coordinates with which a choice of dependents is tested."""

RANGE = 0.5
"""Largest distance of the random independent coordinates from the initial ones, rad and characteristic lengths."""

PARTS = 3
"""Number of steps in which the independent coordinates move to their random values."""

TRIALS = 10
"""Number of Newton steps that may close the loops at the end of the path."""

DAMPING = 1e-11
"""Fraction of the trace of E E^T that is added to its diagonal, so that redundant conditions do not make it
singular."""

NEARLY_CLOSED = 1e-5
"""Residual, in characteristic lengths or rad, up to which columns may be compared at a configuration."""


class NearbyStates:
    """Closure matrices of some loops at the initial configuration and at other configurations that can be reached from
    it. The coordinates of joints outside these loops keep their values. All configurations are computed at the same
    time.

    Attributes
    ----------
    speeds : (f,) array
        Speeds of the joints on the loops' cycles.
    q : (S, nq + 1) array
        The initial configuration first.
    E : (S, rows, f) array
        Closure matrices; linear conditions and displacements per characteristic length.
    residual : (S,) array
        Largest residual of each configuration: rad, and characteristic lengths.
    """

    def __init__(self, groups: PoseGroups, loops: Sequence[int], q: Array, random: np.random.Generator) -> None:
        g = groups.geometry
        g.lengths[list(loops)] = g.own_lengths[list(loops)]
        ring = Ring(groups, loops, {k for k in g.passed(loops) if g.speeds[k]})
        self.geometry, self.ring, self.speeds = g, ring, ring.joints.speeds
        self.scale = np.where(g.turning[self.speeds], 1.0, ring.length)
        self.draws = random.uniform(-RANGE, RANGE, (DRAWS, len(self.speeds)))
        self.q, self.E, self.residual = self._walked(np.repeat(q, WALKS, axis=0), random)

    def reach(self, dependent: Sequence[int]) -> float:
        """Fraction of random independents for which Newton's method closes the loops by moving the dependents.

        The same displacements of all joints are drawn for every choice. Dependents start from the initial configuration.

        Parameters
        ----------
        dependent : sequence of int
            Columns of E.
        """
        step = self.draws / PARTS
        step[:, dependent] = 0
        q = np.repeat(self.q[:1], len(step), axis=0)
        speeds, scale = self.speeds[list(dependent)], self.scale[list(dependent)]
        for part in range(PARTS):
            q = advance(self.geometry, q, self.speeds, step * self.scale)
            rows, E = self._closed(q)
            for _ in range(TRIALS if part == PARTS - 1 else CORRECTIONS):
                if np.all(_largest(rows) < NEARLY_CLOSED):
                    break
                q = advance(self.geometry, q, speeds, _limited(-_least(E[..., dependent], rows)) * scale)
                rows, E = self._closed(q)
        return float(np.mean(_largest(rows) < NEARLY_CLOSED))

    def put(self, q: Array) -> Array:
        """Configurations in which the joints of the loops are at the ends of the walks, with the loops closed if
        possible."""
        moved = sorted({i for s in self.speeds for i in range(*self.geometry.moved[s].indices(q.shape[1]))})
        far = np.argsort(-np.max(np.abs(self.q - self.q[0]), axis=1), kind="stable")[: len(q)]
        far = np.resize(far, len(q))
        q = q.copy()
        q[:, moved] = self._corrected(self.q[far])[0][:, moved]
        return q

    def _walked(self, q: Array, random: np.random.Generator) -> tuple[Array, Array, Array]:
        direction = random.normal(size=(len(q), len(self.speeds)))
        rows, E = self._closed(q)
        configurations, matrices, residuals = [q[:1]], [E[:1]], [_largest(rows[:1])]
        for _ in range(STRIDES):
            along = direction - _least(E, (E @ direction[..., None])[..., 0])
            size = np.max(np.abs(along), axis=1, keepdims=True)
            step = STRIDE * along / np.where(size > 0, size, 1.0)
            moved, found, residual = self._corrected(advance(self.geometry, q, self.speeds, step * self.scale))
            closed = residual < NEARLY_CLOSED
            # a walk that has reached the end of the range turns back
            direction = np.where(closed[:, None], along, -direction)
            q, E = np.where(closed[:, None], moved, q), np.where(closed[:, None, None], found, E)
            configurations.append(q[closed])
            matrices.append(E[closed])
            residuals.append(residual[closed])
        return np.concatenate(configurations), np.concatenate(matrices), np.concatenate(residuals)

    def _corrected(self, q: Array) -> tuple[Array, Array, Array]:
        """Configurations in which the loops have been closed, their matrices, and the remaining residuals."""
        rows, E = self._closed(q)
        for _ in range(CORRECTIONS):
            step = _limited(-_least(E, rows))
            q = advance(self.geometry, q, self.speeds, step * self.scale)
            rows, E = self._closed(q)
        return q, E, _largest(rows)

    def _closed(self, q: Array) -> tuple[Array, Array]:
        rows, E = self.ring.evaluate(q)
        return rows, E * self.scale


def _largest(rows: Array) -> Array:
    """The largest residual ``(S,)`` of rows ``(S, rows)``."""
    largest: Array = np.max(np.abs(rows), axis=1, initial=0.0)
    return largest


def _limited(step: Array) -> Array:
    """The steps ``(S, f)``, shortened to where the linearisation is valid."""
    size = np.max(np.abs(step), axis=1, keepdims=True)
    limited: Array = step * np.minimum(1.0, LARGEST_STEP / np.where(size > 0, size, 1.0))
    return limited


def _least(E: Array, right: Array) -> Array:
    """The shortest x ``(S, f)`` with E x = right ``(S, rows)`` in the least-squares sense, slightly damped."""
    ET = np.swapaxes(E, -1, -2)
    gram = E @ ET if E.shape[1] <= E.shape[2] else ET @ E
    n = gram.shape[1]
    size = np.maximum(np.trace(gram, axis1=1, axis2=2), 1e-300)
    gram = gram + (DAMPING * size)[:, None, None] * np.eye(n)
    if E.shape[1] <= E.shape[2]:
        x: Array = ET @ np.linalg.solve(gram, right[..., None])
    else:
        x = np.linalg.solve(gram, ET @ right[..., None])
    return x[..., 0]


def rigid_parts(geometry: Geometry, q: Array, components: Iterable[Sequence[int]]) -> PoseGroups:
    """Groups of bodies that move rigidly together, since no moving joint of some loops lies between them."""
    moving = geometry.passed(i for loops in components for i in loops)
    return PoseGroups(geometry, q, [k for k in range(geometry.ground) if k not in moving or not geometry.speeds[k]])
