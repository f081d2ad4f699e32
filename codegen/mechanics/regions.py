"""Which links are resolved together: ears, the regions they belong to, and the order of everything.

Section 4 of the theory page. An **ear** is a set of links on cycles, resolved together: the new links of a loop, of the several
loops of a cluster, or, without any loop, one link whose joint is independent. A **region** is a set of ears whose links all
move as functions of the same few **sources**: independent speeds, and perhaps one link that is resolved elsewhere (``A_k = Z_k w``). A
ladder of any length is one region with one source. Where a loop closes a long chain, its ear is a region of its own and the link it
starts from the source.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..loops.partition import Partition
from ..model.model import GROUND, Model
from .joints import FREEDOMS
from .links import Link

MOST_SOURCES = 5
"""Loops whose links share at most so many independent speeds form one region; with six or more a link's own acceleration is
the shorter description."""


@dataclass(slots=True, eq=False)
class Closure:
    """A loop as an ear sees it.

    Attributes
    ----------
    loop : int
        Index into `Model.loops`.
    paths : tuple of two tuples of int
        For the start and the end face: places among the ear's links, from the root outward, of the links that move the face.
    roots : tuple of two int
        Where the paths begin: place among the ear's roots; -1 for both where both begin at the same link.
    """

    loop: int
    paths: tuple[tuple[int, ...], tuple[int, ...]]
    roots: tuple[int, int]
    faces: tuple[int, int]
    """Place of the link of each face among the ear's links; minus one minus the place among its roots where that is a root."""


@dataclass(slots=True, eq=False)
class EarLinks:
    """An ear as links.

    Attributes
    ----------
    links : list of int
        Outward.
    parents : list of int
        For each link, the place of its parent among `links`, or minus one minus its place among `roots`.
    roots : list of int
        Links outside, or `GROUND`, that the ear's links and faces hang on.
    closures : list of Closure
    dependent : list of list of int
        For each link, which of its freedoms are dependent.
    columns : list of dict of int to int
        For each link, independent freedom to the number of its source in the region.
    length : float
        Characteristic length, m.
    """

    region: int
    links: list[int]
    parents: list[int] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    dependent: list[list[int]] = field(default_factory=list)
    columns: list[dict[int, int]] = field(default_factory=list)
    length: float = 1.0


@dataclass(slots=True, eq=False)
class Region:
    """Ears whose links move with the same sources.

    Attributes
    ----------
    base : int
        Link whose axes are used, or `GROUND`.
    rigid : bool
        The loops close within the region whatever the base does: it carries the region like a rigid subtree. Otherwise the base's six
        components are sources.
    freedoms : list of (int, int)
        Sources: link and freedom of the independent speeds.
    """

    base: int
    rigid: bool
    ears: list[int] = field(default_factory=list)
    freedoms: list[tuple[int, int]] = field(default_factory=list)

    @property
    def carried(self) -> bool:
        """The base is a link."""
        return self.base != GROUND


@dataclass(slots=True)
class Unit:
    """What one call of a sweep works on: a link, an ear or a region."""

    role: str
    number: int
    links: tuple[int, ...]


@dataclass(slots=True)
class Regions:
    """The loops of a model as links.

    Attributes
    ----------
    ear_of : list of int or None
        For each link.
    order : list of Unit
        Outward.
    """

    regions: list[Region]
    ears: list[EarLinks]
    ear_of: list[int | None]
    order: list[Unit]


def link_of_speeds(links: Sequence[Link]) -> dict[int, tuple[int, int]]:
    """Link and freedom of every speed."""
    return {link.u + j: (i, j) for i, link in enumerate(links) for j in range(FREEDOMS[link.joint])}


def path_to_ground(links: Sequence[Link], link: int) -> list[int]:
    """The link, its parent, and so on; without the ground."""
    path = []
    while link != GROUND:
        path.append(link)
        link = links[link].parent
    return path


def cycle(links: Sequence[Link], start: int, end: int) -> tuple[list[int], list[int], int]:
    """Links that move one face against the other, on both sides from the face inward, and the link where both sides meet."""
    a, b = start, end
    sides: tuple[list[int], list[int]] = ([], [])
    # links are numbered outward, so the larger number is never an ancestor of the smaller one
    while a != b:
        if a > b:
            sides[0].append(a)
            a = links[a].parent
        else:
            sides[1].append(b)
            b = links[b].parent
    return sides[0], sides[1], a


