"""Planar chains of rods in extended precision, by the forces in their hinges, without the recursions of the generator.

Body k turns by the absolute angle th_k and is held by the force F_k at its near end, -F_{k+1} at its far end. That its near end
accelerates as the far end of the body before gives two equations for every hinge, in F_{k-1}, F_k, F_{k+1}: a block-tridiagonal
system, solved in O(n). Derivatives are carried along by numbers with tangents.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpmath import mp, mpf

DIGITS = 60
"""The condition of these systems costs at most 16 of them."""


class Dual:
    """An mpmath number with its derivatives along several directions."""

    __slots__ = ("d", "x")

    def __init__(self, x: Any, d: Sequence[Any]):
        self.x, self.d = x, d

    def __add__(self, o: Dual) -> Dual:
        return Dual(self.x + o.x, [a + b for a, b in zip(self.d, o.d, strict=True)])

    def __sub__(self, o: Dual) -> Dual:
        return Dual(self.x - o.x, [a - b for a, b in zip(self.d, o.d, strict=True)])

    def __neg__(self) -> Dual:
        return Dual(-self.x, [-a for a in self.d])

    def __mul__(self, o: Dual) -> Dual:
        return Dual(self.x * o.x, [a * o.x + self.x * b for a, b in zip(self.d, o.d, strict=True)])

    def __truediv__(self, o: Dual) -> Dual:
        x = self.x / o.x
        return Dual(x, [(a - x * b) / o.x for a, b in zip(self.d, o.d, strict=True)])

    def cos_sin(self) -> tuple[Dual, Dual]:
        c, s = mp.cos_sin(self.x)
        return Dual(c, [-s * a for a in self.d]), Dual(s, [c * a for a in self.d])


Vector = tuple[Dual, Dual]


def _less(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def _solve(M: Sequence[Dual], b: Vector) -> Vector:
    """The solution of M x = b for a symmetric 2x2 matrix M, given as (xx, xy, yy)."""
    xx, xy, yy = M
    det = xx * yy - xy * xy
    return (yy * b[0] - xy * b[1]) / det, (xx * b[1] - xy * b[0]) / det


def accelerations(
    q: Sequence[float], u: Sequence[float], lengths: Sequence[float], masses: Sequence[float], g: float = 9.81, *,
    dq: Any = (), du: Any = (), dlengths: Any = (), dmasses: Any = (), k: int = 0,
) -> tuple[list[Any], list[list[Any]]]:  # fmt: skip
    """udot of hinge angles of thin rods that hang in a chain from the ground, and its derivatives along k directions.

    Angles count from the downward vertical, each relative to the rod before; gravity is g. Seeds are (k, n); left out: zero.
    """
    with mp.workdps(DIGITS):
        return _accelerations(q, u, lengths, masses, g, dq, du, dlengths, dmasses, k)


def _accelerations(q, u, lengths, masses, g, dq, du, dlengths, dmasses, k):  # type: ignore[no-untyped-def]
    n = len(q)

    def numbers(values: Any, seeds: Any) -> list[Dual]:
        return [
            Dual(mpf(float(x)), [mpf(float(row[i])) for row in seeds] if len(seeds) else [mpf(0)] * k)
            for i, x in enumerate(values)
        ]

    def constant(x: Any) -> Dual:
        return Dual(mpf(x), [mpf(0)] * k)

    q, u, lengths, masses = numbers(q, dq), numbers(u, du), numbers(lengths, dlengths), numbers(masses, dmasses)
    zero, half, twelfth, weight = constant(0), constant(0.5), 1 / mpf(12), constant(g)
    # of every rod: half of it as a vector, what its ends accelerate by without forces, how forces at its ends move it
    angle, speed = zero, zero
    r, remainder, same, cross = [], [], [], []
    for i in range(n):
        angle, speed = angle + q[i], speed + u[i]
        c, s = angle.cos_sin()
        h = half * lengths[i]
        x, y = h * s, -(h * c)
        inertia = masses[i] * lengths[i] * lengths[i] * constant(twelfth)
        w2 = speed * speed
        r.append((x, y))
        remainder.append((w2 * x, w2 * y))  # of the near end: minus omega^2 times its place -r
        inverse = constant(1) / masses[i]
        xx, xy, yy = y * y / inertia, -(x * y / inertia), x * x / inertia
        same.append((inverse + xx, xy, inverse + yy))  # a force at an end, and that end
        cross.append(
            (xx - inverse, xy, yy - inverse)
        )  # minus a force at the far end, and the near end; and the reverse
        r[-1] = (x, y, inertia)
    # near end of k: same_k F_k + cross_k F_{k+1} + remainder_k + gravity
    # far end of k: -cross_k F_k - same_k F_{k+1} - remainder_k + gravity
    diagonal, right = [], []
    for i in range(n):
        D = same[i] if i == 0 else tuple(a + b for a, b in zip(same[i], same[i - 1], strict=True))
        rx, ry = remainder[i]
        b = (-rx, weight - ry) if i == 0 else (-rx - remainder[i - 1][0], -ry - remainder[i - 1][1])
        diagonal.append(D)
        right.append(b)
    for i in range(n - 2, -1, -1):  # eliminate the last hinge first
        C, D = cross[i], diagonal[i + 1]
        first = _solve(D, (C[0], C[1]))
        second = _solve(D, (C[1], C[2]))
        b = _solve(D, right[i + 1])
        xx = C[0] * first[0] + C[1] * first[1]
        xy = C[0] * second[0] + C[1] * second[1]
        yy = C[1] * second[0] + C[2] * second[1]
        diagonal[i] = (diagonal[i][0] - xx, diagonal[i][1] - xy, diagonal[i][2] - yy)
        right[i] = _less(right[i], (C[0] * b[0] + C[1] * b[1], C[1] * b[0] + C[2] * b[1]))
    force = [_solve(diagonal[0], right[0])]
    for i in range(1, n):
        C, F = cross[i - 1], force[-1]
        force.append(_solve(diagonal[i], _less(right[i], (C[0] * F[0] + C[1] * F[1], C[1] * F[0] + C[2] * F[1]))))
    force.append((zero, zero))
    found, before = [], zero
    for i in range(n):
        x, y, inertia = r[i]
        fx, fy = force[i][0] + force[i + 1][0], force[i][1] + force[i + 1][1]
        alpha = (y * fx - x * fy) / inertia  # (-r) x F_k + r x (-F_{k+1})
        found.append(alpha - before)
        before = alpha
    return [a.x for a in found], [[a.d[j] for a in found] for j in range(k)]
