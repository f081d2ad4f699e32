"""Force elements for both engines: forces and torques at attachment points, generalised forces, potential energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from ..model.binding import bind
from ..model.expressions import Expression
from ..model.forces import (
    ALONG_LINES,
    AlongLine,
    Bushing,
    Force,
    ForceElement,
    JointForce,
    JointLoad,
    Spring,
    Torque,
    Torsion,
)
from ..model.forces.line_law import in_squares
from .pairs import Pair, Pairs

E = TypeVar("E", bound=ForceElement)


@dataclass(slots=True)
class End:
    """A point of a body, or a face, at a state, in the ground frame.

    Attributes
    ----------
    x, v : Pair
        Position, m, and velocity, (3, 1).
    R : Pair
        Rotation matrix from components of the body, or of the face, to ground components, (3, 3).
    omega : Pair
        Angular velocity of the body, (3, 1).
    line : Pair or None
        For the first attachment point: the direction to the second one, if it is constant except for its sign.
    """

    x: Pair
    v: Pair
    R: Pair
    omega: Pair
    line: Pair | None = None


@dataclass(slots=True)
class Wrench:
    """Load on a body at an attachment point, in the ground frame: a force through the point, N, and a torque, N m; (3, 1)."""

    force: Pair | None = None
    torque: Pair | None = None


def line(element: ForceElement, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, Pair]:
    """The unit vector from the first attachment point to the second, (3, 1), and the distance.

    Raises
    ------
    ValueError
        If the points coincide.
    """
    start, end = ends
    r = end.x - start.x
    length = pairs.dot(
        r if start.line is None else start.line, r
    )  # components across a constant line are rounding errors
    if length.value == 0:
        raise ValueError(f"{element.type} {element.name}: its two points coincide, so its force has no direction")
    if start.line is None:
        return pairs.unit(r), pairs.call("sqrt", length)
    return start.line * pairs.call("sign", length), pairs.call("abs", length)


class Law(Generic[E]):
    """The law of a type of force element; every result includes its derivatives.

    The methods take the element, an evaluator of its expressions at the state, and its attachment points.
    """

    def wrenches(self, element: E, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        """The loads on the bodies, one for each attachment point."""
        return [Wrench() for _ in ends]

    def on_speeds(self, element: E, pairs: Pairs) -> dict[int, Pair]:
        """Generalised forces on the speeds of joints, (f, 1) by body."""
        return {}

    def energy(self, element: E, pairs: Pairs, ends: Sequence[End]) -> Pair | None:
        """Potential energy, a number, J; None if there is none."""
        return None


class JointForceLaw(Law[JointForce]):
    """Generalised forces of a joint: the values of the element's expressions."""

    def on_speeds(self, element: JointForce, pairs: Pairs) -> dict[int, Pair]:
        return {element.body: pairs.vector(element.values)}


