"""The conditions of loop joints in the ground frame, differentiated twice in time by hand: the dense method's Eq. 5.

A loop joint sets linear conditions on the origins of its two faces and angular ones on their axes:

    linear    n . (x_e - x_s) = 0      n fixed in the start face
    angular   c . d = 0                c fixed in the end face, d in the start face

with the derivatives, where alpha and a are the accelerations at udot = 0,

    n . (v_e - v_s) + (w_s x n) . r                                             r = x_e - x_s
    n . (a_e - a_s) + 2 (w_s x n) . (v_e - v_s) + (alpha_s x n + w_s x (w_s x n)) . r
    (w_e - w_s) . (c x d)
    (alpha_e - alpha_s) . (c x d) + (w_e - w_s) . ((w_e x c) x d + c x (w_s x d))

The first of each pair is the Jacobian times u, the second B of Eq. 8. For joints that fully constrain the rotation, a condition
is half the difference of two such products, an antisymmetric part of the relative rotation.

c . d is a sine, which also vanishes at half a turn, where the axes point in opposite directions. The reported residual is 2
sin(t/2) instead, where t is the angle between axes that should be parallel, or of the rotation between faces. At t = 0 the two
agree to first order. A universal joint is closed in both positions.

A condition on a point is ``f(s) = 0``, with s = R_s^T r the position of the end in the start face. With n = R_s grad f
and v' = v_e - v_s - w_s x r its row is that of a linear condition. Its remainder is n . a' + v'^T (R_s H R_s^T) v',
with a' the acceleration relative to the start face at udot = 0. A distance needs no face: ``(r . r - l^2)/2 = 0``, r .
(v_e - v_s), r . (a_e - a_s) + (v_e - v_s)^2. Conditions on points are divided by the length of their gradient and by
the characteristic length.

A coupling is ``sum of factor q - offset = 0``. Its Jacobian consists of the factors, and its remainder is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..model.model import Coupling, Face, Loop, PointCondition
from .arithmetic import Array
from .ground_frame import Frame, Freedoms, cross, placement
from .pairs import Pair, Pairs
from .primitives import condition_frame, residuals_of_turn
from .surfaces import surface_at

Row = tuple[Pair, Pair, Pair, Pair]
"""Residual (1, 1), Jacobian (1, nu), remainder (1, 1) and wrench (1, 6) of a condition."""

Turning = list[tuple[Any, Pair, Pair]]
"""An angular condition: weights and directions c, d, (1, 3), of its terms w c . d = 0."""


@dataclass(slots=True)
class Conditions:
    """All conditions in the order of `Model.closure_names`; linear ones are divided by a characteristic length.

    Attributes
    ----------
    position : Pair
        Reported residuals of Eq. 5, (m, 1).
    constraint : Pair
        The residuals with sines of angles, (m, 1).
    jacobian : Pair
        Derivatives of `constraint` with respect to the speeds, (m, nu).
    remainder : Pair
        Terms of the second time derivative of `constraint` other than jacobian times udot, (m, 1).
    wrenches : Pair
        Moment (first three) and force on the end body, at its face's origin, for a unit multiplier, (m, 6), ground frame.
    """

    position: Pair
    constraint: Pair
    jacobian: Pair
    remainder: Pair
    wrenches: Pair


@dataclass(slots=True)
class Side:
    """One face of a loop joint in the ground frame.

    ``R (3, 3)`` turns face components into ground components, ``x, v, a (1, 3)`` are the origin's position, velocity and
    acceleration at udot = 0, ``omega, alpha (1, 3)`` the body's, ``J_v, J_w (nu, 3)`` the partial velocities.
    """

    R: Pair
    x: Pair
    v: Pair
    a: Pair
    omega: Pair
    alpha: Pair
    J_v: Pair
    J_w: Pair


def conditions(
    pairs: Pairs,
    loops: Sequence[Loop],
    lengths: Sequence[float],
    frames: list[Frame],
    freedoms: Freedoms,
    q: Pair,
    u: Pair,
    places: Sequence[tuple[slice, slice]],
    defaults: dict[str, float],
) -> Conditions:
    """The conditions of all loops at a state; `places` gives the indices of the coordinates and speeds of bodies."""
    rows: list[Row] = []
    positions: list[Pair] = []
    for loop, length in zip(loops, lengths, strict=True):
        if isinstance(loop, Coupling):
            rows.append(_coupled(pairs, loop, places, q, u))
            positions.append(rows[-1][0])
            continue
        s, e = (side(pairs, face, frames[face.body], freedoms, u) for face in (loop.start, loop.end))
        if isinstance(loop, PointCondition):
            found = _on_point(pairs, loop, s, e, length)
            rows += found
            positions += [value for value, *_ in found]
            continue
        linear, angular = directions(pairs, loop, s.R, e.R, defaults)
        scale = pairs.number(1) / pairs.number(length)
        found = [_linear(pairs, s, e, n) for n in linear]
        rows += [(value * scale, row * scale, more * scale, wrench * scale) for value, row, more, wrench in found]
        positions += [value * scale for value, *_ in found]
        turned = [_angular(pairs, s, e, terms) for terms in angular]
        rows += turned
        into = condition_frame(pairs, loop.axes[0], defaults)[1].mT if loop.axes else pairs.eye(3)
        positions += residuals_of_turn(pairs, loop, into, s.R, e.R, [value for value, *_ in turned])
    return Conditions(
        pairs.block([[x] for x in positions]), *(pairs.block([[row[i]] for row in rows]) for i in range(4))
    )


def side(pairs: Pairs, face: Face, frame: Frame, freedoms: Freedoms, u: Pair) -> Side:
    """The face of a loop joint, from the frame of its body."""
    index = np.array(frame.freedoms, dtype=int)
    x, v = frame.point(pairs.vector(face.at))
    J_w, J_v = freedoms.w[index], freedoms.partial_velocities(index, x)
    a = u[index].mT @ freedoms.partial_velocity_rates(index, x, v)
    alpha = u[index].mT @ freedoms.w_rate[index]
    nu = u.value.shape[0]
    R = frame.R @ placement(pairs, face.rotation)
    return Side(R, x, v, a, frame.omega, alpha, _spread(pairs, J_v, index, nu), _spread(pairs, J_w, index, nu))


def directions(
    pairs: Pairs, loop: Loop, R_s: Pair, R_e: Pair, defaults: dict[str, float]
) -> tuple[list[Pair], list[Turning]]:
    """The directions n, and the terms of c . d, of a loop joint's conditions, each (1, 3) in the ground frame."""
    U = pairs.eye(3)
    i, frame = condition_frame(pairs, loop.axes[0], defaults) if loop.axes else (2, U)
    start, end = ([(R @ frame)[:, j : j + 1].mT for j in range(3)] for R in (R_s, R_e))
    j, k = (i + 1) % 3, (i + 2) % 3
    across = [start[j], start[k]]
    half = pairs.arithmetic.number(1) / 2
    joint = loop.closure
    linear = {3: start, 2: across, 1: [start[i]], 0: []}[joint.linear]
    angular: list[Turning] = []
    if joint.angular == 3:
        angular = [[(half, end[n - 2], start[n - 1]), (-half, end[n - 1], start[n - 2])] for n in range(3)]
    elif joint.angular == 2:
        angular = [[(-1, end[i], start[k])], [(1, end[i], start[j])]]
    elif joint.angular == 1:
        second = pairs.unit(pairs.vector(loop.axes[1])).mT @ R_e.mT
        angular = [[(1, second, start[i])]]
    return linear, angular


