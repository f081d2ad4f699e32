"""The dense method of Eqs. 4 to 9: form M, K and the constraint Jacobian, differentiate them, solve. O(n^3) on purpose.

The formulation is independent of the recursive engine, so that an error in one shows in a comparison. Everything is in the ground
frame, with an explicit geometric Jacobian for every body (Kane's partial velocities, see `ground_frame`). Loops are conditions
between two faces, differentiated by hand (see `conditions`). With the sums over all bodies,

    M = sum  m J_v^T J_v + J_w^T I J_w                                                         (Eq. 4)
    K = tau + sum  J_v^T m (g - dJ_v/dt u) - J_w^T (I dJ_w/dt u + omega x I omega)             (Eq. 4)

    [ M      Phi_q^T ] [ udot   ]   [  K  ]                                                    (Eq. 4)
    [ Phi_q  0       ] [ lambda ] = [ -B  ]                                                    (Eq. 5, twice in time)

    [ M      Phi_q^T ] [ dudot   ]   [ dK - dM udot - dPhi_q^T lambda ]                        (Eq. 6)
    [ Phi_q  0       ] [ dlambda ] = [ -dB - dPhi_q udot              ]                        (Eq. 7, twice in time)

Eqs. 8 and 9 solve the last system for dlambda first. Here both unknowns are solved for at once, so M may be singular
(massless bodies moved by a loop). Eq. 6 is printed with M_,p in front of dudot; it must be M. M, K, Phi_q and the
quantities that they consist of are pairs, so dM and the other derivatives come directly, one full matrix per direction.

Redundant conditions. The partition gives the dependent speeds and their loops. For each ear (of the ear decomposition
of the loop graph), the engine uses the combinations of conditions that its dependent speeds can satisfy at the state,
and holds these combinations fixed in derivatives (docs, 4.7). The other conditions must follow from these combinations,
except conditions that the partition has dropped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..model.model import GROUND, Body
from ..model.motions import Ball, Displacement, Slide, Turn
from .arguments import ALONG, State
from .arithmetic import Array, LeftInverse, SingularMatrixError
from .conditions import Conditions, conditions
from .engine import Engine
from .ground_frame import Frame, Freedoms, attitudes, cross, motion, quaternion_product
from .outputs import Moving
from .pairs import Pair, Pairs

LEFT_OVER = 1e-6
"""A condition is independent if it differs from every combination of the other conditions by more than this fraction of the
largest entry."""


class DenseEngine(Engine):
    """Reference engine with the dense method, for any model. `Engine` documents its methods.

    From the partition it uses the dependent speeds of each loop, the dropped conditions, and the characteristic lengths.
    """

    def _accelerations(self, state: State) -> Pair:
        return self._constrained(state)[0]

    def _constrained(self, state: State, subset: bool = False) -> tuple[Pair, Pair]:
        """udot, (nu, 1), and the multipliers of all conditions, (m, 1): Eqs. 4 to 9.

        With `subset`, only a subset of the conditions has multipliers, as many as there are dependent speeds.
        """
        pairs, nu = state.pairs, self.model.nu
        M, K = self._mass_matrix(state), self._right_side(state)
        held = pairs.constant(np.eye(nu, dtype=int)[self.held])
        given = self._prescribed_accelerations(pairs)
        if not self.model.loops:
            return self._accelerated(M, K, held, given)[:nu], pairs.zeros(0, 1)
        known = self._conditions(state)
        J = self.arithmetic.held(known.jacobian.value)
        C = self.arithmetic.eye(len(J))[self._subset(J)] if subset else self._combinations(J)
        # combinations of the conditions with orthonormal rows: the system is then as well conditioned as M
        inverse = LeftInverse(self.arithmetic, (C @ J).T)
        W = pairs.constant(inverse(inverse.Q).T @ C)
        Phi_q, B = W @ known.jacobian, W @ known.remainder
        x = self._accelerated(M, K, pairs.block([[Phi_q], [held]]), pairs.block([[-B], [given]]))
        return x[:nu], W.mT @ x[nu : nu + len(C)]

    def _accelerated(self, M: Pair, K: Pair, rows: Pair, given: Pair) -> Pair:
        """udot and the multipliers of conditions ``rows udot = given``: conditions of loops, and of prescribed motion
        (Eq. 5)."""
        n = len(rows.value)
        if not n:
            return self._solve(M, K)
        pairs = Pairs(self.arithmetic, len(M.tangent), {})
        A = pairs.block([[M, rows.mT], [rows, pairs.zeros(n, n)]])
        return self._solve(A, pairs.block([[K], [given]]))

    def _solve_mass(self, state: State, b: Pair) -> Pair:
        free = self.free_u
        part = self._solve(self._mass_matrix(state)[np.ix_(free, free)], b[free])
        whole = state.pairs.zeros(self.model.nu, 1)
        whole[free] = part
        return whole

    def _solve(self, A: Pair, B: Pair) -> Pair:
        """X = A^-1 B, (n, m), and dX = A^-1 (dB - dA X); A is square."""
        X = self.arithmetic.solve(A.value, B.value)
        right = B.tangent - A.tangent @ X
        k, n, m = right.shape
        columns = right.transpose(1, 0, 2).reshape(n, k * m)
        return Pair(X, self.arithmetic.solve(A.value, columns).reshape(n, k, m).transpose(1, 0, 2))

    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        return self._mass_matrix(state) @ udot - self._right_side(state)

    # --- loops ----------------------------------------------------------------------------------------------------

    def reactions(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the moment and force that each loop joint exerts on its ``to`` body, (nloops, 6).

        The moment about the origin of the face (N m), then the force (N), along the ground's axes. The opposite acts on the
        ``from`` body. Where conditions are redundant, the solution minimises the sum of squares of moments and of forces
        times the characteristic length.
        """
        return self._reactions(self._state(q, u, p, inputs, t)).value

    def reaction_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the values of `reactions` and their total derivatives along seeds, (k, nloops, 6)."""
        result = self._reactions(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds)))
        return result.value, result.tangent

    def joint_reactions(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the moment and force that the joint of each body exerts on it, (nbodies, 6).

        The moment about the body's origin (N m), then the force (N), along the ground's axes. They follow from the motion
        of all outboard bodies and the other forces on these bodies.
        """
        return self._joint_reactions(self._state(q, u, p, inputs, t)).value

    def joint_reaction_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the values of `joint_reactions` and their total derivatives along seeds, (k, nbodies, 6)."""
        result = self._joint_reactions(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds)))
        return result.value, result.tangent

    def _joint_reactions(self, state: State) -> Pair:
        """The equations of Newton and Euler for everything that a joint carries, first about the ground's origin, then
        about the body's."""
        pairs, udot, g = state.pairs, self._accelerations(state), self._gravity(state.pairs)
        frames, freedoms = state_motion = self._motion(state)
        needed: list[tuple[Pair, Pair]] = []
        for body, frame in zip(self.model.bodies, frames, strict=False):
            index = np.array(frame.freedoms, dtype=int)
            m, I, x, xdot = self._mass(body, frame, pairs)
            a = udot[index].mT @ freedoms.partial_velocities(index, x)
            a = a + state.u[index].mT @ freedoms.partial_velocity_rates(index, x, xdot)
            alpha = udot[index].mT @ freedoms.w[index] + state.u[index].mT @ freedoms.w_rate[index]
            force = (a - g) * m
            needed.append((alpha @ I + cross(frame.omega, frame.omega @ I) + cross(x, force), force))

        def act(body: int, at: Pair, moment: Pair | None, force: Pair | None) -> None:
            if body == GROUND:
                return
            n, f = needed[body]
            if force is not None:
                n, f = n - cross(at, force), f - force
            needed[body] = (n if moment is None else n - moment, f)

        for point, end, wrench in self._wrenches(pairs, state_motion):
            torque, push = (None if v is None else v.mT for v in (wrench.torque, wrench.force))
            act(point.body, end.x.mT, torque, push)
        on_ends = self._reactions(state, given=False)
        for i, loop in enumerate(self.model.loops):
            if not loop.is_coupling:  # forces of couplings act in joints, not between faces
                at = self._point(state_motion, loop.end.body, pairs.vector(loop.end.at))[0].mT
                moment, force = on_ends[i : i + 1, :3], on_ends[i : i + 1, 3:]
                act(loop.end.body, at, moment, force)
                act(loop.start.body, at, -moment, -force)
        for i in reversed(self.model.outward):
            (n, f), parent = needed[i], self.model.bodies[i].parent
            if parent != GROUND:
                needed[parent] = needed[parent][0] + n, needed[parent][1] + f
        origins = [frame.o for frame in frames]
        return pairs.block([[n - cross(o, f), f] for o, (n, f) in zip(origins, needed, strict=False)])

    def _reactions(self, state: State, given: bool = True) -> Pair:
        """Wrenches on the bodies that the file calls ``to``; if not `given`, on those of `Loop.end`, which are others
        in turned loops."""
        pairs = state.pairs
        if not self.model.loops:
            return pairs.zeros(0, 6)
        known, (_, multipliers) = self._conditions(state), self._constrained(state, subset=True)
        multipliers = self._shared(known.jacobian, multipliers)
        # Phi_q^T lambda is on the left side of Eq. 4, hence the minus sign
        acting = [multipliers[rows].mT @ known.wrenches[rows] for rows in self.closure_slices]
        return pairs.block([[w if given and x.turned else -w] for w, x in zip(acting, self.model.loops, strict=True)])

    def _shared(self, jacobian: Pair, multipliers: Pair) -> Pair:
        """Multipliers of least norm, (m, 1), equivalent to the multipliers of a subset; zero for dropped conditions."""
        rows = self._subset(jacobian.value)
        dependent = jacobian[:, self.dependent]
        W = self._solve(dependent[rows].mT, dependent.mT).mT  # every condition as a combination of the subset
        dropped = np.setdiff1d(np.arange(len(jacobian.value)), self.kept)
        W[dropped] = Pair(0 * W.value[dropped], 0 * W.tangent[:, dropped])
        return W @ self._solve(W.mT @ W, multipliers[rows])

    def _conditions(self, state: State) -> Conditions:
        frames, freedoms = self._motion(state)
        loops, defaults = self.model.loops, self.model.defaults
        return conditions(
            state.pairs, loops, self.lengths, frames, freedoms, state.q, state.u, self.model.coordinate_slices, defaults
        )

    def _closure(self, state: State) -> tuple[Pair, Pair]:
        known = self._conditions(state)
        return known.position, known.jacobian @ state.u

    def _displacements(self, state: State) -> Array:
        """Eq. 7 for the dependent displacements. The derivative of the position includes p and the independent
        displacements."""
        known = self._conditions(state)
        C = self._combinations(known.jacobian.value)
        E = C @ known.jacobian.value[:, self.dependent]
        result = self.arithmetic.zeros(state.pairs.k, self.model.nu, 1)
        for moved, opened in zip(
            result, known.constraint.tangent, strict=True
        ):  # one direction at a time, so that the numbers do not depend on the other directions
            moved[self.dependent] = self.arithmetic.solve(E, -(C @ opened))
        return result

    def _closed_speeds(self, state: State) -> Pair:
        """Speeds for which Phi_q u = 0, the first time derivative of Eq. 5."""
        jacobian = self._conditions(state).jacobian
        combined = state.pairs.constant(self._combinations(jacobian.value)) @ jacobian
        return self._solve(combined[:, self.dependent], -(combined @ state.u))

    def _combinations(self, jacobian: Array) -> Array:
        """Ear by ear, orthonormal combinations of conditions that the dependent speeds can satisfy, (r, m).

        Raises
        ------
        SingularMatrixError
            If the conditions do not determine the dependent speeds, or if they cannot all be satisfied by these speeds.
        """
        jacobian = self.arithmetic.held(jacobian)
        self._check_rank(jacobian)
        place = {int(s): i for i, s in enumerate(self.dependent)}
        kept = {int(i) for i in self.kept}
        found = self.arithmetic.zeros(len(place), len(jacobian))
        for ear in self.partition.ears:
            slices = [self.closure_slices[k] for k in ear.loops]
            rows = [i for x in slices for i in range(x.start, x.stop) if i in kept]
            if ear.dependent:
                columns = [jacobian[rows, s] for s in ear.dependent]
                Q = LeftInverse(self.arithmetic, np.stack(columns, axis=1)).Q
                for j, s in enumerate(ear.dependent):
                    found[place[s], rows] = Q[:, j]
        return found

    def _subset(self, jacobian: Array) -> Array:
        """Indices of independent conditions; their number equals that of the dependent speeds."""
        rows, _ = self.arithmetic.independent_rows(jacobian[np.ix_(self.kept, self.dependent)])
        return self.kept[rows]

    def _check_rank(self, jacobian: Array) -> None:
        dependent = jacobian[np.ix_(self.kept, self.dependent)]
        names = [self.model.speed_names[i] for i in self.dependent]
        rows, rank = self.arithmetic.independent_rows(dependent)
        if rank < len(names):
            raise SingularMatrixError(
                f"loops {', '.join(x.name for x in self.model.loops)}: the closure does not determine the speeds"
                f" {', '.join(names)} at this state: rank {rank} of {len(names)}"
            )
        combinations = self.arithmetic.solve(dependent[rows].T, dependent.T).T
        left = np.abs(jacobian[self.kept] - combinations @ jacobian[self.kept[rows]]).max(axis=1)
        worst = int(np.argmax(left))
        if left[worst] > self.arithmetic.number(LEFT_OVER) * np.abs(jacobian).max():
            raise SingularMatrixError(
                f"condition {self.model.closure_names[self.kept[worst]]} does not follow from the others: {len(names)}"
                f" dependent speeds ({', '.join(names)}) are too few here"
            )

    # --- M, K and energies ----------------------------------------------------------------------------------------

    def _mass_matrix(self, state: State) -> Pair:
        """The mass matrix M of Eq. 4, (nu, nu)."""
        pairs, nu = state.pairs, self.model.nu
        frames, freedoms = self._motion(state)
        M = pairs.zeros(nu, nu)
        for body, frame in zip(self.model.bodies, frames, strict=False):
            index = np.array(frame.freedoms, dtype=int)
            m, I, x, _ = self._mass(body, frame, pairs)
            J_w, J_v = freedoms.w[index], freedoms.partial_velocities(index, x)
            part = (J_v @ J_v.mT) * m + J_w @ I @ J_w.mT
            M.value[np.ix_(index, index)] += part.value
            M.tangent[:, index[:, None], index] += part.tangent
        return M + pairs.diagonal(self._armature(pairs))

    def _right_side(self, state: State) -> Pair:
        """The right side K of Eq. 4, (nu, 1)."""
        pairs = state.pairs
        frames, freedoms = self._motion(state)
        K = pairs.zeros(self.model.nu, 1)
        g = self._gravity(pairs)
        for body, frame in zip(self.model.bodies, frames, strict=False):
            index = np.array(frame.freedoms, dtype=int)
            m, I, x, xdot = self._mass(body, frame, pairs)
            J_w, J_v = freedoms.w[index], freedoms.partial_velocities(index, x)
            u = state.u[index]
            dJ_w = freedoms.w_rate[index]
            dJ_v = freedoms.partial_velocity_rates(index, x, xdot)
            force = (g - u.mT @ dJ_v) * m
            moment = -(u.mT @ dJ_w @ I) - cross(frame.omega, frame.omega @ I)
            part = J_v @ force.mT + J_w @ moment.mT
            K.value[index] += part.value
            K.tangent[:, index] += part.tangent
        for point, end, wrench in self._wrenches(pairs, (frames, freedoms)):
            index = np.array(frames[point.body].freedoms, dtype=int)
            for load, J in (
                (wrench.force, freedoms.partial_velocities(index, end.x.mT)), (wrench.torque, freedoms.w[index]),
            ):  # fmt: skip
                if load is not None:
                    part = J @ load
                    K.value[index] += part.value
                    K.tangent[:, index] += part.tangent
        return K + self._forces_on_speeds(pairs)

    def _energies(self, state: State, motion: tuple[list[Frame], Freedoms]) -> tuple[Pair, Pair]:
        pairs, g = state.pairs, self._gravity(state.pairs)
        kinetic = (state.u.mT @ self._mass_matrix(state) @ state.u) * (pairs.number(1) / pairs.number(2))
        potential = pairs.constant([[0]])
        for body, frame in zip(self.model.bodies, motion[0], strict=False):
            m, _, x, _ = self._mass(body, frame, pairs)
            potential = potential - (g @ x.mT) * m
        return kinetic, potential + pairs.matrix([[self._potential(pairs, motion)]])

    def _point(self, motion: tuple[list[Frame], Freedoms], body: int, at: Pair) -> tuple[Pair, Pair]:
        x, v = motion[0][body].point(at)
        return x.mT, v.mT

    def _attitude(self, motion: tuple[list[Frame], Freedoms], body: int) -> tuple[Pair, Pair]:
        frame = motion[0][body]
        return frame.R, frame.omega.mT

    def _accelerating(
        self, state: State, motion: tuple[list[Frame], Freedoms], udot: Pair
    ) -> Callable[[int, Pair], Pair]:
        """``J udot + dJ/dt u``, with J the partial velocities of the point."""
        frames, freedoms = motion

        def acceleration(body: int, at: Pair) -> Pair:
            x, v = frames[body].point(at)
            index = np.array(frames[body].freedoms, dtype=int)
            J, J_rate = freedoms.partial_velocities(index, x), freedoms.partial_velocity_rates(index, x, v)
            return (udot[index].mT @ J + state.u[index].mT @ J_rate).mT

        return acceleration

    def _moving(self, state: State, motion: tuple[list[Frame], Freedoms]) -> list[Moving]:
        found = []
        for body, frame in zip(self.model.bodies, motion[0], strict=False):
            m, I, x, xdot = self._mass(body, frame, state.pairs)
            found.append(Moving(m, x.mT, xdot.mT, I @ frame.omega.mT))
        return found

    def _coordinate_rates(self, state: State) -> Pair:
        """The time derivatives qdot, (nq, 1); for quaternions, edot = e (0, omega)/2."""
        pairs, rates = state.pairs, state.pairs.zeros(self.model.nq, 1)
        half, U = pairs.number(1) / pairs.number(2), pairs.eye(3)
        for body, (q_rows, u_rows) in zip(self.model.bodies, self.model.coordinate_slices, strict=True):
            q, u = state.q[q_rows], state.u[u_rows]
            for m in body.joint.kind.motion:
                match m:
                    case Turn(_, i) | Slide(_, i):
                        part = u[i : i + 1]
                    case Ball(i, j):
                        omega = [pairs.number(0), *(u[j + n, 0] for n in range(3))]
                        part = pairs.column(quaternion_product([q[i + n, 0] for n in range(4)], omega)) * half
                    case Displacement(i, j):
                        part = attitudes(pairs, body.joint, q, U)[-1] @ u[j : j + 3]
                rates[q_rows.start + i : q_rows.start + i + len(part.value)] = part
        return rates

    def _motion(self, state: State) -> tuple[list[Frame], Freedoms]:
        return motion(self.model, state)

    def _gravity(self, pairs: Pairs) -> Pair:
        return pairs.vector(self.model.gravity).mT if self.model.gravity else pairs.zeros(1, 3)

    def _mass(self, body: Body, frame: Frame, pairs: Pairs) -> tuple[Pair, Pair, Pair, Pair]:
        """Mass, inertia about the mass centre (3, 3), and the mass centre's position and velocity (1, 3); ground frame."""
        xx, yy, zz, xy, xz, yz = (pairs.expression(e) for e in body.inertia)
        I = frame.R @ pairs.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ frame.R.mT
        arm = pairs.vector(body.com).mT @ frame.R.mT
        return pairs.expression(body.mass), I, frame.o + arm, frame.v + cross(frame.omega, arm)
