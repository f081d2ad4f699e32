"""A spring and damper against rotation between two bodies."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Torsion
from ..pairs import Pair, Pairs
from .law import End, Law, Wrench


class TorsionLaw(Law[Torsion]):
    """A torque -(k (a - a_0) + c a') g on the end, a the angle, g its derivative with respect to rotations of the end.

    Of the relative rotation's quaternion (w, v), w = cos(h) cos(a/2) and v . axis = cos(h) sin(a/2), where 2h is the swing. Here
    everything is written with the rotation matrix C and the axis itself; the generated code works in a face with the axis as base
    vector.
    """

    def wrenches(self, element: Torsion, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        k, c, free = (pairs.expression(e) for e in element.coefficients)
        angle, gradient = self._angle(element, pairs, ends)
        rate = pairs.dot(gradient, end.omega - start.omega)
        torque = gradient * (k * (angle - free) + c * rate)
        return Wrench(torque=torque), Wrench(torque=-torque)

    def energy(self, element: Torsion, pairs: Pairs, ends: Sequence[End]) -> Pair:
        k, _, free = (pairs.expression(e) for e in element.coefficients)
        more = self._angle(element, pairs, ends)[0] - free
        return k * more * more / pairs.number(2)

    @staticmethod
    def _angle(element: Torsion, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, Pair]:
        """The angle, and its derivative with respect to rotations of the end, (3, 1), ground frame."""
        start, end = ends
        a = pairs.unit(pairs.vector(element.about))
        C = start.R.mT @ end.R
        K = pairs.skew(a)
        # d tr(C X) = tr([d] C X), a sine with X = -[a] and a cosine with X = 1 - a a^T, both times two
        sine, sine_slope = _trace(pairs, C, -K)
        cosine, cosine_slope = _trace(pairs, C, -(K @ K))
        square = sine * sine + cosine * cosine
        if square.value == 0:
            raise ValueError(
                f"torsion {element.name}: one end is turned over across its axis, so its angle is not determined"
            )
        slope = sine_slope * (cosine / square) - cosine_slope * (sine / square)
        return pairs.call("atan2", sine, cosine), start.R @ slope


def _trace(pairs: Pairs, C: Pair, X: Pair) -> tuple[Pair, Pair]:
    """tr(C X), and its derivative with respect to rotations d that come after C, [d] C: (3, 1)."""
    Y = C @ X
    trace = Y[0, 0] + Y[1, 1] + Y[2, 2]
    return trace, pairs.column([Y[i, j] - Y[j, i] for i, j in ((1, 2), (2, 0), (0, 1))])
