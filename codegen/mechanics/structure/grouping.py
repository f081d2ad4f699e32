"""Kinds of links, ears and regions: units of the same structure, found before any expansion.

The kind of a link follows from its signature: joint, zero pattern of its constants, their dependence on parameters, children,
forces on its joint. The kinds of ears (graph.py) and regions follow from their topology.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...model.model import GROUND, PointCondition
from ...program import algebra
from ...program.digits import long_number, number
from ...program.shape import Constants
from .faces import LoopFaces
from .graph import Region
from .kinds import ClosureKind, EarKind, LinkKind, RegionKind, UnitKind
from .links import Link
from .neighbours import Neighbours
from .regions import Regions
from .shared_constants import pattern


def find_link_kinds(
    links: Sequence[Link],
    constants_of: Sequence[Constants],
    order: Neighbours,
    forced_speeds: set[int],
    held: set[int],
    pulled: set[int],
    unrolled: bool,
) -> tuple[list[LinkKind], list[LinkKind]]:
    """The kinds of links, and the kind of each link.

    Parameters
    ----------
    forced_speeds : set of int
        Speeds with a joint force in the model.
    held : set of int
        Prescribed coordinates with a joint force in the model.
    pulled : set of int
        Links on which force elements act.
    unrolled : bool
        Every link gets a kind of its own.
    """
    has_child = {link.parent for link in links}
    last_child: dict[int, int] = {}
    for i, link in enumerate(links):
        last_child[link.parent] = i
    regions = order.regions
    given = {region.base for region in regions.regions}
    given |= {link for partners in regions.elimination.partners for link in partners.links}
    kinds: dict[object, LinkKind] = {}
    kind_of: list[LinkKind] = []
    for i, link in enumerate(links):
        c = constants_of[i]
        forced = tuple(link.u + j in forced_speeds for j in range(link.joint.freedoms))
        aligned = all(
            n not in c.shape.varying and c.values.get(n, 0.0) == float(n[2] == n[3])
            for n in (f"R.{a}{b}" for a in "xyz" for b in "xyz")
        )
        first = last_child[link.parent] == i
        first_unit = order.first_contributor.get(link.parent) == order.unit_of_link[i]
        own = (
            link.joint, link.axis, aligned, first, first_unit, link.parent != GROUND, *order.role_of(i), i in pulled, forced,
            order.partners_of_link(i), link.moves, link.driven in held,
        )  # fmt: skip
        signature = i if unrolled else (own, i in has_child, c.shape.index, pattern(c), order.place_in_ear(i))
        kind = kinds.get(signature)
        if kind is None:
            kind = kinds[signature] = LinkKind(c.shape, len(kinds), *own)
        kind.members.append(i)
        kind.of_links &= i not in given
        kind_of.append(kind)
    for kind in kinds.values():
        kind.fold([constants_of[i] for i in kind.members])
    return list(kinds.values()), kind_of


def total_sources(region: Region) -> int:
    """Number of sources: independent speeds, and six for each link whose motion is a source."""
    moving = 1 if region.carried and not region.rigid else len(region.far)
    return len(region.freedoms) + 6 * moving


def find_unit_kinds(
    regions: Regions,
    order: Neighbours,
    kinds: list[LinkKind],
    kind_of: list[LinkKind],
    faces: list[LoopFaces],
    closure_constants: list[Constants],
    unrolled: bool,
) -> tuple[list[UnitKind], list[UnitKind]]:
    """The kinds of units (links outside ears, ears, regions), and the kind of each unit."""
    found: dict[object, UnitKind] = {}
    unit_kind_of: list[UnitKind] = []
    constants: dict[int, list[list[Constants]]] = {}
    for n, unit in enumerate(regions.order):
        kind: UnitKind
        if unit.role == "link":
            kind = kind_of[unit.number]
            found.setdefault(("link", kind.index), kind)
        elif unit.role == "region":
            region = regions.regions[unit.number]
            first = order.first_contributor.get(region.base) == n
            r, partners = len(region.freedoms), order.partners[n]
            far = tuple(-1 if i == GROUND else partners.links.index(i) for i in region.far)
            own = (r, total_sources(region), region.carried, region.rigid, first, far, partners, order.locked(region))
            key = ("region", own, unit.number if unrolled else 0)
            kind = found.setdefault(key, RegionKind(len(kinds) + len(found), *own))
            assert isinstance(kind, RegionKind)
            kind.members.append(unit.number)
        else:
            kind = _ear_kind(unit.number, n, regions, order, len(kinds) + len(found), kind_of, faces, closure_constants,
                             found, unrolled)  # fmt: skip
            constants.setdefault(kind.index, []).append(
                [closure_constants[c.loop] for c in regions.ears[unit.number].closures]
            )
        kind.units.append(n)
        unit_kind_of.append(kind)
    for kind in found.values():
        if isinstance(kind, EarKind):
            for c, closure in enumerate(kind.closures):
                closure.fold([row[c] for row in constants[kind.index]])
    return list(found.values()), unit_kind_of


def _ear_kind(
    e: int,
    n: int,
    regions: Regions,
    order: Neighbours,
    index: int,
    kind_of: list[LinkKind],
    faces: list[LoopFaces],
    closure_constants: list[Constants],
    found: dict[object, UnitKind],
    unrolled: bool,
) -> EarKind:
    ear = regions.ears[e]
    region = regions.regions[ear.region]
    loops = [faces[c.loop] for c in ear.closures]
    key: object = (
        "ear", order.ear_structures[e], tuple(kind_of[i].index for i in ear.links),
        tuple(
            (f.loop.type, f.loop.turned, f.frames[0].index, f.frames[1].index, closure_constants[c.loop].shape.index,
             pattern(closure_constants[c.loop]))
            for f, c in zip(loops, ear.closures, strict=True)
        ),
        e if unrolled else 0,
    )  # fmt: skip
    kind = found.get(key)
    if kind is None:
        closures = [
            ClosureKind(
                closure_constants[c.loop].shape,
                f.loop.closure,
                f.frames[0].index,
                f.frames[1].index,
                c.paths,
                c.roots,
                c.faces,
                c.gaps,
                c.dropped,
                c.slides(f.loop.type),
                c.terms,
                f.surfaces,
                isinstance(f.loop, PointCondition) and f.loop.length is not None,
                f.loop.turned,
            )
            for f, c in zip(loops, ear.closures, strict=True)
        ]
        r = len(region.freedoms)
        angular = any(c.holds.angular for c in closures)
        inverse = number(1 / long_number(ear.length))
        kind = found[key] = EarKind(
            index, [kind_of[i] for i in ear.links], ear.parents, list(order.roles(e)), list(order.far(e)),
            [order.first_follower.get(root) == n for root in ear.roots], [i in order.first_follower for i in ear.links],
            closures, ear.dependent, ear.columns, r, total_sources(region), region.carried,
            region.rigid, inverse if angular else algebra.ONE, inverse,
            region.carried or order.region_structures[ear.region][0], order.partners[n], locked=order.locked(region),
        )  # fmt: skip
    assert isinstance(kind, EarKind)
    kind.members.append(e)
    return kind
