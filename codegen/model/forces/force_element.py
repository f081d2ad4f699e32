"""What a force element is: an entry of a model file, and what that makes of it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from ..axes import Vector
from ..entries import Entry
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Face, Point


@dataclass(frozen=True, slots=True, eq=False)
class ForceElement:
    """Forces and torques that act on bodies, or on the speeds of a joint.

    Attributes
    ----------
    type : str
        What a model file calls it, and people too.
    keys : tuple of str
        Where each of the coefficients stands in its entry.
    has_energy : bool
        It has a potential energy; its coefficients are then expressions of parameters, inputs and t alone.
    singular : str
        What is wrong where it has no direction, such as ``its ends coincide, so its force has no direction``; empty where it
        always has one.
    measured : tuple of Point
        The points whose position and velocity its coefficients contain, as ``position.NAME.x`` and ``velocity.NAME.x``.
    """

    type: ClassVar[str]
    keys: ClassVar[tuple[str, ...]] = ()
    has_energy: ClassVar[bool] = False
    singular: ClassVar[str] = ""

    name: str
    measured: tuple[Point, ...] = field(default=(), kw_only=True)

    @property
    def ends(self) -> tuple[Point | Face, ...]:
        """Where it acts on bodies, or on the ground; faces where the axes of the body matter."""
        return ()

    @property
    def axis(self) -> Vector | None:
        """A direction in the axes of its faces that its law singles out; it becomes one of their base vectors."""
        return None

    @property
    def variant(self) -> tuple[object, ...]:
        """What else its law depends on but for numbers; only elements of equal ones share generated code."""
        return ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """What else is to be told to people."""
        return ()

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        """What its law is made of; where they are fields, these are called as the keys are."""
        return tuple(getattr(self, key) for key in self.keys)

    def expressions(self) -> Iterator[Expression]:
        for place in (*self.ends, *self.measured):
            yield from place.at
            if isinstance(place, Face):
                for axis, angle in place.rotation:
                    yield from (*axis, angle)
        yield from self.axis or ()
        yield from self.coefficients


class ForceEntry(Entry):
    """The entry of a force element; a subclass has a field for each key.

    Attributes
    ----------
    units : mapping of str to str
        Of its numbers, by key, for those that are written with a unit.
    """

    units: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def read(self, x: EntryReader) -> ForceElement | None:
        """The element, or None after a problem."""
