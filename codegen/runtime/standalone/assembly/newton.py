"""Newton's method on the dependent coordinates of closed loops, for one state or many at once.

Steps are accepted by an affine invariant test (Deuflhard's natural monotonicity test), not by the size of the residuals: after
a fraction of a step, the next full step must nearly equal the remainder. The loops therefore close along the Newton path, on
which all residuals shrink in proportion. No step passes a pose where a loop loses rank.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices, largest, normalise
from ..calls.arguments import placed
from ..calls.targets import Opened
from ..errors import SingularJointError, SingularLoopError
from ..files.manifest import ALLOWED
from .partitions import scale_of

LARGEST = 0.3
"""The longest step of a dependent coordinate, rad or characteristic lengths."""

SURE = 0.05
"""Length of a first step, rad or characteristic lengths, up to which the branch needs no further test."""

CONTRACTION = 0.25
"""Largest ratio of the second full step to the first one. Below it, Newton's method converges to the same closed state as
continuation (Kantorovich's condition, with a margin)."""

BENT = 0.3
"""Largest relative difference between a step and the remainder of the step before it."""

LEAST = 1e-4
"""Smallest fraction of a step; the Newton path ends where an even smaller fraction would be needed."""

CLOSED = 1e-10
"""Scaled residual up to which a loop is closed; below it, Newton's method continues while the residual decreases."""

NEAREST = 1e-10
"""Length of a Newton step below which residuals of redundant conditions within `slack` count as zero."""

BETTER = 0.64
"""With residuals below `CLOSED`, a step must reduce their sum of squares by this factor for another step to follow."""

QUICK, STEPS = 12, 200
"""Maximum number of iterations with full steps, and of iterations along the Newton path."""


class Probe(NamedTuple):
    """Newton steps, residuals and ranks of n states.

    Attributes
    ----------
    step : (n, nq) array
        Newton steps; NaN where a loop has lost rank.
    gaps : (n, m) array
        Scaled residuals of the retained conditions.
    rank : (n, loops) array
        Reciprocal condition numbers of the closure matrices; 0 where rank is lost.
    flat : (n,) array of bool
        Whether a loop has lost rank.
    """

    step: Array
    gaps: Array
    rank: Array
    flat: NDArray[np.bool_]


class Parts:
    """Groups of loops without common dependent coordinates.

    Parameters
    ----------
    rows : (m,) array of int
        The group of each retained condition.
    coordinates : (nq,) array of int
        The group of each dependent coordinate; entries of independent ones have no effect.
    """

    def __init__(self, rows: Indices, coordinates: Indices):
        self.rows, self.coordinates = rows, coordinates
        self.count = 1 + int(max(rows.max(initial=0), coordinates.max(initial=0)))
        self._of_rows = np.arange(self.count)[:, None] == rows
        self._of_coordinates = np.arange(self.count)[:, None] == coordinates

    def sizes(self, steps: Array) -> Array:
        """The largest entry of steps (n, nq) per group, (n, groups)."""
        return self._largest(steps, self._of_coordinates)

    def open_by(self, gaps: Array) -> Array:
        """The largest residual (n, m) in each group, (n, groups)."""
        return self._largest(gaps, self._of_rows)

    def squares(self, gaps: Array) -> Array:
        """Sums of squares of residuals (n, m) per group, (n, groups)."""
        return (gaps * gaps) @ self._of_rows.T

    def spread(self, values: Any) -> Array:
        """Expands values of groups (n, groups) to coordinates, (n, nq)."""
        return values[:, self.coordinates]

    def over_rows(self, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Expands values of groups (n, groups) to conditions, (n, m)."""
        return values[:, self.rows]

    def _largest(self, of: Array, members: NDArray[np.bool_]) -> Array:
        if self.count == 1:
            return np.abs(of).max(axis=1, initial=0.0)[:, None]
        return np.stack([np.abs(of[:, m]).max(axis=1, initial=0.0) for m in members], axis=1)


class Newton:
    """Newton's method for the closure of a partition.

    Parameters
    ----------
    opened : Opened
    kept : array of int
        The retained conditions.

    Attributes
    ----------
    slack : (m,) array or None
        Residuals allowed for redundant conditions, which changed parameters may open.
    scale : (nq,) array
        Unit of change of each coordinate: 1 rad, 0.5 of a quaternion component, or a characteristic length.
    """

    def __init__(self, opened: Opened, kept: Indices):
        manifest = opened.manifest
        self.opened, self.kept = opened, kept
        self.still = np.zeros(len(manifest["speed_names"]))
        self.quaternions = tuple(manifest["quaternions"])
        self.np, self.loops = len(manifest["parameter_names"]), len(manifest["loops"])
        self.scale = scale_of(manifest)
        self.slides = np.array([unit == "m" for unit in manifest["coordinate_units"]], bool)
        self.together = "closing_step" in opened.functions
        slack = np.zeros(len(manifest["closure_names"]))
        slack[manifest.get("redundant", [])] = ALLOWED * manifest.get("loop_tolerance", 0.0)
        self.slack = slack[kept] if slack.any() else None

    def named(self, q: Array, x: Array) -> dict[str, Any]:
        """The arguments by name; x holds the parameters and, with prescribed motion, the inputs and the time."""
        return placed(q, x, self.np)

    def all_gaps(self, q: Array, x: Array) -> Array:
        """Scaled position residuals of all conditions (..., conditions); x has the batch axes of q, or none."""
        given = self.named(q, x) | {"u": self.still}
        return self.opened.target.compute(self.opened.functions["closure"], given, q.shape[:-1])[0]

    def gaps(self, q: Array, x: Array) -> Array:
        """Scaled position residuals of the retained conditions."""
        return self._counting(self.all_gaps(q, x))

    def _counting(self, gaps: Array) -> Array:
        return gaps if len(self.kept) == gaps.shape[-1] else gaps[..., self.kept]

    def probe(self, q: Array, x: Array) -> Probe:
        """Newton steps and residuals of n states: q is (n, nq), x (n, ...)."""
        n = len(q)
        batch, given = ((n,), self.named(q, x)) if n != 1 else ((), self.named(q[0], x[0]))
        failed: dict[int, SingularJointError] = {}
        try:
            found = self._called(given, batch, failed if batch else None)
        except SingularLoopError:
            flat = np.ones(1, bool)
            return Probe(np.full(q.shape, np.nan), self.gaps(q[0], x[0])[None], np.zeros((1, self.loops)), flat)
        step, position, condition = found if batch else [a[None] for a in found]
        position = self._left(step, position)
        flat = np.zeros(n, bool)
        with np.errstate(all="ignore"):
            rank = np.minimum(1.0 / condition, 1.0)
        if failed:
            lost = np.array(list(failed), np.intp)
            flat[lost], step[lost], rank[lost] = True, np.nan, 0.0
            position[lost] = self.all_gaps(q[lost], x[lost])
        return Probe(step, self._counting(position), rank, flat)

    def _left(self, step: Array, position: Array) -> Array:
        """Sets residuals of redundant conditions to zero where they are within `slack` and Newton's step no longer reduces
        them."""
        if self.slack is None:
            return position
        position = position.copy()
        settled = self.sizes(step) <= NEAREST
        kept = position[np.ix_(settled, self.kept)]
        position[np.ix_(settled, self.kept)] = np.where(np.abs(kept) <= self.slack, 0.0, kept)
        return position

    def _called(
        self, given: Mapping[str, Any], batch: tuple[int, ...], failed: dict[int, SingularJointError] | None
    ) -> Sequence[Array]:
        """Newton steps, position residuals and condition numbers, by a call of the generated function."""
        values, functions = self.opened.target.compute, self.opened.functions
        if self.together:
            return values(functions["closing_step"], given, batch, failed=failed)
        (step,) = values(functions["newton_step"], given, batch, failed=failed)
        (condition,) = values(functions["conditions"], given, batch, failed=failed)
        position = values(functions["closure"], {**given, "u": self.still}, batch)[0]
        return step, position, condition

    def sizes(self, steps: Array) -> Array:
        """The largest scaled change of a coordinate (n,), from steps (n, nq)."""
        return np.abs(steps / self.scale).max(axis=1, initial=0.0)

    def paces(self, q: Array, x: Array) -> Array:
        """The largest dependent speeds (n,), 1/s, that prescribed motion alone causes; infinite where rank is lost."""
        found = np.full(len(q), np.inf)
        for n in range(len(q)):
            given = self.named(q[n], x[n]) | {"u": self.still}
            with contextlib.suppress(SingularLoopError):
                (u,) = self.opened.target.compute(self.opened.functions["completion"], given, ())
                found[n] = max(float(np.abs(u).max(initial=0.0)), 1e-6)
        return found

    def single(self, q: Array, x: Array) -> tuple[Array | None, float]:
        """Full Newton steps from one guess (nq,), with less overhead than `quick`; None if the guess is not near a closed
        state."""
        if self.slack is not None:
            closed, near, step = self.quick(q[None], x[None])
            return closed[0] if near[0] else None, float(step[0])
        size, square, best, first = LARGEST / CONTRACTION, np.inf, None, 0.0
        for n in range(QUICK):
            try:
                step, position, _ = self._called(self.named(q, x), (), None)
            except SingularLoopError:
                return None, np.inf
            gaps = self._counting(position)
            open_by = largest(gaps)
            if open_by <= CLOSED:
                now = float(gaps.dot(gaps))
                if now >= square:
                    break
                best = q
                if now == 0.0 or now > BETTER * square:
                    break
                square = now
            else:
                before, size = size, largest(step / self.scale)
                first = first if n else size
                if not size <= CONTRACTION * before:
                    return None, size
            q = q + step
            normalise(q, self.quaternions)
        return best, first

    def quick(self, q: Array, x: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Takes full Newton steps from n guesses: coordinates (n, nq), whether they converged, and the size of the first step
        (n,)."""
        q, best, near = q.copy(), q.copy(), np.zeros(len(q), bool)
        going: Indices = np.arange(len(q))
        size, square = np.full(len(q), LARGEST / CONTRACTION), np.full(len(q), np.inf)
        first = np.zeros(0)
        for n in range(QUICK):
            found = self.probe(q[going], x[going])
            before, size = size, self.sizes(found.step)
            first = first if n else size
            closed = np.abs(found.gaps).max(axis=1, initial=0.0) <= CLOSED
            now = np.einsum("ij,ij->i", found.gaps, found.gaps)
            better = closed & (now < square)
            near[going[better]], best[going[better]] = True, q[going[better]]
            on = np.where(closed, (now > 0.0) & (now <= BETTER * square), size <= CONTRACTION * before)
            if not on.all():
                going, size, now, closed = going[on], size[on], now[on], closed[on]
                if not going.size:
                    break
            square = np.where(closed, now, np.inf)
            moved = q[going] + (found.step if len(going) == len(on) else found.step[on])
            normalise(moved, self.quaternions)
            q[going] = moved
        return best, near, first

    def path(self, q: Array, x: Array, parts: Parts, goal: float = 0.0) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Follows the Newton paths of n guesses (n, nq), with separate step sizes for each group of loops.

        Parameters
        ----------
        goal : float
            A group is finished when its largest residual is at most this.

        Returns
        -------
        q : (n, nq) array
        gaps : (n, m) array
            Scaled residuals of the retained conditions.
        flat : (n,) array of bool
            Whether a loop has lost rank at the guess, where no step exists.
        """
        q = q.copy()
        step, gaps, _, flat = self.probe(q, x)
        fraction = np.ones((len(q), parts.count))
        going = np.logical_not(flat)[:, None] & (parts.open_by(gaps) > goal)
        for _ in range(STEPS):
            n = np.flatnonzero(going.any(axis=1))
            if not n.size:
                break
            q[n], step[n], gaps[n], fraction[n], going[n] = self._onward(
                (q[n], x[n]), step[n], gaps[n], fraction[n], going[n], parts, goal
            )
        return q, gaps, flat

    def _onward(
        self,
        at: tuple[Array, Array],
        step: Array,
        gaps: Array,
        fraction: Array,
        going: NDArray[np.bool_],
        parts: Parts,
        goal: float,
    ) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """One step of all unfinished groups: coordinates, steps, residuals, fractions of steps, and which groups remain
        unfinished."""
        q, x = at
        # for wide gaps (after a change of parameters) the characteristic length of a loop is too small a unit
        lengths = np.maximum(1.0, np.abs(gaps).max(axis=1, initial=0.0))[:, None]
        scale = self.scale * np.where(self.slides, lengths, 1.0)
        with np.errstate(all="ignore"):
            fraction = np.minimum(fraction, LARGEST / parts.sizes(step / scale))
            taken = parts.spread(np.where(going, fraction, 0.0))
            trial = q + taken * step
            normalise(trial, self.quaternions)
            there = self.probe(trial, x)
            off = parts.sizes((there.step - (1.0 - taken) * step) / scale) / parts.sizes(step / scale)
            square, now = parts.squares(gaps), parts.squares(there.gaps)
        near = parts.open_by(gaps) <= CLOSED
        good = going & np.where(near, now < square, (now < square) & (off <= BENT)) & ~there.flat[:, None]
        over, rows = parts.spread(good) > 0, parts.over_rows(good)
        q, step, gaps = np.where(over, trial, q), np.where(over, there.step, step), np.where(rows, there.gaps, gaps)
        on = np.where(near, good & (now <= BETTER * square), good | (fraction > LEAST))
        going = going & on & (parts.open_by(gaps) > goal)
        # the less the path curves, the longer the next step; after a rejected step, the next one is shorter
        with np.errstate(all="ignore"):
            longer = np.minimum(1.0, fraction * np.clip(0.5 * BENT / off, 1.0, 4.0))
        return q, step, gaps, np.where(good, longer, np.where(going, 0.4 * fraction, fraction)), going
