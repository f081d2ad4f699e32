"""The generic recursive engine: Anderson and Hsu's algorithm on 6x6 matrices, equation by equation, for trees.

Nothing is generated here and nothing is clever. Every statement of the four sweeps stands with its equation number and
is followed by its total derivative, the product rule written out; a name with a leading d is the total derivative
d/dp_j of Eq. 10, with the k directions as first axis. This engine is the witness the generated code is tested
against; it shares nothing with `codegen.mechanics`.

Notation, as in the paper (body k, its parent Pr[k]; components in body k's own axes unless said otherwise):

======== ======= ==============================================================================================
C        (3, 3)  direction cosines: turns components in k into components in Pr[k]
gamma    (3, 1)  from the mass centre of Pr[k] to that of k, m
S        (6, 6)  shift: force systems at k's mass centre, in k, to Pr[k]'s mass centre, in Pr[k]
P        (6, f)  partial velocities P_k^k of the mass centre for the joint's f speeds
V        (6, 1)  angular velocity, rad/s, above velocity of the mass centre, m/s, relative to the ground
A_t      (6, 1)  acceleration remainder: all of the acceleration that is not explicit in udot
A_bar    (6, 1)  the part that is explicit in udot
I        (6, 6)  generalised inertia about the mass centre
R        (6, 1)  applied moments about, and forces at, the mass centre (the paper's bold F^k)
F        (6, 1)  generalised force
tau      (f, 1)  joint force, working on the joint's speeds
I_hat    (6, 6)  articulated inertia
F_hat    (6, 1)  articulated force
M        (f, f)  the block M_k of the triangularized mass matrix
T        (6, 6)  triangularization matrix
======== ======= ==============================================================================================

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

The other slips (Eqs. 6, 33 to 41) concern the dense method and closed loops.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..model.model import GROUND, Body
from .arithmetic import Array, SingularMatrixError
from .engine import Engine, State
from .pairs import Pair, Pairs, skew


@dataclass(slots=True)
class Terms:
    """The quantities of one body, named as in the module's table, each with its total derivatives.

    ``N_C (3, 3)`` turns components in k into components in the ground, ``x (3, 1)`` is the mass centre in the ground
    frame, m, ``com (3, 1)`` the mass centre in the body frame.
    """

    S: Array
    dS: Array
    P: Array
    dP: Array
    V: Array
    dV: Array
    A_t: Array
    dA_t: Array
    I: Array
    dI: Array
    F: Array
    dF: Array
    tau: Array
    dtau: Array
    N_C: Array
    dN_C: Array
    x: Array
    dx: Array
    com: Array
    dcom: Array


@dataclass(slots=True)
class Articulated:
    """The articulated quantities of one body, named as in the module's table, each with its total derivatives.

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


@dataclass(slots=True)
class JointTerms:
    """A joint's own kinematics, child body frame relative to joint frame.

    ``R (3, 3)`` turns child components into joint frame components; ``d (3, 1)`` is the child's origin in the joint
    frame, m; ``P (6, f)`` maps the speeds to angular velocity and velocity of the child's origin relative to the parent,
    in child components; ``Pdot_u (6, 1)`` is the derivative of P, in child components, times u.
    """

    R: Pair
    d: Pair
    P: Pair
    Pdot_u: Pair


