"""From a system to blocks: zero patterns first, then statements, then passes.

The zero pattern of what a link receives depends on its neighbours', so patterns are found by running the block-writing code on
structural values until nothing changes; then every block is expanded once per kind with sympy, and passes are applied. What no
later block reads is removed, across blocks.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial

from sympy import Expr

from ..model.model import GROUND
from ..program.block import Block, Expansion, StructuralExpansion
from ..program.operations import Operations, count
from ..program.passes import PASSES, drop_dead
from .kinds import LinkKind, System
from .sweeps import SWEEPS, Sweep

GROUND_KIND = -1
RECORD, SLOT, LANE = "record", "slot", "lane"
"""Memory kept per link for one call; kept while neighbours need it; kept per link and direction."""

PLACES = {"me": (RECORD, False), "up": (RECORD, True), "lme": (SLOT, False), "lup": (SLOT, True), "lane": (LANE, False)}
"""Arrays that links keep values in, and whether they are the parent's."""


@dataclass(slots=True)
class Program:
    """All blocks of a system.

    Attributes
    ----------
    blocks : dict of str to dict of int to Block
        By sweep and kind.
    records, lanes : list of str
        Fields of a link's record, and of what is kept per link and direction.
    slots : dict of str to list of str
        Fields of slots, by sweep.
    transient : dict of str to list of str
        Fields of records that need a slot only, by sweep.
    ground_fields : set of str
        What is read of the ground.
    read_outside : set of (memory, kind, field)
        What formulas read after the sweeps.
    report : list of (pass, operations, seconds)
    sweep_seconds : dict of str to float
        Expanding and simplifying, by sweep.
    """

    system: System
    blocks: dict[str, dict[int, Block]] = field(default_factory=dict)
    records: list[str] = field(default_factory=list)
    lanes: list[str] = field(default_factory=list)
    slots: dict[str, list[str]] = field(default_factory=dict)
    report: list[tuple[str, Operations, float]] = field(default_factory=list)
    sweep_seconds: dict[str, float] = field(default_factory=dict)
    ground_fields: set[str] = field(default_factory=set)
    transient: dict[str, list[str]] = field(default_factory=dict)
    read_outside: set[tuple[str, int, str]] = field(default_factory=set)


class Patterns:
    """Which fields of which memory can differ from zero, by kind."""

    def __init__(self, system: System):
        self.system = system
        self.nonzero: dict[tuple[str, int], set[str]] = {}
        self.parents: dict[int, set[int]] = {k.index: set() for k in system.kinds}
        for i, link in enumerate(system.links):
            parent = GROUND_KIND if link.parent == GROUND else system.kind_of[link.parent].index
            self.parents[system.kind_of[i].index].add(parent)

    def of(self, memory: str, kind: int) -> set[str]:
        return self.nonzero.setdefault((memory, kind), set())

    def is_nonzero(self, kind: LinkKind, sweep: Sweep, array: str, name: str) -> bool:
        if array == "c":
            number = kind.number(name)
            return number is None or number != 0
        place = PLACES.get(array)
        if place is None:
            return True
        memory, of_parent = place
        key = f"{memory}:{sweep.name}" if memory == SLOT else memory
        kinds = self.parents[kind.index] if of_parent else (kind.index,)
        return any(name in self.of(key, k) for k in kinds)

    def settle(self, sweep: Sweep) -> None:
        """Run a sweep's block-writing code on patterns until they do not grow."""
        changed = True
        while changed:
            changed = False
            for kind in self.system.kinds:
                if not sweep.applies(kind):
                    continue
                x = StructuralExpansion(partial(self.is_nonzero, kind, sweep), sweep.tangents)
                sweep.write(x, kind)
                for array, name in x.stored:
                    place = PLACES.get(array)
                    if place is None:
                        continue
                    memory, of_parent = place
                    key = f"{memory}:{sweep.name}" if memory == SLOT else memory
                    for k in self.parents[kind.index] if of_parent else (kind.index,):
                        fields = self.of(key, k)
                        if name not in fields:
                            fields.add(name)
                            changed = True


def expand(system: System, sweeps: Iterable[str], read_outside: Iterable[tuple[str, int, str]] = ()) -> Program:
    """Write the blocks of the named sweeps for every kind, simplify them and lay out their memory.

    `read_outside` are fields (memory, kind, field) that formulas read.
    """
    wanted = set(sweeps)
    chosen = [s for s in SWEEPS if s.name in wanted and any(map(s.applies, system.kinds))]
    patterns = Patterns(system)
    _ground_pattern(patterns)
    program = Program(system, read_outside=set(read_outside))
    start = clock = time.perf_counter()
    seconds = program.sweep_seconds
    for sweep in chosen:
        patterns.settle(sweep)
        program.blocks[sweep.name] = {}
        seconds[sweep.name], clock = time.perf_counter() - clock, time.perf_counter()
    for sweep in chosen:
        for kind in system.kinds:
            if not sweep.applies(kind):
                continue
            nonzero = partial(patterns.is_nonzero, kind, sweep)
            x = Expansion(
                f"{sweep.name}_{kind.index}", sweep.title, nonzero, kind.number_of, kind.alias_of, sweep.tangents
            )
            sweep.write(x, kind)
            program.blocks[sweep.name][kind.index] = x.finish()
        seconds[sweep.name], clock = seconds[sweep.name] + time.perf_counter() - clock, time.perf_counter()
    program.report.append(("expand", _total(program), time.perf_counter() - start))
    start = time.perf_counter()
    _drop_unread(program, patterns, chosen)
    program.report.append(("drop what nobody reads", _total(program), time.perf_counter() - start))
    for name, function in PASSES:
        start = clock = time.perf_counter()
        for sweep_name, blocks in program.blocks.items():
            for k, block in blocks.items():
                blocks[k] = function(block)
            seconds[sweep_name], clock = seconds[sweep_name] + time.perf_counter() - clock, time.perf_counter()
        program.report.append((name, _total(program), time.perf_counter() - start))
    _drop_unread(program, patterns, chosen)
    _lay_out(program)
    return program


