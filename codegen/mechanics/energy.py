"""Kinetic and potential energy, and where links are in the ground frame."""

from __future__ import annotations

from typing import Any

from sympy import Rational

from .joints import JointTransform
from .kinematics import (
    angular_velocity,
    load_matrix,
    load_symmetric,
    load_vector,
    store_matrix,
    store_vector,
)
from .spatial import XYZ, Vec, add, cross, dot, matmul, matvec, scale
from .tangents import differentiate, store_tangent, tangent
from .triangularization import accumulate


def kinetic(x: Any, kind: Any) -> None:
    """Velocity of the link's origin and the link's kinetic energy, half of velocity times momentum."""
    joint = JointTransform(x, kind)
    _, w = angular_velocity(x, kind, joint)
    v = origin_velocity(x, kind, joint)
    m = x.load("c", "m")
    h = load_vector(x, "c", "h")
    J = load_symmetric(x, "c", "J")
    angular = [x.let("L", e, "Eq. 23") for e in add(matvec(J, w), cross(h, v))]
    linear = [x.let("P", e, "Eq. 23") for e in add(scale(m, v), cross(w, h))]
    twice = x.let("T2", dot(w, angular) + dot(v, linear), "kinetic energy")
    half = 1 if x.structural else Rational(1, 2)
    T = x.let("T", half * twice, "kinetic energy")
    store_vector(x, "me", "w", w)
    store_vector(x, "me", "v", v)
    x.store("energy_sum", "0", T)
    if x.tangents:
        d = differentiate(x, kind, joint)
        store_tangent(x, d, "lme", "w", w)
        store_tangent(x, d, "lme", "v", v)
        store_tangent(x, d, "lane", "w", w)
        store_tangent(x, d, "lane", "v", v)
        x.store("denergy_sum", "0", tangent(d, T))


def origin_velocity(x: Any, kind: Any, joint: JointTransform, w: str = "w", v_field: str = "v") -> Vec:
    """Velocity of the link's origin in its own axes. Eq. 18."""
    moved = add(load_vector(x, "up", v_field), cross(load_vector(x, "up", w), joint.offset()))
    v = joint.to_child(moved, "v", "Eq. 18")
    if kind.joint == "prismatic":
        v = list(v)
        v[kind.axis] = x.let("v", v[kind.axis] + x.load("u", "0"), "Eq. 18")
    elif kind.joint == "free":
        v = [x.let("v", v[k] + x.load("u", str(3 + k)), "Eq. 18") for k in range(3)]
    return v


def moments(x: Any, kind: Any) -> None:
    """Mass and first moment of the link and all outboard of it, about the parent's origin."""
    joint = JointTransform(x, kind)
    m = x.let("m", x.load("c", "m") + x.load("me", "sum.m"), "potential energy")
    h = add(load_vector(x, "c", "h"), load_vector(x, "me", "sum.h"))
    h = joint.to_parent(h, "h", "potential energy")
    h = [x.let("h", e, "potential energy") for e in add(h, scale(m, joint.offset()))]
    d = differentiate(x, kind, joint, _sums(x)) if x.tangents else None
    accumulate(x, kind, "sum.m", m)
    for k, i in enumerate(XYZ):
        accumulate(x, kind, f"sum.h.{i}", h[k])
    if x.tangents:
        accumulate(x, kind, "sum.m", tangent(d, m), array="lup", lanes=True)
        for k, i in enumerate(XYZ):
            accumulate(x, kind, f"sum.h.{i}", tangent(d, h[k]), array="lup", lanes=True)


def _sums(x: Any) -> dict[Any, Any]:
    """Tangents of what the children handed on."""
    if x.structural:
        return {}
    found = {
        symbol: x.load("lme", name)
        for symbol, (array, name) in list(x.block.loads.items())
        if array == "me" and name.startswith("sum.")
    }
    return {s: v for s, v in found.items() if v != 0}


def pose(x: Any, kind: Any) -> None:
    """Position of the link's origin and its rotation matrix (ground from link components)."""
    joint = JointTransform(x, kind)
    W = load_matrix(x, "up", "W")
    position = add(load_vector(x, "up", "pos"), matvec(W, joint.offset()))
    position = [x.let(f"pos_{i}", position[k], "Eq. 22") for k, i in enumerate(XYZ)]
    if joint.fixed is not None:
        W = [[x.let("W", e, "Eq. 22") for e in row] for row in matmul(W, joint.fixed)]
    if kind.joint in ("spherical", "free"):
        W = [[x.let("W", e, "Eq. 22") for e in row] for row in matmul(W, joint.matrix)]
    elif kind.joint == "revolute":
        c, s = joint.trig
        i, j = (kind.axis + 1) % 3, (kind.axis + 2) % 3
        W = [list(row) for row in W]
        for row in W:
            row[i], row[j] = (
                x.let("W", c * row[i] + s * row[j], "Eq. 22"),
                x.let("W", c * row[j] - s * row[i], "Eq. 22"),
            )
    store_vector(x, "me", "pos", position)
    store_matrix(x, "me", "W", W)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for array in ("lme", "lane"):
            store_tangent(x, d, array, "pos", position)
            for i in range(3):
                for j in range(3):
                    x.store(array, f"W.{XYZ[i]}{XYZ[j]}", tangent(d, W[i][j]))
