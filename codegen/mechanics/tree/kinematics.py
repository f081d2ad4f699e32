"""Kinematic sweep, outward: velocities, acceleration remainders, generalised forces. Eqs. 18-24."""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import XYZ, VectorField
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..joints import LinkJoint
from ..joints.quaternion import QuaternionJoint
from ..spatial import add, cross, matvec, minus
from ..stores import CONSTANTS, DQDOT, ME, MY_LANE, QDOT, UP
from ..structure.kinds import LinkKind
from .tangents import differentiate, store_motion, tangent


def acceleration_matrix(x: Scope, w: Vector, al: Vector) -> Matrix:
    """``B = alpha x + omega x omega x``: the acceleration of a point r of the link is ``a + B r`` (part of Eq. 21)."""
    tag = "Eq. 21"
    sq = [x.let(f"B_w{i}{i}", w[k] * w[k], tag) for k, i in enumerate(XYZ)]
    B: Matrix = [[0] * 3 for _ in range(3)]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        B[i][i] = x.let(f"B_{XYZ[i]}{XYZ[i]}", -(sq[j] + sq[k]), tag)
        product = x.let(f"B_w{XYZ[j]}{XYZ[k]}", w[j] * w[k], tag)
        B[k][j] = x.let(f"B_{XYZ[k]}{XYZ[j]}", product + al[i], tag)
        B[j][k] = x.let(f"B_{XYZ[j]}{XYZ[k]}", product - al[i], tag)
    return B


def angular_velocity(x: Scope, joint: LinkJoint, field: VectorField = fields.angular_velocity) -> tuple[Vector, Vector]:
    """Angular velocity of the parent along the link's axes, and of the link. Eq. 18."""
    carried = joint.to_child(x.load(UP, field), "wp", "Eq. 18")
    return carried, joint.turning(carried)


def body_force(x: Scope, w: Vector, al: Vector, a: Vector, B: Matrix, inertia: tuple[Value, Vector, Matrix]) -> Vector:
    """Moment and force that a link's own inertia requires: minus Eq. 24, about the frame's origin.

    `inertia` is mass, first moment and inertia about that origin, along the axes of the other arguments.
    """
    m, h, J = inertia
    force = x.let_vector("f", [m * a[k] + matvec(B, h)[k] for k in range(3)], "Eq. 24")
    moment = add(matvec(J, al), cross(h, a), gyroscopic_moment(x, w, J))
    return x.let_vector("n", moment, "Eq. 24") + force


def less_external(x: Scope, kind: LinkKind, needed: Vector, lanes: bool = False) -> Vector:
    """The moment and force that a link requires minus the wrench of force elements on it (R of Eq. 24)."""
    if not kind.pulled:
        return needed
    acting = x.load(MY_LANE if lanes else ME, fields.external)
    return [x.let("less", e, "Eq. 24", lanes=lanes) for e in minus(needed, acting)]


def gyroscopic_moment(x: Scope, w: Vector, J: Matrix) -> Vector:
    """``omega x J omega`` with named products of omega, which `acceleration_matrix` shares."""
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
    """Mass, first moment and inertia of a link about its origin, along its own axes."""
    return x.load(CONSTANTS, fields.mass), x.load(CONSTANTS, fields.first_moment), x.load(CONSTANTS, fields.inertia)


def accelerate(
    x: Scope, joint: LinkJoint, carried: Vector, motion: fields.MotionFields = fields.remainder
) -> tuple[Vector, Vector]:
    """Acceleration of the link's frame with udot = 0 in its own joint. Eqs. 19-21.

    `motion` selects the motion of the parent: its remainder, or its total accelerations.
    """
    return accelerated(x, joint, carried, (x.load(UP, motion.al), x.load(UP, motion.a), x.load(UP, motion.B)))


def accelerated(
    x: Scope, joint: LinkJoint, carried: Vector, before: tuple[Vector, Vector, Matrix]
) -> tuple[Vector, Vector]:
    """The acceleration of the link's frame, from the parent's angular acceleration, acceleration and B, along the
    parent's axes."""
    al_bias, a_bias = joint.bias(carried)
    al = joint.to_child(before[0], "alp", "Eq. 21")
    a = joint.to_child(add(before[1], matvec(before[2], joint.offset())), "ap", "Eq. 21")
    al = x.let_vector("al", add(al, al_bias), "Eq. 21")
    a = x.let_vector("a", add(a, a_bias), "Eq. 21")
    return al, a


def kinematics(x: Scope, kind: LinkKind) -> None:
    """Outward block of forward dynamics: motion with udot = 0 and the force that it requires."""
    joint = kind.joint(x, kind)
    carried, w = angular_velocity(x, joint)
    al, a = accelerate(x, joint, carried)
    B = acceleration_matrix(x, w, al)
    force = less_external(x, kind, body_force(x, w, al, a, B, own_inertia(x)))
    x.store(ME, fields.parents_velocity, carried)
    x.store(ME, fields.angular_velocity, w)
    x.store(ME, fields.remainder.al, al)
    x.store(ME, fields.remainder.a, a)
    x.store(ME, fields.remainder.B, B)
    x.store(ME, fields.needed, force)


def rotations(x: Scope, kind: LinkKind) -> None:
    """Rotation matrix of a quaternion."""
    joint = kind.joint(x, kind)
    assert isinstance(joint, QuaternionJoint)
    joint.write_rotation()


def turns(x: Scope, kind: LinkKind) -> None:
    """Rotation vector of a quaternion's seed."""
    joint = kind.joint(x, kind)
    assert isinstance(joint, QuaternionJoint)
    joint.write_turn()


def coordinate_rates(x: Scope, kind: LinkKind) -> None:
    """Time derivatives of the coordinates. For a quaternion e: ``e (0, omega) / 2``; for a position: ``R v``. Eq. 1."""
    joint = kind.joint(x, kind)
    rates = [x.let("rate", e, "Eq. 1") for e in joint.rates()]
    for m, value in enumerate(rates):
        x.set_entry(QDOT, m, value)
    if x.tangents:
        d = differentiate(x, kind, joint)
        for m, value in enumerate(rates):
            x.set_entry(DQDOT, m, tangent(d, value))


def origin_velocity(
    x: Scope,
    joint: LinkJoint,
    w: VectorField = fields.angular_velocity,
    velocity: VectorField = fields.velocity,
) -> Vector:
    """Velocity of the link's origin along its own axes. Eq. 18."""
    moved = add(x.load(UP, velocity), cross(x.load(UP, w), joint.offset()))
    return joint.sliding(joint.to_child(moved, "v", "Eq. 18"))


def pose(x: Scope, kind: LinkKind) -> None:
    """Position of the link's origin and its rotation matrix (ground from link components)."""
    joint = kind.joint(x, kind)
    W = x.load(UP, fields.attitude)
    position = add(x.load(UP, fields.position), matvec(W, joint.offset()))
    position = x.let_vector("pos", position, "Eq. 22")
    W = joint.attitude(W)
    store_motion(x, kind, joint, ((fields.position, position), (fields.attitude, W)))
