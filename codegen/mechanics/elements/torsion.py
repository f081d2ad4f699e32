"""A spring and damper against rotation between two bodies.

Let z be the axis of both faces, and x_s, y_s and x_e, y_e the other base vectors of start and end. The angle a satisfies

    2 cos^2(h) sin(a) = x_e . y_s - x_s . y_e          2 cos^2(h) cos(a) = x_s . x_e + y_s . y_e

with 2h the angle between the two axes. The derivatives of these sums with respect to a rotation of the end give that of the
angle. The torque is along this derivative, so its power matches the energy for every rotation.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...program.limits import limits
from ...program.scalar import Value, Vector
from ..spatial import add, cross, dot, minus, transpose
from .element import Element, Law, Wrench

NEARLY_OPPOSITE = 1e-17
"""Smallest sum of squares of the two arguments of atan2, ``4 cos(h)^4``, that determines the torque; the axis is then 8e-5
rad from its opposite. The relative error of the torque grows with the inverse cube of this angle."""


class TorsionLaw(Law):
    """A torque ``k (a - a_0) + c a'`` along the derivative of the angle a, opposing it; energy ``k (a - a_0)^2 / 2``."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        (sine, cosine, square), (x_s, y_s, x_e, y_e) = self._turn(e)
        of_sine = e.vector("slope", add(cross(x_e, y_s), cross(x_s, y_e)))
        of_cosine = e.vector("slope", add(cross(x_e, x_s), cross(y_e, y_s)))
        a, b = e.let("part", cosine / square), e.let("part", sine / square)
        gradient = e.vector("gradient", [a * s - b * c for s, c in zip(of_sine, of_cosine, strict=True)])
        stiffness, damping, free = (e.coefficient(key) for key in ("stiffness", "damping", "free_angle"))
        angle = e.turned(e.let("angle", e.x.call("atan2", sine, cosine)))
        start, end = (end.angular_velocity for end in e.ends)
        rate = e.let("rate", dot(gradient, minus(end, start)))
        back = e.let("back", stiffness * (angle - free) + damping * rate)
        torque = e.vector("torque", [back * c for c in gradient])
        return Wrench(torque=torque), Wrench(torque=[-c for c in torque])

    def energy(self, e: Element) -> Value:
        (sine, cosine, _), _ = self._turn(e, directed=e.x.tangents)
        angle = e.let("angle", e.x.call("atan2", sine, cosine))
        more = e.let("more", angle - e.coefficient("free_angle"))
        return e.let("V", e.x.half * e.coefficient("stiffness") * more * more)

    @staticmethod
    def _turn(e: Element, directed: bool = True) -> tuple[tuple[Value, Value, Value], tuple[Vector, ...]]:
        """Sine and cosine of the angle, both times the same positive factor; the square of that factor; and the base vectors
        across the axis."""
        i, j = (e.axis + 1) % 3, (e.axis + 2) % 3
        (x_s, y_s), (x_e, y_e) = ((base[i], base[j]) for base in (transpose(end.axes) for end in e.ends))
        sine = e.let("sine", dot(x_e, y_s) - dot(x_s, y_e))
        cosine = e.let("cosine", dot(x_s, x_e) + dot(y_s, y_e))
        square = e.let("square", sine * sine + cosine * cosine)
        if directed:
            e.require(square - e.x.number(limits().rounding(NEARLY_OPPOSITE, 4 / 3)))
        return (sine, cosine, square), (x_s, y_s, x_e, y_e)
