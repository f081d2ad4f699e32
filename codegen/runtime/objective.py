"""A number that a motion is judged by, as a function that SciPy's optimisers take, with its exact gradient."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .failures import FAILURES
from .outcome import Outcome
from .standalone.arrays import Array, Numbers
from .standalone.errors import SimulationError
from .standalone.functionals import Functional, check_functionals
from .standalone.trajectory import Trajectory
from .variables import Variables, Wanted

KEPT = 16
"""So many points are remembered with their values and gradients."""

Combine = Callable[[Array], tuple[float, ArrayLike]]
"""From values of functionals (m,) to a number and its derivatives by them (m,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """A motion that was run for an optimiser.

    Attributes
    ----------
    number : int
        From 1.
    x : array (n,)
        As the optimiser sees it.
    value : float
        Of the objective; infinite where the motion failed.
    functionals : array (m,)
        Values of functionals, those of constraints behind those of the objective; NaN where the motion failed.
    gradient_norm : float
        The largest entry of the gradient by x.
    seconds : float
    failure : str
        Why the motion failed, empty if it did not.
    """

    number: int
    x: Array
    value: float
    functionals: Array
    gradient_norm: float
    seconds: float
    failure: str


@dataclass(slots=True, eq=False)
class _Point:
    """What is known at an x: value, gradient by x (n,), functionals (m,) and their gradients by x (m, n); or an error."""

    value: float
    gradient: Array
    functionals: Array
    gradients: Array
    error: Exception | None = None


class Objective:
    """``f(x)``, ``f.gradient(x)`` and ``f.value_and_gradient(x)``; made by `objective`.

    Value and gradient at one x take one motion, and so do constraints, which are judged along with it. An optimiser's x are
    numbers of order one; `Variables.values` says what they are in the model's units.

    Attributes
    ----------
    variables : Variables
    history : list of Evaluation
        Of every motion that was run.
    """

    def __init__(
        self, solver: Any, t: Any, functionals: Functional | Sequence[Functional], variables: Variables, *,
        weights: ArrayLike | None, combine: Combine | None, on_failure: str, options: dict[str, Any],
    ):  # fmt: skip
        self.solver, self.variables, self.history = solver, variables, list[Evaluation]()
        ends = np.atleast_1d(np.asarray(t, float))
        self.start, self.end = (0.0, float(ends[0])) if len(ends) == 1 else (float(ends[0]), float(ends[-1]))
        self._functionals = check_functionals(functionals, solver.output_names, self.start, self.end)
        self._count = len(self._functionals)
        if weights is not None and combine is not None:
            raise ValueError("objective: both weights and combine are given; give one of them")
        self._weights = np.ones(self._count) if weights is None else np.asarray(weights, float)
        if self._weights.shape != (self._count,):
            raise ValueError(
                f"weights have shape {self._weights.shape}, expected ({self._count},): one for each functional"
            )
        if on_failure not in ("inf", "raise"):
            raise ValueError(f"on_failure is {on_failure!r}; allowed are 'inf' and 'raise'")
        self._combine, self._on_failure, self._options = combine, on_failure, options
        self._known: OrderedDict[bytes, _Point] = OrderedDict()
        self._last: _Point | None = None

    # -- what an optimiser asks ----------------------------------------------------------------------------------------

    def __call__(self, x: ArrayLike) -> float:
        """The objective at x (n,)."""
        return self._at(x).value

    def gradient(self, x: ArrayLike) -> Array:
        """Its gradient by x, (n,); NaN where the motion fails."""
        return self._at(x).gradient.copy()

    def value_and_gradient(self, x: ArrayLike) -> tuple[float, Array]:
        """Both, for ``minimize(f.value_and_gradient, f.x0, jac=True)``."""
        point = self._at(x)
        return point.value, point.gradient.copy()

    @property
    def x0(self) -> Array:
        """Where to begin, (n,)."""
        return self.variables.x0

    @property
    def bounds(self) -> Any:
        """Of x, as `scipy.optimize.Bounds`."""
        from scipy.optimize import Bounds

        return Bounds(*self.variables.x_bounds, keep_feasible=True)

    def constraint(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> Any:
        """A `scipy.optimize.NonlinearConstraint`, lower <= functionals <= upper, in their units, with its exact Jacobian.

        Equal bounds make an equation. Where a motion fails the constraint has the values of the last that did not: the
        objective says there that it is no good.

        Parameters
        ----------
        functionals : one or m of `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`
        lower, upper : float or (m,)
        """
        from scipy.optimize import NonlinearConstraint

        at, low, high = self._constrained(functionals, lower, upper)
        return NonlinearConstraint(
            lambda x: self._safe(x).functionals[at].copy(), low, high, jac=lambda x: self._safe(x).gradients[at].copy()
        )

    def constraint_dicts(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> list[dict[str, Any]]:
        """The same as dictionaries of SLSQP's: equations, and inequalities that are to be positive."""
        at, low, high = self._constrained(functionals, lower, upper)
        places = np.arange(at.start, at.stop)
        found = []
        for kind, chosen, sign, level in (
            ("eq", low == high, 1.0, low),
            ("ineq", (low != high) & np.isfinite(low), 1.0, low),
            ("ineq", (low != high) & np.isfinite(high), -1.0, high),
        ):
            if chosen.any():
                found.append(self._dictionary(kind, places[chosen], sign, level[chosen]))
        return found

    def _dictionary(self, kind: str, places: Any, sign: float, level: Array) -> dict[str, Any]:
        return {
            "type": kind,
            "fun": lambda x: sign * (self._safe(x).functionals[places] - level),
            "jac": lambda x: sign * self._safe(x).gradients[places],
        }

    def _constrained(
        self, functionals: Functional | Sequence[Functional], lower: ArrayLike, upper: ArrayLike
    ) -> tuple[slice, Array, Array]:
        """Functionals that are judged along with the objective, where they stand among all, and their bounds (m,)."""
        wanted = check_functionals(functionals, self.solver.output_names, self.start, self.end)
        try:
            low, high = (np.broadcast_to(np.asarray(b, float), (len(wanted),)).copy() for b in (lower, upper))
        except ValueError:
            raise ValueError(f"constraint: {len(wanted)} functionals, and bounds {lower!r} and {upper!r}") from None
        if np.isnan([low, high]).any() or (low > high).any() or np.isinf([low, high]).all(axis=0).any():
            raise ValueError(
                f"constraint: bounds are {lower!r} and {upper!r}; lower must not be above upper, one be finite"
            )
        first = len(self._functionals)
        self._functionals = [*self._functionals, *wanted]
        self._known.clear()
        return slice(first, first + len(wanted)), low, high

    # -- what a person asks --------------------------------------------------------------------------------------------

    @property
    def motions(self) -> int:
        """How many motions were run."""
        return len(self.history)

    @property
    def failures(self) -> list[Evaluation]:
        """Motions that failed, with why."""
        return [e for e in self.history if e.failure]

    def error(self, x: ArrayLike) -> Exception:
        """Why the motion at x fails.

        Raises
        ------
        ValueError
            It does not.
        """
        error = self._at(x).error
        if error is None:
            raise ValueError("the motion at this x does not fail")
        return error

    def values(self, x: ArrayLike) -> dict[str, float]:
        """Variables by name, in the model's units."""
        return dict(zip(self.variables.names, self.variables.values(x).tolist(), strict=True))

    def result(self, x: ArrayLike | None = None) -> Outcome:
        """Named values at x, or at the best that was seen, with the objective and its derivatives by them."""
        x = self.best if x is None else np.asarray(x, float)
        point, v = self._at(x), self.variables
        units = tuple(v.unit(i) for i in range(len(v)))
        return Outcome(
            v.names, v.values(x), v.lower, v.upper, units, point.value, point.gradient / v.scale,
            tuple(self._functionals), point.functionals.copy(), self.motions, len(self.failures),
        )  # fmt: skip

    @property
    def best(self) -> Array:
        """The x (n,) with the smallest value so far, whatever constraints say; `x0` before the first motion."""
        done = [e for e in self.history if not e.failure]
        return min(done, key=lambda e: e.value).x.copy() if done else self.x0

    def simulate(self, x: ArrayLike | None = None, t: Any = None, **more: Any) -> Trajectory:
        """The motion at x, or at the best that was seen; t and further arguments as those of `Solver.simulate`."""
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
        lines = [f"Objective of {self.solver.name}: {n} variables, {len(self._functionals)} functionals, "
                 f"from {self.start:g} to {self.end:g} s"]  # fmt: skip
        done = [e for e in self.history if not e.failure]
        best = f", the smallest value {min(e.value for e in done):.9g}" if done else ""
        lines.append(f"  {self.motions} motions run{best}" + (f"; {failed} failed, the last: " if failed else ""))
        if failed:
            lines[-1] += self.failures[-1].failure
        return "\n".join(lines)

    # -- one motion ----------------------------------------------------------------------------------------------------

    def _at(self, x: ArrayLike) -> _Point:
        """What is known at x, found by a motion if it is not known yet."""
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

    def _safe(self, x: ArrayLike) -> _Point:
        """The same for constraints, of which there must be values."""
        point = self._at(x)
        if point.error is None:
            return point
        if self._last is None or len(self._last.functionals) < len(self._functionals):
            raise point.error
        return self._last

    def _judged(self, x: Array) -> _Point:
        v = self.variables
        try:
            judged = self.solver.judge(
                (self.start, self.end), self._functionals, **v.motion(x), wrt=v.names, **self._options
            )
            if not np.isfinite(judged.values).all():
                raise SimulationError(f"functionals are {judged.values}, which is not finite", None)
        except FAILURES as error:
            m, n = len(self._functionals), len(v)
            return _Point(math.inf, np.full(n, np.nan), np.full(m, np.nan), np.full((m, n), np.nan), error)
        gradients = judged.gradients * v.scale
        own = judged.values[: self._count]
        if self._combine is None:
            value, weights = float(self._weights @ own), self._weights
        else:
            combined, derivatives = self._combine(own.copy())
            value, weights = float(combined), np.asarray(derivatives, float)
            if weights.shape != (self._count,):
                raise ValueError(
                    f"combine gives derivatives of shape {weights.shape}, expected ({self._count},): by each functional"
                )
        return _Point(value, weights @ gradients[: self._count], judged.values, gradients)


def objective(
    solver: Any, t: Any, functionals: Functional | Sequence[Functional], variables: Wanted, *, weights: ArrayLike | None = None,
    combine: Combine | None = None, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None,
    method: str = "auto", integrator: str = "dop853", rtol: float = 1e-9, atol: Any = 1e-9, on_failure: str = "inf",
    **options: Any,
) -> Objective:  # fmt: skip
    """A function of design variables for SciPy's optimisers: functionals of a motion, with exact gradients.

    Parameters
    ----------
    solver : Solver
    t : float, or (start, end)
        The motion's end, s, or both ends.
    functionals : one or m of `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`
        The objective is their sum, if nothing else is said.
    variables : names, or mapping of names to None, (lower, upper) or `Variable`
        Parameters; ``q0.NAME`` and ``u0.NAME``, initial values of independent coordinates and speeds; ``inputs.NAME[i]``, a
        value (or control point) of an input, ``inputs.NAME`` all of them.
    weights : (m,), optional
        Of the functionals in the sum.
    combine : callable, optional
        Instead of weights: ``combine(values) -> (value, dvalue/dvalues)``, arrays (m,).
    q, u, p, inputs
        The motion as it is where variables say nothing, see `Solver.simulate`; mappings give some entries by name, the others
        are the model's, which may depend on the variables.
    method, integrator, rtol, atol, options
        As those of `Solver.judge`.
    on_failure : {"inf", "raise"}
        What becomes of a motion that fails: an infinite value, or its error. Both are in the history.

    Returns
    -------
    Objective
    """
    if integrator == "rk4" and "step" not in options:
        raise ValueError("integrator 'rk4' takes constant steps: give step, s")
    settings = {"method": method, "integrator": integrator, "rtol": rtol, "atol": atol, **options}
    return Objective(
        solver, t, functionals, Variables(solver, variables, q, u, p, inputs), weights=weights, combine=combine,
        on_failure=on_failure, options=settings,
    )  # fmt: skip


__all__ = ["Evaluation", "Objective", "objective"]
