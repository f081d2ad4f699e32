"""Closing a ring of joints: damped Newton steps with a line search, for several configurations at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .geometry import Array, advance
from .paths import Ring

ROUNDING = 1e-15
"""Residuals below this, times the distance from the base in characteristic lengths, are not worth a step."""

CLOSED = 1e-10
"""Residuals that count as closed, in the same measure: between rounding and any gap that is meant."""

MAX_STEPS = 60
LARGEST_TURN = 0.7
"""rad; longer steps are shortened, as the linearisation means nothing over half a radian."""

RANK_TOLERANCE = 1e-9
"""Singular values of the closure matrix below this part of the largest are not divided by."""


@dataclass(slots=True)
class Closed:
    """Outcome of a solve.

    Attributes
    ----------
    q : (S, nq + 1) array
    residual : (S,) array
        Largest scaled residual.
    ok : (S,) array
        Whether it counts as closed.
    rows : (S, rows) array
        All residuals.
    """

    q: Array
    residual: Array
    ok: Array
    rows: Array


def close(ring: Ring, q: Array, movable: Array) -> Closed:
    """Close the loops of a ring.

    Least-squares, minimum-norm Newton steps; each must lower the largest residual, else it is shortened; where no
    length will do the step is damped (Levenberg and Marquardt). Angles count in rad, displacements in lengths.

    Parameters
    ----------
    q : (S, nq + 1) array
        Guesses.
    movable : (S, f) array
        1 for the speeds of the ring's joints that may move, 0 for the others.
    """
    speeds = ring.joints.speeds
    turning = ring.geometry.turning[speeds]
    scale = movable * np.where(turning, 1.0, np.max(ring.geometry.lengths[ring.cuts.loops]))
    rows, E = ring.evaluate(q)
    norm = np.max(np.abs(rows), axis=1, initial=0.0)
    unit = 1 + ring.reach()
    damping = np.zeros(len(q))
    active = norm > ROUNDING * unit
    steps = 0
    while np.any(active) and steps < MAX_STEPS:
        steps += 1
        y = _step(E * scale[:, None], rows, damping)
        y *= np.minimum(1, LARGEST_TURN / np.maximum(np.max(np.abs(y), axis=1, initial=0.0), 1e-300))[:, None]
        t = np.ones(len(q))
        for _ in range(5):
            q_new = advance(ring.geometry, q, speeds, t[:, None] * scale * y)
            rows_new, E_new = ring.evaluate(q_new)
            norm_new = np.max(np.abs(rows_new), axis=1, initial=0.0)
            better = norm_new <= (1 - 1e-3 * t) * norm
            if np.all(better | ~active):
                break
            if np.all((norm < CLOSED * unit) | better | ~active):
                break  # rounding has been reached
            t = np.where(better, t, t / 3)
        taken = better & active
        slow = taken & (norm_new > 0.5 * norm) & (norm_new < CLOSED * unit)
        q[taken], rows[taken], E[taken], norm[taken] = q_new[taken], rows_new[taken], E_new[taken], norm_new[taken]
        stuck = active & ~better
        damping = np.where(taken, damping / 10, np.where(damping > 0, damping * 10, 0.01))
        damping[damping < 1e-3] = 0
        active &= (norm > ROUNDING * unit) & ~slow & ~(stuck & ((norm < CLOSED * unit) | (damping > 2)))
    return Closed(q, norm, norm < CLOSED * unit, rows)


def _step(E: Array, rows: Array, damping: Array) -> Array:
    """Minimum-norm least-squares steps ``(S, f)``, damped by `damping` times the largest singular value."""
    U, s, Vt = np.linalg.svd(E, full_matrices=False)
    largest = np.max(s, axis=1, initial=0.0)[:, None]
    kept = s > RANK_TOLERANCE * np.maximum(largest, 1e-300)
    inverse = np.where(kept, s, 0.0) / np.where(kept, s * s + (damping[:, None] * largest) ** 2, 1.0)
    return -np.squeeze(np.swapaxes(Vt, -1, -2) @ (inverse[..., None] * (np.swapaxes(U, -1, -2) @ rows[..., None])), -1)
