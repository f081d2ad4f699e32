"""Springs and dampers along and about three axes between two bodies, along the axes of the start.

Let C be the rotation matrix of the end along the axes of the start, and c the cosine of its angle. Let a be its
rotation axis times the sine of the angle: half of (C_zy - C_yz, C_xz - C_zx, C_yx - C_xy). The rotation vector is f a
with f = atan2(s, c)/s, s = |a|. Let m be the derivative of an energy with respect to the rotation vector. The
derivative of this energy with respect to rotations of the end is

    m + f/2 a x m + h a x (a x m),    h = (1 - f (1 + c)/2)/s^2

Where the faces nearly coincide, these quotients and their derivatives would lose their digits. There, both follow from a
smooth function of y = (1 - c)/2 = s^2/(2 (1 + c)):

    f = (1 - y P)/(1 - y),    h = P/(4 (1 - y)),    P = (1 - (1 - y) f)/y = 1/3 + 2/15 y + 8/105 y^2 + ...

Each coefficient of this series is (2 k + 2)/(2 k + 5) times the one before.
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath

from ...program.algebra import Number
from ...program.digits import are_long
from ...program.limits import limits
from ...program.scalar import Value, Vector
from ..spatial import add, cross, dot, is_zero, matmul, matvec, minus, transpose
from .element import Element, Law, Wrench

NEAR, TERMS = 1e-3, 8
"""Largest y for which the series is used, and its number of terms in double precision. The other branch is then evaluated
at another angle, where it is finite."""
NEARLY_HALF = 1e-12
"""Smallest 1 + cos(angle) that determines the axis; the angle is then 1.4e-6 rad from half a turn."""


class BushingLaw(Law):
    """The law of a bushing: zero coefficients leave no statements, and no angle is computed without a stiffness or
    preload about an axis."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        start, end = e.ends
        axes = start.axes
        force = self._force(e)
        torque = self._torque(e)
        on_end = Wrench(
            None if force is None else e.vector("wrench", matvec(axes, force)),
            None if torque is None else e.vector("wrench", matvec(axes, torque)),
        )
        back: Vector | None = None
        if on_end.torque is not None:
            back = [-c for c in on_end.torque]
        if on_end.force is None:
            return Wrench(torque=back), on_end
        # the force acts at the end's attachment point
        moment = e.vector("moment", cross(minus(start.position, end.position), on_end.force))
        back = moment if back is None else e.vector("moment", add(moment, back))
        return Wrench([-c for c in on_end.force], back), on_end

    def energy(self, e: Element) -> Value:
        found: Value = e.x.number(0)
        for springs, loads, deflection in (
            ("stiffness", "preload", self._stretch),
            ("rotational_stiffness", "rotational_preload", self._turn_of_energy),
        ):
            k, f = e.coefficients(springs), e.coefficients(loads)
            used = [not (is_zero(k[i]) and is_zero(f[i])) for i in range(3)]
            if any(used):
                d = deflection(e, used)
                for i in range(3):
                    if used[i]:
                        found = found + (e.x.half * k[i] * d[i] - f[i]) * d[i]
        return e.let("V", found)

    # -- along axes ------------------------------------------------------------------------------------------------

    def _force(self, e: Element) -> Vector | None:
        """The force on the end, along the axes of the start."""
        k, c, f = (e.coefficients(key) for key in ("stiffness", "damping", "preload"))
        moving = [not is_zero(v) for v in c]
        stretched = [not is_zero(v) for v in k]
        if not any((*moving, *stretched)) and all(map(is_zero, f)):
            return None
        d: Vector = [0, 0, 0]
        v: Vector = [0, 0, 0]
        if any((*moving, *stretched)):
            start, end = e.ends
            way = self._way(e)
            d = _along(e, "stretch", way, stretched)
            if any(moving):
                seen = minus(minus(end.velocity, start.velocity), cross(start.angular_velocity, way))
                v = _along(e, "rate", e.vector("seen", seen), moving)
        return e.vector("force", [f[i] - k[i] * d[i] - c[i] * v[i] for i in range(3)])

    @staticmethod
    def _way(e: Element) -> Vector:
        start, end = e.ends
        return e.vector("way", minus(end.position, start.position))

    def _stretch(self, e: Element, used: Sequence[bool]) -> Vector:
        return _along(e, "stretch", self._way(e), used)

    # -- about axes ------------------------------------------------------------------------------------------------

    def _torque(self, e: Element) -> Vector | None:
        """The torque on the end, along the axes of the start."""
        k, c, f = (e.coefficients(f"rotational_{key}") for key in ("stiffness", "damping", "preload"))
        moving = [not is_zero(v) for v in c]
        found: Vector | None = None
        if not all(map(is_zero, (*k, *f))):
            a, ratio, h = self._turn(e)
            m = e.vector("m", [k[i] * ratio * a[i] - f[i] for i in range(3)])
            half = e.x.half
            once = e.vector("cross", cross(a, m))
            twice = cross(a, once)
            found = e.vector("back", [-m[i] - half * ratio * once[i] - h * twice[i] for i in range(3)])
        if any(moving):
            start, end = e.ends
            w = _along(e, "turning", minus(end.angular_velocity, start.angular_velocity), moving)
            damped = [-c[i] * w[i] for i in range(3)]
            found = e.vector("back", damped if found is None else add(found, damped))
        return found

    def _turn_of_energy(self, e: Element, used: Sequence[bool]) -> Vector:
        a, ratio, _ = self._turn(e)
        return [e.let("turn", ratio * a[i]) if used[i] else 0 for i in range(3)]

    @staticmethod
    def _turn(e: Element) -> tuple[Vector, Value, Value]:
        """The sine times the axis of the rotation from start to end, f = angle/sine, and h."""
        start, end = e.ends
        half = e.x.half
        C = [e.vector("C", row) for row in matmul(transpose(start.axes), end.axes)]
        a = e.vector("sine", [half * (C[(i + 2) % 3][(i + 1) % 3] - C[(i + 1) % 3][(i + 2) % 3]) for i in range(3)])
        cosine = e.let("cosine", half * (C[0][0] + C[1][1] + C[2][2] - 1))
        e.require(1 + cosine - e.x.number(limits().rounding(NEARLY_HALF)))
        far = e.let("far", e.x.call("at_least", e.x.number(1 - 2 * NEAR), cosine))
        square = e.let("square", dot(a, a))
        apart = e.let("apart", e.x.call("choice", far, square, e.x.number(4 * NEAR)))
        length = e.let("length", e.x.sqrt(apart))
        closed = e.let("closed", e.x.call("atan2", length, cosine) / length)
        rest = e.let("rest", half * (1 + cosine))
        quarter = half * half
        y = e.let("y", quarter * square / rest)
        P = e.let("P", _series(e, y))
        ratio = e.let("ratio", e.x.call("choice", far, closed, e.let("near", (1 - y * P) / rest)))
        of_far, of_near = e.let("h_far", (1 - closed * rest) / apart), e.let("h_near", quarter * P / rest)
        return a, ratio, e.let("h", e.x.call("choice", far, of_far, of_near))


def _series(e: Element, y: Value) -> Value:
    """The value of P, see the module, for small y by its power series."""
    long = are_long()
    coefficient: float = mpmath.mpf(1) / 3 if long else 1 / 3
    coefficients = []
    for k in range(mpmath.mp.dps // 3 + 3 if long else TERMS):
        coefficients.append(coefficient)
        coefficient = coefficient * (2 * k + 2) / (2 * k + 5)
    found = e.x.number(Number(coefficients[-1]))
    for c in reversed(coefficients[:-1]):
        found = e.x.number(Number(c)) + y * found
    return found


def _along(e: Element, name: str, v: Vector, used: Sequence[bool]) -> Vector:
    """Components of a vector along the axes of the start; zero for axes that are not used."""
    if not any(used):
        return [0, 0, 0]
    base = transpose(e.ends[0].axes)
    return [e.let(name, dot(base[i], v)) if used[i] else 0 for i in range(3)]
