"""Tangents of reactions, once the balance has found the tangent of udot. Section 6 of the theory page.

Outward, the contribution of the change of udot, which the balance held, is added to the force that every link's motion
requires. Inward, these forces are summed as in the balance, along the links' own axes. A loop's wrench changes with the
directions that its joint constrains, and with its multipliers W. The stored factor gives the change of the multipliers
from ``E^T dW = -dgamma``, where dgamma is the residual of the dependent joints with W held. Where conditions are
redundant, W is the shortest wrench, ``W = E z``, and the part of ``dE z`` that is normal to all columns of E is added
to dW.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..couplings import add_partner_force, others
from ..joints import LinkJoint
from ..propagation import accumulate
from ..spatial import SIX, about, add, inner, is_zero, product, transpose, turned
from ..stores import (
    BASE,
    DLOOP_REACTION,
    DREACTION,
    DUDOT,
    LANE_BASE,
    LBASE,
    LME,
    LREGION,
    LROOTS,
    LUP,
    ME,
    MY_LANE,
    REGION,
)
from ..structure.kinds import EarKind, LinkKind, RegionKind
from ..tree.balance import add_inertial_force, moved_by
from ..tree.inverse_dynamics import transfer
from ..tree.triangularization import force_to_parent
from .balance import (
    RootForce,
    add_closing_wrenches,
    add_to_roots,
    begin_inward,
    closing_wrench,
    forces_at_links,
    residual_tangent,
)
from .closures import dependents, stored_factor
from .conditions import Condition, components_along, of_loop
from .geometry import EarGeometry
from .roots import Frame, Ground, Root
from .tangents import EarTangents

# -- outward -----------------------------------------------------------------------------------------------------------


def needed_by(x: Scope, joint: LinkJoint, before: Vector, rates: Sequence[Value]) -> Vector:
    """Add the force that a link's inertia requires for a change of its acceleration, and return this change. Eqs. 19, 23.

    `before` is the change of its parent's acceleration, `rates` are the changes of its joint's accelerations.
    """
    A = moved_by(x, joint, before, rates, "d Eq. 19")
    force: Vector = list(x.load(MY_LANE, fields.needed))
    add_inertial_force(x, force, A)
    x.store(MY_LANE, fields.total_needed, [x.let("f", e, "d Eq. 24", lanes=True) for e in force])
    return A


def needed(x: Scope, kind: LinkKind) -> None:
    """Outward block over directions of a link: tangent of the force that its total motion requires."""
    joint = kind.joint(x, kind, lanes=True)
    rates = [x.entry(DUDOT, j) for j in range(joint.freedoms)]
    needed_by(x, joint, x.load(LUP, fields.explicit_acceleration), rates)


def ear_needed(x: Scope, kind: EarKind) -> None:
    """Outward block over directions of an ear: tangents of required forces, now including the change of the sources' udot,
    which the balance held constant."""
    ear = EarGeometry(x, kind)
    added: list[Vector] = []
    for k, member in enumerate(ear.members):
        parent = member.parent
        before = added[parent] if parent >= 0 else of_root(x, ear.roots[-1 - parent])
        joint = kind.links[k].joint(member.view, kind.links[k], lanes=True)
        rates: Vector = []
        for j in range(len(joint.columns)):
            held = x.load(MY_LANE[k], fields.dependent_acceleration(j)) if j in kind.dependent[k] else 0
            rates.append(x.entry(DUDOT[k], j) - held)
        added.append(needed_by(member.view, joint, before, rates))


def of_root(x: Scope, root: Root) -> Vector:
    """Contribution of a change of udot to the acceleration of a root, along its own axes."""
    if isinstance(root, Ground) or (isinstance(root, Frame) and not root.needs_force):
        return [0] * 6
    return x.load(LBASE if isinstance(root, Frame) else LROOTS[root.place], fields.explicit_acceleration)


# -- inward ------------------------------------------------------------------------------------------------------------


def store_tangent(x: Scope, store: Store, W: Matrix, dW: Matrix, force: Vector, tangent: Vector) -> None:
    """Tangent of a moment and a force in the ground frame, from components along a link's axes: ``dW f + W df``."""
    for i, value in enumerate(add(turned(W, tangent), turned(dW, force))):
        x.set_entry(store, i, x.let("dreaction", value, "d Eq. 45", lanes=True))


