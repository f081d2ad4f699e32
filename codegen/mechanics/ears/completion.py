"""Completion of seeds: dq and du of the dependent joints, by differentiated closure. Section 4.6 of the theory page.

Position and velocity closure are differentiated one after the other. The same factored closure matrix gives the dependent entries
of both. Links from which ears start propagate their displacement and rotation along a direction.
"""

from __future__ import annotations

from ...program.algebra import Symbol
from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..joints import LinkJoint
from ..propagation import clear
from ..spatial import ZERO, add, cross, dot, is_zero, matvec, minus, rotate, scale, transpose
from ..stores import BASE, CL_DP, CONSTANTS, DP, DPOSITION, DQ, DU, LBASE, LME, LOOP_CONSTANTS, LUP, MY_LANE, SPEEDS
from ..structure.kinds import EarKind, LinkKind
from ..tree.kinematics import angular_velocity, origin_velocity
from ..tree.tangents import differentiate, store_tangents
from .closures import named_root_velocities, stored_factor
from .conditions import Condition, components_along, joint_conditions, kept_conditions
from .couplings import displacement
from .geometry import EarGeometry
from .members import joint_motion
from .motions import Twist
from .tangents import ear_tangents, tangents_of

# -- links that ears start from ----------------------------------------------------------------------------------------


def link_displacement(x: Scope, kind: LinkKind) -> None:
    """Outward block over directions of a link from which ears start: rotation vector, displacement, tangents of its velocity.

    All have components along the link's axes, relative to the origin.
    """
    if kind.closed_on == "origin":
        undisplaced(x, LME, MY_LANE)
    if kind.closed_on != "moving":
        return
    joint = kind.joint(x, kind)
    theta = x.load(LUP, fields.closing_shift.angular)
    d = x.load(LUP, fields.closing_shift.linear)
    moving = kind.joint(x, kind, lanes=True)
    r = joint.offset()
    tag = "d Eq. 22"
    turn, slide = joint.displacement()
    local, about = parameter_displacement(x, kind, joint)
    theta_here = moving.to_child(add(theta, about), "ct", tag)
    d_here = moving.to_child(add(d, cross(theta, r), local), "cd", tag)
    shift = [
        *x.let_vector("ct", add(theta_here, turn), tag, lanes=True),
        *x.let_vector("cd", add(d_here, slide), tag, lanes=True),
    ]
    for store in (LME, MY_LANE):
        x.store(store, fields.closing_shift, shift)
    twist = fields.closing_twist
    _, w = angular_velocity(x, joint, twist.angular)
    v = origin_velocity(x, joint, twist.angular, twist.linear)
    tangents = differentiate(x, kind, joint)
    store_tangents(x, tangents, (LME, MY_LANE), ((twist.angular, w), (twist.linear, v)))


def undisplaced(x: Scope, *stores: Store) -> None:
    """The displacement of the origin: zero."""
    for store in stores:
        for field in (fields.closing_shift, fields.closing_twist):
            clear(x, store, field)


def parameter_displacement(x: Scope, kind: LinkKind, joint: LinkJoint) -> tuple[Vector, Vector]:
    """Displacement and rotation vector of the joint in its parent due to parameters, along the parent's axes."""
    local: Vector = [0, 0, 0]
    about: Vector = [0, 0, 0]
    way, tag = joint.way(), "d Eq. 22"
    for j in range(kind.parameters):
        dp = x.entry(DP, j)
        local = add(local, scale(dp, x.load(CONSTANTS, fields.joint_place.derivative(j))))
        if joint.fixed is not None:
            dR = x.load(CONSTANTS, fields.joint_attitude.derivative(j))
            if not all(is_zero(e) for row in dR for e in row):
                about = add(about, scale(dp, x.let_vector("about", rotation_vector(dR, joint.fixed), tag)))
            if way is not None:
                local = add(local, scale(dp, x.let_vector("moved", matvec(dR, way), tag)))
        more = joint.way_by(j)
        if more is not None:
            more = more if joint.fixed is None else matvec(joint.fixed, more)
            local = add(local, scale(dp, x.let_vector("moved", more, tag)))
    return local, about


