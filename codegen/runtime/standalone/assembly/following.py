"""Continuation: closed states followed along lines of what they depend on, never over a pose where their branch ends.

A step predicts along the tangent of the closure and closes the loops by Newton's method from there. It is taken only if
Newton's steps contract, and if the tangents at both of its ends agree with the way between them (the trapezoidal rule): past
the end of a branch, or on another one, they do not. Where a branch ends, steps become ever shorter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices, normalise
from .newton import CONTRACTION, LARGEST, Newton

PART = 1e-2
"""Part of a step by which a state is moved on for its tangent, which is Newton's step from there."""

START = 1e-9
"""Part of a line for the first tangent."""

FIRST = 1.0 / 16
"""Part of a line that the first step takes at most."""

CORRECTIONS = 6
"""Steps of Newton's method in a step along a line."""

DONE, SETTLED = 1e-10, 1e-8
"""rad, or characteristic lengths: a step of Newton's method that is not followed by another one; what is open then at most."""

AGREES = 0.1
"""By how much the way of a step may differ from what the tangents at its ends say, in parts of the longer one."""

GROWTH, SHORTER = 2.0, 0.4
"""How much longer the next step is at most after one that was taken, and how much shorter after one that was not."""

SHORTEST, FINEST = 1e-7, 1e-14
"""rad, or characteristic lengths, and parts of a line: where shorter steps would be needed a branch ends."""

MOST = 3000
"""Steps along a line, of a hundred turns or so."""

MOVING = 0.05
"""rad, or characteristic lengths: a tangent that moves coordinates by more than this says how long the first step is."""

STEEPER = 2.0
"""Times by which a reciprocal condition number may change faster within a step than it is seen to change."""

CROSSING = 1e-3
"""rad, or characteristic lengths: steps that are no longer are taken over what may be a pose where branches meet."""


class Line(NamedTuple):
    """Straight lines that n states are followed along.

    Attributes
    ----------
    q0, q1 : (n, k) array
        Independent coordinates at both ends.
    x0, x1 : (n, ...) array
        Parameters, and where motion is prescribed inputs and the time.
    shared : (n, nq) array
        At the ends, coordinates of joints that are independent in part.
    """

    q0: Array
    q1: Array
    x0: Array
    x1: Array
    shared: Array

    def of(self, n: Indices) -> Line:
        """Some of the lines."""
        return Line(*(a[n] for a in self))

    def at(self, s: Array) -> tuple[Array, Array]:
        """Independent coordinates and parameters at parts s (n,) of the lines."""
        part = s[:, None]
        q, x = self.q0 + part * (self.q1 - self.q0), self.x0 + part * (self.x1 - self.x0)
        # the ends themselves, to the last digit
        return np.where(part == 1.0, self.q1, q), np.where(part == 1.0, self.x1, x)


class Followed(NamedTuple):
    """Where n states have been followed to.

    Attributes
    ----------
    q : (n, nq) array
        The last closed states.
    s : (n,) array
        The parts of the lines that were covered; 1 where a state has arrived.
    rank : (n, loops) array
        Reciprocal condition numbers of closure matrices there.
    crossed : (n,) array of int
        The last loop that has lost rank on the way, where branches meet; -1 if none has.
    ended : (n,) array of bool
        Whether a branch ends there; the others that have not arrived are too far away.
    """

    q: Array
    s: Array
    rank: Array
    crossed: Indices
    ended: NDArray[np.bool_]


class _Going(NamedTuple):
    """States that are being followed: where they are, how they go on, and how reciprocal condition numbers change."""

    q: Array
    s: Array
    h: Array
    tangent: Array
    rank: Array
    slope: Array

    def of(self, n: Indices) -> _Going:
        """Some of them."""
        return _Going(*(a[n] for a in self))


class Follower:
    """Follows closed states.

    Parameters
    ----------
    newton : Newton
    independent : (k,) array of int
        The coordinates that lines prescribe; the others follow.
    shared : array of int
        Those of the others that belong to joints that are independent in part. Lines aim them at their ends, and closing takes
        away from that what is along dependent speeds.
    """

    def __init__(self, newton: Newton, independent: Indices, shared: Indices):
        self.newton, self.independent, self.shared = newton, independent, shared
        self.others = np.setdiff1d(np.arange(len(newton.scale)), independent)

    def placed(self, q: Array, line: Line, s: Array) -> tuple[Array, Array]:
        """Coordinates (n, nq) with the independent ones of parts of lines; and the parameters there."""
        own, x = line.at(s)
        q = q.copy()
        q[:, self.independent] = own
        normalise(q, self.newton.quaternions)
        return q, x

    def follow(self, q: Array, line: Line, part: float = FIRST) -> Followed:
        """Follow n closed states (n, nq) from the beginnings of lines as far as their branches go.

        `part` is the part of a line that the first step takes at most, if nothing moves where it begins.
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
        """Steps by parts h of lines: where they lead, their errors in parts of those allowed, which loops may lose rank."""
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
        """Newton's method from predicted states: coordinates, and where its steps contract to closure."""
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
        """By how much shared coordinates are to change along the rest of lines, for all of a line, (n, nq)."""
        aim = np.zeros_like(q)
        aim[:, self.shared] = (line.shared - q)[:, self.shared] / (1.0 - s)[:, None]
        for i in self.newton.quaternions:  # of length one all the way
            e = q[:, i : i + 4]
            aim[:, i : i + 4] -= e * (e * aim[:, i : i + 4]).sum(axis=1, keepdims=True)
        return aim

    def _tangents(self, q: Array, line: Line, s: Array, part: Array, aim: Array) -> tuple[Array, Array]:
        """Derivatives of closed coordinates along lines, (n, nq), and reciprocal condition numbers, (n, loops)."""
        part = np.where(s + part > 1.0, -part, part)
        moved, x = self.placed(q + part[:, None] * aim, line, s + part)
        found = self.newton.probe(moved, x)
        tangent = aim + found.step / part[:, None]
        tangent[:, self.independent] = line.q1 - line.q0
        return tangent, found.rank

    def _others(self, change: Array) -> Array:
        """The largest of the changes of coordinates that follow, scaled, (n,)."""
        mine = np.abs(change[:, self.others] / self.newton.scale[self.others])
        return mine.max(axis=1, initial=0.0)
