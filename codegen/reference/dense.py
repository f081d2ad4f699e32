"""The dense method of Eqs. 4 to 9, for trees: form M and K, differentiate them, solve. O(n^3) and worse, on purpose.

A formulation of its own, so that an error in one engine does not hide in the other: everything is kept in the ground
frame, rotations are composed from the root, and every body has its explicit geometric Jacobian (Kane's partial
velocities of the mass centre). Each freedom i is an axis that moves with some body:

======== =========================================================================================================
w_i      angular velocity per unit speed, (3,)
l_i      velocity per unit speed of the point o_i, (3,)
o_i      a point, m, about which w_i turns
======== =========================================================================================================

A point x beyond joint i has the partial velocity l_i + w_i x (x - o_i). Then, with the sums over all bodies,

    M = sum  m J_v^T J_v + J_w^T I J_w                                                         (Eq. 4)
    K = tau + sum  J_v^T m (g - dJ_v/dt u) - J_w^T (I dJ_w/dt u + omega x I omega)             (Eq. 4)
    dudot = M^-1 (dK - dM udot)                                                                (Eq. 9)

Eq. 6 is printed with M_,p in front of dudot; it is M. M, K and all they are made of are formed as pairs, so dM and dK
are their direct derivatives, one full matrix per direction. Points and axes are rows here, (n, 3): one row a freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.model import Body, Vector
from .arithmetic import Array
from .engine import Engine, State
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


@dataclass(slots=True)
class Freedoms:
    """All freedoms: axes w and l, points o, and their rates in time, (nu, 3) each."""

    w: Pair
    l: Pair
    o: Pair
    w_rate: Pair
    l_rate: Pair
    o_rate: Pair


class DenseEngine(Engine):
    """The dense method for any tree. See `Engine` for the face."""

    def _accelerations(self, state: State) -> Pair:
        return self._solve(self._mass_matrix(state), self._right_side(state))

    def _solve_mass(self, state: State, b: Pair) -> Pair:
        return self._solve(self._mass_matrix(state), b)

    def _solve(self, M: Pair, K: Pair) -> Pair:
        """Eqs. 4 and 9: x = M^-1 K, dx = M^-1 (dK - dM x)."""
        x = self.arithmetic.solve(M.value, K.value)  # Eq. 4
        right = K.tangent - M.tangent @ x  # (k, nu, 1)
        dx = self.arithmetic.solve(M.value, right[..., 0].T)  # Eq. 9
        return Pair(x, dx.T[..., None])

    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        return self._mass_matrix(state) @ udot - self._right_side(state)

    def _mass_matrix(self, state: State) -> Pair:
        """M of Eq. 4, (nu, nu)."""
        pairs, nu = state.pairs, self.model.nu
        frames, freedoms = self._motion(state)
        M = pairs.constant(np.zeros((nu, nu), int))
        for body, frame in zip(self.model.bodies, frames, strict=False):
            index = np.array(frame.freedoms, dtype=int)
            m, I, x, _ = self._mass(body, frame, pairs)
            J_w, J_v = freedoms.w[index], self._partial_velocities(freedoms, index, x)
            part = (J_v @ J_v.mT) * m + J_w @ I @ J_w.mT
            M.value[np.ix_(index, index)] += part.value
            M.tangent[:, index[:, None], index] += part.tangent
        return M

    def _right_side(self, state: State) -> Pair:
        """K of Eq. 4, (nu, 1)."""
        pairs = state.pairs
        frames, freedoms = self._motion(state)
        K = pairs.constant(np.zeros((self.model.nu, 1), int))
        g = self._gravity(pairs)
        for body, frame in zip(self.model.bodies, frames, strict=False):
            index = np.array(frame.freedoms, dtype=int)
            m, I, x, xdot = self._mass(body, frame, pairs)
            J_w, J_v = freedoms.w[index], self._partial_velocities(freedoms, index, x)
            u = state.u[index]
            dJ_w = freedoms.w_rate[index]
            dJ_v = (
                freedoms.l_rate[index]
                + cross(freedoms.w_rate[index], x - freedoms.o[index])
                + cross(freedoms.w[index], xdot - freedoms.o_rate[index])
            )
            force = (g - u.mT @ dJ_v) * m
            moment = -(u.mT @ dJ_w @ I) - cross(frame.omega, frame.omega @ I)
            part = J_v @ force.mT + J_w @ moment.mT
            K.value[index] += part.value
            K.tangent[:, index] += part.tangent
        for joint_force in self.model.forces:
            rows = self.model.coordinate_slices[joint_force.body][1]
            tau = pairs.vector(joint_force.values)
            K.value[rows] += tau.value
            K.tangent[:, rows] += tau.tangent
        return K

    def _energies(self, state: State, motion: tuple[list[Frame], Freedoms]) -> tuple[Pair, Pair]:
        pairs, g = state.pairs, self._gravity(state.pairs)
        kinetic = (state.u.mT @ self._mass_matrix(state) @ state.u) * (pairs.number(1) / pairs.number(2))
        potential = pairs.constant([[0]])
        for body, frame in zip(self.model.bodies, motion[0], strict=False):
            m, _, x, _ = self._mass(body, frame, pairs)
            potential = potential - (g @ x.mT) * m
        return kinetic, potential

    def _point(self, motion: tuple[list[Frame], Freedoms], body: int, at: Pair) -> tuple[Pair, Pair]:
        frame = motion[0][body]
        arm = at.mT @ frame.R.mT
        return (frame.o + arm).mT, (frame.v + cross(frame.omega, arm)).mT

    def _coordinate_rates(self, state: State) -> Pair:
        """qdot, (nq, 1): quaternions by their own product, edot = e (0, omega)/2."""
        pairs, rates = state.pairs, []
        half = pairs.number(1) / pairs.number(2)
        for body, (q_rows, u_rows) in zip(self.model.bodies, self.model.coordinate_slices, strict=True):
            q, u = state.q[q_rows], state.u[u_rows]
            if body.joint.type in ("spherical", "free"):
                e = [q[i, 0] for i in range(q.value.shape[0] - 4, q.value.shape[0])]
                omega = [pairs.number(0), *(u[i, 0] for i in range(3))]
                if body.joint.type == "free":
                    rates.append(rotation_of(pairs, e) @ u[3:])
                rates.append(pairs.column(quaternion_product(e, omega)) * half)
            else:
                rates.append(u)
        return pairs.block([[x] for x in rates]) if rates else state.q

    # --- geometry in the ground frame -----------------------------------------------------------------------------

    def _motion(self, state: State) -> tuple[list[Frame], Freedoms]:
        """Frames of all bodies, the ground's last (index -1), and the axes of all freedoms."""
        model, pairs = self.model, state.pairs
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
            A = parent.R  # joint frame components into ground components
            for axis, angle in joint.rotation:
                A = A @ self._turn(pairs, axis, pairs.expression(angle))
            o, v = parent.o + arm, parent.v + cross(parent.omega, arm)
            axes = [pairs.unit(pairs.vector(axis)).mT for axis in joint.axes]

            # R, o and the freedoms' axes. `w` and `l` with the angular velocity of the body each is fixed in.
            R, w, l, omega, carriers = A, [], [], parent.omega, []
            if joint.type == "revolute":
                R = A @ self._turn(pairs, joint.axes[0], q[0, 0])
                w, l = [axes[0] @ A.mT], [zero]
                omega = parent.omega + w[0] * u[0, 0]
                carriers = [parent.omega]
            elif joint.type == "prismatic":
                w, l = [zero], [axes[0] @ A.mT]
                o = o + l[0] * q[0, 0]
                v = v + cross(parent.omega, l[0] * q[0, 0]) + l[0] * u[0, 0]
                carriers = [parent.omega]
            elif joint.type == "universal":
                middle = A @ self._turn(pairs, joint.axes[0], q[0, 0])
                R = middle @ self._turn(pairs, joint.axes[1], q[1, 0])
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

    def _turn(self, pairs: Pairs, axis: Vector, angle: Pair) -> Pair:
        """Rotation about an axis, by the quaternion of the half angle, (3, 3)."""
        a, half = pairs.unit(pairs.vector(axis)), angle * (pairs.number(1) / pairs.number(2))
        sine = pairs.call("sin", half)
        return rotation_of(pairs, [pairs.call("cos", half), *(a[i, 0] * sine for i in range(3))])

    def _gravity(self, pairs: Pairs) -> Pair:
        return pairs.vector(self.model.gravity).mT if self.model.gravity else pairs.constant(np.zeros((1, 3), int))

    def _mass(self, body: Body, frame: Frame, pairs: Pairs) -> tuple[Pair, Pair, Pair, Pair]:
        """Mass, inertia about the mass centre (3, 3), and the mass centre's position and velocity (1, 3); ground frame."""
        xx, yy, zz, xy, xz, yz = (pairs.expression(e) for e in body.inertia)
        I = frame.R @ pairs.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ frame.R.mT
        arm = pairs.vector(body.com).mT @ frame.R.mT
        return pairs.expression(body.mass), I, frame.o + arm, frame.v + cross(frame.omega, arm)

    @staticmethod
    def _partial_velocities(freedoms: Freedoms, index: Array, x: Pair) -> Pair:
        """Partial velocities of the point x (1, 3) for the freedoms in index, (len(index), 3)."""
        return freedoms.l[index] + cross(freedoms.w[index], x - freedoms.o[index])


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