def rotation_vector(dR: Matrix, R: Matrix) -> Vector:
    """Rotation vector of ``dR R^T``."""
    return [dot(dR[i - 1], R[i - 2]) for i in range(3)]


# -- ears --------------------------------------------------------------------------------------------------------------


def complete(x: Scope, kind: EarKind) -> None:
    """Outward block over directions: dq and du of the dependent joints, by differentiated position and velocity closure."""
    ear = EarGeometry(x, kind)
    angles: dict[int, Vector] = {}
    moved: dict[int, Vector] = {}
    for t, root in enumerate(ear.roots):
        angles[-1 - t], moved[-1 - t] = root.rotation(False), root.displacement(False)
    dq = complete_positions(x, ear, angles, moved)
    complete_velocities(x, ear, angles, moved, dq)


def complete_positions(
    x: Scope, ear: EarGeometry, angles: dict[int, Vector], moved: dict[int, Vector]
) -> dict[tuple[int, int], Value]:
    """Displacements of the ear's links, stored in `angles` and `moved`, and dq of dependent joints by link and
    coordinate."""
    kind, tag = ear.kind, "d Eq. 22"
    for k, member in enumerate(ear.members):
        view = member.view
        W = ear.attitude(member.parent)
        own = [f for f in member.freedoms if f.index not in kind.dependent[k]]
        turn, slide = joint_motion(own, [member.joint.along_freedom(f.index) for f in own])
        local, about = parameter_displacement(view, kind.links[k], member.joint)
        theta, d = angles[member.parent], moved[member.parent]
        angles[k] = x.let_vector(
            "th", add(theta, rotate(W, x.let_vector("about", about, tag, lanes=True)), turn or ZERO), tag, lanes=True
        )
        moved[k] = x.let_vector(
            "d",
            add(d, cross(theta, member.rho), rotate(W, x.let_vector("dr", local, tag, lanes=True)), slide or ZERO),
            tag,
            lanes=True,
        )
    dq: dict[tuple[int, int], Value] = {}
    rows = kept_conditions(ear)
    if rows:
        b = components_along(ear, rows, cut_displacements(x, ear, angles, moved, False), "b", "d Eq. 30", lanes=True)
        b = [with_parameters(x, row, value) for row, value in zip(rows, b, strict=True)]
        rates = stored_factor(x, kind).solve([-v for v in b], "dx", "d Eq. 30", lanes=True)
        for k, added in enumerate(ear.walk(ear.still(), ear.coefficients(rates), "dd", tag, lanes=True)):
            angles[k] = x.let_vector("th", add(angles[k], added.angular), tag, lanes=True)
            moved[k] = x.let_vector("d", add(moved[k], added.linear), tag, lanes=True)
        dq = dependent_displacements(x, ear, rates)
        for (place, i), value in dq.items():
            x.set_entry(DQ[place], i, value)
    for k in range(len(ear.members)):
        for store in (LME[k], MY_LANE[k]):
            x.store(store, fields.shift, [*angles[k], *moved[k]])
    return dq


