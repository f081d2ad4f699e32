"""Tables of a model file as expressions: linear between their points, or a cubic spline through them.

On the segment from x_i to x_(i+1), ``s_i = min(max(x_i, x), x_(i+1)) - x_i`` is the part of it below x. With
polynomials p_i that are zero at zero, the table is ``y_0 + sum p_i(s_i)``: segments below x count in full, segments
above x not at all. This is an expression of the grammar, so every engine can evaluate and differentiate it. For equal
arguments, ``min`` and ``max`` have the derivative of the first one. So exactly at a point, the table has the slope on
the left of the point: neighbours compare x with the same number, and only the left one counts there.

A periodic table is repeated after its last point. x is reduced by whole periods to a value above 0 and up to one
period, so that the seam also has the slope on its left. A cubic periodic table is as smooth at the seam as elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from .expressions import Expression, made
from .grammar import WRAPPED, Tree

MAX_POINTS: Final = 200
"""Maximum number of points; more would lead to expressions with thousands of operations."""

LEVEL: Final = 1e-12
"""A slope below this fraction of the steepest slope of a table counts as zero."""

KINDS: Final = ("linear", "cubic")
OUTSIDE: Final = ("constant", "linear", "periodic")


@dataclass(frozen=True, eq=False)
class Table:
    """Points of a table, with its interpolation and extrapolation.

    Attributes
    ----------
    x : tuple of float
        Arguments of the points, increasing.
    y : tuple of Expression
        Values: expressions of parameters in a linear table, otherwise numbers.
    kind : str
        ``linear``, or ``cubic``: the natural spline, with a continuous second derivative that is zero at both ends; or
        a periodic spline.
    outside : str
        ``constant`` or ``linear`` beyond the first and last point; or ``periodic``: the last point is the first one again.
    """

    x: tuple[float, ...]
    y: tuple[Expression, ...]
    kind: str
    outside: str

    def at(self, argument: Tree) -> Tree:
        """The expression of the table's value at an argument."""
        x, y, n, at = self.x, self.y, len(self.x) - 1, Expression(argument)
        origin = x[0] if self.outside == "periodic" else 0.0
        if self.outside == "periodic":
            at = self._within(at)
        elif self.outside == "constant" and self.kind == "cubic":
            at = self._before_kinks(at)
        terms = [y[0]]
        for i in range(n):
            start, end = x[i] - origin, x[i + 1] - origin
            h = end - start
            s = made("min", made("max", start, at), end) - start
            if self.kind == "linear":
                terms.append((y[i + 1] - y[i]) / h * s)
            else:
                a, b, c = self._cubic(i, h)
                terms.append(s * (a + s * (b + c * s)))
        if self.outside == "linear":
            first, last = self._slopes()
            terms += [first * made("min", at - x[0], 0), last * made("max", 0, at - x[n])]
        while len(terms) > 1:  # in pairs: time and depth of one long sum would grow with the square of its length
            terms = [sum(terms[i + 1 : i + 2], terms[i]) for i in range(0, len(terms), 2)]
        return terms[0].tree

    def _within(self, argument: Expression) -> Expression:
        """Position of the argument within its period. In a cubic table nothing jumps where the next period begins."""
        period = self.x[-1] - self.x[0]
        return period - made("mod" if self.kind == "linear" else WRAPPED, -(argument - self.x[0]), period)

    def _before_kinks(self, at: Expression) -> Expression:
        """The argument, constant beyond those ends of a cubic table at which its slope jumps to zero.

        The parts of a cubic table count as smooth, so motions do not stop at its points; motions stop at this limit.
        """
        first, last = (abs(float(e.value)) > LEVEL * self._steepest for e in self._slopes())
        if first:
            at = made("max", self.x[0], at)
        return made("min", at, self.x[-1]) if last else at

    @property
    def _steepest(self) -> float:
        """The largest slope of a straight line between two neighbouring points."""
        return float(np.max(np.abs(np.diff(self._values) / np.diff(self.x))))

    def _slopes(self) -> tuple[Expression, Expression]:
        """Slopes at the first and at the last point."""
        x, y, n = self.x, self.y, len(self.x) - 1
        if self.kind == "linear":
            first, last = ((y[i + 1] - y[i]) / (x[i + 1] - x[i]) for i in (0, n - 1))
            return first, last
        h = x[n] - x[n - 1]
        a, b, c = self._cubic(n - 1, h)
        return Expression.number(self._cubic(0, x[1] - x[0])[0]), Expression.number(a + h * (2 * b + 3 * c * h))

    @cached_property
    def _values(self) -> list[float]:
        return [float(e.value) for e in self.y]

    @cached_property
    def _bends(self) -> list[float]:
        spline = periodic_spline if self.outside == "periodic" else natural_spline
        return spline(self.x, self._values)

    def _cubic(self, i: int, h: float) -> tuple[float, float, float]:
        """Coefficients of s, s^2 and s^3 on segment i."""
        y, bend = self._values, self._bends
        slope = (y[i + 1] - y[i]) / h
        return slope - h * (2 * bend[i] + bend[i + 1]) / 6, bend[i] / 2, (bend[i + 1] - bend[i]) / (6 * h)


def natural_spline(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Second derivatives at the points of the cubic spline whose second derivative is zero at both ends.

    [C. de Boor, A Practical Guide to Splines, 1978, chapter IV.]
    """
    n = len(x) - 1
    bend = [0.0] * (n + 1)
    h = [x[i + 1] - x[i] for i in range(n)]
    rise = [(y[i + 1] - y[i]) / h[i] for i in range(n)]
    diagonal = [2 * (h[i] + h[i + 1]) for i in range(n - 1)]
    right = [6 * (rise[i + 1] - rise[i]) for i in range(n - 1)]
    for i in range(1, n - 1):
        factor = h[i] / diagonal[i - 1]
        diagonal[i] -= factor * h[i]
        right[i] -= factor * right[i - 1]
    for i in reversed(range(n - 1)):
        bend[i + 1] = (right[i] - h[i + 1] * bend[i + 2]) / diagonal[i]
    return bend


def periodic_spline(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Second derivatives at the points of a periodic cubic spline, whose last point is the first one again."""
    n = len(x) - 1
    h = [x[i + 1] - x[i] for i in range(n)]
    rise = [(y[i + 1] - y[i]) / h[i] for i in range(n)]
    matrix = np.zeros((n, n))
    for i in range(n):
        matrix[i, i] += 2 * (h[i - 1] + h[i])
        matrix[i, i - 1] += h[i - 1]
        matrix[i, (i + 1) % n] += h[i]
    bend = np.linalg.solve(matrix, [6 * (rise[i] - rise[i - 1]) for i in range(n)]).tolist()
    return [*bend, bend[0]]
