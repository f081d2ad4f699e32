"""Components: sets of loops that share joints. Each component can be closed independently of the others."""

from __future__ import annotations

from .disjoint_sets import DisjointSets
from .geometry import Geometry


def components(geometry: Geometry) -> list[list[int]]:
    """Sets of loops that share no moving joint, each ascending, in the order of their first loops.

    The joints of a component form a connected part of the tree. A walk along a cycle that meets such a part continues from
    the part's base. So every joint is passed about once, however long the cycles are.
    """
    depth = geometry.depth
    carrier = list(range(geometry.ground + 1))  # bodies on joints without degrees of freedom move with their parents
    for k in geometry.model.outward:
        if not geometry.speeds[k]:
            carrier[k] = carrier[geometry.parent[k]]
    joined = DisjointSets(len(geometry.starts))
    base = [0] * len(geometry.starts)
    owner: dict[int, int] = {}
    for i, (start, end) in enumerate(zip(geometry.starts, geometry.ends, strict=True)):
        if i in geometry.couplings:
            continue
        a, b = carrier[start], carrier[end]
        touched: set[int] = set()
        while a != b:
            if depth[a] < depth[b]:
                a, b = b, a
            if a in owner and owner[a] != i:
                known = joined.find(owner[a])
                touched.add(known)
                a = base[known]
            else:
                owner[a] = i
                a = carrier[geometry.parent[a]]
        base[i] = min([a, *(base[c] for c in touched)], key=depth.__getitem__)
        for c in touched:
            joined.join(c, i)
    for i, coupled in geometry.couplings.items():  # joints of a coupling need not be connected, so couplings come last
        for k in coupled.bodies:
            joined.join(owner.setdefault(k, i), i)
    return sorted(joined.members().values())
