"""Which links are resolved together: ears, the regions they belong to, and the order of everything.

Section 4 of the theory page. An **ear** is a set of links on cycles, resolved together: the new links of a loop, of the
several loops of a cluster, or, without any loop, one link whose joint is independent. A **region** is a set of ears whose
links all move as functions of the same few **sources**: independent speeds, and perhaps one link that is resolved elsewhere
(``A_k = Z_k w``). A ladder of any length is one region with one source. Where a loop closes a long chain, its ear is a
region of its own and the link it starts from the source.
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
    faces : tuple of two int
        Place of each face's link among the ear's links; minus one minus the place among its roots where it is one of those.
    """

    loop: int
    paths: tuple[tuple[int, ...], tuple[int, ...]]
    roots: tuple[int, int]
    faces: tuple[int, int]


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
        The loops close within the region whatever the base does: it carries the region like a rigid subtree. Otherwise the
        base's six components are sources.
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
    regions: list[Region] = []
    ears: list[EarLinks] = []
    ear_of: list[int | None] = [None] * len(links)
    for group, base in _components(links, faces, partition):
        bundles = _bundles(links, faces, group)
        on_cycles = sorted({i for b in bundles for i in b.links})
        free = [(i, j) for i in on_cycles for j in range(FREEDOMS[links[i].joint]) if (i, j) not in dependent]
        made = _Maker(links, regions, ears, ear_of, faces, dependent)
        if len(free) > MOST_SOURCES and made.by_single_ears(bundles):
            continue
        regions.append(Region(base, True, freedoms=free))
        number = {f: c for c, f in enumerate(free)}
        for b in bundles:
            # links inboard of all dependent ones have their own, loopless ears: then equal loops are of one kind
            outer = made.outboard_of_dependents(b.links)
            for i in b.links:
                if i not in outer:
                    made.add([i], (), number, 1.0)
            made.add([i for i in b.links if i in outer], b.loops, number, b.length)
    return Regions(regions, ears, ear_of, _order(links, regions, ears, ear_of))


def _components(
    links: Sequence[Link], faces: Sequence[tuple[int, ...]], partition: Partition
) -> list[tuple[list[Bundle], int]]:
    """Ears that share links on their cycles, directly or through others, in their order, and the link that carries them all.

    Cycles are followed from both faces inward only to links that an earlier ear has: from there its component's base is next.
    """
    group = list(range(len(partition.ears)))
    base: list[int] = [GROUND] * len(group)
    owner: dict[int, int] = {}

    def find(e: int) -> int:
        while group[e] != e:
            group[e] = group[group[e]]
            e = group[e]
        return e

    bundles: list[Bundle] = []
    for e, ear in enumerate(partition.ears):
        new: list[int] = []
        lowest: list[int] = []
        for loop in ear.loops:
            a, b = faces[loop]
            # links are numbered outward, so the larger number is never an ancestor of the smaller one
            while a != b:
                a, b = max(a, b), min(a, b)
                if a not in owner:
                    owner[a] = e
                    new.append(a)
                    a = links[a].parent
                    continue
                known = find(owner[a])
                if known == e:  # another loop of this ear has been here: on to where that ended
                    a = links[a].parent
                    continue
                group[known] = e
                lowest.append(base[known])
                if b in owner and find(owner[b]) == e:
                    break
                a = base[known]
            else:
                lowest.append(a)
        base[e] = min(lowest)
        bundles.append(Bundle(ear.loops, sorted(new), ear.length))
    found: dict[int, list[Bundle]] = {}
    for e, bundle in enumerate(bundles):
        found.setdefault(find(e), []).append(bundle)
    return [(bundles_here, base[root]) for root, bundles_here in found.items()]


@dataclass(slots=True)
class Bundle:
    """Loops that are closed together, and the links on their cycles that no earlier bundle has."""

    loops: tuple[int, ...]
    links: list[int]
    length: float


