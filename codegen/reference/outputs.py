"""The values of outputs for both engines, and the data about a model that these values need; pairs give the
derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Final

from ..model.outputs import QUATERNION, Output
from ..model.places import Point
from .pairs import Pair, Pairs


@dataclass(frozen=True, slots=True)
class Moving:
    """A body with its mass, in the ground frame.

    Attributes
    ----------
    mass : Pair
        A number, kg.
    x, v : Pair
        Position, m, and velocity of the mass centre, (3, 1).
    spin : Pair
        Angular momentum about the mass centre, (3, 1).
    """

    mass: Pair
    x: Pair
    v: Pair
    spin: Pair


@dataclass(frozen=True, slots=True)
class Seen:
    """A model at a state, as an engine evaluates it.

    Attributes
    ----------
    pairs : Pairs
        Evaluates expressions at the state.
    point : callable
        Position, m, and velocity of a point in the ground frame, (3, 1).
    acceleration : callable
        Acceleration of a point relative to the ground, (3, 1).
    attitude : callable
        Rotation matrix of a body, from its components to ground components, (3, 3), and its angular velocity in the ground frame,
        (3, 1).
    energies : callable
        Kinetic and potential energy, (1, 1), J.
    driving_forces : callable
        The generalised forces that drive prescribed coordinates, (1, 1) each, N m or N, by name.
    bodies : callable
        All bodies, in the order of the model.
    """

    pairs: Pairs
    point: Callable[[Point], tuple[Pair, Pair]]
    acceleration: Callable[[Point], Pair]
    attitude: Callable[[int], tuple[Pair, Pair]]
    energies: Callable[[], tuple[Pair, Pair]]
    driving_forces: Callable[[], dict[str, Pair]]
    bodies: Callable[[], Sequence[Moving]]


def along(output: Output, seen: Seen, v: Pair) -> Pair:
    """The component of a vector along the output's axis."""
    assert output.axis is not None
    return seen.pairs.dot(seen.pairs.unit(seen.pairs.vector(output.axis)), v)


def of_points(which: int) -> Callable[[Output, Seen], Pair]:
    """n . x of one point, or n . (x_2 - x_1) of two points; x is a position (0) or velocity (1)."""

    def value(output: Output, seen: Seen) -> Pair:
        *first, last = (seen.point(point)[which] for point in output.points)
        return along(output, seen, last - first[0] if first else last)

    return value


def rotation(output: Output, seen: Seen) -> Pair:
    """An entry of ``R = R_other^T R_body``, or a component of its quaternion, qw >= 0.

    The largest component is a square root; the others follow from products of two components. At qw = 0 the largest is positive.
    """
    body, other = output.bodies
    (entry,) = output.choice
    R = seen.attitude(other)[0].mT @ seen.attitude(body)[0]
    if entry not in QUATERNION:
        return R["xyz".index(entry[0]), "xyz".index(entry[1])]
    one, two, four = (seen.pairs.number(x) for x in (1, 2, 4))
    xx, yy, zz = (R[i, i] for i in range(3))
    squares = [one + xx + yy + zz, one + xx - yy - zz, one - xx + yy - zz, one - xx - yy + zz]
    antisymmetric = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    component = QUATERNION.index(entry)

    def product(i: int, j: int) -> Pair:
        """Four times the product of two different components of the quaternion."""
        i, j = sorted((i, j))
        return antisymmetric[j - 1] if i == 0 else R[i - 1, j - 1] + R[j - 1, i - 1]

    def by(largest: int) -> Pair:
        e = seen.pairs.call("sqrt", squares[largest]) / two

        def of(i: int) -> Pair:
            return e if i == largest else product(i, largest) / (four * e)

        if largest == 0:
            return of(component)
        return seen.pairs.where_negative(of(0), lambda: -of(component), lambda: of(component))

    return seen.pairs.of_largest(squares, by)


def angular_velocity(output: Output, seen: Seen) -> Pair:
    """n . omega, with the axis n fixed in the ground or in the body."""
    (body,) = output.bodies
    R, omega = seen.attitude(body)
    return along(output, seen, omega if output.choice[0] == "ground" else R.mT @ omega)


def acceleration(output: Output, seen: Seen) -> Pair:
    """n . a, with a the acceleration of a point and n the axis."""
    (point,) = output.points
    return along(output, seen, seen.acceleration(point))


def center(bodies: list[Moving], seen: Seen) -> Pair:
    """The centre of mass, sum m x / sum m, (3, 1)."""
    one = seen.pairs.number(1)
    return reduce(add, (b.x * b.mass for b in bodies)) * (one / reduce(add, (b.mass for b in bodies)))


def center_of_mass(output: Output, seen: Seen) -> Pair:
    """n . c, with c the centre of mass and n the axis."""
    known = seen.bodies()
    return along(output, seen, center([known[k] for k in output.bodies or range(len(known))], seen))


def momentum(output: Output, seen: Seen) -> Pair:
    """n . sum m v, or n . sum (spin + (x - o) x m v), with o the ground's origin or the centre of mass."""
    kind, about = output.choice
    bodies = list(seen.bodies())
    if kind == "linear":
        return along(output, seen, reduce(add, (b.v * b.mass for b in bodies)))
    arms = [b.x for b in bodies]
    if about == "center_of_mass":
        o = center(bodies, seen)
        arms = [x - o for x in arms]
    moments = (b.spin + seen.pairs.skew(r) @ b.v * b.mass for b, r in zip(bodies, arms, strict=True))
    return along(output, seen, reduce(add, moments))


def distance(output: Output, seen: Seen) -> Pair:
    """The distance |x_2 - x_1| of two points.

    Raises
    ------
    ValueError
        If the points coincide and a derivative is needed.
    """
    first, second = (seen.point(p)[0] for p in output.points)
    line = second - first
    square = seen.pairs.dot(line, line)
    if square.value == 0 and seen.pairs.k:
        raise ValueError(f"output {output.name}: its two points coincide, so their distance has no derivative")
    return seen.pairs.call("sqrt", square)


def value(output: Output, seen: Seen) -> Pair:
    """The value of an output that is an expression."""
    assert output.expression is not None
    return seen.pairs.expression(output.expression)


VALUES: Final[dict[str, Callable[[Output, Seen], Pair]]] = {
    "position": of_points(0),
    "velocity": of_points(1),
    "rotation": rotation,
    "angular_velocity": angular_velocity,
    "acceleration": acceleration,
    "center_of_mass": center_of_mass,
    "momentum": momentum,
    "distance": distance,
    "relative_position": of_points(0),
    "relative_velocity": of_points(1),
    "driving_force": lambda output, seen: seen.driving_forces()[output.choice[0]][0, 0],
    "value": value,
    "kinetic_energy": lambda _, seen: seen.energies()[0][0, 0],
    "potential_energy": lambda _, seen: seen.energies()[1][0, 0],
}
"""Functions that compute outputs, by the name of the measure."""
