"""Kinematic sweep, outward: velocities, acceleration remainders, generalised forces. Eqs. 18-24."""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import XYZ, VectorField
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..joints.transform import JointTransform
from ..spatial import add, cross, matmul, matvec
from ..stores import CONSTANTS, COORDINATES, DQ, DQDOT, DU, LME, ME, MY_LANE, QDOT, SPEEDS, UP
from ..structure.freedoms import COORDINATE_START
from ..structure.kinds import LinkKind
from .tangents import differentiate, store_tangent, tangent


def acceleration_matrix(x: Scope, w: Vector, al: Vector, name: str = "B") -> Matrix:
    """``B = alpha x + omega x omega x``: acceleration of a point r of the link is ``a + B r`` (part of Eq. 21)."""
    tag = "Eq. 21"
    sq = [x.let(f"{name}_w{i}{i}", w[k] * w[k], tag) for k, i in enumerate(XYZ)]
    B: Matrix = [[0] * 3 for _ in range(3)]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        B[i][i] = x.let(f"{name}_{XYZ[i]}{XYZ[i]}", -(sq[j] + sq[k]), tag)
        product = x.let(f"{name}_w{XYZ[j]}{XYZ[k]}", w[j] * w[k], tag)
        B[k][j] = x.let(f"{name}_{XYZ[k]}{XYZ[j]}", product + al[i], tag)
        B[j][k] = x.let(f"{name}_{XYZ[j]}{XYZ[k]}", product - al[i], tag)
    return B


def angular_velocity(
    x: Scope, kind: LinkKind, joint: JointTransform, field: VectorField = fields.angular_velocity
) -> tuple[Vector, Vector]:
    """Angular velocity of the parent in the link's axes, and of the link. Eq. 18."""
    carried = joint.to_child(x.load(UP, field), "wp", "Eq. 18")
    return carried, turning(x, kind, carried)


def turning(x: Scope, kind: LinkKind, carried: Vector) -> Vector:
    """Angular velocity of a link from that of its parent, in the link's axes. Eq. 18."""
    w = list(carried)
    if kind.joint == "revolute":
        w[kind.axis] = x.let(f"w_{XYZ[kind.axis]}", w[kind.axis] + x.entry(SPEEDS, 0), "Eq. 18")
    elif kind.joint in ("spherical", "free"):
        w = x.let_vector("w", add(w, [x.entry(SPEEDS, i) for i in range(3)]), "Eq. 18")
    return w


def relative_bias(x: Scope, kind: LinkKind, carried: Vector) -> tuple[Vector, Vector]:
    """Angular and linear acceleration remainder that the joint itself contributes. Eqs. 20, 21."""
    zero: Vector = [0, 0, 0]
    if kind.joint == "revolute":
        e = list(zero)
        e[kind.axis] = x.entry(SPEEDS, 0)
        return cross(carried, e), zero
    if kind.joint == "prismatic":
        e = list(zero)
        e[kind.axis] = x.let("u2", 2 * x.entry(SPEEDS, 0), "Eq. 21")
        return zero, cross(carried, e)
    turn = [x.entry(SPEEDS, i) for i in range(3)]
    if kind.joint == "spherical":
        return cross(carried, turn), zero
    slide = [x.entry(SPEEDS, i) for i in range(3, 6)]
    # d/dt (R v) = R (v' + w_rel x v), and Coriolis 2 w_pr x v
    sweep = x.let_vector("sweep", [turn[i] + 2 * carried[i] for i in range(3)], "Eq. 21")
    return cross(carried, turn), cross(sweep, slide)


def body_force(
    x: Scope, w: Vector, al: Vector, a: Vector, B: Matrix, inertia: tuple[Value, Vector, Matrix]
) -> tuple[Vector, Vector]:
    """Moment and force that a link's own inertia needs: minus Eq. 24, about the frame's origin.

    `inertia` is mass, first moment and inertia about that origin, in the axes of the others.
    """
    m, h, J = inertia
    force = x.let_vector("f", [m * a[k] + matvec(B, h)[k] for k in range(3)], "Eq. 24")
    moment = add(matvec(J, al), cross(h, a), gyroscopic_moment(x, w, J))
    moment = x.let_vector("n", moment, "Eq. 24")
    return moment, force


