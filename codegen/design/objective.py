"""Functionals of a motion as a function with exact gradient, for SciPy's optimisers."""
# long: each of seventeen functions has a docstring with an example

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..html_tables import html_of
from ..runtime.standalone.arrays import Array, Numbers
from ..runtime.standalone.errors import SimulationError
from ..runtime.standalone.motion.functionals import Functional, check_functionals
from ..runtime.standalone.motion.settings import ATOL, METHOD, RTOL
from ..runtime.standalone.trajectory.trajectory import Trajectory
from ..wording import counted
from .constraints import bounds_of, dictionaries, nonlinear
from .curvature import Curvatures
from .evaluated_points import Combine, Evaluation, Point
from .failures import FAILURES
from .given_solver import check_given
from .outcome import Outcome
from .variables import Variables, Wanted

KEPT = 16
"""Number of points whose values and gradients are kept."""


class OfVariables(ABC):
    """A function of an optimiser's x (n,) with its exact gradient.

    Attributes
    ----------
    variables : Variables
        `Variables.values` converts x to the model's units.
    """

    variables: Variables

    @abstractmethod
    def value_and_gradient(self, x: ArrayLike) -> tuple[float, Array]:
        """Return value and gradient, for ``minimize(f.value_and_gradient, f.x0, jac=True)``.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        value : float
            The value; infinite where a motion fails.
        gradient : ndarray (n,)
            Its derivatives with respect to x; NaN where a motion fails.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> value, gradient = f.value_and_gradient(f.x0)
        >>> round(value, 4), gradient.round(4)
        (1.4231, array([0.1759]))
        """

    def __call__(self, x: ArrayLike) -> float:
        """The value at x (n,); infinite where a motion fails."""
        return self.value_and_gradient(x)[0]

    def gradient(self, x: ArrayLike) -> Array:
        """Return the gradient with respect to x.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        ndarray (n,)
            Derivatives of the value with respect to x; NaN where a motion fails.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.gradient(f.x0).round(4)
        array([0.1759])
        """
        return self.value_and_gradient(x)[1]

    @property
    def x0(self) -> Array:
        """Start of a search, (n,)."""
        return self.variables.x0

    @property
    def bounds(self) -> Any:
        """Bounds of x, as `scipy.optimize.Bounds`."""
        from scipy.optimize import Bounds

        return Bounds(*self.variables.x_bounds, keep_feasible=True)

    def values(self, x: ArrayLike) -> dict[str, float]:
        """Return the variables by name.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        dict of str to float
            Values in the model's units.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.values([0.5])
        {'length_1': 1.25}
        """
        return dict(zip(self.variables.names, self.variables.values(x).tolist(), strict=True))


