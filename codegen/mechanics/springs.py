"""Springs and dampers between two points: forces on the links that carry them, their tangents and their energy.

The points are followed in the ground frame; a link gets force and moment about its origin in its own axes, as fields ``ext`` that
the kinematic sweep takes off the force that the link's motion needs.
"""

from __future__ import annotations

from typing import Any

import sympy

from ..program.block import ANY
from ..program.derivatives import Tangents
from .energy import origin_velocity
from .joints import JointTransform
from .kinematics import angular_velocity, load_matrix, load_vector, store_vector
from .spatial import XYZ, Vec, add, cross, dot, matvec, transpose
from .tangents import differentiate, store_tangent, tangent

SIDES = ("one", "two")

SHORTEST = 1e-100
"""Of a spring, m, that has a direction: squares of what is divided by its length stay finite."""


def velocities(x: Any, kind: Any) -> None:
    """Outward block of a link: angular velocity and velocity of the origin, in its own axes. Eq. 18."""
    joint = JointTransform(x, kind)
    _, w = angular_velocity(x, kind, joint, "vw")
    v = origin_velocity(x, kind, joint, "vw", "vv")
    store_vector(x, "me", "vw", w)
    store_vector(x, "me", "vv", v)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for array in ("lme", "lane"):
            store_tangent(x, d, array, "vw", w)
            store_tangent(x, d, array, "vv", v)


def clear(x: Any, kind: Any) -> None:
    """No force acts yet."""
    for name in ("n", "f"):
        store_vector(x, "me", f"ext.{name}", [0, 0, 0])


def clear_tangents(x: Any, kind: Any) -> None:
    """Nor do any tangents."""
    for name in ("n", "f"):
        store_vector(x, "lane", f"ext.{name}", [0, 0, 0])


def _length(x: Any, square: Any) -> Any:
    return ANY if x.structural else x.let("length", sympy.sqrt(square), "spring")


def stretch(x: Any, kind: Any, directed: bool = True) -> tuple[Vec, Any, list[Vec]]:
    """From the first point to the second in the ground frame, the distance, and the points in the components of their links.

    `directed`: without length the spring has no direction, nor its length a derivative, which is an error.
    """
    points: list[Vec] = []
    arms: list[Vec] = []
    for side, array in enumerate(SIDES):
        r = [x.load("cs", f"{'AB'[side]}.r.{i}") for i in XYZ]
        arms.append(r)
        moved = matvec(load_matrix(x, array, "W"), r)
        points.append([x.let("point", e, "spring") for e in add(load_vector(x, array, "pos"), moved)])
    line = [x.let("line", points[1][i] - points[0][i], "spring") for i in range(3)]
    square = x.let("square", dot(line, line), "spring")
    if directed:
        x.store("pivot", "0", square if x.structural else square - SHORTEST**2)
    return line, _length(x, square), arms


def point_velocity(x: Any, array: str, r: Vec) -> Vec:
    """Velocity of a point of a link in the ground frame."""
    own = add(load_vector(x, array, "vv"), cross(load_vector(x, array, "vw"), r))
    own = [x.let("own", e, "spring") for e in own]
    return [x.let("speed", e, "spring") for e in matvec(load_matrix(x, array, "W"), own)]


def springs(x: Any, kind: Any) -> None:
    """The forces of a spring on the two links."""
    line, length, arms = stretch(x, kind)
    velocities_ = [point_velocity(x, array, r) for array, r in zip(SIDES, arms, strict=True)]
    inverse = x.let("inverse", 1 / length, "spring")
    along = [x.let("along", e * inverse, "spring") for e in line]
    rate = x.let("rate", dot(along, [velocities_[1][i] - velocities_[0][i] for i in range(3)]), "spring")
    stiffness, damping, free = (x.load("coefficient", str(j)) for j in range(3))
    pull = x.let("pull", stiffness * (length - free) + damping * rate, "spring")
    force = [x.let("force", pull * e, "spring") for e in along]
    acting: list[tuple[Vec, Vec] | None] = []
    for side, array in enumerate(SIDES):
        if kind.grounded[side]:
            acting.append(None)
            continue
        given = force if side == 0 else [-e for e in force]
        own = [x.let("acting", e, "spring") for e in matvec(transpose(load_matrix(x, array, "W")), given)]
        moment = [x.let("moment", e, "spring") for e in cross(arms[side], own)]
        acting.append((moment, own))
        if not x.tangents:
            for name, v in (("n", moment), ("f", own)):
                for k, i in enumerate(XYZ):
                    x.store(f"{array}_sum", f"ext.{name}.{i}", v[k])
    if x.tangents:
        d = _tangents(x, kind)
        for side, array in enumerate(SIDES):
            found = acting[side]
            if found is not None:
                for name, v in zip(("n", "f"), found, strict=True):
                    for k, i in enumerate(XYZ):
                        x.store(f"lane{array}_sum", f"ext.{name}.{i}", tangent(d, v[k]))


def spring_energy(x: Any, kind: Any) -> None:
    """Half of stiffness times the square of what the spring is longer than free."""
    _, length, _ = stretch(x, kind, directed=x.tangents)
    more = x.let("more", length - x.load("coefficient", "2"), "spring")
    half = 1 if x.structural else sympy.Rational(1, 2)
    energy = x.let("V", half * x.load("coefficient", "0") * more * more, "spring")
    x.store("potential_sum", "0", energy)
    if x.tangents:
        d = _tangents(x, kind)
        x.store("dpotential_sum", "0", tangent(d, energy))


def _tangents(x: Any, kind: Any) -> Tangents | None:
    """Tangents of all statements so far."""
    if x.structural:
        return None
    seeds: dict[Any, Any] = {}
    transparent: dict[Any, dict[Any, Any]] = {}
    for symbol, (array, name) in list(x.block.loads.items()):
        if array in SIDES:
            seeds[symbol] = x.load(f"lane{array}", name)
        elif array == "coefficient":
            seeds[symbol] = x.load("dcoefficient", name)
        elif array == "cs" and "/" not in name:
            inner = {}
            for j in range(kind.parameters):
                value = x.load("cs", f"{name}/{j}")
                if value != 0:
                    root = x.load("csparameter", str(j))
                    inner[root] = value
                    seeds[root] = x.load("csdp", str(j))
            if inner:
                transparent[symbol] = inner
    d = Tangents(x, {s: v for s, v in seeds.items() if v != 0}, transparent)
    for statement in list(x.block.statements):
        d.statement(statement)
    return d


__all__ = ["clear", "clear_tangents", "spring_energy", "springs", "velocities"]
