"""Sums of adjoints: the first contribution assigns the component, so memory need not be set to zero before."""

from __future__ import annotations

from collections.abc import Sequence

from ..model.model import GROUND
from ..program import algebra
from ..program.block import Block
from ..program.store import Memory, Store
from ..records import dataclass
from .structure.kinds import UnitKind
from .structure.owners import owner_links
from .structure.system import System
from .sweeps import INWARD, Sweep

Run = tuple[Sweep, dict[int, Block]]
"""A sweep, and its blocks by kind."""


@dataclass(frozen=True, slots=True)
class _Access:
    """The stores or loads of one component by the blocks of one kind.

    Attributes
    ----------
    at : int
        Number of the sweep, in the order in which they run.
    kind : UnitKind
    store : Store
        The accessed store, in the form that overwrites (`Store.plain`), even if the block adds to it.
    """

    at: int
    kind: UnitKind
    store: Store


Accesses = tuple[_Access, ...]


def assign_first(system: System, memory: Memory, runs: Sequence[Run], own: Store, outside: set[str]) -> None:
    """Replace the first contribution to each component by an assignment.

    If the block of a kind contributes first for some links only, or if a link without contributions is read, the first
    sweep assigns the component instead: its own contribution, or zero. If the ground has such a component, which this
    sweep does not reach, nothing is replaced.

    Parameters
    ----------
    system : System
    memory : Memory
        Memory of links.
    runs : sequence of Run
        Sweeps in the order in which they run. The first visits all links; its blocks add to their own link only.
    own : Store
        A link's own memory.
    outside : set of str
        Components of the ground that are read afterwards.
    """
    given, read = _accesses(system, memory, runs)
    order = _Order(system, runs)
    fresh: set[tuple[_Access, str]] = set()
    zeros: dict[int, list[str]] = {}
    known: dict[tuple[Accesses, Accesses, bool], set[_Access] | None] = {}
    for name, by in given.items():
        readers = read.get(name, ())
        of_ground = name in outside or any(GROUND in order.links(access) for access in readers)
        key = by, readers, of_ground
        if key not in known:
            known[key] = order.first(*key)
        first = known[key]
        if first is not None:
            fresh |= {(access, name) for access in first}
            continue
        if of_ground:
            return
        for kind in runs[0][0].kinds(system):
            access = _Access(0, kind, own)
            if access in by:
                fresh.add((access, name))
            else:
                zeros.setdefault(kind.index, []).append(name)
    for at, (sweep, blocks) in enumerate(runs):
        for kind in sweep.kinds(system):
            block = blocks.get(kind.index)
            if block is not None:
                block.stores = [
                    (a.plain if a.memory is memory and (_Access(at, kind, a.plain), n) in fresh else a, n, e)
                    for a, n, e in block.stores
                ]
    for k, names in zeros.items():
        runs[0][1][k].stores += [(own, n, algebra.ZERO) for n in names]


def _accesses(system: System, memory: Memory, runs: Sequence[Run]) -> tuple[dict[str, Accesses], dict[str, Accesses]]:
    """By component, the accesses of the blocks that store it, and of those that load it."""
    given: dict[str, dict[_Access, None]] = {}
    read: dict[str, dict[_Access, None]] = {}
    for at, (sweep, blocks) in enumerate(runs):
        for kind in sweep.kinds(system):
            block = blocks.get(kind.index)
            if block is None:
                continue
            for a, n, _ in block.stores:
                if a.memory is memory:
                    given.setdefault(n, {})[_Access(at, kind, a.plain)] = None
            for a, n in block.loads.values():
                if a.memory is memory:
                    read.setdefault(n, {})[_Access(at, kind, a)] = None
    return {n: tuple(of) for n, of in given.items()}, {n: tuple(of) for n, of in read.items()}


class _Order:
    """The order in which blocks reach the links."""

    def __init__(self, system: System, runs: Sequence[Run]):
        self.system, self.runs = system, runs
        self._links: dict[_Access, list[int]] = {}

    def links(self, access: _Access) -> list[int]:
        """For each instance of the kind, the link whose memory is accessed."""
        if access not in self._links:
            of_units = self.runs[access.at][0].units
            self._links[access] = owner_links(self.system, access.kind, access.store, of_units)
        return self._links[access]

    def instances(self, access: _Access) -> Sequence[int]:
        """The instances of the kind of an access, in the order of its sweep."""
        return access.kind.units if self.runs[access.at][0].units else access.kind.members

    def first(self, given: Accesses, read: Accesses, of_ground: bool) -> set[_Access] | None:
        """The accesses that contribute first to every link that they reach. None if an access comes first for some of its
        links only, or if the component is read for a link to which no access contributes."""
        earliest: dict[int, tuple[int, int, int]] = {}
        for g, access in enumerate(given):
            sign = -1 if self.runs[access.at][0].direction == INWARD else 1
            for i, link in zip(self.instances(access), self.links(access), strict=True):
                mine = access.at, sign * i, g
                if link not in earliest or mine < earliest[link]:
                    earliest[link] = mine
        if not of_ground:
            earliest.pop(GROUND, None)
        count: dict[int, int] = {}
        for _, _, g in earliest.values():
            count[g] = count.get(g, 0) + 1
        needed = {link for access in read for link in self.links(access)} | ({GROUND} if of_ground else set())
        if not needed <= earliest.keys() or any(c < len(self.instances(given[g])) for g, c in count.items()):
            return None
        return {given[g] for g in count}
