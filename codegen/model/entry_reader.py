"""The interface by which force elements and outputs read their entries; `sections.meaning` implements it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from .axes import Vector
from .entries import Entry
from .expressions import Expression
from .motions import Motion
from .places import Face, Point


class NamedJoint(NamedTuple):
    """A joint to which an entry refers: its name, body, type, and the names of its speeds."""

    name: str
    body: int
    type: str
    speeds: tuple[str, ...]


class EntryReader(Protocol):
    """Reads the expressions and references of one entry, and reports errors.

    A path leads from the entry to a value; a key is a path of length one.
    """

    @property
    def name(self) -> str:
        """The entry's own name; empty if it is wrong."""

    def is_whole(self, entry: Entry) -> bool:
        """Whether everything in the entry, including its name, is written correctly."""

    def bound(self, expression: Expression, *path: str | int, scope: str) -> Expression:
        """The expression with constants as numbers, and its names checked. It may contain the names of a scope: ``parameters``,
        ``inputs``, ``motion``, or ``measured``, which adds positions and velocities of points."""

    def direction(self, axis: Vector, key: str) -> Vector:
        """An axis as an expression of parameters; an error if its length is zero."""

    def point(self, point: Any, key: str | tuple[str | int, ...], name: str) -> Point | None:
        """The point that a mapping or a name denotes; None after an error. A point without a name gets `name`."""

    def measured(self, *expressions: Expression) -> tuple[Point, ...]:
        """The points whose positions or velocities occur in the expressions, each once."""

    def unmoved(self, what: str, place: Point | Face, key: str) -> bool:
        """Whether a place is on the ground or rigidly connected to it; reports an error if so."""

    def face(self, face: Any, key: str) -> Face | None:
        """The face that a mapping or a name denotes; None after an error."""

    def body(self, reference: Expression, *path: str | int) -> int | None:
        """Index of the named body, `GROUND` for the ground; None after an error."""

    def mass(self, bodies: Sequence[int] | None = None) -> float | None:
        """Total mass of some or all bodies at the default parameters, kg; None if a body has an error."""

    def joint(self, reference: Expression, key: str, entry: Entry) -> NamedJoint | None:
        """The named joint; None if it or the entry has errors."""

    def placed(self, joint: NamedJoint) -> tuple[Face, Face, tuple[Motion, ...], tuple[Vector, ...]]:
        """The frames of a joint in its body and in the parent, the joint's motion, and its axes."""

    def prescribed(self, reference: Expression, key: str) -> tuple[str, str] | None:
        """The named prescribed coordinate, and the unit of a force along it; None after an error."""

    def held_together(self, what: str, start: Point | Face, end: Point | Face, useless: str) -> bool:
        """Whether two bodies cannot move relative to each other; reports an error if so."""

    def report(self, path: tuple[str | int, ...], message: str) -> None:
        """Report an error."""