def complete_velocities(
    x: Scope, ear: EarGeometry, angles: dict[int, Vector], moved: dict[int, Vector], dq: dict[tuple[int, int], Value]
) -> None:
    """du of the ear's dependent joints, and tangents of its links' velocities."""
    kind = ear.kind
    roots = named_root_velocities(ear)
    velocities = ear.walk(roots, [m.speeds for m in ear.members], "r", "Eq. 30")
    rows = kept_conditions(ear)
    at_cuts = ear.face_difference(velocities, roots, [m.speeds for m in ear.members])
    conditions = components_along(ear, rows, at_cuts, "cv", "Eq. 30")
    seeds: dict[Symbol, Value] = {}
    held: Vector = []
    for t, root in enumerate(ear.roots):
        seeds.update(tangents_of(roots[t].six, root.velocity_tangent(False)))
        held += roots[t].six
        if ear.slides:
            seeds.update(tangents_of(root.position(), moved[-1 - t]))
            held += root.position()
    held += [ear.members[k].view.entry(SPEEDS, freedom.index) for k, freedom in ear.dependents()]
    tangents = ear_tangents(ear, angles, seeds, dq)
    tangents.hold(held)
    tangents.run()
    if rows:
        b = [-tangents.of(v) for v in conditions]
        rates = stored_factor(x, kind).solve(b, "du", "d Eq. 30", lanes=True)
        added = ear.walk(ear.still(), ear.coefficients(rates), "dr", "d Eq. 30", lanes=True)
        pairs = [
            ((v.angular, more.angular), (v.linear, more.linear)) for v, more in zip(velocities, added, strict=True)
        ]
        tangents.correct([pair for both in pairs for pair in both])
        for (k, freedom), value in zip(ear.dependents(), rates, strict=True):
            x.set_entry(DU[k], freedom.index, value)
    for v in ear.fixed:
        if v.kept is not None:
            x.store(*v.kept, tangents.vector(v.found))
    for k, velocity in enumerate(velocities):
        angular, linear = tangents.vector(velocity.angular), tangents.vector(velocity.linear)
        for store in (LME[k], MY_LANE[k]):
            x.store(store, fields.measured_velocity, [*angular, *linear])
        if kind.links[k].closed_on == "origin":
            undisplaced(x, LME[k], MY_LANE[k])
        if kind.links[k].closed_on == "moving":
            member_displacement(x, ear, k, (angles[k], moved[k]), velocity, Twist(angular, linear))


def member_displacement(
    x: Scope, ear: EarGeometry, k: int, displaced: tuple[Vector, Vector], velocity: Twist, tangent: Twist
) -> None:
    """Stores, for a link of an ear on whose motion loops of other regions depend, what `link_displacement` stores for
    links outside ears."""
    kind, tag = ear.kind, "d Eq. 22"
    theta, d = displaced
    W, o = ear.members[k].W, ear.position(k)
    w, v, dw, dv = velocity.angular, velocity.linear, tangent.angular, tangent.linear
    theta_whole, d_whole = list(theta), list(d)
    if kind.carried:
        theta_base, d_base = x.load(LBASE, fields.closing_shift.angular), x.load(LBASE, fields.closing_shift.linear)
        theta_whole, d_whole = add(theta, theta_base), add(d, d_base, cross(theta_base, o))
        if kind.rigid:
            w_base, dw_base = x.load(BASE, fields.closing_twist.angular), x.load(LBASE, fields.closing_twist.angular)
            w = x.let_vector("w", add(w, w_base), "Eq. 18")
            v = x.let_vector("v", add(v, x.load(BASE, fields.closing_twist.linear), cross(w_base, o)), "Eq. 18")
            dw = add(dw, dw_base)
            dv = add(dv, x.load(LBASE, fields.closing_twist.linear), cross(dw_base, o), cross(w_base, d))
    dw = minus(dw, cross(theta, w))
    dv = minus(dv, cross(theta, v))
    back = transpose(W)
    shift, twist = fields.closing_shift, fields.closing_twist
    for field, value in (
        (shift.angular, theta_whole),
        (shift.linear, d_whole),
        (twist.angular, dw),
        (twist.linear, dv),
    ):
        own = x.let_vector(field.name, matvec(back, x.let_vector(field.name, value, tag, lanes=True)), tag, lanes=True)
        for store in (LME[k], MY_LANE[k]):
            x.store(store, field, own)


