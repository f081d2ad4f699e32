"""The balance through an ear: tangents of its inverse dynamics at fixed udot. Section 4.6 of the theory page.

Motions and forces have components along the links' own axes, as for links outside ears: along these axes, a link's inertia
is constant. Only quantities at a cut are rotated into the region's axes, and the loops' wrenches are rotated back. Outward,
the acceleration closure is differentiated. Inward, the loops transmit the wrench that closes them. The residual along the
dependent joints is projected onto the sources by ``Y``, so tangents of multipliers are not needed.
"""

from __future__ import annotations

from functools import partial

from ...program.algebra import Symbol
from ...program.block import Scope
from ...program.field import SixField
from ...program.scalar import Value, Vector
from ...records import dataclass
from .. import fields
from ..joints import Column
from ..rotors import driven_rotor_change, rotor, rotor_force_change, transmitted_along
from ..spatial import SIX, UNIT, add, cross, is_zero, matvec, minus, transpose
from ..stores import DHELD, DTAU, DUDOT, EAR, LME, LREGION, ME, MY_LANE, UDOT
from ..structure.kinds import EarKind, LinkKind
from ..tree.inverse_dynamics import joint_acceleration
from ..tree.kinematics import accelerated, acceleration_matrix, body_force, less_external, own_inertia
from ..tree.tangents import pattern
from ..tree.triangularization import force_to_parent
from .closing_accelerations import closing_accelerations
from .closures import dependents, named_root_velocities, own_sources, stored_factor
from .conditions import Condition, kept_conditions, of_loop
from .couplings import CouplingForces
from .geometry import EarGeometry
from .members import Member, MemberView
from .motions import Motion, Twist
from .tangents import EarTangents, ear_tangents, tangents_of


@dataclass(slots=True)
class RootForce:
    """A moment and force on a root, about the root's origin and along its axes, and the tangent: six components each."""

    root: int
    force: Vector
    tangent: Vector


# -- outward -----------------------------------------------------------------------------------------------------------


def motion_tangents(motion: Motion, tangent: Motion) -> dict[Symbol, Value]:
    """Maps each symbol of a loaded motion to its tangent."""
    seeds: dict[Symbol, Value] = {}
    for vector, moved in ((motion.w, tangent.w), (motion.al, tangent.al), (motion.a, tangent.a)):
        seeds.update(tangents_of(vector, moved))
    for row, changed in zip(motion.B, tangent.B, strict=True):
        seeds.update(tangents_of(row, changed))
    return seeds


def own_motion(x: Scope, kind: LinkKind, member: Member, before: Motion) -> Motion:
    """Motion of a link along its own axes, from its parent's motion and the udot of its joint. Eqs. 18-21."""
    view, joint = member.view, member.joint
    carried = joint.to_child(before.w, "wp", "Eq. 18")
    w = joint.turning(carried)
    al, a = accelerated(view, joint, carried, (before.al, before.a, before.B))
    al, a = joint_acceleration(view, joint, al, a)
    return Motion(w, al, a, acceleration_matrix(x, w, al))


def turned_face_motion(
    x: Scope, ear: EarGeometry, motions: list[Motion], roots: list[Motion], c: int, side: int
) -> tuple[Vector, Vector, Vector]:
    """Angular velocity, angular acceleration and acceleration of a loop's face, along the region's axes."""
    place = ear.kind.closures[c].faces[side]
    m = motions[place] if place >= 0 else roots[-1 - place]
    r, _ = ear.face(c, side)
    a = x.let_vector("fa", m.at(r), "Eq. 31")
    w, al, a = (ear.fixed_vector("face", place, v, "Eq. 31") for v in (m.w, m.al, a))
    return w, al, a


def dependent_accelerations(x: Scope, ear: EarGeometry, rates: Vector) -> list[tuple[Vector, Vector]]:
    """Angular and linear accelerations of the links due to the dependent joints, along the links' axes. Eq. 31."""
    tag = "d Eq. 31"
    found: list[tuple[Vector, Vector]] = []
    along = {(k, freedom.index): value for (k, freedom), value in zip(ear.dependents(), rates, strict=True)}
    for k, (member, kind) in enumerate(zip(ear.members, ear.kind.links, strict=True)):
        A: Vector = [0] * 6
        if member.parent >= 0:
            al, a = found[member.parent]
            joint = kind.joint(member.view, kind, lanes=True)
            A = joint.to_child(al, "da", tag) + joint.to_child(add(a, cross(al, member.r)), "da", tag)
        for j, s in enumerate(member.joint.columns):
            for i, value in s.added(A, along.get((k, j), 0)).items():
                A[i] = value
        A = [x.let("da", e, tag, lanes=True) for e in A]
        found.append((A[:3], A[3:]))
    return found


