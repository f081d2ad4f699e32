"""Vectors and matrices of size three, as lists of scalars of any type (symbols, floats, structural values)."""

from __future__ import annotations

from collections.abc import Sequence

from ..program.algebra import Number
from ..program.scalar import Matrix, Value, Vector

Components = Sequence[Value]
Rows = Sequence[Sequence[Value]]

SIX = range(6)
"""Indices of the components of a wrench, a twist or an acceleration: angular, then linear."""

ZERO: Vector = [0, 0, 0]
UNIT: Matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def is_zero(v: object) -> bool:
    """Whether a scalar is known to be zero."""
    return isinstance(v, (int, Number)) and v == 0


def cross(a: Components, b: Components) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def add(*vectors: Components) -> Vector:
    return [sum(components[1:], components[0]) for components in zip(*vectors, strict=True)]


def minus(a: Components, b: Components) -> Vector:
    return [p - q for p, q in zip(a, b, strict=True)]


def dot(a: Components, b: Components) -> Value:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def product(a: Value, b: Value) -> Value:
    """A product; either factor may be the int 0 or 1."""
    return b if isinstance(a, int) and a == 1 else a * b


def inner(a: Components, b: Components) -> Value:
    """The sum of products of components; those of `a` may be the int 0 or 1."""
    return sum(product(p, q) for p, q in zip(a, b, strict=True))


def scale(s: Value, a: Components) -> Vector:
    return [s * x for x in a]


def matvec(m: Rows, v: Components) -> Vector:
    return [dot(row, v) for row in m]


def rotate(W: Matrix, v: Vector) -> Vector:
    """``W v``; a unit matrix W costs no operations."""
    return list(v) if W is UNIT else matvec(W, v)


def turned(W: Matrix, six: Vector) -> Vector:
    """Six components rotated by W, such as a moment and a force."""
    return rotate(W, six[:3]) + rotate(W, six[3:])


def about(lever: Vector, force: Vector) -> Vector:
    """A moment and a force about another point; `lever` is the vector from that point to the present one."""
    return [*add(force[:3], cross(lever, force[3:])), *force[3:]]


def transpose(m: Rows) -> Matrix:
    return [list(row) for row in zip(*m, strict=True)]


def matmul(a: Rows, b: Rows) -> Matrix:
    columns = transpose(b)
    return [[dot(row, c) for c in columns] for row in a]


def symmetric(six: Components) -> Matrix:
    """Symmetric matrix from its entries xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def six(m: Rows) -> Vector:
    """Entries xx, yy, zz, xy, xz, yz of a symmetric matrix."""
    return [m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]]


def skew(v: Components) -> Matrix:
    """The cross-product matrix of v: ``v x``."""
    x, y, z = v
    return [[0, -z, y], [z, 0, -x], [-y, x, 0]]
