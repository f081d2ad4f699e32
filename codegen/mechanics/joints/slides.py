"""Joints that slide along two axes."""

from __future__ import annotations

from ...model.motions import Slide
from ...program.scalar import Vector
from ...program.store import Store
from ..spatial import add, cross, scale
from ..stores import COORDINATES, DQ, SPEEDS
from .link_joint import LinkJoint


class Slides(LinkJoint):
    """A joint with displacements along the two directions normal to the link's axis: the first link of a planar
    joint."""

    motion = (Slide(axis=1, index=0), Slide(axis=2, index=1))
    freedoms, coordinates = 2, 2

    def _across(self) -> tuple[int, int]:
        return (self.kind.axis + 1) % 3, (self.kind.axis + 2) % 3

    def _vector(self, store: Store) -> Vector:
        v: Vector = [0, 0, 0]
        for n, i in enumerate(self._across()):
            v[i] = self.x.entry(store, n)
        return v

    def way(self) -> Vector:
        return self._vector(COORDINATES)

    def turning(self, carried: Vector) -> Vector:
        return carried

    def sliding(self, carried: Vector) -> Vector:
        return self.x.let_vector("v", add(carried, self._vector(SPEEDS)), "Eq. 18")

    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        twice = [self.x.let("u2", e, "Eq. 21") for e in scale(2, self._vector(SPEEDS))]
        return [0, 0, 0], cross(carried, twice)

    def displacement(self) -> tuple[Vector, Vector]:
        return [0, 0, 0], self._vector(DQ)
