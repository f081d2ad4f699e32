"""The order in which links and regions are eliminated, and the couplings that this causes. Section 4 of the theory page.

An ear (graph.py) that starts from two moving links couples their accelerations by a 6x6 block of the equations of motion, the
paper's two-argument inertia. When one of these links is eliminated, its parent takes over the block, until the path
inward reaches the other link. Going inward, the unit with the fewest couplings is eliminated first, so that few
couplings exist at any time.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import field
from itertools import combinations

from ...model.model import GROUND
from ...records import dataclass
from .graph import EarLinks, Region, Unit
from .links import Link

CARRIER = -1
"""Entry of `Contribution.ends` for the link that carries the eliminated unit: its parent, or the base of a region."""


@dataclass(frozen=True, slots=True)
class Contribution:
    """A 6x6 block that the elimination of a unit adds to the coupling of two links that are eliminated later.

    Attributes
    ----------
    coupling : int
        Number of the coupling.
    ends : tuple of two int
        Indices of the two links among the unit's partners, rows first; `CARRIER` for the link that carries the unit.
    first : bool
        The unit is the first to contribute to this coupling.
    """

    coupling: int
    ends: tuple[int, int]
    first: bool


@dataclass(slots=True, eq=False)
class Partners:
    """The links to which a unit is coupled when it is eliminated.

    Attributes
    ----------
    links : list of int
        Links outside the unit, eliminated later.
    base : int
        Index of the carrying link in `links`; -1 if it is not a partner.
    first : list of bool
        For each partner, whether the unit (a link or region) is the first on the way inward to contribute inertia to it.
    own : list of int
        Couplings that end with this unit: of a link, with each of its partners; of an ear, those in `between`.
    between : list of (int, int)
        For an ear, the links of rows and columns of each coupling: n for link n of the ear, and -1 - n for partner n.
    contributions : list of Contribution
    """

    links: list[int]
    base: int
    first: list[bool] = field(default_factory=list)
    own: list[int] = field(default_factory=list)
    between: list[tuple[int, int]] = field(default_factory=list)
    contributions: list[Contribution] = field(default_factory=list)

    def __eq__(self, other: object) -> bool:
        """Whether units with these partners have the same blocks."""
        return isinstance(other, Partners) and self.structure() == other.structure()

    def __hash__(self) -> int:
        return hash(self.structure())

    def structure(self) -> tuple[object, ...]:
        """A key, equal for units with the same blocks."""
        return (
            len(self.links), self.base, tuple(self.first), tuple(self.between),
            tuple((c.ends, c.first) for c in self.contributions),
        )  # fmt: skip


NOBODY = Partners([], -1)


@dataclass(slots=True)
class Elimination:
    """Units in outward order, and their couplings.

    Attributes
    ----------
    order : list of Unit
    partners : list of Partners
        For each unit.
    coupling_slot : list of int
        For each coupling, the memory slot of its block; slots are reused.
    slots : int
    first_contributor : dict of int to int
        For each link, or `GROUND`, that carries or is coupled to a unit: the unit that first contributes inertia to it on the way
        inward.
    """

    order: list[Unit]
    partners: list[Partners]
    coupling_slot: list[int]
    slots: int
    first_contributor: dict[int, int]


def find_elimination(
    links: Sequence[Link], regions: Sequence[Region], ears: Sequence[EarLinks], ear_of: Sequence[int | None]
) -> Elimination:
    """The order of a model's units, and the couplings."""
    order, eliminated = _Graph(links, regions, ears, ear_of).eliminate()
    contributor: dict[int, int] = {}
    for n, (unit, (partners, base)) in enumerate(zip(order, eliminated, strict=True)):
        if unit.role != "ear":
            contributor.update(dict.fromkeys((base, *partners), n))
    if not any(partners for partners, _ in eliminated):
        return Elimination(order, [NOBODY] * len(order), [], 0, contributor)
    return _couplings(order, eliminated, regions, ears, contributor)


