"""The derivative primitives of the recursive engine: quantities local to a body or a joint, with their derivatives.

Geometry and inertia are pairs; each quantity depends only on one body's own parameters, coordinates and speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.model import Body, Face, Joint, Loop, Vector, coordinate_axis, least_along
from ..model.motions import Ball, Displacement, Slide, Turn
from ..model.quarter_turns import cosine_and_sine, quarter_turns
from .pairs import Pair, Pairs

HALF_TURN = 1e-12
"""Limit of 4 cos(t/2)^2 below which a rotation by t counts as half a turn."""


@dataclass(slots=True)
class JointTerms:
    """A joint's own kinematics, child body frame relative to joint frame.

    ``R (3, 3)`` maps child components to joint frame components. ``d (3, 1)`` is the child's origin in the joint frame, m. ``P
    (6, f)`` maps the speeds to angular velocity and velocity of the child's origin relative to the parent, in child components.
    ``Pdot_u (6, 1)`` is the derivative of P in child components, times u.
    """

    R: Pair
    d: Pair
    P: Pair
    Pdot_u: Pair


def shift(pairs: Pairs, C: Pair, gamma: Pair) -> Pair:
    """S^k, (6, 6); gamma is in components of k, as C gamma x requires."""
    zero = pairs.zeros(3, 3)
    return pairs.block([[C, C @ pairs.skew(gamma)], [zero, C]])  # Eqs. 22 and 28


def generalised_inertia(body: Body, pairs: Pairs) -> Pair:
    """I^k about the mass centre in body axes, (6, 6)."""
    xx, yy, zz, xy, xz, yz = (pairs.expression(e) for e in body.inertia)
    central = pairs.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = pairs.eye(3) * pairs.expression(body.mass)
    zero = pairs.zeros(3, 3)
    return pairs.block([[central, zero], [zero, mass]])


def axis_rotation(pairs: Pairs, axis: Pair, angle: Pair) -> Pair:
    """Rotation about a unit axis (Euler-Rodrigues formula): U + sin(angle) a x + (1 - cos(angle)) a x a x, (3, 3)."""
    return _rodrigues(pairs, axis, pairs.call("cos", angle), pairs.call("sin", angle))


def _rodrigues(pairs: Pairs, axis: Pair, cosine: Pair, sine: Pair) -> Pair:
    a = pairs.skew(axis)
    return pairs.eye(3) + a * sine + (a @ a) * (pairs.number(1) - cosine)


def quaternion_rotation(pairs: Pairs, e: Pair) -> Pair:
    """Rotation of e/abs(e), e = (w, v): U + 2 (w v x + v x v x)/abs(e)^2, (3, 3)."""
    v, two = pairs.skew(e[1:]), pairs.number(2)
    return pairs.eye(3) + (v * e[0, 0] + v @ v) * (two / pairs.dot(e, e))


def quaternion_rate_matrix(pairs: Pairs, e: Pair) -> Pair:
    """The matrix that maps child components of the angular velocity to edot = e (0, omega)/2, (4, 3)."""
    w, x, y, z = (e[i, 0] for i in range(4))
    return pairs.matrix([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) * (pairs.number(1) / pairs.number(2))


def placed_rotation(placed: Joint | Face, pairs: Pairs) -> Pair:
    """Rotation matrix from a joint frame or face to the body that contains it, (3, 3)."""
    C = pairs.eye(3)
    for axis, angle in placed.rotation:
        about, quarters = pairs.unit(pairs.vector(axis)), quarter_turns(angle)
        if quarters is None:
            C = C @ axis_rotation(pairs, about, pairs.expression(angle))
        else:
            C = C @ _rodrigues(pairs, about, *map(pairs.number, cosine_and_sine(quarters)))
    return C


def condition_frame(pairs: Pairs, axis: Vector, defaults: dict[str, float]) -> tuple[int, Pair]:
    """The frame of a loop joint's conditions, see `closure_row_names`: the index of the axis among its columns, and (3, 3)."""
    along = coordinate_axis(axis)
    if along is not None:
        i, sign = along
        return i, pairs.constant(np.diag([sign if j in (i, (i + 2) % 3) else 1 for j in range(3)]))
    a = pairs.unit(pairs.vector(axis))
    least = least_along(axis, defaults)
    t1 = -pairs.unit(pairs.skew(a)[:, least : least + 1])
    return 2, pairs.block([[t1, pairs.skew(a) @ t1, a]])


