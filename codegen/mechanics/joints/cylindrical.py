"""Sliding along an axis and turning about it."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.motions import Slide, Turn
from .column import Column
from .prismatic import Prismatic


class Cylindrical(Prismatic):
    """A slider that turns: one link, both columns constant in its axes."""

    motion = (Slide(axis=0, index=0), Turn(axis=0, index=1))
    freedoms, coordinates, angle = 2, 2, 1

    @property
    def columns(self) -> Sequence[Column]:
        return (Column(3 + self.kind.axis), Column(self.kind.axis))
