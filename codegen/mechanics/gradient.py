"""The transpose of the balance (the tangent of forward dynamics): six sweeps are merged into two, one outward, one inward.

The transpose of the balance's inward sweep goes outward and propagates virtual motions. It is merged with
the sweep of accelerations. Terms in transmitted forces are deferred (`codegen.program.transpose.deferred`), since these
forces are only known on the way inward. The inward sweep merges the transmitted forces, the deferred terms, and the
transposes of the outward sweep and of the completion of seeds (`codegen.program.fusion`). Gradients of coordinates are
then stored once, and few values pass through memory.

Memory need not be cleared: the first contribution to a component assigns it, the others add.
"""

from __future__ import annotations

from dataclasses import field
from functools import partial

from ..program import algebra
from ..program.block import Block, Component
from ..program.fusion import fused
from ..program.store import Store
from ..program.transpose import deferred
from ..records import dataclass
from .expansion import Program
from .stores import DQ, DU, LANE, LINK, LREGION, MY_LANE, REGION_LANE, SLOT
from .structure.kinds import EarKind, LinkKind, RegionKind, UnitKind
from .structure.owners import owner_links
from .structure.system import System
from .sweeps import GRADIENT_IN, GRADIENT_IN_CLOSED, GRADIENT_OUT, SWEEP, transpose_name, values_name

NOTHING = Block("", "")


def run_together(program: Program, closed: bool, alone: bool) -> None:
    """Merge the sweeps of the balance's transpose into one outward and one inward sweep.

    Parameters
    ----------
    program : Program
    closed : bool
        Includes the transpose of the completion of seeds.
    alone : bool
        No other sweep over directions follows, so reused memory need not be cleared afterwards.
    """
    blocks, system = program.blocks, program.system
    values_out, values_in = (blocks.pop(values_name(s)) for s in ("balance_out", "balance_in"))
    back_in, back_out = (blocks.pop(transpose_name(s)) for s in ("balance_in", "balance_out"))
    solve = blocks[transpose_name("balance_back")]
    completion = blocks[transpose_name("complete")] if closed else {}
    waiting = {(a.memory, n) for b in values_in.values() for a, n, _ in b.stores}
    kinds = SWEEP[GRADIENT_OUT].kinds(system)
    parts_out: dict[int, list[Block]] = {}
    parts_in: dict[int, list[Block]] = {}
    everything = [b for of in (solve, back_in, back_out, completion) for b in of.values()]
    shared = sorted({n for b in everything for a, n, _ in b.stores if a.memory is LANE and a.owner is not LINK})
    for kind in kinds:
        k = kind.index
        taken = {(a.plain, n) for a, n, _ in solve.get(k, NOTHING).stores}
        taken |= {(a, n) for a in _Unit(system, kind, None, set()).lanes for n in shared}

        def late(store: Store, name: str) -> bool:
            return (store.memory, name) in waiting

        def steady(store: Store, name: str, taken: set[Component] = taken) -> bool:
            return store.memory is LANE and store.owner is LINK and (store, name) not in taken

        first, second = deferred(back_in.get(k, NOTHING), late, partial(_saved, kind), steady)
        parts_out[k] = [values_out.get(k, NOTHING), first]
        parts_in[k] = [values_in.get(k, NOTHING), second, back_out.get(k, NOTHING), completion.get(k, NOTHING)]
    propagated_in = _Propagated(system, parts_in, False) if alone else None
    propagated_out = _Propagated(system, parts_out, True) if propagated_in and propagated_in.all else None
    free = tuple(map(set, system.independent))
    name_in = GRADIENT_IN_CLOSED if closed else GRADIENT_IN
    blocks[GRADIENT_OUT], blocks[name_in] = {}, {}
    for kind in kinds:
        k, unit = kind.index, _Unit(system, kind, free if closed else None, set(shared))
        if k in solve:
            solve[k] = unit.run(solve[k].name, solve[k].title, [solve[k]], None)
        outward = unit.run(f"{GRADIENT_OUT}_{k}", SWEEP[GRADIENT_OUT].title, parts_out[k], propagated_out, first=True)
        for a in unit.lanes:
            outward.stores += [(a, n, algebra.ZERO) for n in shared if (a, n) not in unit.stored]
        inward = unit.run(f"{name_in}_{k}", SWEEP[name_in].title, parts_in[k], propagated_in)
        unit.complete(inward)
        if alone:  # no later sweep reads the lanes of links
            inward.stores = [(a, n, e) for a, n, e in inward.stores if a.memory is not LANE or n in shared]
        blocks[GRADIENT_OUT][k], blocks[name_in][k] = outward, inward
    slots = {s: program.slots.get(s, []) for s in ("balance_in", "balance_out", "complete")}
    assert not set(slots["balance_out"]) & set(slots["complete"]), "the sweeps balance_out and complete share a slot"
    program.slots[GRADIENT_OUT] = slots["balance_in"]
    program.slots[name_in] = [*slots["balance_out"], *(slots["complete"] if closed else ())]
    for memory in (LANE, REGION_LANE):
        stored = (n for b in blocks[GRADIENT_OUT].values() for a, n, _ in b.stores if a.memory is memory)
        program.fields[memory] = list(dict.fromkeys((*program.fields[memory], *stored)))


