"""Joints that rotate about an axis and slide along it in a fixed ratio."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from ...model.motions import Slide, Turn
from ...program.scalar import Value
from .. import fields
from ..spatial import is_zero
from ..stores import CONSTANTS
from .axial import Axial
from .column import Column


class Screw(Axial):
    """A screw joint: partial velocity ``(e, h e)``, h the pitch, m/rad."""

    motion = (Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0))
    freedoms, coordinates, angle, slides = 1, 1, 0, True

    @cached_property
    def pitch(self) -> Value:
        return self.x.load(CONSTANTS, fields.joint_factor)

    def pitch_by(self, parameter: int) -> Value:
        """Derivative of the pitch with respect to a design parameter."""
        return self.x.load(CONSTANTS, fields.joint_factor.derivative(parameter))

    @property
    def columns(self) -> Sequence[Column]:
        return (self.column,)

    @cached_property
    def column(self) -> Column:
        """The partial velocity of the screw."""
        axis = self.kind.axis
        h = {3 + axis: self.pitch}
        by = [{3 + axis: self.pitch_by(j)} for j in range(self.kind.parameters)]
        others, *changes = ({i: v for i, v in s.items() if not is_zero(v)} for s in (h, *by))
        return Column(axis, others, tuple(changes))

    def shift(self) -> Value:
        return self.x.let("shift", self.pitch * self.own_coordinate(), "Eq. 22")

    def shift_by(self, parameter: int) -> Value:
        return self.pitch_by(parameter) * self.own_coordinate()

    def slide_speed(self) -> Value:
        return self.x.let("slide", self.pitch * self.own_speed(), "Eq. 18")

    def shift_tangent(self) -> Value:
        return self.x.let("slide", self.pitch * self.own_change(), "d Eq. 22", lanes=True)
