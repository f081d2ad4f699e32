"""From a system to blocks: zero patterns, then statements, then simplifying passes.

The zero pattern of a link's inputs depends on its neighbours. Patterns are therefore found by running the block-writing code on
structural values until nothing changes. Then every block is expanded once per kind and simplified. Values that no later block
reads are removed, across blocks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Container, Iterable, Iterator, Set
from dataclasses import field
from functools import partial

from ..program import algebra
from ..program.algebra import Number, Symbol
from ..program.block import Block, Component, Expansion, FieldError, Statement, symbols_of
from ..program.field import AnyField
from ..program.operations import Operations, count, count_expression
from ..program.passes import PASSES, drop_dead, propagate_copies
from ..program.plan import Merged
from ..program.progress import Progress, silent
from ..program.store import Memory
from ..records import dataclass
from .patterns import GROUND_KIND, Patterns, Place, write_block
from .second_order import Original, SecondOrder
from .second_order import read_outside as read_outside_twice
from .stores import LAID_OUT, LINK, RECORD, SLOT
from .structure.kinds import UnitKind
from .structure.system import System
from .sweeps import DIFFERENTIATED_TWICE, FALLING, SWEEPS, TWICE, Sweep, adjoint_name, along_name, parts_of


@dataclass(slots=True)
class Program:
    """All blocks of a system.

    Attributes
    ----------
    blocks : dict of str to dict of int to Block
        By sweep and kind.
    fields : dict of Memory to list of str
        Components that have a place in each type of memory, in the order of the places.
    slots : dict of str to list of str
        Components of slots, by sweep.
    transient : dict of str to list of str
        Components of records that only one sweep reads, so that a slot is enough; by sweep.
    ground_fields : set of str
        Fields of the ground that are read.
    read_outside : set of (memory, kind, field)
        Fields that formulas read after the sweeps.
    report : list of (pass, operations, seconds)
    sweep_seconds : dict of str to float
        Time of expansion and simplification, by sweep.
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


class FieldUse:
    """Checks that some block or formula reads each stored field; fields that differ only in a number count as one family.

    Parameters
    ----------
    outside : iterable of Place
        Fields that formulas read.
    """

    def __init__(self, outside: Iterable[Place]):
        self._read = {name for _, _, name in outside}
        self._families: set[AnyField] = set()
        self._written: dict[AnyField, tuple[str, dict[Component, None]]] = {}

    def note(self, sweep: Sweep, x: Expansion) -> None:
        """Records the fields that a block loads and stores, including those for tangents."""
        self._read.update(name for _, name in x.block.loads.values())
        self._families.update(entry.family for entry in x.reads.values())
        for store, name, value in x.block.stores:
            entry = x.writes.get((store, name))
            if entry is not None and value is not algebra.ZERO and store.memory in LAID_OUT and not entry.family.unread:
                self._written.setdefault(entry.family, (sweep.title, {}))[1][store, name] = None

    def check(self) -> None:
        """Raise an error if a family of fields is stored but never read.

        Raises
        ------
        FieldError
            Names block, store and component.
        """
        for family, (title, written) in self._written.items():
            if family not in self._families and not any(name in self._read for _, name in written):
                store, name = next(iter(written))
                raise FieldError(f"{title}: {store}.{name} is stored, and no block or formula reads {family}")


def expand(
    system: System,
    sweeps: Iterable[str],
    read_outside: Iterable[Place] = (),
    progress: Progress = silent,
    whole: bool = True,
    given: Set[Place] = frozenset(),
    alone: bool = True,
    gradients: bool = False,
) -> Program:
    """Write the blocks of the named sweeps for every kind, simplify them and lay out their memory.

    `read_outside` are fields (memory, kind, field) that formulas read; `progress` is called for every sweep; `whole` says
    that all functions are generated, so that every stored value should be read. `given`, `alone` and
    `gradients`: see `SecondOrder`.

    Raises
    ------
    FieldError
        A block loads a field that no block stores, or (with `whole`) stores a field that no block loads.
    """
    wanted = set(sweeps)
    twice = {s for s in DIFFERENTIATED_TWICE if {along_name(s), adjoint_name(s)} & parts_of(wanted)}
    chosen = [s for s in SWEEPS if s.name in wanted | twice and s.kinds(system)]
    patterns = Patterns(system)
    program = Program(system, read_outside=set(read_outside))
    start = time.perf_counter()
    for sweep in _timed(program, chosen, "finding zeros", progress):
        patterns.settle(sweep)
        program.blocks[sweep.name] = {}
    while patterns.overruled:
        patterns.overruled = False
        for sweep in chosen:
            patterns.settle(sweep)
    field_use = FieldUse(program.read_outside)
    originals = _expand(program, patterns, chosen, wanted, progress, field_use)
    if whole:
        field_use.check()
    if originals:
        second = SecondOrder(patterns, originals, wanted, given, alone, gradients)
        chosen += _differentiated_twice(program, chosen, second)
    linked = _links(program, patterns, chosen)
    _choose(program, linked)
    program.report.append(("expand", _Counter(program).total(), time.perf_counter() - start))
    start = time.perf_counter()
    _drop_unread(program, linked)
    counter = _Counter(program)
    program.report.append(("drop unread values", counter.total(), time.perf_counter() - start))
    for done, (name, function) in enumerate(PASSES):
        start = time.perf_counter()
        for sweep in _timed(program, chosen, "simplifying", progress, done, len(PASSES)):
            blocks = program.blocks[sweep.name]
            for k, block in blocks.items():
                blocks[k] = function(block)
        program.report.append((name, counter.total(), time.perf_counter() - start))
    _drop_unread(program, _links(program, patterns, chosen))
    _lay_out(program)
    return program


