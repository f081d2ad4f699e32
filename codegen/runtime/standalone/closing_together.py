"""Newton's method on the dependent coordinates of many states at once: for each what `Newton.solve` does with all loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Indices, normalise
from .errors import SingularJointError
from .newton import SEARCH, STEPS, Newton

FEW = 4
"""States that are as quickly closed one after the other."""


def solve_together(newton: Newton, q: Array, p: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Coordinates (n, nq) that n guesses lead to, their conditions that count, and which states met a loop without rank, (n,).

    Every state takes the steps that it would take alone, until none makes its residuals smaller; each evaluation is one call
    for all that go on. `p` is (n, np).
    """
    q = q.copy()
    gaps = newton.gaps(q, p)
    flat = np.zeros(len(q), bool)
    going: Indices = np.flatnonzero(np.abs(gaps).max(axis=1, initial=0.0) > 0.0)
    step_of, target = newton.opened.functions["newton_step"], newton.opened.target
    for _ in range(STEPS):
        if not going.size:
            break
        failed: dict[int, SingularJointError] = {}
        (step,) = target.values(step_of, newton.named(q[going], p[going]), (going.size,), (), failed)
        if failed:
            lost = np.array(list(failed), np.intp)
            flat[going[lost]] = True
            step, going = np.delete(step, lost, axis=0), np.delete(going, lost)
        with np.errstate(all="ignore"):  # a step may lead anywhere
            going = _search(newton, q, p, gaps, step, going)
        going = going[np.abs(gaps[going]).max(axis=1, initial=0.0) > 0.0]
    return q, gaps, flat


def _search(newton: Newton, q: Array, p: Array, gaps: Array, step: Array, going: Indices) -> Indices:
    """Take as much of each state's step as makes its residuals smaller; the states that have become so."""
    smaller: list[Indices] = []
    for fraction in SEARCH:
        if not going.size:
            break
        trial = q[going] + fraction * step
        normalise(trial, newton.quaternions)
        after = newton.gaps(trial, p[going])
        # the sum of squares goes down by nearly what a linear closure would take off
        better = _squares(after) < (1.0 - 0.2 * fraction) * _squares(gaps[going])
        done = going[better]
        q[done], gaps[done] = trial[better], after[better]
        smaller.append(done)
        going, step = going[~better], step[~better]
    return np.sort(np.concatenate(smaller)) if smaller else going


def _squares(gaps: Array) -> Array:
    found: Array = np.einsum("ij,ij->i", gaps, gaps)
    return found


__all__ = ["FEW", "solve_together"]