def find_regions(
    model: Model, links: Sequence[Link], carriers: Sequence[tuple[int, object]], partition: Partition | None
) -> Regions:
    """Ears, regions and the order of everything."""
    if partition is None or not partition.ears:
        units = [Unit("link", i, (i,)) for i in range(len(links))]
        return Regions([], [], [None] * len(links), units)
    place = link_of_speeds(links)
    dependent = {place[u] for ear in partition.ears for u in ear.dependent}
    faces = [
        tuple(GROUND if f.body == GROUND else carriers[f.body][0] for f in (loop.start, loop.end))
        for loop in model.loops
    ]
    cycles = [cycle(links, *f) for f in faces]
    regions: list[Region] = []
    ears: list[EarLinks] = []
    ear_of: list[int | None] = [None] * len(links)
    for group in _components(len(links), cycles, partition):
        on_cycles = sorted({i for e in group for loop in partition.ears[e].loops for i in (*cycles[loop][0], *cycles[loop][1])})
        free = [(i, j) for i in on_cycles for j in range(FREEDOMS[links[i].joint]) if (i, j) not in dependent]
        base = min(cycles[loop][2] for e in group for loop in partition.ears[e].loops)
        if len(free) > MOST_SOURCES and _by_single_ears(links, cycles, partition, group, dependent, regions, ears, ear_of, faces):
            continue
        region = Region(base, True, freedoms=free)
        regions.append(region)
        number = {f: c for c, f in enumerate(free)}
        for e in group:
            loops = partition.ears[e].loops
            new = sorted({i for loop in loops for i in (*cycles[loop][0], *cycles[loop][1]) if ear_of[i] is None})
            first = {i for i in new if any((i, j) in dependent for j in range(FREEDOMS[links[i].joint]))}
            # links inboard of all dependent ones have their own, loopless ears: then equal loops are of one kind
            inner = [i for i in new if i not in first and not first.intersection(path_to_ground(links, i))]
            for i in inner:
                _add_ear(links, regions, ears, ear_of, len(regions) - 1, [i], (), faces, dependent, number, 1.0)
            rest = [i for i in new if i not in inner]
            _add_ear(links, regions, ears, ear_of, len(regions) - 1, rest, loops, faces, dependent, number, partition.ears[e].length)
    return Regions(regions, ears, ear_of, _order(links, regions, ears, ear_of))


def _components(count: int, cycles: Sequence[tuple[list[int], list[int], int]], partition: Partition) -> list[list[int]]:
    """Ears that share links on their cycles, directly or through others, in their order."""
    owner: dict[int, int] = {}
    group = list(range(len(partition.ears)))

    def find(e: int) -> int:
        while group[e] != e:
            group[e] = group[group[e]]
            e = group[e]
        return e

    for e, ear in enumerate(partition.ears):
        for loop in ear.loops:
            for i in (*cycles[loop][0], *cycles[loop][1]):
                if i in owner:
                    a, b = find(owner[i]), find(e)
                    group[max(a, b)] = min(a, b)
                else:
                    owner[i] = e
    found: dict[int, list[int]] = {}
    for e in range(len(group)):
        found.setdefault(find(e), []).append(e)
    return list(found.values())


def _by_single_ears(
    links: Sequence[Link],
    cycles: Sequence[tuple[list[int], list[int], int]],
    partition: Partition,
    group: Sequence[int],
    dependent: set[tuple[int, int]],
    regions: list[Region],
    ears: list[EarLinks],
    ear_of: list[int | None],
    faces: Sequence[tuple[int, ...]],
) -> bool:
    """Every ear of a component as a region of its own, with the link that it starts from as source. False where some ear starts from two
    links, neither of them the ground."""
    made = []
    taken: set[int] = set()
    for e in group:
        loops = partition.ears[e].loops
        new = sorted({i for loop in loops for i in (*cycles[loop][0], *cycles[loop][1])} - taken)
        moved = {i for i in new if any((i, j) in dependent for j in range(FREEDOMS[links[i].joint]))}
        moved = {i for i in moved if any((i, j) in {_place for _place in dependent} for j in range(FREEDOMS[links[i].joint]))}
        members = [i for i in new if moved.intersection(path_to_ground(links, i))]
        outside = {links[i].parent for i in members if links[i].parent not in members}
        outside |= {f for loop in loops for f in faces[loop] if f not in members}
        full = sorted(outside - {GROUND})
        if len(full) > 1:
            return False
        made.append((members, loops, full, partition.ears[e].length))
        taken |= set(members)
    for members, loops, full, length in made:
        base = full[0] if full else GROUND
        inside = [(i, j) for i in members for j in range(FREEDOMS[links[i].joint]) if (i, j) not in dependent]
        # a loop that hangs on one link alone closes whatever that link does
        rigid = not full or all(cycles[loop][2] == base for loop in loops)
        regions.append(Region(base, rigid, freedoms=inside))
        number = {f: c for c, f in enumerate(inside)}
        _add_ear(links, regions, ears, ear_of, len(regions) - 1, members, loops, faces, dependent, number, length)
    return True


