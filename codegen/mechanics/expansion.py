"""From a system to blocks: zero patterns first, then statements, then passes.

The zero pattern of what a link receives depends on its neighbours', so patterns are found by running the block-writing code on
structural values until nothing changes; then every block is expanded once per kind, and passes are applied. What no
later block reads is removed, across blocks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Container, Iterable
from dataclasses import dataclass, field
from functools import partial

from ..model.model import GROUND
from ..program import algebra
from ..program.algebra import Expr, Number, Symbol
from ..program.block import (
    Block,
    Component,
    Expansion,
    FieldError,
    Scope,
    Statement,
    StructuralExpansion,
    symbols_of,
)
from ..program.field import AnyField
from ..program.operations import Operations, count, count_expression
from ..program.passes import PASSES, drop_dead, propagate_copies
from ..program.plan import Merged
from ..program.progress import Progress, silent
from ..program.store import CONSTANT, Life, Memory, Owner, Store
from . import fields
from .stores import EAR_ITSELF, HANDED_COUPLING, LAID_OUT, LINK, OWN_COUPLING, RECORD, REGION_ITSELF, SLOT
from .structure.kinds import EarKind, UnitKind
from .structure.owners import owner_links
from .structure.system import System
from .sweeps import FALLING, INWARD, SWEEPS, Sweep

GROUND_KIND = -1
MemoryKey = tuple[Memory, str]
"""A sort of memory, and the sweep whose slots are meant; without sweep for what outlives one."""

KindKey = int | tuple[int, int]
"""Index of a kind; of a coupling, that of the unit that it ends with and its number there."""

Place = tuple[MemoryKey, KindKey, str]
"""A component in a memory of a kind."""


@dataclass(slots=True)
class Program:
    """All blocks of a system.

    Attributes
    ----------
    blocks : dict of str to dict of int to Block
        By sweep and kind.
    fields : dict of Memory to list of str
        Components that are kept, by sort of memory.
    slots : dict of str to list of str
        Those of slots, by sweep.
    transient : dict of str to list of str
        Fields of records that need a slot only, by sweep.
    ground_fields : set of str
        What is read of the ground.
    read_outside : set of (memory, kind, field)
        What formulas read after the sweeps.
    report : list of (pass, operations, seconds)
    sweep_seconds : dict of str to float
        Expanding and simplifying, by sweep.
    merged : dict of str to Merged
        Sweeps that are printed as one block.
    """

    system: System
    blocks: dict[str, dict[int, Block]] = field(default_factory=dict)
    fields: dict[Memory, list[str]] = field(default_factory=dict)
    slots: dict[str, list[str]] = field(default_factory=dict)
    report: list[tuple[str, Operations, float]] = field(default_factory=list)
    sweep_seconds: dict[str, float] = field(default_factory=dict)
    ground_fields: set[str] = field(default_factory=set)
    transient: dict[str, list[str]] = field(default_factory=dict)
    read_outside: set[Place] = field(default_factory=set)
    merged: dict[str, Merged] = field(default_factory=dict)


class Reach:
    """Which memory of which kinds an array means in the blocks of a kind."""

    def __init__(self, system: System):
        self.system = system
        self._found: dict[tuple[UnitKind, str, Store], tuple[MemoryKey, set[KindKey]] | None] = {}
        self._of_links: dict[tuple[str, int, bool, Owner, int | None], set[KindKey]] = {}
        self._regions: dict[int, set[KindKey]] = {}
        self._handed_on: dict[tuple[int, int | None], set[KindKey]] = {}
        regions = system.regions
        of_region = {
            u.number: k.index for u, k in zip(regions.order, system.unit_kind_of, strict=True) if u.role == "region"
        }
        # a coupling is of the kind of the unit that it ends with
        kind_of_coupling = {
            c: (kind.index, n)
            for partners, kind in zip(regions.elimination.partners, system.unit_kind_of, strict=True)
            for n, c in enumerate(partners.own)
        }
        for unit, kind, partners in zip(regions.order, system.unit_kind_of, regions.elimination.partners, strict=True):
            for n, handed_on in enumerate(partners.handed_on):
                self._handed_on.setdefault((kind.index, n), set()).add(kind_of_coupling[handed_on.coupling])
            if unit.role != "link":
                number = unit.number if unit.role == "region" else regions.ears[unit.number].region
                self._regions.setdefault(kind.index, set()).add(of_region[number])

    def of(self, kind: UnitKind, sweep: Sweep, store: Store) -> tuple[MemoryKey, set[KindKey]] | None:
        """Memory and kinds; None for what the layout does not place."""
        key = kind, sweep.name, store
        if key not in self._found:
            if store.memory in LAID_OUT:
                memory = store.memory, sweep.name if store.memory.life is Life.SWEEP else ""
                self._found[key] = memory, self._kinds(kind, sweep, store)
            else:
                self._found[key] = None
        return self._found[key]

    def _kinds(self, kind: UnitKind, sweep: Sweep, store: Store) -> set[KindKey]:
        """Kinds of what a store is of, in the blocks of a kind."""
        owner, place = store.owner, store.place
        if owner in (EAR_ITSELF, REGION_ITSELF):
            return {kind.index} if owner is EAR_ITSELF or kind.role == "region" else self._regions[kind.index]
        if owner is OWN_COUPLING:
            assert place is not None
            return {(kind.index, place)}
        if owner is HANDED_COUPLING:
            return self._handed_on[kind.index, place]
        key = kind.role, kind.index, sweep.units, owner, place
        if key not in self._of_links:
            links = set(owner_links(self.system, kind, store, sweep.units))
            self._of_links[key] = {GROUND_KIND if i == GROUND else self.system.kind_of[i].index for i in links}
        return self._of_links[key]


@dataclass(slots=True)
class _Run:
    """A block that was run on patterns: when, what it reads, and where it stores zeros."""

    block: StructuralExpansion
    at: int
    reads: set[tuple[MemoryKey, KindKey]]
    zeros: list[Place] = field(default_factory=list)


class Patterns:
    """Which fields of which memory can differ from zero, and which are 1 or -1 in every state, by kind."""

    def __init__(self, system: System):
        self.system = system
        self.reach = Reach(system)
        self.nonzero: dict[tuple[MemoryKey, KindKey], dict[str, int | None]] = {}
        self._fields: dict[tuple[UnitKind, str, Store], list[dict[str, int | None]] | None] = {}
        self.overruled = False
        """Whether a sweep has stored something else where an earlier one had stored 1 or -1."""
        self._known_from: dict[Place, str] = {}
        self._written: set[Place] = set()
        self._runs: dict[UnitKind, _Run] = {}
        self._changes: dict[tuple[MemoryKey, KindKey], int] = {}
        self._clock = 0
        self._ground()

    def _ground(self) -> None:
        """The ground: at rest, accelerating by -g."""
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
        """Fields that can differ from zero, and the number that they are, if any."""
        return self.nonzero.setdefault((memory, kind), {})

    def is_nonzero(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> bool:
        if store.memory is CONSTANT:
            number = kind.number_of(store, name)
            return number is not algebra.ZERO
        found = self._meant(kind, sweep, store)
        return found is None or any(name in of for of in found)

    def known(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> int | None:
        """The number 1 or -1 that a field is in every state."""
        if store.memory is CONSTANT:
            number = kind.number_of(store, name)
            return int(number) if isinstance(number, Number) and number.value in (1, -1) else None
        values = {of.get(name) for of in self._meant(kind, sweep, store) or ({},)}
        return values.pop() if len(values) == 1 else None

    def _meant(self, kind: UnitKind, sweep: Sweep, store: Store) -> list[dict[str, int | None]] | None:
        """Fields as `of` has them, of all kinds that a store can be of; None for what the layout does not place."""
        key = kind, sweep.name, store
        if key not in self._fields:
            found = self.reach.of(kind, sweep, store)
            self._fields[key] = None if found is None else [self.of(found[0], k) for k in found[1]]
        return self._fields[key]

    def number(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> Expr | None:
        """A value that is known: a constant of the whole kind, or a field that is 1 or -1."""
        value = kind.number_of(store, name)
        if value is not None:
            return value
        known = self.known(kind, sweep, store, name)
        return None if known is None else algebra.Number(known)

    def settle(self, sweep: Sweep) -> None:
        """Run a sweep's block-writing code on patterns until they do not grow.

        Raises
        ------
        FieldError
            Something is loaded that neither this sweep nor one before it stores.
        """
        self._runs.clear()
        kinds = sweep.kinds(self.system)
        order = [*reversed(kinds)] if sweep.direction == INWARD else kinds  # what is found climbs in one pass
        changed = True
        while changed:
            changed = False
            for kind in order:
                changed |= self._settle(sweep, kind)
            if not changed:  # only now is a zero sure to stay one: then the field is not 1 for all
                for kind in kinds:
                    for memory, k, name in self._runs[kind].zeros:
                        if self.of(memory, k).get(name) is not None:
                            changed = self._forget(sweep, memory, k, name)
        for kind in kinds:
            self.check_loads(sweep, kind, self._runs[kind].block)

    def _settle(self, sweep: Sweep, kind: UnitKind) -> bool:
        """Run the code of a block on patterns, if some that it reads have changed since; whether others change by it."""
        run = self._runs.get(kind)
        if run is not None and all(self._changes.get(place, 0) <= run.at for place in run.reads):
            return False
        before = self._clock
        form = kind.form if isinstance(kind, EarKind) else None
        run = self._run(sweep, kind)
        if isinstance(kind, EarKind) and kind.form != form:  # blocks of others are written by it, too
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
        _write(sweep, x, kind)
        reads: set[tuple[MemoryKey, KindKey]] = set()
        for store in {store for store, _ in x.asked}:
            found = self.reach.of(kind, sweep, store)
            if found is not None:
                reads.update((found[0], k) for k in found[1])
        return _Run(x, at, reads)

    def _note(self, memory: MemoryKey, kind: KindKey) -> None:
        """What some blocks read has changed."""
        self._clock += 1
        self._changes[memory, kind] = self._clock

    def check_loads(self, sweep: Sweep, kind: UnitKind, x: Scope) -> None:
        """What a block loads must be stored by some block, zeros too, unless others hand it on and there may be none.

        Raises
        ------
        FieldError
            With block, store and component.
        """
        for (store, name), asked in x.asked.items():
            found = self.reach.of(kind, sweep, store)
            if found is None or asked.handed_on:
                continue
            for k in found[1]:
                if k != GROUND_KIND and (found[0], k, name) not in self._written:
                    raise FieldError(f"{sweep.title}: {store}.{name} is loaded, and no block stores it")

    def _forget(self, sweep: Sweep, memory: MemoryKey, kind: KindKey, name: str) -> bool:
        """A field is not the same number in every state."""
        self.of(memory, kind)[name] = None
        self._note(memory, kind)
        self.overruled |= self._known_from.get((memory, kind, name), sweep.name) != sweep.name
        return True


class Traffic:
    """What blocks write and read: of every family of fields that is written somebody should read something.

    Parameters
    ----------
    outside : iterable of Place
        What formulas read.
    """

    def __init__(self, outside: Iterable[Place]):
        self._read = {name for _, _, name in outside}
        self._families: set[AnyField] = set()
        self._written: dict[AnyField, tuple[str, dict[Component, None]]] = {}

    def note(self, sweep: Sweep, x: Expansion) -> None:
        """Take note of what a block has written and read, tangents too."""
        self._read.update(name for _, name in x.block.loads.values())
        self._families.update(asked.family for asked in x.asked.values())
        for store, name, value in x.block.stores:
            told = x.told.get((store, name))
            if told is not None and value is not algebra.ZERO and store.memory in LAID_OUT and not told.family.unread:
                self._written.setdefault(told.family, (sweep.title, {}))[1][store, name] = None

    def check(self) -> None:
        """Somebody reads something of every family that is written.

        Raises
        ------
        FieldError
            With block, store and component.
        """
        for family, (title, written) in self._written.items():
            if family not in self._families and not any(name in self._read for _, name in written):
                store, name = next(iter(written))
                raise FieldError(f"{title}: {store}.{name} is stored, and no block or formula reads {family}")


def _write(sweep: Sweep, x: Scope, kind: UnitKind) -> None:
    """Write the block of a kind; the form of a closure matrix that is factored is kept for the sweeps that follow."""
    form = sweep.write_block(x, kind)
    if form is not None:
        assert isinstance(kind, EarKind)
        kind.form = form


def expand(
    system: System,
    sweeps: Iterable[str],
    read_outside: Iterable[Place] = (),
    progress: Progress = silent,
    whole: bool = True,
) -> Program:
    """Write the blocks of the named sweeps for every kind, simplify them and lay out their memory.

    `read_outside` are fields (memory, kind, field) that formulas read; `progress` hears of every sweep; `whole` says
    that the sweeps are those of all functions, so that what none of them reads should not be stored.

    Raises
    ------
    FieldError
        A block loads what no block stores, or (of the whole) stores what no block loads.
    """
    wanted = set(sweeps)
    chosen = [s for s in SWEEPS if s.name in wanted and s.kinds(system)]
    patterns = Patterns(system)
    program = Program(system, read_outside=set(read_outside))
    start = clock = time.perf_counter()
    seconds = program.sweep_seconds
    for step, sweep in enumerate(chosen, 1):
        progress("finding zeros", step, len(chosen))
        patterns.settle(sweep)
        program.blocks[sweep.name] = {}
        seconds[sweep.name], clock = time.perf_counter() - clock, time.perf_counter()
    while patterns.overruled:
        patterns.overruled = False
        for sweep in chosen:
            patterns.settle(sweep)
    traffic = Traffic(program.read_outside)
    for step, sweep in enumerate(chosen, 1):
        progress("expanding", step, len(chosen))
        for kind in sweep.kinds(system):
            x = Expansion(
                f"{sweep.name}_{kind.index}", sweep.title, partial(patterns.is_nonzero, kind, sweep),
                partial(patterns.number, kind, sweep), kind.alias_of, sweep.tangents, sweep.units,
            )  # fmt: skip
            _write(sweep, x, kind)
            patterns.check_loads(sweep, kind, x)
            traffic.note(sweep, x)
            block = program.blocks[sweep.name][kind.index] = x.finish()
            _check_pattern(patterns, kind, sweep, propagate_copies(block))
        seconds[sweep.name], clock = seconds[sweep.name] + time.perf_counter() - clock, time.perf_counter()
    if whole:
        traffic.check()
    _choose(program, patterns, chosen)
    program.report.append(("expand", _total(program), time.perf_counter() - start))
    start = time.perf_counter()
    _drop_unread(program, patterns, chosen)
    program.report.append(("drop what nobody reads", _total(program), time.perf_counter() - start))
    for done, (name, function) in enumerate(PASSES):
        start = clock = time.perf_counter()
        for step, (sweep_name, blocks) in enumerate(program.blocks.items(), 1 + done * len(program.blocks)):
            progress("simplifying", step, len(PASSES) * len(program.blocks))
            for k, block in blocks.items():
                blocks[k] = function(block)
            seconds[sweep_name], clock = seconds[sweep_name] + time.perf_counter() - clock, time.perf_counter()
        program.report.append((name, _total(program), time.perf_counter() - start))
    _drop_unread(program, patterns, chosen)
    _lay_out(program)
    return program


def _check_pattern(patterns: Patterns, kind: UnitKind, sweep: Sweep, block: Block) -> None:
    """What is stored must be within the pattern: others load zero, or a known number, where the pattern says so."""
    for store, name, value in block.stores:
        if patterns.reach.of(kind, sweep, store) is None:
            continue
        known = patterns.known(kind, sweep, store, name)
        if known is None and value is algebra.ZERO:
            continue
        if isinstance(value, Number) and not math.isfinite(float(value)):
            raise OverflowError(f"{name} of {sweep.name} is {value}")
        if not patterns.is_nonzero(kind, sweep, store, name) or (
            known is not None and value is not algebra.Number(known)
        ):
            raise AssertionError(
                f"{sweep.name}, {kind.role} {kind.index}: {store}.{name} = {value} is not in its pattern"
            )


def _total(program: Program) -> Operations:
    total = Operations()
    for blocks in program.blocks.values():
        for b in blocks.values():
            total = total + count(b)
    return total


@dataclass(slots=True)
class _Links:
    """What connects a block with others: the places that each of its stores goes to (None for what the layout
    does not place), and those that each of its loads comes from."""

    block: Block
    targets: list[set[Place] | None]
    loads: dict[Symbol, list[Place]]


def _links(program: Program, patterns: Patterns, sweeps: list[Sweep]) -> list[_Links]:
    reach = patterns.reach
    found: list[_Links] = []
    for sweep in sweeps:
        for kind in sweep.kinds(program.system):
            block = program.blocks[sweep.name][kind.index]
            loads: dict[Symbol, list[Place]] = {}
            for symbol, (store, name) in block.loads.items():
                memory = reach.of(kind, sweep, store)
                if memory is not None:
                    loads[symbol] = [(memory[0], k, name) for k in memory[1]]
            targets: list[set[Place] | None] = []
            for store, name, _ in block.stores:
                memory = reach.of(kind, sweep, store)
                targets.append(None if memory is None else {(memory[0], k, name) for k in memory[1]})
            found.append(_Links(block, targets, loads))
    return found


def _needed(program: Program, blocks: list[_Links]) -> set[Place]:
    """What some result depends on; of values that may be had in two ways, neither is followed."""
    needed: set[Place] = set(program.read_outside)
    before = -1
    read: dict[int, frozenset[int]] = {}
    while before != len(needed):
        before = len(needed)
        for n, of in reversed([*enumerate(blocks)]):  # most is read by later ones
            stored = frozenset(
                i for i, target in enumerate(of.targets) if target is None or not target.isdisjoint(needed)
            )
            if read.get(n) == stored:
                continue
            read[n] = stored
            symbols = {symbol for i in stored for symbol in symbols_of(of.block.stores[i][2])}
            for symbol in _read_for(of.block, symbols, of.block.otherwise) & of.loads.keys():
                needed.update(of.loads[symbol])
    return needed


def _read_for(block: Block, symbols: set[Symbol], ends: Container[Symbol] = ()) -> set[Symbol]:
    """Symbols that some depend on, and these; statements of `ends` are not followed."""
    found = set(symbols)
    for statement in reversed(block.statements):
        if statement.target in found and statement.target not in ends:
            found |= symbols_of(statement.expression)
    return found


def _choose(program: Program, patterns: Patterns, sweeps: list[Sweep]) -> None:
    """Of values that may be had in two ways, take the first where others need all that it reads, if the second costs no less."""
    if not any(b.otherwise for blocks in program.blocks.values() for b in blocks.values()):
        return
    linked = _links(program, patterns, sweeps)
    needed = _needed(program, linked)
    for of in linked:
        block = of.block
        for n, s in enumerate(block.statements):
            if s.target not in block.otherwise:
                continue
            both = s.expression, block.otherwise[s.target]
            alone = [
                any(needed.isdisjoint(of.loads[x]) for x in _read_for(block, set(symbols_of(e))) & of.loads.keys())
                for e in both
            ]
            value, other = (count_expression(e).flops for e in both)
            if alone[0] or (other < value and not alone[1]):
                block.statements[n] = Statement(s.target, both[1], s.tag, s.lanes)
        block.otherwise = {}


def _drop_unread(program: Program, patterns: Patterns, sweeps: list[Sweep]) -> None:
    """Remove what no result depends on, across blocks: stores to memory are needed if a needed statement loads them."""
    linked = _links(program, patterns, sweeps)
    needed = _needed(program, linked)
    for of in linked:
        of.block.stores = [
            store
            for store, places in zip(of.block.stores, of.targets, strict=True)
            if places is None or not places.isdisjoint(needed)
        ]
    for blocks in program.blocks.values():
        for k, block in blocks.items():
            blocks[k] = drop_dead(block)
    program.ground_fields = {n for m, k, n in needed if m[0] is RECORD and k == GROUND_KIND}


def _lay_out(program: Program) -> None:
    """Order the fields of each memory by first use."""
    found: dict[Memory, dict[str, None]] = {m: {} for m in LAID_OUT if m is not SLOT}
    falling: dict[str, None] = {}
    for sweep in SWEEPS:
        slots: dict[str, None] = falling if sweep.name in FALLING else {}
        if sweep.name not in program.blocks:
            continue
        for kind in sweep.kinds(program.system):
            block = program.blocks[sweep.name][kind.index]
            for store, name in [*block.loads.values(), *((a, n) for a, n, _ in block.stores)]:
                if store.memory in LAID_OUT:
                    found.get(store.memory, slots)[name] = None
        if slots:
            program.slots[sweep.name] = list(slots)
    program.slots |= {
        s: list(falling) for s in FALLING if s in program.slots
    }  # the ground's tangent is set for all of them
    program.fields = {memory: list(names) for memory, names in found.items()}
    program.transient = _transient(program)


def _transient(program: Program) -> dict[str, list[str]]:
    """Fields of records that only neighbours read, within the sweep that writes them, by sweep.

    They need no place of their own in every link: memory for one path through the tree will do, and stays in the cache.
    """
    uses: dict[str, dict[str, bool]] = {}
    of_links = {n for blocks in program.blocks.values() for b in blocks.values() for _, n, _ in b.stores}
    crossing: set[str] = {n for m, _, n in program.read_outside if m[0] is RECORD}
    for sweep, blocks in program.blocks.items():
        written = {(a.owner is LINK, n) for b in blocks.values() for a, n, _ in b.stores if a.memory is RECORD}
        loaded = {(a.owner is LINK, n) for b in blocks.values() for a, n in b.loads.values() if a.memory is RECORD}
        stored, read = {n for _, n in written}, {n for _, n in loaded}
        crossing |= read - stored - (program.ground_fields - of_links)
        crossing |= {n for is_own, n in loaded if is_own and (False, n) not in written}  # written by an earlier sweep
        for name in stored | read:
            uses.setdefault(name, {})[sweep] = name in stored
    crossing |= {name for name, sweeps in uses.items() if not all(sweeps.values())} - program.ground_fields
    result: dict[str, list[str]] = {}
    for name in program.fields[RECORD]:
        if name not in crossing:
            for sweep in uses.get(name, {}):
                result.setdefault(sweep, []).append(name)
    return result
