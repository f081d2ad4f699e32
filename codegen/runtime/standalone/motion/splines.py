"""B-splines: values, derivatives, interpolation, and change of knots and degree (C. de Boor's algorithms)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array

MOST_DEGREE = 9
"""Highest degree of a spline; equal to the limit in ``motion.h``."""


def spline_weights(
    knots: Array, degree: int, count: int, t: Array | float, order: int = 0, before: bool = False,
    within: Array | None = None,
) -> tuple[Any, Array]:  # fmt: skip
    """The index of the first B-spline that is not zero at each time; and the values (*t.shape, degree + 1) of these
    B-splines, or of their derivatives.

    Outside the knots, the values at the first or last knot apply. At a knot, values are those from the right; with
    `before`, those from the left; with `within`, those of the pieces that contain these times. Derivatives are differences
    of splines of lower degree.
    """
    x = np.minimum(np.maximum(t, knots[degree]), knots[count])
    at = piece(knots, degree, count, x if within is None else np.clip(within, knots[degree], knots[count]), before)
    if order > degree:
        return at - degree, np.zeros((*np.shape(t), degree + 1))
    value = [np.ones(np.shape(t))]
    for j in range(1, degree + 1):
        new, differs = [np.zeros(np.shape(t)) for _ in range(j + 1)], j > degree - order
        for i in range(j):
            left, right = knots[at + 1 - j + i], knots[at + 1 + i]
            part = value[i] / (right - left)
            new[i] = new[i] + (-j * part if differs else (right - x) * part)
            new[i + 1] = new[i + 1] + (j * part if differs else (x - left) * part)
        value = new
    return at - degree, np.stack(value, axis=-1)


def piece(knots: Array, degree: int, count: int, t: Array | float, before: bool = False) -> Any:
    """Indices, of the shape of t, of the knots at which the pieces that contain t start."""
    at = np.searchsorted(knots, t, "left" if before else "right") - 1
    at = np.minimum(np.maximum(at, degree), count - 1)
    while (empty := knots[at] == knots[at + 1]).any():  # skip pieces of zero length at the ends
        at = at + empty * np.where(knots[at] <= knots[degree], 1, -1)
    return at


def spline_values(
    knots: Array, degree: int, control: Array, t: Array | float, order: int = 0, before: bool = False,
    within: Array | None = None,
) -> Array:  # fmt: skip
    """Values (*t.shape, m) of splines with control points (count, m), or derivatives; see `spline_weights`."""
    first, weights = spline_weights(knots, degree, len(control), t, order, before, within)
    found = np.zeros((*np.shape(t), control.shape[1]))
    for i in range(degree + 1):
        found += weights[..., i, None] * control[first + i]
    return found


# -- interpolation ---------------------------------------------------------------------------------------------------


def knots_through(t: Array, degree: int) -> tuple[int, Array]:
    """Degree (at most `degree`) and knots of the interpolating spline, with not-a-knot end conditions."""
    degree = min(degree, len(t) - 1)
    inner = t[(degree + 1) // 2 : len(t) - (degree + 1) // 2]
    if degree % 2 == 0:  # for an even degree, knots are midpoints
        inner = 0.5 * (t[degree // 2 : len(t) - degree // 2 - 1] + t[degree // 2 + 1 : len(t) - degree // 2])
    return degree, np.concatenate([[t[0]] * (degree + 1), inner, [t[-1]] * (degree + 1)])


@dataclass(frozen=True)
class Through:
    """Maps values at times, (n,) or (n, m), to control points of the interpolating spline.

    The matrix is banded and totally positive, so elimination needs no pivoting.
    """

    knots: Array
    degree: int
    t: Array

    def __call__(self, values: Array) -> Array:
        n, k = len(self.t), self.degree
        band = np.zeros((n, 2 * k + 1))  # row i contains columns i - k to i + k
        first, weights = spline_weights(self.knots, k, n, self.t)
        rows = np.arange(n)
        for i in range(k + 1):
            band[rows, first - rows + k + i] = weights[:, i]
        x = np.array(values, float)
        for i in range(n):
            for j in range(i + 1, min(i + k + 1, n)):
                at = i - j + k
                if band[j, at]:
                    factor = band[j, at] / band[i, k]
                    band[j, at : at + k + 1] -= factor * band[i, k:]
                    x[j] -= factor * x[i]
        for i in reversed(range(n)):
            width = min(k, n - 1 - i)
            x[i] = (x[i] - band[i, k + 1 : k + 1 + width] @ x[i + 1 : i + 1 + width]) / band[i, k]
        return x


# -- change of knots and degree --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rewritten:
    """Maps the control points (n,) of a spline to its control points for other knots and the same or a higher degree.

    For the new degree D, control point i is the polar form of a piece, evaluated at the new knots i + 1 to i + D. If the
    piece has degree d < D, the polar form with D arguments is the mean over all choices of d of them (L. Ramshaw).
    """

    knots: Array
    degree: int
    onto: Array
    onto_degree: int

    def __call__(self, values: Array) -> Array:
        n, k, degree = len(values), self.degree, self.onto_degree
        first, last = self.knots[k], self.knots[n]
        found = np.empty(len(self.onto) - degree - 1)
        for i in range(len(found)):
            own = self.onto[i : i + degree + 2]
            longest = int(np.argmax(np.diff(own)))  # choose a piece on which this B-spline is not zero
            middle = 0.5 * (own[longest] + own[longest + 1])
            if not first <= middle <= last:
                found[i] = self._end(values, middle < first)
                continue
            at = int(piece(self.knots, k, n, middle))
            sets = list(itertools.combinations(own[1:-1].tolist(), k))
            found[i] = sum(self._polar(values, at, s) for s in sets) / len(sets)
        return found

    def _end(self, values: Array, is_first: bool) -> float:
        """The constant value before the first or after the last knot."""
        n, k = len(values), self.degree
        t = float(self.knots[k if is_first else n])
        return float(spline_values(self.knots, k, values[:, None], t, before=not is_first)[0])

    def _polar(self, values: Array, at: int, arguments: tuple[float, ...]) -> float:
        k, t = self.degree, self.knots
        d = values[at - k : at + 1].tolist()
        for r, u in enumerate(arguments, 1):
            for j in range(k, r - 1, -1):
                left, right = t[at - k + j], t[at + 1 + j - r]
                d[j] = ((right - u) * d[j - 1] + (u - left) * d[j]) / (right - left)
        return float(d[k])


def pieces(x: Array, c: Array) -> tuple[int, Array, Array]:
    """B-spline of a piecewise polynomial: degree, knots and control points (count, m).

    ``c[j, i]`` is the coefficient of ``(x - x_i)^(k - j)`` in piece i.
    """
    k = len(c) - 1
    knots = np.repeat(x, k + 1)
    h = np.diff(x)[:, None]
    values = np.zeros((k + 1, len(x) - 1, c.shape[2]))
    binomial = np.ones(1)
    for _ in range(k):
        binomial = np.convolve(binomial, [1.0, 1.0])
    for i in range(k + 1):  # Bernstein control point i of t^m is (i choose m)/(k choose m)
        chosen = 1.0
        for m in range(i + 1):
            values[i] += chosen / binomial[m] * h**m * c[k - m]
            chosen = chosen * (i - m) / (m + 1)
    return k, knots, values.transpose(1, 0, 2).reshape(-1, c.shape[2])


def common_knots(splines: list[tuple[int, Array]]) -> tuple[int, Array]:
    """Degree and knots with which all given splines, each constant outside its own knots, can be written."""
    degree = max(k for k, _ in splines)
    first, last = min(t[k] for k, t in splines), max(t[-1 - k] for k, t in splines)
    needed: dict[float, int] = {}
    for k, t in splines:
        start, end = t[k], t[-1 - k]
        places, often = np.unique(t[(t > start) & (t < end)], return_counts=True)
        several = [(x, degree - k + n) for x, n in zip(places.tolist(), often.tolist(), strict=True)]
        several += [(float(x), degree) for x in (start, end)]  # at its ends a spline is only continuous
        for x, n in several:
            needed[x] = max(needed.get(x, 0), n)
    inner = [x for x in sorted(needed) if first < x < last for _ in range(needed[x])]
    return degree, np.array([first] * (degree + 1) + inner + [last] * (degree + 1))
