"""Embedding and triangularization with loops, Eqs. 39 to 60: inertias and forces of ears are propagated inward, udot outward.

The accelerations A_j of a group's members (see `ears`) depend on the accelerations A_x of the group's ends, and on the
accelerations y of its independent speeds. With z = (A_x ..., y, 1)

    A_j = H_j z,    H_j = [ Gamma_j^x ... | N_j | Xi_j A_t ]          (Eq. 31; the dependent udot are Y z)

In the group's part of the Gibbs function, 1/2 A_j^T I_j A_j + A_i^T Q_ij A_j - A_j^T F_j - tau^T udot, body j has the articulated
inertia I_j and force F_j, and pairs of bodies may be coupled. As a function of z it has the coefficients

    Z = sum H_j^T I_j H_j + H_i^T Q_ij H_j,        f = sum H_j^T F_j + Y^T tau_dependent + tau_independent      (Eqs. 39-41)

the virtual body p_i of the paper. y is eliminated from it at once (D = Z_yy is M_k of Eq. 47). The remaining terms are added to
the ends: inertias and forces of each end, and couplings between ends, I^{p_i;o_i} of the paper. If members are coupled to a body
i of an earlier group, because an ear ends on both, this coupling is propagated in the same way. For a single body of the
tree H = [S^T | P | 0], and these are Eqs. 44 to 47.

All accelerations are the parts A_bar explicit in udot. The acceleration of the ground is zero (Eq. 56), so the ground
needs no terms.

Misprints of the paper: Eqs. 39 and 40 have their left-hand sides exchanged relative to their use in Eqs. 42 to 49. The
sum with two Gammas continues in Eq. 44, the one with the shift to 0_i in Eq. 43. In Eq. 41 the Xi term is a force and
enters with the minus of -I A_t, with the sign of F in Eq. 53. Eqs. 42 to 60 use the relative o_i A_bar; A_x is used
here instead, so that base and branch are treated in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..model.model import Model
from .arithmetic import Array, SingularMatrixError
from .closure import EarClosure, selection
from .ears import Group
from .pairs import Pair, Pairs
from .terms import Terms


class Places:
    """Columns of z: six for each end, one for each independent acceleration y, and one for the constant 1."""

    def __init__(self, group: Group) -> None:
        self.ends = {x: slice(6 * i, 6 * i + 6) for i, x in enumerate(group.ends)}
        first = 6 * len(group.ends)
        self.y = slice(first, first + len(group.independent))
        self.one = slice(self.y.stop, self.y.stop + 1)
        self.size = self.one.stop


@dataclass(slots=True)
class Eliminated:
    """Data for the back substitution of a group: y = D^-1 (r - sum h_x^T A_x) over the bodies x in ``h``."""

    H: dict[int, Pair]
    Y: Pair
    D_inverse: Pair
    r: Pair
    h: dict[int, Pair]


def embed(
    model: Model,
    groups: Sequence[Group],
    closures: Sequence[EarClosure],
    bodies: Sequence[Terms],
    remainders: Sequence[Pair],
    rotors: Pair,
    pairs: Pairs,
) -> Pair:
    """The accelerations udot, (nu, 1), of a model with loops.

    Parameters
    ----------
    remainders : sequence of Pair
        By loop, the kept conditions of the accelerations at udot = 0, (m, 1).
    rotors : Pair
        Reflected inertia of the rotors by speed, (nu, 1).
    """
    inward = _Inward(model, bodies, rotors, pairs)
    eliminated = [
        inward.eliminate(group, ear, remainders)
        for group, ear in zip(reversed(groups), reversed(closures), strict=True)
    ]
    return back_substitution(model, groups, eliminated[::-1], pairs)


class _Inward:
    """The triangularization sweep, with the current articulated inertias and forces, and the couplings between bodies."""

    def __init__(self, model: Model, bodies: Sequence[Terms], rotors: Pair, pairs: Pairs) -> None:
        n = len(model.bodies)
        self.model, self.bodies, self.rotors, self.pairs = model, bodies, rotors, pairs
        self.I_hat = [bodies[k].I for k in range(n)]
        self.F_hat = [bodies[k].F for k in range(n)]
        self.I_locked = [bodies[k].I.value for k in range(n)]  # I_hat with all joints locked: the scale of D
        self.Q: dict[int, dict[int, Pair]] = {k: {} for k in range(n)}  # Q[i][j] = Q[j][i]^T, the couplings

    def eliminate(self, group: Group, ear: EarClosure, remainders: Sequence[Pair]) -> Eliminated:
        """Eliminate a group: Eqs. 39 to 52 and the couplings C(k)."""
        z = Places(group)
        H, Y = motion_of_members(self.model, group, z, ear, self.bodies, remainders, self.pairs)
        Z, f, outside = self._share(group, z, H, Y)

        D, r = Z[z.y, z.y], f[z.y]  # Eq. 47
        D_inverse = self._inverse(group, z, H, Y, D)
        h = {x: Z[place, z.y] for x, place in z.ends.items()} | {i: R[:, z.y] for i, R in outside.items()}

        # the contribution of the group to its ends, and to other bodies to which its members were coupled ...
        for x, place in z.ends.items():
            self.I_hat[x] = self.I_hat[x] + Z[place, place]
            self.F_hat[x] = self.F_hat[x] + f[place]
        for x, other in combinations(z.ends, 2):
            self._couple(x, other, Z[z.ends[x], z.ends[other]])
        for i, R in outside.items():
            self.F_hat[i] = self.F_hat[i] - R[:, z.one]
            for x, place in z.ends.items():
                self._couple(i, x, R[:, place])
        # ... minus the part that y removes
        T = {x: h_x @ D_inverse for x, h_x in h.items()}
        for x in h:
            self.I_hat[x] = self.I_hat[x] - T[x] @ h[x].mT  # Eq. 44
            self.F_hat[x] = self.F_hat[x] - T[x] @ r  # Eq. 45
        for x, other in combinations(h, 2):
            self._couple(x, other, -(T[x] @ h[other].mT))  # Eq. 43
        self._forget(group, z, H)
        return Eliminated(H, Y, D_inverse, r, h)

    def _share(self, group: Group, z: Places, H: dict[int, Pair], Y: Pair) -> tuple[Pair, Pair, dict[int, Pair]]:
        """The group's Gibbs function z^T Z z / 2 - f^T z, and its couplings to other bodies: A_i^T (outside[i]) z."""
        pairs = self.pairs
        Z, f = pairs.zeros(z.size, z.size), pairs.zeros(z.size, 1)
        outside: dict[int, Pair] = {}
        for j in group.members:
            Z = Z + H[j].mT @ self.I_hat[j] @ H[j]  # Eqs. 39 and 40
            f = f + H[j].mT @ self.F_hat[j]  # Eq. 41; the second sum in it is the last column of Z
            for i, Q_ji in self.Q[j].items():
                if i in H:
                    Z = Z + H[j].mT @ Q_ji @ H[i]
                else:
                    outside[i] = outside.get(i, pairs.zeros(6, z.size)) + Q_ji.mT @ H[j]
            tau = self.bodies[j].tau
            f = f + Y.mT @ selection(pairs, self.model, j, group.dependent).mT @ tau
            _add(f, z.y, slice(0, 1), selection(pairs, self.model, j, group.independent).mT @ tau)
        # rotors act on the speeds of their joints: Y^T a Y for dependent speeds, with remainders, and a for independent
        # speeds
        of_dependent, of_independent = (
            pairs.diagonal(self.rotors[np.array(of, dtype=int)]) for of in (group.dependent, group.independent)
        )
        Z = Z + Y.mT @ of_dependent @ Y
        _add(Z, z.y, z.y, of_independent)
        for x, place in z.ends.items():
            if x in outside:  # couplings of members to an end in z: a block of Z, and its transpose
                R = outside.pop(x)
                _add(Z, place, slice(None), R)
                _add(Z, slice(None), place, R.mT)
        return Z, f - Z[:, z.one], outside

    def _forget(self, group: Group, z: Places, H: dict[int, Pair]) -> None:
        """Remove the couplings of the members, and propagate their inertia with all joints locked."""
        for j in group.members:
            for i in self.Q.pop(j):
                if i in self.Q:
                    del self.Q[i][j]
            for x, place in z.ends.items():
                Gamma = H[j].value[:, place]
                self.I_locked[x] = self.I_locked[x] + Gamma.mT @ self.I_locked[j] @ Gamma

    def _couple(self, i: int, j: int, Q_ij: Pair) -> None:
        for a, b, block in ((i, j, Q_ij), (j, i, Q_ij.mT)):
            known = self.Q[a].get(b)
            self.Q[a][b] = block if known is None else known + block

    def _inverse(self, group: Group, z: Places, H: dict[int, Pair], Y: Pair, D: Pair) -> Pair:
        """D^-1 and its derivative, Eq. 52 with the missing minus; an error names the speeds that move no inertia."""
        scale = 0 * D.value
        for j in group.members:
            N = H[j].value[:, z.y]
            scale = scale + N.mT @ self.I_locked[j] @ N
        rates = Y.value[:, z.y]
        scale = scale + rates.mT @ (self.rotors[np.array(group.dependent, dtype=int)].value * rates)
        scale = scale + self.pairs.diagonal(self.rotors[np.array(group.independent, dtype=int)]).value
        try:
            inverse = self.pairs.arithmetic.inverse(D.value, [scale[i, i] for i in range(len(scale))])
        except SingularMatrixError as error:
            names = ", ".join(self.model.speed_names[i] for i in group.independent)
            raise SingularMatrixError(f"nothing that {names} moves has inertia against it ({error})") from None
        return Pair(inverse, -inverse @ D.tangent @ inverse)