class RecursiveEngine(Engine):
    """The paper's recursive method for any tree, O(n) per evaluation and per direction. See `Engine` for the face."""

    def _accelerations(self, state: State) -> Pair:
        """udot, (nu, 1): kinematic sweep, triangularization, back substitution."""
        bodies = self._motion(state)
        return self._back_substitution(bodies, self._triangularization(bodies))

    def _solve_mass(self, state: State, b: Pair) -> Pair:
        """M^-1 b, (nu, 1): the same sweeps with b for the joint forces and nothing else acting."""
        bodies = self._motion(state)
        for body, (_, rows) in zip(bodies, self.model.coordinate_slices, strict=False):
            body.F, body.dF = 0 * body.F, 0 * body.dF
            body.tau, body.dtau = b.value[rows], b.tangent[:, rows]
        return self._back_substitution(bodies, self._triangularization(bodies))

    def _triangularization(self, bodies: list[Terms]) -> list[Articulated]:
        """Articulated inertias and forces, inward, Eqs. 42 to 52; the ground's last, as in `bodies`."""
        # Every body starts as its own and collects its children: the sums over Dist[k] of Eqs. 48 to 50.
        articulated = [Articulated(b.I, b.dI, b.F, b.dF, b.I) for b in bodies]
        U = self.arithmetic.eye(6)
        for k in reversed(self.model.outward):
            b, art, pr = bodies[k], articulated[k], articulated[self.model.bodies[k].parent]
            S, dS, P, dP, tau, dtau = b.S, b.dS, b.P, b.dP, b.tau, b.dtau
            I_hat, dI_hat, F_hat, dF_hat = art.I_hat, art.dI_hat, art.F_hat, art.dF_hat

            M = P.mT @ I_hat @ P  # Eq. 47
            dM = dP.mT @ I_hat @ P + P.mT @ dI_hat @ P + P.mT @ I_hat @ dP  # Eq. 51, its first P transposed
            M_inverse = self._inverse(k, M, P.mT @ art.I_locked @ P)
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
            b, art, pr, rows = bodies[k], articulated[k], model.bodies[k].parent, model.coordinate_slices[k][1]
            S, dS, P, dP = b.S, b.dS, b.P, b.dP

            A = S.mT @ A_bar[pr]
            dA = dS.mT @ A_bar[pr] + S.mT @ dA_bar[pr]
            f = art.F_hat - art.I_hat @ A
            df = art.dF_hat - art.dI_hat @ A - art.I_hat @ dA
            r = P.mT @ f + b.tau
            dr = dP.mT @ f + P.mT @ df + b.dtau
            udot_k = art.M_inverse @ r  # Eq. 53, and the joint force
            dudot_k = art.dM_inverse @ r + art.M_inverse @ dr  # Eq. 55, first line
            A_bar[k] = A + P @ udot_k  # Eq. 54 with S^T
            dA_bar[k] = dA + dP @ udot_k + P @ dudot_k  # Eq. 55, second line, with S^T
            udot[rows], dudot[:, rows] = udot_k, dudot_k
        return Pair(udot, dudot)

    def _motion(self, state: State) -> list[Terms]:
        """The kinematic sweep (outward), Eqs. 12 to 29: one `Terms` a body, the ground's last (index -1)."""
        model, pairs = self.model, state.pairs
        bodies = [self._ground(pairs)] * (len(model.bodies) + 1)
        gravity = self._gravity(pairs)
        g, dg = gravity.value, gravity.tangent
        joint_forces = self._joint_forces(pairs)
        for k in model.outward:
            body = model.bodies[k]
            q_rows, u_rows = model.coordinate_slices[k]
            u, du = state.u[u_rows].value, state.u[u_rows].tangent
            pr = bodies[body.parent]

            # Geometry and inertia: local to the body, by pairs (the derivative primitives).
            joint = joint_terms(body, pairs, state.q[q_rows], state.u[u_rows])
            r = pairs.vector(body.com)  # from the joint's outboard side to k*
            s = pairs.vector(body.joint.at) - Pair(pr.com, pr.dcom)  # from Pr[k]* to the joint, in Pr[k]
            C_fixed = fixed_rotation(body, pairs)
            C_pair = C_fixed @ joint.R
            gamma_pair = C_pair.mT @ (s + C_fixed @ joint.d) + r
            lever = pairs.block([[pairs.constant(np.eye(3, dtype=int)), pairs.constant(np.zeros((3, 3), int))],
                                 [-pairs.skew(r), pairs.constant(np.eye(3, dtype=int))]])  # fmt: skip
            P_pair, Pdot_u = lever @ joint.P, lever @ joint.Pdot_u  # from the child's origin to its mass centre
            C, dC, gamma, dgamma = C_pair.value, C_pair.tangent, gamma_pair.value, gamma_pair.tangent
            P, dP = P_pair.value, P_pair.tangent
            S, dS = shift(C, dC, gamma, dgamma)
            I, dI = generalised_inertia(body, pairs)

            # Velocity: V_t is zero as no joint is prescribed (Eqs. 20, 25), so all of V is V_bar.
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
            A_t = S.mT @ pr.A_t + remainder  # Eq. 21
            dA_t = (  # Eq. 26
                dS.mT @ pr.A_t + S.mT @ pr.dA_t + np.concatenate([dangular, dlinear], axis=1) + Pdot_u.tangent
            )

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
            tau = joint_forces[k]
            bodies[k] = Terms(S, dS, P, dP, V, dV, A_t, dA_t, I, dI, F, dF, tau.value, tau.tangent,
                              N_C, dN_C, x, dx, r.value, r.tangent)  # fmt: skip
        return bodies

    def _closure(self, state: State) -> tuple[Pair, Pair]:
        raise NotImplementedError("the recursive engine has no loops yet")

    def _displacements(self, state: State) -> Array:
        raise NotImplementedError("the recursive engine has no loops yet")

    def _closed_speeds(self, state: State) -> Pair:
        raise NotImplementedError("the recursive engine has no loops yet")

    # --- other quantities of the same sweeps ----------------------------------------------------------------------

    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        """M udot - K, (nu, 1): Eqs. 19 outward, the balance of every body inward."""
        model, zeros = self.model, self.arithmetic.zeros
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
        return Pair(result, dresult)

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
        return Pair(M, dM)

    def _energies(self, state: State, motion: list[Terms]) -> tuple[Pair, Pair]:
        """Kinetic energy, the sum of V^T I V / 2, and potential energy, the sum of -m g^T x; (1, 1)."""
        gravity = self._gravity(state.pairs)
        g, dg = gravity.value, gravity.tangent
        T, dT, W, dW = 0 * (g.mT @ g), 0 * (dg.mT @ g), 0 * (g.mT @ g), 0 * (dg.mT @ g)
        for b in motion[:GROUND]:
            T = T + b.V.mT @ b.I @ b.V / 2
            dT = dT + b.V.mT @ b.dI @ b.V / 2 + b.V.mT @ b.I @ b.dV  # I is symmetric
            m, dm = b.I[5:, 5:], b.dI[:, 5:, 5:]
            W = W - m * (g.mT @ b.x)
            dW = dW - dm * (g.mT @ b.x) - m * (dg.mT @ b.x + g.mT @ b.dx)
        return Pair(T, dT), Pair(W, dW)

    def _point(self, motion: list[Terms], body: int, at: Pair) -> tuple[Pair, Pair]:
        """Position x + N_C r and velocity N_C (v + omega x r), r from the mass centre; (3, 1) in the ground frame."""
        b = motion[body]
        r, dr = at.value - b.com, at.tangent - b.dcom
        position, dposition = b.x + b.N_C @ r, b.dx + b.dN_C @ r + b.N_C @ dr
        v = b.V[3:] + skew(b.V[:3]) @ r
        dv = b.dV[:, 3:] + skew(b.dV[:, :3]) @ r + skew(b.V[:3]) @ dr
        return Pair(position, dposition), Pair(b.N_C @ v, b.dN_C @ v + b.N_C @ dv)

    def _coordinate_rates(self, state: State) -> Pair:
        """qdot = C(q) u, Eq. 1 with D = 0, (nq, 1)."""
        pairs, rates = state.pairs, []
        for body, (q_rows, u_rows) in zip(self.model.bodies, self.model.coordinate_slices, strict=True):
            q, u = state.q[q_rows], state.u[u_rows]
            if body.joint.type == "spherical":
                rates.append(quaternion_rate_matrix(pairs, q) @ u)
            elif body.joint.type == "free":
                rates.append(quaternion_rotation(pairs, q[3:]) @ u[3:])
                rates.append(quaternion_rate_matrix(pairs, q[3:]) @ u[:3])
            else:
                rates.append(u)  # Eq. 11
        return pairs.block([[x] for x in rates]) if rates else state.q

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

    def _joint_forces(self, pairs: Pairs) -> list[Pair]:
        """The model's forces on the joints' speeds, (f, 1) a body."""
        tau = [pairs.constant(np.zeros((u.stop - u.start, 1), int)) for _, u in self.model.coordinate_slices]
        for force in self.model.forces:
            tau[force.body] = tau[force.body] + pairs.vector(force.values)
        return tau

    def _inverse(self, k: int, M: Array, M_locked: Array) -> Array:
        """The inverse of M_k, (f, f); a body without inertia about its joint is named."""
        try:
            return self.arithmetic.inverse(M, [M_locked[i, i] for i in range(len(M))])
        except SingularMatrixError as error:
            body = self.model.bodies[k]
            raise SingularMatrixError(
                f"body {body.name}: nothing that its {body.joint.type} joint moves has inertia against it ({error})"
            ) from None


