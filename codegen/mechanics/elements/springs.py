"""Springs and dampers between two points: forces on the links that carry them, their tangents and their energy.

The points are followed in the ground frame; a link gets force and moment about its origin in its own axes, as fields ``ext`` that
the kinematic sweep takes off the force that the link's motion needs.
"""

from __future__ import annotations

from sympy import Symbol

from ...program.block import Expansion, Scope
from ...program.derivatives import Tangents
from ...program.scalar import Value, Vector
from ...program.store import Store
from .. import fields, handing_on
from ..spatial import add, cross, dot, matvec, transpose
from ..stores import (
    COEFFICIENT,
    CS_DP,
    CS_PARAMETER,
    DCOEFFICIENT,
    DPOTENTIAL,
    LANE_ONE,
    LANE_TWO,
    LME,
    ME,
    MY_LANE,
    ONE,
    PIVOT,
    POTENTIAL,
    SPRING_CONSTANTS,
    TWO,
)
from ..structure.kinds import LinkKind, SpringKind
from ..tree.kinematics import angular_velocity, origin_velocity
from ..tree.tangents import differentiate, store_tangent, tangent

ENDS, LANE_ENDS = (ONE, TWO), (LANE_ONE, LANE_TWO)

SHORTEST = 1e-100
"""Of a spring, m, that has a direction: squares of what is divided by its length stay finite."""


def velocities(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: angular velocity and velocity of the origin, in its own axes. Eq. 18."""
    joint = kind.joint(x, kind)
    _, w = angular_velocity(x, joint, fields.spring_twist.angular)
    v = origin_velocity(x, joint, fields.spring_twist.angular, fields.spring_twist.linear)
    x.store(ME, fields.spring_twist.angular, w)
    x.store(ME, fields.spring_twist.linear, v)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for store in (LME, MY_LANE):
            store_tangent(x, d, (store,), fields.spring_twist.angular, w)
            store_tangent(x, d, (store,), fields.spring_twist.linear, v)


def clear(x: Scope, kind: LinkKind) -> None:
    """No force acts yet."""
    handing_on.clear(x, ME, fields.external)


def clear_tangents(x: Scope, kind: LinkKind) -> None:
    """Nor do any tangents."""
    handing_on.clear(x, MY_LANE, fields.external)


def stretch(x: Scope, kind: SpringKind, directed: bool = True) -> tuple[Vector, Value, list[Vector]]:
    """From the first point to the second in the ground frame, the distance, and the points in the components of their links.

    `directed`: without length the spring has no direction, nor its length a derivative, which is an error.
    """
    points: list[Vector] = []
    arms: list[Vector] = []
    for side, end in enumerate(ENDS):
        r = x.load(SPRING_CONSTANTS, fields.face_place("AB"[side]))
        arms.append(r)
        moved = matvec(x.load(end, fields.attitude), r)
        points.append([x.let("point", e, "spring") for e in add(x.load(end, fields.position), moved)])
    line = [x.let("line", points[1][i] - points[0][i], "spring") for i in range(3)]
    square = x.let("square", dot(line, line), "spring")
    if directed:
        x.set_entry(PIVOT, 0, square - x.number(SHORTEST**2))
    return line, x.let("length", x.sqrt(square), "spring"), arms


def point_velocity(x: Scope, end: Store, r: Vector) -> Vector:
    """Velocity of a point of a link in the ground frame."""
    own = add(x.load(end, fields.spring_twist.linear), cross(x.load(end, fields.spring_twist.angular), r))
    own = [x.let("own", e, "spring") for e in own]
    return [x.let("speed", e, "spring") for e in matvec(x.load(end, fields.attitude), own)]


def springs(x: Scope, kind: SpringKind) -> None:
    """The forces of a spring on the two links."""
    line, length, arms = stretch(x, kind)
    velocities_ = [point_velocity(x, end, r) for end, r in zip(ENDS, arms, strict=True)]
    inverse = x.let("inverse", 1 / length, "spring")
    along = [x.let("along", e * inverse, "spring") for e in line]
    rate = x.let("rate", dot(along, [velocities_[1][i] - velocities_[0][i] for i in range(3)]), "spring")
    stiffness, damping, free = (x.entry(COEFFICIENT, j) for j in range(3))
    pull = x.let("pull", stiffness * (length - free) + damping * rate, "spring")
    force = [x.let("force", pull * e, "spring") for e in along]
    acting: list[Vector | None] = []
    for side, end in enumerate(ENDS):
        if kind.grounded[side]:
            acting.append(None)
            continue
        given = force if side == 0 else [-e for e in force]
        own = [x.let("acting", e, "spring") for e in matvec(transpose(x.load(end, fields.attitude)), given)]
        moment = [x.let("moment", e, "spring") for e in cross(arms[side], own)]
        acting.append([*moment, *own])
        if not x.tangents:
            x.store(end.sum, fields.external, [*moment, *own])
    if x.tangents:
        d = _tangents(x, kind)
        for end, found in zip(LANE_ENDS, acting, strict=True):
            if found is not None:
                x.store(end.sum, fields.external, [tangent(d, e) for e in found])


def spring_energy(x: Scope, kind: SpringKind) -> None:
    """Half of stiffness times the square of what the spring is longer than free."""
    _, length, _ = stretch(x, kind, directed=x.tangents)
    more = x.let("more", length - x.entry(COEFFICIENT, 2), "spring")
    energy = x.let("V", x.half * x.entry(COEFFICIENT, 0) * more * more, "spring")
    x.set_entry(POTENTIAL.sum, 0, energy)
    if x.tangents:
        d = _tangents(x, kind)
        x.set_entry(DPOTENTIAL.sum, 0, tangent(d, energy))


def _tangents(x: Scope, kind: SpringKind) -> Tangents | None:
    """Tangents of all statements so far."""
    if not isinstance(x, Expansion):
        return None
    seeds: dict[Symbol, Value] = {}
    transparent: dict[Symbol, dict[Symbol, Value]] = {}
    for symbol, (store, name) in list(x.block.loads.items()):
        if store in ENDS:
            seeds[symbol] = x.component(LANE_ENDS[ENDS.index(store)], name)
        elif store is COEFFICIENT:
            seeds[symbol] = x.component(DCOEFFICIENT, name)
        elif store is SPRING_CONSTANTS and "/" not in name:
            inner = {}
            for j in range(kind.parameters):
                value = x.component(SPRING_CONSTANTS, f"{name}/{j}")
                if value != 0:
                    root = x.entry(CS_PARAMETER, j)
                    inner[root] = value
                    seeds[root] = x.entry(CS_DP, j)
            if inner:
                transparent[symbol] = inner
    d = Tangents(x, {s: v for s, v in seeds.items() if v != 0}, transparent)
    for statement in list(x.block.statements):
        d.statement(statement)
    return d
