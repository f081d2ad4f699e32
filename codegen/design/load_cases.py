"""Several motions evaluated together: the weighted sum of objectives of the same variables."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from ..html_tables import html_of
from ..runtime.standalone.arrays import Array
from ..runtime.standalone.calls.threads import one_thread
from .objective import Objective, OfVariables
from .outcome import Outcome
from .variables import Variables


class LoadCases(OfVariables):
    """The weighted sum of objectives: one design for several motions or models.

    `optimize` takes it like an `Objective`. A constraint belongs to one case: ``f.cases[0].constraint(...)``. It takes
    the same x and needs no motion of its own.

    Parameters
    ----------
    objectives : sequence of Objective
        One objective for each case, all of the same variables with the same bounds and scales. A search begins at the
        start of the first objective.
    weights : array_like (n,), optional
        Weights of the cases in the sum. Default: 1.
    threads : int, optional
        Largest number of cases that are computed at once.

    Attributes
    ----------
    cases : tuple of Objective
        The cases.
    weights : ndarray (n,)
        Weights of the cases.

    Raises
    ------
    ValueError
        If the objectives have different variables, or an argument has another shape.

    Examples
    --------
    >>> from ordernm.runtime import Final
    >>> near = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)}, q={"upper": 0.5})
    >>> far = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)}, q={"upper": 1.5})
    >>> f = ordernm.load_cases([near, far], weights=[2.0, 1.0])
    >>> bool(np.isclose(f(f.x0), 2 * near(f.x0) + far(f.x0)))
    True
    """

    def __init__(self, objectives: Sequence[Objective], *, weights: ArrayLike | None = None, threads: int = 1):
        if isinstance(objectives, Objective):
            raise ValueError("load_cases: objectives must be a list, such as [ordernm.objective(...), ...]")
        self.cases = tuple(objectives)
        if not self.cases:
            raise ValueError(
                "load_cases: the list of objectives is empty; give at least one, such as ordernm.objective(...)"
            )
        for i, case in enumerate(self.cases):
            if not isinstance(case, Objective):
                raise ValueError(f"load_cases: case {i} is {case!r}, expected the result of ordernm.objective")
        self.variables = self.cases[0].variables
        for i, case in enumerate(self.cases):
            if difference := _difference(self.variables, case.variables):
                raise ValueError(
                    f"load_cases: the variables of case {i} have other {difference} than those of case 0; give all cases the "
                    f"same variables, with the same bounds, or a Variable with start and scale"
                )
        if len(set(map(id, self.cases))) < len(self.cases):
            raise ValueError("load_cases: an objective is given twice; give it once, with a weight")
        self.weights = np.ones(len(self.cases)) if weights is None else np.asarray(weights, float)
        if self.weights.shape != (len(self.cases),) or not np.isfinite(self.weights).all():
            raise ValueError(
                f"load_cases: weights are {weights!r}, expected {len(self.cases)} numbers, one for each case"
            )
        if not isinstance(threads, (int, np.integer)) or threads < 1:
            raise ValueError(f"threads is {threads!r}, expected a number of threads")
        self._threads = int(threads)

    def value_and_gradient(self, x: ArrayLike) -> tuple[float, Array]:
        x = np.array(x, float)
        if self._threads > 1:
            with ThreadPoolExecutor(min(self._threads, len(self.cases))) as pool:
                found = list(pool.map(one_thread()(lambda case: case.value_and_gradient(x)), self.cases))
        else:
            found = [case.value_and_gradient(x) for case in self.cases]
        values, gradients = (np.array(part) for part in zip(*found, strict=True))
        if not np.isfinite(values).all():
            return float("inf"), np.full(len(self.variables), np.nan)
        return float(self.weights @ values), self.weights @ gradients

    def hessp(self, x: ArrayLike, v: ArrayLike) -> Array:
        """Return the product of the Hessian with a direction, as `Objective.hessp`.

        Parameters
        ----------
        x, v : array_like (n,)
            The point and the direction, numbers of order one.

        Returns
        -------
        ndarray (n,)
            The product; NaN where a motion fails.

        Raises
        ------
        ValueError
            If a case has no exact Hessian.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> case = ordernm.objective(pendulum, 1.0, Final("x"), {"length": (0.5, 1.5)})
        >>> f = ordernm.load_cases([case], weights=[2.0])
        >>> bool(np.allclose(f.hessp(f.x0, [1.0]), 2 * case.hessp(f.x0, [1.0])))
        True
        """
        found: Array = self.weights @ np.array([case.hessp(x, v) for case in self.cases])  # zero times NaN is NaN
        return found

    def error(self, x: ArrayLike) -> Exception:
        """Return the error with which the motion of the first failing case fails.

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
            If no motion fails.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> case = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)}, most_steps=2)
        >>> f = ordernm.load_cases([case])
        >>> type(f.error(f.x0)).__name__
        'SimulationError'
        """
        for case in self.cases:
            if not np.isfinite(case(x)):
                return case.error(x)
        raise ValueError("no motion at this x fails")

    @property
    def motions(self) -> int:
        """Number of motions that were run, including those of `hessp`."""
        return sum(case.motions for case in self.cases)

    def result(self, x: ArrayLike) -> Outcome:
        """Return named values, the weighted sum and its derivatives, and the functionals of all cases.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        Outcome
            Values in the model's units.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> case = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f = ordernm.load_cases([case])
        >>> f.result([0.5])["length_1"]
        1.25
        """
        value, gradient = self.value_and_gradient(x)
        several, first = [case.result(x) for case in self.cases], self.cases[0].result(x)
        return Outcome(
            first.names, first.values, first.lower, first.upper, first.units, value, gradient / self.variables.scale,
            tuple(f for r in several for f in r.functionals), np.concatenate([r.functional_values for r in several]),
            self.motions, sum(r.failures for r in several),
        )  # fmt: skip

    def __repr__(self) -> str:
        cases = "\n".join(f"  {w:g} times: {case!r}" for w, case in zip(self.weights, self.cases, strict=True))
        return f"{len(self.cases)} load cases\n{cases}"

    def _repr_html_(self) -> str:
        rows = ((w, repr(case).splitlines()[0]) for w, case in zip(self.weights, self.cases, strict=True))
        return html_of([f"{len(self.cases)} load cases"], ("weight", "case"), rows)


load_cases = LoadCases
"""The function that makes load cases is the class itself."""


def _difference(a: Variables, b: Variables) -> str:
    """The first difference between two sets of variables, in words; empty if there is none."""
    if a.names != b.names:
        return "names"
    for what, called in {
        "lower": "lower bounds",
        "upper": "upper bounds",
        "scale": "scales",
        "origin": "origins",
    }.items():
        if not np.array_equal(getattr(a, what), getattr(b, what)):
            return called
    return ""


__all__ = ["LoadCases", "load_cases"]
