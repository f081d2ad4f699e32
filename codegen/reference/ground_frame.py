"""Bodies and freedoms in the ground frame: the kinematics of the dense method.

Rotations are composed from the root, and every body has its explicit geometric Jacobian. Each freedom i is an axis that
moves with some body:

======== =========================================================================================================
w_i      angular velocity per unit speed, (3,)
l_i      velocity per unit speed of the point o_i, (3,)
o_i      a point, m, about which w_i turns
======== =========================================================================================================

A point x beyond joint i has the partial velocity l_i + w_i x (x - o_i). Points and axes are rows here, (n, 3): one row a
freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.expressions import Expression
from ..model.model import Model, Vector
from .arithmetic import Array
from .engine import State
from .pairs import Pair, Pairs


@dataclass(slots=True)
class Frame:
    """A body in the ground frame.

    Attributes
    ----------
    R : Pair
        Body components into ground components, (3, 3).
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
    """All freedoms: axes w and l, points o, and their rates in time, (nu, 3) each."""

    w: Pair
    l: Pair
    o: Pair
    w_rate: Pair
    l_rate: Pair
    o_rate: Pair

    def partial_velocities(self, index: Array, x: Pair) -> Pair:
        """Partial velocities of the point x (1, 3) for the freedoms in index, (len(index), 3)."""
        return self.l[index] + cross(self.w[index], x - self.o[index])

    def partial_velocity_rates(self, index: Array, x: Pair, xdot: Pair) -> Pair:
        """Their derivatives in time for a point that moves with xdot (1, 3), (len(index), 3)."""
        return (
            self.l_rate[index]
            + cross(self.w_rate[index], x - self.o[index])
            + cross(self.w[index], xdot - self.o_rate[index])
        )


def motion(model: Model, state: State) -> tuple[list[Frame], Freedoms]:
    """Frames of all bodies, the ground's last (index -1), and the axes of all freedoms."""
    pairs = state.pairs
    zero, U = pairs.constant(np.zeros((1, 3), int)), pairs.constant(np.eye(3, dtype=int))
    frames = [Frame(U, zero, zero, zero, [])] * (len(model.bodies) + 1)
    rows: list[list[Pair]] = [[] for _ in range(model.nu)]
    for k in model.outward:
        joint, (q_rows, u_rows) = model.bodies[k].joint, model.coordinate_slices[k]
        q, u = state.q[q_rows], state.u[u_rows]
        parent = frames[model.bodies[k].parent]
        speeds = list(range(u_rows.start, u_rows.stop))

        # The joint frame is fixed in the parent; its origin moves with it.
        arm = pairs.vector(joint.at).mT @ parent.R.mT
        A = parent.R @ placement(pairs, joint.rotation)  # joint frame components into ground components
        o, v = parent.o + arm, parent.v + cross(parent.omega, arm)
        axes = [pairs.unit(pairs.vector(axis)).mT for axis in joint.axes]

        # R, o and the freedoms' axes. `w` and `l` with the angular velocity of the body each is fixed in.
        R, w, l, omega, carriers = A, [], [], parent.omega, []
        if joint.type == "revolute":
            R = A @ turn(pairs, joint.axes[0], q[0, 0])
            w, l = [axes[0] @ A.mT], [zero]
            omega = parent.omega + w[0] * u[0, 0]
            carriers = [parent.omega]
        elif joint.type == "prismatic":
            w, l = [zero], [axes[0] @ A.mT]
            o = o + l[0] * q[0, 0]
            v = v + cross(parent.omega, l[0] * q[0, 0]) + l[0] * u[0, 0]
            carriers = [parent.omega]
        elif joint.type == "universal":
            middle = A @ turn(pairs, joint.axes[0], q[0, 0])
            R = middle @ turn(pairs, joint.axes[1], q[1, 0])
            w, l = [axes[0] @ A.mT, axes[1] @ R.mT], [zero, zero]
            omega = parent.omega + w[0] * u[0, 0] + w[1] * u[1, 0]
            carriers = [parent.omega, omega]
        elif joint.type in ("spherical", "free"):
            n = q.value.shape[0]
            R = A @ rotation_of(pairs, [q[i, 0] for i in range(n - 4, n)])
            columns = [R[:, i : i + 1].mT for i in range(3)]
            w, l = list(columns), [zero] * 3
            omega = parent.omega + u[:3].mT @ R.mT
            if joint.type == "free":
                w, l = [*w, zero, zero, zero], [*l, *columns]
                displacement = q[:3].mT @ A.mT
                o = o + displacement
                v = v + cross(parent.omega, displacement) + u[3:].mT @ R.mT
            carriers = [omega] * len(w)
        elif joint.type != "fixed":
            raise ValueError(
                f"body {model.bodies[k].name}: joint type {joint.type!r} is not known to the reference engines"
            )
        for i, w_i, l_i, carrier in zip(speeds, w, l, carriers, strict=True):
            rows[i] = [w_i, l_i, o, cross(carrier, w_i), cross(carrier, l_i), v]
        frames[k] = Frame(R, o, v, omega, [*parent.freedoms, *speeds])
    if not rows:
        return frames, Freedoms(*(pairs.constant(np.zeros((0, 3), int)) for _ in range(6)))
    return frames, Freedoms(*(pairs.block([[row[i]] for row in rows]) for i in range(6)))


def placement(pairs: Pairs, rotation: Sequence[tuple[Vector, Expression]]) -> Pair:
    """Components in a frame placed in a body, by rotations about the moving axes, into body components, (3, 3)."""
    A = pairs.constant(np.eye(3, dtype=int))
    for axis, angle in rotation:
        A = A @ turn(pairs, axis, pairs.expression(angle))
    return A


def turn(pairs: Pairs, axis: Vector, angle: Pair) -> Pair:
    """Rotation about an axis, by the quaternion of the half angle, (3, 3)."""
    a, half = pairs.unit(pairs.vector(axis)), angle * (pairs.number(1) / pairs.number(2))
    sine = pairs.call("sin", half)
    return rotation_of(pairs, [pairs.call("cos", half), *(a[i, 0] * sine for i in range(3))])


def cross(a: Pair, b: Pair) -> Pair:
    """The cross product of rows, (n, 3); one of the two may be a single row."""
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
    """The matrix of x -> e x e^-1, column by column, (3, 3); any length of e."""
    one, zero = pairs.number(1), pairs.number(0)
    squared = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]
    inverse = [e[0] / squared, -e[1] / squared, -e[2] / squared, -e[3] / squared]
    columns = []
    for i in range(3):
        unit = [zero, *(one if j == i else zero for j in range(3))]
        columns.append(quaternion_product(quaternion_product(e, unit), inverse)[1:])
    return pairs.matrix([[columns[j][i] for j in range(3)] for i in range(3)])
