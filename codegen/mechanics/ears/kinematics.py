"""Motion of an ear's links with the sources at rest, and the force that it requires. Eqs. 18-24, 31, 38.

The dependent joints have the accelerations that closure requires. For links outboard of the ear, motions are also stored
along the axes of the ear's links.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import ZERO, add, cross, dot, is_zero, matmul, matvec, minus, symmetric, transpose, turned
from ..stores import CONSTANTS, EAR, ME
from ..structure.kinds import EarKind
from ..tree.kinematics import acceleration_matrix, body_force
from .closing_accelerations import closing_accelerations
from .closures import stored_factor
from .conditions import kept_conditions
from .geometry import EarGeometry
from .members import Member, joint_motion
from .motions import Motion


def link_constants(x: Scope, ear: EarGeometry, k: int) -> tuple[Value, Vector, Matrix]:
    """Mass, first moment and inertia of a link about its origin, along region axes."""
    member = ear.members[k]
    m = member.view.load(CONSTANTS, fields.mass)
    h = ear.fixed_vector("h", k, member.view.load(CONSTANTS, fields.first_moment), "Eq. 23")
    return m, h, rotated_inertia(x, member.W, member.view.load(CONSTANTS, fields.inertia), "Eq. 23")


def rotated_inertia(x: Scope, W: Matrix, J: Matrix, tag: str) -> Matrix:
    """An inertia rotated by W: ``W J W^T``."""
    axis = None if x.structural else _axis_of_symmetry(J)
    if axis is not None:
        # J = a (1 - e e^T) + c e e^T; 1 - e e^T is computed as sums of squares, so that nothing cancels in its entries
        e = [W[i][axis] for i in range(3)]
        c, a = J[axis][axis], J[axis - 1][axis - 1]
        squares = [x.let("ee", v * v, tag) for v in e]
        across = [a * x.let("es", squares[i - 2] + squares[i - 1], tag) + c * squares[i] for i in range(3)]
        for i, row in enumerate(W):
            if (j := _kept_axis(row)) is not None:
                across[i] = J[j][j]  # equals the sum above; where patterns have a constant, the statement must have it
        more = x.let("ca", c - a, tag)
        mixed = [more * x.let("ee", e[i] * e[j], tag) for i, j in ((0, 1), (0, 2), (1, 2))]
        return symmetric([x.let("J", v, tag) for v in (*across, *mixed)])
    half = [[x.let("WJ", e, tag) for e in row] for row in matmul(W, J)]
    entries = [dot(half[i], W[j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return symmetric([x.let("J", e, tag) for e in entries])


def _axis_of_symmetry(J: Matrix) -> int | None:
    """The axis of symmetry of a diagonal inertia, if the moments about the other two axes are the same constant."""
    if not all(is_zero(J[i][j]) for i, j in ((0, 1), (0, 2), (1, 2))):
        return None
    for axis in range(3):
        a, b = J[axis - 1][axis - 1], J[axis - 2][axis - 2]
        if a == b and not is_zero(a):
            return axis
    return None


def _kept_axis(row: Sequence[Value]) -> int | None:
    """The axis of a link that is parallel to an axis of the region in every state; None if there is none."""
    places = [j for j, v in enumerate(row) if not is_zero(v)]
    return places[0] if len(places) == 1 and row[places[0]] in (1, -1) else None


def joint_bias(x: Scope, member: Member, w_before: Vector, speeds: Vector) -> tuple[Vector, Vector]:
    """Angular and linear acceleration that a joint adds with udot = 0. Eq. 21."""
    turning, sliding = ([x.let("rel", e, "Eq. 21") for e in v or ZERO] for v in joint_motion(member.freedoms, speeds))
    own = turning if member.joint.swings else ZERO
    twice = [2 * w_before[i] + own[i] for i in range(3)] if any(not is_zero(v) for v in sliding) else list(ZERO)
    twice = [x.let("sweep", e, "Eq. 21") for e in twice]
    return cross(w_before, turning), cross(twice, sliding)


def member_motion(x: Scope, member: Member, before: Motion, extra: Vector | None = None) -> Motion:
    """The motion of a link from that of its parent; `extra` is the joint's udot, by default zero or as prescribed."""
    speeds = member.speeds
    turning, _ = joint_motion(member.freedoms, speeds)
    w = x.let_vector("w", add(before.w, turning or ZERO), "Eq. 18")
    al_bias, a_bias = joint_bias(x, member, before.w, speeds)
    al = add(before.al, al_bias)
    a = add(before.at(member.rho), a_bias)
    extra = member.given_accelerations or extra
    if extra is not None:
        turning, sliding = joint_motion(member.freedoms, extra)
        al, a = add(al, turning or ZERO), add(a, sliding or ZERO)
    al = x.let_vector("al", al, "Eq. 21")
    a = x.let_vector("a", a, "Eq. 21")
    return Motion(w, al, a, acceleration_matrix(x, w, al))


