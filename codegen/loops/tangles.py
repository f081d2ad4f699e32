"""Ears that start from each other's bodies: none of them can be resolved first, so they are one dense system.

A loop may close by itself for every motion of what came before and still carry, on the bodies that its dependents move,
the joints of another ear that its own cut depends on.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    hangs_on: list[set[int]] = []
    for e, loops in enumerate(ears):
        passed = {k for i in loops for side in geometry.cycle(i) for k in side}
        new = sorted((k for k in passed if k not in owner), key=lambda k: geometry.depth[k])
        outer: set[int] = set()
        for k in new:
            if geometry.parent[k] in outer or dependent.intersection(geometry.speeds[k]):
                outer.add(k)
        owner |= {k: e if k in outer else -1 for k in new}
        faces = {k for i in loops for k in (geometry.starts[i], geometry.ends[i])}
        hangs_on.append(faces | {geometry.parent[k] for k in outer})
    before = [{owner[k] for k in bodies if owner.get(k, -1) not in (-1, e)} for e, bodies in enumerate(hangs_on)]
    found = sorted(tangle(before))
    if not found:
        return list(ears)
    # where the last one stands: the tangle needs whatever the others needed
    one = tuple(sorted(i for e in found for i in ears[e]))
    kept = [(one if e == found[-1] else x) for e, x in enumerate(ears) if e == found[-1] or e not in found]
    return untangled(geometry, kept, dependent)


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