def _bundles(links: Sequence[Link], faces: Sequence[tuple[int, ...]], bundles: list[Bundle]) -> list[Bundle]:
    """The ears of a component; those that start from each other's links are joined."""
    while True:
        owner = {i: n for n, b in enumerate(bundles) for i in b.links}
        before: list[set[int]] = []
        for n, b in enumerate(bundles):
            outside = {links[i].parent for i in b.links} | {f for loop in b.loops for f in faces[loop]}
            before.append({owner[i] for i in outside if i in owner} - {n})
        tangled = sorted(_on_circles(before))
        if not tangled:
            return bundles
        joined = [bundles[n] for n in tangled]
        one = Bundle(
            tuple(loop for b in joined for loop in b.loops), sorted(i for b in joined for i in b.links),
            max(b.length for b in joined),
        )  # fmt: skip
        bundles = [b for n, b in enumerate(bundles) if n not in tangled]
        bundles.insert(min(tangled[0], len(bundles)), one)


def _on_circles(before: list[set[int]]) -> set[int]:
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


class _Maker:
    """Makes ears and regions, one component after the other."""

    def __init__(
        self,
        links: Sequence[Link],
        regions: list[Region],
        ears: list[EarLinks],
        ear_of: list[int | None],
        faces: Sequence[tuple[int, ...]],
        dependent: set[tuple[int, int]],
    ):
        self.links = links
        self.regions = regions
        self.ears = ears
        self.ear_of = ear_of
        self.faces = faces
        self.dependent = dependent

    def moved(self, i: int) -> bool:
        """Whether a link's joint has a dependent freedom."""
        return any((i, j) in self.dependent for j in range(FREEDOMS[self.links[i].joint]))

    def outboard_of_dependents(self, links: Sequence[int]) -> set[int]:
        """Of links in outward order, those with a dependent freedom, or with such a link between them and the rest."""
        found: set[int] = set()
        for i in links:
            if self.moved(i) or self.links[i].parent in found:
                found.add(i)
        return found

    def by_single_ears(self, bundles: list[Bundle]) -> bool:
        """Every ear of a component as a region of its own, with the link that it starts from as source.

        False, and nothing made, where some ear starts from two links, neither of them the ground, or from one of another ear.
        """
        plan: list[tuple[list[int], Bundle, int, bool]] = []
        taken: set[int] = set()
        for b in bundles:
            outer = self.outboard_of_dependents(b.links)
            members = [i for i in b.links if i in outer]
            outside = {self.links[i].parent for i in members} | {f for loop in b.loops for f in self.faces[loop]}
            full = sorted(outside - set(members) - {GROUND})
            base = full[0] if full else GROUND
            # a loop that hangs on one link alone closes whatever that link does
            rigid = not full or GROUND not in outside
            if len(full) > 1 or (base in taken and not rigid):
                return False
            plan.append((members, b, base, rigid))
            taken |= set(members)
        for members, b, base, rigid in plan:
            inside = [
                (i, j) for i in members for j in range(FREEDOMS[self.links[i].joint]) if (i, j) not in self.dependent
            ]
            self.regions.append(Region(base, rigid, freedoms=inside))
            self.add(members, b.loops, {f: c for c, f in enumerate(inside)}, b.length)
        return True

    def add(self, members: list[int], loops: Sequence[int], number: dict[tuple[int, int], int], length: float) -> None:
        """An ear of the last region."""
        links = self.links
        ear = EarLinks(len(self.regions) - 1, members, length=length)
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
            ear.dependent.append([j for j in freedoms if (i, j) in self.dependent])
            ear.columns.append({j: number[i, j] for j in freedoms if (i, j) not in self.dependent})
            self.ear_of[i] = len(self.ears)
        for loop in loops:
            sides: list[tuple[int, ...]] = []
            roots: list[int] = []
            for face in self.faces[loop]:
                path = []
                i = face
                while i in place:
                    path.append(place[i])
                    i = links[i].parent
                sides.append(tuple(reversed(path)))
                roots.append(-1 - where(i))
            common = {*sides[0]} & {*sides[1]}
            a, b = (tuple(k for k in side if k not in common) for side in sides)
            if common or roots[0] == roots[1]:
                roots = [-1, -1]
            ends = tuple(where(face) for face in self.faces[loop])
            ear.closures.append(Closure(loop, (a, b), (roots[0], roots[1]), (ends[0], ends[1])))
        self.regions[-1].ears.append(len(self.ears))
        self.ears.append(ear)


def _order(links: Sequence[Link], regions: list[Region], ears: list[EarLinks], ear_of: list[int | None]) -> list[Unit]:
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
