"""The plan of a solver: its statements by sweep and kind, and where values lie. Targets print it and know nothing else of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..records import dataclass
from .addresses import Addresses, Kind
from .block import Block
from .formula import Formula
from .layout import Layout
from .procedure import Array
from .shape import Constants, Shape
from .store import Memory, Store


@dataclass(frozen=True, slots=True)
class Merged:
    """The blocks of a sweep as one block.

    Attributes
    ----------
    block : Block
    of : dict of Store to (Kind, Store)
        What each of its stores is in the blocks of a kind.
    names : set of (Memory, str)
        Components that it loads or stores.
    ground : set of (Memory, str)
        Components of the ground's records that it reads; those of gravity it reads elsewhere.
    """

    block: Block
    of: dict[Store, tuple[Kind, Store]]
    names: set[tuple[Memory, str]]
    ground: set[tuple[Memory, str]]


@dataclass(frozen=True, slots=True)
class Swept:
    """What a sweep goes over.

    Attributes
    ----------
    title : str
    lanes, inward : bool
        It runs over directions; from the tips to the ground.
    groups : str
        Of sweeps over all columns of a matrix at once: on which of them a link works.
    then : str
        Sweep whose function of a link is called after each of this one.
    kinds : sequence of Kind
        Those that may have a block.
    order : sequence of Kind
        Of what it goes over, one after the other.
    blocks : dict of int to Block
        By the index of a kind.
    merged : Merged or None
        All of these as one block, where the sweep is printed so.
    """

    title: str
    lanes: bool
    inward: bool
    groups: str
    then: str
    kinds: Sequence[Kind]
    order: Sequence[Kind]
    blocks: dict[int, Block]
    merged: Merged | None = None


@dataclass(frozen=True, slots=True)
class Ground:
    """What is known of the ground, whose row comes after those of the links.

    Attributes
    ----------
    fields : dict of str to float or str
        Components that are read: a number, or which component of `gravity` it is.
    kept : set of str
        Those of them that sweeps run backwards read again.
    gravity : dict of str to float or str
        Minus the acceleration of gravity: a number, or which of `constants` it is. Empty without gravity.
    constants : Constants or None
        Those of gravity.
    tangents : list of (str, list of (float or str, int))
        Components whose tangent is not zero: a number or constant for each parameter that it depends on.
    sweeps : tuple of str
        Those that begin with the tangent.
    """

    fields: dict[str, float | str]
    kept: set[str]
    gravity: dict[str, float | str]
    constants: Constants | None
    tangents: list[tuple[str, list[tuple[float | str, int]]]]
    sweeps: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan of a solver.

    Attributes
    ----------
    sweeps : dict of str to Swept
    formulas : list of Formula
        Joint forces, outputs and the like.
    links : list of str
        Names of links.
    called : mapping of Kind to (str, str)
        What its members are, in the plural, and the name of the first.
    constants, shapes : list
        In the order of their indices.
    owners : list of (str, Constants)
        Whose constants which are.
    ground : Ground
    arguments : dict of str to Array
        Arguments and results.
    arrays : dict of str to int
        Arrays that are found before sweeps or by them, and their sizes.
    layout : Layout
    addresses : callable (bool) -> Addresses
        For a target whose places in memory are numbers, or names.
    """

    sweeps: dict[str, Swept]
    formulas: list[Formula]
    links: list[str]
    called: Mapping[Kind, tuple[str, str]]
    constants: list[Constants]
    shapes: list[Shape]
    owners: list[tuple[str, Constants]]
    ground: Ground
    arguments: dict[str, Array]
    arrays: dict[str, int]
    layout: Layout
    addresses: Callable[[bool], Addresses]


__all__ = ["Ground", "Merged", "Plan", "Swept"]