# --- geometry and inertia: the derivative primitives ---------------------------------------------------------------


def shift(C: Array, dC: Array, gamma: Array, dgamma: Array) -> tuple[Array, Array]:
    """S^k and its total derivative, (6, 6) and (k, 6, 6); gamma in components of k, as C gamma x asks."""
    S = np.block([[C, C @ skew(gamma)], [0 * C, C]])  # Eq. 22
    dS = np.block([[dC, dC @ skew(gamma) + C @ skew(dgamma)], [0 * dC, dC]])  # Eq. 28
    return S, dS


def generalised_inertia(body: Body, pairs: Pairs) -> tuple[Array, Array]:
    """I^k about the mass centre in body axes, and its total derivative, (6, 6) and (k, 6, 6)."""
    xx, yy, zz, xy, xz, yz = (pairs.expression(e) for e in body.inertia)
    central = pairs.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = pairs.constant(np.eye(3, dtype=int)) * pairs.expression(body.mass)
    zero = pairs.constant(np.zeros((3, 3), int))
    I = pairs.block([[central, zero], [zero, mass]])
    return I.value, I.tangent


def axis_rotation(pairs: Pairs, axis: Pair, angle: Pair) -> Pair:
    """Rotation about a unit axis (Euler and Rodrigues): U + sin(angle) a x + (1 - cos(angle)) a x a x, (3, 3)."""
    a = pairs.skew(axis)
    sine, versine = pairs.call("sin", angle), pairs.number(1) - pairs.call("cos", angle)
    return pairs.constant(np.eye(3, dtype=int)) + a * sine + (a @ a) * versine


