"""Equilibria: Newton's method in the tangent space, relaxation if it fails, and derivatives of the equilibrium."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....html_tables import html_of
from ..arrays import Array
from ..errors import AssemblyError, EquilibriumError

NEWTON = 100
"""Maximum number of Newton steps."""

RELAXATION = 300
"""Maximum number of relaxation steps."""

HALVINGS = 30
"""Maximum number of halvings of a step."""

RADIUS = 0.5
"""rad or m: limit on the largest component of the first step; doubled after each successful step of that size."""

POOR, GOOD = 0.5, 0.1
"""Relative errors of the linear prediction of accelerations: below POOR a relaxation step is accepted, below GOOD the
next step is longer."""

FINEST = 1e-16
"""rad or m: smallest step near an equilibrium."""

SINGULAR = 1e-12
"""A singular value of the Jacobian is zero if it is below this fraction of the largest one."""

NONE = 1e-14
"""1/s^2: singular values below this are rounding errors of balanced forces. An oscillation with this squared angular
frequency would have a period of two years."""

KEPT = 1e-8
"""Largest relative distance of a right side from the range of a singular Jacobian at which the equations count as solvable."""


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    """An equilibrium.

    Attributes
    ----------
    q, u : ndarray (nq,), (nu,)
        The state, assembled; u is zero.
    residual : float
        Largest remaining acceleration of an independent speed, rad/s^2 or m/s^2.
    iterations : int
        Steps of Newton's method and of relaxation.
    relaxed : bool
        Whether relaxation was used, on request or because Newton's method failed.
    names : tuple of str
        Parameters and inputs of the derivatives.
    dq : ndarray (k, nq)
        Derivatives of q with respect to these parameters and inputs, exact to rounding. NaN for one whose change causes
        accelerations along a neutral direction, so that no equilibrium remains nearby.
    stable : bool or None
        Whether no eigenvalue of the linearised equations has a positive real part, to rounding. None if
        undecided: always near a loss of rank of a loop, and possibly with a neutral direction.
    neutral : ndarray (m, nq)
        Directions of unit length along which the mechanism stays at rest. If there are any, q is one of many equilibria
        near the guess, and dq is the change of least norm.
    coordinate_names : tuple of str
        Names of the coordinates.
    """

    q: Array
    u: Array
    residual: float
    iterations: int
    relaxed: bool
    names: tuple[str, ...]
    dq: Array
    stable: bool | None
    neutral: Array
    coordinate_names: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        text = {True: "stable", False: "unstable", None: "stability undecided"}[self.stable]
        if len(self.neutral):
            most = [self.coordinate_names[int(np.argmax(np.abs(row)))] for row in self.neutral]
            text += f", {len(most)} neutral direction{'s' * (len(most) > 1)} ({', '.join(most)} most)"
        if self.names:
            text += f", derivatives with respect to {', '.join(self.names)}"
        how = " after relaxation" if self.relaxed else ""
        steps = f"{self.iterations} step{'s' * (self.iterations != 1)}{how}"
        values = ", ".join(f"{n}={x:.6g}" for n, x in zip(self.coordinate_names[:12], self.q, strict=False))
        more = ", ..." if len(self.q) > 12 else ""
        return f"<Equilibrium: {values}{more}; {text}; residual {self.residual:.2g} after {steps}>"

    def _repr_html_(self) -> str:
        rows = ((f"q.{name}", self.q[i], *self.dq[:, i]) for i, name in enumerate(self.coordinate_names))
        return html_of([repr(self)], ("", "value", *(f"by {name}" for name in self.names)), rows)


class Motions(NamedTuple):
    """Accelerations of a state at rest and their derivatives.

    Attributes
    ----------
    tangents : (n, nq)
        Changes of the coordinates along each direction of the tangent space.
    udot : (n,)
        Accelerations of the independent speeds.
    J : (n, n)
        Derivatives of udot; columns are directions.
    """

    tangents: Array
    udot: Array
    J: Array


class Search:
    """Searches for an equilibrium of a mechanism.

    Parameters
    ----------
    motions : callable (q) -> Motions
    udot : callable (q) -> (n,) array
    retract : callable (q) -> q
        Assembles coordinates after a step along tangents.
    tolerance : float
    """

    def __init__(
        self,
        motions: Callable[[Array], Motions],
        udot: Callable[[Array], Array],
        retract: Callable[[Array], Array],
        tolerance: float,
    ):
        self.motions, self.udot, self.retract, self.tolerance = motions, udot, retract, tolerance
        self.iterations = 0

    def is_rest(self, m: Motions) -> bool:
        """Whether a state is an equilibrium."""
        return rests(m.udot, m.J, self.tolerance)

    def newton(self, q: Array) -> tuple[Array, Motions]:
        """Newton's method from a guess, until it converges or fails.

        A step is accepted if the next step with the same Jacobian is shorter (Deuflhard's natural monotonicity test). The test
        compares displacements, so it is independent of inertia and units. If the Jacobian is singular, the step of least norm is
        taken.
        """
        radius = RADIUS
        m = self.motions(q)
        for _ in range(NEWTON):
            if not np.isfinite(m.J).all():
                break
            inverse = _inverse(m.J)
            step = -inverse @ m.udot
            length, size = float(np.linalg.norm(step)), float(np.abs(step).max(initial=0.0))
            near = self.is_rest(m)
            if size <= (FINEST if near else 0.0):
                break
            fraction = first = min(1.0, radius / size)
            for _ in range(1 if near else HALVINGS):
                found = self._tried(q, m, fraction * step)
                if found is not None:
                    left = float(np.linalg.norm(inverse @ found[1]))
                    if left <= (1.0 - 0.25 * fraction) * length * (0.5 if near else 1.0):
                        break
                fraction *= 0.5
            else:
                break
            if fraction == first < 1.0:
                radius *= 2.0
            elif fraction < first:
                radius = max(fraction * size, RADIUS)
            self.iterations += 1
            q, m = found[0], self.motions(found[0])
        return q, m

    def relax(self, q: Array) -> tuple[Array, Motions]:
        """Relaxation: integrates ``w' = udot`` by implicit steps of growing size until the accelerations are small.

        The mechanism moves as if creeping in a viscous medium. If the forces have a potential, the potential decreases,
        so the equilibrium found is stable. Steps grow while the linear prediction is accurate, and finally become
        Newton steps.
        """
        m = self.motions(q)
        rate = float(np.linalg.norm(m.J)) or 1.0  # 1/s^2; its reciprocal is the size of the step
        radius = RADIUS
        for _ in range(RELAXATION):
            if not np.isfinite(m.J).all() or self.is_rest(m):
                break
            # a rate above all positive eigenvalues: steps lead away from an unstable equilibrium, not across it
            least = 2.0 * float(np.linalg.eigvals(m.J).real.max(initial=0.0))
            rate = max(rate, least)
            for _ in range(HALVINGS):
                step = np.asarray(np.linalg.solve(rate * np.eye(len(m.J)) - m.J, m.udot), np.float64)
                found = self._tried(q, m, step) if np.abs(step).max() <= radius else None
                # the linear equations predict the accelerations rate * step
                if found is not None:
                    error = float(np.linalg.norm(found[1] - rate * step) / np.linalg.norm(m.udot))
                    if error <= POOR:
                        break
                rate *= 4.0
            else:
                break
            radius *= 2.0 if np.abs(step).max() > 0.5 * radius else 1.0
            rate *= 0.25 if error < GOOD else 1.0
            self.iterations += 1
            q, m = found[0], self.motions(found[0])
        return q, m

    def _tried(self, q: Array, m: Motions, step: Array) -> tuple[Array, Array] | None:
        """Coordinates after a step, and accelerations there; None if the loops do not close or a pivot is zero."""
        try:
            moved = self.retract(q + step @ m.tangents)
            udot = self.udot(moved)
        except (AssemblyError, np.linalg.LinAlgError):
            return None
        return (moved, udot) if np.isfinite(udot).all() else None

    def find(self, q: Array, names: tuple[str, ...], relax: bool) -> tuple[Array, Motions, bool]:
        """An equilibrium: coordinates, accelerations and Jacobian, and whether relaxation found it.

        Raises
        ------
        EquilibriumError
        """
        q = self.retract(q)
        tried: list[tuple[Array, Motions]] = []
        for relaxed in (True, False) if relax else (False, True):
            found = self.newton(self.relax(q)[0] if relaxed else q)
            if self.is_rest(found[1]):
                return *found, relaxed
            tried.append(found)
        best = min(tried, key=lambda found: _largest(found[1]))
        worst = int(np.argmax(np.abs(best[1].udot)))
        raise EquilibriumError(_largest(best[1]), names[worst], best[0])


def rests(udot: Array, J: Array, tolerance: float) -> bool:
    """Whether accelerations are negligible compared with 1, or with the accelerations that a displacement of 1 rad or 1
    m causes."""
    return bool(np.all(np.abs(udot) <= tolerance * (1.0 + np.abs(J).sum(axis=1))))


def _largest(m: Motions) -> float:
    found = float(np.abs(m.udot).max(initial=0.0))
    return found if math.isfinite(found) else math.inf


def followed(J: Array, pushes: Array) -> Array:
    """Displacements w (k, n) of an equilibrium when udot changes by pushes (k, n): ``J w = -push`` (implicit function theorem).

    The solution of least norm if J is singular; NaN if there is none.
    """
    w = -pushes @ _inverse(J).T
    left = np.abs(pushes + w @ J.T).max(axis=1, initial=0.0)
    w[left > KEPT * np.abs(pushes).max(axis=1, initial=0.0)] = np.nan
    return w


def neutral_directions(J: Array) -> Array:
    """Orthonormal directions w (m, n) along which udot does not change."""
    _, sizes, rows = np.linalg.svd(J)
    return np.asarray(rows[~_regular(sizes)], np.float64)


def _regular(sizes: Array) -> NDArray[np.bool_]:
    """Mask of the singular values that do not count as zero."""
    return sizes > max(SINGULAR * sizes.max(initial=0.0), NONE)


def _inverse(J: Array) -> Array:
    """The pseudo-inverse from a singular value decomposition."""
    columns, sizes, rows = np.linalg.svd(J)
    kept = _regular(sizes)
    return np.asarray((rows[kept].T / sizes[kept]) @ columns[:, kept].T, np.float64)
