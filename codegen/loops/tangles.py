"""Tangles: ears that start from each other's bodies, so that none can be closed first. They become one dense system.

A loop may close by itself for every motion of earlier loops. Still, the dependents of the loop may move bodies that
carry joints of another ear, and the cut of the loop may depend on that ear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import TypeVar

from ..records import dataclass
from .ancestry import NewJoints
from .disjoint_sets import DisjointSets
from .geometry import Geometry

T = TypeVar("T")


def untangled(geometry: Geometry, ears: Sequence[tuple[int, ...]], dependent: set[int]) -> list[tuple[int, ...]]:
    """The ears as tuples of their loops, with each tangle merged into one ear; the same list if there is no tangle.

    Parameters
    ----------
    geometry : Geometry
    ears : sequence of tuple of int
        Ears in their order.
    dependent : set of int
        Dependent speeds.
    """
    joints = NewJoints(geometry.ancestry)
    owner = {
        k: i for loops in ears for i in loops for k in joints.of(geometry.starts[i], geometry.ends[i])
    }  # the first loop that passes each body's joint
    return _untangled(geometry, ears, owner, {*_bodies_of(geometry, dependent)})


def closed_together(geometry: Geometry, ears: Sequence[tuple[int, ...]], dependent: set[int]) -> list[tuple[int, ...]]:
    """The ears that are closed as one system: a coupling joins the ears whose cycles pass the joints that it couples.

    The parameters are those of `untangled`.
    """
    joints, owner = NewJoints(geometry.ancestry), dict[int, int]()
    couplings = geometry.couplings
    for i in (i for loops in ears for i in loops if i not in couplings):
        owner |= dict.fromkeys(joints.of(geometry.starts[i], geometry.ends[i]), i)
    for i in (i for loops in ears for i in loops if i in couplings):
        bodies = couplings[i].bodies
        base = reduce(geometry.ancestry.meeting, bodies)
        base = geometry.parent[base] if base in bodies else base
        owner |= {k: i for body in bodies for k in joints.of(body, base)}
    place = {i: n for n, loops in enumerate(ears) for i in loops}
    sets = DisjointSets(len(ears))
    for i, coupling in couplings.items():
        for body in coupling.bodies:
            sets.join(place[owner[body]], place[i])
    together = joined(ears, [members for members in sets.members().values() if len(members) > 1], _as_one)
    coupled = {body for coupling in couplings.values() for body in coupling.bodies}
    return _untangled(geometry, together, owner, coupled.union(_bodies_of(geometry, dependent)))


def _untangled(
    geometry: Geometry, ears: Sequence[tuple[int, ...]], owner: Mapping[int, int], moved: set[int]
) -> list[tuple[int, ...]]:
    """The ears after each tangle is merged. `owner`: loop of each body on a cycle; `moved`: bodies that dependents move."""
    ears, couplings = list(ears), geometry.couplings
    outward = sorted(owner, key=lambda k: (geometry.depth[k], k))
    parent = {k: geometry.parent[k] for k in outward}
    while True:
        place = {i: n for n, loops in enumerate(ears) for i in loops}
        faces = [
            [k for i in loops if i not in couplings for k in (geometry.starts[i], geometry.ends[i])] for loops in ears
        ]
        members = ear_members(parent, {k: place[i] for k, i in owner.items()}, outward, faces, moved.__contains__)
        found = tangles(members.before)
        if not found:
            return ears
        ears = joined(ears, found, _as_one)


def _bodies_of(geometry: Geometry, speeds: set[int]) -> list[int]:
    return [int(geometry.speed_body[s]) for s in speeds]


def _as_one(ears: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    return tuple(sorted(i for loops in ears for i in loops))


def joined(things: Sequence[T], tangled: Sequence[Sequence[int]], join: Callable[[list[T]], T]) -> list[T]:
    """Merge the items of each tangle into one, at the place of the last of them; all items on which they depend come
    earlier."""
    last = {tangle[-1]: join([things[n] for n in tangle]) for tangle in tangled}
    gone = {n for tangle in tangled for n in tangle[:-1]}
    return [last.get(n, thing) for n, thing in enumerate(things) if n not in gone]


@dataclass(slots=True)
class Members:
    """Bodies or links that the dependents of each ear move.

    Attributes
    ----------
    moved : list of set of int
        For each ear, the nodes that its dependents move, as far out as its own cycles reach.
    before : list of set of int
        For each ear, the ears that move the nodes from which it starts.
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
    """Nodes (bodies or links) on cycles that each ear's dependents move, and the ears that each ear starts from.

    Nodes inboard of all dependents of an ear move without it, and may carry other ears.

    Parameters
    ----------
    parent, owner : mapping of int to int
        For nodes on cycles: the parent; the first ear with a cycle through the node.
    outward : iterable of int
        The same nodes, parents first.
    faces : sequence of iterable of int
        For each ear, the nodes at which its loops end.
    is_moved : callable
        Whether a node's joint has a dependent degree of freedom.
    """
    moved: list[set[int]] = [set() for _ in faces]
    carrier: dict[int, int] = {}

    def take(e: int, i: int) -> None:
        """Adds a node that ear e moves, and all nodes inboard of it that have not been added."""
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


def tangles(before: Sequence[set[int]]) -> list[list[int]]:
    """Sets of two or more items that wait for each other, directly or through others, sorted.

    The strongly connected components, by Tarjan's method (SIAM J. Comput. 1, 1972, 146-160).
    """
    found: list[list[int]] = []
    number = [-1] * len(before)
    lowest = [0] * len(before)
    stacked = [False] * len(before)
    stack: list[int] = []
    count = 0
    for start in range(len(before)):
        if number[start] >= 0:
            continue
        way = [(start, iter(sorted(before[start])))]
        number[start] = lowest[start] = count
        count += 1
        stack.append(start)
        stacked[start] = True
        while way:
            n, others = way[-1]
            for m in others:
                if number[m] < 0:
                    number[m] = lowest[m] = count
                    count += 1
                    stack.append(m)
                    stacked[m] = True
                    way.append((m, iter(sorted(before[m]))))
                    break
                if stacked[m]:
                    lowest[n] = min(lowest[n], number[m])
            else:
                way.pop()
                if way:
                    lowest[way[-1][0]] = min(lowest[way[-1][0]], lowest[n])
                if lowest[n] == number[n]:
                    component: list[int] = []
                    while not component or component[-1] != n:
                        component.append(stack.pop())
                        stacked[component[-1]] = False
                    if len(component) > 1:
                        found.append(sorted(component))
    return sorted(found)