def dependent_displacements(
    x: Scope, ear: EarGeometry, rates: Vector, lanes: bool = True
) -> dict[tuple[int, int], Value]:
    """dq of dependent joints from displacements along their degrees of freedom; for a quaternion e, ``e (0, theta) / 2``."""
    result: dict[tuple[int, int], Value] = {}
    values: dict[int, dict[int, Value]] = {}
    for (k, freedom), value in zip(ear.dependents(), rates, strict=True):
        values.setdefault(k, {})[freedom.index] = value
    for k, found in values.items():
        changes = ear.members[k].joint.coordinate_changes(found, lanes)
        result |= {(k, i): value for i, value in changes.items()}
    return result


def cut_displacements(
    x: Scope, ear: EarGeometry, angles: dict[int, Vector], moved: dict[int, Vector], complete: bool
) -> list[Twist]:
    """Displacements of end faces relative to start faces; with `complete`, including those due to dependent joints."""
    found = []
    for c, closure in enumerate(ear.kind.closures):
        if closure.is_coupling:
            found.append(displacement(ear, c, complete))
            continue
        sides = []
        for side in (0, 1):
            place = closure.faces[side]
            W = ear.attitude(place)
            theta, d = angles[place], moved[place]
            local, about = face_displacement(x, ear, c, side)
            at = add(d, cross(theta, ear.arm(c, side)), rotate(W, x.let_vector("dr", local, "d Eq. 30", lanes=True)))
            theta = add(theta, rotate(W, x.let_vector("about", about, "d Eq. 30", lanes=True)))
            slip = ear.slip(c) if side == 0 else None
            if slip is not None:
                at = add(at, cross(theta, slip))
            sides.append(
                Twist(
                    x.let_vector("cut", theta, "d Eq. 30", lanes=True), x.let_vector("cut", at, "d Eq. 30", lanes=True)
                )
            )
        found.append(sides[1].minus(sides[0]))
    return found


def with_parameters(x: Scope, row: Condition, value: Value) -> Value:
    """The residual of a condition due to a displacement and to the change of the condition with parameters."""
    if row.surface is None:
        return value
    return x.let("b", value + row.share * row.surface.by_parameters(), "d Eq. 30", lanes=True)


def seed_residuals(x: Scope, kind: EarKind) -> None:
    """Outward block over directions: residuals of the loops' conditions that remain along complete seeds.

    Only a redundant condition can have a residual, for example if a parameter moves a joint out of the plane of a
    planar loop.
    """
    ear = EarGeometry(x, kind)
    angles = {-1 - t: root.rotation(True) for t, root in enumerate(ear.roots)}
    moved = {-1 - t: root.displacement(True) for t, root in enumerate(ear.roots)}
    for k in range(len(ear.members)):
        angles[k], moved[k] = x.load(MY_LANE[k], fields.shift.angular), x.load(MY_LANE[k], fields.shift.linear)
    gaps = cut_displacements(x, ear, angles, moved, True)
    for c in range(len(kind.closures)):
        for i, row in enumerate(joint_conditions(ear, c)):
            value = with_parameters(x, row, dot(row.n, gaps[c].angular if row.angular else gaps[c].linear))
            x.set_entry(DPOSITION[c], i, x.let("open", value, "d Eq. 32", lanes=True))


def face_displacement(x: Scope, ear: EarGeometry, c: int, side: int) -> tuple[Vector, Vector]:
    """Displacement and rotation vector of a face in its link due to the design parameters."""
    name = "AB"[side]
    local: Vector = [0, 0, 0]
    about: Vector = [0, 0, 0]
    closure = ear.kind.closures[c]
    for j in range(closure.parameters):
        dp = x.entry(CL_DP[c], j)
        local = add(local, scale(dp, x.load(LOOP_CONSTANTS[c], fields.face_place(name).derivative(j))))
        if closure.holds == (3, 0) and not closure.gaps:
            continue  # no condition depends on the axes of the face
        _, F = ear.face(c, side)
        dF = x.load(LOOP_CONSTANTS[c], fields.face_axes(name).derivative(j))
        if not all(is_zero(e) for row in dF for e in row):
            about = add(about, scale(dp, x.let_vector("about", rotation_vector(dF, F), "d Eq. 30")))
    return local, about
