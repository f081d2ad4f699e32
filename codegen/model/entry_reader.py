"""What force elements and outputs need to read themselves; `sections.meaning` provides it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from .axes import Vector
from .entries import Entry
from .expressions import Expression
from .motions import Motion
from .places import Face, Point


class NamedJoint(NamedTuple):
    """A joint that an entry names: its name, body, type, and the names of its speeds."""

    name: str
    body: int
    type: str
    speeds: tuple[str, ...]


class EntryReader(Protocol):
    """Reads the expressions and references of one entry, and reports what is wrong with them.

    A path leads from the entry to a value; a key is one of length one.
    """

    @property
    def name(self) -> str:
        """The entry's own name; empty if that is wrong."""

    def is_whole(self, entry: Entry) -> bool:
        """Whether nothing in it, its name included, was wrong as written."""

    def bound(self, expression: Expression, *path: str | int, scope: str) -> Expression:
        """With constants as numbers and names checked: ``parameters``, ``inputs`` or ``motion`` may stand in it, or ``measured``,
        what points do, too."""

    def direction(self, axis: Vector, key: str) -> Vector:
        """An axis of parameters, which has to have a length."""

    def point(self, point: Any, key: str | tuple[str | int, ...], name: str) -> Point | None:
        """What a mapping or a name means, or None after a problem; a point without a name gets this one."""

    def measured(self, *expressions: Expression) -> tuple[Point, ...]:
        """The points whose positions or velocities stand in them, each once."""

    def unmoved(self, what: str, place: Point | Face, key: str) -> bool:
        """Whether that place is on the ground, or held by it, which is reported."""

    def face(self, face: Any, key: str) -> Face | None:
        """What a mapping or a name means as a place with axes, or None after a problem."""

    def body(self, reference: Expression, *path: str | int) -> int | None:
        """Index of the body that is named, `GROUND` for the ground, or None after a problem."""

    def mass(self, bodies: Sequence[int] | None = None) -> float | None:
        """What bodies, or all, weigh together at the default parameters, kg; None where something is wrong with them."""

    def joint(self, reference: Expression, key: str, entry: Entry) -> NamedJoint | None:
        """The joint that is named, or None after a problem with it or with the entry."""

    def placed(self, joint: NamedJoint) -> tuple[Face, Face, tuple[Motion, ...], tuple[Vector, ...]]:
        """The frames of a joint in its body and in the parent, its motion, and its axes."""

    def prescribed(self, reference: Expression, key: str) -> tuple[str, str] | None:
        """The prescribed coordinate that is named, and the unit of a force along it, or None after a problem."""

    def held_together(self, what: str, start: Point | Face, end: Point | Face, useless: str) -> bool:
        """Whether two bodies cannot move against each other, which is reported."""

    def report(self, path: tuple[str | int, ...], message: str) -> None:
        """Something wrong."""
