"""The generic recursive engine: Anderson and Hsu's algorithm on 6x6 matrices, equation by equation.

This engine generates no code and is not optimised. Every statement of the four sweeps has its equation number. Quantities are
pairs of a value and its total derivatives, d/dp_j of Eq. 10. Their product rule turns each equation into its derivative: Eqs. 26
to 28, 49 to 52 and 55. Tests compare the generated code with this engine, which shares nothing with `codegen.mechanics`.

This file has the sweeps of a tree. Closed loops are in other files: `ears` (groups of bodies whose motion is computed together),
`closure` (Eqs. 30 to 38: dependent speeds, and the completion of dependent seeds) and `embedding` (Eqs. 39 to 60 with loops).

The notation is that of `terms`.

Misprints of the paper, each corrected here where it occurs:

- Eq. 12: one transposition too many; omega = sum of omega_r u_r, as in Eq. 13 for v.
- Eqs. 24 and 27: the gyroscopic moment omega x I omega enters F with a minus. Euler's equation is
  moment = I alpha + omega x I omega, and F has to balance I A_bar.
- Eq. 42: with this F the articulated equation of motion is P^T (I_hat A - F_hat) = 0; the printed plus contradicts Eq. 53.
- Eq. 45: forces acting in the joints are not in F; they contribute -S I_hat P M^-1 tau to the parent and enter Eq. 53. (The
result is the same if F contains the joint's force on k and its reaction on Pr[k].)
- Eq. 50: the left-hand side lacks its d/dp_j.
- Eq. 51: the first P lacks its transposition.
- Eq. 52: d(M^-1) = -M^-1 dM M^-1; the minus is missing.
- Eqs. 54 and 55: the shift of an acceleration is S^T, as in Eq. 19.

The other misprints concern the dense method (Eq. 6, see `dense`) and closed loops (Eqs. 33, 36, 39 to 41, see `closure` and
`embedding`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..loops.partition import Partition
from ..model.model import GROUND, Coupling, Model
from ..model.motions import Ball, Displacement, Slide, Turn
from .arguments import State
from .arithmetic import Arithmetic, Array, SingularMatrixError
from .closure import AnyCut, EarClosure, closed_motion, cut, displacement, with_best_dependents
from .couplings import CoupledCut
from .ears import groups
from .embedding import embed
from .engine import Engine
from .forces import Wrench
from .outputs import Moving
from .pairs import Pair, Pairs
from .primitives import (
    generalised_inertia,
    joint_terms,
    placed_rotation,
    quaternion_rate_matrix,
    shift,
)
from .terms import Terms


@dataclass(slots=True)
class Articulated:
    """The articulated quantities of one body, named as in the table of `terms`.

    ``I_locked (6, 6)`` is I_hat with the children's joints locked. It is the scale for M_k, in which nearly everything may
    cancel.
    """

    I_hat: Pair
    F_hat: Pair
    I_locked: Array
    M_inverse: Pair = field(init=False)


class RecursiveEngine(Engine):
    """Reference engine with the paper's recursive method, O(n + m) for each evaluation and direction.

    `Engine` documents its methods.
    """

    def __init__(self, model: Model, numbers: str | Arithmetic = "float64", partition: Partition | None = None) -> None:
        super().__init__(model, numbers, partition)
        self.groups = groups(self.model, self.partition, self.held.tolist())
        held = set(self.held.tolist())
        self.free = [
            [j for j, i in enumerate(range(u.start, u.stop)) if i not in held] for _, u in self.model.coordinate_slices
        ]

    def _accelerations(self, state: State) -> Pair:
        """udot, (nu, 1): kinematic sweep, elimination of loops, triangularization, back substitution."""
        return self._with_accelerations(self._explicit_accelerations(state), state.pairs)

    def _explicit_accelerations(self, state: State) -> Pair:
        """udot, (nu, 1), with zero for prescribed speeds, whose accelerations the remainders contain."""
        bodies = self._motion(state)
        rotors = self._armature(state.pairs)
        if not self.model.loops:
            return self._back_substitution(bodies, self._triangularization(bodies, rotors))
        cuts = self._cuts(state.pairs, bodies)
        groups = [with_best_dependents(self.model, group, state.pairs, bodies, cuts) for group in self.groups]
        closures = [EarClosure(self.model, group, state.pairs, bodies, cuts) for group in groups]
        remainders = [
            joint.of_coordinates(state.pairs, self._given_accelerations(state.pairs))
            if isinstance(joint, CoupledCut)
            else joint.remainder(state.pairs, bodies[loop.start.body], bodies[loop.end.body])
            for loop, joint in zip(self.model.loops, cuts, strict=True)
        ]
        return embed(self.model, groups, closures, bodies, remainders, rotors, state.pairs)

    def _solve_mass(self, state: State, b: Pair) -> Pair:
        """M^-1 b, (nu, 1): the same sweeps with b as joint forces and no other loads."""
        bodies = self._motion(state)
        for body, (_, rows) in zip(bodies, self.model.coordinate_slices, strict=False):
            body.F, body.tau = state.pairs.zeros(6, 1), b[rows]
        return self._back_substitution(bodies, self._triangularization(bodies, self._armature(state.pairs)))

    def _triangularization(self, bodies: list[Terms], rotors: Pair) -> list[Articulated]:
        """Articulated inertias and forces, inward, Eqs. 42 to 52; the ground's last, as in `bodies`.

        The reflected inertia of a joint's rotors enters only M_k: T_k leaves their part of the inertia along P.
        """
        # Every body starts with its own values and adds those of its children: the sums over Dist[k] of Eqs. 48 to 50.
        articulated = [Articulated(b.I, b.F, b.I.value) for b in bodies]
        for k in reversed(self.model.outward):
            b, art, pr = bodies[k], articulated[k], articulated[self.model.bodies[k].parent]
            S, I_hat = b.S, art.I_hat
            P, tau = self._freedoms(k, b)

            own = rotors[self._free_places(k)]
            turn = self.arithmetic.eye(len(own.value))
            resisting = Pair(turn * own.value, turn * own.tangent)
            M = P.mT @ I_hat @ P + resisting  # Eq. 47, and the rotors; Eq. 51, its first P transposed
            M_inverse = self._inverse(k, M.value, P.value.mT @ art.I_locked @ P.value + resisting.value)
            art.M_inverse = Pair(M_inverse, -M_inverse @ M.tangent @ M_inverse)  # Eq. 52 with the missing minus

            # H = I_hat P M^-1, (6, f), is used in Eq. 46 and in the contribution of the joint force.
            H = I_hat @ P @ art.M_inverse
            T = S - S @ H @ P.mT  # Eq. 46

            pr.I_locked = pr.I_locked + S.value @ I_hat.value @ S.value.mT
            pr.I_hat = pr.I_hat + T @ I_hat @ S.mT  # Eqs. 44 and 49
            pr.F_hat = pr.F_hat + T @ art.F_hat - S @ H @ tau  # Eqs. 45 and 50, and the joint force
        return articulated

    def _back_substitution(self, bodies: list[Terms], articulated: list[Articulated]) -> Pair:
        """The accelerations udot, (nu, 1), by the outward sweep of Eqs. 53 to 56."""
        model, pairs = self.model, self._constants(bodies)
        udot = pairs.zeros(model.nu, 1)
        A_bar = [pairs.zeros(6, 1)] * len(bodies)  # Eq. 56: the ground's acceleration stays zero
        for k in model.outward:
            b, art, rows = bodies[k], articulated[k], self._free_places(k)
            P, tau = self._freedoms(k, b)
            A = b.S.mT @ A_bar[model.bodies[k].parent]
            udot_k = art.M_inverse @ (P.mT @ (art.F_hat - art.I_hat @ A) + tau)  # Eq. 53, and the joint force; Eq. 55
            A_bar[k] = A + P @ udot_k  # Eqs. 54 and 55 with S^T
            udot[rows] = udot_k
        return udot

    def _constants(self, bodies: list[Terms]) -> Pairs:
        return Pairs(self.arithmetic, len(bodies[GROUND].V.tangent), {})

    def _free_places(self, k: int) -> list[int]:
        """Indices in u of the speeds of a joint that are not prescribed."""
        return [self.model.coordinate_slices[k][1].start + j for j in self.free[k]]

    def _freedoms(self, k: int, b: Terms) -> tuple[Pair, Pair]:
        """Columns of P and entries of tau of a joint for its speeds that are not prescribed."""
        free = self.free[k]
        return (b.P, b.tau) if len(free) == len(b.tau.value) else (b.P[:, free], b.tau[free])

    def _motion(self, state: State) -> list[Terms]:
        """The kinematic sweep (outward), Eqs. 12 to 29: one `Terms` per body, the ground's last (index -1)."""
        model, pairs = self.model, state.pairs
        bodies = [self._ground(pairs)] * (len(model.bodies) + 1)
        gravity, on_speeds, given = (
            self._gravity(pairs),
            self._forces_on_speeds(pairs),
            self._given_accelerations(pairs),
        )
        for k in model.outward:
            body, (q_rows, u_rows) = model.bodies[k], model.coordinate_slices[k]
            pr, u = bodies[body.parent], state.u[u_rows]

            # Geometry and inertia: local to the body (the derivative primitives).
            joint = joint_terms(body, pairs, state.q[q_rows], u)
            r = pairs.vector(body.com)  # from the child's origin to the mass centre k*
            s = pairs.vector(body.joint.at) - pr.com  # from the mass centre Pr[k]* to the joint, in Pr[k]
            C_fixed = placed_rotation(body.joint, pairs)
            C = C_fixed @ joint.R
            gamma = C.mT @ (s + C_fixed @ joint.d) + r
            lever = pairs.block([[pairs.eye(3), pairs.zeros(3, 3)],
                                 [-pairs.skew(r), pairs.eye(3)]])  # fmt: skip
            P, Pdot_u = lever @ joint.P, lever @ joint.Pdot_u  # shifted from the child's origin to k*
            S, I = shift(pairs, C, gamma), generalised_inertia(body, pairs)

            # Velocity: V_t (Eqs. 20, 25) is the part of V_bar due to prescribed speeds, which are among the u here.
            v = P @ u  # motion of k* relative to the parent
            V = S.mT @ pr.V + v  # Eq. 18, and Eq. 12

            # Acceleration remainder: terms of the moving parent and of the changing partial velocities.
            Ox, wx = pairs.skew(C.mT @ pr.V[:3]), pairs.skew(v[:3])  # omega of the parent, in k; omega relative to it
            remainder = pairs.block([[Ox @ v[:3]], [Ox @ Ox @ gamma + Ox @ (v[3:] + v[3:]) + wx @ v[3:]]]) + Pdot_u
            A_t = S.mT @ pr.A_t + remainder + P @ given[u_rows]  # Eqs. 21 and 26; `given`: prescribed accelerations

            # Generalised force: Eqs. 24 and 27, with a minus sign for the gyroscopic moment.
            N_C = pr.N_C @ C
            gyroscopic = pairs.skew(V[:3]) @ I[:3, :3] @ V[:3]
            F = pairs.block([[-gyroscopic], [I[3:, 3:] @ N_C.mT @ gravity]]) - I @ A_t
            bodies[k] = Terms(S, P, V, A_t, I, F, on_speeds[u_rows], N_C, pr.x + N_C @ gamma, r)
        for point, _, wrench in self._wrenches(pairs, bodies):
            if point.body != GROUND:
                self._apply(pairs, bodies[point.body], pairs.vector(point.at), wrench)
        return bodies

    @staticmethod
    def _apply(pairs: Pairs, b: Terms, at: Pair, wrench: Wrench) -> None:
        """Add a load that acts at the point ``at`` (3, 1) of a body to its generalised force."""
        inward = b.N_C.mT
        if wrench.force is not None:
            force = inward @ wrench.force
            b.F = b.F + pairs.block([[pairs.skew(at - b.com) @ force], [force]])
        if wrench.torque is not None:
            b.F = b.F + pairs.block([[inward @ wrench.torque], [pairs.zeros(3, 1)]])

    # --- loops: completion of dependent speeds and seeds ------------------------------------------------------------

    def _given_accelerations(self, pairs: Pairs) -> Pair:
        """Prescribed accelerations, (nu, 1), zero for all other speeds."""
        return self._with_accelerations(pairs.zeros(self.model.nu, 1), pairs)

    def _cuts(self, pairs: Pairs, bodies: list[Terms]) -> list[AnyCut]:
        """The loop joints, and couplings, at the position of the bodies."""
        return [
            CoupledCut(pairs, self.model, loop, bodies)
            if isinstance(loop, Coupling)
            else cut(pairs, loop, length, bodies[loop.start.body], bodies[loop.end.body], self.model.defaults, dropped)
            for loop, length, dropped in zip(self.model.loops, self.lengths, self.dropped_rows, strict=True)
        ]

    def _closed_speeds(self, state: State) -> Pair:
        """Eq. 30, outward: the dependent speeds of a group from the velocities of its ends."""
        pairs, bodies = state.pairs, self._motion(state)
        cuts = self._cuts(pairs, bodies)
        own = [b.P @ state.u[rows] for b, (_, rows) in zip(bodies, self.model.coordinate_slices, strict=False)]
        still = [pairs.zeros(len(joint.kept), 1) for joint in cuts]
        return closed_motion(self.model, self.groups, pairs, bodies, cuts, own, still)[self.dependent]

    def _displacements(self, state: State) -> Array:
        """Dependent displacements that close the loops, given the displacements due to parameters and independent seeds.

        With the dependent seeds at zero, the derivatives of N_C and x are the displacements of the bodies. The part of
        a body's displacement that is relative to the parent is called its own.
        """
        pairs, bodies = state.pairs, self._motion(state)
        cuts = self._cuts(pairs, bodies)
        moved = [displacement(pairs, b.N_C, b.x) for b in bodies]
        own = [moved[k] - bodies[k].S.mT @ moved[body.parent] for k, body in enumerate(self.model.bodies)]
        of_faces = [
            joint.besides(pairs, state.q, own)
            if isinstance(joint, CoupledCut)
            else joint.displacement_of_faces(
                pairs, loop, self.model.defaults, bodies[loop.start.body], bodies[loop.end.body]
            )
            for loop, joint in zip(self.model.loops, cuts, strict=True)
        ]
        return closed_motion(self.model, self.groups, pairs, bodies, cuts, own, of_faces).tangent

    def _closure(self, state: State) -> tuple[Pair, Pair]:
        pairs, bodies = state.pairs, self._motion(state)
        positions, velocities = [], []
        for loop, joint in zip(self.model.loops, self._cuts(pairs, bodies), strict=True):
            if isinstance(joint, CoupledCut):
                positions.append([joint.residual(pairs, state.q)])
                velocities.append([joint.of_coordinates(pairs, state.u)])
                continue
            positions.append([joint.position_residual(pairs, loop)])
            start, end = bodies[loop.start.body], bodies[loop.end.body]
            velocities.append([joint.K_end @ end.V - joint.K_start @ start.V])
        return pairs.block(positions), pairs.block(velocities)

    # --- other quantities of the same sweeps ----------------------------------------------------------------------

    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        """M udot - K, (nu, 1): Eqs. 19 outward, then the balance of every body inward."""
        model, pairs, explicit = self.model, state.pairs, self._explicit(udot)
        bodies = self._motion(state)
        A_bar = [pairs.zeros(6, 1)] * len(bodies)
        for k in model.outward:
            b, rows = bodies[k], model.coordinate_slices[k][1]
            A_bar[k] = b.S.mT @ A_bar[model.bodies[k].parent] + b.P @ explicit[rows]  # Eq. 54

        # Phi is the wrench that joint k transmits: first for the body's own motion, then also for the motion of its
        # children.
        Phi = [b.I @ A - b.F for b, A in zip(bodies, A_bar, strict=True)]
        result = pairs.zeros(model.nu, 1)
        for k in reversed(model.outward):
            b, pr, rows = bodies[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            result[rows] = b.P.mT @ Phi[k] - b.tau
            Phi[pr] = Phi[pr] + b.S @ Phi[k]
        return result + pairs.diagonal(self._armature(pairs)) @ udot

    def _explicit(self, udot: Pair) -> Pair:
        """udot with zeros for prescribed accelerations, because the remainders already contain them."""
        found = Pair(udot.value.copy(), udot.tangent.copy())
        found.value[self.held] *= 0
        found.tangent[:, self.held] *= 0
        return found

    def _mass_matrix(self, state: State) -> Pair:
        """M, (nu, nu), by composite inertias: M_jk = (P_j^j)^T jS^k I_composite^k P_k^k for j inboard of k."""
        model, pairs = self.model, state.pairs
        bodies = self._motion(state)
        M = pairs.zeros(model.nu, model.nu)
        composite = [b.I for b in bodies]
        for k in reversed(model.outward):
            b, pr, columns = bodies[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            X = composite[k] @ b.P
            composite[pr] = composite[pr] + b.S @ composite[k] @ b.S.mT
            j = k
            while j >= 0:
                b, rows = bodies[j], model.coordinate_slices[j][1]
                M[rows, columns] = b.P.mT @ X
                M[columns, rows] = M[rows, columns].mT
                X = b.S @ X
                j = model.bodies[j].parent
        return M + pairs.diagonal(self._armature(pairs))

    def _energies(self, state: State, motion: list[Terms]) -> tuple[Pair, Pair]:
        """Kinetic energy, the sum of V^T I V / 2 and of the rotors' energies, and potential energy, the sum of -m g^T x; (1,
        1)."""
        pairs, g = state.pairs, self._gravity(state.pairs)
        half = pairs.number(pairs.arithmetic.number(1) / 2)
        T = state.u.mT @ pairs.diagonal(self._armature(pairs)) @ state.u * half
        W = pairs.matrix([[self._potential(pairs, motion)]])
        for b in motion[:GROUND]:
            T = T + b.V.mT @ b.I @ b.V * half
            W = W - g.mT @ b.x * b.I[5, 5]
        return T, W

    def _point(self, motion: list[Terms], body: int, at: Pair) -> tuple[Pair, Pair]:
        """Position x + N_C r and velocity N_C (v + omega x r), with r from the mass centre; (3, 1) in the ground frame."""
        b = motion[body]
        r = at - b.com
        return b.x + b.N_C @ r, b.N_C @ (b.V[3:] + Pairs.skew(b.V[:3]) @ r)

    def _attitude(self, motion: list[Terms], body: int) -> tuple[Pair, Pair]:
        b = motion[body]
        return b.N_C, b.N_C @ b.V[:3]

    def _accelerating(self, state: State, motion: list[Terms], udot: Pair) -> Callable[[int, Pair], Pair]:
        """Outward, Eqs. 19 and 54: the part of all accelerations that is explicit in udot.

        A point of a body adds ``alpha x r + omega x (omega x r)``.
        """
        pairs, zero, udot = state.pairs, state.pairs.zeros(6, 1), self._explicit(udot)
        explicit = [zero for _ in motion]
        for k in self.model.outward:
            b, rows = motion[k], self.model.coordinate_slices[k][1]
            explicit[k] = b.S.mT @ explicit[self.model.bodies[k].parent] + b.P @ udot[rows]

        def acceleration(body: int, at: Pair) -> Pair:
            b, r = motion[body], at - motion[body].com
            A, turning = b.A_t + explicit[body], pairs.skew(b.V[:3])
            return b.N_C @ (A[3:] + pairs.skew(A[:3]) @ r + turning @ turning @ r)

        return acceleration

    def _moving(self, state: State, motion: list[Terms]) -> list[Moving]:
        found = []
        for b in motion[:GROUND]:
            I, V, N = b.I, b.V, b.N_C
            found.append(Moving(I[5, 5], b.x, N @ V[3:], N @ I[:3, :3] @ V[:3]))
        return found

    def _coordinate_rates(self, state: State) -> Pair:
        """qdot = C(q) u, Eq. 1 with D = 0, (nq, 1)."""
        pairs, rates = state.pairs, state.pairs.zeros(self.model.nq, 1)
        for body, (q_rows, u_rows) in zip(self.model.bodies, self.model.coordinate_slices, strict=True):
            q, u = state.q[q_rows], state.u[u_rows]
            for m in body.joint.kind.motion:
                match m:
                    case Turn(_, i) | Slide(_, i):
                        part = u[i : i + 1]  # Eq. 11
                    case Ball(i, j):
                        part = quaternion_rate_matrix(pairs, q[i : i + 4]) @ u[j : j + 3]
                    case Displacement(i, j):
                        part = joint_terms(body, pairs, q, u).R @ u[j : j + 3]
                rates[q_rows.start + i : q_rows.start + i + len(part.value)] = part
        return rates

    # --- parts of the kinematic sweep -----------------------------------------------------------------------------

    def _ground(self, pairs: Pairs) -> Terms:
        """The terms of the ground, which does not move; values that sweeps add to them are not used."""
        zero = {(r, c): pairs.zeros(r, c) for r, c in ((6, 6), (6, 1), (6, 0), (3, 1), (0, 1))}
        zero[3, 3] = pairs.eye(3)
        shapes = {"S": (6, 6), "P": (6, 0), "V": (6, 1), "A_t": (6, 1), "I": (6, 6), "F": (6, 1), "tau": (0, 1)}
        shapes |= {"N_C": (3, 3), "x": (3, 1), "com": (3, 1)}
        return Terms(**{name: zero[shape] for name, shape in shapes.items()})

    def _gravity(self, pairs: Pairs) -> Pair:
        """The acceleration of gravity in the ground frame, (3, 1), m/s^2."""
        return pairs.vector(self.model.gravity) if self.model.gravity else pairs.zeros(3, 1)

    def _inverse(self, k: int, M: Array, M_locked: Array) -> Array:
        """The inverse of M_k, (f, f); if it does not exist, an error names the body without inertia about its joint."""
        try:
            return self.arithmetic.inverse(M, [M_locked[i, i] for i in range(len(M))])
        except SingularMatrixError as error:
            body = self.model.bodies[k]
            raise SingularMatrixError(
                f"body {body.name}: nothing that its {body.joint.type} joint moves has inertia along or about it ({error})"
            ) from None
