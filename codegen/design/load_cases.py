"""Several motions evaluated together: the weighted sum of objectives of the same variables."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.calls.threads import one_thread
from .objective import Objective, OfVariables
from .outcome import Outcome
from .variables import Variables


class LoadCases(OfVariables):
    """The weighted sum of objectives: one design for several motions, or models; `optimize` takes it like an `Objective`.

    A constraint is one of a case, ``f.cases[0].constraint(...)``: it takes the same x, and no motion of its own.

    Parameters
    ----------
    objectives : sequence of Objective
        One for each case, all of the same variables with the same bounds and scales; a search begins at the start of the first.
    weights : (n,), optional
        Of the cases in the sum; left out: one each.
    threads : int
        Cases that are computed at once, at most.

    Attributes
    ----------
    cases : tuple of Objective
    weights : array (n,)

    Raises
    ------
    ValueError
    """

    def __init__(self, objectives: Sequence[Objective], *, weights: ArrayLike | None = None, threads: int = 1):
        if isinstance(objectives, Objective):
            raise ValueError("load_cases: objectives are a list, such as [ordernm.objective(...), ...]")
        self.cases = tuple(objectives)
        if not self.cases:
            raise ValueError("load_cases: no objective is given, such as ordernm.objective(...)")
        for i, case in enumerate(self.cases):
            if not isinstance(case, Objective):
                raise ValueError(f"load_cases: case {i} is {case!r}, expected what ordernm.objective returns")
        self.variables = self.cases[0].variables
        for i, case in enumerate(self.cases):
            if difference := _difference(self.variables, case.variables):
                raise ValueError(
                    f"load_cases: {difference} of the variables of case {i} are not those of case 0; give all cases the same "
                    f"variables, with the same bounds, or a Variable with start and scale"
                )
        if len(set(map(id, self.cases))) < len(self.cases):
            raise ValueError("load_cases: an objective is given twice; give it a weight instead")
        self.weights = np.ones(len(self.cases)) if weights is None else np.asarray(weights, float)
        if self.weights.shape != (len(self.cases),) or not np.isfinite(self.weights).all():
            raise ValueError(
                f"load_cases: weights are {weights!r}, expected {len(self.cases)} numbers, one for each case"
            )
        if not isinstance(threads, (int, np.integer)) or threads < 1:
            raise ValueError(f"threads is {threads!r}, expected a number of threads")
        self._threads = int(threads)

    def value_and_gradient(self, x: ArrayLike) -> tuple[float, Array]:
        """Both, for ``minimize(f.value_and_gradient, f.x0, jac=True)``; every case remembers its motion at x."""
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

    def error(self, x: ArrayLike) -> Exception:
        """Why a motion at x fails, that of the first case that does.

        Raises
        ------
        ValueError
            None does.
        """
        for case in self.cases:
            if not np.isfinite(case(x)):
                return case.error(x)
        raise ValueError("no motion at this x fails")

    @property
    def motions(self) -> int:
        """How many motions were run."""
        return sum(case.motions for case in self.cases)

    def result(self, x: ArrayLike) -> Outcome:
        """Named values at x, with the sum and its derivatives by them, and the functionals of all cases one after the other."""
        value, gradient = self.value_and_gradient(x)
        several, first = [case.result(x) for case in self.cases], self.cases[0].result(x)
        return Outcome(
            first.names, first.values, first.lower, first.upper, first.units, value, gradient / self.variables.scale,
            tuple(f for r in several for f in r.functionals), np.concatenate([r.functional_values for r in several]),
            self.motions, sum(r.failures for r in several),
        )  # fmt: skip

    def __repr__(self) -> str:
        told = "\n".join(f"  {w:g} times: {case!r}" for w, case in zip(self.weights, self.cases, strict=True))
        return f"{len(self.cases)} load cases\n{told}"


load_cases = LoadCases
"""What makes it."""


def _difference(a: Variables, b: Variables) -> str:
    """What of two sets of variables is not the same; empty where all is."""
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