class _Graph:
    """Units with their predecessors, and the couplings of links during the elimination."""

    def __init__(
        self,
        links: Sequence[Link],
        regions: Sequence[Region],
        ears: Sequence[EarLinks],
        ear_of: Sequence[int | None],
    ):
        self.links, self.regions, self.ears = links, regions, ears
        self.units = [Unit("link", i, (i,)) for i in range(len(links)) if ear_of[i] is None]
        self.units += [Unit("region", r, ()) for r in range(len(regions))]
        self.units += [Unit("ear", e, tuple(ear.links)) for e, ear in enumerate(ears)]
        self.unit_of_link: dict[int, int] = {}
        self.unit_of_region: dict[int, int] = {}
        for n, unit in enumerate(self.units):
            if unit.role == "region":
                self.unit_of_region[unit.number] = n
            self.unit_of_link.update(dict.fromkeys(unit.links, n))
        self.coupled: dict[int, set[int]] = {}
        self.inside = [{i for e in region.ears for i in ears[e].links} for region in regions]
        self.region_of_link = {i: r for r, inside in enumerate(self.inside) for i in inside}
        self.touched: list[set[int]] = [set() for _ in regions]

    def hangs_on(self, unit: Unit) -> set[int]:
        """The units that directly precede a unit on the outward path."""
        none: set[int] = set()
        if unit.role == "link":
            found, before = {self.links[unit.number].parent}, none
        elif unit.role == "region":
            region = self.regions[unit.number]
            found, before = {region.base, *region.far}, none
        else:
            ear = self.ears[unit.number]
            found, before = {*ear.roots}, {self.unit_of_region[ear.region]}
        return before | {self.unit_of_link[i] for i in found if i != GROUND}

    def priority(self, unit: Unit) -> tuple[int, int, int]:
        """Priority among units with equal numbers of partners: the last one in the order of links is eliminated
        first."""
        if unit.role == "region":
            first = min((i for e in self.regions[unit.number].ears for i in self.ears[e].links), default=0)
            return -first, 0, -unit.number
        return -min(unit.links, default=0), -1, -unit.number

    def partners(self, unit: Unit) -> set[int]:
        """Links outside a link, or outside the region of an ear, to which it is coupled."""
        if unit.role == "link":
            return self.coupled.get(unit.number, set())
        r = self.ears[unit.number].region if unit.role == "ear" else unit.number
        found = set(self.regions[r].far) - {GROUND}
        for i in self.touched[r]:
            found |= self.coupled.get(i, set())
        return found - self.inside[r]

    def couple(self, i: int, j: int) -> None:
        for a, b in ((i, j), (j, i)):
            self.coupled.setdefault(a, set()).add(b)
            if a in self.region_of_link:
                self.touched[self.region_of_link[a]].add(a)

    def eliminate(self) -> tuple[list[Unit], list[tuple[set[int], int]]]:
        """The units in outward order, each with its partners and the link that carries it."""
        units = self.units
        needs = [self.hangs_on(unit) for unit in units]
        waiting = [0] * len(units)
        for before in needs:
            for n in before:
                waiting[n] += 1
        heap: list[tuple[int, tuple[int, int, int], int]] = []
        done = [False] * len(units)

        def offer(n: int) -> None:
            if not waiting[n] and not done[n]:
                # a region directly follows its last ear on the way inward: no further couplings can reach its links
                degree = -1 if units[n].role == "region" else len(self.partners(units[n]))
                heapq.heappush(heap, (degree, self.priority(units[n]), n))

        for n in range(len(units)):
            offer(n)
        order: list[Unit] = []
        found: list[tuple[set[int], int]] = []
        while heap:
            degree, _, n = heapq.heappop(heap)
            if done[n] or (degree >= 0 and degree != len(self.partners(units[n]))):
                continue
            done[n] = True
            partners, base = self._take_out(units[n])
            order.append(units[n])
            found.append((partners, base))
            for m in needs[n]:
                waiting[m] -= 1
            for m in needs[n] | {self.unit_of_link[i] for i in partners}:
                offer(m)
        assert len(order) == len(units)
        return order[::-1], found[::-1]

    def _take_out(self, unit: Unit) -> tuple[set[int], int]:
        """Eliminates a unit, after which its partners and the link that carries it are coupled to each other."""
        if unit.role == "ear":
            return set(), GROUND
        partners = set(self.partners(unit))
        if unit.role == "link":
            gone, base = [unit.number], self.links[unit.number].parent
        else:
            gone, base = sorted(self.inside[unit.number]), self.regions[unit.number].base
        if partners:
            for i in gone:
                for j in self.coupled.pop(i, set()):
                    self.coupled.get(j, set()).discard(i)
            for i, j in combinations(_remaining(partners, base), 2):
                self.couple(i, j)
        return partners, base


