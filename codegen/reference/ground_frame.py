"""Bodies and degrees of freedom in the ground frame: the kinematics of the dense method.

Rotations are composed from the root, and every body has its explicit geometric Jacobian. Each degree of freedom i is an axis that
moves with some body:

======== =========================================================================================================
w_i      angular velocity per unit speed, (3,)
l_i      velocity per unit speed of the point o_i, (3,)
o_i      a point, m, about which w_i turns
======== =========================================================================================================

A point x outboard of joint i has the partial velocity l_i + w_i x (x - o_i). Points and axes are rows, (n, 3): one row per degree
of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.expressions import Expression
from ..model.model import Joint, Model, Vector
from ..model.motions import Ball, Displacement, Slide, Turn
from ..model.quarter_turns import quarter_turns
from .arguments import State
from .arithmetic import Array
from .pairs import Pair, Pairs


@dataclass(slots=True)
class Frame:
    """The frame of a body, with its motion relative to the ground.

    Attributes
    ----------
    R : Pair
        Rotation matrix from body to ground components, (3, 3).
    o, v : Pair
        Position and velocity of the body's origin, (1, 3).
    omega : Pair
        Angular velocity, (1, 3).
    freedoms : list of int
        Indices of the speeds that move the body.
    """

    R: Pair
    o: Pair
    v: Pair
    omega: Pair
    freedoms: list[int]

    def point(self, at: Pair) -> tuple[Pair, Pair]:
        """Position and velocity, (1, 3) each, of a point ``at`` (3, 1) in body axes."""
        arm = at.mT @ self.R.mT
        return self.o + arm, self.v + cross(self.omega, arm)


@dataclass(slots=True)
class Freedoms:
    """All degrees of freedom: axes w and l, points o, and their time derivatives, (nu, 3) each."""

    w: Pair
    l: Pair
    o: Pair
    w_rate: Pair
    l_rate: Pair
    o_rate: Pair

    def partial_velocities(self, index: Array, x: Pair) -> Pair:
        """Partial velocities of the point x (1, 3) for the degrees of freedom in index, (len(index), 3)."""
        return self.l[index] + cross(self.w[index], x - self.o[index])

    def partial_velocity_rates(self, index: Array, x: Pair, xdot: Pair) -> Pair:
        """Time derivatives of the partial velocities of a point that moves with xdot (1, 3), (len(index), 3)."""
        return (
            self.l_rate[index]
            + cross(self.w_rate[index], x - self.o[index])
            + cross(self.w[index], xdot - self.o_rate[index])
        )


def motion(model: Model, state: State) -> tuple[list[Frame], Freedoms]:
    """Frames of all bodies, the ground's last (index -1), and the axes of all degrees of freedom."""
    pairs = state.pairs
    zero, U = pairs.zeros(1, 3), pairs.eye(3)
    frames = [Frame(U, zero, zero, zero, [])] * (len(model.bodies) + 1)
    rows: list[list[Pair]] = [[] for _ in range(model.nu)]
    for k in model.outward:
        joint, (q_rows, u_rows) = model.bodies[k].joint, model.coordinate_slices[k]
        q, u = state.q[q_rows], state.u[u_rows]
        parent = frames[model.bodies[k].parent]
        speeds = list(range(u_rows.start, u_rows.stop))

        # The joint frame is fixed in the parent; its origin moves with it.
        arm = pairs.vector(joint.at).mT @ parent.R.mT
        A = parent.R @ placement(pairs, joint.rotation)  # from joint frame components to ground components
        o, v = parent.o + arm, parent.v + cross(parent.omega, arm)
        body_axes = [pairs.unit(pairs.vector(axis)).mT for axis in joint.axes]

        Rs = attitudes(pairs, joint, q, A)
        R = Rs[-1]

        # o and the axes, each with the angular velocity of the frame in which it is fixed
        w, l, w_rate, l_rate, points = ([zero] * len(speeds) for _ in range(5))
        point_rates = [zero] * len(speeds)
        omega = parent.omega
        for m, before, behind in zip(joint.kind.motion, Rs, Rs[1:], strict=False):
            match m:
                case Turn(axis, i):
                    w[i] = body_axes[axis] @ before.mT
                    w_rate[i], points[i], point_rates[i] = cross(omega, w[i]), o, v
                    omega = omega + w[i] * u[i, 0]
                case Slide(axis, i, factor):
                    l[i] = body_axes[axis] @ before.mT
                    if factor is not None:
                        l[i] = l[i] * pairs.expression(joint.factors[factor])
                    l_rate[i] = cross(omega, l[i])
                    o = o + l[i] * q[i, 0]
                    v = v + cross(omega, l[i] * q[i, 0]) + l[i] * u[i, 0]
                case Ball(_, i):
                    omega = omega + u[i : i + 3].mT @ behind.mT
                    for n in range(3):
                        w[i + n] = behind[:, n : n + 1].mT
                        w_rate[i + n], points[i + n], point_rates[i + n] = cross(omega, w[i + n]), o, v
                case Displacement(i, j):
                    way = q[i : i + 3].mT @ before.mT
                    o = o + way
                    v = v + cross(omega, way) + u[j : j + 3].mT @ R.mT
                    l[j : j + 3] = [R[:, n : n + 1].mT for n in range(3)]
        for m in joint.kind.motion:
            if isinstance(m, Displacement):  # the displacement is along axes of the body
                l_rate[m.speed : m.speed + 3] = [cross(omega, l[m.speed + n]) for n in range(3)]
        for i, *row in zip(speeds, w, l, points, w_rate, l_rate, point_rates, strict=True):
            rows[i] = row
        frames[k] = Frame(R, o, v, omega, [*parent.freedoms, *speeds])
    if not rows:
        return frames, Freedoms(*(pairs.zeros(0, 3) for _ in range(6)))
    return frames, Freedoms(*(pairs.block([[row[i]] for row in rows]) for i in range(6)))