def face_motion(
    ear: EarGeometry, motions: list[Motion], roots: list[Motion], c: int, side: int
) -> tuple[Vector, Vector, Vector]:
    """Angular velocity, angular acceleration and acceleration of a loop's face."""
    place = ear.kind.closures[c].faces[side]
    m = motions[place] if place >= 0 else roots[-1 - place]
    return m.w, m.al, m.at(ear.arm(c, side))


def ear_kinematics(x: Scope, kind: EarKind) -> None:
    """Outward block: motion with the sources at rest and the dependent accelerations that closure requires, and the
    required force."""
    ear = EarGeometry(x, kind)
    rows = kept_conditions(ear)
    roots = [root.motion(False) for root in ear.roots]
    motions: list[Motion] = []
    for member in ear.members:
        before = motions[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
        motions.append(member_motion(x, member, before))
    if rows:
        given = [m.given_accelerations or [0] * len(m.freedoms) for m in ear.members]
        b = closing_accelerations(x, ear, rows, partial(face_motion, ear, motions, roots), given, "b")
        rates = stored_factor(x, kind).solve([-v for v in b], "y", "Eq. 38")
        added = ear.walk(ear.still(), ear.coefficients(rates), "e", "Eq. 38")
        for d, y in enumerate(rates):
            x.store(EAR, fields.dependent_remainder(d), y)
        for k, m in enumerate(motions):
            al = x.let_vector("al", add(m.al, added[k].angular), "Eq. 31")
            a = x.let_vector("a", add(m.a, added[k].linear), "Eq. 31")
            motions[k] = Motion(m.w, al, a, acceleration_matrix(x, m.w, al))
    store_motions(x, ear, motions, False)


def store_motions(x: Scope, ear: EarGeometry, motions: list[Motion], total: bool) -> None:
    """Store the motions of an ear's links, either `total` or with the sources at rest, and the forces that they
    require. Eq. 24."""
    motion, needed = (fields.ear_total, fields.ear_total_needed) if total else (fields.ear_remainder, fields.ear_needed)
    for k, m in enumerate(motions):
        me, constants = ME[k], link_constants(x, ear, k)
        force = body_force(x, m.w, m.al, m.a, m.B, constants)
        if not total:
            x.store(me, fields.ear_first_moment, constants[1])
            x.store(me, fields.ear_inertia, constants[2])
        m.store(x, me, motion)
        x.store(me, needed, less_external_of(x, ear, k, force))
        if ear.kind.links[k].carries:
            hand_outward(x, me, ear.members[k].W, m, total)


def less_external_of(x: Scope, ear: EarGeometry, k: int, needed: Vector) -> Vector:
    """The force that a link requires minus the force of its force elements, along region axes."""
    if not ear.kind.links[k].pulled:
        return needed
    acting = turned(ear.members[k].W, x.load(ME[k], fields.external))
    return [x.let("less", e, "Eq. 24") for e in minus(needed, acting)]


def hand_outward(x: Scope, store: Store, W: Matrix, m: Motion, total: bool) -> None:
    """Stores the motion of a link along its own axes for its children."""
    back = transpose(W)
    w, al, a = ([x.let("own", e, "Eq. 22") for e in matvec(back, v)] for v in (m.w, m.al, m.a))
    motion = fields.total if total else fields.remainder
    if not total:
        x.store(store, motion.w, w)
    x.store(store, motion.al, al)
    x.store(store, motion.a, a)
    x.store(store, motion.B, acceleration_matrix(x, w, al))