def less_external(
    x: Scope, kind: LinkKind, needed: tuple[Vector, Vector], lanes: bool = False
) -> tuple[Vector, Vector]:
    """What is left of the force that a link needs when springs have acted on it (R of Eq. 24)."""
    if not kind.pulled:
        return needed
    store = MY_LANE if lanes else ME
    n, f = (
        [x.let("less", e - acting, "Eq. 24", lanes=lanes) for e, acting in zip(v, x.load(store, field), strict=True)]
        for v, field in zip(needed, (fields.external.angular, fields.external.linear), strict=True)
    )
    return n, f


def gyroscopic_moment(x: Scope, w: Vector, J: Matrix) -> Vector:
    """``omega x J omega`` with the products of omega named, so that they are shared with `acceleration_matrix`."""
    sq = [x.let(f"B_w{i}{i}", w[k] * w[k], "Eq. 24") for k, i in enumerate(XYZ)]
    out: Vector = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        jk = x.let(f"B_w{XYZ[j]}{XYZ[k]}", w[j] * w[k], "Eq. 24")
        ij = x.let(f"B_w{XYZ[i]}{XYZ[j]}", w[i] * w[j], "Eq. 24")
        ik = x.let(f"B_w{XYZ[i]}{XYZ[k]}", w[i] * w[k], "Eq. 24")
        difference = x.let("dJ", J[k][k] - J[j][j], "Eq. 24")
        squares = x.let("sq", sq[j] - sq[k], "Eq. 24")
        out.append(difference * jk + J[j][k] * squares + J[i][k] * ij - J[i][j] * ik)
    return out


def own_inertia(x: Scope) -> tuple[Value, Vector, Matrix]:
    """Mass, first moment and inertia of a link, in its own axes about its origin."""
    return x.load(CONSTANTS, fields.mass), x.load(CONSTANTS, fields.first_moment), x.load(CONSTANTS, fields.inertia)


def accelerate(
    x: Scope, kind: LinkKind, joint: JointTransform, carried: Vector, motion: fields.MotionFields = fields.remainder
) -> tuple[Vector, Vector]:
    """Acceleration of the link's frame with udot = 0 of its own joint. Eqs. 19-21.

    `motion` is what of the parent it starts from: the remainders, or the total accelerations.
    """
    return accelerated(x, kind, joint, carried, (x.load(UP, motion.al), x.load(UP, motion.a), x.load(UP, motion.B)))


def accelerated(
    x: Scope, kind: LinkKind, joint: JointTransform, carried: Vector, before: tuple[Vector, Vector, Matrix]
) -> tuple[Vector, Vector]:
    """The same from the parent's angular acceleration, acceleration and B, in the parent's axes."""
    al_bias, a_bias = relative_bias(x, kind, carried)
    al = joint.to_child(before[0], "alp", "Eq. 21")
    a = joint.to_child(add(before[1], matvec(before[2], joint.offset())), "ap", "Eq. 21")
    al = x.let_vector("al", add(al, al_bias), "Eq. 21")
    a = x.let_vector("a", add(a, a_bias), "Eq. 21")
    return al, a


def kinematics(x: Scope, kind: LinkKind) -> None:
    """Outward block of the forward dynamics: motion with udot = 0 and the force it needs."""
    joint = JointTransform(x, kind)
    carried, w = angular_velocity(x, kind, joint)
    al, a = accelerate(x, kind, joint, carried)
    B = acceleration_matrix(x, w, al)
    moment, force = less_external(x, kind, body_force(x, w, al, a, B, own_inertia(x)))
    x.store(ME, fields.parents_velocity, carried)
    x.store(ME, fields.angular_velocity, w)
    x.store(ME, fields.remainder.al, al)
    x.store(ME, fields.remainder.a, a)
    x.store(ME, fields.remainder.B, B)
    x.store(ME, fields.needed.angular, moment)
    x.store(ME, fields.needed.linear, force)


def quaternion_matrix(x: Scope, kind: LinkKind) -> None:
    """Rotation matrix of e/|e|, child to parent components; written with 2/|e|^2, so any e will do."""
    n = COORDINATE_START[kind.joint]
    w, i, j, k = (x.entry(COORDINATES, n + m) for m in range(4))
    tag = "Eq. 22"
    s = x.let("s", 2 / x.let("ee", w * w + i * i + j * j + k * k, tag), tag)
    si, sj, sk = (x.let(f"s{name}", s * v, tag) for name, v in (("i", i), ("j", j), ("k", k)))
    wi, wj, wk = (x.let(f"w{name}", w * v, tag) for name, v in (("i", si), ("j", sj), ("k", sk)))
    ii, jj, kk = x.let("ii", i * si, tag), x.let("jj", j * sj, tag), x.let("kk", k * sk, tag)
    ij, ik, jk = x.let("ij", i * sj, tag), x.let("ik", i * sk, tag), x.let("jk", j * sk, tag)
    Q = [[1 - (jj + kk), ij - wk, ik + wj], [ij + wk, 1 - (ii + kk), jk - wi], [ik - wj, jk + wi, 1 - (ii + jj)]]
    named = [[x.let(f"Q_{XYZ[a]}{XYZ[b]}", Q[a][b], tag) for b in range(3)] for a in range(3)]
    x.store(ME, fields.quaternion_matrix, named)


