"""A force on a body, through one of its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from ..entries import Expr, PointOrName
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Face, Point
from .force_element import AxesOf, ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class Force(ForceElement):
    """A force through a point of a body, N.

    Its components are along the axes of the ground, or, with ``axes`` "body", of the body: expressions of p, inputs, t, q.x, u.x
    and of positions and velocities of points.
    """

    type: ClassVar[str] = "force"
    keys: ClassVar[tuple[str, ...]] = ("value[0]", "value[1]", "value[2]")

    on: Point
    value: tuple[Expression, Expression, Expression]
    axes: str = "ground"

    @property
    def ends(self) -> tuple[Point | Face, ...]:
        return (Face(self.on.body, self.on.at) if self.axes == "body" else self.on,)

    @property
    def remarks(self) -> tuple[str, ...]:
        return (f"in axes of the {self.axes}",)

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return self.value


class ForceOnBodyEntry(ForceEntry):
    placeholders: ClassVar[dict[str, Any]] = {"on": "ground", "value": ["0", "0", "0"]}
    misspelt: ClassVar[dict[str, str]] = {"at": "on", "point": "on", "body": "on", "force": "value"}

    type: Literal["force"]
    on: PointOrName
    value: tuple[Expr, Expr, Expr]
    axes: AxesOf = "ground"

    def read(self, x: EntryReader) -> Force | None:
        on = x.point(self.on, "on", f"{x.name}.on")
        a, b, c = (x.bound(e, "value", i, scope="measured") for i, e in enumerate(self.value))
        if on is None or not x.is_whole(self) or x.unmoved(f"force {x.name!r}", on, "on"):
            return None
        return Force(x.name, on, (a, b, c), self.axes, measured=x.measured(a, b, c))
