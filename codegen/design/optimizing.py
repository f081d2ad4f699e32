"""SciPy's optimisers on an objective, with a start inside the bounds and steps back from failing motions."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from ..terminal import working
from .constraints import with_exact_hessian
from .load_cases import LoadCases
from .objective import Objective

NEWTON = ("trust-krylov", "trust-ncg")
"""Methods of `scipy.optimize.minimize` that take Hessian products, without bounds and constraints."""

METHODS = ("L-BFGS-B", "SLSQP", "trust-constr", *NEWTON)
"""Methods of `scipy.optimize.minimize`. The first three take gradients and bounds; the first takes no constraints."""

INSIDE = 1e-6
"""Least distance of the start of trust-constr from the bounds, in an optimiser's x."""

ROUNDING = 1e-9
"""A start farther than this outside the bounds, in an optimiser's x, is refused."""

STUCK = ("ABNORMAL", "Positive directional derivative")
"""Parts of SciPy's messages for a line search that finds no lower value."""

STEP_BACK = 10.0
"""A failing motion gets a value that exceeds the largest one so far by this factor times the range or size of all values."""


def optimize(
    objective: Objective | LoadCases, method: str | None = None, *, constraints: Any = (), x0: ArrayLike | None = None,
    tol: float | None = None, callback: Any = None, hessian: bool = False, **options: Any,
) -> Any:  # fmt: skip
    """Minimise an `Objective` or `LoadCases` with `scipy.optimize.minimize`.

    A motion that fails counts as a large finite value with the gradient zero, so that line searches step back from it.

    Parameters
    ----------
    objective : Objective or LoadCases
        The function.
    method : {"L-BFGS-B", "SLSQP", "trust-constr", "trust-krylov", "trust-ncg"}, optional
        SciPy's method. Default: SLSQP with constraints, else L-BFGS-B. The last two are Newton's method with exact
        Hessian products; they take neither bounds nor constraints.
    constraints : constraint or sequence of constraints, optional
        Results of `Objective.constraint` or `Objective.constraint_dicts`, or SciPy's own constraints.
    x0 : array_like (n,), optional
        Start, as numbers of order one. Default: the start of the variables.
    tol : float, optional
        As in `scipy.optimize.minimize`.
    callback : callable, optional
        As in `scipy.optimize.minimize`.
    hessian : bool, optional
        Give trust-constr exact Hessians of the objective and of its constraints, instead of SciPy's approximations.
    **options
        Options of the method, such as ``maxiter=50``.

    Returns
    -------
    scipy.optimize.OptimizeResult
        The result, with ``outcome``, the `Outcome` at its x.

    Raises
    ------
    SimulationError, AssemblyError, SingularJointError
        If the motion fails at the start.

    Examples
    --------
    >>> from ordernm.runtime import At
    >>> f = ordernm.objective(solver, 0.5, At("tip_z", 0.5), {"length_1": (0.5, 1.5)})
    >>> found = ordernm.optimize(f)
    >>> found.success, round(found.outcome["length_1"], 3)
    (True, 1.5)
    """
    # long: the docstring describes every argument
    from scipy.optimize import minimize

    if not isinstance(objective, (Objective, LoadCases)):
        raise ValueError(
            f"optimize: {objective!r} is not an objective; give the result of ordernm.objective or load_cases"
        )
    if isinstance(constraints, Sequence):
        constraints = [c for several in constraints for c in (several if isinstance(several, list) else [several])]
    else:
        constraints = [constraints]
    method = method or ("SLSQP" if constraints else "L-BFGS-B")
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; allowed are {', '.join(map(repr, METHODS))}")
    if method == "L-BFGS-B" and constraints:
        raise ValueError("method 'L-BFGS-B' does not take constraints; use 'SLSQP' or 'trust-constr'")
    if hessian and method != "trust-constr":
        raise ValueError(f"hessian is for method 'trust-constr', and method is {method!r}; leave hessian out")
    more: dict[str, Any] = {"bounds": objective.bounds, "constraints": constraints}
    if method in NEWTON:
        _check_newton(objective, method, constraints)
        more = {}
    if hessian:
        more["constraints"] = [with_exact_hessian(c) for c in constraints]
    start = _start(objective, method, x0)
    judged = _SteppingBack(objective, start)
    if hessian or method in NEWTON:
        more["hessp"] = judged.hessp
    # a callback or SciPy may print, and a status line would disturb this
    prints = callback is not None or any(options.get(word) for word in ("disp", "iprint", "verbose"))
    with contextlib.nullcontext() if prints else working("optimizing"):
        result = minimize(
            judged, start, jac=True, method=method, tol=tol, callback=callback, options=options, **more
        )  # fmt: skip
    result.outcome = objective.result(result.x)
    if not result.success and any(word in str(result.message) for word in STUCK):
        result.message = (
            f"{result.message}; {_why_stuck(objective, result, max(judged.high - judged.low, abs(float(result.fun))))}"
        )
    return result


