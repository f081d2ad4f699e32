"""Zero patterns: which fields of which memory can differ from zero, found by running block-writing code on patterns.

The pattern of a link's inputs depends on its neighbours, so the code of a sweep is run until nothing changes.
"""

from __future__ import annotations

from dataclasses import field
from functools import partial

from ..model.model import GROUND
from ..program import algebra
from ..program.algebra import Expr, Number
from ..program.block import FieldError, Scope, StructuralExpansion
from ..program.store import CONSTANT, Life, Memory, Owner, Store
from ..records import dataclass
from . import fields
from .stores import CHANGED_COUPLING, EAR_ITSELF, LAID_OUT, OWN_COUPLING, RECORD, REGION_ITSELF, SLOT
from .structure.kinds import EarKind, UnitKind
from .structure.owners import owner_links
from .structure.system import System
from .sweeps import FALLING, INWARD, Sweep

GROUND_KIND = -1
MemoryKey = tuple[Memory, str]
"""A type of memory and, for slots, the sweep that uses it; the sweep is "" for memory that all sweeps share."""

KindKey = int | tuple[int, int]
"""Index of a kind. A coupling has the kind of the unit at which it ends, and its number in that unit."""

Place = tuple[MemoryKey, KindKey, str]
"""A component of the memory of a kind."""


class Reach:
    """The memory, by type and kind, that a store accesses in the blocks of a kind."""

    def __init__(self, system: System):
        self.system = system
        self._found: dict[tuple[UnitKind, str, Store], tuple[MemoryKey, set[KindKey]] | None] = {}
        self._of_links: dict[tuple[str, int, bool, Owner, int | None], set[KindKey]] = {}
        self._regions: dict[int, set[KindKey]] = {}
        self._changed: dict[tuple[int, int | None], set[KindKey]] = {}
        regions = system.regions
        of_region = {
            u.number: k.index for u, k in zip(regions.order, system.unit_kind_of, strict=True) if u.role == "region"
        }
        # a coupling belongs to the kind of the unit at which it ends
        kind_of_coupling = {
            c: (kind.index, n)
            for partners, kind in zip(regions.elimination.partners, system.unit_kind_of, strict=True)
            for n, c in enumerate(partners.own)
        }
        for unit, kind, partners in zip(regions.order, system.unit_kind_of, regions.elimination.partners, strict=True):
            for n, contribution in enumerate(partners.contributions):
                self._changed.setdefault((kind.index, n), set()).add(kind_of_coupling[contribution.coupling])
            if unit.role != "link":
                number = unit.number if unit.role == "region" else regions.ears[unit.number].region
                self._regions.setdefault(kind.index, set()).add(of_region[number])

    def of(self, kind: UnitKind, sweep: Sweep, store: Store) -> tuple[MemoryKey, set[KindKey]] | None:
        """The types of memory and the kinds; None for memory without a layout."""
        key = kind, sweep.name, store
        if key not in self._found:
            if store.memory in LAID_OUT:
                memory = store.memory, sweep.name if store.memory.life is Life.SWEEP else ""
                self._found[key] = memory, self._kinds(kind, sweep, store)
            else:
                self._found[key] = None
        return self._found[key]

    def _kinds(self, kind: UnitKind, sweep: Sweep, store: Store) -> set[KindKey]:
        """Kinds of the units whose memory a store accesses in the blocks of a kind."""
        owner, place = store.owner, store.place
        if owner in (EAR_ITSELF, REGION_ITSELF):
            return {kind.index} if owner is EAR_ITSELF or kind.role == "region" else self._regions[kind.index]
        if owner is OWN_COUPLING:
            assert place is not None
            return {(kind.index, place)}
        if owner is CHANGED_COUPLING:
            return self._changed[kind.index, place]
        key = kind.role, kind.index, sweep.units, owner, place
        if key not in self._of_links:
            links = set(owner_links(self.system, kind, store, sweep.units))
            self._of_links[key] = {GROUND_KIND if i == GROUND else self.system.kind_of[i].index for i in links}
        return self._of_links[key]


@dataclass(slots=True)
class _Run:
    """The record of a run of a block on patterns: its time, the memory that it read, and where it stored zeros."""

    block: StructuralExpansion
    at: int
    reads: set[tuple[MemoryKey, KindKey]]
    zeros: list[Place] = field(default_factory=list)


