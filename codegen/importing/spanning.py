"""Which joints of a graph of links carry links, so that all lead to the ground, and which are left to close loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from .robot import WORLD


class Edge(NamedTuple):
    """A joint between two links; `loose` ones would rather close loops."""

    name: str
    parent: str
    child: str
    loose: bool


def spanning_tree(links: Sequence[str], edges: Sequence[Edge]) -> list[tuple[str, bool]]:
    """What carries links if they are spanned by joints, from the ground outwards.

    The name of a joint, with whether its child carries its parent, or of a link that stands on the ground by itself.
    Joints are taken from parent to child, the loose ones where no other joint leads on, backwards last. What nothing leads
    to stands on the ground, first links that are nobody's child.
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
