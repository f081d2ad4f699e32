"""Stores: what a block calls the memory, the arguments and the results that it reads and writes.

A store says whose memory is meant (`Owner`) and of which sort it is (`Memory`); where that lies is decided once, by the
mechanics, whose stores are listed in `codegen.mechanics.stores`. Those that blocks of any program may have stand here.
"""

from __future__ import annotations

from dataclasses import field
from enum import Enum

from ..records import dataclass


class Life(Enum):
    """How long values are kept."""

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
        Of memory whose fields the layout gives places to: what targets call it.
    """

    name: str
    lanes: bool = False
    life: Life = Life.CALL
    region: str = ""

    def __repr__(self) -> str:
        return self.name


@dataclass(frozen=True, eq=False)
class Owner:
    """Whose memory a block means: its own link's, its parent's, a loop's, ...

    Attributes
    ----------
    name : str
    several : bool
        A block may know several of them: stores of it have a place, ``ROOT[1]``.
    """

    name: str
    several: bool = False

    def __repr__(self) -> str:
        return self.name


@dataclass(frozen=True, eq=False)
class Store:
    """Memory as a block sees it.

    Attributes
    ----------
    name : str
        In the names of generated variables.
    owner : Owner
    memory : Memory
    adds : bool
        Storing adds to what is there.
    place : int or None
        Which one, of an owner of which a block knows several.
    """

    name: str
    owner: Owner
    memory: Memory
    adds: bool = False
    place: int | None = None
    _others: dict[object, Store] = field(default_factory=dict, repr=False)

    @property
    def lanes(self) -> bool:
        """One value per direction."""
        return self.memory.lanes

    @property
    def label(self) -> str:
        """Name and place, ``root#1``."""
        return self.name if self.place is None else f"{self.name}#{self.place}"

    def __getitem__(self, place: int) -> Store:
        """The same of one of several; the same object each time."""
        found = self._others.get(place)
        if found is None:
            found = self._others[place] = Store(self.name, self.owner, self.memory, self.adds, place)
            if self.adds:
                found._others["plain"] = self.plain[place]
        return found

    @property
    def sum(self) -> Store:
        """The same, added to."""
        found = self._others.get("sum")
        if found is None:
            found = self._others["sum"] = Store(self.name, self.owner, self.memory, True, self.place)
            found._others["plain"] = self
        return found

    @property
    def plain(self) -> Store:
        """The same, not added to."""
        return self._others["plain"] if self.adds else self

    def __repr__(self) -> str:
        return self.label + ("_sum" if self.adds else "")


CONSTANT = Memory("constants", life=Life.OUTSIDE)
ARGUMENT, ARGUMENT_LANE = Memory("arguments", life=Life.OUTSIDE), Memory("arguments", True, Life.OUTSIDE)
MARGIN = Memory("margins")
"""What must be positive: nothing is stored, a function stops where it is not."""

MODEL = Owner("model")
SHAPE = Store("pc", MODEL, CONSTANT)
"""The constants that a shape's block computes."""
NUMBER = Store("k", MODEL, Memory("numbers", life=Life.OUTSIDE))
"""Numbers of a row of a table."""


def argument(name: str, lanes: bool = False) -> Store:
    """An argument or a result of the whole model, such as ``p`` or ``outputs``, by name; the same object each time."""
    found = _ARGUMENTS.get((name, lanes))
    if found is None:
        found = _ARGUMENTS[name, lanes] = Store(name, MODEL, ARGUMENT_LANE if lanes else ARGUMENT)
    return found


_ARGUMENTS: dict[tuple[str, bool], Store] = {}


MODES = argument("modes")
"""Of the switches of a model: the sign of each switching function that a step of an integrator goes on with, or zero."""