def _coupled(pairs: Pairs, loop: Coupling, places: Sequence[tuple[slice, slice]], q: Pair, u: Pair) -> Row:
    """The condition that a sum of factor q minus the offset is zero; its wrench is a force along the first q."""
    value, row = -pairs.matrix([[pairs.expression(loop.offset)]]), pairs.zeros(1, len(u.value))
    for term in loop.terms:
        i, j = (place.start + term.index for place in places[term.body])
        factor = pairs.matrix([[pairs.expression(term.factor)]])
        value = value + factor @ q[i : i + 1]
        row.value[:, [j]], row.tangent[:, :, [j]] = factor.value, factor.tangent
    return value, row, pairs.constant([[0]]), pairs.constant([[1, 0, 0, 0, 0, 0]])


def _linear(pairs: Pairs, s: Side, e: Side, n: Pair) -> Row:
    """The condition n . (x_e - x_s) = 0."""
    r, v = e.x - s.x, e.v - s.v
    turned = cross(s.omega, n)
    row = n @ (e.J_v - s.J_v).mT + cross(n, r) @ s.J_w.mT
    remainder = (
        n @ (e.a - s.a).mT + turned @ v.mT * pairs.number(2) + (cross(s.alpha, n) + cross(s.omega, turned)) @ r.mT
    )
    return n @ r.mT, row, remainder, pairs.block([[pairs.constant([[0, 0, 0]]), n]])


