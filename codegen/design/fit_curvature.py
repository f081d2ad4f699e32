"""The full Hessian of a fit's sum of squares, which J^T J approximates, and profile likelihood intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.motion.functionals import LeastSquares
from ..runtime.standalone.warning import warn
from .curvature import check_initial_state
from .experiments import Experiment

OF_JUDGE = ("rtol", "atol", "step", "largest_step", "most_steps")
"""Options of `Solver.simulate` that `Solver.judge` has, too."""

CLOSE = 1e-5
"""Relative distance from the end of an interval at which the search for this end stops."""

TRIALS = 40
"""Largest number of minimisations for one end of an interval."""

FAR = 1e4
"""Distance from the best value, in standard deviations, beyond which an interval counts as infinite."""


def check_hessian(experiments: Sequence[Experiment], loss: str) -> None:
    """Refuses fits of which the full Hessian cannot be computed.

    Raises
    ------
    ValueError
    """
    if loss != "linear":
        raise ValueError(f"fit: hessian needs loss='linear', and loss is {loss!r}; leave out hessian or loss")
    for e in experiments:
        outputs = e.variables.solver.output_names
        if others := [name for name in e.samples if name not in outputs]:
            raise ValueError(
                f"fit: hessian needs samples of outputs, and {e.name} has samples of {others[0]}; add an output with this value "
                f"to the model, or leave out hessian"
            )
        if unknown := [name for name in e.simulation if name not in (*OF_JUDGE, "method")]:
            raise ValueError(f"fit: {unknown[0]} is not allowed with hessian; leave out one of them")
        check_initial_state(e.variables, e.variables.x0)


def full_hessian(experiments: Sequence[Experiment], x: Array) -> Array:
    """The Hessian (n, n) of half the sum of squares with respect to x, numbers of order one."""
    total = np.zeros((len(x), len(x)))
    for e in experiments:
        v, end = e.variables, float(e.times[-1])
        check_initial_state(v, x[e.places])
        options = {name: value for name, value in e.simulation.items() if name in OF_JUDGE}
        judged = v.solver.judge(
            (e.start, end if end > e.start else end + 1e-3), LeastSquares(e.times, e.samples, e.sigma),
            **v.motion(x[e.places]), wrt=v.names, hessian=np.diag(v.scale), integrator=e.simulation["method"], **options,
        )  # fmt: skip
        total[np.ix_(e.places, e.places)] += judged.hessian_products[0] * v.scale
    return total


def covariance_of(hessian: Array, determined: Array) -> Array:
    """The inverse of a Hessian (n, n) within the span of rows (k, n); NaN if the Hessian is not positive definite in
    this span."""
    within = determined @ hessian @ determined.T
    if not np.isfinite(within).all() or np.linalg.eigvalsh((within + within.T) / 2).min(initial=1.0) <= 0.0:
        return np.full(hessian.shape, np.nan)
    found: Array = determined.T @ np.linalg.solve(within, determined)
    return found


class Profile:
    """The sum of squares as a function of one variable, with all others at their best values.

    Parameters
    ----------
    problem : object
        It has ``at(x)``, which returns residuals (m,) and their Jacobian (m, n).
    x : array (n,)
        The best values, as numbers of order one.
    i : int
        The variable.
    unit : float
        Increase of the sum of squares that counts as one: the variance of the residuals, or 1.
    """

    def __init__(self, problem: Any, x: Array, bounds: tuple[Array, Array], i: int, unit: float):
        self.problem, self.x, self.i, self.unit = problem, x, i, unit
        self.others = np.array([k for k in range(len(x)) if k != i], int)
        self.low, self.high = bounds
        residuals, jacobian = problem.at(x)
        self.least = float(residuals @ residuals)
        # the other variables follow this one as the linear model predicts
        self.along = np.zeros(len(x))
        self.along[i] = 1.0
        if len(self.others):
            self.along[self.others] = -np.linalg.lstsq(jacobian[:, self.others], jacobian[:, i])[0]
        size = float(np.linalg.norm(jacobian @ self.along))
        self.deviation = math.sqrt(unit) / size if size else math.inf
        self.better = False

    def signed_root(self, change: float) -> float:
        """The square root of the increase of the sum of squares over `unit`, with the sign of the change; infinite where a
        motion fails."""
        from scipy.optimize import least_squares

        start = self.x + change * self.along
        start[self.others] = np.clip(start, self.low, self.high)[self.others]
        squares = self._squares(start)
        if len(self.others) and math.isfinite(squares):

            def whole(others: Array) -> Array:
                moved = start.copy()
                moved[self.others] = others
                return moved

            found = least_squares(
                lambda y: self.problem.at(whole(y))[0], start[self.others],
                jac=lambda y: self.problem.at(whole(y))[1][:, self.others],
                bounds=(self.low[self.others], self.high[self.others]), xtol=1e-9, ftol=1e-9, gtol=1e-9,
            )  # fmt: skip
            squares = 2.0 * float(found.cost)
        increase = (squares - self.least) / self.unit
        self.better |= increase < -1e-3
        return math.copysign(math.sqrt(max(increase, 0.0)), change)

    def _squares(self, x: Array) -> float:
        residuals = self.problem.at(x)[0]
        return float(residuals @ residuals)

    def end(self, factor: float, sign: float) -> float:
        """The change of the variable at which the signed root is `sign` times `factor`, or the change to the bound if that
        is nearer."""
        room = float((self.high if sign > 0 else self.low)[self.i] - self.x[self.i])
        near, at_near, far = 0.0, 0.0, math.inf
        change = sign * factor * self.deviation
        for _ in range(TRIALS):
            if abs(change) >= abs(room):
                change = room
            at = abs(self.signed_root(change))
            if abs(at - factor) <= CLOSE * factor or (at < factor and change == room):
                return change
            if at < factor:
                near, at_near = abs(change), at
            else:
                far = abs(change)
            if near > FAR * factor * self.deviation:
                return sign * math.inf
            slope = (at - at_near) / (abs(change) - near) if at > factor else at / abs(change)
            next_change = near + (factor - at_near) / slope if math.isfinite(slope) and slope > 0.0 else math.inf
            inside = near < next_change < far
            if not inside:
                next_change = (near + far) / 2 if math.isfinite(far) else 2.0 * near
            elif not math.isfinite(far):
                next_change = min(next_change, 4.0 * near)
            if far - near <= CLOSE * far:
                break
            change = sign * next_change
        return sign * (near if math.isinf(at) else abs(change))


def profile_interval(
    search: tuple[Any, Array, Any], name: str, i: int, factor: float, unit: float
) -> tuple[float, float]:
    """Ends of an interval in which the sum of squares grows by at most factor**2 units, in the model's unit."""
    problem, x, space = search
    of = Profile(problem, x, space.x_bounds, i, unit)
    ends = [float(space.origin[i] + space.scale[i] * (x[i] + of.end(factor, sign))) for sign in (-1.0, 1.0)]
    if of.better:
        warn(
            f"fit: other values of {name} give a smaller sum of squares, so the search had not found the minimum; "
            f"start fit from other values (p=), or make tolerance smaller"
        )
    return ends[0], ends[1]


__all__ = ["check_hessian", "covariance_of", "full_hessian", "profile_interval"]
