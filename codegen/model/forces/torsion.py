"""A spring and damper against rotation between two bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from pydantic import Field

from ..axes import Vector
from ..entries import ZERO, Axis, Expr, FaceOrName
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Face
from .force_element import ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class Torsion(ForceElement):
    """A spring and damper against rotation between two bodies.

    C is the rotation matrix of the end's face relative to the start's; the axis a has the same components in both. The angle is

        atan2(a . (C_zy - C_yz, C_xz - C_zx, C_yx - C_xy), tr C - a . C a),

    the twist about the axis if a rotation is decomposed into a twist and a swing; in a revolute joint it is the joint angle.
    A torque ``stiffness (angle - free_angle) + damping angle'``, N m, acts against rotation of the end, along the gradient of the
    angle with respect to rotations of the end. The opposite acts on the start. The coefficients are expressions of p, inputs, t.
    """

    type: ClassVar[str] = "torsion"
    keys: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "free_angle")
    has_energy: ClassVar[bool] = True
    singular: ClassVar[str] = (
        "one end is turned by half a turn about a line across its axis, so its angle is not determined"
    )

    start: Face
    end: Face
    about: Vector
    stiffness: Expression
    damping: Expression
    free_angle: Expression

    @property
    def ends(self) -> tuple[Face, ...]:
        return self.start, self.end

    @property
    def axis(self) -> Vector:
        return self.about


class TorsionEntry(ForceEntry):
    placeholders: ClassVar[dict[str, Any]] = {"from": "ground", "to": "ground", "axis": "x", "stiffness": "0"}
    misspelt: ClassVar[dict[str, str]] = {"free_length": "free_angle"}

    units: ClassVar[Mapping[str, str]] = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "free_angle": "rad"}

    type: Literal["torsion"]
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")
    axis: Axis
    stiffness: Expr
    damping: Expr = ZERO
    free_angle: Expr = ZERO

    def read(self, x: EntryReader) -> Torsion | None:
        start, end = x.face(self.start, "from"), x.face(self.end, "to")
        axis = x.direction(self.axis, "axis")
        stiffness, damping, free_angle = (x.bound(getattr(self, key), key, scope="inputs") for key in Torsion.keys)
        if start is None or end is None or not x.is_whole(self):
            return None
        if x.held_together(f"torsion {x.name!r}", start, end, "turns nothing"):
            return None
        return Torsion(x.name, start, end, axis, stiffness, damping, free_angle)
