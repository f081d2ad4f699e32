"""What loops cost as one region and as regions of their own: estimates in multiplications, to choose by.

Measured against what is generated, in additions and multiplications of udot (section 4.3 of the theory page): 38 000 and 9 000
are estimated for the Delta robot, 44 000 and 17 000 are found; 7 300 and 6 600 for the Stewart platform, 9 800 and 9 600; 3 600
and 8 200 for a chain of 16 links with its end held, 7 600 and 19 000. Derivatives cost a little more in one region where udot
costs as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from graphlib import TopologicalSorter

from ...model.model import GROUND
from ...records import dataclass
from .graph import Region
from .links import Link

FEW_SOURCES = 5
"""Loops whose links share at most so many independent speeds are one region: the six components of a link's acceleration are
never the shorter description."""

GAIN = 0.4
"""With more speeds they are one region if that takes less than such a part of the work: the estimate of couplings is high where
mechanisms are planar, and derivatives gain nothing."""

LINK_OF_TREE = 150
"""Multiplications of a link whose inertia is handed on as a six by six matrix."""

TO_GROUND = 40
"""The same for each unknown of a region, to turn its column from the motion of a far link against the base to its own."""

Freedom = tuple[int, int]
"""A link and a freedom of its joint."""


@dataclass(slots=True)
class Bundle:
    """Loops that are closed together.

    Attributes
    ----------
    links : list of int
        On their cycles, that no earlier bundle has.
    members : list of int
        Links on cycles that their dependents move: of these, or of an earlier bundle's.
    before : list of int
        The bundles that move what this one starts from.
    """

    loops: tuple[int, ...]
    links: list[int]
    length: float
    members: list[int] = field(default_factory=list)
    before: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Freedoms:
    """Links, which of their speeds are dependent, and where loops end.

    Attributes
    ----------
    ends : list of tuple of int
        The links of every loop's faces; nothing of a coupling.
    """

    links: Sequence[Link]
    dependent: set[Freedom]
    ends: Sequence[tuple[int, ...]]

    def independent(self, links: Sequence[int]) -> list[Freedom]:
        """The independent speeds of links."""
        return [(i, j) for i in links for j in range(self.links[i].joint.speeds()) if (i, j) not in self.dependent]

    def outside(self, bundle: Bundle) -> set[int]:
        """The links that a bundle starts from, perhaps with `GROUND`."""
        ends = {i for loop in bundle.loops for i in self.ends[loop]}
        return ends.union(self.links[i].parent for i in bundle.members) - set(bundle.members)

    def alone(self, bundle: Bundle) -> Region:
        """The region that has the ear of a bundle only, with the motion of the links that it starts from as sources."""
        outside = self.outside(bundle)
        moving = list(outside - {GROUND})
        # what hangs on the base has the shortest description
        hanging = [self.links[i].parent for i in bundle.members]
        moving.sort(key=lambda i: (-hanging.count(i), i))
        base = moving[0] if moving else GROUND
        far = moving[1:] + ([GROUND] if moving[1:] and GROUND in outside else [])
        # a loop that hangs on one link alone closes whatever that link does
        rigid = not moving or bool(far) or GROUND not in outside
        return Region(base, rigid, freedoms=self.independent(bundle.members), far=far)


def is_one_region(freedoms: Freedoms, bundles: Sequence[Bundle], free: Sequence[Freedom]) -> bool:
    """Whether loops that share links become one region, with all the independent speeds on their cycles as sources."""
    if len(free) <= FEW_SOURCES:
        return True
    most = GAIN * work_apart(freedoms, bundles)
    return elimination(len(free), len(free)) < most and work_together(freedoms, bundles, free) < most


def work_apart(freedoms: Freedoms, bundles: Sequence[Bundle]) -> float:
    """Multiplications with a region for every bundle."""
    work = 0.0
    for bundle in bundles:
        region = freedoms.alone(bundle)
        sources = len(region.freedoms) + 6 * len(region.far) + (0 if region.rigid else 6)
        partners = len([i for i in region.far if i != GROUND]) + region.carried
        unknowns = sources + 6 * (partners - (not region.rigid))
        work += work_of_ear(freedoms, bundle, dict.fromkeys(bundle.members, sources))
        work += elimination(len(region.freedoms), unknowns)
        work += len(region.far) * TO_GROUND * unknowns + LINK_OF_TREE * partners
    return work + LINK_OF_TREE * len(loopless(bundles))


def work_together(freedoms: Freedoms, bundles: Sequence[Bundle], free: Sequence[Freedom]) -> float:
    """Multiplications with one region for all bundles."""
    sources = sources_of_links(freedoms, bundles)
    work = elimination(len(free), len(free)) + sum(map(work_of_link, (sources[i] for i in loopless(bundles))))
    return work + sum(work_of_ear(freedoms, b, {i: sources[i] for i in b.members}) for b in bundles)


def loopless(bundles: Sequence[Bundle]) -> set[int]:
    """Links on cycles that no dependent moves."""
    return {i for b in bundles for i in b.links}.difference(*(b.members for b in bundles))


def work_of_ear(freedoms: Freedoms, bundle: Bundle, sources: dict[int, int]) -> float:
    """Multiplications of a closure and of its links: of each of them by how many sources it is moved."""
    dependents = sum(
        (i, j) in freedoms.dependent for i in bundle.members for j in range(freedoms.links[i].joint.speeds())
    )
    closure = dependents**3 / 3 + dependents**2 * max(sources.values(), default=0)
    return closure + sum(map(work_of_link, sources.values()))


def work_of_link(sources: int) -> float:
    """Multiplications of a link's motion, and of its inertia, along so many sources."""
    return 3.0 * sources**2 + 36.0 * sources


def elimination(eliminated: int, unknowns: int) -> float:
    """Multiplications for the elimination of so many unknowns of a symmetric system."""
    left = unknowns - eliminated
    return (unknowns**3 - left**3) / 6


def sources_of_links(freedoms: Freedoms, bundles: Sequence[Bundle]) -> dict[int, int]:
    """By how many of the independent speeds on the cycles each link on them is moved."""
    owner = {i: n for n, b in enumerate(bundles) for i in b.members}
    on_ways: dict[int, frozenset[Freedom]] = {}
    """Of links that no dependent of their bundle moves: the speeds on the way inward to one that is moved, or off the cycles."""
    mover: dict[int, int | None] = {}
    for i in sorted({i for b in bundles for i in (*b.links, *b.members)}):  # links are numbered outward
        parent = freedoms.links[i].parent
        if i in owner:
            on_ways[i], mover[i] = frozenset(), owner[i]
        else:
            on_ways[i] = on_ways.get(parent, frozenset()).union(freedoms.independent([i]))
            mover[i] = mover.get(parent)
    of_bundles: dict[int | None, frozenset[Freedom]] = {None: frozenset()}
    for n in TopologicalSorter({n: b.before for n, b in enumerate(bundles)}).static_order():
        bundle = bundles[n]
        own = frozenset(freedoms.independent(bundle.members))
        ways = (on_ways[i] for i in freedoms.outside(bundle) if i in on_ways)
        of_bundles[n] = own.union(*ways, *(of_bundles[m] for m in bundle.before))
    return {i: len(speeds | of_bundles[mover[i]]) for i, speeds in on_ways.items()}