class Patterns:
    """Fields of each memory that can differ from zero, and fields that are 1 or -1 in every state, by kind."""

    def __init__(self, system: System):
        self.system = system
        self.reach = Reach(system)
        self.nonzero: dict[tuple[MemoryKey, KindKey], dict[str, int | None]] = {}
        self._fields: dict[tuple[UnitKind, str, Store], list[dict[str, int | None]] | None] = {}
        self.overruled = False
        """Whether a field that was 1 or -1 in earlier sweeps has since been stored with another value."""
        self._known_from: dict[Place, str] = {}
        self._written: set[Place] = set()
        self._runs: dict[UnitKind, _Run] = {}
        self._changes: dict[tuple[MemoryKey, KindKey], int] = {}
        self._clock = 0
        self._ground()

    def _ground(self) -> None:
        """Known values of the ground's memory: the ground is at rest and accelerates by -g."""
        gravity = self.system.gravity
        record = self.of((RECORD, ""), GROUND_KIND)
        for turned in (fields.attitude, fields.closing_attitude):
            record |= dict.fromkeys((f"{turned.name}.{ii}" for ii in ("xx", "yy", "zz")), 1)
        if gravity is None:
            return
        given = gravity.shape.fields
        record |= {name: None for name, of in self.system.fields_of_gravity.items() if given.get(of, 0) != 0}
        for name in given:
            if name in gravity.shape.varying:
                for sweep in FALLING:
                    self.of((SLOT, sweep), GROUND_KIND)[name] = None

    def of(self, memory: MemoryKey, kind: KindKey) -> dict[str, int | None]:
        """Fields that can differ from zero, each with its constant value 1 or -1, or None if it varies."""
        return self.nonzero.setdefault((memory, kind), {})

    def is_nonzero(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> bool:
        if store.memory is CONSTANT:
            number = kind.number_of(store, name)
            return number is not algebra.ZERO
        found = self._accessed(kind, sweep, store)
        return found is None or any(name in of for of in found)

    def known(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> int | None:
        """The number 1 or -1 that a field has in every state; None if there is none."""
        if store.memory is CONSTANT:
            number = kind.number_of(store, name)
            return int(number) if isinstance(number, Number) and number.value in (1, -1) else None
        values = {of.get(name) for of in self._accessed(kind, sweep, store) or ({},)}
        return values.pop() if len(values) == 1 else None

    def _accessed(self, kind: UnitKind, sweep: Sweep, store: Store) -> list[dict[str, int | None]] | None:
        """The results of `of` for all kinds whose memory a store may access; None for memory without a layout."""
        key = kind, sweep.name, store
        if key not in self._fields:
            found = self.reach.of(kind, sweep, store)
            self._fields[key] = None if found is None else [self.of(found[0], k) for k in found[1]]
        return self._fields[key]

    def number(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> Expr | None:
        """A known value: a constant of the whole kind, or a field that is 1 or -1."""
        value = kind.number_of(store, name)
        if value is not None:
            return value
        known = self.known(kind, sweep, store, name)
        return None if known is None else algebra.Number(known)

    def settle(self, sweep: Sweep) -> None:
        """Run a sweep's block-writing code on patterns until they stop growing.

        Raises
        ------
        FieldError
            A field is loaded that neither this sweep nor an earlier one stores.
        """
        self._runs.clear()
        kinds = sweep.kinds(self.system)
        order = [*reversed(kinds)] if sweep.direction == INWARD else kinds  # the order in which the sweep visits them
        changed = True
        while changed:
            changed = False
            for kind in order:
                changed |= self._settle(sweep, kind)
            if not changed:  # patterns no longer grow, so fields with a stored zero are not 1 in every state
                for kind in kinds:
                    for memory, k, name in self._runs[kind].zeros:
                        if self.of(memory, k).get(name) is not None:
                            changed = self._forget(sweep, memory, k, name)
        for kind in kinds:
            self.check_loads(sweep, kind, self._runs[kind].block)

    def _settle(self, sweep: Sweep, kind: UnitKind) -> bool:
        """Runs a block on patterns if its inputs have changed; returns whether other blocks must run again."""
        run = self._runs.get(kind)
        if run is not None and all(self._changes.get(place, 0) <= run.at for place in run.reads):
            return False
        before = self._clock
        form = kind.form if isinstance(kind, EarKind) else None
        run = self._run(sweep, kind)
        if isinstance(kind, EarKind) and kind.form != form:  # other blocks also load this factored matrix
            self._runs.clear()
            self._clock += 1
        self._runs[kind] = run
        for (store, name), value in run.block.stored.items():
            found = self.reach.of(kind, sweep, store)
            if found is None:
                continue
            for k in found[1]:
                self._written.add((found[0], k, name))
                known = self.of(found[0], k)
                if value == 0:
                    run.zeros.append((found[0], k, name))
                elif name not in known:
                    known[name] = value
                    self._known_from[found[0], k, name] = sweep.name
                    self._note(found[0], k)
                elif known[name] is not None and known[name] != value:
                    self._forget(sweep, found[0], k, name)
        return self._clock > before

    def _run(self, sweep: Sweep, kind: UnitKind) -> _Run:
        x = StructuralExpansion(
            sweep.title,
            partial(self.is_nonzero, kind, sweep),
            sweep.tangents,
            partial(self.known, kind, sweep),
            sweep.units,
        )
        at = self._clock
        write_block(sweep, x, kind)
        reads: set[tuple[MemoryKey, KindKey]] = set()
        for store in {store for store, _ in x.reads}:
            found = self.reach.of(kind, sweep, store)
            if found is not None:
                reads.update((found[0], k) for k in found[1])
        return _Run(x, at, reads)

    def _note(self, memory: MemoryKey, kind: KindKey) -> None:
        """Records that the pattern of this memory has changed, so that blocks that read it must run again."""
        self._clock += 1
        self._changes[memory, kind] = self._clock

    def check_loads(self, sweep: Sweep, kind: UnitKind, x: Scope) -> None:
        """Check that some block stores each field that a block loads, unless the field consists of contributions.

        Raises
        ------
        FieldError
            Names block, store and component.
        """
        for (store, name), entry in x.reads.items():
            found = self.reach.of(kind, sweep, store)
            if found is None or entry.propagated:
                continue
            for k in found[1]:
                if k != GROUND_KIND and (found[0], k, name) not in self._written:
                    raise FieldError(f"{sweep.title}: {store}.{name} is loaded, and no block stores it")

    def _forget(self, sweep: Sweep, memory: MemoryKey, kind: KindKey, name: str) -> bool:
        """Records that a field does not have the same value in every state."""
        self.of(memory, kind)[name] = None
        self._note(memory, kind)
        self.overruled |= self._known_from.get((memory, kind, name), sweep.name) != sweep.name
        return True


def write_block(sweep: Sweep, x: Scope, kind: UnitKind) -> None:
    """Write the block of a kind; the form of a factored closure matrix is stored in the kind for later sweeps."""
    form = sweep.write_block(x, kind)
    if form is not None:
        assert isinstance(kind, EarKind)
        kind.form = form
