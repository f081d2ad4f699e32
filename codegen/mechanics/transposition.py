"""Transposes of sweeps over directions.

Every sweep over directions gives two more (`sweeps.backwards`). One computes and keeps the scalars that the sweep itself would
propagate from link to link, in the same order. The other is its transpose, from the last link to the first
(`codegen.program.transpose`). Nothing here depends on what a sweep computes.

Transposes of the balance are merged: see `gradient`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from ..program.block import Block, Component
from ..program.passes import by_results, drop_dead, simplify
from ..program.store import MARGIN, Life, Memory, Store
from ..program.transpose import Kept, transposed, values
from .expansion import Program
from .gradient import run_together
from .stores import DQ, DU, KEPT, LAID_OUT, LINK
from .sweeps import GRADIENT_IN, GRADIENT_IN_CLOSED, GRADIENT_OUT, SWEEP, transpose_name, values_name

Name = tuple[Memory, str]
"""A type of memory and the name of a component, for any owner."""

_KEPT: dict[Store, Store] = {}


def kept(store: Store) -> Store:
    """The store that keeps, for transposes, scalars that a sweep would propagate in the given store."""
    found = _KEPT.get(store)
    if found is None:
        if store.adds:
            found = kept(store.plain).sum
        else:
            found = Store(f"kept_{store.name}", store.owner, KEPT[store.memory], place=store.place)
        _KEPT[store] = found
    return found


def _names(blocks: Iterable[Block], stored: bool) -> set[Name]:
    """The components that blocks store or, without `stored`, load."""
    if stored:
        return {(a.memory, n) for b in blocks for a, n, _ in b.stores}
    return {(a.memory, n) for b in blocks for a, n in b.loads.values()}


def transpose_sweeps(
    program: Program,
    sweeps: Iterable[str],
    formulas: Iterable[Block] = (),
    checked: Collection[str] = (),
    together: Collection[str] = (),
    alone: bool = False,
) -> None:
    """Add the transposes of sweeps over directions to a program, and the sweeps that compute scalars for them.

    `formulas` are tangents of formulas that run with the sweeps. Sweeps in `checked` check pivots, since no other sweep does.
    `together` lists the merged sweeps of `gradient` to use; `alone`: no other transposes follow them.
    """
    chosen = [s for s in sweeps if s in program.blocks]
    formulas = list(formulas)
    read: dict[str, set[Name]] = {s: _names(program.blocks[s].values(), False) for s in chosen}
    written: dict[str, set[Name]] = {s: _names(program.blocks[s].values(), True) for s in chosen}
    wanted = set[Name]().union(*read.values(), _names(formulas, False))
    before = set[Name]()
    for sweep in chosen:
        before = before | written[sweep]  # scalars that this sweep or an earlier one has stored
        several = set[Name]().union(*(w for s, w in written.items() if s != sweep))

        def holds(store: Store, name: str, before: set[Name] = before) -> bool:
            return store.memory in KEPT and (store.memory, name) in before

        def cleared(store: Store, name: str, several: set[Name] = several) -> bool:
            # completion replaces seeds: the remaining adjoints are those of the given seeds
            is_used_anew = store.memory.life is Life.SWEEP or (store.memory, name) in several
            return store.name in (DQ.name, DU.name) or (store.memory in LAID_OUT and is_used_anew)

        keeping = Kept(holds, kept, lambda store: store.owner is LINK)
        title = SWEEP[sweep].title
        backwards: dict[int, Block] = {}
        forwards: dict[int, Block] = {}
        for kind, block in program.blocks[sweep].items():
            useful = Block(block.name, block.title, block.loads, block.statements, [
                (a, n, e) for a, n, e in block.stores if not (a.lanes and a.memory in LAID_OUT) or (a.memory, n) in wanted
            ])  # fmt: skip
            backwards[kind] = transposed(
                useful, f"{transpose_name(sweep)}_{kind}", f"transpose of {title}", cleared, keeping
            )
            forwards[kind] = values(
                block, f"{values_name(sweep)}_{kind}", f"values of {title}", keeping,
                (lambda store: store.memory is MARGIN) if sweep in checked else (lambda store: False),
            )  # fmt: skip
        program.blocks[transpose_name(sweep)] = backwards
        program.blocks[values_name(sweep)] = forwards
        program.slots[transpose_name(sweep)] = program.slots.get(sweep, [])
    if together:
        run_together(program, GRADIENT_IN_CLOSED in together, alone)
    made = [s for sweep in chosen for s in (values_name(sweep), transpose_name(sweep)) if s in program.blocks]
    made += [s for s in (GRADIENT_OUT, GRADIENT_IN, GRADIENT_IN_CLOSED) if s in program.blocks]
    _keep_needed(program, made)
    for memory in KEPT.values():
        blocks = [block for sweep in made for block in program.blocks.get(sweep, {}).values()]
        program.fields[memory] = list(dict.fromkeys(n for b in blocks for a, n, _ in b.stores if a.memory is memory))


def _keep_needed(program: Program, made: list[str]) -> None:
    """Removes scalars that are never read, and sweeps that compute only such scalars."""
    needed: set[Name] = set()

    def useful(block: Block) -> Block:
        stores = [(a, n, e) for a, n, e in block.stores if a.memory not in _ALL_KEPT or (a.memory, n) in needed]
        return Block(block.name, block.title, block.loads, block.statements, stores)

    before = -1
    read: dict[tuple[str, int], int] = {}
    while before != len(needed):
        before = len(needed)
        for s in reversed(made):  # later sweeps read most of the scalars that a sweep keeps
            for kind, block in program.blocks[s].items():
                part = useful(block)
                if read.get((s, kind)) != len(part.stores):
                    read[s, kind] = len(part.stores)
                    needed |= set(_kept_names(drop_dead(part)))
    for s in made:
        program.blocks[s] = {kind: simplify(drop_dead(useful(block))) for kind, block in program.blocks[s].items()}
        if s in (GRADIENT_OUT, GRADIENT_IN, GRADIENT_IN_CLOSED):
            for block in program.blocks[s].values():
                block.statements = [one for statements, _ in by_results(block) for one in statements]
                block.ordered = True  # most gradients are computed for one vector of weights
        if not any(b.stores for b in program.blocks[s].values()):
            del program.blocks[s]


_ALL_KEPT = tuple(KEPT.values())


def _kept_names(block: Block) -> Iterable[Name]:
    loaded: Iterable[Component] = block.loads.values()
    return ((a.memory, n) for a, n in loaded if a.memory in _ALL_KEPT)
