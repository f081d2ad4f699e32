"""A force along the line between two points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from pydantic import Field

from ..entries import Expr, PointOrName
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Point
from .force_element import ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class Actuator(ForceElement):
    """A force along the line between two points, N; positive drives them apart.

    So it does the work ``force d'`` per second, d the distance, as a joint force does with a sliding joint in its place. An
    expression of p, inputs, t, q.x, u.x and of positions and velocities of points.
    """

    type: ClassVar[str] = "actuator"
    keys: ClassVar[tuple[str, ...]] = ("force",)
    singular: ClassVar[str] = "its ends coincide, so its force has no direction"

    start: Point
    end: Point
    force: Expression

    @property
    def ends(self) -> tuple[Point, ...]:
        return self.start, self.end

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return (self.force,)


class ActuatorEntry(ForceEntry):
    placeholders: ClassVar[dict[str, Any]] = {"from": "ground", "to": "ground", "force": "0"}
    misspelt: ClassVar[dict[str, str]] = {"value": "force"}

    type: Literal["actuator"]
    start: PointOrName = Field(alias="from")
    end: PointOrName = Field(alias="to")
    force: Expr

    def read(self, x: EntryReader) -> Actuator | None:
        start, end = (x.point(point, key, f"{x.name}.{key}") for point, key in ((self.start, "from"), (self.end, "to")))
        force = x.bound(self.force, "force", scope="measured")
        if start is None or end is None or not x.is_whole(self):
            return None
        if x.held_together(f"actuator {x.name!r}", start, end, "moves nothing"):
            return None
        return Actuator(x.name, start, end, force, measured=x.measured(force))
