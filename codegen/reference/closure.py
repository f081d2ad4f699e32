"""Recursive closure of loops, Eqs. 30 to 38: dependent speeds from the motion of the bodies on which an ear ends.

Loop joints. The motions of the two bodies of a loop are shifted to the cut, which is the origin of the end face. The end face may
move relative to the start face only along the degrees of freedom d_i of the joint:

    V_end - V_start = sum of d_i x_i, A_end - A_start = sum of d_i xdot_i + (terms of the moving axes)

The rows of a cut are the orthogonal complement of these degrees of freedom, so multiplication by them removes x. A revolute joint
in a planar mechanism leaves 2 relevant rows, a spherical joint 3, a Hooke joint 4. `K_start` and `K_end` shift and project in one
step.

Ears (of the ear decomposition of the loop graph). With G_j the partial velocities of member j for the ear's dependent speeds x,
and V_j^0 its velocity at x = 0,

    V_j = V_j^0 + G_j x,      E x = b,      E = sum K_start G_start - K_end G_end,   b = K_end V_end^0 - K_start V_start^0

and the same E serves displacements (dq from the seeds), velocities and accelerations. The paper solves this system by sequential
orthogonal projection: tau of Eq. 33 is the projector onto the motions that earlier joints leave free, Delta of Eq. 34 the squared
pivot, chi of Eq. 35 the row of the inverse. The second Delta, of Eq. 36, propagates Gamma and Xi from body to body, Eqs. 37 and
38. Two misprints: Delta is used for a scalar and for a 6x6 map, and tau^k on the right of Eq. 33 must be tau^{k+1}, on both sides
of the rank-one term. Here the same projection is done with pivoting and repeated once (`LeftInverse`), for joints on both
branches and several loops at a time. E may have more rows than columns: on consistent motion, any left inverse gives the
solution.

Angular conditions are sums of w c . d = 0, with c fixed in the end body and d in the start body: a_e . n for revolute joints,
antisymmetric parts of the relative rotation if it is fully constrained. Their rows, sums of w c x d, and their acceleration terms
hold even if the loop is open in other conditions.

Derivatives. E dx = db - dE x is solved with the left inverse at the state. This differentiates a mechanism that satisfies, ear by
ear, the combinations of conditions that its dependent speeds can satisfy here (docs, 4.7). On consistent seeds, they are
equivalent to all conditions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from ..model.model import GROUND, Loop, Model
from .arithmetic import Array, LeftInverse, SingularMatrixError
from .couplings import CoupledCut
from .ears import Group
from .pairs import Pair, Pairs
from .primitives import condition_frame, placed_rotation, residuals_of_turn
from .surfaces import at, surface_at
from .terms import Terms

Turning = list[tuple[Any, Pair, Pair]]
"""An angular condition: weights w and directions c (end) and d (start), (3, 1), of its terms w c . d = 0."""


@dataclass(slots=True)
class Cut:
    """A loop joint at a state; components in the start body's axes.

    Attributes
    ----------
    rows : Pair
        The complement of the degrees of freedom, (m, 6), at the end face's origin. Linear conditions come first, divided by the
        characteristic length, in the order of `closure_row_names`.
    kept : array of int
        Indices of the conditions that are not dropped.
    turning : list of Turning
        The angular conditions.
    frame : Pair
        Directions of the conditions, (3, 3).
    K_start, K_end : Pair
        Conditions applied to a motion of the start or end body's mass centre, in the axes of this body, (m, 6).
    arm_start, arm_end : Pair
        From the mass centres to the end face's origin, (3, 1), m.
    offset : Pair
        From the start face's origin to the end face's, (3, 1), m.
    C : Pair
        Rotates components in the end body to components in the start body, (3, 3).
    surfaces : list of (Pair, Pair, Pair)
        For a condition on a point, in the scale of its row: the function (1, 1), its second derivatives along the start body's
        axes (3, 3), and its explicit derivatives with respect to parameters, a pair without value (1, 1).
    """

    rows: Pair
    kept: Array
    turning: list[Turning]
    frame: Pair
    K_start: Pair
    K_end: Pair
    arm_start: Pair
    arm_end: Pair
    offset: Pair
    C: Pair
    surfaces: list[tuple[Pair, Pair, Pair]]

    def remainder(self, pairs: Pairs, start: Terms, end: Terms) -> Pair:
        """The kept conditions of the accelerations at udot = 0, (m, 1): A_t of Eq. 31, and terms of the moving axes."""
        V_s, V_e = start.V, end.V
        w_s, w_e = V_s[:3], self.C @ V_e[:3]
        wx_s, wx_e = pairs.skew(w_s), pairs.skew(w_e)
        w = w_e - w_s  # relative motion of the end face, with v the velocity of its origin
        v = (self.C @ V_e[3:] + wx_e @ self.arm_end) - (V_s[3:] + wx_s @ self.arm_start)
        linear = wx_e @ wx_e @ self.arm_end - wx_s @ wx_s @ self.arm_start - wx_s @ (v + v)
        moving_axes = self.rows @ pairs.block([[-(wx_s @ w)], [linear]])
        # c rotates with the end: the term ((w x c) x d) . w, and the term of the start's rotation
        turned = [pairs.constant(np.zeros((len(self.rows.value) - len(self.turning), 1), int))]
        for terms in self.turning:
            rate = pairs.constant([[0]])
            for weight, c, d in terms:
                rate = rate + (pairs.skew(pairs.skew(w) @ c) @ d).mT @ w * pairs.number(weight)
            turned.append(rate)
        if self.surfaces:
            turned = [v.mT @ hessian @ v for _, hessian, _ in self.surfaces]
        total = self.K_end @ end.A_t - self.K_start @ start.A_t + moving_axes
        return (total + pairs.block([[x] for x in turned]))[self.kept]

    def position_residual(self, pairs: Pairs, loop: Loop) -> Pair:
        """Residuals of position closure, (m, 1), in the order and scale of the rows.

        Angular residuals are 2 sin(t/2) along the rows, where t is the remaining rotation. For universal joints, the
        residual is the cosine between the axes.
        """
        if self.surfaces:
            return pairs.block([[value] for value, _, _ in self.surfaces])
        linear = self.rows[: loop.closure.linear, 3:] @ self.offset
        if not self.turning:
            return linear
        R_s, R_e = placed_rotation(loop.start, pairs), self.C @ placed_rotation(loop.end, pairs)
        turned = residuals_of_turn(pairs, loop, self.frame.mT @ R_s, R_s, R_e, self.sines(pairs))
        return pairs.block([[linear], *([x] for x in turned)])

    def sines(self, pairs: Pairs) -> list[Pair]:
        """The angular conditions, sums of c . d, (1, 1) each."""
        return [reduce(add, ((c.mT @ d) * pairs.number(w) for w, c, d in terms)) for terms in self.turning]

    def displacement_of_faces(
        self, pairs: Pairs, loop: Loop, defaults: dict[str, float], start: Terms, end: Terms
    ) -> Pair:
        """The kept conditions for displacements of the faces in their bodies due to parameters, (m, 1): a pair without
        value.

        A face rotates with its joint's axis, which may depend on parameters; points off the face's origin then also
        move.
        """
        axes = loop.axes or (None,)
        moved = []
        for face, axis, body in ((loop.start, axes[0], start), (loop.end, axes[-1], end)):
            R = placed_rotation(face, pairs)
            if axis is not None:
                R = R @ condition_frame(pairs, axis, defaults)[1]
            moved.append((rotation_only(R), shift_only(pairs.vector(face.at) - body.com)))
        (turn_s, shift_s), (turn_e, shift_e) = moved
        angular = self.C @ turn_e - turn_s
        linear = self.C @ shift_e - shift_s + pairs.skew(self.offset) @ turn_s
        total = self.rows @ pairs.block([[angular], [linear]])
        if self.surfaces:
            total = total + pairs.block([[by_parameters] for _, _, by_parameters in self.surfaces])
        return total[self.kept]


def cut(
    pairs: Pairs,
    loop: Loop,
    length: float,
    start: Terms,
    end: Terms,
    defaults: dict[str, float],
    dropped: Collection[int],
) -> Cut:
    """The cut of the loop joint between two bodies; `dropped` contains the indices of its dropped conditions."""
    U, zero = pairs.eye(3), pairs.zeros(3, 3)
    C = start.N_C.mT @ end.N_C
    arm_end = C @ (pairs.vector(loop.end.at) - end.com)
    arm_start = start.N_C.mT @ (end.x - start.x) + arm_end
    offset = arm_start - (pairs.vector(loop.start.at) - start.com)

    # Directions of the conditions, with the joint's axis as one of the columns: fixed in the start face, and in the end face.
    i, end_i, frame, end_frame = 2, 2, U, U
    if loop.axes:
        i, frame = condition_frame(pairs, loop.axes[0], defaults)
        end_i, end_frame = condition_frame(pairs, loop.axes[-1], defaults)
    frame, end_frame = placed_rotation(loop.start, pairs) @ frame, C @ placed_rotation(loop.end, pairs) @ end_frame
    s, e = ([axes[:, j : j + 1] for j in range(3)] for axes in (frame, end_frame))
    j, k = (i + 1) % 3, (i + 2) % 3
    scale, none = pairs.number(1) / pairs.number(length), pairs.zeros(1, 3)
    linear: list[Pair] = {0: [], 1: [s[i]], 2: [s[j], s[k]], 3: s}[loop.closure.linear]
    surfaces: list[tuple[Pair, Pair, Pair]] = []
    if loop.surfaces:
        linear, surfaces = _on_surfaces(pairs, loop, scale, frame, offset)
    turning: list[Turning] = []
    if loop.closure.angular == 1:
        turning = [[(1, e[end_i], s[i])]]
    elif loop.closure.angular == 2:
        turning = [[(-1, e[i], s[k])], [(1, e[i], s[j])]]
    elif loop.closure.angular == 3:
        half = pairs.arithmetic.number(1) / 2
        turning = [[(half, e[n - 2], s[n - 1]), (-half, e[n - 1], s[n - 2])] for n in range(3)]
    angular = []
    for terms in turning:
        total = none
        for weight, c, d in terms:
            total = total + (pairs.skew(c) @ d).mT * pairs.number(weight)
        angular.append([total, none])
    rows = pairs.block([*([none, n.mT * scale] for n in linear), *angular])
    return Cut(
        rows,
        np.array([n for n in range(len(rows.value)) if n not in dropped], dtype=int),
        turning,
        frame,
        rows @ pairs.block([[U, zero], [-pairs.skew(arm_start), U]]),
        rows @ pairs.block([[C, zero], [-pairs.skew(arm_end) @ C, C]]),
        arm_start,
        arm_end,
        offset,
        C,
        surfaces,
    )


def _on_surfaces(
    pairs: Pairs, loop: Loop, scale: Pair, F: Pair, offset: Pair
) -> tuple[list[Pair], list[tuple[Pair, Pair, Pair]]]:
    """Unit normals, and the entries of `Cut.surfaces`, of a condition on a point in a face with axes F of the start body."""
    place = F.mT @ offset
    normals, found = [], []
    for function in loop.surfaces:
        f = surface_at(pairs, function, place)
        share = pairs.number(1) / pairs.call("sqrt", pairs.dot(f.gradient, f.gradient))
        normals.append(F @ f.gradient * share)
        size = share * scale
        held = at(pairs, Pair(place.value, 0 * place.tangent)).expression(function.value)
        by_parameters = shift_only(pairs.matrix([[held]]) * Pair(size.value, 0 * size.tangent))
        found.append((f.value * size, F @ f.hessian @ F.mT * size, by_parameters))
    return normals, found


AnyCut = Cut | CoupledCut


class EarClosure:
    """The closure of one group at a position: E with its left inverse, and the motion due to the dependent speeds.

    Attributes
    ----------
    G : dict of int to Pair
        For each member the partial velocities of its mass centre for the group's dependent speeds, (6, r).
    """

    def __init__(
        self, model: Model, group: Group, pairs: Pairs, bodies: Sequence[Terms], cuts: Sequence[AnyCut]
    ) -> None:
        self._model, self._group, self._bodies = model, group, bodies
        self._loops = [(model.loops[i], cuts[i]) for i in group.loops]
        self.pairs = pairs
        self.G = self.partial_velocities(group.dependent)
        if not group.dependent:
            return
        self.E = -self.conditions(self.G)
        try:
            self._inverse = LeftInverse(pairs.arithmetic, self.E.value)
        except SingularMatrixError as error:
            loops, speeds = ([x.name for x in model.loops], model.speed_names)
            raise SingularMatrixError(
                f"loop {', '.join(loops[i] for i in group.loops)}: the closure does not"
                f" determine the speeds {', '.join(speeds[i] for i in group.dependent)} at this state: {error}"
            ) from None

    def partial_velocities(self, speeds: Sequence[int]) -> dict[int, Pair]:
        """Partial velocities of the members' mass centres for some of the members' speeds, (6, len(speeds)) each."""
        G: dict[int, Pair] = {}
        for j in self._group.members:
            own = self._bodies[j].P @ selection(self.pairs, self._model, j, speeds)
            carried = G.get(self._model.bodies[j].parent)
            G[j] = own if carried is None else self._bodies[j].S.mT @ carried + own
        return G

    def conditions(self, motion: Mapping[int, Pair]) -> Pair:
        """The kept conditions of all loops, one loop below the other: ``K_end M_end - K_start M_start``.

        `motion` has the motions M (6, c) of mass centres; bodies without an entry do not move.
        """
        (still,) = {x.value.shape[1] for x in motion.values()} or {1}
        rows = []
        for loop, joint in self._loops:
            if isinstance(joint, CoupledCut):
                rows.append([joint.of_motion(self.pairs, motion, still)])
                continue
            start, end = loop.start.body, loop.end.body
            total = self.pairs.zeros(len(joint.kept), still)
            if end in motion:
                total = total + joint.K_end[joint.kept] @ motion[end]
            if start in motion:
                total = total - joint.K_start[joint.kept] @ motion[start]
            rows.append([total])
        return self.pairs.block(rows)

    def solve(self, b: Pair) -> Pair:
        """x of E x = b, (r, c), with E dx = db - dE x."""
        x = self._inverse(b.value)
        return Pair(x, self._inverse(b.tangent - self.E.tangent @ x))


def with_best_dependents(
    model: Model, group: Group, pairs: Pairs, bodies: Sequence[Terms], cuts: Sequence[AnyCut]
) -> Group:
    """The group with the dependent speeds that have the largest pivots here.

    The state is completed with the dependent speeds of the partition. Accelerations do not depend on which joints of a group are
    solved for, so a poor choice, such as one in which inertias of 1e6 cancel, can be avoided.
    """
    if not group.dependent or not group.independent:
        return group
    speeds = (*group.dependent, *group.independent)
    every = EarClosure(model, replace(group, dependent=(), independent=speeds), pairs, bodies, cuts)
    G = every.partial_velocities(speeds)
    pivots, _ = pairs.arithmetic.independent_rows(every.conditions(G).value.T)
    best = {speeds[i] for i in pivots[: len(group.dependent)]}
    return replace(
        group,
        dependent=tuple(i for i in sorted(speeds) if i in best),
        independent=tuple(i for i in sorted(speeds) if i not in best),
    )


def closed_motion(
    model: Model,
    groups: Sequence[Group],
    pairs: Pairs,
    bodies: Sequence[Terms],
    cuts: Sequence[AnyCut],
    own: Sequence[Pair],
    of_faces: Sequence[Pair],
) -> Pair:
    """The dependent speeds (or displacements, which correspond to speeds) that close all loops, (nu, 1); entries of
    independent speeds are zero.

    Parameters
    ----------
    own : sequence of Pair
        For each body, the motion of its mass centre relative to the parent with dependent joints at rest, (6, 1).
    of_faces : sequence of Pair
        By loop, the displacements of its faces in their bodies, as kept conditions (m, 1).
    """
    result = pairs.zeros(model.nu, 1)
    motion: dict[int, Pair] = {}
    for group in groups:
        ear = EarClosure(model, group, pairs, bodies, cuts)
        for j in group.members:
            parent = model.bodies[j].parent
            motion[j] = own[j] if parent == GROUND else bodies[j].S.mT @ motion[parent] + own[j]  # Eq. 18
        if group.dependent:
            x = ear.solve(ear.conditions(motion) + pairs.block([[of_faces[i]] for i in group.loops]))
            index = np.array(group.dependent)
            result[index] = x
            for j in group.members:
                motion[j] = motion[j] + ear.G[j] @ x  # Eq. 30
    return result


# --- small geometry ------------------------------------------------------------------------------------------------


def rotation_only(R: Pair) -> Pair:
    """The small rotation dR of R as (3, 1), along the axes to which R maps; a pair without value."""
    W = R.tangent @ R.value.mT  # a skew matrix
    return Pair(0 * R.value[:, :1], np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=1)[..., None])


def shift_only(x: Pair) -> Pair:
    """The displacement dx of a body, as a pair without value."""
    return Pair(0 * x.value, x.tangent)


def displacement(pairs: Pairs, N_C: Pair, x: Pair) -> Pair:
    """Small rotation and displacement of a body at N_C and x, (6, 1) in its own axes: a pair without value."""
    return pairs.block([[N_C.mT @ rotation_only(N_C)], [N_C.mT @ shift_only(x)]])


def selection(pairs: Pairs, model: Model, body: int, speeds: Sequence[int]) -> Pair:
    """A matrix (f, len(speeds)) whose entry is 1 where a speed belongs to a body's joint."""
    rows = model.coordinate_slices[body][1]
    return pairs.constant(
        np.array([[int(i == j) for j in speeds] for i in range(rows.start, rows.stop)], dtype=int).reshape(
            rows.stop - rows.start, len(speeds)
        )
    )