def _ground_pattern(patterns: Patterns) -> None:
    """The ground: at rest, accelerating by -g."""
    gravity = patterns.system.gravity
    record = patterns.of(RECORD, GROUND_KIND)
    record |= {"W.xx", "W.yy", "W.zz"}
    if gravity is None:
        return
    for name, value in gravity.shape.fields.items():
        if value != 0:
            record |= {name, "t" + name}
        if name in gravity.shape.varying:
            patterns.of(f"{SLOT}:balance_out", GROUND_KIND).add(name)


def _total(program: Program) -> Operations:
    total = Operations()
    for blocks in program.blocks.values():
        for b in blocks.values():
            total = total + count(b, False) + count(b, True)
    return total


def _key(sweep: Sweep, array: str) -> tuple[str, bool] | None:
    place = PLACES.get(array)
    if place is None:
        return None
    memory, of_parent = place
    return (f"{memory}:{sweep.name}" if memory == SLOT else memory), of_parent


def _drop_unread(program: Program, patterns: Patterns, sweeps: list[Sweep]) -> None:
    """Remove stores to link memory that no block of a neighbour or of the link itself loads, until nothing changes."""
    while True:
        read: set[tuple[str, int, str]] = set()
        for sweep in sweeps:
            for kind, block in program.blocks[sweep.name].items():
                for array, name in block.loads.values():
                    key = _key(sweep, array)
                    if key is None:
                        continue
                    memory, of_parent = key
                    read |= {(memory, k, name) for k in (patterns.parents[kind] if of_parent else (kind,))}
        read |= program.read_outside
        changed = False
        for sweep in sweeps:
            for kind, block in program.blocks[sweep.name].items():
                kept: list[tuple[str, str, Expr]] = []
                for array, name, value in block.stores:
                    key = _key(sweep, array)
                    if key is not None:
                        memory, of_parent = key
                        targets = patterns.parents[kind] if of_parent else (kind,)
                        if not any((memory, k, name) in read for k in targets):
                            continue
                    kept.append((array, name, value))
                if len(kept) != len(block.stores):
                    block.stores = kept
                    changed = True
                program.blocks[sweep.name][kind] = drop_dead(block)
        if not changed:
            program.ground_fields = {n for m, k, n in read if m == RECORD and k == GROUND_KIND}
            return


def _lay_out(program: Program) -> None:
    """Order the fields of each memory by first use."""
    records: dict[str, None] = {}
    lanes: dict[str, None] = {}
    for sweep in SWEEPS:
        slots: dict[str, None] = {}
        for block in program.blocks.get(sweep.name, {}).values():
            used = [(a, n) for a, n in block.loads.values()] + [(a, n) for a, n, _ in block.stores]
            for array, name in used:
                key = _key(sweep, array)
                if key is None:
                    continue
                {RECORD: records, LANE: lanes}.get(key[0], slots)[name] = None
        if slots:
            program.slots[sweep.name] = list(slots)
    program.records, program.lanes = list(records), list(lanes)
    program.transient = _transient(program)


def _transient(program: Program) -> dict[str, list[str]]:
    """Fields of records that only neighbours read, within the sweep that writes them, by sweep.

    They need no place of their own in every link: memory for one path through the tree will do, and stays in the cache.
    """
    flows: dict[str, dict[str, set[str]]] = {}
    crossing: set[str] = {n for m, _, n in program.read_outside if m == RECORD}
    for sweep, blocks in program.blocks.items():
        stored = {n for b in blocks.values() for a, n, _ in b.stores if a in ("me", "up")}
        from_me = {n for b in blocks.values() for a, n in b.loads.values() if a == "me"}
        from_up = {n for b in blocks.values() for a, n in b.loads.values() if a == "up"}
        handed_in = {n for b in blocks.values() for a, n, _ in b.stores if a == "up"}
        crossing |= (from_me | from_up) - stored - program.ground_fields
        crossing |= from_me - handed_in  # written by an earlier sweep
        for name in stored | from_me | from_up:
            flows.setdefault(name, {})[sweep] = {"stored"} if name in stored else set()
    for name, sweeps in flows.items():
        if any("stored" not in f for f in sweeps.values()) and name not in program.ground_fields:
            crossing.add(name)
    result: dict[str, list[str]] = {}
    for name in program.records:
        if name not in crossing:
            for sweep in flows.get(name, {}):
                result.setdefault(sweep, []).append(name)
    return result
