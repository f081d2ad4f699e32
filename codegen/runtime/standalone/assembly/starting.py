"""Finds closed states from which continuation can start, if a guess is not near one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices, normalise
from .following import Follower
from .newton import CLOSED, Newton, Parts

MOVED = 1e-7
"""Increment of the difference quotients of residuals in a fit: rad, characteristic lengths or seconds."""

FITTED = 1e-9
"""Scaled residual at which a fit has converged."""

CONSISTENT = 1e-6
"""Scaled residual up to which a fit succeeds; a guess is expected to have at least six correct digits."""

LARGEST = 0.5
"""The longest step of a fit, rad or characteristic lengths."""

BETTER = 0.9999
"""Factor by which a step must reduce the sum of squared residuals to be accepted."""

AGAIN = (1.5, -1.5)
"""Offsets of further starting points, rad or characteristic lengths, if the fit from the guess fails."""

FITS, HALVINGS = 40, 5
"""Maximum number of steps of a fit, and of halvings of each step."""


class Starts:
    """Finds closed states with the dependent coordinates of guesses, by varying the independent coordinates or the time.

    Parameters
    ----------
    newton : Newton
    follower : Follower
    timed : bool
        Whether motion is prescribed; the state then depends on the time, the last entry of x.
    """

    def __init__(self, newton: Newton, follower: Follower, timed: bool):
        self.newton, self.follower, self.timed = newton, follower, timed

    def find(self, q: Array, x: Array, parts: Parts) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Closed states (n, nq) with the dependent coordinates of guesses, their parameters and times, and whether each was
        found."""
        guess, x_guess = q, x
        q, x, fits = self._fitted(q, x)
        for turned in AGAIN if self._unknowns else ():
            n = np.flatnonzero(~fits)
            if not n.size:
                break
            # all entries differ in magnitude, so that no symmetry of the guess is kept
            offset = np.tile(turned * np.cos(0.3 * np.arange(self._unknowns)), (n.size, 1))
            if self.timed:
                offset[:, -1] = turned / self.newton.paces(guess[n], x_guess[n])
            other_q, other_x, fit = self._fitted(*self._changed(guess[n], x_guess[n], offset))
            q[n[fit]], x[n[fit]], fits[n[fit]] = other_q[fit], other_x[fit], True
        q, gaps, flat = self.newton.path(q, x, parts)
        return q, x, fits & ~flat & (parts.open_by(gaps).max(axis=1) <= CLOSED)

    def _fitted(self, q: Array, x: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Fits independent coordinates and times to close the loops (Gauss-Newton), and returns where this succeeds."""
        q, x = q.copy(), x.copy()
        gaps = self.newton.gaps(q, x)
        going: Indices = np.flatnonzero(np.isfinite(gaps).all(axis=1))
        for _ in range(FITS if self._unknowns else 0):
            going = going[np.abs(gaps[going]).max(axis=1, initial=0.0) > FITTED]
            if not going.size:
                break
            slopes = self._slopes(q[going], x[going], gaps[going])
            change = -np.einsum("nkm,nm->nk", np.linalg.pinv(slopes, rcond=1e-6), gaps[going])
            with np.errstate(all="ignore"):
                change *= np.minimum(1.0, LARGEST / self._moved(slopes, change))[:, None]
            going = self._shorter(q, x, gaps, going, change)
        slack = 0.0 if self.newton.slack is None else self.newton.slack
        return q, x, np.abs(gaps - np.clip(gaps, -slack, slack)).max(axis=1, initial=0.0) <= CONSISTENT

    @property
    def _unknowns(self) -> int:
        return len(self.follower.independent) + self.timed

    def _moved(self, slopes: Array, change: Array) -> Array:
        """The largest change (n,) of independent coordinates or residuals caused by changes of unknowns (n, unknowns)."""
        opened = np.abs(np.einsum("nmk,nk->nm", slopes, change)).max(axis=1, initial=0.0)
        turned = np.abs(change[:, : len(self.follower.independent)]).max(axis=1, initial=0.0)
        return np.maximum(opened, turned)

    def _shorter(self, q: Array, x: Array, gaps: Array, going: Indices, change: Array) -> Indices:
        """Halves the changes until they reduce the residuals and applies them; returns the states where this
        succeeds."""
        done: list[Indices] = []
        for _ in range(HALVINGS):
            if not going.size:
                break
            there = self._changed(q[going], x[going], change)
            found = self.newton.gaps(*there)
            good = _squares(found) < BETTER * _squares(gaps[going])
            taken = going[good]
            q[taken], x[taken], gaps[taken] = there[0][good], there[1][good], found[good]
            done.append(taken)
            going, change = going[~good], 0.5 * change[~good]
        return np.sort(np.concatenate(done)) if done else going[:0]

    def _slopes(self, q: Array, x: Array, gaps: Array) -> Array:
        """Derivatives of the residuals with respect to the unknowns, by difference quotients, (n, m, unknowns)."""
        n, k = len(q), self._unknowns
        units = np.tile(MOVED * np.eye(k), (n, 1))
        found = self.newton.gaps(*self._changed(np.repeat(q, k, axis=0), np.repeat(x, k, axis=0), units))
        return ((found.reshape(n, k, -1) - gaps[:, None]) / MOVED).transpose(0, 2, 1)

    def _changed(self, q: Array, x: Array, change: Array) -> tuple[Array, Array]:
        """States with changed unknowns, which are scaled independent coordinates and the time; change is (n,
        unknowns)."""
        q, x = q.copy(), x.copy()
        independent = self.follower.independent
        q[:, independent] += change[:, : len(independent)] * self.newton.scale[independent]
        normalise(q, self.newton.quaternions)
        if self.timed:
            x[:, -1] += change[:, -1]
        return q, x


def _squares(gaps: Array) -> Array:
    return np.einsum("ij,ij->i", gaps, gaps)
