"""Motions that are run and judged for an optimiser: the last points with their values and gradients, and the history of all."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.errors import SimulationError
from ..runtime.standalone.motion.functionals import Functional
from .failures import FAILURES
from .variables import Variables

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
class Point:
    """What is known at an x: value, gradient by x (n,), functionals (m,) and their gradients by x (m, n); or an error."""

    value: float
    gradient: Array
    functionals: Array
    gradients: Array
    error: Exception | None = None


class EvaluatedPoints:
    """Runs and judges a motion where nothing is known yet.

    Parameters
    ----------
    solver, variables
    span : (start, end)
        Of the motion, s.
    functionals : list of Functional
        Those of the objective; further ones may be added, and are judged along with it.
    weights : (m,)
    combine : callable or None
        In place of the weights.
    on_failure : {"inf", "raise"}
    options : dict
        Further arguments of `Solver.judge`.
    """

    def __init__(
        self, solver: Any, variables: Variables, span: tuple[float, float], functionals: Sequence[Functional], *,
        weights: Array, combine: Combine | None, on_failure: str, options: dict[str, Any],
    ):  # fmt: skip
        self.solver, self.variables, self.span, self.options = solver, variables, span, options
        self.functionals, self.history = list(functionals), list[Evaluation]()
        self._weights, self._combine, self._on_failure = weights, combine, on_failure
        self._known: OrderedDict[bytes, Point] = OrderedDict()
        self._last: Point | None = None

    def judge_also(self, wanted: Sequence[Functional]) -> slice:
        """Where further functionals will stand among all."""
        first = len(self.functionals)
        self.functionals += wanted
        self._known.clear()
        return slice(first, first + len(wanted))

    def at(self, x: ArrayLike) -> Point:
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

    def safe(self, x: ArrayLike) -> Point:
        """The same for constraints, of which there must be values: where a motion fails, those of the last that did not."""
        point = self.at(x)
        if point.error is None:
            return point
        if self._last is None or len(self._last.functionals) < len(self.functionals):
            raise point.error
        return self._last

    def _judged(self, x: Array) -> Point:
        v, count = self.variables, len(self._weights)
        try:
            judged = self.solver.judge(self.span, self.functionals, **v.motion(x), wrt=v.names, **self.options)
            if not np.isfinite(judged.values).all():
                raise SimulationError(f"functionals are {judged.values}, which is not finite", None)
        except FAILURES as error:
            m, n = len(self.functionals), len(v)
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
                    f"combine gives derivatives of shape {weights.shape}, expected ({count},): by each functional"
                )
        return Point(value, weights @ gradients[:count], judged.values, gradients)


__all__ = ["Combine", "EvaluatedPoints", "Evaluation", "Point"]
