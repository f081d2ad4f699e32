"""Adjoints of a link's forces that are equal: one of them is kept, and read in place of the others.

A joint transmits the sum of the forces that its link, the children and the loops require. The sum gives all its terms the
same adjoint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set

from ..program.algebra import Expr
from ..program.block import Block
from ..program.store import Memory, Store
from . import fields
from .patterns import Place

Run = tuple[Block, Callable[[Store, str], Set[Place]]]
"""A block, and the places of its stores and loads."""

SUMMED = (fields.total_needed, fields.closing_force, fields.transmitted, fields.tree_transmitted)
TERMS = tuple(zip(*(of.components for of in SUMMED), strict=True))
"""The components of the forces that are summed."""


def merge_equal(memory: Memory, runs: Sequence[Run]) -> None:
    """Replace components of adjoints by others that are equal, in all blocks.

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
    """Whether a block stores the same values for two components, or only one of them where the other is not read."""
    first, second = _stores(block, memory, name), _stores(block, memory, kept)
    for a in first.keys() | second.keys():
        if a in first and a in second:
            if first[a] is not second[a]:
                return False
        elif not read.isdisjoint(places(a, kept if a in first else name)):
            return False
    return True


def _rename(block: Block, memory: Memory, name: str, kept: str) -> None:
    """Let a block access one component in place of another."""
    block.loads = {s: (a, kept if a.memory is memory and n == name else n) for s, (a, n) in block.loads.items()}
    stored = {a for a, n, _ in block.stores if a.memory is memory and n == kept}
    block.stores = [
        (a, kept if a.memory is memory and n == name else n, e)
        for a, n, e in block.stores
        if not (a.memory is memory and n == name and a in stored)
    ]
