"""Stores: the memory, arguments and results that a block reads and writes.

A store says which object's memory is accessed (`Owner`) and which sort of memory it is (`Memory`). The mechanics
decides once where the memory lies; the stores of the mechanics are listed in `codegen.mechanics.stores`. This module
has the stores that blocks of any program may use.
"""

from __future__ import annotations

from dataclasses import field
from enum import Enum

from ..records import dataclass


class Life(Enum):
    """Lifetime of the values in a memory."""

    CALL = "for one call"
    SWEEP = "while neighbours need them, within one sweep"
    OUTSIDE = "by the caller, or for ever"


@dataclass(frozen=True, eq=False)
class Memory:
    """A sort of memory.

    Attributes
    ----------
    name : str
    lanes : bool
        One value per direction.
    life : Life
    region : str
        Name of the region in targets, if the layout assigns places to its fields.
    """

    name: str
    lanes: bool = False
    life: Life = Life.CALL
    region: str = ""

    def __repr__(self) -> str:
        return self.name


@dataclass(frozen=True, eq=False)
class Owner:
    """The object whose memory a block accesses: its own link, its parent, a loop, ...

    Attributes
    ----------
    name : str
    several : bool
        Whether a block may access several of them; their stores are numbered, ``ROOT[1]``.
    """

    name: str
    several: bool = False

    def __repr__(self) -> str:
        return self.name


@dataclass(frozen=True, eq=False)
class Store:
    """A store: memory, as a block addresses it.

    Attributes
    ----------
    name : str
        Part of the names of generated variables.
    owner : Owner
    memory : Memory
    adds : bool
        Whether storing adds to the stored value.
    place : int or None
        Number of the object, for owners with several.
    """

    name: str
    owner: Owner
    memory: Memory
    adds: bool = False
    place: int | None = None
    _others: dict[object, Store] = field(default_factory=dict, repr=False)

    @property
    def lanes(self) -> bool:
        """Whether the memory has one value per direction."""
        return self.memory.lanes

    @property
    def label(self) -> str:
        """Name and place of the store, such as ``root#1``."""
        return self.name if self.place is None else f"{self.name}#{self.place}"

    def __getitem__(self, place: int) -> Store:
        """The store of one of several objects; the same object each time."""
        found = self._others.get(place)
        if found is None:
            found = self._others[place] = Store(self.name, self.owner, self.memory, self.adds, place)
            if self.adds:
                found._others["plain"] = self.plain[place]
        return found

    @property
    def sum(self) -> Store:
        """This store in the form that adds values to its memory."""
        found = self._others.get("sum")
        if found is None:
            found = self._others["sum"] = Store(self.name, self.owner, self.memory, True, self.place)
            found._others["plain"] = self
        return found

    @property
    def plain(self) -> Store:
        """This store in the form that overwrites its memory."""
        return self._others["plain"] if self.adds else self

    def __repr__(self) -> str:
        return self.label + ("_sum" if self.adds else "")


CONSTANT = Memory("constants", life=Life.OUTSIDE)
ARGUMENT, ARGUMENT_LANE = Memory("arguments", life=Life.OUTSIDE), Memory("arguments", True, Life.OUTSIDE)
MARGIN = Memory("margins")
"""Margins that must be positive. Margins are not stored: a function stops if a margin is not positive."""

MODEL = Owner("model")
SHAPE = Store("pc", MODEL, CONSTANT)
"""The constants that the block of a shape computes."""
NUMBER = Store("k", MODEL, Memory("numbers", life=Life.OUTSIDE))
"""Numbers in a row of a table."""


def argument(name: str, lanes: bool = False) -> Store:
    """An argument or a result of the whole model by name, such as ``p`` or ``outputs``; the same object each time."""
    found = _ARGUMENTS.get((name, lanes))
    if found is None:
        found = _ARGUMENTS[name, lanes] = Store(name, MODEL, ARGUMENT_LANE if lanes else ARGUMENT)
    return found


_ARGUMENTS: dict[tuple[str, bool], Store] = {}


MODES = argument("modes")
"""Modes of the model's switches: the sign that an integration step assumes for each switching function, or 0 for none."""
