"""Sweeps run backwards: what the transpose of a function over directions is made of.

Of every sweep over directions there are two more (`sweeps.backwards`): one gives the scalars that the sweep itself would
hand from link to link, in the same order, and keeps them; the other is its transpose, from the last link to the first
(`codegen.program.transpose`). Nothing here knows what a sweep computes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from ..program.block import Block, Component
from ..program.passes import drop_dead, simplify
from ..program.store import Life, Memory, Store
from ..program.transpose import Adjoints, Kept, transposed, values
from .expansion import Program
from .stores import DQ, DU, KEPT, LAID_OUT, LINK, MARGIN
from .sweeps import SWEEP, transpose_name, values_name

Name = tuple[Memory, str]
"""A component of a sort of memory, whosever it is."""

_KEPT: dict[Store, Store] = {}


def kept(store: Store) -> Store:
    """Where scalars of a record are kept for the sweeps that run backwards."""
    found = _KEPT.get(store)
    if found is None:
        found = _KEPT[store] = Store(f"kept_{store.name}", store.owner, KEPT[store.memory], store.adds, store.place)
    return found


def _is_margin(store: Store) -> bool:
    return store.memory is MARGIN


def _is_none(store: Store) -> bool:
    return False


def _names(blocks: Iterable[Block], stored: bool) -> set[Name]:
    """What blocks store, or load."""
    if stored:
        return {(a.memory, n) for b in blocks for a, n, _ in b.stores}
    return {(a.memory, n) for b in blocks for a, n in b.loads.values()}


def transpose_sweeps(
    program: Program, sweeps: Iterable[str], formulas: Iterable[Block] = (), checked: Collection[str] = ()
) -> None:
    """Add the transposes of sweeps over directions to a program, and the sweeps that give them their scalars.

    `formulas` are tangents of formulas that run with the sweeps; of those in `checked` nobody else looks at the pivots.
    """
    chosen = [s for s in sweeps if s in program.blocks]
    formulas = list(formulas)
    read: dict[str, set[Name]] = {s: _names(program.blocks[s].values(), False) for s in chosen}
    written: dict[str, set[Name]] = {s: _names(program.blocks[s].values(), True) for s in chosen}
    wanted = set[Name]().union(*read.values(), _names(formulas, False))
    before = set[Name]()
    for sweep in chosen:
        before = before | written[sweep]  # what this sweep or one before it stores
        several = set[Name]().union(*(w for s, w in written.items() if s != sweep))

        def holds(store: Store, name: str, before: set[Name] = before) -> bool:
            return store.memory in KEPT and (store.memory, name) in before

        def cleared(store: Store, name: str, several: set[Name] = several) -> bool:
            # completion replaces seeds: what is left of their adjoints belongs to the given ones
            if store.name in (DQ.name, DU.name):
                return True
            if store.memory not in LAID_OUT:
                return False
            return store.memory.life is Life.SWEEP or (store.memory, name) in several

        keeping = Kept(holds, kept, lambda store: store.owner is LINK)
        adjoints = Adjoints(lambda store, name: False, cleared)
        title = SWEEP[sweep].title
        backwards: dict[int, Block] = {}
        forwards: dict[int, Block] = {}
        for kind, block in program.blocks[sweep].items():
            useful = Block(block.name, block.title, block.loads, block.statements, [
                (a, n, e) for a, n, e in block.stores if not (a.lanes and a.memory in LAID_OUT) or (a.memory, n) in wanted
            ])  # fmt: skip
            made = transposed(useful, f"{transpose_name(sweep)}_{kind}", f"transpose of {title}", adjoints, keeping)
            backwards[kind] = simplify(made)
            forwards[kind] = values(
                block, f"{values_name(sweep)}_{kind}", f"values of {title}", keeping,
                _is_margin if sweep in checked else _is_none,
            )  # fmt: skip
        program.blocks[transpose_name(sweep)] = backwards
        program.blocks[values_name(sweep)] = forwards
        program.slots[transpose_name(sweep)] = program.slots.get(sweep, [])
    _keep_needed(program, chosen)
    for memory in KEPT.values():
        names: dict[str, None] = {}
        for sweep in chosen:
            for block in program.blocks.get(values_name(sweep), {}).values():
                names |= {n: None for a, n, _ in block.stores if a.memory is memory}
        program.fields[memory] = list(names)


def _keep_needed(program: Program, chosen: list[str]) -> None:
    """Drop the scalars that nobody reads, and the sweeps that have none left."""
    needed = {at for s in chosen for b in program.blocks[transpose_name(s)].values() for at in _kept_names(b)}

    def useful(block: Block) -> Block:
        stores = [(a, n, e) for a, n, e in block.stores if (a.memory, n) in needed or a.memory is MARGIN]
        return drop_dead(Block(block.name, block.title, block.loads, block.statements, stores))

    before = -1
    while before != len(needed):
        before = len(needed)
        for s in chosen:
            for block in program.blocks[values_name(s)].values():
                needed |= set(_kept_names(useful(block)))
    for s in chosen:
        blocks = program.blocks[values_name(s)]
        program.blocks[values_name(s)] = {kind: useful(block) for kind, block in blocks.items()}
    for s in chosen:
        for name in (values_name(s), transpose_name(s)):
            if not any(b.stores for b in program.blocks[name].values()):
                del program.blocks[name]


def _kept_names(block: Block) -> Iterable[Name]:
    loaded: Iterable[Component] = block.loads.values()
    return ((a.memory, n) for a, n in loaded if a.memory in KEPT.values())
