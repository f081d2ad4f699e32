"""Turning about an axis."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.motions import Turn
from .axial import Axial
from .column import Column


class Revolute(Axial):
    """A hinge."""

    motion = (Turn(axis=0, index=0),)
    freedoms, coordinates, angle = 1, 1, 0

    @property
    def columns(self) -> Sequence[Column]:
        return (Column(self.kind.axis),)
