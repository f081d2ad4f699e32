"""Inputs over time: constant, held, joined by lines, or a cubic spline, each a sum of B-splines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arguments import some
from .arrays import Array

DEGREES = {"hold": 0, "linear": 1, "spline": 3}
"""Of the B-splines, by what a caller names them."""


@dataclass(slots=True)
class Inputs:
    """Inputs over time: a B-spline, or constant numbers.

    Attributes
    ----------
    degree : int
    knots : array (count + degree + 1,) or None
        None for constant inputs, of which count is 1.
    values : array (count, ninputs)
        Control points: of degree 0 and 1 the values themselves.
    """

    degree: int
    knots: Array | None
    values: Array

    def at(self, t: float) -> Array:
        """Inputs (ninputs,) at a time; outside of the knots as at the first and the last of them."""
        if self.knots is None:
            return self.values[0]
        first, weights = self.weights(t)
        found: Array = weights @ self.values[first : first + len(weights)]
        return found

    def rate(self, t: float) -> Array:
        """Their time derivatives (ninputs,)."""
        k = self.degree
        if self.knots is None or not k or not self.knots[k] <= t <= self.knots[-1 - k]:
            return np.zeros(self.values.shape[1])
        span = self.knots[k + 1 : -1] - self.knots[1 : -k - 1]
        steps = k * np.diff(self.values, axis=0) / span[:, None]
        return Inputs(k - 1, self.knots[1:-1], steps).at(t)

    def weights(self, t: float) -> tuple[int, Array]:
        """The B-splines that are not zero at a time: the number of the first, and their values (C. de Boor's recursion)."""
        if self.knots is None:
            return 0, np.ones(1)
        k, n, knots = self.degree, len(self.values), self.knots
        x = min(max(t, knots[k]), knots[n])
        at = int(min(max(np.searchsorted(knots, x, "right") - 1, k), n - 1))
        value = np.ones(1)
        for j in range(1, k + 1):
            new = np.zeros(j + 1)
            for i in range(j):
                left, right = knots[at + 1 - j + i], knots[at + 1 + i]
                part = value[i] / (right - left)
                new[i] += (right - x) * part
                new[i + 1] += (x - left) * part
            value = new
        return at - k, value


def take_inputs(names: Sequence[str], given: Any) -> Inputs:
    """Inputs of a motion as a caller gives them, checked.

    Raises
    ------
    ValueError
    """
    n = len(names)
    if given is None:
        return Inputs(0, None, np.zeros((1, n)))
    if isinstance(given, Inputs):
        return given
    if isinstance(given, tuple) and len(given) in (2, 3) and np.ndim(given[0]) == 1 and not isinstance(given[0], str):
        return _over_time(names, *given)
    if isinstance(given, Mapping):
        unknown = [k for k in given if k not in names]
        if unknown:
            raise ValueError(f"inputs: {unknown[0]!r} is not known; expected is any of {some(names)}")
        given = [given.get(k, 0.0) for k in names]
    values = _numbers("inputs", given)
    if values.shape != (n,):
        raise ValueError(
            f"inputs have shape {values.shape}, expected ({n},): one number for each of {some(names)}; or (times, values), or "
            f"(times, values, 'hold' | 'linear' | 'spline')"
        )
    return Inputs(0, None, values[None])


def _over_time(names: Sequence[str], times: Any, values: Any, between: str = "linear") -> Inputs:
    if between not in DEGREES:
        raise ValueError(f"inputs are to be joined by {between!r}; allowed are {', '.join(map(repr, DEGREES))}")
    degree = DEGREES[between]
    t, x = _numbers("times of inputs", times), _numbers("values of inputs", values)
    if x.ndim == 1 and len(names) == 1:
        x = x[:, None]
    if t.ndim != 1 or (np.diff(t) <= 0).any() or len(t) < 1 + (degree > 0):
        raise ValueError(f"times of inputs: they must rise, and {1 + (degree > 0)} are needed at least")
    count = len(t) + 2 if degree == 3 else len(t)
    if x.shape != (count, len(names)):
        what = "control points, two more than times" if degree == 3 else "values, one row for each time"
        raise ValueError(f"values of inputs have shape {x.shape}, expected ({count}, {len(names)}): {what}")
    # the first and the last knot as often as the spline is to end at its first and last control point
    before, after = [t[0]] * degree, [t[-1]] * degree if degree else [np.inf]
    return Inputs(degree, np.array([*before, *t, *after], float), np.ascontiguousarray(x))


def _numbers(name: str, given: Any) -> Array:
    try:
        found = np.asarray(given, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}; expected real numbers") from None
    if not np.isfinite(found).all():
        raise ValueError(f"{name} has entries that are not finite, expected finite numbers")
    return found
