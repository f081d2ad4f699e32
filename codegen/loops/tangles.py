"""Ears that start from each other's bodies: none of them can be resolved first, so they are one dense system.

A loop may close by itself for every motion of what came before and still carry, on the bodies that its dependents move,
the joints of another ear that its own cut depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from .geometry import Geometry


def untangled(geometry: Geometry, ears: Sequence[tuple[int, ...]], dependent: set[int]) -> list[tuple[int, ...]]:
    """The ears by their loops, those of a tangle as one; the same list where there is none.

    Parameters
    ----------
    geometry : Geometry
    ears : sequence of tuple of int
        In their order.
    dependent : set of int
        Speeds.
    """
    owner: dict[int, int] = {}
    for e, loops in enumerate(ears):
        for i in loops:
            for side in geometry.cycle(i):
                for k in side:
                    owner.setdefault(k, e)
    faces = [[k for i in loops for k in (geometry.starts[i], geometry.ends[i])] for loops in ears]
    outward = sorted(owner, key=lambda k: (geometry.depth[k], k))
    moved = {k for k in outward if dependent.intersection(geometry.speeds[k])}
    members = ear_members({k: geometry.parent[k] for k in outward}, owner, outward, faces, moved.__contains__)
    found = sorted(tangle(members.before))
    if not found:
        return list(ears)
    # where the last one stands: the tangle needs whatever the others needed
    one = tuple(sorted(i for e in found for i in ears[e]))
    kept = [(one if e == found[-1] else x) for e, x in enumerate(ears) if e == found[-1] or e not in found]
    return untangled(geometry, kept, dependent)


@dataclass(slots=True)
class Members:
    """What moves with the dependents of each ear.

    Attributes
    ----------
    moved : list of set of int
        Of each ear, the nodes that its dependents move, as far out as its own cycles go.
    before : list of set of int
        Of each ear, those that move what it starts from.
    """

    moved: list[set[int]]
    before: list[set[int]]


def ear_members(
    parent: Mapping[int, int],
    owner: Mapping[int, int],
    outward: Iterable[int],
    faces: Sequence[Iterable[int]],
    is_moved: Callable[[int], bool],
) -> Members:
    """Which nodes (bodies or links) on cycles an ear's dependents move, and what the ears start from.

    Nodes inboard of all dependents of an ear move without it, and are free to carry other ears.

    Parameters
    ----------
    parent, owner : mapping of int to int
        Of nodes on cycles: the parent; the first ear with a cycle through the node.
    outward : iterable of int
        The same nodes, parents first.
    faces : sequence of iterable of int
        Of each ear, the nodes that its loops end at.
    is_moved : callable
        Whether a node's joint has a dependent freedom.
    """
    moved: list[set[int]] = [set() for _ in faces]
    carrier: dict[int, int] = {}

    def take(e: int, i: int) -> None:
        """A node that an ear moves, and those between it and the ear."""
        while i not in moved[e]:
            moved[e].add(i)
            i = parent[i]

    for i in outward:
        e, carried = owner[i], carrier.get(parent[i])
        if carried == e:
            take(e, parent[i])
        if carried == e or is_moved(i):
            moved[e].add(i)
            carrier[i] = e
        elif carried is not None:
            carrier[i] = carried
    for e, ends in enumerate(faces):
        for i in ends:
            if carrier.get(i) == e:
                take(e, i)
    before: list[set[int]] = []
    for e, ends in enumerate(faces):
        starts = {*ends, *(parent[i] for i in moved[e])} - moved[e]
        before.append({carrier[i] for i in starts if i in carrier})
    return Members(moved, before)


def tangle(before: Sequence[set[int]]) -> set[int]:
    """Of things that wait for others, those of one tangle where all wait for each other."""
    left = set(range(len(before)))
    after: list[set[int]] = [set() for _ in before]
    for n, x in enumerate(before):
        for m in x:
            after[m].add(n)
    for waits, frees in ((before, after), (after, before)):
        count = {n: len(waits[n] & left) for n in left}
        ready = [n for n in left if not count[n]]
        while ready:
            n = ready.pop()
            left.discard(n)
            for m in frees[n]:
                if m in left:
                    count[m] -= 1
                    if not count[m]:
                        ready.append(m)
    if not left:
        return left
    found = {min(left)}
    grown = True
    while grown:
        more = {m for n in found for m in (before[n] | after[n]) & left} - found
        found |= more
        grown = bool(more)
    return found