def link_tangents(x: Scope, kind: LinkKind) -> None:
    """Inward block over directions of a link: tangent of the reaction of its joint on it."""
    phi: Vector = []
    d_phi: Vector = []
    for i in SIX:
        own, children = fields.total_needed.scalars()[i], fields.transmitted.scalars()[i]
        phi.append(x.let("phi", x.load(ME, own) + x.load(ME, children), "Eq. 45"))
        moved = x.load(LME, fields.articulated_force.scalars()[i])
        d_phi.append(x.let("dphi", x.load(MY_LANE, own) + moved, "d Eq. 45", lanes=True))
    store_tangent(x, DREACTION, x.load(ME, fields.attitude), x.load(MY_LANE, fields.attitude), phi, d_phi)
    for m in others(kind):
        if kind.partners.first[m]:
            add_partner_force(x, kind, m, [0] * 6, fields.transmitted)
            add_partner_force(x, kind, m, [0] * 6, lanes=True)
    if kind.has_parent:
        transfer(x, kind, kind.joint(x, kind), phi, d_phi)


def ear_reaction_tangents(x: Scope, kind: EarKind) -> None:
    """Inward block over directions of an ear: tangents of the reactions of its joints and loops."""
    redundant = len(kind.form.rows) > len(dependents(kind))
    ear, rows, d = begin_inward(x, kind, moving_shares=redundant)
    phi, d_phi = forces_at_links(x, kind, fields.total_needed)
    wrench = closing_wrench(x, ear, phi) if rows else []
    redundant_change = redundant_part(x, ear, rows, wrench, d) if redundant else []
    on_roots, coupling_forces = add_closing_wrenches(x, ear, rows, wrench, phi, d_phi, d)
    if rows:
        rest = [
            -residual_tangent(x, ear, k, j, phi[k], d_phi[k], coupling_forces, found=True) for k, j in dependents(kind)
        ]
        d_wrench = stored_factor(x, kind).solve_transposed(rest, "dW", "d Eq. 9", lanes=True)
        if redundant_change:
            d_wrench = [
                x.let("dW", a + b, "d Eq. 9", lanes=True) for a, b in zip(d_wrench, redundant_change, strict=True)
            ]
        for c in range(len(kind.closures)):
            store_loop(x, ear, c, rows, wrench, d_wrench, d)
        on_roots += add_wrench_changes(x, ear, rows, d_wrench, d_phi)
    else:
        for c in range(len(kind.closures)):
            for i in SIX:
                x.set_entry(DLOOP_REACTION[c], i, 0)
    for k in range(len(ear.members)):
        W, dW = x.load(ME[k], fields.attitude), x.load(MY_LANE[k], fields.attitude)
        store_tangent(x, DREACTION[k], W, dW, phi[k], d_phi[k])
    add_to_roots(x, ear, on_roots)


def redundant_part(x: Scope, ear: EarGeometry, rows: list[Condition], wrench: Vector, d: EarTangents) -> Vector:
    """The part of ``dE z`` that is normal to all columns of E; z gives the shortest multipliers, ``W = E z``. Eq.
    9."""
    factor = stored_factor(x, ear.kind)
    z = [x.name("z", v, "Eq. 9") for v in factor.solve(wrench, "z", "Eq. 9")]
    d.hold(z)
    rates = ear.coefficients(z)
    motions = ear.walk(ear.still(), rates, "z", "Eq. 9")
    conditions = components_along(ear, rows, ear.face_difference(motions, ear.still(), rates), "Ez", "Eq. 9")
    d.run()
    moved = [x.let("dEz", d.of(v), "d Eq. 9", lanes=True) for v in conditions]
    for q in factor.q:
        along = x.let("along", inner(q, moved), "d Eq. 9", lanes=True)
        moved = [x.let("dEz", v - product(e, along), "d Eq. 9", lanes=True) for e, v in zip(q, moved, strict=True)]
    return moved


