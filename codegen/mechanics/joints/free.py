"""The free joint, with six degrees of freedom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...model.motions import Ball, Displacement
from ...program.scalar import Value, Vector
from ..spatial import add, cross, dot, matvec, transpose
from ..stores import COORDINATES, DQ, SPEEDS
from .quaternion import QuaternionJoint


class Free(QuaternionJoint):
    """A free joint: a position, then a quaternion; the last three speeds are linear, along the link's axes."""

    motion = (Displacement(coordinate=0, speed=3), Ball(coordinate=3, speed=0))
    freedoms, coordinates, quaternion, swings = 6, 7, 3, True

    @classmethod
    def moved_by(cls, freedoms: Sequence[int]) -> list[int]:
        return [c for c in range(7) if any((j < 3) == (c >= 3) for j in freedoms)]

    def way(self) -> Vector:
        return [self.x.entry(COORDINATES, i) for i in range(3)]

    def _slide_speeds(self) -> Vector:
        return [self.x.entry(SPEEDS, i) for i in range(3, 6)]

    def sliding(self, carried: Vector) -> Vector:
        return [self.x.let("v", e, "Eq. 18") for e in add(carried, self._slide_speeds())]

    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        turn = self._turn_speeds()
        # d/dt (R v) = R (v' + w_rel x v), plus the Coriolis term 2 w_parent x v
        sweep = self.x.let_vector("sweep", [turn[i] + 2 * carried[i] for i in range(3)], "Eq. 21")
        return cross(carried, turn), cross(sweep, self._slide_speeds())

    def bias_change(self, change: Vector) -> tuple[Vector, Vector]:
        twice = [2 * speed for speed in self._slide_speeds()]
        return cross(change, self._turn_speeds()), cross(change, twice)

    def rates(self) -> Vector:
        turned = super().rates()
        return matvec(self.matrix, self._slide_speeds()) + turned

    def displacement(self) -> tuple[Vector, Vector]:
        turn, _ = super().displacement()
        moved = matvec(transpose(self.matrix), [self.x.entry(DQ, i) for i in range(3)])
        return turn, self.x.let_vector("slide", moved, "d Eq. 22", lanes=True)

    def along_freedom(self, j: int) -> Value:
        if j < 3:
            return super().along_freedom(j)
        column = [row[j - 3] for row in self.matrix]
        return self.x.let("slide", dot(column, [self.x.entry(DQ, i) for i in range(3)]), "d Eq. 22", lanes=True)

    def coordinate_changes(self, found: Mapping[int, Value], lanes: bool) -> dict[int, Value]:
        result = super().coordinate_changes(found, lanes)
        if any(j >= 3 for j in found):
            slide = [found[j] if j in found else self.along_freedom(j) if lanes else 0 for j in range(3, 6)]
            for m, value in enumerate(matvec(self.matrix, slide)):
                result[m] = self.x.let("dq", value, "d Eq. 22", lanes=lanes)
        return result