def _saved(kind: UnitKind, i: int) -> Component:
    """Memory per direction in which the outward block of a kind saves a value for the inward block."""
    store = LREGION if isinstance(kind, RegionKind) else MY_LANE[0] if isinstance(kind, EarKind) else MY_LANE
    return store, f"saved.{i}"


@dataclass(slots=True)
class _Unit:
    """Merges the blocks of the six sweeps for one kind of units.

    Attributes
    ----------
    free : tuple of set of int, or None
        Independent coordinates and speeds; gradients of the others become zero.
    shared : set of str
        Components of lanes to which other units contribute.
    stored : set of (Store, str)
        Components per direction that have been stored so far.
    """

    system: System
    kind: UnitKind
    free: tuple[set[int], ...] | None
    shared: set[str]
    stored: set[Component] = field(default_factory=set)

    @property
    def links(self) -> list[tuple[LinkKind, int | None]]:
        """Kinds of the links, each with its index in the ear, which is None outside ears."""
        if isinstance(self.kind, EarKind):
            return [(link, place) for place, link in enumerate(self.kind.links)]
        return [(self.kind, None)] if isinstance(self.kind, LinkKind) else []

    @property
    def lanes(self) -> list[Store]:
        """The stores of the lanes of the unit's links."""
        return [MY_LANE if place is None else MY_LANE[place] for _, place in self.links]

    def run(
        self, name: str, title: str, parts: list[Block], propagated: _Propagated | None, first: bool = False
    ) -> Block:
        """The blocks `parts` joined to one; with `first`, it runs before any other unit adds to the lanes of its links, so
        it assigns its contributions."""

        def fresh(store: Store, component: str) -> bool:
            if store.memory is SLOT:
                return propagated is not None and propagated.fresh(self.kind, store, component)
            own = component not in self.shared or (first and store.plain in self.lanes)
            mine = store.memory is LANE and store.owner is LINK and own
            return (mine or store.name in (DQ.name, DU.name)) and (store, component) not in self.stored

        found = fused(name, title, parts, fresh)
        if propagated is not None:
            found.stores = [
                (a, n, e)
                for a, n, e in found.stores
                if not (a.memory is SLOT and e is algebra.ZERO and n in propagated.assigned)
            ]
        self.stored |= {(a.plain, n) for a, n, _ in found.stores if a.lanes}
        return found

    def complete(self, block: Block) -> None:
        """Store zero gradients for seeds that do not affect accelerations, and for dependent coordinates and speeds."""
        at = {(a.plain, n): i for i, (a, n, _) in enumerate(block.stores)}
        for link, place in self.links:
            mine = owner_links(self.system, self.kind, DQ if place is None else DQ[place], of_units=True)
            members = [self.system.links[i] for i in mine]
            for seed, count, which in ((DQ, link.joint.coordinates, 0), (DU, link.joint.freedoms, 1)):
                store = seed if place is None else seed[place]
                for j in range(count):
                    at_j = [(m.u if which else m.q) + j for m in members]
                    dependent = {self.free is not None and i not in self.free[which] for i in at_j}
                    assert len(dependent) == 1, "links of one kind have the same dependent coordinates and speeds"
                    zero = (store, str(j), algebra.ZERO)
                    if (store, str(j)) in at and dependent == {True}:
                        block.stores[at[store, str(j)]] = zero
                    elif (store, str(j)) not in at and (dependent == {True} or (store, str(j)) not in self.stored):
                        block.stores.append(zero)


