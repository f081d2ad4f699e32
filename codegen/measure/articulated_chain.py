"""The articulated-body algorithm for CHAIN(n) with any scalar type, as one would write it by hand for a symbolic tool.

It shares nothing with the generator. With CasADi's SX scalars it gives the graph that `chain_against_casadi.py` prints to C; with
floats or mpmath numbers it is an independent reference. Structural zeros and ones cost nothing, and symmetric blocks are computed
once. All quantities are about the joint, in body axes, so rotations are about x or y, and the rods' inertias are constant.

Blocks of a spatial inertia: ``J`` (3x3, symmetric) about the joint, ``H`` = m [c]x, ``M`` (3x3, symmetric);
moment = J alpha + H a, force = H^T alpha + M a.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

Vector = list[Any]
Matrix = list[list[Any]]

X, Y = 0, 1


def known(x: Any, value: int) -> bool:
    """Whether a number is a structural zero or one."""
    return type(x) is int and x == value


def mul(x: Any, y: Any) -> Any:
    """The product x y; no operation if one of the factors is a structural zero or one."""
    if known(x, 0) or known(y, 1):
        return x
    return y if known(y, 0) or known(x, 1) else x * y


def add(x: Any, y: Any) -> Any:
    """The sum x + y; no operation if one of the terms is a structural zero."""
    return y if known(x, 0) else x if known(y, 0) else x + y


def dot(a: Vector, b: Vector) -> Any:
    return reduce(add, map(mul, a, b))


def cross(a: Vector, b: Vector) -> Vector:
    return [add(mul(a[i - 2], b[i - 1]), mul(-1, mul(a[i - 1], b[i - 2]))) for i in range(3)]


def plus(a: Vector, b: Vector) -> Vector:
    return list(map(add, a, b))


def times(A: Matrix, x: Vector) -> Vector:
    return [dot(row, x) for row in A]


def transposed(A: Matrix) -> Matrix:
    return [list(column) for column in zip(*A, strict=True)]


def product(A: Matrix, B: Matrix) -> Matrix:
    columns = transposed(B)
    return [[dot(row, column) for column in columns] for row in A]


def symmetric(entry: Callable[[int, int], Any]) -> Matrix:
    """A symmetric matrix from its upper triangle."""
    A: Matrix = [[0] * 3 for _ in range(3)]
    for i in range(3):
        for j in range(i, 3):
            A[i][j] = A[j][i] = entry(i, j)
    return A


def turned(R: Matrix, A: Matrix) -> Matrix:
    """The rotated matrix R A R^T for a symmetric A."""
    RA = product(R, A)
    return symmetric(lambda i, j: dot(RA[i], R[j]))


def rotation(axis: int, c: Any, s: Any) -> Matrix:
    """Rotation matrix about the hinge, parent components from body components."""
    return [[1, 0, 0], [0, c, -s], [0, s, c]] if axis == X else [[c, 0, s], [0, 1, 0], [-s, 0, c]]


@dataclass(frozen=True)
class Rod:
    """A rod: its length, and the blocks of its inertia about the hinge."""

    L: Any
    J: Matrix
    H: Matrix
    M: Matrix

    @classmethod
    def of(cls, L: Any, density: Any, radius: Any) -> Rod:
        m = density * L
        mc = -m * L / 2  # first moment along z
        across, along = m * (3 * radius * radius + 4 * L * L) / 12, m * radius * radius / 2  # moments about the hinge
        J: Matrix = [[across, 0, 0], [0, across, 0], [0, 0, along]]
        return cls(L, J, [[0, -mc, 0], [mc, 0, 0], [0, 0, 0]], [[m, 0, 0], [0, m, 0], [0, 0, m]])


Wrench = tuple[Vector, Vector]
"""A moment and a force, or an angular and a linear acceleration."""


def accelerations(
    q: Vector, u: Vector, L: Any, sin: Any, cos: Any, density: Any, radius: Any, g: Any, *, planar: bool = False
) -> Vector:
    """udot of CHAIN(n): hinge axes y, x, y, ..., or all y, rods along -z, gravity (0, 0, -g), no joint forces."""
    axes = [Y if planar or k % 2 == 0 else X for k in range(len(q))]
    rod = Rod.of(L, density, radius)
    R = [rotation(a, cos(angle), sin(angle)) for a, angle in zip(axes, q, strict=True)]
    bias, pushed = _velocities(rod, axes, R, u)
    solved = _articulated(rod, axes, R, bias, pushed)

    # outward: accelerations; gravity is replaced by an acceleration g of the ground
    udot = []
    alpha: Vector = [0, 0, 0]
    acceleration: Vector = [0, 0, g]
    for k, a in enumerate(axes):
        inverse = transposed(R[k])
        if k > 0:
            x, y, z = acceleration
            acceleration = [x - alpha[1] * L, y + alpha[0] * L, z]
        alpha = plus(times(inverse, alpha), bias[k][0])
        acceleration = plus(times(inverse, acceleration), bias[k][1])
        hj, hm, pivot, r = solved[k]
        udot.append((r - dot(hj, alpha) - dot(hm, acceleration)) * pivot)
        alpha[a] = alpha[a] + udot[k]
    return udot


def _velocities(rod: Rod, axes: Sequence[int], R: list[Matrix], u: Vector) -> tuple[list[Wrench], list[Wrench]]:
    """Outward sweep: velocities of the hinge points, and from these bias accelerations and bias forces."""
    bias: list[Wrench] = []
    pushed: list[Wrench] = []
    w, v = [0, 0, 0], [0, 0, 0]
    for k, a in enumerate(axes):
        inverse = transposed(R[k])
        if k > 0:
            v = times(inverse, [v[0] - w[1] * rod.L, v[1] + w[0] * rod.L, v[2]])
            w = times(inverse, w)
        rate = [0, 0, 0]
        rate[a] = u[k]
        w = plus(w, rate)
        bias.append((cross(w, rate), cross(v, rate)))
        angular = plus(times(rod.J, w), times(rod.H, v))
        linear = plus(times(transposed(rod.H), w), times(rod.M, v))
        pushed.append((plus(cross(w, angular), cross(v, linear)), cross(w, linear)))
    return bias, pushed


def _articulated(
    rod: Rod, axes: Sequence[int], R: list[Matrix], bias: list[Wrench], pushed: list[Wrench]
) -> list[tuple[Vector, Vector, Any, Any]]:
    """Inward sweep: articulated inertias and forces. Returns for each joint the moment and force per unit acceleration about
    its axis, the inverse of the inertia about its axis, and minus the moment along it."""
    L, J, H, M = rod.L, rod.J, rod.H, rod.M
    moment, force = pushed[-1]
    solved: list[Any] = [None] * len(axes)
    for k in reversed(range(len(axes))):
        a = axes[k]
        hj, hm = [J[i][a] for i in range(3)], H[a]
        pivot = 1 / J[a][a]
        solved[k] = (hj, hm, pivot, -moment[a])
        if k == 0:
            break
        gj, gm = [x * pivot for x in hj], [x * pivot for x in hm]
        # The joint's row and column of the contribution to the parent are exactly zero.
        Ja = symmetric(lambda i, j: 0 if a in (i, j) else J[i][j] - gj[i] * hj[j])  # noqa: B023
        Ha = [[0 if i == a else H[i][j] - gj[i] * hm[j] for j in range(3)] for i in range(3)]
        Ma = symmetric(lambda i, j: M[i][j] - gm[i] * hm[j])  # noqa: B023
        angular, linear = bias[k]
        torque = plus(plus(moment, plus(times(Ja, angular), times(Ha, linear))), [x * -moment[a] for x in gj])
        torque[a] = 0  # the joint cannot transmit this moment; there is no joint force
        thrust = plus(
            plus(force, plus(times(transposed(Ha), angular), times(Ma, linear))), [x * -moment[a] for x in gm]
        )
        Jr, Mr = turned(R[k], Ja), turned(R[k], Ma)
        Hr = product(product(R[k], Ha), transposed(R[k]))
        # Shift from the hinge at (0, 0, -L): H' = Hr + [p]x Mr, J' = Jr + [p]x Hr^T + H' [p]x^T.
        Hs = [
            [Hr[0][j] + L * Mr[1][j] for j in range(3)],
            [Hr[1][j] - L * Mr[0][j] for j in range(3)],
            Hr[2],
        ]
        lever = [[L * Hr[j][1] for j in range(3)], [-L * Hr[j][0] for j in range(3)], [0, 0, 0]]
        arm = [[L * row[1], -L * row[0], 0] for row in Hs]
        J = symmetric(lambda i, j: rod.J[i][j] + Jr[i][j] + lever[i][j] + arm[i][j])  # noqa: B023
        H = [[rod.H[i][j] + Hs[i][j] for j in range(3)] for i in range(3)]
        M = symmetric(lambda i, j: rod.M[i][j] + Mr[i][j])  # noqa: B023
        torque, thrust = times(R[k], torque), times(R[k], thrust)
        torque = [torque[0] + L * thrust[1], torque[1] - L * thrust[0], torque[2]]
        moment, force = plus(pushed[k - 1][0], torque), plus(pushed[k - 1][1], thrust)
    return solved