def quaternion_turn(x: Scope, kind: LinkKind) -> None:
    """Rotation vector, in the link's axes, that belongs to a quaternion's tangent: ``2 e* de / |e|^2``, a radial one is zero."""
    n = COORDINATE_START[kind.joint]
    w, i, j, k = (x.entry(COORDINATES, n + m) for m in range(4))
    dw, di, dj, dk = (x.entry(DQ, n + m) for m in range(4))
    tag = "d Eq. 22"
    s = x.let("s", 2 / x.let("ee", w * w + i * i + j * j + k * k, tag), tag)
    w, i, j, k = (x.let("e", s * v, tag) for v in (w, i, j, k))
    turn = (
        w * di - i * dw - j * dk + k * dj,
        w * dj - j * dw - k * di + i * dk,
        w * dk - k * dw - i * dj + j * di,
    )
    for m in range(3):
        x.store(MY_LANE, fields.turn(m), x.let("turn", turn[m], tag, lanes=True))


def coordinate_rates(x: Scope, kind: LinkKind) -> None:
    """Time derivatives of the coordinates. Eq. 1: of a quaternion ``e (0, omega) / 2``, of a position ``R v``."""
    if kind.joint in ("revolute", "prismatic"):
        x.set_entry(QDOT, 0, x.entry(SPEEDS, 0))
        if x.tangents:
            x.set_entry(DQDOT, 0, x.entry(DU, 0))
        return
    joint = JointTransform(x, kind)
    n = COORDINATE_START[kind.joint]
    tag = "Eq. 1"
    half = x.half
    w, i, j, k = (x.let("e", half * x.entry(COORDINATES, n + m), tag) for m in range(4))
    wx, wy, wz = (x.entry(SPEEDS, m) for m in range(3))
    rates = [-i * wx - j * wy - k * wz, w * wx + j * wz - k * wy, w * wy + k * wx - i * wz, w * wz + i * wy - j * wx]
    if kind.joint == "free":
        rates = matvec(joint.matrix, [x.entry(SPEEDS, m) for m in range(3, 6)]) + rates
    rates = [x.let("rate", e, tag) for e in rates]
    for m, value in enumerate(rates):
        x.set_entry(QDOT, m, value)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for m, value in enumerate(rates):
            x.set_entry(DQDOT, m, tangent(d, value))


def origin_velocity(
    x: Scope,
    kind: LinkKind,
    joint: JointTransform,
    w: VectorField = fields.angular_velocity,
    velocity: VectorField = fields.velocity,
) -> Vector:
    """Velocity of the link's origin in its own axes. Eq. 18."""
    moved = add(x.load(UP, velocity), cross(x.load(UP, w), joint.offset()))
    v = joint.to_child(moved, "v", "Eq. 18")
    if kind.joint == "prismatic":
        v = list(v)
        v[kind.axis] = x.let("v", v[kind.axis] + x.entry(SPEEDS, 0), "Eq. 18")
    elif kind.joint == "free":
        v = [x.let("v", v[k] + x.entry(SPEEDS, 3 + k), "Eq. 18") for k in range(3)]
    return v


def pose(x: Scope, kind: LinkKind) -> None:
    """Position of the link's origin and its rotation matrix (ground from link components)."""
    joint = JointTransform(x, kind)
    W = x.load(UP, fields.attitude)
    position = add(x.load(UP, fields.position), matvec(W, joint.offset()))
    position = x.let_vector("pos", position, "Eq. 22")
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
    x.store(ME, fields.position, position)
    x.store(ME, fields.attitude, W)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for store in (LME, MY_LANE):
            store_tangent(x, d, (store,), fields.position, position)
            x.store(store, fields.attitude, [[tangent(d, e) for e in row] for row in W])