def twice_half_sine(pairs: Pairs, R: Pair) -> Pair:
    """2 sin(t/2) a of the rotation by t about a, (3, 1): twice the vector of its unit quaternion with w >= 0."""
    one, zero = pairs.number(1), pairs.number(0)
    four_w2 = one + R[0, 0] + R[1, 1] + R[2, 2]
    if four_w2.value > HALF_TURN:
        axis = pairs.column([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])  # 4 w v
        return axis * (one / pairs.call("sqrt", four_w2))
    i = int(np.argmax(np.diagonal(R.value)))  # half a turn: R + U = 2 a a^T
    column = R[:, i : i + 1] + pairs.column([one if j == i else zero for j in range(3)])
    return pairs.unit(column) * pairs.number(2)


def residuals_of_turn(pairs: Pairs, loop: Loop, into: Pair, R_s: Pair, R_e: Pair, sines: Sequence[Pair]) -> list[Pair]:
    """The reported angular residuals of a loop joint, (1, 1) each, with 2 sin(t/2) instead of sin(t).

    Parameters
    ----------
    into : Pair
        Rotation matrix from the start face to the axes of the conditions, (3, 3).
    R_s, R_e : Pair
        Rotation matrices from the faces to a common frame, (3, 3).
    sines : sequence of Pair
        The conditions, sums of c . d, (1, 1) each.
    """
    if loop.closure.angular == 3:
        turn = into @ twice_half_sine(pairs, R_s.mT @ R_e)
        return [turn[i : i + 1] for i in range(3)]
    if loop.closure.angular < 2:
        return list(sines)
    a = pairs.unit(pairs.vector(loop.axes[0]))
    double = R_s @ a + R_e @ a  # the length of this sum is 2 cos(t/2)
    square = pairs.dot(double, double)
    if not square.value > HALF_TURN:
        return [pairs.constant([[2]]), *(pairs.constant([[0]]) for _ in sines[1:])]
    return [x * (pairs.number(2) / pairs.call("sqrt", square)) for x in sines]


def joint_terms(body: Body, pairs: Pairs, q: Pair, u: Pair) -> JointTerms:
    """The joint's own kinematics at q (c, 1) and u (f, 1), from its chain of motions; see `JointTerms`.

    An elementary motion rotates by R, with the angular velocity omega in components after it, and translates by d. A preceding
    motion with the twist (w, v) has the twist (R^T w, R^T (v + w x d)) at the origin after it, whose derivative at constant w, v
    is

        (-omega x R^T w,  -omega x R^T (v + w x d) + R^T (w x ddot))
    """
    U, zero = pairs.eye(3), pairs.zeros(3, 1)
    none, eye = pairs.zeros(3, 3), np.eye(u.value.shape[0], dtype=int)
    axes = [pairs.unit(pairs.vector(axis)) for axis in body.joint.axes]
    R, d = U, zero
    P = P_end = pairs.zeros(6, len(eye))
    Pdot_u = pairs.zeros(6, 1)
    moving = False
    for m in body.joint.kind.motion:
        turned, way, place = U, zero, slice(0)
        match m:
            case Turn(axis, i):
                turned, place = axis_rotation(pairs, axes[axis], q[i, 0]), slice(i, i + 1)
                own = pairs.block([[axes[axis]], [zero]])
            case Slide(axis, i, factor):
                along = axes[axis] if factor is None else axes[axis] * pairs.expression(body.joint.factors[factor])
                way, place = along * q[i, 0], slice(i, i + 1)
                own = pairs.block([[zero], [along]])
            case Ball(i, j):
                turned, place = quaternion_rotation(pairs, q[i : i + 4]), slice(j, j + 3)
                own = pairs.constant(np.eye(6, 3, dtype=int))
            case Displacement(i, j):  # the first motion; its velocities are in child components
                d, P_end = q[i : i + 3], pairs.constant(np.eye(6, 3, -3, dtype=int) @ eye[j : j + 3])
                continue
        V_own = own @ u[place]
        if moving:
            back = turned.mT
            shift = pairs.block([[back, none], [-(back @ pairs.skew(way)), back]])
            V = shift @ P @ u
            omega, rate = pairs.skew(V_own[:3]), V_own[3:]
            added = [[-(omega @ V[:3])], [-(omega @ V[3:]) + pairs.skew(V[:3]) @ rate]]
            P, Pdot_u = shift @ P, shift @ Pdot_u + pairs.block(added)
        P = P + own @ pairs.constant(eye[place])
        R, d, moving = R @ turned, d + R @ way, True
    return JointTerms(R, d, P + P_end, Pdot_u)
