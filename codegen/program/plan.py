"""The plan of a solver: its statements by sweep and kind, and the places of values. Targets print it and use nothing else."""

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
    """All blocks of a sweep, merged into one block.

    Attributes
    ----------
    block : Block
    of : dict of Store to (Kind, Store)
        For each store of the merged block: a kind, and the store in the block of this kind.
    names : set of (Memory, str)
        Components that the merged block loads or stores.
    ground : set of (Memory, str)
        Components of the ground's records that the merged block reads, except gravity.
    """

    block: Block
    of: dict[Store, tuple[Kind, Store]]
    names: set[tuple[Memory, str]]
    ground: set[tuple[Memory, str]]


@dataclass(frozen=True, slots=True)
class Swept:
    """A sweep: its direction, kinds and blocks.

    Attributes
    ----------
    title : str
    lanes, inward : bool
        Whether it runs over directions; whether it runs from the tips to the ground.
    groups : str
        For sweeps over all columns of a matrix at once: the columns that the function of a link processes.
    then : str
        Another sweep, whose function for a link is called right after the function of this sweep.
    kinds : sequence of Kind
        Kinds that may have a block.
    order : sequence of Kind
        Kind of each unit, in the order of the sweep.
    blocks : dict of int to Block
        Blocks by index of the kind.
    merged : Merged or None
        All blocks as one, if the sweep is printed in this form.
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
    """Known values of the ground, whose row follows the rows of links.

    Attributes
    ----------
    fields : dict of str to float or str
        Components that are read: a number, or the name of a component of `gravity`.
    kept : set of str
        Components that transposed sweeps read again.
    gravity : dict of str to float or str
        Minus the acceleration of gravity: a number, or the name of one of `constants`. Empty without gravity.
    constants : Constants or None
        Constants of gravity.
    tangents : list of (str, list of (float or str, int))
        Components with a non-zero tangent: a number or constant for each parameter on which it depends.
    sweeps : tuple of str
        Sweeps that begin with the tangent.
    twice : list of (str, list of (float or str, int), list of (float or str, int, int))
        Components with tangents that functions with second derivatives read: their first and second derivatives, by
        parameter.
    """

    fields: dict[str, float | str]
    kept: set[str]
    gravity: dict[str, float | str]
    constants: Constants | None
    tangents: list[tuple[str, list[tuple[float | str, int]]]]
    sweeps: tuple[str, ...]
    twice: list[tuple[str, list[tuple[float | str, int]], list[tuple[float | str, int, int]]]]


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
        By kind: a plural name of its members, and the name of the first member.
    constants, shapes : list
        In the order of their indices.
    owners : list of (str, Constants)
        Name of the owner of each `Constants`.
    ground : Ground
    arguments : dict of str to Array
        Arguments and results.
    arrays : dict of str to int
        Arrays that are computed before or by sweeps, with their sizes.
    layout : Layout
    addresses : callable (bool) -> Addresses
        Returns the addresses for a target in which places in memory are numbers (True) or names (False).
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
