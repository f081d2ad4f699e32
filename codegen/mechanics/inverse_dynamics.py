"""Inverse dynamics with given udot, and its tangent: the right side of the balance.

Forward dynamics is ``M udot = K``; so ``M dudot = d(K - M udot)`` at fixed udot (Eq. 9 without constraints), and the right
side is minus the tangent of the inverse dynamics at the acceleration just found. It has vectors only.
"""

from __future__ import annotations

from typing import Any

from sympy import Expr, Symbol

from ..program.derivatives import Tangents
from .joints import JointTransform, freedom_axes
from .kinematics import (
    accelerate,
    acceleration_matrix,
    angular_velocity,
    body_force,
    load_vector,
    store_matrix,
    store_vector,
)
from .spatial import NINE, XYZ, Vec, add
from .triangularization import force_to_parent, hand_on_force


def joint_acceleration(x: Any, kind: Any, al: Vec, a: Vec) -> tuple[Vec, Vec]:
    """Add the joint's own udot. Eq. 19."""
    A = list(al) + list(a)
    for j, i in enumerate(freedom_axes(kind.joint, kind.axis)):
        A[i] = x.let(f"A{i}", A[i] + x.load("udot", str(j)), "Eq. 19")
    return A[:3], A[3:]


def newton_euler_outward(x: Any, kind: Any) -> None:
    """Total accelerations and the force each link's inertia needs. Eqs. 19, 24."""
    joint = JointTransform(x, kind)
    carried, w = angular_velocity(x, kind, joint)
    al, a = joint_acceleration(x, kind, *accelerate(x, kind, joint, carried, "t"))
    B = acceleration_matrix(x, w, al)
    moment, force = body_force(x, w, al, a, B)
    x.recall({"wp": carried, "w": w})
    store_vector(x, "me", "tal", al)
    store_vector(x, "me", "ta", a)
    store_matrix(x, "me", "tB", B)
    store_vector(x, "me", "tn", moment)
    store_vector(x, "me", "tf", force)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for name, v in (("w", w), ("al", al), ("a", a)):
            store_tangent(x, d, "lme", name, v)
        for name in NINE:
            entry = B[XYZ.index(name[0])][XYZ.index(name[1])]
            x.store("lme", f"B.{name}", d.value(entry) if d else entry)
        store_tangent(x, d, "lane", "n", moment)
        store_tangent(x, d, "lane", "f", force)


def store_tangent(x: Any, d: Tangents | None, array: str, name: str, v: Vec) -> None:
    """Store the tangent of a vector; on zero patterns the tangent is zero where the vector is."""
    for k, i in enumerate(XYZ):
        x.store(array, f"{name}.{i}", d.value(v[k]) if d else v[k])


UP_TANGENTS = {
    "w": "w", "tal": "al", "ta": "a", "tB": "B", "v": "v", "T": "T", "pos": "pos", "W": "W",
}  # fmt: skip
"""Fields of the parent that have a tangent, and the name of it."""


def seeds(x: Any, kind: Any) -> dict[Symbol, Expr]:
    """Tangents of everything that the block has loaded."""
    result: dict[Symbol, Expr] = {}
    for symbol, (array, name) in list(x.block.loads.items()):
        stem, _, component = name.partition(".")
        if array == "up" and stem in UP_TANGENTS:
            result[symbol] = x.load("lup", f"{UP_TANGENTS[stem]}.{component}" if component else UP_TANGENTS[stem])
        elif array == "u":
            result[symbol] = x.load("du", name)
        elif array == "q":
            result[symbol] = x.load("dq", name)
        elif array == "turn":
            result[symbol] = x.load("dq", "0") if kind.joint == "revolute" else x.load("lane", f"turn.{name}")
    for j in range(kind.parameters):
        result[x.load("parameter", str(j))] = x.load("dp", str(j))
    return {s: v for s, v in result.items() if v != 0}


def constants_transparent(x: Any, kind: Any) -> dict[Symbol, dict[Symbol, Expr]]:
    """A link's constants as functions of the design parameters that they depend on."""
    result: dict[Symbol, dict[Symbol, Expr]] = {}
    for symbol, (array, name) in list(x.block.loads.items()):
        if array == "c" and "/" not in name:
            result[symbol] = {
                x.load("parameter", str(j)): x.load("c", f"{name}/{j}") for j in range(kind.parameters)
            }
    return {s: {r: v for r, v in inner.items() if v != 0} for s, inner in result.items()}


def differentiate(x: Any, kind: Any, joint: JointTransform | None, extra: dict[Symbol, Expr] | None = None) -> Tangents | None:
    """Append the tangents of all statements so far. None on zero patterns."""
    if x.structural:
        return None
    statements = list(x.block.statements)
    transparent = joint.transparent() if joint else {}
    transparent |= constants_transparent(x, kind)
    d = Tangents(x, seeds(x, kind) | (extra or {}), transparent)
    for statement in statements:
        d.statement(statement)
    return d


def newton_euler_inward(x: Any, kind: Any) -> None:
    """Forces transmitted by the joints; their components along the freedoms are the joint forces."""
    let = x.let
    joint = JointTransform(x, kind)
    own = [("n", "n"), ("f", "f")]
    phi: Vec = []
    d_phi: Vec = []
    for field, name in own:
        for i in XYZ:
            key = f"{field}.{i}"
            phi.append(let(f"phi_{name}", x.load("me", f"t{key}") + x.load("me", f"tacc.{key}"), "Eq. 45"))
            if x.tangents:
                d_phi.append(let("dphi", x.load("lane", key) + x.load("lme", f"acc.{key}"), "d Eq. 45", lanes=True))
    for j, i in enumerate(freedom_axes(kind.joint, kind.axis)):
        x.store("force", str(j), phi[i])
        if x.tangents:
            x.store("dforce", str(j), d_phi[i])
    if kind.carried_on:
        transfer(x, kind, joint, phi, d_phi)


def transfer(x: Any, kind: Any, joint: JointTransform, phi: Vec, d_phi: Vec) -> None:
    """Hand the transmitted force on to the parent, and its tangent."""
    r = joint.offset()
    named = [x.name(f"phi{i}", value, "Eq. 45") for i, value in enumerate(phi)]
    n, f = force_to_parent(x, joint, r, named[:3], named[3:], "Eq. 45")
    if x.tangents:
        if x.structural:
            moved = force_to_parent(x, joint, r, d_phi[:3], d_phi[3:], "")
            tn, tf = add(n, moved[0]), add(f, moved[1])
        else:
            extra = {s: v for s, v in zip(named, d_phi, strict=True) if v != 0}
            d = differentiate(x, kind, joint, extra)
            assert d is not None
            tn, tf = [d.value(v) for v in n], [d.value(v) for v in f]
        hand_on_force(x, kind, n, f, "tacc")
        hand_on_lanes(x, kind, tn, tf)
    else:
        hand_on_force(x, kind, n, f, "tacc")


def hand_on_lanes(x: Any, kind: Any, n: Vec, f: Vec) -> None:
    from .triangularization import accumulate

    for k, i in enumerate(XYZ):
        accumulate(x, kind, f"acc.n.{i}", n[k], array="lup", lanes=True)
        accumulate(x, kind, f"acc.f.{i}", f[k], array="lup", lanes=True)


def differentiate_phi(x: Any) -> None:
    """Placeholder for readers: the tangent of `newton_euler_inward` is made by `transfer`."""


__all__ = ["load_vector", "newton_euler_inward", "newton_euler_outward", "transfer"]
