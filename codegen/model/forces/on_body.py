"""Forces and torques on one body, by components along axes of the ground or of the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from ..entries import PointOrName, Vector, one_of
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Face, Point
from .force_element import ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class OnBody(ForceElement):
    """A force or torque vector on a body.

    Its components are along the axes of the ground or, if ``axes`` is "body", of the body. They are expressions of p, inputs, t,
    q.x, u.x, and positions and velocities of points.
    """

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


class OnBodyEntry(ForceEntry):
    """Entry of a force or torque on a body; `element` is the class of the element."""

    placeholders: ClassVar[dict[str, Any]] = {"on": "ground", "value": ["0", "0", "0"]}
    element: ClassVar[type[OnBody]]

    on: PointOrName
    value: Vector
    axes: Annotated[str, one_of("ground", "body", what="along whose axes the components are")] = "ground"

    def read(self, x: EntryReader) -> OnBody | None:
        on = x.point(self.on, "on", f"{x.name}.on")
        a, b, c = (x.bound(e, "value", i, scope="measured") for i, e in enumerate(self.value))
        if on is None or not x.is_whole(self) or x.unmoved(f"{self.element.type} {x.name!r}", on, "on"):
            return None
        return self.element(x.name, on, (a, b, c), self.axes, measured=x.measured(a, b, c))


@dataclass(frozen=True, slots=True, eq=False)
class Force(OnBody):
    """A force through a point of a body, N."""

    type: ClassVar[str] = "force"


class ForceOnBodyEntry(OnBodyEntry):
    misspelt: ClassVar[dict[str, str]] = {"at": "on", "point": "on", "body": "on", "force": "value"}
    units: ClassVar[Mapping[str, str]] = {"value": "N"}
    element: ClassVar[type[OnBody]] = Force

    type: Literal["force"]


@dataclass(frozen=True, slots=True, eq=False)
class Torque(OnBody):
    """A torque on a body, N m; its point of application is irrelevant."""

    type: ClassVar[str] = "torque"


class TorqueEntry(OnBodyEntry):
    misspelt: ClassVar[dict[str, str]] = {"body": "on", "torque": "value", "moment": "value"}
    units: ClassVar[Mapping[str, str]] = {"value": "N*m"}
    element: ClassVar[type[OnBody]] = Torque

    type: Literal["torque"]