def _remaining(partners: Iterable[int], base: int) -> list[int]:
    return sorted({*partners, base} - {GROUND})


def _couplings(
    order: list[Unit],
    eliminated: list[tuple[set[int], int]],
    regions: Sequence[Region],
    ears: Sequence[EarLinks],
    contributor: dict[int, int],
) -> Elimination:
    """Coupling blocks, with their row links, the units that contribute to them, and their memory slots."""
    place: dict[int, tuple[int, int]] = {}
    of_region: dict[int, Partners] = {}
    for n, unit in enumerate(order):
        place.update({i: (n, k) for k, i in enumerate(unit.links)})
    ends: list[tuple[int, int]] = []
    number: dict[frozenset[int], int] = {}
    at_link: dict[int, list[int]] = {}
    result: list[Partners] = [NOBODY] * len(order)
    for n, unit in enumerate(order):
        if unit.role == "region":
            partners, base = eliminated[n]
            of_region[unit.number] = _partners(partners, base, place, n, contributor)
    slot_of: list[int] = []
    free: list[int] = []
    slots = 0
    for n in reversed(range(len(order))):
        unit = order[n]
        if unit.role == "ear":
            region = of_region[ears[unit.number].region]
            if not region.links and not any(at_link.get(i) for i in unit.links):
                continue
            assert len(regions[ears[unit.number].region].ears) == 1, "a region with couplings has one ear"
            mine = result[n] = _of_ear(unit, region, ends, at_link)
        else:
            partners, base = eliminated[n]
            if not partners:
                continue
            mine = result[n] = (
                of_region[unit.number] if unit.role == "region" else _partners(partners, base, place, n, contributor)
            )
            if unit.role == "link":
                at_link.pop(unit.number, None)
                mine.own = [number[frozenset((unit.number, i))] for i in mine.links]
            where = {i: CARRIER if i == base else k for k, i in enumerate([*mine.links, base])}
            for pair in combinations(_remaining(partners, base), 2):
                key = frozenset(pair)
                rows, columns = sorted(pair, key=place.__getitem__, reverse=True)
                first = key not in number
                if first:
                    number[key] = len(ends)
                    ends.append((rows, columns))
                    for i in pair:
                        at_link.setdefault(i, []).append(number[key])
                    slot_of.append(free.pop() if free else slots)
                    slots = max(slots, slot_of[-1] + 1)
                mine.contributions.append(Contribution(number[key], (where[rows], where[columns]), first))
        free += [slot_of[c] for c in mine.own]
        for c in mine.own:
            for i in ends[c]:
                if c in at_link.get(i, ()):
                    at_link[i].remove(c)
    return Elimination(order, result, slot_of, slots, contributor)


def _of_ear(unit: Unit, region: Partners, ends: list[tuple[int, int]], at_link: dict[int, list[int]]) -> Partners:
    """The partners of an ear, which are the partners of its region; removes couplings that end with its links from
    `at_link`."""
    mine = Partners(region.links, region.base)
    inside = {i: k for k, i in enumerate(unit.links)}
    for c in sorted({c for i in unit.links for c in at_link.pop(i, ())}):
        rows, columns = ends[c]
        other = inside[columns] if columns in inside else -1 - region.links.index(columns)
        mine.own.append(c)
        mine.between.append((inside[rows], other))
    return mine


def _partners(
    partners: set[int], base: int, place: dict[int, tuple[int, int]], n: int, contributor: dict[int, int]
) -> Partners:
    links = sorted(partners, key=place.__getitem__, reverse=True)
    return Partners(links, links.index(base) if base in partners else -1, [contributor[i] == n for i in links])
