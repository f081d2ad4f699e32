"""Walks over trees of expressions, parsed or bound: see `expressions` for their nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from ..elementary import Tree

LEAVES: Final = ("number", "name", "quantity", "slot", "parameter")


def parts(tree: Tree) -> tuple[Tree, ...]:
    """The trees directly below a node: operands, arguments, indices."""
    kind = tree[0]
    if kind in LEAVES:
        return ()
    found: tuple[Tree, ...] = tree[2:] if kind == "call" else tree[1:]
    if kind == "indexed":
        found = tree[2]
    elif kind == "component":
        found = tree[1:2]
    return found


def nodes(tree: Tree) -> Iterator[Tree]:
    """Iterate over a tree and all trees below it."""
    stack = [tree]
    while stack:
        tree = stack.pop()
        yield tree
        stack += parts(tree)


def mapped(tree: Tree, change: Callable[[Tree], Tree]) -> Tree:
    """A node with changed parts; the same object if no part changes."""
    if tree[0] in LEAVES:
        return tree
    before = parts(tree)
    after = tuple(map(change, before))
    if all(a is b for a, b in zip(after, before, strict=True)):
        return tree
    if tree[0] == "indexed":
        return (*tree[:2], after, tree[3])
    if tree[0] == "component":
        return (*tree[:1], *after, *tree[2:])
    return (*tree[: len(tree) - len(after)], *after)


def replaced(tree: Tree, old: Tree, new: Tree) -> Tree:
    """A tree with another tree in place of each part that equals `old`; the same object if there is none."""
    if old == new:
        return tree
    return new if tree == old else mapped(tree, lambda part: replaced(part, old, new))