def ear_balance_out(x: Scope, kind: EarKind) -> None:
    """Outward block over directions: tangents of motions and of required forces at fixed udot of the sources. Eqs. 25-29."""
    ear = EarGeometry(x, kind)
    rows = kept_conditions(ear)
    angles = kept_rotations(ear)
    roots: list[Motion] = []
    seeds: dict[Symbol, Value] = {}
    for root in ear.roots:
        motion, tangent = root.own_motion()
        roots.append(motion)
        seeds.update(motion_tangents(motion, tangent))
    slip_roots = named_root_velocities(ear) if ear.slides else []
    seeds.update(root_positions(ear))
    seeds.update(slip_tangents(ear, slip_roots))
    d = ear_tangents(ear, angles, seeds)
    d.turn_joints()
    hold_roots(d, ear, slip_roots)
    motions: list[Motion] = []
    for k, member in enumerate(ear.members):
        before = motions[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
        motions.append(own_motion(x, kind.links[k], member, before))
    d.run()
    if rows:
        faces = partial(turned_face_motion, x, ear, motions, roots)
        found = [m.given_accelerations or [m.view.entry(UDOT, f.index) for f in m.freedoms] for m in ear.members]
        conditions = closing_accelerations(x, ear, rows, faces, found, "ca", slip_roots)
        d.run()
        rates = stored_factor(x, kind).solve([-d.of(v) for v in conditions], "dx", "d Eq. 31", lanes=True)
        pairs: list[tuple[Vector, Vector]] = []
        for m, (al, a) in zip(motions, dependent_accelerations(x, ear, rates), strict=True):
            pairs += [(m.al, al), (m.a, a)]
        d.correct(pairs)
        for n, (k, freedom) in enumerate(ear.dependents()):
            x.store(MY_LANE[k], fields.dependent_acceleration(freedom.index), rates[n])
    for k, m in enumerate(motions):
        view, link = ear.members[k].view, kind.links[k]
        needed = body_force(x, m.w, m.al, m.a, m.B, own_inertia(view))
        d.run()
        force = less_external(view, link, needed)
        d_force = less_external(view, link, d.vector(needed[:3]) + d.vector(needed[3:]), lanes=True)
        own, moved = fields.ear_own, fields.remainder
        for field, v in ((own.w, m.w), (own.al, m.al), (own.a, m.a)):
            x.store(ME[k], field, v)
        x.store(ME[k], fields.total_needed, force)
        x.store(ME[k], own.B, m.B)
        for field, v in ((moved.w, m.w), (moved.al, m.al), (moved.a, m.a)):
            x.store(LME[k], field, d.vector(v))
        x.store(LME[k], moved.B, [d.vector(row) for row in m.B])
        x.store(MY_LANE[k], fields.needed, d_force)


def kept_rotations(ear: EarGeometry) -> dict[int, Vector]:
    """Rotation vectors of links (keys 0, 1, ...) and of roots (negative keys), for complete seeds."""
    found = {-1 - t: root.rotation(True) for t, root in enumerate(ear.roots)}
    return found | {k: ear.x.load(MY_LANE[k], fields.shift.angular) for k in range(len(ear.members))}


def root_positions(ear: EarGeometry) -> dict[Symbol, Value]:
    """Tangents of the roots' positions along complete seeds; empty for ears whose loop joints do not slide."""
    found: dict[Symbol, Value] = {}
    for root in ear.roots if ear.slides else ():
        found.update(tangents_of(root.position(), root.displacement(True)))
    return found


def slip_tangents(ear: EarGeometry, velocities: list[Twist]) -> dict[Symbol, Value]:
    """Tangents of the roots' velocities; empty for ears whose loop joints do not slide."""
    found: dict[Symbol, Value] = {}
    for root, twist in zip(ear.roots, velocities, strict=False):
        found.update(tangents_of(twist.six, root.velocity_tangent(True)))
    return found


def hold_roots(d: EarTangents, ear: EarGeometry, velocities: list[Twist]) -> None:
    """If loop joints slide, exclude the roots' velocities and positions from differentiation: their tangents are given."""
    for t, root in enumerate(ear.roots if ear.slides else ()):
        if velocities:
            d.hold(velocities[t].six)
        d.hold(root.position())


# -- inward ------------------------------------------------------------------------------------------------------------


def ear_balance_in(x: Scope, kind: EarKind) -> None:
    """Inward block over directions: forces transmitted by the joints, wrenches that close the loops, and the tangents
    of both.

    Residuals of the forces along the joints are projected onto the sources. Eqs. 9, 45, 50.
    """
    ear, rows, d = begin_inward(x, kind)
    phi, d_phi = forces_at_links(x, kind, fields.needed)
    wrench = closing_wrench(x, ear, phi) if rows else []
    on_roots, coupling_forces = add_closing_wrenches(x, ear, rows, wrench, phi, d_phi, d)

    def residual(k: int, j: int) -> Value:
        return residual_tangent(x, ear, k, j, phi[k], d_phi[k], coupling_forces)

    r = {c: residual(k, j) for c, (k, j) in own_sources(kind).items()}
    for n, (k, j) in enumerate(dependents(kind)):
        value = residual(k, j)
        for c in range(kind.total):
            r[c] = r.get(c, 0) + x.load(EAR, fields.dependent_rate(n, c)) * value
    for c, value in r.items():
        x.store(LREGION.sum, fields.source_tangent_force(c), x.let("r", value, "d Eq. 53", lanes=True))
    add_to_roots(x, ear, on_roots)


def add_closing_wrenches(
    x: Scope, ear: EarGeometry, rows: list[Condition], wrench: Vector, phi: list[Vector], d_phi: list[Vector], d: EarTangents
) -> tuple[list[RootForce], CouplingForces]:  # fmt: skip
    """Add the closing wrenches to the forces at the links, and propagate these and their tangents inward.

    Returns the forces on the roots, and the coupling forces. Changes phi and d_phi. Eqs. 9, 45.
    """
    on_roots: list[RootForce] = []
    coupling_forces = CouplingForces()
    for c, closure in enumerate(ear.kind.closures if rows else ()):
        if closure.is_coupling:
            coupling_forces.add(ear, c, rows, wrench, d)
        else:
            on_roots += apply_wrench(x, ear, c, rows, wrench, phi, d_phi, d)
    on_roots += transmit(x, ear, phi, d_phi, d, coupling_forces)
    return on_roots, coupling_forces


def begin_inward(
    x: Scope, kind: EarKind, moving_shares: bool = False
) -> tuple[EarGeometry, list[Condition], EarTangents]:
    """Geometry and conditions of an ear for complete seeds, and tangents of the levers and attitudes that propagate
    forces.

    With `moving_shares`, the factors of conditions on points, one over the length of the gradient, are differentiated
    too.
    """
    ear = EarGeometry(x, kind)
    if moving_shares:
        ear.shares = "moving"
    rows = kept_conditions(ear)
    angles = kept_rotations(ear)
    for c in range(len(kind.closures)):
        ear.slip(c)
    d = ear_tangents(ear, angles, root_positions(ear))
    d.turn_joints()
    hold_roots(d, ear, [])
    d.run()
    return ear, rows, d


def forces_at_links(x: Scope, kind: EarKind, tangent: SixField) -> tuple[list[Vector], list[Vector]]:
    """For each link, the force that it requires plus contributions of other links, and the tangent of this sum. The
    tangents of the required forces are in the field `tangent`."""
    phi: list[Vector] = []
    d_phi: list[Vector] = []
    for k in range(len(kind.links)):
        parts = [(fields.total_needed, MY_LANE[k], tangent)]
        if kind.followed[k]:
            parts.append((fields.root_transmitted, LME[k], fields.root_transmitted))
        if kind.links[k].carries:
            parts.append((fields.transmitted, LME[k], fields.articulated_force))
        phi.append([sum(x.load(ME[k], field.scalars()[i]) for field, _, _ in parts) for i in SIX])
        d_phi.append([sum(x.load(store, field.scalars()[i]) for _, store, field in parts) for i in SIX])
    return phi, d_phi


def closing_wrench(x: Scope, ear: EarGeometry, phi: list[Vector]) -> Vector:
    """The loops' multipliers for which each dependent joint transmits only its own force along its columns. Eqs. 9,
    53."""
    # forces that the joints would transmit without the loops' wrenches
    held = transmitted(x, ear, phi)
    gamma = [
        x.let("gamma", column_of(ear, k, j).along(held[k]) - tau(x, ear.kind, k, j), "Eq. 53")
        for k, j in dependents(ear.kind)
    ]
    return stored_factor(x, ear.kind).solve_transposed([-v for v in gamma], "W", "Eq. 9")


def residual_tangent(
    x: Scope, ear: EarGeometry, k: int, j: int, phi: Vector, d_phi: Vector, coupling_forces: CouplingForces, found: bool = False
) -> Value:  # fmt: skip
    """Tangent of the transmitted force along a degree of freedom, minus that of the joint's own force. Eq. 53.

    `found`: see `own_force_tangent`."""
    dtau = own_force_tangent(x, ear.kind, k, j, found)
    s = column_of(ear, k, j)
    change = s.change(ear.members[k].view, phi)
    change = change + coupling_forces.tangents.get((k, j), 0)
    return x.let("dgamma", s.along(d_phi) + change - dtau, "d Eq. 53", lanes=True)


def column_of(ear: EarGeometry, k: int, j: int) -> Column:
    """Partial velocity of a degree of freedom, along its link's axes."""
    return ear.members[k].joint.all_columns[j]


def own_force_tangent(x: Scope, kind: EarKind, k: int, j: int, found: bool = False) -> Value:
    """Tangent of the model's own force minus the tangent of the rotor's force, along a degree of freedom or a prescribed
    coordinate.

    The balance holds udot of the independent degrees of freedom; the dependent udot follow. If the tangent of udot has been
    `found`, the rotor's force includes it.
    """
    link, view = kind.links[k], MemberView(x, k)
    if link.joint.driven:
        return (x.entry(DHELD[k], 0) if link.held else 0) - driven_rotor_change(view, link)
    force = (x.entry(DTAU[k], j) if link.forced[j] else 0) - rotor_force_change(view, link, j)
    a = rotor(view, link, j)
    if is_zero(a) or j not in kind.dependent[k]:  # udot of an independent degree of freedom is held
        return force
    rate = x.entry(DUDOT[k], j) if found else x.load(MY_LANE[k], fields.dependent_acceleration(j))
    return force - a * rate


def tau(x: Scope, kind: EarKind, k: int, j: int) -> Value:
    """The model's own force along a degree of freedom, minus the force of its rotor."""
    return transmitted_along(MemberView(x, k), kind.links[k], j)


def transmitted(x: Scope, ear: EarGeometry, own: list[Vector]) -> list[Vector]:
    """Forces transmitted by the joints of the ear's links, about the links' origins."""
    held = list(own)
    for k in reversed(range(len(own))):
        held[k] = [x.let("phi", v, "Eq. 45") for v in held[k]]
        parent = ear.members[k].parent
        if parent >= 0:
            held[parent] = add(
                held[parent], force_to_parent(x, ear.members[k].joint, held[k], "Eq. 45", ear.members[k].r)
            )
    return held


def transmit(
    x: Scope, ear: EarGeometry, phi: list[Vector], d_phi: list[Vector], d: EarTangents, coupling_forces: CouplingForces
) -> list[RootForce]:
    """Propagate the transmitted forces and their tangents inward, in `phi` and `d_phi`; returns the forces on the roots."""
    kind = ear.kind
    on_roots: list[RootForce] = []
    for k in reversed(range(len(phi))):
        member = ear.members[k]
        for j in kind.dependent[k]:
            # in equilibrium a dependent joint transmits its own force along its degree of freedom, plus coupling forces
            s = column_of(ear, k, j)
            own = tau(x, kind, k, j)
            if (k, j) in coupling_forces.forces:
                own = x.let("tau", own - coupling_forces.forces[k, j], "Eq. 9")
            phi[k][s.lead] = s.completed(phi[k], own)
        phi[k] = [x.name("phi", v, "Eq. 45") for v in phi[k]]
        d_phi[k] = [x.let("dphi", v, "d Eq. 45", lanes=True) for v in d_phi[k]]
        if member.parent < 0 and not ear.roots[-1 - member.parent].needs_force:
            continue
        on_parent = force_to_parent(x, member.joint, phi[k], "Eq. 45", member.r)
        if x.structural:
            moved = add([pattern(v) for v in on_parent], force_to_parent(x, member.joint, d_phi[k], "", member.r))
        else:
            d.give(phi[k], d_phi[k])
            d.run()
            moved = [d.of(v) for v in on_parent]
        if member.parent >= 0:
            phi[member.parent] = add(phi[member.parent], on_parent)
            d_phi[member.parent] = add(d_phi[member.parent], moved)
        else:
            on_roots.append(RootForce(-1 - member.parent, on_parent, moved))
    return on_roots


def apply_wrench(
    x: Scope,
    ear: EarGeometry,
    c: int,
    rows: list[Condition],
    wrench: Vector,
    phi: list[Vector],
    d_phi: list[Vector],
    d: EarTangents,
) -> list[RootForce]:
    """Add the wrench of a loop on its two faces. Its components are along directions that rotate with the links.

    Wrenches on links of the ear are added to `phi` and `d_phi`; those on roots are returned.
    """
    wrenches = of_loop(rows, c, wrench, [row.n for row in rows])
    tangents = of_loop(rows, c, wrench, [d.vector(row.n) if row.loop == c else row.n for row in rows])
    moment, force = (x.let_vector("W", v, "Eq. 9") for v in wrenches)
    d_moment, d_force = (x.let_vector("dW", v, "d Eq. 9", lanes=True) for v in tangents)
    on_roots: list[RootForce] = []
    for side, sign in ((0, -1), (1, 1)):
        place = ear.kind.closures[c].faces[side]
        if place < 0 and not ear.roots[-1 - place].needs_force:
            continue
        slip = ear.slip(c) if side == 0 else None
        n, dn = moment, d_moment
        if slip is not None:
            d_slip = x.let_vector("dslip", d.vector(slip), "d Eq. 30", lanes=True)
            n = add(moment, cross(slip, force))
            dn = add(d_moment, cross(d_slip, force), cross(slip, d_force))
        r, _ = ear.face(c, side)
        f, df = turned_back(x, ear, place, d.angles.get(place), force, d_force)
        n, dn = turned_back(x, ear, place, d.angles.get(place), n, dn)
        n = add(n, cross(r, f))
        dn = add(dn, cross(r, df), cross(d.vector(r), f))
        acting, moved = [sign * e for e in (*n, *f)], [sign * e for e in (*dn, *df)]
        if place < 0:
            on_roots.append(RootForce(-1 - place, acting, moved))
        else:
            phi[place] = add(phi[place], acting)
            d_phi[place] = add(d_phi[place], moved)
    return on_roots


def turned_back(
    x: Scope, ear: EarGeometry, place: int, theta: Vector | None, v: Vector, dv: Vector
) -> tuple[Vector, Vector]:
    """Components along a link's axes of a vector given along the region's axes, and the tangents ``W^T (dv - theta x
    v)`` of these components."""
    W = ear.attitude(place)
    if W is UNIT or theta is None:
        return v, dv
    back = transpose(W)
    relative = x.let_vector("rel", minus(dv, cross(theta, v)), "d Eq. 22", lanes=True)
    return x.let_vector("own", matvec(back, v), "Eq. 22"), x.let_vector(
        "own", matvec(back, relative), "d Eq. 22", lanes=True
    )


def add_to_roots(x: Scope, ear: EarGeometry, on_roots: list[RootForce]) -> None:
    """Add the forces on roots to the region's sums, along each root's own axes."""
    for t, root in enumerate(ear.roots):
        parts = [h for h in on_roots if h.root == t]
        if parts and root.needs_force:
            total = [x.let("to_root", v, "Eq. 45") for v in add(*(h.force for h in parts))]
            change = [x.let("to_root", v, "d Eq. 45", lanes=True) for v in add(*(h.tangent for h in parts))]
            root.receive_own(total, change)
