"""Solutions with the closure matrix and the mass matrix of models with loops, for given right sides over directions.

With E for the conditions of all loops and M for the mass matrix of the tree, the sweeps solve

    E_dependent^T y = c        and        M x + E^T y = b,   E x = e.

They do the same as the sweeps of `ears.balance` and `ears.reaction_tangents`, but with fixed geometry.
"""

from __future__ import annotations

from collections.abc import Callable

from ...program.block import Scope
from ...program.field import SixField
from ...program.scalar import Value, Vector
from .. import fields
from ..couplings import add_partner_force, others
from ..propagation import accumulate
from ..rotors import rotor
from ..spatial import SIX, add, is_zero, rotate
from ..stores import (
    DMULTIPLIER,
    DUDOT,
    EAR,
    GAP_RIGHT_SIDE,
    LBASE,
    LME,
    LREGION,
    LUP,
    MY_LANE,
    RIGHT_SIDE,
)
from ..structure.kinds import EarKind, LinkKind, RegionKind
from ..tree.balance import add_inertial_force, eliminate, moved_by
from ..tree.inverse_dynamics import propagate_lanes
from ..tree.triangularization import force_to_parent
from .balance import RootForce, column_of
from .closed_tree import multipliers, numbered
from .closures import dependents, own_sources, stored_factor
from .conditions import components_along, kept_conditions
from .geometry import EarGeometry
from .members import MemberView
from .motions import Twist
from .reaction_tangents import forces_at_faces, of_root
from .region_balance import transmitted_fields

# -- forces through an ear -----------------------------------------------------------------------------------------------


def forces_from_outboard(x: Scope, kind: EarKind, own: SixField | None = None) -> list[Vector]:
    """For each link of an ear, the force on it from other links, and the force `own` that it requires itself."""
    found: list[Vector] = []
    for k in range(len(kind.links)):
        parts = [] if own is None else [(MY_LANE[k], own)]
        if kind.followed[k]:
            parts.append((LME[k], fields.root_transmitted))
        if kind.links[k].carries:
            parts.append((LME[k], fields.articulated_force))
        found.append([sum(x.load(store, field.scalars()[i]) for store, field in parts) for i in SIX])
    return found


def propagate(x: Scope, ear: EarGeometry, force: list[Vector], lanes: bool = True) -> list[RootForce]:
    """Propagates forces inward through an ear, in place, and returns the forces on the roots. Eq. 45."""
    on_roots: list[RootForce] = []
    for k in reversed(range(len(force))):
        member = ear.members[k]
        force[k] = [x.let("phi", v, "Eq. 45", lanes=lanes) for v in force[k]]
        if member.parent < 0 and not ear.roots[-1 - member.parent].needs_force:
            continue
        joint = ear.kind.links[k].joint(member.view, ear.kind.links[k], lanes=lanes)
        on_parent = force_to_parent(x, joint, force[k], "Eq. 45", member.r)
        if member.parent >= 0:
            force[member.parent] = add(force[member.parent], on_parent)
        else:
            on_roots.append(RootForce(-1 - member.parent, [], on_parent))
    return on_roots


def add_to_roots(x: Scope, ear: EarGeometry, on_roots: list[RootForce]) -> None:
    """Add the forces on roots to the sums over directions, along each root's own axes."""
    for t, root in enumerate(ear.roots):
        parts = [h.tangent for h in on_roots if h.root == t]
        if parts and root.needs_force:
            root.receive_along([x.let("to_root", v, "Eq. 45", lanes=True) for v in add(*parts)])


# -- multipliers: E_dependent^T y = c --------------------------------------------------------------------------------------