def attitudes(pairs: Pairs, joint: Joint, q: Pair, A: Pair) -> list[Pair]:
    """A (3, 3) times the rotations of a joint's first n motions, for n = 0, 1, ...; the last matrix maps child components."""
    Rs = [A]
    for m in joint.kind.motion:
        match m:
            case Turn(axis, i):
                Rs.append(Rs[-1] @ turn(pairs, joint.axes[axis], q[i, 0]))
            case Ball(i, _):
                Rs.append(Rs[-1] @ rotation_of(pairs, [q[i + n, 0] for n in range(4)]))
            case _:
                Rs.append(Rs[-1])
    return Rs


def placement(pairs: Pairs, rotation: Sequence[tuple[Vector, Expression]]) -> Pair:
    """Rotation matrix from a frame placed in a body to the body, by rotations about the moving axes, (3, 3)."""
    A = pairs.eye(3)
    for axis, angle in rotation:
        quarters = quarter_turns(angle)
        A = A @ (turn(pairs, axis, pairs.expression(angle)) if quarters is None else quarter(pairs, axis, quarters))
    return A


def turn(pairs: Pairs, axis: Vector, angle: Pair) -> Pair:
    """Rotation about an axis, by the quaternion of the half angle, (3, 3)."""
    a, half = pairs.unit(pairs.vector(axis)), angle * (pairs.number(1) / pairs.number(2))
    sine = pairs.call("sin", half)
    return rotation_of(pairs, [pairs.call("cos", half), *(a[i, 0] * sine for i in range(3))])


def quarter(pairs: Pairs, axis: Vector, count: int) -> Pair:
    """Rotation about an axis by quarter turns, (3, 3), with the quaternion (1, a), (0, a) or (1, -a)."""
    a = pairs.unit(pairs.vector(axis))
    w, along = ((1, 0), (1, 1), (0, 1), (1, -1))[count]
    return rotation_of(pairs, [pairs.number(w), *(a[i, 0] * pairs.number(along) for i in range(3))])


def cross(a: Pair, b: Pair) -> Pair:
    """The cross products of rows, (n, 3); one of the two may be a single row."""
    value = row_cross(a.value, b.value)
    return Pair(value, row_cross(a.tangent, b.value) + row_cross(a.value, b.tangent))


def row_cross(a: Array, b: Array) -> Array:
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.stack([x, y, z], axis=-1)


def quaternion_product(a: list[Pair], b: list[Pair]) -> list[Pair]:
    """Hamilton's product of two quaternions (w, x, y, z)."""
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def rotation_of(pairs: Pairs, e: list[Pair]) -> Pair:
    """The matrix of x -> e x e^-1, column by column, (3, 3), for e of any length."""
    squared = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]
    inverse = [e[0] / squared, -e[1] / squared, -e[2] / squared, -e[3] / squared]
    times_units = [-e[1], e[0], e[3], -e[2]], [-e[2], -e[3], e[0], e[1]], [-e[3], e[2], -e[1], e[0]]
    columns = [quaternion_product(e_times_unit, inverse)[1:] for e_times_unit in times_units]
    return pairs.matrix([[columns[j][i] for j in range(3)] for i in range(3)])
