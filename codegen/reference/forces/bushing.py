"""Springs and dampers along and about three axes between two bodies."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Bushing
from ..pairs import Pair, Pairs
from .law import End, Law, Wrench

NEARLY_HALF = 1e-12
"""Of 1 + cos(angle) where the rotation vector is not determined any more."""


class BushingLaw(Law[Bushing]):
    """Along the axes of the start: force f - k d - c v, torque -dV/d(rotation) - c' w with V = r . (k' r/2 - f').

    By the unit quaternion (w, e), w > 0, of the end in the axes of the start: the rotation vector is r = F e with
    F = 2 atan2(|e|, w)/|e|, and a rotation d that comes after it changes w by -(d . e)/2 and e by (w d + d x e)/2.
    The generated code has no quaternion.
    """

    def wrenches(self, element: Bushing, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        _, c, f, _, turning_c, _ = self._values(element, pairs)
        A = start.R
        way, stretch, k = self._stretch(element, pairs, ends)
        across = pairs.skew(start.omega) @ way
        force = f - _times(pairs, k, stretch) - _times(pairs, c, A.mT @ (end.v - start.v - across))
        torque = -_times(pairs, turning_c, A.mT @ (end.omega - start.omega))
        if element.turns:
            turn, (w, e, F, slope) = self._turn(element, pairs, ends)
            m = self._moment(element, pairs, turn)
            half = pairs.number(0.5)
            torque = torque - (m * w + pairs.skew(e) @ m) * (half * F) + e * (half * slope * pairs.dot(m, e))
        force, torque = A @ force, A @ torque
        return Wrench(-force, -torque - pairs.skew(way) @ force), Wrench(force, torque)

    def energy(self, element: Bushing, pairs: Pairs, ends: Sequence[End]) -> Pair:
        f = self._values(element, pairs)[2]
        _, stretch, k = self._stretch(element, pairs, ends)
        half = pairs.number(0.5)
        found = pairs.dot(stretch, _times(pairs, k, stretch)) * half - pairs.dot(f, stretch)
        if element.turns:
            turn, _ = self._turn(element, pairs, ends)
            _, _, _, k, _, f = self._values(element, pairs)
            found = found + pairs.dot(turn, _times(pairs, k, turn)) * half - pairs.dot(f, turn)
        return found

    @staticmethod
    def _values(element: Bushing, pairs: Pairs) -> list[Pair]:
        return [pairs.vector(components) for components in element.values]

    def _stretch(self, element: Bushing, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, Pair, Pair]:
        """The way from start to end, the same in the axes of the start, and the stiffness."""
        start, end = ends
        way = end.x - start.x
        return way, start.R.mT @ way, self._values(element, pairs)[0]

    def _moment(self, element: Bushing, pairs: Pairs, turn: Pair) -> Pair:
        """Derivative of the energy by the rotation vector."""
        _, _, _, k, _, f = self._values(element, pairs)
        return _times(pairs, k, turn) - f

    @staticmethod
    def _turn(element: Bushing, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, tuple[Pair, Pair, Pair, Pair]]:
        """The rotation vector; w, e, F and the derivative of F by w.

        Raises
        ------
        ValueError
            Half a turn.
        """
        start, end = ends
        C = start.R.mT @ end.R
        one, two = pairs.number(1), pairs.number(2)
        square = (one + C[0, 0] + C[1, 1] + C[2, 2]) / pairs.number(4)
        if 2 * square.value < NEARLY_HALF:
            raise ValueError(f"bushing {element.name}: {element.singular}")
        w = pairs.call("sqrt", square)
        e = pairs.column([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) * (one / (pairs.number(4) * w))
        squared = pairs.dot(e, e)
        if squared.value == 0:  # the limits; what multiplies the slope vanishes to second order
            F, slope = two, pairs.number(-4) / pairs.number(3)
        else:
            length = pairs.call("sqrt", squared)
            F = two * pairs.call("atan2", length, w) / length
            slope = (F * w - two) / squared
        return e * F, (w, e, F, slope)


def _times(pairs: Pairs, a: Pair, b: Pair) -> Pair:
    """Component by component."""
    return pairs.column([a[i, 0] * b[i, 0] for i in range(3)])
