"""Estimated multiplications for loops in separate regions and in one region; the estimates decide between the two.

Estimates, and in brackets the operations that are generated for udot (section 4.3 of the theory page), first for separate
regions and then for one region: Delta robot, 38000 and 9000 (44000 and 17000); Stewart platform, 7300 and 6600 (9800
and 9600); chain of 16 links with its end held, 3600 and 8200 (7600 and 19000). Where udot costs the same, derivatives
cost a little more in one region.
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
"""Loops with at most this many independent speeds form one region. A separate region has at least as many unknowns, the
six components of a link's acceleration."""

GAIN = 0.4
"""Loops whose joints have more independent speeds form one region only if its estimate is below this fraction of the
estimate for separate regions. The margin is wide because the estimate of couplings is too high for planar mechanisms,
and because derivatives gain nothing."""

LINK_OF_TREE = 150
"""Multiplications for a link whose inertia is propagated as a 6x6 matrix."""

TO_GROUND = 40
"""Multiplications per unknown of a region that convert the relative motion of a far link to its own motion."""

Freedom = tuple[int, int]
"""A link and one of its joint's degrees of freedom."""


@dataclass(slots=True)
class Bundle:
    """Loops that are closed together, as an ear.

    Attributes
    ----------
    links : list of int
        Links on the loops' cycles that no earlier bundle contains.
    members : list of int
        Links, of this or of an earlier bundle, that the loops' dependent joints move.
    before : list of int
        The bundles that move the links from which this one starts.
    """

    loops: tuple[int, ...]
    links: list[int]
    length: float
    members: list[int] = field(default_factory=list)
    before: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Freedoms:
    """The links of a model, their dependent speeds, and the links of the loops' faces.

    Attributes
    ----------
    ends : list of tuple of int
        The links of each loop's faces; empty for a coupling.
    """

    links: Sequence[Link]
    dependent: set[Freedom]
    ends: Sequence[tuple[int, ...]]

    def independent(self, links: Sequence[int]) -> list[Freedom]:
        """The independent speeds of some links."""
        return [(i, j) for i in links for j in range(self.links[i].joint.speeds()) if (i, j) not in self.dependent]

    def outside(self, bundle: Bundle) -> set[int]:
        """The links from which a bundle starts, which may include `GROUND`."""
        ends = {i for loop in bundle.loops for i in self.ends[loop]}
        return ends.union(self.links[i].parent for i in bundle.members) - set(bundle.members)

    def alone(self, bundle: Bundle) -> Region:
        """The region with this bundle as its only ear; its sources include the motions of the links from which it
        starts."""
        outside = self.outside(bundle)
        moving = list(outside - {GROUND})
        # the motion of links carried by the base needs no far link, so the base is the link that carries most of them
        hanging = [self.links[i].parent for i in bundle.members]
        moving.sort(key=lambda i: (-hanging.count(i), i))
        base = moving[0] if moving else GROUND
        far = moving[1:] + ([GROUND] if moving[1:] and GROUND in outside else [])
        # loops that a single link carries close for any motion of that link
        rigid = not moving or bool(far) or GROUND not in outside
        return Region(base, rigid, freedoms=self.independent(bundle.members), far=far)


def is_one_region(freedoms: Freedoms, bundles: Sequence[Bundle], free: Sequence[Freedom]) -> bool:
    """Whether loops that share links become one region, whose sources are all independent speeds on their cycles."""
    if len(free) <= FEW_SOURCES:
        return True
    most = GAIN * work_apart(freedoms, bundles)
    return elimination(len(free), len(free)) < most and work_together(freedoms, bundles, free) < most


def work_apart(freedoms: Freedoms, bundles: Sequence[Bundle]) -> float:
    """Estimated number of multiplications if every bundle is a region."""
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
    """Estimated number of multiplications if all bundles are one region."""
    sources = sources_of_links(freedoms, bundles)
    work = elimination(len(free), len(free)) + sum(map(work_of_link, (sources[i] for i in loopless(bundles))))
    return work + sum(work_of_ear(freedoms, b, {i: sources[i] for i in b.members}) for b in bundles)


def loopless(bundles: Sequence[Bundle]) -> set[int]:
    """Links on cycles that no dependent joint moves."""
    return {i for b in bundles for i in b.links}.difference(*(b.members for b in bundles))


def work_of_ear(freedoms: Freedoms, bundle: Bundle, sources: dict[int, int]) -> float:
    """Multiplications for a closure and its links; `sources` has the number of sources that move each link."""
    dependents = sum(
        (i, j) in freedoms.dependent for i in bundle.members for j in range(freedoms.links[i].joint.speeds())
    )
    closure = dependents**3 / 3 + dependents**2 * max(sources.values(), default=0)
    return closure + sum(map(work_of_link, sources.values()))


def work_of_link(sources: int) -> float:
    """Multiplications for the motion and the inertia of a link that `sources` sources move."""
    return 3.0 * sources**2 + 36.0 * sources


def elimination(eliminated: int, unknowns: int) -> float:
    """Multiplications to eliminate some unknowns of a symmetric system."""
    left = unknowns - eliminated
    return (unknowns**3 - left**3) / 6


def sources_of_links(freedoms: Freedoms, bundles: Sequence[Bundle]) -> dict[int, int]:
    """For each link on the cycles, the number of independent speeds on the cycles that move it."""
    owner = {i: n for n, b in enumerate(bundles) for i in b.members}
    on_ways: dict[int, frozenset[Freedom]] = {}
    """For each link that no dependent joint moves: the independent speeds on the path inward to a link that a dependent
    joint moves."""
    mover: dict[int, int | None] = {}
    for i in sorted({i for b in bundles for i in (*b.links, *b.members)}):
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