def clear_sums(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: set the forces on its carrying links to zero."""
    for _, of_lanes in transmitted_fields(kind):
        for part in of_lanes.scalars():
            x.store(LREGION, part, 0)


def link_multipliers(x: Scope, kind: LinkKind) -> None:
    """Inward block of a link: propagates the forces of outboard loops to the parent."""
    _propagate(x, kind, x.load(LME, fields.articulated_force))


def link_balanced(x: Scope, kind: LinkKind) -> None:
    """Inward block of a link: propagates the forces that accelerations and outboard loops require. Eq. 45."""
    own, children = (
        x.load(store, field) for store, field in ((MY_LANE, fields.total_needed), (LME, fields.articulated_force))
    )
    _propagate(x, kind, [x.let("phi", v, "Eq. 45", lanes=True) for v in add(own, children)])


def _propagate(x: Scope, kind: LinkKind, force: Vector) -> None:
    for m in others(kind):
        if kind.partners.first[m]:
            add_partner_force(x, kind, m, [0] * 6, lanes=True)
    if kind.has_parent:
        propagate_lanes(x, kind, force_to_parent(x, kind.joint(x, kind, lanes=True), force, "Eq. 45"))


def ear_multipliers(x: Scope, kind: EarKind) -> None:
    """Inward block of an ear: multipliers for given forces along the dependent degrees of freedom. Eq. 9."""
    _solve(x, kind, lambda k, j: x.entry(RIGHT_SIDE[k], j))


def ear_balanced(x: Scope, kind: EarKind) -> None:
    """Inward block of an ear: multipliers that balance required forces and given forces. Eqs. 9, 45."""

    def rest(k: int, j: int) -> Value:
        value, own = x.entry(RIGHT_SIDE[k], j), rotor(MemberView(x, k), kind.links[k], j)
        return value if is_zero(own) else value - own * x.entry(DUDOT[k], j)

    _solve(x, kind, rest, fields.total_needed)


def _solve(x: Scope, kind: EarKind, given: Callable[[int, int], Value], own: SixField | None = None) -> None:
    ear = EarGeometry(x, kind)
    rows = kept_conditions(ear)
    force = forces_from_outboard(x, kind, own)
    on_roots = propagate(x, ear, force)
    if rows:
        right = [given(k, j) - column_of(ear, k, j).along(force[k]) for k, j in dependents(kind)]
        right = [x.let("c", v, "Eq. 9", lanes=True) for v in right]
        factor = stored_factor(x, kind)
        weights = factor.weights(right, "y", "Eq. 9", lanes=True)
        found = factor.combined(weights, "y", "Eq. 9", lanes=True)
        for (c, i), value in zip(numbered(rows), found, strict=True):
            x.set_entry(DMULTIPLIER[c], i, value)
        for t, root in enumerate(ear.roots):
            if root.needs_force:
                gains = [x.load(EAR, fields.multiplier_gain(n, t)) for n in range(len(weights))]
                acting = [sum(g[i] * y for g, y in zip(gains, weights, strict=True)) for i in SIX]
                on_roots.append(RootForce(t, [], acting))
    add_to_roots(x, ear, on_roots)


def multiplier_gains(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: the forces on its roots by multipliers equal to each column of Q. Eq. 9.

    These forces are the same for all right sides; the forces of any multipliers are linear combinations of them.
    """
    ear = EarGeometry(x, kind)
    rows = kept_conditions(ear)
    for n, column in enumerate(stored_factor(x, kind).q if rows else ()):
        force, on_roots = forces_at_faces(x, ear, rows, column, lanes=False)
        on_roots += propagate(x, ear, force, lanes=False)
        for t, root in enumerate(ear.roots):
            if root.needs_force:
                acting = add([0] * 6, *(h.tangent for h in on_roots if h.root == t))
                x.store(EAR, fields.multiplier_gain(n, t), [x.let("gain", e, "Eq. 9") for e in acting])


def region_multipliers(x: Scope, kind: RegionKind) -> None:
    """Inward block of a region: adds the region's forces to the links that carry it."""
    sums = {m: f for f, m in enumerate(kind.far) if m >= 0}
    for m in others(kind):
        force: Vector = x.load(LREGION, fields.far_balance(sums[m])) if m in sums else [0] * 6
        add_partner_force(x, kind, m, force, lanes=True)
    if kind.carried:
        force = x.load(LREGION, fields.region_balance)
        accumulate(x, LBASE, fields.articulated_force, force, kind.first, "Eq. 44", lanes=True)


# -- accelerations: M x + E^T y = b, E x = e -------------------------------------------------------------------------------


def link_response(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: the acceleration that inboard loops cause, and the force that it requires. Eqs. 19, 23."""
    joint = kind.joint(x, kind, lanes=True)
    A = moved_by(x, joint, x.load(LUP, fields.explicit_acceleration), [0] * joint.freedoms, "Eq. 19")
    _store_needed(x, A)


def _store_needed(x: Scope, A: Vector) -> None:
    force: Vector = [0] * 6
    add_inertial_force(x, force, A)
    x.store(MY_LANE, fields.needed, [x.let("f", e, "Eq. 23", lanes=True) for e in force])


def ear_response(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: required forces and dependent accelerations, with the sources at rest. Eqs. 19, 23,
    31."""
    ear = EarGeometry(x, kind)
    before = [of_root(x, root) for root in ear.roots]
    rates = _dependent_rates(x, ear, before, {})
    for k, A in enumerate(_accelerations(ear, before, rates)):
        _store_needed(ear.members[k].view, A)
        for j in kind.dependent[k]:
            x.store(MY_LANE[k], fields.dependent_acceleration(j), rates[k, j])


Rates = dict[tuple[int, int], Value]
"""Accelerations of an ear's degrees of freedom, each by link and index."""


def _dependent_rates(x: Scope, ear: EarGeometry, before: list[Vector], own: Rates) -> Rates:
    """Dependent accelerations from ``E x = e``, with accelerations of the roots and of other joints. Eq. 31."""
    rows = kept_conditions(ear)
    if not rows:
        return {}
    along = [
        Twist(*(x.let_vector("A", rotate(root.attitude(), v), "Eq. 31", lanes=True) for v in (A[:3], A[3:])))
        for root, A in zip(ear.roots, before, strict=True)
    ]
    at_cuts = ear.root_difference(along)
    for (k, j), rate in own.items():
        moved = ear.column(k, ear.members[k].freedoms[j])
        at_cuts = [t.plus(of.times(rate)) for t, of in zip(at_cuts, moved, strict=True)]
    known = components_along(ear, rows, at_cuts, "b", "Eq. 31", lanes=True)
    right = [a - b for a, b in zip(multipliers(x, rows, GAP_RIGHT_SIDE), known, strict=True)]
    right = [x.let("b", v, "Eq. 31", lanes=True) for v in right]
    solved = stored_factor(x, ear.kind).solve(right, "dx", "Eq. 31", lanes=True)
    return dict(zip(dependents(ear.kind), solved, strict=True))


def _accelerations(ear: EarGeometry, before: list[Vector], rates: Rates) -> list[Vector]:
    """The accelerations of an ear's links. They are also stored for the children of these links. Eq. 19."""
    found: list[Vector] = []
    for k, member in enumerate(ear.members):
        joint = ear.kind.links[k].joint(member.view, ear.kind.links[k], lanes=True)
        parent = found[member.parent] if member.parent >= 0 else before[-1 - member.parent]
        own = [rates.get((k, j), 0) for j in range(len(joint.columns))]
        found.append(moved_by(member.view, joint, parent, own, "Eq. 19"))
    return found


def region_response(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: set sums to zero."""
    for c in range(kind.total):
        x.store(LREGION, fields.source_tangent_force(c), 0)
    clear_sums(x, kind)


def link_at_rest(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link if e = 0: sets the force that it requires with the sources at rest to zero."""
    for part in fields.needed.scalars():
        x.store(MY_LANE, part, 0)


def ear_at_rest(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear if e = 0: sets required forces and dependent accelerations to zero (sources at rest)."""
    for k, dependent in enumerate(kind.dependent):
        for part in (*fields.needed.scalars(), *(fields.dependent_acceleration(j) for j in dependent)):
            x.store(MY_LANE[k], part, 0)


def link_solution(x: Scope, kind: LinkKind) -> None:
    """Inward block of a link: the recursion of the bias force, with partners. Eqs. 45, 53."""
    own, children = (x.load(store, of) for store, of in ((MY_LANE, fields.needed), (LME, fields.articulated_force)))
    _eliminate(x, kind, [x.let("P", v, "Eq. 45", lanes=True) for v in add(own, children)])


def link_virtual(x: Scope, kind: LinkKind) -> None:
    """Inward block of a link like `link_solution`, for e = 0: the loops' conditions have zero right sides."""
    _eliminate(x, kind, [*x.load(LME, fields.articulated_force)])


def _eliminate(x: Scope, kind: LinkKind, P: Vector) -> None:
    joint = kind.joint(x, kind, lanes=True)
    if joint.driven:
        x.store(MY_LANE, fields.driving_rest, x.let("ddrive", joint.driven_column.along(P), "Eq. 53", lanes=True))
    of_partners = eliminate(x, kind, joint.columns, P, [x.entry(RIGHT_SIDE, j) for j in range(joint.freedoms)])
    for m in others(kind):
        add_partner_force(x, kind, m, of_partners[m], lanes=True)
    if kind.has_parent:
        force, beside = force_to_parent(x, joint, P, "Eq. 45"), of_partners.get(kind.partners.base)
        if beside is not None:
            force = [x.let("beside", v, "Eq. 45", lanes=True) for v in add(force, beside)]
        propagate_lanes(x, kind, force)


def ear_solution(x: Scope, kind: EarKind) -> None:
    """Inward block of an ear: residuals of the forces along the ear's joints, projected onto the sources. Eqs. 45,
    53."""
    _project(x, kind, fields.needed)


def ear_virtual(x: Scope, kind: EarKind) -> None:
    """Inward block of an ear like `ear_solution`, for e = 0: the loops' conditions have zero right sides."""
    _project(x, kind, None)


def _project(x: Scope, kind: EarKind, own: SixField | None) -> None:
    ear = EarGeometry(x, kind)
    force = forces_from_outboard(x, kind, own)
    on_roots = propagate(x, ear, force)

    def residual(k: int, j: int) -> Value:
        along = column_of(ear, k, j).along(force[k])
        if kind.links[k].joint.driven:
            return along
        view, a = ear.members[k].view, rotor(ear.members[k].view, kind.links[k], j)
        along = along - view.entry(RIGHT_SIDE, j)
        if own is None or is_zero(a) or j not in kind.dependent[k]:
            return along
        return along + a * x.load(MY_LANE[k], fields.dependent_acceleration(j))

    r = {c: residual(k, j) for c, (k, j) in own_sources(kind).items()}
    for n, (k, j) in enumerate(dependents(kind)):
        value = x.let("gamma", residual(k, j), "Eq. 53", lanes=True)
        for c in range(kind.total):
            r[c] = r.get(c, 0) + x.load(EAR, fields.dependent_rate(n, c)) * value
    for c, value in r.items():
        x.store(LREGION.sum, fields.source_tangent_force(c), x.let("r", value, "Eq. 53", lanes=True))
    add_to_roots(x, ear, on_roots)


# -- accelerations from those of independent speeds: E x = e ---------------------------------------------------------------


def link_given(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: its acceleration from that of its joint, and the force that it requires. Eqs. 19, 23."""
    joint = kind.joint(x, kind, lanes=True)
    rates = [x.entry(RIGHT_SIDE, j) for j in range(joint.freedoms)]
    _store_given(x, moved_by(x, joint, x.load(LUP, fields.explicit_acceleration), rates, "Eq. 19"), rates)


def ear_given(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: accelerations of its links from those of the other joints, and required forces. Eqs. 19,
    23, 31."""
    ear = EarGeometry(x, kind)
    before = [of_root(x, root) for root in ear.roots]
    free = {k: range(link.joint.freedoms) for k, link in enumerate(kind.links)}
    rates = {(k, j): x.entry(RIGHT_SIDE[k], j) for k, all in free.items() for j in all if j not in kind.dependent[k]}
    rates |= _dependent_rates(x, ear, before, rates)
    for k, A in enumerate(_accelerations(ear, before, rates)):
        _store_given(ear.members[k].view, A, [rates[k, j] for j in free[k]])


def _store_given(x: Scope, A: Vector, rates: list[Value]) -> None:
    force: Vector = [0] * 6
    add_inertial_force(x, force, A)
    x.store(MY_LANE, fields.total_needed, [x.let("f", e, "Eq. 23", lanes=True) for e in force])
    for j, rate in enumerate(rates):
        x.set_entry(DUDOT, j, rate)