def store_loop(
    x: Scope, ear: EarGeometry, c: int, rows: list[Condition], wrench: Vector, d_wrench: Vector, d: EarTangents
) -> None:
    """Tangent of a loop's reaction, which is minus the wrench of its multipliers."""
    if ear.kind.closures[c].is_coupling:  # a coupling's reaction is one number, along the coordinate with factor 1
        own = [value for row, value in zip(rows, d_wrench, strict=True) if row.loop == c]
        for i in SIX:
            x.set_entry(
                DLOOP_REACTION[c], i, x.let("dreaction", -own[0], "d Eq. 9", lanes=True) if own and not i else 0
            )
        return
    directions = [row.n for row in rows]
    acting = of_loop(rows, c, wrench, directions)
    moved = of_loop(rows, c, wrench, [d.vector(row.n) if row.loop == c else row.n for row in rows])
    added = of_loop(rows, c, d_wrench, directions)
    turned = ear.kind.closures[c].turned
    force = [x.let("W", e if turned else -e, "Eq. 9") for v in acting for e in v]
    tangent = [
        x.let("dW", a + b if turned else -a - b, "d Eq. 9", lanes=True)
        for v, w in zip(moved, added, strict=True)
        for a, b in zip(v, w, strict=True)
    ]
    W, dW = x.load(BASE, fields.attitude), x.load(LANE_BASE, fields.attitude)
    store_tangent(x, DLOOP_REACTION[c], W, dW, force, tangent)


def forces_at_faces(
    x: Scope, ear: EarGeometry, rows: list[Condition], d_wrench: Vector, lanes: bool = True
) -> tuple[list[Vector], list[RootForce]]:
    """The forces of multipliers, or of changes of multipliers, on each link of an ear, and on the roots that have a face."""
    more: list[Vector] = [[0] * 6 for _ in ear.members]
    on_roots: list[RootForce] = []
    for c, closure in enumerate(ear.kind.closures):
        if closure.is_coupling:
            continue
        moment, force = of_loop(rows, c, d_wrench, [row.n for row in rows])
        wrench = [*moment, *force]
        for side, sign in ((0, -1), (1, 1)):
            place = closure.faces[side]
            if place < 0 and not ear.roots[-1 - place].needs_force:
                continue
            slip = ear.slip(c) if side == 0 else None
            at_face = turned(transpose(ear.attitude(place)), wrench if slip is None else about(slip, wrench))
            own = [x.let("own", e, "d Eq. 9", lanes=lanes) for e in at_face]
            acting = [sign * e for e in about(ear.face(c, side)[0], own)]
            if place < 0:
                on_roots.append(RootForce(-1 - place, [0] * 6, acting))
            else:
                more[place] = add(more[place], acting)
    return more, on_roots


def add_wrench_changes(
    x: Scope, ear: EarGeometry, rows: list[Condition], d_wrench: Vector, d_phi: list[Vector]
) -> list[RootForce]:
    """Add the effect of changes of the multipliers at the faces to `d_phi` and to the forces on the roots."""
    more, on_roots = forces_at_faces(x, ear, rows, d_wrench)
    for k in reversed(range(len(more))):
        if all(is_zero(v) for v in more[k]):
            continue
        member = ear.members[k]
        more[k] = [x.let("dphi", v, "d Eq. 45", lanes=True) for v in more[k]]
        d_phi[k] = [x.let("dphi", v, "d Eq. 45", lanes=True) for v in add(d_phi[k], more[k])]
        if member.parent < 0 and not ear.roots[-1 - member.parent].needs_force:
            continue
        joint = ear.kind.links[k].joint(member.view, ear.kind.links[k], lanes=True)
        on_parent = force_to_parent(x, joint, more[k], "d Eq. 45", member.r)
        if member.parent >= 0:
            more[member.parent] = add(more[member.parent], on_parent)
        else:
            on_roots.append(RootForce(-1 - member.parent, [0] * 6, on_parent))
    return on_roots


def region_reaction_tangents(x: Scope, kind: RegionKind) -> None:
    """Inward block over directions of a region: adds the region's forces to the links that carry it."""
    transmitted: dict[int, tuple[Vector, Vector]] = {m: ([0] * 6, [0] * 6) for m in others(kind)}
    for f, m in enumerate(kind.far):
        if m >= 0:  # the sum of the ears' forces on a far link is along that link's axes
            transmitted[m] = x.load(REGION, fields.far_transmitted(f)), x.load(LREGION, fields.far_balance(f))
    for m, (force, tangent) in transmitted.items():
        add_partner_force(x, kind, m, force, fields.transmitted)
        add_partner_force(x, kind, m, tangent, lanes=True)
    if kind.carried:
        moved = x.load(LREGION, fields.region_balance)
        accumulate(x, LBASE, fields.articulated_force, moved, kind.first, "Eq. 44", lanes=True)
        accumulate(x, BASE, fields.transmitted, x.load(REGION, fields.region_transmitted), kind.first, "Eq. 44")
