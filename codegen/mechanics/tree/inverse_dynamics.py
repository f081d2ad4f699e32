"""Inverse dynamics with given udot, and its tangent: the right side of the balance.

Forward dynamics is ``M udot = K``; so ``M dudot = d(K - M udot)`` at fixed udot (Eq. 9 without constraints), and the right
side is minus the tangent of the inverse dynamics at the acceleration just found. It contains vectors only.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...program import algebra
from ...program.algebra import Symbol
from ...program.block import Expansion, Scope
from ...program.scalar import Value, Vector
from ...program.store import Store
from .. import fields
from ..joints import LinkJoint
from ..propagation import accumulate_force
from ..rotors import rotor, rotor_force_change
from ..spatial import add, is_zero
from ..stores import DFORCE, FORCE, LME, LUP, ME, MY_LANE, TAU, UDOT, UP
from ..structure.kinds import LinkKind
from .kinematics import accelerate, acceleration_matrix, angular_velocity, body_force, less_external, own_inertia
from .tangents import differentiate, pattern, store_tangents, tangent
from .triangularization import force_to_parent, is_first


def joint_acceleration(x: Scope, joint: LinkJoint, al: Vector, a: Vector) -> tuple[Vector, Vector]:
    """Add the acceleration due to the joint's own udot. Eq. 19."""
    A = list(al) + list(a)
    for j, s in enumerate(joint.columns):
        for i, value in s.added(A, joint.x.entry(UDOT, j)).items():
            A[i] = x.let(f"A{i}", value, "Eq. 19")
    return A[:3], A[3:]


def found_acceleration(x: Scope, store: Store, al: Vector, a: Vector) -> tuple[Vector, Vector, dict[Symbol, Value]]:
    """Accelerations of a link as forward dynamics found them, and a map from their symbols to the equal values in `al`
    and `a`.

    Forward dynamics solves for udot and the accelerations together. Accelerations that are sums of udot alone would
    contain the errors of every inboard udot. These errors are large relative to the accelerations at the end of a long
    chain.
    """
    same: dict[Symbol, Value] = {}
    found: list[Vector] = []
    parts = (
        (al, fields.remainder.al, fields.explicit_acceleration.angular),
        (a, fields.remainder.a, fields.explicit_acceleration.linear),
    )
    for v, rest, explicit in parts:
        found.append([])
        for computed, e in zip(v, add(x.load(store, rest), x.load(store, explicit)), strict=True):
            value = e if is_zero(e) else x.name("A", e, "Eq. 19")
            if isinstance(value, Symbol):
                same[value] = computed
            found[-1].append(value)
    if isinstance(x, Expansion):
        x.equal |= {s: algebra.expression(v) for s, v in same.items()}
    return found[0], found[1], same


def balance_start(x: Scope, kind: LinkKind) -> None:
    """`newton_euler_outward` at the udot of forward dynamics; for links with children, also at its accelerations."""
    newton_euler_outward(x, kind, kind.carries)


def newton_euler_outward(x: Scope, kind: LinkKind, found: bool = False) -> None:
    """Total acceleration of each link at given udot, and the force that its inertia requires. Eqs. 19, 24."""
    joint = kind.joint(x, kind)
    carried, w = angular_velocity(x, joint)
    al, a = joint_acceleration(x, joint, *accelerate(x, joint, carried, fields.total))
    same: dict[Symbol, Value] = {}
    if found:
        al, a, same = found_acceleration(x, ME, al, a)
    B = acceleration_matrix(x, w, al)
    needed = body_force(x, w, al, a, B, own_inertia(x))
    x.recall(ME, fields.parents_velocity, carried)
    x.recall(ME, fields.angular_velocity, w)
    x.store(ME, fields.total.al, al)
    x.store(ME, fields.total.a, a)
    x.store(ME, fields.total.B, B)
    x.store(ME, fields.total_needed, less_external(x, kind, needed))
    if x.tangents:
        d = differentiate(x, kind, joint, same=same)
        motion = fields.remainder
        store_tangents(x, d, (LME,), ((motion.w, w), (motion.al, al), (motion.a, a), (motion.B, B)))
        x.store(MY_LANE, fields.needed, less_external(x, kind, [tangent(d, e) for e in needed], lanes=True))


def missing_forces(x: Scope, kind: LinkKind) -> None:
    """`newton_euler_inward` minus the model's own joint forces; the result is zero for the udot of forward dynamics."""
    newton_euler_inward(x, kind, [x.entry(TAU, j) if forced else 0 for j, forced in enumerate(kind.forced)])


def newton_euler_inward(x: Scope, kind: LinkKind, known: Sequence[Value] = ()) -> None:
    """Forces transmitted by the joints. The components along the degrees of freedom, minus known joint forces, are the joint
    forces of the inverse dynamics."""
    let = x.let
    joint = kind.joint(x, kind)
    phi: Vector = []
    d_phi: Vector = []
    for i in range(6):
        own, children = x.load(ME, fields.total_needed.scalars()[i]), x.load(ME, fields.transmitted.scalars()[i])
        phi.append(let(f"phi_{'nf'[i // 3]}", own + children, "Eq. 45"))
        if x.tangents:
            d_own, d_children = (
                x.load(MY_LANE, fields.needed.scalars()[i]),
                x.load(LME, fields.articulated_force.scalars()[i]),
            )
            d_phi.append(let("dphi", d_own + d_children, "d Eq. 45", lanes=True))
    for j, s in enumerate(joint.columns):
        along, own = s.along(phi), rotor(x, kind, j)
        force = along if is_zero(own) else along + own * x.entry(UDOT, j)
        x.set_entry(FORCE, j, force - known[j] if known else force)
        if x.tangents:
            x.set_entry(DFORCE, j, s.along(d_phi) + s.change(x, phi) + rotor_force_change(x, kind, j))
    if kind.has_parent:
        transfer(x, kind, joint, phi, d_phi)


def transfer(
    x: Scope, kind: LinkKind, joint: LinkJoint, phi: Vector, d_phi: Vector, beside: Vector | None = None
) -> None:
    """Propagate the transmitted force and its tangent to the parent. If the parent is also a partner of the link, `beside`
    is the link's contribution to the tangent of the force on this partner."""
    r = joint.offset()
    named = [x.name(f"phi{i}", value, "Eq. 45") for i, value in enumerate(phi)]
    force = force_to_parent(x, joint, named, "Eq. 45", r)
    moved: Vector = []
    if x.tangents and x.structural:
        moved = add([pattern(v) for v in force], force_to_parent(x, joint, d_phi, "", r))
    elif x.tangents:
        extra = {s: v for s, v in zip(named, d_phi, strict=True) if isinstance(s, Symbol)}
        d = differentiate(x, kind, joint, extra)
        assert d is not None
        moved = [d.value(v) for v in force]
    if beside is not None:
        moved = [x.let("beside", v, "d Eq. 45", lanes=True) for v in add(moved, beside)]
    accumulate_force(x, UP, fields.transmitted, force, is_first(x, kind), "Eq. 45")
    if x.tangents:
        propagate_lanes(x, kind, moved)


def propagate_lanes(x: Scope, kind: LinkKind, force: Vector) -> None:
    """Propagate a force over directions, such as a tangent or the bias force of a solution, to the parent's sum."""
    accumulate_force(x, LUP, fields.articulated_force, force, is_first(x, kind), "Eq. 45", lanes=True)