def quaternion_rotation(pairs: Pairs, e: Pair) -> Pair:
    """Rotation of e/abs(e), e = (w, v): U + 2 (w v x + v x v x)/abs(e)^2, (3, 3)."""
    v, two = pairs.skew(e[1:]), pairs.number(2)
    return pairs.constant(np.eye(3, dtype=int)) + (v * e[0, 0] + v @ v) * (two / pairs.dot(e, e))


def quaternion_rate_matrix(pairs: Pairs, e: Pair) -> Pair:
    """The matrix that turns child components of the angular velocity into edot = e (0, omega)/2, (4, 3)."""
    w, x, y, z = (e[i, 0] for i in range(4))
    return pairs.matrix([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) * (pairs.number(1) / pairs.number(2))


def fixed_rotation(body: Body, pairs: Pairs) -> Pair:
    """Joint frame components into parent components, (3, 3)."""
    C = pairs.constant(np.eye(3, dtype=int))
    for axis, angle in body.joint.rotation:
        C = C @ axis_rotation(pairs, pairs.unit(pairs.vector(axis)), pairs.expression(angle))
    return C


def joint_terms(body: Body, pairs: Pairs, q: Pair, u: Pair) -> JointTerms:
    """The joint's own kinematics at q (c, 1) and u (f, 1); see `JointTerms`."""
    U, zero = pairs.constant(np.eye(3, dtype=int)), pairs.constant(np.zeros((3, 1), int))
    still = pairs.constant(np.zeros((6, 1), int))
    axes = [pairs.unit(pairs.vector(axis)) for axis in body.joint.axes]
    if body.joint.type == "fixed":
        return JointTerms(U, zero, pairs.constant(np.zeros((6, 0), int)), still)
    if body.joint.type == "revolute":
        (a,) = axes  # the same components on both sides of the joint
        return JointTerms(axis_rotation(pairs, a, q[0, 0]), zero, pairs.block([[a], [zero]]), still)
    if body.joint.type == "prismatic":
        (a,) = axes
        return JointTerms(U, a * q[0, 0], pairs.block([[zero], [a]]), still)
    if body.joint.type == "universal":
        a, b = axes
        R1, R2 = axis_rotation(pairs, a, q[0, 0]), axis_rotation(pairs, b, q[1, 0])
        first = R2.mT @ a  # the first axis seen from the child, which turns about b: its rate is -b x first u_2
        rate = (-(pairs.skew(b) @ first)) * u[1, 0]
        P = pairs.block([[first, b], [zero, zero]])
        return JointTerms(R1 @ R2, zero, P, pairs.block([[rate * u[0, 0]], [zero]]))
    if body.joint.type == "spherical":
        P = pairs.constant(np.eye(6, 3, dtype=int))
        return JointTerms(quaternion_rotation(pairs, q), zero, P, still)
    if body.joint.type == "free":
        return JointTerms(quaternion_rotation(pairs, q[3:]), q[:3], pairs.constant(np.eye(6, dtype=int)), still)
    raise ValueError(f"body {body.name}: joint type {body.joint.type!r} is not known to the reference engines")
