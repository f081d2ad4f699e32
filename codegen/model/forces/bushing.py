"""A bushing: springs and dampers along and about three axes between two bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

from pydantic import Field

from ..axes import Vector as Components
from ..entries import FaceOrName, Origin, Vector
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Face, Point
from .force_element import ForceElement, ForceEntry

LISTS: Final = ("stiffness", "damping", "preload", "rotational_stiffness", "rotational_damping", "rotational_preload")
"""Keys of an entry; each has one number for each axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Bushing(ForceElement):
    """Springs and dampers along and about the axes x, y, z of the first end.

    d is the vector from the start to the end, and v its rate, both in the axes of the start. r is the rotation vector of the
    end's face relative to the start's (axis times angle, below half a turn), and G = dr/d(rotation). w is the angular velocity of
    the end relative to the start. On the end act, component by component along the axes of the start,

        force = preload - stiffness d - damping v,   N
        torque = G^T (rotational_preload - rotational_stiffness r) - rotational_damping w,   N m

    and the opposite on the start, at the position of the end. So at rest the faces coincide, and the part without damping has a
    potential energy in every pose. The coefficients are expressions of p, inputs and t; a row of zeros is omitted.

    This is the BUSHING of Adams/Solver, in the axes of its J marker, with the rotation vector in place of its small angles, as
    in the deformable joint of MBDyn.
    """

    type: ClassVar[str] = "bushing"
    keys: ClassVar[tuple[str, ...]] = tuple(f"{name}[{i}]" for name in LISTS for i in range(3))
    has_energy: ClassVar[bool] = True
    singular: ClassVar[str] = "one end is turned by half a turn, so its rotation axis is not determined"

    start: Face
    end: Face
    values: tuple[Components, ...]

    @property
    def turns(self) -> bool:
        """Whether a torque depends on the rotation angle; dampers alone need no angle."""
        return any(
            not e.is_number or e.value != 0
            for key in ("rotational_stiffness", "rotational_preload")
            for e in self.values[LISTS.index(key)]
        )

    @property
    def ends(self) -> tuple[Point | Face, ...]:
        return self.start, self.end if self.turns else Point("", self.end.body, self.end.at)

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return tuple(e for components in self.values for e in components)


class BushingEntry(ForceEntry):
    placeholders: ClassVar[dict[str, Any]] = {"from": "ground", "to": "ground"}
    misspelt: ClassVar[dict[str, str]] = {
        "force": "preload",
        "torque": "rotational_preload",
        "torsional_stiffness": "rotational_stiffness",
        "torsional_damping": "rotational_damping",
    }
    units: ClassVar[Mapping[str, str]] = {
        "stiffness": "N/m",
        "damping": "N*s/m",
        "preload": "N",
        "rotational_stiffness": "N*m/rad",
        "rotational_damping": "N*m*s/rad",
        "rotational_preload": "N*m",
    }

    type: Literal["bushing"]
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")
    stiffness: Vector = Origin
    damping: Vector = Origin
    preload: Vector = Origin
    rotational_stiffness: Vector = Origin
    rotational_damping: Vector = Origin
    rotational_preload: Vector = Origin

    def read(self, x: EntryReader) -> Bushing | None:
        start, end = x.face(self.start, "from"), x.face(self.end, "to")
        values = []
        for key in LISTS:
            a, b, c = (x.bound(e, key, i, scope="inputs") for i, e in enumerate(getattr(self, key)))
            values.append((a, b, c))
        if start is None or end is None or not x.is_whole(self):
            return None
        if x.held_together(f"bushing {x.name!r}", start, end, "moves nothing"):
            return None
        if all(e.is_number and e.value == 0 for key in LISTS for e in getattr(self, key)):
            x.report(
                (),
                f"every coefficient of bushing {x.name!r} is zero, so it does nothing; give one of {', '.join(LISTS)}",
            )
            return None
        return Bushing(x.name, start, end, tuple(values))