def _check_newton(objective: Objective | LoadCases, method: str, constraints: Sequence[Any]) -> None:
    """Refuse bounds and constraints, which SciPy's Newton methods would ignore."""
    v = objective.variables
    if constraints:
        raise ValueError(f"method {method!r} does not take constraints; use 'trust-constr' with hessian=True")
    bounded = [n for n, low, high in zip(v.names, v.lower, v.upper, strict=True) if low > -math.inf or high < math.inf]
    if bounded:
        raise ValueError(
            f"method {method!r} does not take bounds, and {bounded[0]} has bounds; give its variable as "
            f"{{{bounded[0]!r}: None}}, or use 'trust-constr' with hessian=True"
        )


def _start(objective: Objective | LoadCases, method: str, x0: ArrayLike | None) -> Array:
    """The start of a search, moved inside the bounds."""
    v = objective.variables
    start = v.x0 if x0 is None else np.asarray(x0, float)
    values, (lower, upper) = v.values(start), v.x_bounds
    for i in np.flatnonzero((start < lower - ROUNDING) | (start > upper + ROUNDING)):
        raise ValueError(
            f"optimize: x0 has {v.names[i]} = {values[i]:g}, outside of its bounds {v.lower[i]:g} and {v.upper[i]:g}"
        )
    inside = INSIDE if method == "trust-constr" else 0.0  # the start of trust-constr must not be at a bound
    return np.clip(start, lower + inside, upper - inside)


class _SteppingBack:
    """An objective for line searches: if a motion fails, the value is large and finite, and its derivatives are zero.

    Raises
    ------
    SimulationError, AssemblyError, SingularJointError
        If the motion fails at the start.
    """

    def __init__(self, objective: Objective | LoadCases, start: Array):
        self.objective = objective
        self.low = self.high = objective(start)
        self._far: dict[bytes, float] = {}
        if not math.isfinite(self.high):
            raise objective.error(start)

    def __call__(self, x: Array) -> tuple[float, Array]:
        value, gradient = self.objective.value_and_gradient(x)
        if math.isfinite(value):
            self.low, self.high = min(self.low, value), max(self.high, value)
            return value, gradient
        far = self.high + STEP_BACK * max(self.high - self.low, abs(self.high), 1e-3)
        return self._far.setdefault(np.asarray(x).tobytes(), far), np.zeros_like(gradient)

    def hessp(self, x: Array, v: Array) -> Array:
        """The product of the Hessian with a direction; zeros if a motion fails."""
        if not math.isfinite(self.objective(x)):
            return np.zeros(len(x))
        product = self.objective.hessp(x, v)
        if not np.isfinite(product).all():
            raise ValueError(
                "optimize: the objective has no finite second derivatives at an x of the search; this method "
                "needs finite Hessian products. Use method 'L-BFGS-B' or 'SLSQP', which need none"
            )
        return product


def _why_stuck(objective: Objective | LoadCases, result: Any, size: float) -> str:
    """The explanation for a line search that finds no lower value."""
    lower, upper = objective.variables.x_bounds
    x, gradient = np.asarray(result.x), objective.value_and_gradient(result.x)[1]
    free = np.clip(x - gradient, lower, upper) - x
    slope = float(np.abs(free).max(initial=0.0))
    return (
        f"the line search finds no lower value along a gradient of {slope:.1e} (with respect to variables of order one; the "
        f"objective has the size {size:.1e}). Close to an optimum, integration errors have this effect: use these values, or "
        f"make rtol and atol of the objective smaller and start here (x0=result.x)"
    )


__all__ = ["METHODS", "optimize"]
