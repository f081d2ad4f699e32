"""Continuation: closed states are continued along straight lines in the independent coordinates, parameters and time.

A step predicts along the tangent and corrects with Newton's method. A step is accepted only if Newton's corrections
contract and the tangents at both ends agree with the step (trapezoidal rule). Beyond the end of a branch, or on another
branch, the tangents do not agree with the step. So steps shrink toward the end of a branch and never pass it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices, normalise
from .newton import CONTRACTION, LARGEST, Newton

PART = 1e-2
"""Fraction of a step by which the independent coordinates are shifted for a tangent; Newton's step from there gives the
tangent."""

START = 1e-9
"""Shift of the independent coordinates to find the first tangent, as a fraction of the line."""

FIRST = 1.0 / 16
"""Upper bound of the first step, as a fraction of the line."""

CORRECTIONS = 6
"""Number of Newton iterations in each step."""

DONE, SETTLED = 1e-10, 1e-8
"""Step size at which Newton's method stops (rad, or characteristic lengths), and the largest scaled residual accepted then."""

AGREES = 0.1
"""Relative difference allowed between a step and the mean of the tangents at its ends."""

GROWTH, SHORTER = 2.0, 0.4
"""Largest factor between step sizes after an accepted step, and the factor after a rejected one."""

SHORTEST, FINEST = 1e-7, 1e-14
"""Step sizes below which a branch ends: the first in rad or characteristic lengths, the second as a fraction of the line."""

MOST = 3000
"""Maximum number of steps along a line, enough for about a hundred turns."""

MOVING = 0.05
"""Size of the first tangent, rad or characteristic lengths, above which that tangent alone limits the first step."""

STEEPER = 2.0
"""Safety factor on the rate at which a reciprocal condition number may change within a step."""

CROSSING = 1e-3
"""Largest step, rad or characteristic lengths, that may pass a possible branch point."""


class Line(NamedTuple):
    """Straight lines along which n states are continued.

    Attributes
    ----------
    q0, q1 : (n, k) array
        Independent coordinates at both ends.
    x0, x1 : (n, ...) array
        Parameters; with prescribed motion also the inputs and the time.
    shared : (n, nq) array
        Coordinates at the ends of the lines; used for joints of which only some speeds are independent.
    """

    q0: Array
    q1: Array
    x0: Array
    x1: Array
    shared: Array

    def of(self, n: Indices) -> Line:
        """The lines of the selected states."""
        return Line(*(a[n] for a in self))

    def at(self, s: Array) -> tuple[Array, Array]:
        """Independent coordinates and parameters at fractions s (n,) of the lines."""
        part = s[:, None]
        q, x = self.q0 + part * (self.q1 - self.q0), self.x0 + part * (self.x1 - self.x0)
        # at an end of the line, its exact values
        return np.where(part == 1.0, self.q1, q), np.where(part == 1.0, self.x1, x)


class Followed(NamedTuple):
    """The result of a continuation of n states.

    Attributes
    ----------
    q : (n, nq) array
        The last closed states.
    s : (n,) array
        Fractions of the lines that were covered; 1 at the end.
    rank : (n, loops) array
        Reciprocal condition numbers of the closure matrices there.
    crossed : (n,) array of int
        The last loop that lost rank on the way, at a branch point; -1 if none did.
    ended : (n,) array of bool
        Whether the branch ends there. Other states with s < 1 are too far from the end of the line.
    """

    q: Array
    s: Array
    rank: Array
    crossed: Indices
    ended: NDArray[np.bool_]


class _Going(NamedTuple):
    """States during continuation: coordinates, covered fraction, next step, tangent, reciprocal condition numbers and their
    rates."""

    q: Array
    s: Array
    h: Array
    tangent: Array
    rank: Array
    slope: Array

    def of(self, n: Indices) -> _Going:
        """A selection from the states that are being continued."""
        return _Going(*(a[n] for a in self))


