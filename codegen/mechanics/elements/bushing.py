"""Springs and dampers along and about three axes between two bodies, along the axes of the start.

Let C be the rotation matrix of the end along the axes of the start, and c the cosine of its angle. Let a be its
rotation axis times the sine of the angle: half of (C_zy - C_yz, C_xz - C_zx, C_yx - C_xy). The rotation vector is f a
with f = atan2(s, c)/s, s = |a|. Let m be the derivative of an energy with respect to the rotation vector. The
derivative of this energy with respect to rotations of the end is

    m + f/2 a x m + h a x (a x m),    h = (1 - f (1 + c)/2)/s^2

Where the faces coincide, f and h are 0/0, but h is multiplied by a = 0, and f = 1. `SMALLEST` in s keeps the quotients
finite. Each division by s enlarges the rounding errors of the quotients and of their derivatives; a factor a, of size
s, reduces them again.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...program.limits import limits
from ...program.scalar import Value, Vector
from ..spatial import add, cross, dot, is_zero, matmul, matvec, minus, transpose
from .element import Element, Law, Wrench

SMALLEST = 1e-60
"""Number added to the square of a sine before a division: far below rounding, but large enough that no quotient
overflows."""
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
            a, cosine, square, ratio = self._turn(e)
            m = e.vector("m", [k[i] * ratio * a[i] - f[i] for i in range(3)])
            half = e.x.half
            h = e.let("h", (1 - half * ratio * (1 + cosine)) / square)
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
        a, _, _, ratio = self._turn(e)
        return [e.let("turn", ratio * a[i]) if used[i] else 0 for i in range(3)]

    @staticmethod
    def _turn(e: Element) -> tuple[Vector, Value, Value, Value]:
        """The sine times the axis, the cosine, the squared sine, and angle/sine of the rotation from start to end."""
        start, end = e.ends
        half = e.x.half
        C = [e.vector("C", row) for row in matmul(transpose(start.axes), end.axes)]
        a = e.vector("sine", [half * (C[(i + 2) % 3][(i + 1) % 3] - C[(i + 1) % 3][(i + 2) % 3]) for i in range(3)])
        cosine = e.let("cosine", half * (C[0][0] + C[1][1] + C[2][2] - 1))
        e.require(1 + cosine - e.x.number(limits().rounding(NEARLY_HALF)))
        square = e.let("square", dot(a, a) + e.x.number(limits().tiny(SMALLEST, 2)))
        length = e.let("length", e.x.sqrt(square))
        angle = e.let("angle", e.x.call("atan2", length, cosine))
        return a, cosine, square, e.let("ratio", angle / length)


def _along(e: Element, name: str, v: Vector, used: Sequence[bool]) -> Vector:
    """Components of a vector along the axes of the start; zero for axes that are not used."""
    if not any(used):
        return [0, 0, 0]
    base = transpose(e.ends[0].axes)
    return [e.let(name, dot(base[i], v)) if used[i] else 0 for i in range(3)]
