"""Base classes of force elements and of their entries in a model file."""

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
        Type name in a model file and in messages.
    keys : tuple of str
        Path of each coefficient in the entry.
    has_energy : bool
        Whether it has a potential energy; its coefficients then depend on parameters, inputs and t only.
    singular : str
        Message for configurations without a direction, such as ``its ends coincide, so its force has no direction``; empty if
        there are none.
    measured : tuple of Point
        Points whose positions and velocities its coefficients contain, as ``position.NAME.x`` and ``velocity.NAME.x``.
    """

    type: ClassVar[str]
    keys: ClassVar[tuple[str, ...]] = ()
    has_energy: ClassVar[bool] = False
    singular: ClassVar[str] = ""

    name: str
    measured: tuple[Point, ...] = field(default=(), kw_only=True)

    @property
    def ends(self) -> tuple[Point | Face, ...]:
        """Attachment points on bodies or on the ground; faces where the axes of the body matter."""
        return ()

    @property
    def axis(self) -> Vector | None:
        """A direction that the law needs, in the axes of the element's faces; it becomes a base vector of the faces."""
        return None

    @property
    def needs_direction(self) -> bool:
        """Whether there are configurations without a direction or an angle that the law needs; see `singular`."""
        return bool(self.singular)

    @property
    def variant(self) -> tuple[object, ...]:
        """Non-numerical properties of the law; only elements with equal properties share generated code."""
        return ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Further properties of the element, in words, for reports."""
        return ()

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        """Coefficients of the law; the fields have the names of the keys."""
        return tuple(getattr(self, key) for key in self.keys)

    @property
    def zeros(self) -> dict[str, int]:
        """Coefficients that are the number zero, by key."""
        return {key: 0 for key, e in zip(self.keys, self.coefficients, strict=True) if e.is_number and e.value == 0}

    def expressions(self) -> Iterator[Expression]:
        for place in (*self.ends, *self.measured):
            yield from place.at
            if isinstance(place, Face):
                for axis, angle in place.rotation:
                    yield from (*axis, angle)
        yield from self.axis or ()
        yield from self.coefficients


class ForceEntry(Entry):
    """The entry of a force element; a subclass has a field for each key of the file.

    Attributes
    ----------
    units : mapping of str to str
        Units of its numbers by key, for numbers that are written with a unit.
    """

    units: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def read(self, x: EntryReader) -> ForceElement | None:
        """The element that the entry describes; None after an error."""
