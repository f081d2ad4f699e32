"""Force elements of the laws along a line: for each law its element class and its entry in a model file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

from pydantic import Field, create_model

from ..binding import bind
from ..entries import Expr, PointOrName
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..grammar import ExpressionError
from ..places import Point
from .force_element import ForceElement, ForceEntry
from .line_law import LineLaw, in_squares
from .line_laws import LINE_LAWS


@dataclass(frozen=True, slots=True, eq=False)
class AlongLine(ForceElement):
    """A force along the line between two points, by a law; each law has a subclass."""

    singular: ClassVar[str] = "its ends coincide, so its force has no direction"
    law: ClassVar[LineLaw]

    start: Point
    end: Point
    values: tuple[Expression, ...]

    @property
    def ends(self) -> tuple[Point, ...]:
        return self.start, self.end

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return self.values

    @property
    def needs_direction(self) -> bool:
        return in_squares(bind(self.law.formula, self.zeros), 1) is None


class AlongLineEntry(ForceEntry):
    """Entry of a force along a line; each law has a subclass with its coefficients as fields."""

    element: ClassVar[type[AlongLine]]

    type: str
    start: PointOrName = Field(alias="from")
    end: PointOrName = Field(alias="to")

    def read(self, x: EntryReader) -> AlongLine | None:
        law = self.element.law
        start, end = (x.point(point, key, f"{x.name}.{key}") for point, key in ((self.start, "from"), (self.end, "to")))
        scope = "inputs" if law.energy else "measured"
        values = tuple(x.bound(getattr(self, _field(key)), key, scope=scope) for key in law.coefficients)
        if start is None or end is None or not x.is_whole(self):
            return None
        if x.held_together(f"{law.type} {x.name!r}", start, end, "moves nothing"):
            return None
        numbers = {key: e.value for key, e in zip(law.coefficients, values, strict=True) if e.is_number}
        for formula in filter(None, (law.formula, law.potential)):
            try:
                bind(formula, numbers)
            except ExpressionError as error:
                x.report((), f"{law.type}, {formula}: {error.message}; change its numbers")
                return None
        return self.element(x.name, start, end, values, measured=x.measured(*values))


def _field(key: str) -> str:
    """Name of the field of a coefficient; the prefix permits keys that Pydantic reserves."""
    return f"coefficient_{key}"


def element_of(law: LineLaw) -> type[AlongLine]:
    """The element class of a force law along a line."""
    name = "".join(map(str.capitalize, law.type.split("_")))
    contents = {
        "__slots__": (), "__module__": __name__, "__doc__": law.meaning,
        "law": law, "type": law.type, "keys": tuple(law.coefficients), "has_energy": bool(law.energy),
    }  # fmt: skip
    return type(name, (AlongLine,), contents)


def entry_of(element: type[AlongLine]) -> type[AlongLineEntry]:
    """The entry class that belongs to an element class."""
    law = element.law
    fields: dict[str, Any] = {"type": (Literal[law.type], ...)}
    for key, c in law.coefficients.items():
        default = ... if c.default is None else Expression.number(c.default)
        fields[_field(key)] = (Expr, Field(default, alias=key))
    made = create_model(f"{element.__name__}Entry", __base__=AlongLineEntry, __module__=__name__, **fields)
    made.element = element
    made.units = {key: c.unit for key, c in law.coefficients.items()}
    made.misspelt = dict(law.misspelt)
    needed = {key: "1" for key, c in law.coefficients.items() if c.default is None}
    made.placeholders = {"from": "ground", "to": "ground", **needed}
    return made


ALONG_LINES: Final[dict[str, type[AlongLine]]] = {name: element_of(law) for name, law in LINE_LAWS.items()}
"""Element classes of laws along a line, by type."""

globals().update(
    {element.__name__: element for element in ALONG_LINES.values()}
)  # pickle finds the classes here by these names

ENTRIES: Final[tuple[type[ForceEntry], ...]] = tuple(entry_of(element) for element in ALONG_LINES.values())
