"""Joints with a quaternion: its rotation matrix, and its tangent as a rotation vector of three components."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

from ...program.block import Scope
from ...program.field import XYZ
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import add, cross, matmul, matvec, transpose
from ..stores import COORDINATES, DQ, ME, MY_LANE, SPEEDS, TURNS
from .inertia import rotate_all
from .link_joint import LinkJoint, Primitives


class QuaternionJoint(LinkJoint):
    """A joint that rotates by a quaternion; its first three speeds are the angular velocity along the link's axes."""

    quaternion: ClassVar[int]

    @cached_property
    def matrix(self) -> Matrix:
        """Rotation matrix of the quaternion: components along the joint's frame at q = 0 from those along the link's axes."""
        return self.x.load(ME, fields.quaternion_matrix)

    def _turned(self, W: Matrix) -> Matrix:
        return [[self.x.let("W", e, "Eq. 22") for e in row] for row in matmul(W, self.matrix)]

    def _behind(self, v: Vector, name: str, tag: str) -> Vector:
        v = matvec(transpose(self.matrix), v)
        return [self._let(f"{name}_{i}", v[k], tag) for k, i in enumerate(XYZ)]

    def _before(self, v: Vector, name: str, tag: str) -> Vector:
        v = matvec(self.matrix, v)
        return [self._let(f"{name}_{i}", v[k], tag) for k, i in enumerate(XYZ)]

    def _inertia_before(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        return rotate_all(self.x, self.matrix, J, H, M, tag)

    def _turn_speeds(self) -> Vector:
        return [self.x.entry(SPEEDS, i) for i in range(3)]

    def turning(self, carried: Vector) -> Vector:
        return self.x.let_vector("w", add(carried, self._turn_speeds()), "Eq. 18")

    def sliding(self, carried: Vector) -> Vector:
        return carried

    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        return cross(carried, self._turn_speeds()), [0, 0, 0]

    def rates(self) -> Vector:
        x, tag = self.x, "Eq. 1"
        n, half = self.quaternion, x.half
        w, i, j, k = (x.let("e", half * x.entry(COORDINATES, n + m), tag) for m in range(4))
        wx, wy, wz = self._turn_speeds()
        return [-i * wx - j * wy - k * wz, w * wx + j * wz - k * wy, w * wy + k * wx - i * wz, w * wz + i * wy - j * wx]

    def displacement(self) -> tuple[Vector, Vector]:
        return [self.x.load(MY_LANE, fields.turn(i)) for i in range(3)], [0, 0, 0]

    def along_freedom(self, j: int) -> Value:
        return self.x.load(MY_LANE, fields.turn(j))

    def coordinate_changes(self, found: Mapping[int, Value], lanes: bool) -> dict[int, Value]:
        # If loops determine some degrees of freedom of the rotation, dq keeps its components along the other degrees of
        # freedom. If loops determine none, dq stays as given, including its change of the quaternion's length.
        if not any(j < 3 for j in found):
            return {}
        x, tag = self.x, "d Eq. 22"
        turn = [found[j] if j in found else self.along_freedom(j) if lanes else 0 for j in range(3)]
        a, b, c = (x.let("half", x.half * v, tag, lanes=lanes) for v in turn)
        w, i, j, k = (x.entry(COORDINATES, self.quaternion + m) for m in range(4))
        changed = [-(i * a + j * b + k * c), w * a + j * c - k * b, w * b + k * a - i * c, w * c + i * b - j * a]
        result = {self.quaternion + m: x.let("dq", value, tag, lanes=lanes) for m, value in enumerate(changed)}
        if lanes:
            for m in range(3):
                x.store(MY_LANE, fields.turn(m), turn[m])
        return result

    def transparent(self) -> Primitives:
        result: Primitives = {}
        R = self.matrix
        turn = [self.x.entry(TURNS, i) for i in range(3)]
        for i in range(3):
            for j in range(3):
                k, n = (j + 1) % 3, (j + 2) % 3
                # d R = R [delta x], delta along the link's axes
                result[R[i][j]] = {turn[n]: R[i][k], turn[k]: -R[i][n]}
        return result

    @classmethod
    def turn_seed(cls, x: Scope, component: str, store: Store = MY_LANE) -> Value:
        return x.load(store, fields.turn(component))

    # -- blocks that compute rotations -----------------------------------------------------------------------------

    def write_rotation(self) -> None:
        """Rotation matrix of e/|e|, parent components from link components; the factor 2/|e|^2 allows for any length of e."""
        x = self.x
        w, i, j, k = (x.entry(COORDINATES, self.quaternion + m) for m in range(4))
        tag = "Eq. 22"
        s = x.let("s", 2 / x.let("ee", w * w + i * i + j * j + k * k, tag), tag)
        si, sj, sk = (x.let(f"s{name}", s * v, tag) for name, v in (("i", i), ("j", j), ("k", k)))
        wi, wj, wk = (x.let(f"w{name}", w * v, tag) for name, v in (("i", si), ("j", sj), ("k", sk)))
        ii, jj, kk = x.let("ii", i * si, tag), x.let("jj", j * sj, tag), x.let("kk", k * sk, tag)
        ij, ik, jk = x.let("ij", i * sj, tag), x.let("ik", i * sk, tag), x.let("jk", j * sk, tag)
        Q = [[1 - (jj + kk), ij - wk, ik + wj], [ij + wk, 1 - (ii + kk), jk - wi], [ik - wj, jk + wi, 1 - (ii + jj)]]
        named = [[x.let(f"Q_{XYZ[a]}{XYZ[b]}", Q[a][b], tag) for b in range(3)] for a in range(3)]
        x.store(ME, fields.quaternion_matrix, named)

    def write_turn(self, store: Store = MY_LANE) -> None:
        """Rotation vector, along the link's axes, of a quaternion's tangent: ``2 e* de / |e|^2``; zero for a change of length."""
        x = self.x
        w, i, j, k = (x.entry(COORDINATES, self.quaternion + m) for m in range(4))
        dw, di, dj, dk = (x.entry(DQ, self.quaternion + m) for m in range(4))
        tag = "d Eq. 22"
        s = x.let("s", 2 / x.let("ee", w * w + i * i + j * j + k * k, tag), tag)
        w, i, j, k = (x.let("e", s * v, tag) for v in (w, i, j, k))
        turn = (
            w * di - i * dw - j * dk + k * dj,
            w * dj - j * dw - k * di + i * dk,
            w * dk - k * dw - i * dj + j * di,
        )
        for m in range(3):
            x.store(store, fields.turn(m), x.let("turn", turn[m], tag, lanes=True))
