"""Ears and regions: the links whose motion is computed together, and the order of all units. Section 4 of the theory page.

An **ear** (of the ear decomposition of the loop graph, Whitney 1932) is a set of links on cycles whose motion is computed
together: the new links of a loop or of a cluster of loops, or a single link whose joint is independent. A **region** is a set of
ears whose links all move with the same few **sources** (``A_k = Z_k w``): independent speeds, and possibly the motion of links
outside the region. A ladder of any length is one region with one source. If a loop closes a long chain, its ear is a region of
its own. One of the links from which it starts is the base; the others are far links, which move relative to the base.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...loops.disjoint_sets import DisjointSets
from ...loops.partition import Partition
from ...loops.tangles import ear_members, joined, tangles
from ...model.model import GROUND, Coupling, Model
from ...records import dataclass
from .elimination_order import Elimination, find_elimination
from .graph import Closure, EarLinks, Region, Unit
from .links import Link
from .region_work import Bundle, Freedoms, is_one_region


@dataclass(slots=True)
class Regions:
    """The loops of a model, as ears and regions.

    Attributes
    ----------
    ear_of : list of int or None
        The ear of each link.
    elimination : Elimination
        The order of all units, and the couplings.
    """

    regions: list[Region]
    ears: list[EarLinks]
    ear_of: list[int | None]
    elimination: Elimination

    @property
    def order(self) -> list[Unit]:
        """The units in outward order."""
        return self.elimination.order


def link_of_speeds(links: Sequence[Link]) -> dict[int, tuple[int, int]]:
    """Link and degree of freedom of every speed."""
    return {link.speed + j: (i, j) for i, link in enumerate(links) for j in range(link.joint.freedoms)}


def find_regions(
    model: Model, links: Sequence[Link], carriers: Sequence[tuple[int, object]], partition: Partition | None
) -> Regions:
    """The ears and regions of a model, and the order of its units."""
    if partition is None or not partition.ears:
        ear_of: list[int | None] = [None] * len(links)
        return Regions([], [], ear_of, find_elimination(links, [], [], ear_of))
    place = link_of_speeds(links)
    faces = [
        tuple(GROUND if f.body == GROUND else carriers[f.body][0] for f in (loop.start, loop.end))
        for loop in model.loops
    ]
    coupled = coupled_freedoms(model, links)
    dependent = {place[u] for ear in partition.ears for u in ear.dependent}
    freedoms = Freedoms(links, dependent, [() if i in coupled else faces[i] for i in range(len(faces))])
    regions: list[Region] = []
    ears: list[EarLinks] = []
    gaps = {i for ear in partition.ears if ear.gaps for i in ear.loops}
    dropped = partition.dropped_rows(model)
    ear_of = [None] * len(links)
    for group, base in _components(links, faces, coupled, partition):
        bundles = _bundles(links, faces, coupled, group, dependent)
        on_cycles = sorted({i for b in bundles for i in b.links})
        free = freedoms.independent(on_cycles)
        made = _Maker(freedoms, regions, ears, ear_of, faces, coupled, gaps, dropped)
        if not is_one_region(freedoms, bundles, free):
            made.by_single_ears(bundles)
            continue
        regions.append(Region(base, True, freedoms=free))
        number = {f: c for c, f in enumerate(free)}
        moved = {i for b in bundles for i in b.members}
        for b in bundles:
            # links inboard of all dependent joints become separate ears without loops, so that equal loops are of one
            # kind
            for i in b.links:
                if i not in moved:
                    made.add([i], (), number, 1.0)
            made.add(b.members, b.loops, number, b.length)
    return Regions(regions, ears, ear_of, find_elimination(links, regions, ears, ear_of))


Coupled = dict[int, list[tuple[int, int]]]
"""For each coupling, the link and degree of freedom of each coordinate."""


def coupled_freedoms(model: Model, links: Sequence[Link]) -> Coupled:
    """For each coupling: link and degree of freedom of its coordinates, including prescribed ones."""
    speeds = model.released.coordinate_slices
    place = {link.speed + j: (i, j) for i, link in enumerate(links) for j in range(link.joint.speeds())}
    return {
        n: [place[speeds[t.body][1].start + t.index] for t in loop.terms]
        for n, loop in enumerate(model.loops)
        if isinstance(loop, Coupling)
    }


def _ways(links: Sequence[Link], freedoms: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Paths between the joints of a coupling: from each of its links to the nearest link that is inboard of all of
    them."""
    ends = list(dict.fromkeys(i for i, _ in freedoms))
    front = set(ends)
    while len(front) > 1:
        i = max(front)  # links are numbered outward
        front.remove(i)
        front.add(links[i].parent)
    (base,) = front
    return [(i, links[base].parent if base in ends else base) for i in ends]