def _expand(
    program: Program, patterns: Patterns, chosen: list[Sweep], wanted: set[str], progress: Progress, field_use: FieldUse
) -> dict[str, dict[int, Original]]:
    """Writes all blocks; returns the original blocks of the sweeps that `second_order` differentiates."""
    originals: dict[str, dict[int, Original]] = {
        s: {} for s in DIFFERENTIATED_TWICE if {along_name(s), adjoint_name(s)} & parts_of(wanted)
    }
    for sweep in _timed(program, chosen, "expanding", progress):
        for kind in sweep.kinds(program.system):
            block, original = _written(patterns, field_use, sweep, kind)
            program.blocks[sweep.name][kind.index] = block
            if sweep.name in originals:
                originals[sweep.name][kind.index] = original
    return originals


def _differentiated_twice(program: Program, chosen: list[Sweep], second: SecondOrder) -> list[Sweep]:
    """Adds the blocks that are derived from those of other sweeps; returns their sweeps."""
    wanted = second.wanted
    program.blocks |= {s: b for s, b in second.blocks().items() if s in wanted}
    only_differentiated = second.originals.keys() - wanted
    for name in only_differentiated:
        del program.blocks[name]
    chosen[:] = [s for s in chosen if s.name not in only_differentiated]
    program.read_outside |= read_outside_twice(program.system)
    return [s for s in TWICE if s.name in program.blocks]


def _written(patterns: Patterns, field_use: FieldUse, sweep: Sweep, kind: UnitKind) -> tuple[Block, Original]:
    """The block of a kind before simplification, and its original statements."""
    x = Expansion(
        f"{sweep.name}_{kind.index}", sweep.title, partial(patterns.is_nonzero, kind, sweep),
        partial(patterns.number, kind, sweep), kind.alias_of, sweep.tangents, sweep.units,
    )  # fmt: skip
    write_block(sweep, x, kind)
    patterns.check_loads(sweep, kind, x)
    field_use.note(sweep, x)
    original = Original.of(x)
    block = x.finish()
    _check_pattern(patterns, kind, sweep, propagate_copies(block))
    return block, original.finished(block)


def _timed(
    program: Program, sweeps: list[Sweep], stage: str, progress: Progress, done: int = 0, rounds: int = 1
) -> Iterator[Sweep]:
    """Yields the sweeps one by one, reports progress, and measures each sweep's time. The sweeps run in several
    `rounds`, of which `done` are complete."""
    for step, sweep in enumerate(sweeps, 1 + done * len(sweeps)):
        progress(stage, step, rounds * len(sweeps))
        clock = time.perf_counter()
        yield sweep
        spent = time.perf_counter() - clock
        program.sweep_seconds[sweep.name] = program.sweep_seconds.get(sweep.name, 0.0) + spent


def _check_pattern(patterns: Patterns, kind: UnitKind, sweep: Sweep, block: Block) -> None:
    """Check that stored values agree with the pattern: other blocks read zeros and known numbers from the pattern."""
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


class _Counter:
    """Counts operations of all blocks; counts of unchanged blocks are reused."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._known: dict[int, tuple[Block, Operations]] = {}

    def total(self) -> Operations:
        blocks = [b for of_sweep in self._program.blocks.values() for b in of_sweep.values()]
        found = {id(b): self._known.get(id(b)) or (b, sum(count(b), Operations())) for b in blocks}
        self._known = found
        return sum((operations for _, operations in found.values()), Operations())


@dataclass(slots=True)
class _Links:
    """Connections of a block with other blocks: the places where each store writes (None for memory without a layout),
    and the places from which each load may come."""

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
    """Places on which some result depends. Places that only operands of values with two expressions need are left out."""
    needed: set[Place] = set(program.read_outside)
    before = -1
    read: dict[int, frozenset[int]] = {}
    while before != len(needed):
        before = len(needed)
        for n, of in reversed([*enumerate(blocks)]):  # later blocks read most of the needed places
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
    """The given symbols and those on which they depend. The search does not go beyond symbols in `ends`."""
    found = set(symbols)
    for statement in reversed(block.statements):
        if statement.target in found and statement.target not in ends:
            found |= symbols_of(statement.expression)
    return found


def _choose(program: Program, linked: list[_Links]) -> None:
    """For a value with two expressions, chooses the second if the first has operands that nothing else needs.

    Also chooses the second if it costs less and all of its operands are needed anyway.
    """
    if not any(of.block.otherwise for of in linked):
        return
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


def _drop_unread(program: Program, linked: list[_Links]) -> None:
    """Removes statements on which no result depends, across blocks; a store is needed if a needed statement loads
    it."""
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
    for sweep in (*SWEEPS, *TWICE):
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
    }  # these sweeps share the code that sets the ground's tangent
    program.fields = {memory: list(names) for memory, names in found.items()}
    program.transient = _transient(program)


def _transient(program: Program) -> dict[str, list[str]]:
    """For each sweep, the components of records that only neighbouring links read, and only within this sweep.

    They need memory for one path through the tree only, which stays in the cache.
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