class Objective(OfVariables):
    """A function of design variables, made by `objective`: ``f(x)``, ``f.gradient(x)``, ``f.value_and_gradient(x)``.

    Value, gradient and constraints at one x take one motion.

    Attributes
    ----------
    variables : Variables
        The design variables.
    history : list of Evaluation
        Every motion that was run for a value or gradient.
    """

    def __init__(
        self, solver: Any, span: tuple[float, float], functionals: Functional | Sequence[Functional], variables: Variables, *,
        weights: ArrayLike | None, combine: Combine | None, on_failure: str, options: dict[str, Any],
    ):  # fmt: skip
        self.solver, self.variables = solver, variables
        self.start, self.end = span
        own = check_functionals(functionals, solver.output_names, self.start, self.end)
        if weights is not None and combine is not None:
            raise ValueError("objective: weights and combine are both given; give only one of them")
        by = np.ones(len(own)) if weights is None else np.asarray(weights, float)
        if by.shape != (len(own),):
            raise ValueError(f"weights have shape {by.shape}, expected ({len(own)},): one for each functional")
        if not np.isfinite(by).all():
            raise ValueError(f"weights are {weights!r}, expected finite numbers")
        if combine is not None and not callable(combine):
            raise ValueError(f"combine is {combine!r}, expected a function of the functionals' values")
        if on_failure not in ("inf", "raise"):
            raise ValueError(f"on_failure is {on_failure!r}; allowed are 'inf' and 'raise'")
        self.history: list[Evaluation] = []
        self._functionals, self._options = list(own), options
        self._weights, self._combine, self._on_failure = by, combine, on_failure
        self._known: OrderedDict[bytes, Point] = OrderedDict()
        self._last: Point | None = None
        self._curvatures = Curvatures(solver, variables, self.start, self.end, self._functionals, options)

    # -- functions for optimisers -----------------------------------------------------------------------------------

    def value_and_gradient(self, x: ArrayLike) -> tuple[float, Array]:
        point = self._at(x)
        return point.value, point.gradient.copy()

    def constraint(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> Any:
        """Return the constraint ``lower <= functionals <= upper`` with its exact Jacobian.

        Equal bounds make an equation. Where a motion fails, the constraint has the values of the last motion that did
        not fail, and its Hessian is zero.

        Parameters
        ----------
        functionals : functional or sequence of m functionals
            `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`.
        lower, upper : float or array_like (m,), optional
            Bounds in the units of the functionals. Default: no bound.

        Returns
        -------
        scipy.optimize.NonlinearConstraint
            The constraint, as a function of x.

        Examples
        --------
        >>> from ordernm.runtime import At, Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> constraint = f.constraint(At("tip_z", 0.5), upper=-1.0)
        >>> constraint.fun(f.x0).shape, constraint.jac(f.x0).shape
        ((1,), (1, 1))
        """
        at, low, high = self._constrained(functionals, lower, upper)

        def curvature(x: ArrayLike, v: Array) -> Array:
            if self._at(x).error is not None:
                return np.zeros((at.stop - at.start, len(self.variables)))
            return self._curvatures.products(x, v, range(at.start, at.stop))

        return nonlinear(self._safe, at, low, high, curvature)

    def constraint_dicts(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> list[dict[str, Any]]:
        """Return the constraints of `constraint` as dictionaries for SLSQP.

        Parameters
        ----------
        functionals : functional or sequence of m functionals
            `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`.
        lower, upper : float or array_like (m,), optional
            Bounds in the units of the functionals. Default: no bound.

        Returns
        -------
        list of dict
            Equations (``"eq"``), and inequalities (``"ineq"``) whose function must not be negative.

        Examples
        --------
        >>> from ordernm.runtime import At, Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> [c["type"] for c in f.constraint_dicts(At("tip_z", 0.5), upper=-1.0)]
        ['ineq']
        """
        return dictionaries(self._safe, *self._constrained(functionals, lower, upper))

    def _constrained(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike, upper: ArrayLike
    ) -> tuple[slice, Array, Array]:
        """Functionals evaluated together with the objective: their positions among all functionals, and their bounds
        (m,)."""
        wanted = check_functionals(functionals, self.solver.output_names, self.start, self.end)
        low, high = bounds_of(len(wanted), lower, upper)
        first = len(self._functionals)
        self._functionals += wanted
        self._known.clear()
        return slice(first, first + len(wanted)), low, high

    # -- curvature -----------------------------------------------------------------------------------------------------

    def hessp(self, x: ArrayLike, v: ArrayLike) -> Array:
        """Return the product of the Hessian with a direction, for SciPy's ``trust-krylov``, ``trust-ncg``, ``trust-constr``.

        Exact for the steps of the motion at x. See ``hessian`` of `Solver.judge` for the models that have it. Up to 32
        variables, the whole Hessian is computed once for each x.

        Parameters
        ----------
        x, v : array_like (n,)
            The point and the direction, numbers of order one.

        Returns
        -------
        ndarray (n,)
            The product; NaN where the motion fails.

        Raises
        ------
        ValueError
            If the objective has no exact Hessian.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(pendulum, 1.0, Final("x"), {"length": (0.5, 1.5)})
        >>> f.hessp(f.x0, [1.0]).shape
        (1,)
        """
        if self._combine is not None:
            raise ValueError(
                "objective: combine has no second derivatives; Hessians need weights= instead, or none of the two"
            )
        try:
            found: Array = self._weights @ self._curvatures.products(x, v, range(len(self._weights)))
        except FAILURES:
            if self._on_failure == "raise":
                raise
            return np.full(len(self.variables), np.nan)
        return found

    # -- motions -------------------------------------------------------------------------------------------------------

    def _at(self, x: ArrayLike) -> Point:
        """The evaluated point at x; runs a motion if it is not known yet."""
        x = np.array(x, float)
        key = x.tobytes()
        if key in self._known:
            self._known.move_to_end(key)
            point = self._known[key]
        else:
            began = time.perf_counter()
            point = self._judged(x)
            self._known[key] = point
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
            self.history.append(
                Evaluation(
                    len(self.history) + 1, x, point.value, point.functionals, float(np.abs(point.gradient).max()),
                    time.perf_counter() - began, str(point.error or ""),
                )
            )  # fmt: skip
        if point.error is None:
            self._last = point
        elif self._on_failure == "raise":
            raise point.error
        return point

    def _safe(self, x: ArrayLike) -> Point:
        """The evaluated point for constraints; if the motion fails, with the functionals of the last motion that did not fail."""
        point = self._at(x)
        if point.error is None:
            return point
        if self._last is None or len(self._last.functionals) < len(self._functionals):
            raise point.error
        return self._last

    def _judged(self, x: Array) -> Point:
        v, count = self.variables, len(self._weights)
        try:
            judged = self.solver.judge(
                (self.start, self.end), self._functionals, **v.motion(x), wrt=v.names, **self._options
            )
            if not np.isfinite(judged.values).all():
                raise SimulationError(f"the functionals are not finite: {judged.values}", None)
        except FAILURES as error:
            m, n = len(self._functionals), len(v)
            return Point(math.inf, np.full(n, np.nan), np.full(m, np.nan), np.full((m, n), np.nan), error)
        gradients = judged.gradients * v.scale
        own = judged.values[:count]
        if self._combine is None:
            value, weights = float(self._weights @ own), self._weights
        else:
            combined, derivatives = self._combine(own.copy())
            value, weights = float(combined), np.asarray(derivatives, float)
            if weights.shape != (count,):
                raise ValueError(
                    f"combine gives derivatives of shape {weights.shape}, expected ({count},): one for each functional"
                )
            if math.isnan(value) or np.isnan(weights).any():
                raise ValueError(f"combine gives {value} with the derivatives {weights} of {own}, expected numbers")
        return Point(value, weights @ gradients[:count], judged.values, gradients)

    # -- results and errors -------------------------------------------------------------------------------------------

    @property
    def motions(self) -> int:
        """Number of motions that were run, including those of `hessp`."""
        return len(self.history) + self._curvatures.motions

    @property
    def failures(self) -> list[Evaluation]:
        """Motions that failed, with the reasons."""
        return [e for e in self.history if e.failure]

    def error(self, x: ArrayLike) -> Exception:
        """Return the error with which the motion at x fails.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        Exception
            The error.

        Raises
        ------
        ValueError
            If the motion does not fail.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)}, most_steps=2)
        >>> f(f.x0), type(f.error(f.x0)).__name__
        (inf, 'SimulationError')
        """
        error = self._at(x).error
        if error is None:
            raise ValueError("the motion at this x does not fail")
        return error

    def result(self, x: ArrayLike | None = None) -> Outcome:
        """Return named values, the objective and its derivatives.

        Parameters
        ----------
        x : array_like (n,), optional
            Numbers of order one. Default: the x with the smallest value so far.

        Returns
        -------
        Outcome
            Values in the model's units.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.result([0.5])["length_1"]
        1.25
        """
        x = self.best if x is None else np.asarray(x, float)
        point, v = self._at(x), self.variables
        units = tuple(v.unit(i) for i in range(len(v)))
        return Outcome(
            v.names, v.values(x), v.lower, v.upper, units, point.value, point.gradient / v.scale,
            tuple(self._functionals), point.functionals.copy(), self.motions, len(self.failures),
        )  # fmt: skip

    @property
    def best(self) -> Array:
        """The x (n,) with the smallest value so far, regardless of constraints; `x0` before the first motion."""
        done = [e for e in self.history if not e.failure]
        return min(done, key=lambda e: e.value).x.copy() if done else self.x0

    def simulate(self, x: ArrayLike | None = None, t: Any = None, **more: Any) -> Trajectory:
        """Return the motion at an x.

        Parameters
        ----------
        x : array_like (n,), optional
            Numbers of order one. Default: the x with the smallest value so far.
        t : float or array_like (nt,), optional
            Times of the results, s. Default: 201 equidistant times from the start to the end of the objective's motion.
        **more
            Further arguments of `Solver.simulate`.

        Returns
        -------
        Trajectory
            The motion.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.simulate([0.5], np.linspace(0.0, 1.0, 11)).q.shape
        (11, 2)
        """
        motion = self.variables.motion(self.best if x is None else x, derivatives=False)
        options = {
            name: value for name, value in self._options.items() if name not in ("method", "memory", "integrator")
        }
        options["method"] = self._options["integrator"]
        if t is None:
            t = np.linspace(self.start, self.end, 201)
        found: Trajectory = self.solver.simulate(t, **motion, **{**options, **more})
        return found

    def __repr__(self) -> str:
        n, failed = len(self.variables), len(self.failures)
        lines = [f"Objective of {self.solver.name}: {counted(n, 'variable')}, "
                 f"{counted(len(self._functionals), 'functional')}, "
                 f"from {self.start:g} to {self.end:g} s"]  # fmt: skip
        done = [e for e in self.history if not e.failure]
        best = f", the smallest value {min(e.value for e in done):.9g}" if done else ""
        lines.append(
            f"  {counted(self.motions, 'motion')} run{best}" + (f"; {failed} failed, the last: " if failed else "")
        )
        if failed:
            lines[-1] += self.failures[-1].failure
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        v = self.variables
        rows = zip(v.names, v.start, v.lower, v.upper, strict=True)
        return html_of(repr(self).splitlines(), ("variable", "start", "lower bound", "upper bound"), rows)


def objective(
    solver: Any, t: Any, functionals: Functional | Sequence[Functional], variables: Wanted, *, weights: ArrayLike | None = None,
    combine: Combine | None = None, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None,
    method: str = "auto", integrator: str = METHOD, rtol: float = RTOL, atol: Any = ATOL, on_failure: str = "inf",
    **options: Any,
) -> Objective:  # fmt: skip
    """Make a function of design variables for SciPy's optimisers from functionals of a motion, with exact gradients.

    Parameters
    ----------
    solver : Solver
        The model.
    t : float or tuple of two float
        End of the motion, s, or its start and end.
    functionals : functional or sequence of m functionals
        `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`. The value is their sum by default.
    variables : str, sequence of str, or mapping of str to None, (lower, upper) or Variable
        Parameters; ``q0.NAME`` and ``u0.NAME``, initial values of independent coordinates and speeds;
        ``inputs.NAME[i]``, the i-th value (or control point) of an input; ``inputs.NAME``, all of them.
    weights : array_like (m,), optional
        Weights of the functionals in the sum.
    combine : callable, optional
        Replaces the weights: ``combine(values) -> (value, dvalue/dvalues)`` with arrays (m,).
    q, u, p : array_like or mapping, optional
        Initial state and parameters where no variable determines them, as in `Solver.simulate`. Entries that a mapping
        leaves out have the model's values, which may depend on the variables.
    inputs : array_like, tuple, callable, spline or mapping, optional
        Inputs over time, as in `Solver.simulate`.
    method, integrator : str, optional
        As in `Solver.judge`.
    rtol, atol : float, optional
        Tolerances of a step, as in `Solver.simulate`.
    on_failure : {"inf", "raise"}, optional
        Return an infinite value for a motion that fails, or raise its error. Both record it in the history.
    **options
        Further arguments of `Solver.judge`.

    Returns
    -------
    Objective
        A function of x (n,), numbers of order one.

    See Also
    --------
    optimize : Minimises it.
    load_cases : Sums objectives of several motions.

    Examples
    --------
    >>> from ordernm.runtime import Final
    >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5), "mass_2": (0.5, 2.0)})
    >>> round(f(f.x0), 4), f.gradient(f.x0).round(4)
    (1.4231, array([ 0.1759, -0.1024]))
    """
    # long: the docstring describes every argument
    if integrator == "rk4" and "step" not in options:
        raise ValueError("integrator 'rk4' takes constant steps: give step, s")
    settings = {"method": method, "integrator": integrator, "rtol": rtol, "atol": atol, **options}
    span = _span(t)
    check_given(solver)
    return Objective(
        solver, span, functionals, Variables(solver, variables, q, u, p, inputs, span), weights=weights, combine=combine,
        on_failure=on_failure, options=settings,
    )  # fmt: skip


def _span(t: Any) -> tuple[float, float]:
    """Start and end of a motion, s."""
    try:
        start, end = np.asarray(t, float).reshape(-1) if np.size(t) > 1 else (0.0, float(np.asarray(t, float).item()))
    except (TypeError, ValueError):
        raise ValueError(f"objective: t is {t!r}, expected the motion's end, s, or (start, end)") from None
    if not -math.inf < start < end < math.inf:
        raise ValueError(f"objective: t is {t!r}; the end must be finite, and after the start, {start:g} s")
    return float(start), float(end)


__all__ = ["Evaluation", "Objective", "objective"]
