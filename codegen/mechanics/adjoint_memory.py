"""Memory of adjoints: equal adjoints share a place, and adjoints that only neighbours read are kept in scratch memory.

A joint transmits the sum of the forces that its link, the children and the loops require. The sum gives all its terms the
same adjoint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set

from ..program.algebra import Expr
from ..program.block import Block
from ..program.store import Memory, Store
from . import fields
from .patterns import Place
from .stores import LINK

Run = tuple[Block, Callable[[Store, str], Set[Place]]]
"""A block, and a function that gives the places to which a store or load of the block refers."""

SUMMED = (fields.total_needed, fields.closing_force, fields.transmitted, fields.tree_transmitted)
TERMS = tuple(zip(*(of.components for of in SUMMED), strict=True))
"""For each of the six components, its names in the forces of `SUMMED`."""


def merge_equal(memory: Memory, runs: Sequence[Run]) -> None:
    """If two components of adjoints are equal in every block, replace one by the other everywhere.

    Parameters
    ----------
    memory : Memory
        Memory of links.
    runs : sequence of Run
        All blocks that access the memory.
    """
    read = {p for block, places in runs for a, n in block.loads.values() if a.memory is memory for p in places(a, n)}
    for terms in TERMS:
        kept = ""
        for name in sorted(terms, key=lambda n: -sum(_stores(block, memory, n) != {} for block, _ in runs)):
            if kept and all(_is_equal(block, places, memory, name, kept, read) for block, places in runs):
                for block, _ in runs:
                    _rename(block, memory, name, kept)
                read |= {(of, kind, kept) for of, kind, n in read if n == name}
            kept = kept or name


def _stores(block: Block, memory: Memory, name: str) -> dict[Store, Expr]:
    """The values that a block stores for a component."""
    return {a: e for a, n, e in block.stores if a.memory is memory and n == name}


def _is_equal(
    block: Block, places: Callable[[Store, str], Set[Place]], memory: Memory, name: str, kept: str, read: Set[Place]
) -> bool:
    """Whether two components, `name` and `kept`, may share memory as far as this block is concerned: the block stores
    the same value for both, or it stores only one, at a place where no block reads the other."""
    first, second = _stores(block, memory, name), _stores(block, memory, kept)
    for a in first.keys() | second.keys():
        if a in first and a in second:
            if first[a] is not second[a]:
                return False
        elif not read.isdisjoint(places(a, kept if a in first else name)):
            return False
    return True


def _rename(block: Block, memory: Memory, name: str, kept: str) -> None:
    """Let a block access the component `kept` wherever it accesses `name`."""
    block.loads = {s: (a, kept if a.memory is memory and n == name else n) for s, (a, n) in block.loads.items()}
    stored = {a for a, n, _ in block.stores if a.memory is memory and n == kept}
    block.stores = [
        (a, kept if a.memory is memory and n == name else n, e)
        for a, n, e in block.stores
        if not (a.memory is memory and n == name and a in stored)
    ]


def exchange_in_scratch(scratch: Mapping[Store, Store], blocks: Sequence[tuple[str, Block]], outside: Set[str]) -> None:
    """Keep components that neighbouring links exchange within one sweep in scratch memory, which stays in the cache.

    Parameters
    ----------
    scratch : mapping of Store to Store
        The scratch memory of a link and of its parent, for the stores of their adjoints.
    blocks : sequence of (str, Block)
        All blocks that access the adjoints, with the names of their sweeps.
    outside : set of str
        Components of the ground that are read afterwards.
    """
    kept, assigned = {*outside}, set()
    sweeps: dict[str, set[str]] = {}
    memories = {store.memory for store in scratch}
    for sweep, block in blocks:
        loads = [(a, n, False) for a, n in block.loads.values()]
        for a, n, is_store in (*loads, *((a, n, True) for a, n, _ in block.stores)):
            if a.memory not in memories:
                continue
            sweeps.setdefault(n, set()).add(sweep)
            if a.plain not in scratch or is_store is (a.owner is LINK):
                kept.add(n)
            if is_store and not a.adds:
                assigned.add(n)
    moved = {n for n in assigned - kept if len(sweeps[n]) == 1}

    def place(a: Store, n: str) -> Store:
        if a.plain not in scratch or n not in moved:
            return a
        return scratch[a.plain].sum if a.adds else scratch[a.plain]

    for _, block in blocks:
        block.loads = {s: (place(a, n), n) for s, (a, n) in block.loads.items()}
        block.stores = [(place(a, n), n, e) for a, n, e in block.stores]
