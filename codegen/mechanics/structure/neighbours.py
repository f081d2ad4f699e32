"""For each link, in the order of units: its first contributor, the ears that start from it, the last use of its values."""

from __future__ import annotations

from ...model.model import GROUND
from .elimination_order import NOBODY, Partners
from .graph import Region
from .links import Link
from .regions import Regions


class Neighbours:
    """For the links of a system: which units contribute to them, start from them, and use their values.

    Attributes
    ----------
    unit_of_link : dict of int to int
        Index of each link's unit in the order.
    last_use : dict of int to int
        For each link, the last unit, on the way outward, that uses its values.
    first_follower : dict of int to int
        For links of regions from which later ears start: the first of these ears on the way inward.
    """

    def __init__(self, links: list[Link], regions: Regions, loop_types: list[str]):
        self.links = links
        self.regions = regions
        self.loop_types = loop_types
        self.unit_of_link: dict[int, int] = {}
        for n, unit in enumerate(regions.order):
            if unit.role != "region":
                self.unit_of_link.update(dict.fromkeys(unit.links, n))
        self.last_use: dict[int, int] = dict(self.unit_of_link)
        self.first_follower: dict[int, int] = {}
        self.partners = regions.elimination.partners
        self.first_contributor = regions.elimination.first_contributor
        for n, unit in enumerate(regions.order):
            coupled = [] if unit.role == "ear" else self.partners[n].links
            if unit.role == "ear":
                ear = regions.ears[unit.number]
                base = regions.regions[ear.region].base
                used = [*ear.roots, base]
                # an ear without links contributes nothing: its loop adds no condition
                for root in ear.roots if ear.links else ():
                    if root != base and root not in regions.regions[ear.region].far:
                        self.first_follower[root] = n
            else:
                region = regions.regions[unit.number] if unit.role == "region" else None
                base = region.base if region else links[unit.number].parent
                used = [base, *coupled]
            for i in used:
                if i != GROUND:
                    self.last_use[i] = n
        self._closed_on = self._followed()
        self.region_structures = [self._of_region(region) for region in regions.regions]
        """For each region: whether the displacement between faces is needed, which far links are the ground, and the prescribed
        sources."""
        self.ear_structures = [self._structure(e) for e in range(len(regions.ears))]
        """A key for each ear, equal for ears of the same structure."""

    def _followed(self) -> dict[int, str]:
        """The role of each link outside a region on whose motion the region's loops depend.

        The ``origin`` carries all links from which a region starts. These links, and those between them and the origin,
        are ``moving``, even if they are also the origin of another region. Their motion is computed relative to the
        origin: relative to the ground it would lose digits, for example on a satellite far from the ground's origin.
        """
        regions = self.regions
        top: dict[int, int] = {}
        origins = set[int]()

        def place(i: int) -> int:
            return -1 if i == GROUND else self.unit_of_link[i]

        for region in regions.regions:
            if region.rigid and not region.far:
                continue
            front = {region.base, *region.far} | (set() if region.rigid else {GROUND})
            passed = []
            while len(front) > 1:
                i = max(front, key=place)
                front.remove(i)
                passed.append(i)
                e = regions.ear_of[i]
                parent = self.links[i].parent if e is None else regions.regions[regions.ears[e].region].base
                # an earlier walk has passed here: continue from the end of that walk, since this one goes at least as far
                front.add(top.get(i, parent))
            top.update(dict.fromkeys(passed, *front))
            origins |= front - {GROUND}
        return dict.fromkeys(origins, "origin") | dict.fromkeys(top, "moving")

    def partners_of_link(self, i: int) -> Partners:
        """Partners of a link that is a unit; empty for a link of an ear."""
        return NOBODY if self.regions.ear_of[i] is not None else self.partners[self.unit_of_link[i]]

    def carries(self, link: int) -> bool:
        """Whether units outside a link's own ear depend on the link or are coupled to it."""
        return link in self.first_contributor

    def place_in_ear(self, link: int) -> tuple[object, ...] | None:
        """The part of a link's signature that comes from its ear: index and structure of the ear."""
        e = self.regions.ear_of[link]
        if e is None:
            return None
        ear = self.regions.ears[e]
        return (ear.links.index(link), *self.ear_structures[e])

    def _structure(self, e: int) -> tuple[object, ...]:
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        n = self.unit_of_link[ear.links[0]] if ear.links else -1
        return (
            tuple(ear.parents), self.roles(e), tuple(self.first_follower.get(r) == n for r in ear.roots),
            tuple(i in self.first_follower for i in ear.links),
            tuple((c.paths, c.roots, c.faces, c.gaps, c.dropped, c.terms) for c in ear.closures),
            tuple(map(tuple, ear.dependent)), tuple(tuple(sorted(c.items())) for c in ear.columns), ear.length,
            len(region.freedoms), region.carried, region.rigid, tuple(self.role_of(i) for i in ear.links), self.far(e),
            *self.region_structures[ear.region], self.partners[n] if n >= 0 else (),
        )  # fmt: skip

    def _of_region(self, region: Region) -> tuple[bool, tuple[bool, ...], tuple[int, ...]]:
        slides = any(c.slides(self.loop_types[c.loop]) for e in region.ears for c in self.regions.ears[e].closures)
        return slides, tuple(i == GROUND for i in region.far), self.locked(region)

    def locked(self, region: Region) -> tuple[int, ...]:
        """Indices of the prescribed sources of a region."""
        return tuple(c for c, (i, _) in enumerate(region.freedoms) if self.links[i].joint.driven)

    def roles(self, e: int) -> tuple[str, ...]:
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        return tuple(
            "frame" if r == region.base else "far" if r in region.far else "ground" if r == GROUND else "link"
            for r in ear.roots
        )

    def far(self, e: int) -> tuple[int, ...]:
        """For each root of an ear, its index among the far links of the region; -1 if it is not a far link."""
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        return tuple(region.far.index(r) if r in region.far else -1 for r in ear.roots)

    def role_of(self, link: int) -> tuple[bool, str]:
        """Whether a link carries units, and whether a loop closes on the motion of the link."""
        return self.carries(link), self._closed_on.get(link, "")

    def slots(self) -> tuple[list[int], int]:
        """Memory slot of each link, which is used again after the link's last use, and the number of slots; slot 0 is
        the ground."""
        free: list[int] = []
        count = 1
        slot_of = [0] * len(self.links)
        ending: dict[int, list[int]] = {}
        for i, n in self.last_use.items():
            ending.setdefault(n, []).append(i)
        for n, unit in enumerate(self.regions.order):
            if unit.role != "region":
                for i in unit.links:
                    if free:
                        slot_of[i] = free.pop()
                    else:
                        slot_of[i], count = count, count + 1
            # the slot freed last is reused first: along a chain, links alternate between two slots
            for i in sorted(ending.get(n, ()), reverse=True):
                free.append(slot_of[i])
        return slot_of, count
