"""Reactions: the wrenches that joints and loops transmit, by the force sweep, in the ground frame.

With all accelerations known, the forces that the motions of links require are summed inward. Loops carry a wrench W
such that the dependent joints transmit only their own joint force along their degrees of freedom: ``E^T W = -gamma``,
with gamma the force that they would transmit without W, minus their own. Where conditions are redundant, W is the
shortest such wrench.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Matrix, Vector
from ...program.store import Store
from .. import fields
from ..couplings import add_partner_force, from_far, others
from ..propagation import accumulate, clear
from ..rotors import transmitted_along
from ..spatial import about, add, transpose, turned
from ..stores import BASE, LOOP_REACTION, ME, REACTION, REGION, UDOT
from ..structure.kinds import EarKind, LinkKind, RegionKind
from ..tree.inverse_dynamics import transfer
from .closures import stored_factor
from .conditions import kept_conditions, of_loop
from .far_links import far_motions
from .geometry import EarGeometry
from .kinematics import member_motion, store_motions
from .members import MemberView
from .motions import Motion
from .region_balance import transmitted_fields


def inward(x: Scope, ear: EarGeometry, own: list[Vector]) -> list[Vector]:
    """Forces transmitted by the joints of the ear's links, about the links' origins."""
    held = list(own)
    for k in reversed(range(len(own))):
        held[k] = [x.let("phin" if i < 3 else "phif", e, "Eq. 45") for i, e in enumerate(held[k])]
        parent = ear.members[k].parent
        if parent >= 0:
            held[parent] = add(held[parent], about(ear.members[k].rho, held[k]))
    return held


def store_reaction(x: Scope, store: Store, attitude: Matrix, force: Vector) -> None:
    """Store a reaction, moment then force, along the axes of the ground frame."""
    for i, value in enumerate(turned(attitude, force)):
        x.set_entry(store, i, x.let("reaction", value, "Eq. 45"))


def transmitted(x: Scope, kind: LinkKind) -> None:
    """Inward block of a link: the reaction of its joint on it, about its origin."""
    phi: Vector = []
    for own, children in zip(fields.total_needed.scalars(), fields.transmitted.scalars(), strict=True):
        phi.append(x.let("phi", x.load(ME, own) + x.load(ME, children), "Eq. 45"))
    store_reaction(x, REACTION, x.load(ME, fields.attitude), phi)
    for m in others(kind):
        if kind.partners.first[m]:
            add_partner_force(x, kind, m, [0] * 6, fields.transmitted)
    if kind.has_parent:
        transfer(x, kind, kind.joint(x, kind), phi, [])


def ear_motion(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: accelerations, and the force that its links require."""
    ear = EarGeometry(x, kind)
    roots = [root.motion(True) for root in ear.roots]
    motions: list[Motion] = []
    for k, member in enumerate(ear.members):
        before = motions[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
        udot = [] if member.joint.driven else [x.entry(UDOT[k], f.index) for f in member.freedoms]
        motions.append(member_motion(x, member, before, udot))
    store_motions(x, ear, motions, True)


def region_motion(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: set sums to zero, and compute the motions of far links."""
    for whole, _ in transmitted_fields(kind):
        clear(x, REGION, whole)
    far_motions(x, kind, fields.total, fields.far_total)


def ear_transmitted(x: Scope, kind: EarKind) -> None:
    """Inward block of an ear: reactions of its joints and loops."""
    ear = EarGeometry(x, kind)
    rows = kept_conditions(ear)
    phi: list[Vector] = []
    for k, member in enumerate(ear.members):
        force = x.load(ME[k], fields.ear_total_needed)
        if kind.followed[k]:
            force = add(force, x.load(ME[k], fields.ear_transmitted))
        if kind.links[k].carries:
            force = add(force, turned(member.W, x.load(ME[k], fields.transmitted)))
        phi.append(force)
    held = inward(x, ear, phi)
    on_roots: list[tuple[int, Vector]] = []
    if rows:
        gamma: Vector = []  # with the loops cut: transmitted force minus the joint's own, plus the rotor's
        for k, freedom in ear.dependents():
            tau = transmitted_along(MemberView(x, k), kind.links[k], freedom.index)
            gamma.append(x.let("gamma", freedom.along(held[k][:3], held[k][3:]) - tau, "Eq. 53"))
        multipliers = stored_factor(x, kind).solve_transposed([-v for v in gamma], "W", "Eq. 9")
        for c, closure in enumerate(kind.closures):
            if closure.is_coupling:  # a coupling's reaction is one number, along the coordinate with factor 1
                along = [value for row, value in zip(rows, multipliers, strict=True) if row.loop == c]
                for entry in range(6):
                    on_first = -along[0] if along and entry == 0 else 0
                    x.set_entry(LOOP_REACTION[c], entry, x.let("reaction", on_first, "Eq. 9"))
                continue
            moment, push = of_loop(rows, c, multipliers, [row.n for row in rows])
            wrench, end = [*moment, *push], closure.faces[1]
            on_end = turned(transpose(ear.attitude(end)), [e if closure.turned else -e for e in wrench])
            attitude = x.load(ME[end] if end >= 0 else ear.roots[-1 - end].record, fields.attitude)
            store_reaction(x, LOOP_REACTION[c], attitude, on_end)
            for side, sign in ((0, -1), (1, 1)):
                place = closure.faces[side]
                lever = ear.arm(c, side)
                slip = ear.slip(c) if side == 0 else None
                acting = [sign * e for e in about(lever if slip is None else add(lever, slip), wrench)]
                if place < 0:
                    on_roots.append((-1 - place, acting))
                else:
                    phi[place] = add(phi[place], acting)
        held = inward(x, ear, phi)
    for k, member in enumerate(ear.members):
        store_reaction(x, REACTION[k], x.load(ME[k], fields.attitude), turned(transpose(member.W), held[k]))
        if member.parent < 0:
            on_roots.append((-1 - member.parent, about(member.rho, held[k])))
    for t, root in enumerate(ear.roots):
        parts = [p for number, p in on_roots if number == t]
        if parts and root.needs_force:
            root.receive(add(*parts))


def region_transmitted(x: Scope, kind: RegionKind) -> None:
    """Inward block of a region: adds the region's forces to the links that carry it."""
    transmitted: dict[int, Vector] = {m: [0] * 6 for m in others(kind)}
    for f, m in enumerate(kind.far):
        if m >= 0:
            W = x.load(REGION, fields.far_attitude(f))
            transmitted[m] = from_far(x, W, x.load(REGION, fields.far_transmitted(f)), "Eq. 45")
    for m, values in transmitted.items():
        add_partner_force(x, kind, m, values, fields.transmitted)
    if kind.carried:
        accumulate(x, BASE, fields.transmitted, x.load(REGION, fields.region_transmitted), kind.first, "Eq. 44")