def _on_point(pairs: Pairs, loop: PointCondition, s: Side, e: Side, length: float) -> list[Row]:
    """Conditions that keep a point at a distance or on surfaces, divided by the gradient's size and by `length`."""
    r, v = e.x - s.x, e.v - s.v
    if loop.length is not None:
        l = pairs.matrix([[pairs.expression(loop.length)]])
        value = (r @ r.mT - l @ l) * (pairs.number(1) / pairs.number(2))
        found = [(value, r, r @ (e.J_v - s.J_v).mT, r @ (e.a - s.a).mT + v @ v.mT)]
    else:
        seen = v - cross(s.omega, r)  # velocity as seen from the start face
        a = e.a - s.a - cross(s.alpha, r) - cross(s.omega, cross(s.omega, r)) - cross(s.omega, seen) * pairs.number(2)
        found = []
        for f in loop.surfaces:
            surface, own = surface_at(pairs, f, s.R.mT @ r.mT), seen @ s.R
            n = (s.R @ surface.gradient).mT
            row = n @ (e.J_v - s.J_v).mT + cross(n, r) @ s.J_w.mT
            found.append((surface.value, n, row, n @ a.mT + own @ surface.hessian @ own.mT))
    rows: list[Row] = []
    for value, n, row, more in found:
        scale = pairs.number(1) / (pairs.call("sqrt", (n @ n.mT)[0, 0]) * pairs.number(length))
        wrench = pairs.block([[pairs.constant([[0, 0, 0]]), n]])
        rows.append((value * scale, row * scale, more * scale, wrench * scale))
    return rows


def _angular(pairs: Pairs, s: Side, e: Side, terms: Turning) -> Row:
    """The condition that the sum of w c . d is zero."""
    omega = e.omega - s.omega
    value, turned, m = pairs.constant([[0]]), pairs.constant([[0]]), pairs.constant([[0, 0, 0]])
    for weight, c, d in terms:
        w = pairs.number(weight)
        value, m = value + c @ d.mT * w, m + cross(c, d) * w
        turned = turned + omega @ (cross(cross(e.omega, c), d) + cross(c, cross(s.omega, d))).mT * w
    row = m @ (e.J_w - s.J_w).mT
    return value, row, (e.alpha - s.alpha) @ m.mT + turned, pairs.block([[m, pairs.constant([[0, 0, 0]])]])


def _spread(pairs: Pairs, rows: Pair, index: Array, n: int) -> Pair:
    """A matrix with n rows that has the given rows (len(index), 3) at the given indices."""
    result = pairs.zeros(n, 3)
    result[index] = rows
    return result
