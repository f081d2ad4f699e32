"""Couplings of coordinates in the recursive engine: conditions on motions of bodies relative to their parents.

The speed of a joint follows from the motion of its body relative to the parent, ``V_k - S^T V_pr = P u`` (Eq. 18). With p the row
of a left inverse of P for this speed, ``u_i = p (V_k - S^T V_pr)``, and the coupling requires ``sum of factor u_i = 0``. The same
row applies to displacements and accelerations, after subtracting the contributions of parameters and remainders, which are not
motions of the joint. So a coupling needs no lever arm and no cut; its bodies are the members of its ear (of the ear decomposition
of the loop graph).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..model.model import GROUND, Coupling, Model
from .arithmetic import Array
from .pairs import Pair, Pairs
from .terms import Terms


@dataclass(slots=True)
class CoupledTerm:
    """A coordinate of a coupling, with its factor and the row that gives its speed.

    Attributes
    ----------
    body, parent : int
    q, u : int
        Indices of the coordinate and its speed.
    factor : Pair
        A number.
    K : Pair
        Row (1, 6), times the factor, that is applied to a motion of the body relative to its parent.
    S : Pair
        The body's shift, (6, 6).
    """

    body: int
    parent: int
    q: int
    u: int
    factor: Pair
    K: Pair
    S: Pair


class CoupledCut:
    """A coupling at a state; replaces a `Cut`.

    Attributes
    ----------
    kept : array of int
        Index of the coupling's condition.
    """

    def __init__(self, pairs: Pairs, model: Model, loop: Coupling, bodies: Sequence[Terms]) -> None:
        self.kept = np.array([0])
        self.offset = pairs.expression(loop.offset)
        self.terms: list[CoupledTerm] = []
        for term in loop.terms:
            q, u = (place.start for place in model.coordinate_slices[term.body])
            P, factor = bodies[term.body].P, pairs.expression(term.factor)
            row = coordinate_row(pairs, P, term.index)
            self.terms.append(
                CoupledTerm(
                    term.body, model.bodies[term.body].parent, q + term.index, u + term.index, factor, row * factor,
                    bodies[term.body].S,
                )
            )  # fmt: skip

    def of_motion(self, pairs: Pairs, motion: Mapping[int, Pair], columns: int) -> Pair:
        """The condition for motions (6, columns) of mass centres; bodies that are not listed do not move."""
        total = pairs.zeros(1, columns)
        for term in self.terms:
            if term.body in motion:
                total = total + term.K @ motion[term.body]
            if term.parent in motion and term.parent != GROUND:
                total = total - term.K @ term.S.mT @ motion[term.parent]
        return total

    def of_coordinates(self, pairs: Pairs, x: Pair) -> Pair:
        """The sum of factor x, (1, 1), for values x of the speeds, (nu, 1)."""
        total = pairs.constant([[0]])
        for term in self.terms:
            total = total + x[term.u : term.u + 1] * term.factor
        return total

    def residual(self, pairs: Pairs, q: Pair) -> Pair:
        """The residual of the coupling at coordinates (nq, 1), (1, 1)."""
        total = -pairs.matrix([[self.offset]])
        for term in self.terms:
            total = total + q[term.q : term.q + 1] * term.factor
        return total

    def besides(self, pairs: Pairs, q: Pair, own: Sequence[Pair]) -> Pair:
        """The residual of the condition minus the part due to displacements of the bodies, (1, 1): a pair without
        value.

        `own` are displacements of the bodies relative to their parents; part of them is due to parameters, not to the joints.
        """
        residual = self.residual(pairs, q)
        total = Pair(0 * residual.value, residual.tangent)
        for term in self.terms:
            total = total - term.K @ own[term.body]
        return total


def coordinate_row(pairs: Pairs, P: Pair, index: int) -> Pair:
    """The row p, (1, 6), for which ``p P`` is one for a coordinate and zero for the joint's other coordinates; P (6, f)
    are partial velocities."""
    G, unit = P.mT @ P, np.eye(P.value.shape[1], dtype=int)[:, [index]]
    y: Array = pairs.arithmetic.solve(G.value, pairs.arithmetic.array(unit))
    columns = [pairs.arithmetic.solve(G.value, -dG @ y) for dG in G.tangent]
    tangent = np.stack(columns) if columns else pairs.arithmetic.zeros(0, *y.shape)
    return Pair(y, tangent).mT @ P.mT