def _components(
    links: Sequence[Link], faces: Sequence[tuple[int, ...]], coupled: Coupled, partition: Partition
) -> list[tuple[list[Bundle], int]]:
    """Groups of ears that share links on their cycles, directly or through other ears; and the link that carries each
    group.

    A search goes inward from both faces of a loop. At a link of an earlier ear, it continues from the base of that ear's
    group. Couplings come last, because paths between the joints of a coupling may pass through unrelated loops.
    """
    parts = [(ear, tuple(i for i in ear.loops if i not in coupled)) for ear in partition.ears]
    parts = [(ear, loops) for ear, loops in parts if loops or not ear.loops]
    parts += [(ear, loops) for ear in partition.ears if (loops := tuple(i for i in ear.loops if i in coupled))]
    groups = DisjointSets(len(parts))
    base: list[int] = [GROUND] * len(parts)
    owner: dict[int, int] = {}
    bundles: list[Bundle] = []
    for e, (ear, loops) in enumerate(parts):
        new: list[int] = []
        lowest: list[int] = []
        reached: list[int] = []
        for a, b in (way for i in loops for way in (_ways(links, coupled[i]) if i in coupled else [faces[i]])):
            # links are numbered outward, so the larger number is never an ancestor of the smaller one
            while a != b:
                a, b = max(a, b), min(a, b)
                if a not in owner:
                    owner[a] = e
                    new.append(a)
                    a = links[a].parent
                    continue
                known = groups.find(owner[a])
                if known == e:  # an earlier walk of this ear has passed here: continue from the end of that walk
                    a = reached[0] if owner[a] != e and len(reached) == 1 else links[a].parent
                    continue
                groups.join(known, e)
                reached.append(base[known])
                lowest.append(base[known])
                if b in owner and groups.find(owner[b]) == e:
                    break
                a = base[known]
            else:
                lowest.append(a)
        base[e] = min(lowest)
        bundles.append(Bundle(loops, sorted(new), ear.length))
    return [([bundles[e] for e in members], base[root]) for root, members in groups.members().items()]


def _bundles(
    links: Sequence[Link],
    faces: Sequence[tuple[int, ...]],
    coupled: Coupled,
    bundles: list[Bundle],
    dependent: set[tuple[int, int]],
) -> list[Bundle]:
    """The ears of a group, each with the links that it moves. Ears that start from each other's links,
    directly or through other ears, are joined.

    A coupling is joined with the ears that contain its links, and with loops that must be closed together with it.
    """
    bundles = _with_coupled_links(coupled, bundles)
    held = {i for b in bundles for loop in b.loops for i, _ in coupled.get(loop, ())}
    while True:
        owner = {i: n for n, b in enumerate(bundles) for i in b.links}
        ends = [[f for loop in b.loops if loop not in coupled for f in faces[loop]] for b in bundles]

        def is_moved(i: int) -> bool:
            return i in held or any((i, j) in dependent for j in range(links[i].joint.freedoms))

        members = ear_members({i: links[i].parent for i in owner}, owner, sorted(owner), ends, is_moved)
        for b, moved, before in zip(bundles, members.moved, members.before, strict=True):
            b.members, b.before = sorted(moved), sorted(before)
        tangled = tangles(members.before)
        if not tangled:
            return bundles
        bundles = joined(bundles, tangled, _as_one)


def _with_coupled_links(coupled: Coupled, bundles: list[Bundle]) -> list[Bundle]:
    """The bundles after each coupling has been joined with the bundles that contain its links."""
    owner = {i: n for n, b in enumerate(bundles) for i in b.links}
    sets = DisjointSets(len(bundles))
    for n, b in enumerate(bundles):
        for i in (i for loop in b.loops for i, _ in coupled.get(loop, ())):
            sets.join(owner[i], n)
    return joined(bundles, [members for members in sets.members().values() if len(members) > 1], _as_one)


def _as_one(bundles: list[Bundle]) -> Bundle:
    return Bundle(
        tuple(loop for b in bundles for loop in b.loops), sorted(i for b in bundles for i in b.links),
        max(b.length for b in bundles),
    )  # fmt: skip


@dataclass(slots=True)
class _Maker:
    """Builder of ears and regions, one group after the other."""

    freedoms: Freedoms
    regions: list[Region]
    ears: list[EarLinks]
    ear_of: list[int | None]
    faces: Sequence[tuple[int, ...]]
    coupled: Coupled
    gaps: set[int]
    dropped: Sequence[set[int]]

    def by_single_ears(self, bundles: list[Bundle]) -> None:
        """Makes each ear of a group a region of its own."""
        for b in bundles:
            region = self.freedoms.alone(b)
            self.regions.append(region)
            self.add(b.members, b.loops, {f: c for c, f in enumerate(region.freedoms)}, b.length)

    def add(self, members: list[int], loops: Sequence[int], number: dict[tuple[int, int], int], length: float) -> None:
        """Adds an ear to the latest region."""
        links = self.freedoms.links
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
            freedoms = range(links[i].joint.speeds())
            ear.dependent.append([j for j in freedoms if (i, j) in self.freedoms.dependent])
            ear.columns.append({j: number[i, j] for j in freedoms if (i, j) not in self.freedoms.dependent})
            self.ear_of[i] = len(self.ears)
        for loop in loops:
            if loop in self.coupled:
                terms = tuple((place[i], j) for i, j in self.coupled[loop])
                rows = tuple(sorted(self.dropped[loop]))
                ear.closures.append(Closure(loop, ((), ()), (-1, -1), (-1, -1), False, rows, terms))
                continue
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
            ear.closures.append(
                Closure(
                    loop, (a, b), (roots[0], roots[1]), (ends[0], ends[1]), loop in self.gaps,
                    tuple(sorted(self.dropped[loop])),
                )
            )  # fmt: skip
        self.regions[-1].ears.append(len(self.ears))
        self.ears.append(ear)
