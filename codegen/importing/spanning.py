"""Spanning tree of a graph of links: the joints in the tree carry links; the other joints close loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from .robot import WORLD


class Edge(NamedTuple):
    """A joint between two links. If it is `loose`, it becomes part of the tree only where no other joint can."""

    name: str
    parent: str
    child: str
    loose: bool


def spanning_tree(links: Sequence[str], edges: Sequence[Edge]) -> list[tuple[str, bool]]:
    """Carriers of all links, from the ground outward: a joint, or the link itself if it is attached to the ground.

    Each entry is a name, and whether the joint is reversed, so that its child carries its parent. Joints are taken from
    parent to child. Loose joints are taken only if no other joint continues the tree, and reversed joints last. Links
    that no joint reaches are attached to the ground, first those that are nobody's child.
    """
    children = {edge.child for edge in edges}
    waiting = [*(link for link in links if link not in children), *(link for link in links if link in children)]
    ranks = [
        lambda e, reached: e.parent in reached and e.child not in reached and not e.loose,
        lambda e, reached: e.parent in reached and e.child not in reached,
        lambda e, reached: e.child in reached and e.parent not in reached,
    ]
    reached: set[str] = {WORLD}
    carriers: list[tuple[str, bool]] = []
    left = list(edges)
    while True:
        found = next(((k, e) for k, rank in enumerate(ranks) for e in left if rank(e, reached)), None)
        if found is None:
            base = next((link for link in waiting if link not in reached), None)
            if base is None:
                return carriers
            reached.add(base)
            carriers.append((base, False))
            continue
        rank, edge = found
        reached |= {edge.parent, edge.child}
        carriers.append((edge.name, rank == 2))
        left.remove(edge)
