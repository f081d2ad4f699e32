"""A spring and damper between two points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from pydantic import Field

from ..entries import ZERO, Expr, PointOrName
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Point
from .force_element import ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class Spring(ForceElement):
    """A spring and damper between two points.

    It pulls the points towards each other by ``stiffness (d - free_length) + damping d'``, d the distance, N. The
    coefficients are expressions of p, inputs and t.
    """

    type: ClassVar[str] = "spring"
    keys: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "free_length")
    has_energy: ClassVar[bool] = True
    singular: ClassVar[str] = "its ends coincide, so its force has no direction"

    start: Point
    end: Point
    stiffness: Expression
    damping: Expression
    free_length: Expression

    @property
    def ends(self) -> tuple[Point, ...]:
        return self.start, self.end

    @property
    def needs_direction(self) -> bool:
        return not {"damping", "free_length"} <= self.zeros.keys()


class SpringEntry(ForceEntry):
    placeholders: ClassVar[dict[str, Any]] = {"from": "ground", "to": "ground", "stiffness": "0"}

    units: ClassVar[Mapping[str, str]] = {"stiffness": "N/m", "damping": "N*s/m", "free_length": "m"}

    type: Literal["spring"]
    start: PointOrName = Field(alias="from")
    end: PointOrName = Field(alias="to")
    stiffness: Expr
    damping: Expr = ZERO
    free_length: Expr = ZERO

    def read(self, x: EntryReader) -> Spring | None:
        start, end = (x.point(point, key, f"{x.name}.{key}") for point, key in ((self.start, "from"), (self.end, "to")))
        stiffness, damping, free_length = (x.bound(getattr(self, key), key, scope="inputs") for key in Spring.keys)
        if start is None or end is None or not x.is_whole(self):
            return None
        if x.held_together(f"spring {x.name!r}", start, end, "moves nothing"):
            return None
        return Spring(x.name, start, end, stiffness, damping, free_length)
