"""The generic recursive engine: Anderson and Hsu's algorithm on 6x6 matrices, equation by equation.

Nothing is generated here and nothing is clever. Every statement of the four sweeps stands with its equation number and
is followed by its total derivative, the product rule written out; a name with a leading d is the total derivative
d/dp_j of Eq. 10, with the k directions as first axis. This engine is the witness the generated code is tested
against; it shares nothing with `codegen.mechanics`.

The sweeps of a tree stand in this file. Closed loops have files of their own, where the product rule is that of pairs:
`ears` (which bodies are resolved together), `closure` (Eqs. 30 to 38: dependent speeds, and the completion of
dependent seeds) and `embedding` (Eqs. 39 to 60 with loops).

The notation is that of `terms`.

The slips of the printed paper, each mended here where it is met:

- Eq. 12: a transposition too many; omega = sum of omega_r u_r, as Eq. 13 has it for v.
- Eqs. 24 and 27: the gyroscopic moment omega x I omega enters F with a minus. Euler's equation is
  moment = I alpha + omega x I omega, and F has to balance I A_bar.
- Eq. 42: with that F the articulated equation of motion is P^T (I_hat A - F_hat) = 0; the printed plus contradicts
  Eq. 53, which is right.
- Eq. 45: forces that work in the joints are not in F; they hand -S I_hat P M^-1 tau to the parent and enter Eq. 53.
  (The same comes out if the joint's force on k and its reaction on Pr[k] are put in F.)
- Eq. 50: the left-hand side lacks its d/dp_j.
- Eq. 51: the first P lacks its transposition.
- Eq. 52: d(M^-1) = -M^-1 dM M^-1; the minus is missing.
- Eqs. 54 and 55: the shift of an acceleration is S^T, as in Eq. 19.

The other slips concern the dense method (Eq. 6, see `dense`) and closed loops (Eqs. 33, 36, 39 to 41, see `closure` and
`embedding`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..loops.partition import Partition
from ..model.model import GROUND, Coupling, Model
from ..model.motions import Ball, Displacement, Slide, Turn
from .arguments import State
from .arithmetic import Array, SingularMatrixError
from .closure import AnyCut, EarClosure, closed_motion, cut, displacement, with_best_dependents
from .couplings import CoupledCut
from .ears import groups
from .embedding import embed
from .engine import Engine
from .forces import Wrench
from .outputs import Moving
from .pairs import Pair, Pairs, skew
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
    """The articulated quantities of one body, named as in the table of `terms`, each with its total derivatives.

    ``I_locked (6, 6)`` is what I_hat would be with the children's joints locked: the measure of what is left in M_k
    where nearly all has cancelled.
    """

    I_hat: Array
    dI_hat: Array
    F_hat: Array
    dF_hat: Array
    I_locked: Array
    M_inverse: Array = field(init=False)
    dM_inverse: Array = field(init=False)


class RecursiveEngine(Engine):
    """The paper's recursive method, O(n + m) per evaluation and per direction. See `Engine` for the face."""

    def __init__(self, model: Model, numbers: str = "float64", partition: Partition | None = None) -> None:
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
        """The same, zero for what is prescribed: that is in the remainders."""
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
        """M^-1 b, (nu, 1): the same sweeps with b for the joint forces and nothing else acting."""
        bodies = self._motion(state)
        for body, (_, rows) in zip(bodies, self.model.coordinate_slices, strict=False):
            body.F, body.dF = 0 * body.F, 0 * body.dF
            body.tau, body.dtau = b.value[rows], b.tangent[:, rows]
        return self._back_substitution(bodies, self._triangularization(bodies, self._armature(state.pairs)))

    def _triangularization(self, bodies: list[Terms], rotors: Pair) -> list[Articulated]:
        """Articulated inertias and forces, inward, Eqs. 42 to 52; the ground's last, as in `bodies`.

        What the rotors of a joint resist with is in its M_k and nowhere else: T_k leaves their part of the inertia along P.
        """
        # Every body starts as its own and collects its children: the sums over Dist[k] of Eqs. 48 to 50.
        articulated = [Articulated(b.I, b.dI, b.F, b.dF, b.I) for b in bodies]
        U = self.arithmetic.eye(6)
        for k in reversed(self.model.outward):
            b, art, pr = bodies[k], articulated[k], articulated[self.model.bodies[k].parent]
            S, dS, P, dP, tau, dtau = b.S, b.dS, *self._freedoms(k, b)
            I_hat, dI_hat, F_hat, dF_hat = art.I_hat, art.dI_hat, art.F_hat, art.dF_hat

            own = rotors[self._free_places(k)]
            turn = self.arithmetic.eye(len(own.value))
            M = P.mT @ I_hat @ P + turn * own.value  # Eq. 47, and the rotors
            dM = (  # Eq. 51, its first P transposed
                dP.mT @ I_hat @ P + P.mT @ dI_hat @ P + P.mT @ I_hat @ dP + turn * own.tangent
            )
            M_inverse = self._inverse(k, M, P.mT @ art.I_locked @ P + turn * own.value)
            dM_inverse = -M_inverse @ dM @ M_inverse  # Eq. 52 with its minus

            # H = I_hat P M^-1, (6, f), stands in Eq. 46 and in what the joint force hands on.
            H = I_hat @ P @ M_inverse
            dH = dI_hat @ P @ M_inverse + I_hat @ dP @ M_inverse + I_hat @ P @ dM_inverse
            T = S @ (U - H @ P.mT)  # Eq. 46
            dT = dS @ (U - H @ P.mT) - S @ (dH @ P.mT + H @ dP.mT)

            pr.I_locked = pr.I_locked + S @ I_hat @ S.mT
            pr.I_hat = pr.I_hat + T @ I_hat @ S.mT  # Eq. 44
            pr.dI_hat = pr.dI_hat + dT @ I_hat @ S.mT + T @ dI_hat @ S.mT + T @ I_hat @ dS.mT  # Eq. 49
            pr.F_hat = pr.F_hat + T @ F_hat - S @ H @ tau  # Eq. 45, and the joint force
            pr.dF_hat = (  # Eq. 50 with its d/dp_j, and the joint force
                pr.dF_hat + dT @ F_hat + T @ dF_hat - dS @ H @ tau - S @ dH @ tau - S @ H @ dtau
            )
            art.M_inverse, art.dM_inverse = M_inverse, dM_inverse
        return articulated

    def _back_substitution(self, bodies: list[Terms], articulated: list[Articulated]) -> Pair:
        """udot, (nu, 1), outward, Eqs. 53 to 56."""
        model, zeros, k_directions = self.model, self.arithmetic.zeros, len(bodies[GROUND].dV)
        udot, dudot = zeros(model.nu, 1), zeros(k_directions, model.nu, 1)
        A_bar = [zeros(6, 1) for _ in bodies]  # Eq. 56: the ground's stays zero
        dA_bar = [zeros(k_directions, 6, 1) for _ in bodies]
        for k in model.outward:
            b, art, pr = bodies[k], articulated[k], model.bodies[k].parent
            S, dS, P, dP, tau, dtau = b.S, b.dS, *self._freedoms(k, b)
            rows = self._free_places(k)

            A = S.mT @ A_bar[pr]
            dA = dS.mT @ A_bar[pr] + S.mT @ dA_bar[pr]
            f = art.F_hat - art.I_hat @ A
            df = art.dF_hat - art.dI_hat @ A - art.I_hat @ dA
            r = P.mT @ f + tau
            dr = dP.mT @ f + P.mT @ df + dtau
            udot_k = art.M_inverse @ r  # Eq. 53, and the joint force
            dudot_k = art.dM_inverse @ r + art.M_inverse @ dr  # Eq. 55, first line
            A_bar[k] = A + P @ udot_k  # Eq. 54 with S^T
            dA_bar[k] = dA + dP @ udot_k + P @ dudot_k  # Eq. 55, second line, with S^T
            udot[rows], dudot[:, rows] = udot_k, dudot_k
        return Pair(udot, dudot)

    def _free_places(self, k: int) -> list[int]:
        """Where the speeds of a joint that are not prescribed stand in u."""
        return [self.model.coordinate_slices[k][1].start + j for j in self.free[k]]

    def _freedoms(self, k: int, b: Terms) -> tuple[Array, Array, Array, Array]:
        """P, dP, tau and dtau of what of a joint is not prescribed."""
        free = self.free[k]
        if len(free) == len(b.tau):
            return b.P, b.dP, b.tau, b.dtau
        return b.P[:, free], b.dP[:, :, free], b.tau[free], b.dtau[:, free]

    def _motion(self, state: State) -> list[Terms]:
        """The kinematic sweep (outward), Eqs. 12 to 29: one `Terms` a body, the ground's last (index -1)."""
        model, pairs = self.model, state.pairs
        bodies = [self._ground(pairs)] * (len(model.bodies) + 1)
        gravity = self._gravity(pairs)
        g, dg = gravity.value, gravity.tangent
        on_speeds = self._forces_on_speeds(pairs)
        given = pairs.constant(np.zeros((model.nu, 1), int))
        given = self._with_accelerations(given, pairs)
        for k in model.outward:
            body = model.bodies[k]
            q_rows, u_rows = model.coordinate_slices[k]
            u, du = state.u[u_rows].value, state.u[u_rows].tangent
            pr = bodies[body.parent]

            # Geometry and inertia: local to the body, by pairs (the derivative primitives).
            joint = joint_terms(body, pairs, state.q[q_rows], state.u[u_rows])
            r = pairs.vector(body.com)  # from the joint's outboard side to k*
            s = pairs.vector(body.joint.at) - Pair(pr.com, pr.dcom)  # from Pr[k]* to the joint, in Pr[k]
            C_fixed = placed_rotation(body.joint, pairs)
            C_pair = C_fixed @ joint.R
            gamma_pair = C_pair.mT @ (s + C_fixed @ joint.d) + r
            lever = pairs.block([[pairs.constant(np.eye(3, dtype=int)), pairs.constant(np.zeros((3, 3), int))],
                                 [-pairs.skew(r), pairs.constant(np.eye(3, dtype=int))]])  # fmt: skip
            P_pair, Pdot_u = lever @ joint.P, lever @ joint.Pdot_u  # from the child's origin to its mass centre
            C, dC, gamma, dgamma = C_pair.value, C_pair.tangent, gamma_pair.value, gamma_pair.tangent
            P, dP = P_pair.value, P_pair.tangent
            S, dS = shift(C, dC, gamma, dgamma)
            I, dI = generalised_inertia(body, pairs)

            # Velocity: V_t (Eqs. 20, 25) is what prescribed speeds, which are among the u here, add to V_bar.
            v, dv = P @ u, dP @ u + P @ du  # relative to the parent
            V = S.mT @ pr.V + v  # Eq. 18
            dV = dS.mT @ pr.V + S.mT @ pr.dV + dv
            omega, domega = V[:3], dV[:, :3]  # Eq. 12

            # Acceleration remainder: what the moving parent and the changing partial velocities add.
            Omega = C.mT @ pr.V[:3]  # angular velocity of the parent, in k
            dOmega = dC.mT @ pr.V[:3] + C.mT @ pr.dV[:, :3]
            w, dw, l, dl = v[:3], dv[:, :3], v[3:], dv[:, 3:]
            Ox, dOx, wx, dwx = skew(Omega), skew(dOmega), skew(w), skew(dw)
            remainder = np.concatenate([Ox @ w, Ox @ Ox @ gamma + 2 * Ox @ l + wx @ l]) + Pdot_u.value
            dangular = dOx @ w + Ox @ dw
            dlinear = (dOx @ Ox @ gamma + Ox @ dOx @ gamma + Ox @ Ox @ dgamma
                       + 2 * dOx @ l + 2 * Ox @ dl + dwx @ l + wx @ dl)  # fmt: skip
            a, da = given[u_rows].value, given[u_rows].tangent  # of what is prescribed; all others are zero
            A_t = S.mT @ pr.A_t + remainder + P @ a  # Eq. 21
            dA_t = (  # Eq. 26
                dS.mT @ pr.A_t + S.mT @ pr.dA_t + np.concatenate([dangular, dlinear], axis=1) + Pdot_u.tangent
                + dP @ a + P @ da
            )  # fmt: skip

            # Generalised force.
            N_C = pr.N_C @ C
            dN_C = pr.dN_C @ C + pr.N_C @ dC
            weight = I[3:, 3:] @ N_C.mT @ g
            dweight = dI[:, 3:, 3:] @ N_C.mT @ g + I[3:, 3:] @ (dN_C.mT @ g + N_C.mT @ dg)
            J, dJ, ox, dox = I[:3, :3], dI[:, :3, :3], skew(omega), skew(domega)
            gyroscopic = ox @ J @ omega
            dgyroscopic = dox @ J @ omega + ox @ dJ @ omega + ox @ J @ domega
            F = np.concatenate([-gyroscopic, weight]) - I @ A_t  # Eq. 24 with the gyroscopic minus
            dF = np.concatenate([-dgyroscopic, dweight], axis=1) - dI @ A_t - I @ dA_t  # Eq. 27, the same

            x = pr.x + N_C @ gamma
            dx = pr.dx + dN_C @ gamma + N_C @ dgamma
            tau = on_speeds[u_rows]
            bodies[k] = Terms(S, dS, P, dP, V, dV, A_t, dA_t, I, dI, F, dF, tau.value, tau.tangent,
                              N_C, dN_C, x, dx, r.value, r.tangent)  # fmt: skip
        for point, _, wrench in self._wrenches(pairs, bodies):
            if point.body != GROUND:
                self._apply(pairs, bodies[point.body], pairs.vector(point.at), wrench)
        return bodies

    @staticmethod
    def _apply(pairs: Pairs, b: Terms, at: Pair, wrench: Wrench) -> None:
        """Add what acts at the point ``at`` (3, 1) of a body to its generalised force."""
        inward, F = b.pair("N_C").mT, b.pair("F")
        if wrench.force is not None:
            force = inward @ wrench.force
            F = F + pairs.block([[pairs.skew(at - b.pair("com")) @ force], [force]])
        if wrench.torque is not None:
            F = F + pairs.block([[inward @ wrench.torque], [pairs.constant(np.zeros((3, 1), int))]])
        b.F, b.dF = F.value, F.tangent

    # --- loops: completion of dependent speeds and seeds ------------------------------------------------------------

    def _given_accelerations(self, pairs: Pairs) -> Pair:
        """Those of what is prescribed, (nu, 1), zero for all others."""
        return self._with_accelerations(pairs.constant(np.zeros((self.model.nu, 1), int)), pairs)

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
        own = [b.pair("P") @ state.u[rows] for b, (_, rows) in zip(bodies, self.model.coordinate_slices, strict=False)]
        still = [pairs.constant(np.zeros((len(joint.kept), 1), int)) for joint in cuts]
        return closed_motion(self.model, self.groups, pairs, bodies, cuts, own, still)[self.dependent]

    def _displacements(self, state: State) -> Array:
        """The same sweep for displacements: what parameters and independent seeds move is the motion to be closed.

        With the dependent seeds at zero, the derivatives of N_C and x are the displacements of the bodies; what one of them
        has more than its parent is its own.
        """
        pairs, bodies = state.pairs, self._motion(state)
        cuts = self._cuts(pairs, bodies)
        moved = [displacement(pairs, b.pair("N_C"), b.pair("x")) for b in bodies]
        own = [moved[k] - bodies[k].pair("S").mT @ moved[body.parent] for k, body in enumerate(self.model.bodies)]
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
            velocities.append([joint.K_end @ end.pair("V") - joint.K_start @ start.pair("V")])
        return pairs.block(positions), pairs.block(velocities)

    # --- other quantities of the same sweeps ----------------------------------------------------------------------

    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        """M udot - K, (nu, 1): Eqs. 19 outward, the balance of every body inward."""
        model, zeros, whole, udot = self.model, self.arithmetic.zeros, udot, self._explicit(udot)
        bodies = self._motion(state)
        A_bar = [zeros(6, 1) for _ in bodies]
        dA_bar = [zeros(state.pairs.k, 6, 1) for _ in bodies]
        for k in model.outward:
            b, pr, rows = bodies[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            udot_k, dudot_k = udot.value[rows], udot.tangent[:, rows]
            A_bar[k] = b.S.mT @ A_bar[pr] + b.P @ udot_k  # Eq. 54
            dA_bar[k] = b.dS.mT @ A_bar[pr] + b.S.mT @ dA_bar[pr] + b.dP @ udot_k + b.P @ dudot_k

        # Phi: what joint k has to transmit, the body's own need first, then its children's.
        Phi = [b.I @ A - b.F for b, A in zip(bodies, A_bar, strict=True)]
        dPhi = [b.dI @ A + b.I @ dA - b.dF for b, A, dA in zip(bodies, A_bar, dA_bar, strict=True)]
        result, dresult = zeros(model.nu, 1), zeros(state.pairs.k, model.nu, 1)
        for k in reversed(model.outward):
            b, pr, rows = bodies[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            result[rows] = b.P.mT @ Phi[k] - b.tau
            dresult[:, rows] = b.dP.mT @ Phi[k] + b.P.mT @ dPhi[k] - b.dtau
            Phi[pr] = Phi[pr] + b.S @ Phi[k]
            dPhi[pr] = dPhi[pr] + b.dS @ Phi[k] + b.S @ dPhi[k]
        return Pair(result, dresult) + state.pairs.diagonal(self._armature(state.pairs)) @ whole

    def _explicit(self, udot: Pair) -> Pair:
        """Without what is prescribed, which the remainders have."""
        found = Pair(udot.value.copy(), udot.tangent.copy())
        found.value[self.held] *= 0
        found.tangent[:, self.held] *= 0
        return found

    def _mass_matrix(self, state: State) -> Pair:
        """M, (nu, nu), by composite inertias: M_jk = (P_j^j)^T jS^k I_composite^k P_k^k for j inboard of k."""
        model, zeros = self.model, self.arithmetic.zeros
        bodies = self._motion(state)
        M, dM = zeros(model.nu, model.nu), zeros(state.pairs.k, model.nu, model.nu)
        I_c, dI_c = [b.I for b in bodies], [b.dI for b in bodies]
        for k in reversed(model.outward):
            b, pr, columns = bodies[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            X, dX = I_c[k] @ b.P, dI_c[k] @ b.P + I_c[k] @ b.dP
            I_c[pr] = I_c[pr] + b.S @ I_c[k] @ b.S.mT
            dI_c[pr] = dI_c[pr] + b.dS @ I_c[k] @ b.S.mT + b.S @ dI_c[k] @ b.S.mT + b.S @ I_c[k] @ b.dS.mT
            j = k
            while j >= 0:
                b, rows = bodies[j], model.coordinate_slices[j][1]
                M[rows, columns] = b.P.mT @ X
                dM[:, rows, columns] = b.dP.mT @ X + b.P.mT @ dX
                M[columns, rows] = M[rows, columns].mT
                dM[:, columns, rows] = dM[:, rows, columns].mT
                X, dX = b.S @ X, b.dS @ X + b.S @ dX
                j = model.bodies[j].parent
        return Pair(M, dM) + state.pairs.diagonal(self._armature(state.pairs))

    def _energies(self, state: State, motion: list[Terms]) -> tuple[Pair, Pair]:
        """Kinetic energy, the sum of V^T I V / 2 and that of rotors, and potential energy, the sum of -m g^T x; (1, 1)."""
        gravity = self._gravity(state.pairs)
        g, dg = gravity.value, gravity.tangent
        T, dT, W, dW = 0 * (g.mT @ g), 0 * (dg.mT @ g), 0 * (g.mT @ g), 0 * (dg.mT @ g)
        for b in motion[:GROUND]:
            T = T + b.V.mT @ b.I @ b.V / 2
            dT = dT + b.V.mT @ b.dI @ b.V / 2 + b.V.mT @ b.I @ b.dV  # I is symmetric
            m, dm = b.I[5:, 5:], b.dI[:, 5:, 5:]
            W = W - m * (g.mT @ b.x)
            dW = dW - dm * (g.mT @ b.x) - m * (dg.mT @ b.x + g.mT @ b.dx)
        rotors = state.u.mT @ state.pairs.diagonal(self._armature(state.pairs)) @ state.u
        T, dT = T + rotors.value / 2, dT + rotors.tangent / 2
        energy = self._potential(state.pairs, motion)
        W, dW = W + energy.value, dW + energy.tangent[:, None, None]
        return Pair(T, dT), Pair(W, dW)

    def _point(self, motion: list[Terms], body: int, at: Pair) -> tuple[Pair, Pair]:
        """Position x + N_C r and velocity N_C (v + omega x r), r from the mass centre; (3, 1) in the ground frame."""
        b = motion[body]
        r, dr = at.value - b.com, at.tangent - b.dcom
        position, dposition = b.x + b.N_C @ r, b.dx + b.dN_C @ r + b.N_C @ dr
        v = b.V[3:] + skew(b.V[:3]) @ r
        dv = b.dV[:, 3:] + skew(b.dV[:, :3]) @ r + skew(b.V[:3]) @ dr
        return Pair(position, dposition), Pair(b.N_C @ v, b.dN_C @ v + b.N_C @ dv)

    def _attitude(self, motion: list[Terms], body: int) -> tuple[Pair, Pair]:
        b = motion[body]
        return b.pair("N_C"), b.pair("N_C") @ b.pair("V")[:3]

    def _accelerating(self, state: State, motion: list[Terms], udot: Pair) -> Callable[[int, Pair], Pair]:
        """Outward, Eqs. 19 and 54: the part of all accelerations that is explicit in udot.

        A point of a body adds ``alpha x r + omega x (omega x r)``.
        """
        pairs, zero, udot = state.pairs, state.pairs.constant(np.zeros((6, 1), int)), self._explicit(udot)
        explicit = [zero for _ in motion]
        for k in self.model.outward:
            b, rows = motion[k], self.model.coordinate_slices[k][1]
            explicit[k] = b.pair("S").mT @ explicit[self.model.bodies[k].parent] + b.pair("P") @ udot[rows]

        def acceleration(body: int, at: Pair) -> Pair:
            b, r = motion[body], at - motion[body].pair("com")
            A, turning = b.pair("A_t") + explicit[body], pairs.skew(b.pair("V")[:3])
            return b.pair("N_C") @ (A[3:] + pairs.skew(A[:3]) @ r + turning @ turning @ r)

        return acceleration

    def _moving(self, state: State, motion: list[Terms]) -> list[Moving]:
        found = []
        for b in motion[:GROUND]:
            I, V, N = b.pair("I"), b.pair("V"), b.pair("N_C")
            found.append(Moving(I[5, 5], b.pair("x"), N @ V[3:], N @ I[:3, :3] @ V[:3]))
        return found

    def _coordinate_rates(self, state: State) -> Pair:
        """qdot = C(q) u, Eq. 1 with D = 0, (nq, 1)."""
        pairs, rates = state.pairs, state.pairs.constant(np.zeros((self.model.nq, 1), int))
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
                pairs.put(rates, q_rows.start + i, part)
        return rates

    # --- parts of the kinematic sweep -----------------------------------------------------------------------------

    def _ground(self, pairs: Pairs) -> Terms:
        """The ground does not move; what the sweeps collect for it is never read."""
        zero = {(r, c): pairs.constant(np.zeros((r, c), int)) for r, c in ((6, 6), (6, 1), (6, 0), (3, 1), (0, 1))}
        zero[3, 3] = pairs.constant(np.eye(3, dtype=int))
        shapes = {"S": (6, 6), "P": (6, 0), "V": (6, 1), "A_t": (6, 1), "I": (6, 6), "F": (6, 1), "tau": (0, 1)}
        shapes |= {"N_C": (3, 3), "x": (3, 1), "com": (3, 1)}
        values = {name: zero[shape].value for name, shape in shapes.items()}
        return Terms(**values, **{f"d{name}": zero[shape].tangent for name, shape in shapes.items()})

    def _gravity(self, pairs: Pairs) -> Pair:
        """The acceleration of gravity in the ground frame, (3, 1), m/s^2."""
        return pairs.vector(self.model.gravity) if self.model.gravity else pairs.constant(np.zeros((3, 1), int))

    def _inverse(self, k: int, M: Array, M_locked: Array) -> Array:
        """The inverse of M_k, (f, f); a body without inertia about its joint is named."""
        try:
            return self.arithmetic.inverse(M, [M_locked[i, i] for i in range(len(M))])
        except SingularMatrixError as error:
            body = self.model.bodies[k]
            raise SingularMatrixError(
                f"body {body.name}: nothing that its {body.joint.type} joint moves has inertia against it ({error})"
            ) from None