class _Propagated:
    """Sums per direction to which units contribute, and whether a unit is the first that contributes to a component. If
    the answer is the same for all units of a kind, the first contribution assigns the component, and reused memory need
    not be cleared.

    Attributes
    ----------
    assigned : set of str
        Components that first contributions assign.
    all : bool
        Whether these are all components.
    """

    def __init__(self, system: System, parts: dict[int, list[Block]], outward: bool):
        self.system = system
        self.kinds = {k.index: k for k in SWEEP[GRADIENT_OUT].kinds(system)}
        self.order = 1 if outward else -1
        self.assigned: set[str] = set()
        self._fresh: set[tuple[str, int, Store]] = set()
        self._links: dict[tuple[int, Store], list[int]] = {}
        gives: dict[str, list[tuple[int, Store, bool]]] = {}
        reads: dict[str, set[tuple[int, Store]]] = {}
        for k, blocks in parts.items():
            for block in blocks:
                for a, n, e in block.stores:
                    if a.memory is SLOT and e is not algebra.ZERO:
                        gives.setdefault(n, []).append((k, a.plain, a.adds))
                for a, n in block.loads.values():
                    if a.memory is SLOT:
                        reads.setdefault(n, set()).add((k, a))
        known: dict[object, tuple[set[tuple[int, Store]], set[int]] | None] = {}
        for n, givers in gives.items():
            at = tuple((k, a) for k, a, _ in givers)
            if len(set(at)) < len(at) or not all(adds for _, _, adds in givers):
                continue  # a unit contributes twice, or modifies a stored value
            if at not in known:
                known[at] = self._first(at)
            found = known[at]
            if found is None:
                continue
            first, given = found
            unread = {(k, a) for k, a in reads.get(n, ()) if not given.intersection(self.links(k, a))}
            if all((k, a) in unread or given.issuperset(self.links(k, a)) for k, a in reads.get(n, ())):
                self.assigned.add(n)
                self._fresh |= {(n, k, a) for k, a in first | unread}
        self.all = self.assigned == gives.keys()

    def links(self, k: int, store: Store) -> list[int]:
        """The links whose memory a store accesses, for all units of a kind."""
        if (k, store) not in self._links:
            self._links[k, store] = owner_links(self.system, self.kinds[k], store, of_units=True)
        return self._links[k, store]

    def _first(self, givers: tuple[tuple[int, Store], ...]) -> tuple[set[tuple[int, Store]], set[int]] | None:
        """The contributions that come first for all units of a kind, and all links that receive contributions. None if a
        contribution comes first for some units of its kind only."""
        earliest: dict[int, tuple[int, int]] = {}
        for g, (k, a) in enumerate(givers):
            for unit, link in zip(self.kinds[k].units, self.links(k, a), strict=True):
                mine = self.order * unit, g
                if link not in earliest or mine < earliest[link]:
                    earliest[link] = mine
        count: dict[int, int] = {}
        for _, g in earliest.values():
            count[g] = count.get(g, 0) + 1
        if any(c < len(self.kinds[givers[g][0]].units) for g, c in count.items()):
            return None
        return {givers[g] for g in count}, set(earliest)

    def fresh(self, kind: UnitKind, store: Store, name: str) -> bool:
        """Whether no unit has contributed to a component before the block of a unit of this kind begins."""
        return (name, kind.index, store) in self._fresh
