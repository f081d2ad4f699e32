"""Rotation and shift of generalised inertias."""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Matrix, Vector
from ..spatial import dot, matmul, six, skew, symmetric, transpose


def rotate_all(x: Scope, R: Matrix, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
    """Blocks of a generalised inertia rotated by R: each block m becomes ``R m R^T``."""

    def named(m: Matrix, name: str) -> Matrix:
        return [[x.let(f"{name}{i}{j}", m[i][j], tag) for j in range(3)] for i in range(3)]

    def turned(m: Matrix, name: str, is_symmetric: bool) -> Matrix:
        half = named(matmul(R, named(m, name + "_in")), name + "_h")
        if is_symmetric:
            entries = [dot(half[i], R[j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            return symmetric([x.let(f"{name}_r", e, tag) for e in entries])
        return named(matmul(half, transpose(R)), name + "_r")

    return turned(J, "J", True), turned(H, "H", False), turned(M, "M", True)


def shift_inertia(x: Scope, r: Vector, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
    """The blocks of a generalised inertia about a point at -r: ``S I S^T`` of Eq. 44."""
    let = x.let
    rM = matmul_named(x, skew(r), M, "rM", tag)
    H_out = [[let("H_s", H[i][j] + rM[i][j], tag) for j in range(3)] for i in range(3)]
    X = skew(r)
    first = matmul(X, transpose(H))
    second = matmul(H_out, transpose(X))
    J_out = [[J[i][j] + first[i][j] + second[i][j] if j >= i else 0 for j in range(3)] for i in range(3)]
    return symmetric(six(J_out)), H_out, M


def matmul_named(x: Scope, a: Matrix, b: Matrix, name: str, tag: str) -> Matrix:
    """A matrix product whose terms have names, so that equal terms of a symmetric result are computed once."""
    out: Matrix = []
    for row in a:
        line = []
        for j in range(3):
            terms = [x.let(name, row[k] * b[k][j], tag) for k in range(3)]
            line.append(terms[0] + terms[1] + terms[2])
        out.append(line)
    return out