class JointLoadLaw(Law[JointLoad]):
    """A force through the origin of the body and a torque; the opposite wrench about this origin acts on the parent."""

    def wrenches(self, element: JointLoad, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        body, joint = ends
        torque, force, own_torque, own_force = (pairs.vector(element.values[i : i + 3]) for i in range(0, 12, 3))
        torque = joint.R @ torque + body.R @ own_torque
        force = joint.R @ force + body.R @ own_force
        back = torque + pairs.skew(body.x - joint.x) @ force
        return Wrench(force, torque), Wrench(-force, -back)


class SpringLaw(Law[Spring]):
    """A tension k (d - d_0) + c d' along r from start to end, with d its length; energy k (d - d_0)^2 / 2.

    If the points coincide, the force has no direction; but without damping and free length it is k r.
    """

    def wrenches(self, element: Spring, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        k, c, free = (pairs.expression(e) for e in element.coefficients)
        r = end.x - start.x
        if not element.needs_direction:
            pull = r * k
        else:
            along, d = line(element, pairs, ends)
            pull = along * (k * (d - free) + c * pairs.dot(along, end.v - start.v))
        return Wrench(pull), Wrench(-pull)

    def energy(self, element: Spring, pairs: Pairs, ends: Sequence[End]) -> Pair:
        start, end = ends
        k, _, free = (pairs.expression(e) for e in element.coefficients)
        r, two = end.x - start.x, pairs.number(2)
        if "free_length" in element.zeros:
            return pairs.dot(r, r) * k / two
        stretch = line(element, pairs, ends)[1] - free
        return k * stretch * stretch / two


class AlongLineLaw(Law[AlongLine]):
    """The force f of the law acts on the end along the unit vector from start to end; -f acts on the start."""

    def wrenches(self, element: AlongLine, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        formula = in_squares(bind(element.law.formula, element.zeros), 1)
        if formula is not None:
            push = (end.x - start.x) * self._of_square(formula, element, pairs, ends)
            return Wrench(-push), Wrench(push)
        along, distance = line(element, pairs, ends)
        rate = pairs.dot(along, end.v - start.v)
        push = along * self._value(element.law.formula, element, pairs, {"distance": distance, "rate": rate})
        return Wrench(-push), Wrench(push)

    def energy(self, element: AlongLine, pairs: Pairs, ends: Sequence[End]) -> Pair | None:
        if element.law.potential is None:
            return None
        potential = in_squares(bind(element.law.potential, element.zeros), 0)
        if potential is not None:
            return self._of_square(potential, element, pairs, ends)
        _, distance = line(element, pairs, ends)
        return self._value(element.law.potential, element, pairs, {"distance": distance})

    def _of_square(self, formula: Expression, element: AlongLine, pairs: Pairs, ends: Sequence[End]) -> Pair:
        r = ends[1].x - ends[0].x
        return self._value(formula, element, pairs, {"square": pairs.dot(r, r)})

    @staticmethod
    def _value(formula: Expression, element: AlongLine, pairs: Pairs, measures: dict[str, Pair]) -> Pair:
        """The value of a formula whose names are measures and coefficients."""
        of = {key: pairs.expression(e) for key, e in zip(element.keys, element.coefficients, strict=True)}
        return Pairs(pairs.arithmetic, pairs.k, measures | of).expression(formula)


class ForceLaw(Law[Force]):
    """A force with the components that the element gives; components along body axes are rotated to the ground
    frame."""

    def wrenches(self, element: Force, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        f = pairs.vector(element.value)
        return (Wrench(ends[0].R @ f if element.axes == "body" else f),)


class TorqueLaw(Law[Torque]):
    """A torque with the components that the element gives; components along body axes are rotated to the ground
    frame."""

    def wrenches(self, element: Torque, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        n = pairs.vector(element.value)
        return (Wrench(torque=ends[0].R @ n if element.axes == "body" else n),)


class TorsionLaw(Law[Torsion]):
    """A torque -(k (a - a_0) + c a') g on the end, with a the angle and g its derivative with respect to rotations of the end.

    The quaternion (w, v) of the relative rotation has w = cos(h) cos(a/2) and v . axis = cos(h) sin(a/2), where 2h is the swing.
    This module uses the rotation matrix C and the axis; the generated code uses a face with the axis as base vector.
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
        # tr(C X) is a common factor times the sine of the angle for X = -[a], times the cosine for X = 1 - a a^T;
        # d tr(C X) = tr([d] C X)
        sine, sine_slope = _trace(pairs, C, -K)
        cosine, cosine_slope = _trace(pairs, C, -(K @ K))
        square = sine * sine + cosine * cosine
        if not pairs.arithmetic.symbolic and square.value < NEARLY_OPPOSITE:
            raise ValueError(
                f"torsion {element.name}: one end is turned by half a turn about a line across its axis; no angle is determined"
            )
        slope = sine_slope * (cosine / square) - cosine_slope * (sine / square)
        return pairs.call("atan2", sine, cosine), start.R @ slope


def _trace(pairs: Pairs, C: Pair, X: Pair) -> tuple[Pair, Pair]:
    """tr(C X), and its derivative with respect to rotations d applied after C, [d] C: (3, 1)."""
    Y = C @ X
    trace = Y[0, 0] + Y[1, 1] + Y[2, 2]
    return trace, pairs.column([Y[i, j] - Y[j, i] for i, j in ((1, 2), (2, 0), (0, 1))])


NEARLY_OPPOSITE = 1e-17
"""Value of ``4 cos(h)^4``, with 2h the angle between the two axes of a torsion spring, below which rounding errors determine its
torque."""

NEARLY_HALF = 1e-12
"""Value of 1 + cos(angle) below which the rotation vector is not determined."""

NEAR = 0.01
"""Square of the sine of half the angle below which a series is used."""


class BushingLaw(Law[Bushing]):
    """Along the axes of the start: force f - k d - c v, torque -dV/d(rotation) - c' w with V = r . (k' r/2 - f').

    With the unit quaternion (w, e), w > 0, of the end in the axes of the start, the rotation vector is r = F e with F = 2
    atan2(|e|, w)/|e|. A further rotation d changes w by -(d . e)/2 and e by (w d + d x e)/2. The generated code has no
    quaternion.
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
        """The displacement from start to end, in ground axes and in the axes of the start, and the stiffness."""
        start, end = ends
        way = end.x - start.x
        return way, start.R.mT @ way, self._values(element, pairs)[0]

    def _moment(self, element: Bushing, pairs: Pairs, turn: Pair) -> Pair:
        """Derivative of the energy with respect to the rotation vector."""
        _, _, _, k, _, f = self._values(element, pairs)
        return _times(pairs, k, turn) - f

    @staticmethod
    def _turn(element: Bushing, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, tuple[Pair, Pair, Pair, Pair]]:
        """The rotation vector r, and w, e, F of the class's formulas, with the derivative of F with respect to w.

        Raises
        ------
        ValueError
            If the rotation is half a turn.
        """
        start, end = ends
        C = start.R.mT @ end.R
        one, two = pairs.number(1), pairs.number(2)
        square = (one + C[0, 0] + C[1, 1] + C[2, 2]) / pairs.number(4)
        if not pairs.arithmetic.symbolic and 2 * square.value < NEARLY_HALF:
            raise ValueError(f"bushing {element.name}: {element.singular}")
        w = pairs.call("sqrt", square)
        e = pairs.column([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) * (one / (pairs.number(4) * w))
        squared = pairs.dot(e, e)
        if not pairs.arithmetic.symbolic and squared.value < NEAR:
            F, by_square = _near(pairs, squared)
            return e * F, (w, e, F, pairs.number(-2) * w * by_square)

        def factor() -> Pair:
            length = pairs.call("sqrt", squared)
            return two * pairs.call("atan2", length, w) / length

        # symbols may be zero; at e = 0, F and its slope have these limits
        F = pairs.where_zero(squared, lambda: two, factor)
        slope = pairs.where_zero(squared, lambda: pairs.number(-2) / pairs.number(3), lambda: (F * w - two) / squared)
        return e * F, (w, e, F, slope)


def _near(pairs: Pairs, square: Pair) -> tuple[Pair, Pair]:
    """2 asin(x)/x and its derivative with respect to x^2, by the series in x^2, for x^2 below `NEAR`.

    Derivatives of the quotient itself lose their digits there.
    """
    terms = 3 + int(math.log(float(pairs.arithmetic.epsilon)) / math.log(NEAR))
    term, found, slope = pairs.number(2), pairs.number(0), pairs.number(0)  # term: a factor of the series
    power, before = pairs.number(1), pairs.number(0)
    for k in range(terms):
        found = found + term * power
        slope = slope + term * pairs.number(k) * before
        term = term * (pairs.number((2 * k + 1) ** 2) / pairs.number((2 * k + 2) * (2 * k + 3)))
        power, before = power * square, power
    return found, slope


def _times(pairs: Pairs, a: Pair, b: Pair) -> Pair:
    """The product of two columns, component by component."""
    return pairs.column([a[i, 0] * b[i, 0] for i in range(3)])


LAWS: Final[dict[type[ForceElement], Law[Any]]] = {
    JointForce: JointForceLaw(),
    JointLoad: JointLoadLaw(),
    Spring: SpringLaw(),
    Force: ForceLaw(),
    Torque: TorqueLaw(),
    Torsion: TorsionLaw(),
    Bushing: BushingLaw(),
    **dict.fromkeys(ALONG_LINES.values(), AlongLineLaw()),
}
"""Classes of laws by the class of the element."""
