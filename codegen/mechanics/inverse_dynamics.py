"""Inverse dynamics with given udot, and its tangent: the right side of the balance.

Forward dynamics is ``M udot = K``; so ``M dudot = d(K - M udot)`` at fixed udot (Eq. 9 without constraints), and the right
side is minus the tangent of the inverse dynamics at the acceleration just found. It has vectors only.
"""

from __future__ import annotations

from typing import Any

from .joints import JointTransform, freedom_axes
from .kinematics import (
    accelerate,
    acceleration_matrix,
    angular_velocity,
    body_force,
    less_external,
    own_inertia,
    store_matrix,
    store_vector,
)
from .spatial import NINE, XYZ, Vec
from .tangents import differentiate, pattern, store_tangent, tangent
from .triangularization import accumulate, force_to_parent, hand_on_force


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
    moment, force = needed = body_force(x, w, al, a, B, own_inertia(x))
    x.recall({"wp": carried, "w": w})
    store_vector(x, "me", "tal", al)
    store_vector(x, "me", "ta", a)
    store_matrix(x, "me", "tB", B)
    left = less_external(x, kind, needed)
    store_vector(x, "me", "tn", left[0])
    store_vector(x, "me", "tf", left[1])
    if x.tangents:
        d = differentiate(x, kind, joint)
        for name, v in (("w", w), ("al", al), ("a", a)):
            store_tangent(x, d, "lme", name, v)
        for name in NINE:
            entry = B[XYZ.index(name[0])][XYZ.index(name[1])]
            x.store("lme", f"B.{name}", tangent(d, entry))
        tangents = [[tangent(d, e) for e in v] for v in (moment, force)]
        tangents = list(less_external(x, kind, (tangents[0], tangents[1]), "lane", True))
        store_vector(x, "lane", "n", tangents[0])
        store_vector(x, "lane", "f", tangents[1])


def newton_euler_inward(x: Any, kind: Any) -> None:
    """Forces transmitted by the joints; their components along the freedoms are the joint forces."""
    let = x.let
    joint = JointTransform(x, kind)
    phi: Vec = []
    d_phi: Vec = []
    for field in ("n", "f"):
        for i in XYZ:
            key = f"{field}.{i}"
            phi.append(let(f"phi_{field}", x.load("me", f"t{key}") + x.load("me", f"tacc.{key}"), "Eq. 45"))
            if x.tangents:
                d_phi.append(let("dphi", x.load("lane", key) + x.load("lme", f"acc.{key}"), "d Eq. 45", lanes=True))
    for j, a in enumerate(freedom_axes(kind.joint, kind.axis)):
        x.store("force", str(j), phi[a])
        if x.tangents:
            x.store("dforce", str(j), d_phi[a])
    if kind.carried_on:
        transfer(x, kind, joint, phi, d_phi)


def transfer(x: Any, kind: Any, joint: JointTransform, phi: Vec, d_phi: Vec, beside: Vec | None = None) -> None:
    """Hand the transmitted force on to the parent, and its tangent, with what the parent gets `beside` as a partner."""
    r = joint.offset()
    named = [x.name(f"phi{i}", value, "Eq. 45") for i, value in enumerate(phi)]
    n, f = force_to_parent(x, joint, r, named[:3], named[3:], "Eq. 45")
    if x.tangents:
        if x.structural:
            moved = force_to_parent(x, joint, r, d_phi[:3], d_phi[3:], "")
            tn, tf = ([pattern(a) + b for a, b in zip(v, w, strict=True)] for v, w in zip((n, f), moved, strict=True))
        else:
            extra = {s: v for s, v in zip(named, d_phi, strict=True) if v != 0}
            d = differentiate(x, kind, joint, extra)
            assert d is not None
            tn, tf = [d.value(v) for v in n], [d.value(v) for v in f]
        if beside is not None:
            tn, tf = (
                [x.let("beside", a + b, "d Eq. 45", lanes=True) for a, b in zip(v, w, strict=True)]
                for v, w in ((tn, beside[:3]), (tf, beside[3:]))
            )
        hand_on_force(x, kind, n, f, "tacc")
        hand_on_lanes(x, kind, tn, tf)
    else:
        hand_on_force(x, kind, n, f, "tacc")


def hand_on_lanes(x: Any, kind: Any, n: Vec, f: Vec) -> None:
    """Add a tangent, or the bias force of a solve, to what the parent collects."""
    for k, i in enumerate(XYZ):
        accumulate(x, kind, f"acc.n.{i}", n[k], array="lup", lanes=True)
        accumulate(x, kind, f"acc.f.{i}", f[k], array="lup", lanes=True)