def motion_of_members(
    model: Model,
    group: Group,
    z: Places,
    ear: EarClosure,
    bodies: Sequence[Terms],
    remainders: Sequence[Pair],
    pairs: Pairs,
) -> tuple[dict[int, Pair], Pair]:
    """H of every member, (6, n), and Y, (r, n): A_bar = H z, dependent udot = Y z."""
    motion = {x: pairs.constant(np.eye(6, z.size, place.start, dtype=int)) for x, place in z.ends.items()}
    for j in group.members:
        parent = model.bodies[j].parent
        own = pairs.zeros(6, z.size)
        _add(own, slice(None), z.y, bodies[j].P @ selection(pairs, model, j, group.independent))
        motion[j] = bodies[j].S.mT @ motion[parent] + own if parent in motion else own  # Eq. 19
    Y = pairs.zeros(len(group.dependent), z.size)
    if group.dependent:
        b = ear.conditions(motion)
        _add(b, slice(None), z.one, pairs.block([[remainders[i]] for i in group.loops]))
        Y = ear.solve(b)
    return {j: motion[j] + ear.G[j] @ Y for j in group.members}, Y  # Eqs. 31, 37, 38


def back_substitution(model: Model, groups: Sequence[Group], eliminated: Sequence[Eliminated], pairs: Pairs) -> Pair:
    """The accelerations udot, (nu, 1), computed by the outward sweep of Eqs. 53 to 60."""
    udot = pairs.zeros(model.nu, 1)
    A_bar: dict[int, Pair] = {}
    for group, e in zip(groups, eliminated, strict=True):
        r = e.r
        for x, h in e.h.items():
            r = r - h.mT @ A_bar[x]
        y = e.D_inverse @ r  # Eqs. 53 and 57
        z = pairs.block([*([A_bar[x]] for x in group.ends), [y], [pairs.constant([[1]])]])
        for j in group.members:
            A_bar[j] = e.H[j] @ z  # Eqs. 54 and 58; Eq. 31
        for speeds, values in ((group.independent, y), (group.dependent, e.Y @ z)):
            _add(udot, np.array(speeds, dtype=int), slice(0, 1), values)
    return udot


def _add(matrix: Pair, rows: slice | Array, columns: slice, block: Pair) -> None:
    """Add a block to a matrix in place: matrix[rows, columns] += block."""
    matrix.value[rows, columns] += block.value
    matrix.tangent[:, rows, columns] += block.tangent