class Follower:
    """Continues closed states along lines.

    Parameters
    ----------
    newton : Newton
    independent : (k,) array of int
        The coordinates that the line prescribes; all others are determined by closing the loops.
    shared : array of int
        Coordinates of joints of which only some speeds are independent. The predictor aims them at the end of the line;
        closing the loops removes the part of that motion along dependent speeds.
    """

    def __init__(self, newton: Newton, independent: Indices, shared: Indices):
        self.newton, self.independent, self.shared = newton, independent, shared
        self.others = np.setdiff1d(np.arange(len(newton.scale)), independent)

    def placed(self, q: Array, line: Line, s: Array) -> tuple[Array, Array]:
        """Coordinates (n, nq) with their independent entries, and parameters, at fractions s of the lines."""
        own, x = line.at(s)
        q = q.copy()
        q[:, self.independent] = own
        normalise(q, self.newton.quaternions)
        return q, x

    def follow(self, q: Array, line: Line, part: float = FIRST) -> Followed:
        """Continues n closed states (n, nq) along the lines, each as far as its branch of solutions reaches.

        Where the first tangent is small, `part` limits the first step, as a fraction of the line.
        """
        n = len(q)
        s, crossed = np.zeros(n), np.full(n, -1)
        tangent, rank = self._tangents(q, line, s, np.full(n, START), self._aim(q, s, line))
        h = np.where(self.newton.sizes(tangent) > MOVING, 1.0, part)
        all_of, stopped = _Going(q.copy(), s, h, tangent, rank, np.zeros_like(rank)), np.zeros(n, bool)
        going: Indices = np.flatnonzero(np.isfinite(tangent).all(axis=1))
        for _ in range(MOST):
            if not going.size:
                break
            at = all_of.of(going)
            pace = self.newton.sizes(at.tangent)
            with np.errstate(divide="ignore"):
                h = np.minimum(np.minimum(at.h, 1.0 - at.s), LARGEST / pace)
            there, error, lost = self._step(at, h, line.of(going))
            good = (error <= 1.0) & ~(lost.any(axis=1) & (h * pace > CROSSING))
            with np.errstate(divide="ignore"):
                next_h = h * np.where(good, np.clip(0.3 / error, 0.5, GROWTH), SHORTER)
            over = good & lost.any(axis=1)
            crossed[going[over]] = lost[over].argmax(axis=1)
            all_of.h[going] = next_h
            for mine, new in zip(all_of, there, strict=True):
                if mine is not all_of.h:
                    mine[going[good]] = new[good]
            ended = ~good & (((h * pace < SHORTEST) & (h < SHORTEST)) | (h < FINEST))
            stopped[going[ended]] = True
            going = going[~ended & (all_of.s[going] < 1.0)]
        return Followed(all_of.q, s, all_of.rank, crossed, stopped)

    def _step(self, at: _Going, h: Array, line: Line) -> tuple[_Going, Array, NDArray[np.bool_]]:
        """One step along each line, by the fraction h of its length: new states, errors relative to the tolerance, and which
        loops may have lost rank."""
        s, aim = np.where(h >= 1.0 - at.s, 1.0, at.s + h), self._aim(at.q, at.s, line)
        q, closed = self._closed(at.q + h[:, None] * at.tangent, line, s)
        tangent, rank, error = np.full_like(q, np.nan), at.rank.copy(), np.full(len(q), np.inf)
        good = np.flatnonzero(closed)
        if good.size:
            tangent[good], rank[good] = self._tangents(q[good], line.of(good), s[good], PART * h[good], aim[good])
            way = q[good] - at.q[good]
            says = 0.5 * h[good, None] * (at.tangent[good] + tangent[good])
            longest = h[good] * np.maximum(*(self._others(t[good]) for t in (at.tangent, tangent)))
            error[good] = self._others(way - says) / (AGREES * longest + DONE)
            error[np.isnan(error)] = np.inf
        slope = np.abs(rank - at.rank) / h[:, None]
        lost = rank + at.rank <= STEEPER * h[:, None] * np.maximum(slope, at.slope)
        return _Going(q, s, h, tangent, rank, slope), error, lost & closed[:, None]

    def _closed(self, guess: Array, line: Line, s: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Predicted states corrected by Newton's method, and whether the loops closed with contracting steps."""
        q, x = self.placed(guess, line, s)
        closed, before = np.zeros(len(q), bool), np.full(len(q), LARGEST / CONTRACTION)
        going: Indices = np.arange(len(q))
        for _ in range(CORRECTIONS):
            found = self.newton.probe(q[going], x[going])
            size = self.newton.sizes(found.step)
            on = (size <= CONTRACTION * before) | (size <= DONE)
            moved = q[going[on]] + found.step[on]
            normalise(moved, self.newton.quaternions)
            q[going[on]] = moved
            last = on & (size <= DONE)
            closed[going[last]] = np.abs(found.gaps[last]).max(axis=1, initial=0.0) <= SETTLED
            on &= ~last
            going, before = going[on], size[on]
            if not going.size:
                break
        return q, closed

    def _aim(self, q: Array, s: Array, line: Line) -> Array:
        """Derivatives (n, nq) of coordinates with respect to the position on the line (0 to 1), with which the shared
        coordinates reach their values at its end."""
        aim = np.zeros_like(q)
        aim[:, self.shared] = (line.shared - q)[:, self.shared] / (1.0 - s)[:, None]
        for i in self.newton.quaternions:  # rates of a quaternion are tangential to the unit sphere
            e = q[:, i : i + 4]
            aim[:, i : i + 4] -= e * (e * aim[:, i : i + 4]).sum(axis=1, keepdims=True)
        return aim

    def _tangents(self, q: Array, line: Line, s: Array, part: Array, aim: Array) -> tuple[Array, Array]:
        """Tangents (n, nq) of closed states along the lines, and reciprocal condition numbers (n, loops)."""
        part = np.where(s + part > 1.0, -part, part)
        moved, x = self.placed(q + part[:, None] * aim, line, s + part)
        found = self.newton.probe(moved, x)
        tangent = aim + found.step / part[:, None]
        tangent[:, self.independent] = line.q1 - line.q0
        return tangent, found.rank

    def _others(self, change: Array) -> Array:
        """The largest scaled change (n,) of the coordinates that the line does not prescribe."""
        mine = np.abs(change[:, self.others] / self.newton.scale[self.others])
        return mine.max(axis=1, initial=0.0)
