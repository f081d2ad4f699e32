"""What a force element is: an entry of a model file, and what that makes of it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

from ..entries import Entry
from ..entry_reader import EntryReader
from ..expressions import Expression
from ..places import Point


@dataclass(frozen=True, slots=True, eq=False)
class ForceElement:
    """Forces and torques that act on bodies, or on the speeds of a joint."""

    name: str

    @property
    def ends(self) -> tuple[Point, ...]:
        """Where it acts on bodies, or on the ground."""
        return ()

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        """What its law is made of."""
        return ()

    def expressions(self) -> Iterator[Expression]:
        for point in self.ends:
            yield from point.at
        yield from self.coefficients


class ForceEntry(Entry):
    """The entry of a force element; a subclass has a field for each key."""

    @abstractmethod
    def read(self, x: EntryReader) -> ForceElement | None:
        """The element, or None after a problem."""