def _add_ear(
    links: Sequence[Link],
    regions: list[Region],
    ears: list[EarLinks],
    ear_of: list[int | None],
    region: int,
    members: list[int],
    loops: Sequence[int],
    faces: Sequence[tuple[int, ...]],
    dependent: set[tuple[int, int]],
    number: dict[tuple[int, int], int],
    length: float,
) -> None:
    ear = EarLinks(region, members, length=length)
    place = {i: k for k, i in enumerate(members)}

    def where(i: int) -> int:
        if i in place:
            return place[i]
        if i not in ear.roots:
            ear.roots.append(i)
        return -1 - ear.roots.index(i)

    for i in members:
        ear.parents.append(where(links[i].parent))
        freedoms = range(FREEDOMS[links[i].joint])
        ear.dependent.append([j for j in freedoms if (i, j) in dependent])
        ear.columns.append({j: number[i, j] for j in freedoms if (i, j) not in dependent})
        ear_of[i] = len(ears)
    for loop in loops:
        sides: list[tuple[int, ...]] = []
        roots: list[int] = []
        ends: list[int] = []
        for face in faces[loop]:
            path = []
            i = face
            while i in place:
                path.append(place[i])
                i = links[i].parent
            sides.append(tuple(reversed(path)))
            roots.append(-1 - where(i))
            ends.append(where(face))
        common = {*sides[0]} & {*sides[1]}
        paths = tuple(tuple(k for k in side if k not in common) for side in sides)
        if common or roots[0] == roots[1]:
            roots = [-1, -1]
        ear.closures.append(Closure(loop, paths, (roots[0], roots[1]), (ends[0], ends[1])))  # type: ignore[arg-type]
    regions[region].ears.append(len(ears))
    ears.append(ear)


def _order(
    links: Sequence[Link], regions: list[Region], ears: list[EarLinks], ear_of: list[int | None]
) -> list[Unit]:
    """Units outward: everything after what it hangs on, otherwise in the order of links."""
    region_units = [Unit("region", r, () if x.base == GROUND else (x.base,)) for r, x in enumerate(regions)]
    units = [Unit("link", i, (i,)) for i in range(len(links)) if ear_of[i] is None]
    units += region_units
    units += [Unit("ear", e, tuple(ear.links)) for e, ear in enumerate(ears)]
    of_link: dict[int, int] = {}
    of_region: dict[int, int] = {}
    for n, unit in enumerate(units):
        if unit.role == "region":
            of_region[unit.number] = n
        else:
            of_link.update(dict.fromkeys(unit.links, n))
    needs: list[set[int]] = []
    keys: list[tuple[int, int, int]] = []
    for n, unit in enumerate(units):
        if unit.role == "link":
            before = {links[unit.number].parent}
            keys.append((unit.number, 1, n))
            needs.append({of_link[i] for i in before if i != GROUND})
        elif unit.role == "region":
            region = regions[unit.number]
            first = min(i for e in region.ears for i in ears[e].links)
            keys.append((first, 0, n))
            needs.append(set() if region.base == GROUND else {of_link[region.base]})
        else:
            ear = ears[unit.number]
            keys.append((ear.links[0] if ear.links else 0, 1, n))
            needs.append({of_link[i] for i in ear.roots if i != GROUND} | {of_region[ear.region]})
    followers: list[list[int]] = [[] for _ in units]
    waiting = [len(x) for x in needs]
    for n, x in enumerate(needs):
        for before_n in x:
            followers[before_n].append(n)
    ready = [keys[n] for n in range(len(units)) if not waiting[n]]
    heapq.heapify(ready)
    order: list[Unit] = []
    while ready:
        n = heapq.heappop(ready)[2]
        order.append(units[n])
        for m in followers[n]:
            waiting[m] -= 1
            if not waiting[m]:
                heapq.heappush(ready, keys[m])
    assert len(order) == len(units)
    return order
