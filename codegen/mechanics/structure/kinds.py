"""Kinds: links of equal structure, which share every generated function.

The kind of a link is found from its signature (joint, zero pattern of its constants, which of them depend on parameters,
whether it has children, forces on its joint) before anything is expanded. Numbers that are equal across a kind
are folded into its code, the others are data of the link.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import sympy
from sympy import Expr
from sympy.core.numbers import Number

from ...loops.partition import Partition
from ...model.expressions import Expression
from ...model.model import CLOSURE_ROWS, GROUND, JointForce, Model
from ...program.block import Expansion
from ...program.functions import SYMBOLIC, number
from ...program.scalar import Value
from ...program.store import Store
from ..joints import LinkJoint
from ..stores import CONSTANT, CONSTANTS, LINK
from .constants import Constants, Leaf, Shape, Slots, Statements
from .element_kinds import ElementKind, PlacedElement, find_element_kinds, placed_elements
from .elimination_order import NOBODY, Partners
from .factor_form import NO_FORM, FactorForm
from .folded import Folded, make_constants, pattern
from .graph import Region
from .links import FLOAT, Carrier, Link, LoopFaces, face_constants, keep, link_constants, links_of, loop_faces
from .regions import Regions, find_regions


@dataclass(slots=True, eq=False)
class LinkKind(Folded):
    """What the blocks of a kind of links are written from.

    Attributes
    ----------
    joint, axis
        See `Link`.
    aligned : bool
        The link's axes are its parent's at q = 0.
    first : bool
        The first child of its parent on the way inward.
    first_unit : bool
        The first of all that hands inertia to its parent, loops and regions included.
    carried_on : bool
        It has a parent other than the ground.
    carries : bool
        Something that is not of its own ear hangs on it, or is coupled to it.
    closed_on : {"", "origin", "moving"}
        Whether a loop that is closed elsewhere depends on its motion: against the ground, or against the link that carries
        all of the loop, which is then the origin.
    pulled : bool
        Force elements act on it.
    forced : tuple of bool
        Which freedoms have a force of the model.
    partners : Partners
        Coupled links, of the first member; the structure is that of all.
    members : list of int
        Links, in outward order.
    units : list of int
        Their places in the order of units, where they are units themselves.
    """

    index: int
    joint: type[LinkJoint]
    axis: int
    aligned: bool
    first: bool
    first_unit: bool
    carried_on: bool
    carries: bool
    closed_on: str
    pulled: bool
    forced: tuple[bool, ...]
    partners: Partners = NOBODY
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    role = "link"

    def number_of(self, store: Store, name: str) -> Expr | None:
        """`number`, for the constants among all fields."""
        return self.number(name) if store is CONSTANTS else None

    def alias_of(self, store: Store, name: str) -> str:
        """The first constant of equal value."""
        return self.shape.varying.get(name, name) if store is CONSTANTS else name


@dataclass(slots=True, eq=False)
class ClosureKind(Folded):
    """A loop of a kind of ears: see `structure.Closure`; `axis` and `end_axis` are those of the joint among the faces' axes.

    `slides`: the way between the faces matters.
    """

    type: str
    axis: int
    end_axis: int
    paths: tuple[tuple[int, ...], tuple[int, ...]]
    roots: tuple[int, int]
    faces: tuple[int, int]
    gaps: bool
    dropped: tuple[int, ...]
    slides: bool


@dataclass(slots=True, eq=False)
class EarKind:
    """What the blocks of a kind of ears are written from.

    Attributes
    ----------
    links : list of LinkKind
    parents, dependent, columns
        See `structure.EarLinks`.
    roots : list of str
        ``frame`` (the region's base), ``ground`` (where the base is a link), ``link`` (of the region), ``far`` (see `Region`).
    far : list of int
        For each root, its place among the region's far links; -1 for the others.
    first_at : list of bool
        Whether the ear is the first, on the way inward, to hand a force to that root.
    followed : list of bool
        Which links later ears of the region start from.
    closures : list of ClosureKind
    sources, total : int
        Independent speeds of the region; with the six components of a base whose motion the loops close on, or of far links.
    carried, rigid : bool
        See `structure.Region`.
    scale, per_length : sympy number
        One over the characteristic length; the former 1 where there are no angular conditions to weigh linear ones against.
    positions : bool
        The faces of some joint of the region may be apart, so positions are needed.
    partners : Partners
        See `LinkKind`.
    members : list of int
        Ears.
    form : FactorForm
        Of the factored closure matrix; the expansion of the closures gives it.
    """

    index: int
    links: list[LinkKind]
    parents: list[int]
    roots: list[str]
    far: list[int]
    first_at: list[bool]
    followed: list[bool]
    closures: list[ClosureKind]
    dependent: list[list[int]]
    columns: list[dict[int, int]]
    sources: int
    total: int
    carried: bool
    rigid: bool
    scale: Number
    per_length: Number
    positions: bool
    partners: Partners = NOBODY
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)
    form: FactorForm = NO_FORM

    role = "ear"

    def _owner(self, store: Store) -> Folded | None:
        if store.memory is not CONSTANT or store.place is None:
            return None
        return self.links[store.place] if store.owner is LINK else self.closures[store.place]

    def number_of(self, store: Store, name: str) -> Expr | None:
        """Constants that are the same number for the whole kind."""
        owner = self._owner(store)
        return owner.number(name) if owner else None

    def alias_of(self, store: Store, name: str) -> str:
        """The first constant of equal value."""
        owner = self._owner(store)
        return owner.shape.varying.get(name, name) if owner else name


@dataclass(slots=True, eq=False)
class RegionKind:
    """What the blocks of a kind of regions are written from; see `EarKind`.

    Attributes
    ----------
    first : bool
        The region is the first, on the way inward, to hand inertia to its base.
    far : tuple of int
        For each far link, its place among the partners; -1 for the ground.
    """

    index: int
    sources: int
    total: int
    carried: bool
    rigid: bool
    first: bool
    far: tuple[int, ...] = ()
    partners: Partners = NOBODY
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    role = "region"

    def number_of(self, store: Store, name: str) -> Expr | None:
        """A region has no constants."""
        return None

    def alias_of(self, store: Store, name: str) -> str:
        """Nor any of equal value."""
        return name


UnitKind = LinkKind | EarKind | RegionKind | ElementKind


@dataclass(slots=True, eq=False)
class System:
    """A model as links, ears, regions and their kinds: everything that the expansion needs.

    Attributes
    ----------
    links : list of Link
        Outward.
    carriers : list of (int, tuple of Placement)
        For each body, the link that carries it and the way to its frame.
    kinds : list of LinkKind
        Of all links.
    kind_of, constants_of : list
        For each link.
    regions : Regions
        Ears, regions and the order of units.
    unit_kinds : list of UnitKind
        Kinds of what is not part of something larger.
    unit_kind_of : list of UnitKind
        For each unit.
    faces : list of LoopFaces
        For each loop.
    closure_constants : list of Constants
        For each loop.
    element_kinds : list of ElementKind
    elements : list of PlacedElement
        Force elements on bodies.
    slot_of : list of int
        Where the values that only neighbours need are kept: few slots, reused.
    slots : int
        How many there are, with the ground's.
    gravity : Constants or None
        Minus gravity, in ground components, m/s^2.
    force_of : dict of int to list
        Joint forces by body.
    partition : Partition or None
        Of models with loops.
    """

    model: Model
    links: list[Link]
    carriers: list[Carrier]
    kinds: list[LinkKind]
    kind_of: list[LinkKind]
    constants_of: list[Constants]
    constants: list[Constants]
    shapes: list[Shape]
    regions: Regions
    unit_kinds: list[UnitKind]
    unit_kind_of: list[UnitKind]
    faces: list[LoopFaces]
    closure_constants: list[Constants]
    element_kinds: list[ElementKind]
    elements: list[PlacedElement]
    slot_of: list[int]
    slots: int
    gravity: Constants | None
    force_of: dict[int, list[JointForce]]
    partition: Partition | None

    @property
    def coefficient_counts(self) -> dict[str, int]:
        """How many coefficients of force elements there are, by array: of those with an energy, and of the others."""
        counts = {"coefficient": 0, "drive": 0}
        for e in self.elements:
            counts["coefficient" if e.element.has_energy else "drive"] += len(e.parts)
        return {name: n for name, n in counts.items() if n}

    @property
    def independent_links(self) -> bool:
        """Every link is a unit: there are no loops."""
        return not self.regions.ears

    @property
    def independent(self) -> tuple[list[int], list[int]]:
        """Indices of the independent coordinates and speeds; of a rotation or position that is split all coordinates."""
        dependent = {
            (i, j)
            for ear in self.regions.ears
            for i, freedoms in zip(ear.links, ear.dependent, strict=True)
            for j in freedoms
        }
        q: list[int] = []
        u: list[int] = []
        for i, link in enumerate(self.links):
            free = [j for j in range(link.joint.freedoms) if (i, j) not in dependent]
            u += [link.u + j for j in free]
            q += [link.q + c for c in link.joint.moved_by(free)]
        return sorted(q), sorted(u)

    @property
    def has_link_motion(self) -> bool:
        """Some loop closes on the motion of a link that is resolved outside its region."""
        return any(r.far or (r.carried and not r.rigid) for r in self.regions.regions)


def analyse(model: Model, unrolled: bool, partition: Partition | None = None) -> System:
    """Find links, constants and kinds. No symbolic work but one expansion per form of constants."""
    defaults = model.defaults

    def evaluate(e: Expression) -> float:
        value: float = e.evaluate(defaults)
        return value

    links, carriers = links_of(model, evaluate)
    regions = find_regions(model, links, carriers, partition)
    if regions.ears:
        links, carriers = in_order_of_units(links, carriers, regions)
        regions = find_regions(model, links, carriers, partition)
    shapes: dict[object, Shape] = {}
    by_key: dict[object, Constants] = {}
    constants: list[Constants] = []
    constants_of: list[Constants] = []
    for link in links:
        key = link.key()
        found = by_key.get(key)
        if found is None:
            structure = (
                link.parent_frame.form(), link.frame.form(), tuple(len(r) for _, r in link.steps),
                tuple(tuple(len(r) for _, r in steps) for _, steps in link.members),
            )  # fmt: skip
            found = make_constants(
                shapes, structure, partial(_visit, link), partial(_write, link),
                partial(link_constants, link, evaluate, FLOAT, keep), len(constants),
            )  # fmt: skip
            by_key[key] = found
            constants.append(found)
        constants_of.append(found)
    faces = [loop_faces(loop, links, carriers, evaluate) for loop in model.loops]
    closure_constants: list[Constants] = []
    for f in faces:
        key = (f.structure(), *map(id, f.expressions()))
        found = by_key.get(key)
        if found is None:
            found = by_key[key] = make_constants(
                shapes, f.structure(), partial(_visit_faces, f), partial(_write_faces, f),
                partial(face_constants, f, evaluate, FLOAT, keep), len(constants),
            )  # fmt: skip
            constants.append(found)
        closure_constants.append(found)
    elements = placed_elements(model, links, carriers, evaluate, shapes, constants)
    pulled = {i for e in elements for i in e.acted_on}
    force_of: dict[int, list[JointForce]] = {}
    for force in model.forces:
        force_of.setdefault(force.body, []).append(force)
    forced_speeds = set()
    for body, forces in force_of.items():
        start = model.coordinate_slices[body][1].start
        for force in forces:
            for j, value in enumerate(force.values):
                if value.tree != ("number", 0):
                    forced_speeds.add(start + j)
    has_child = {link.parent for link in links}
    last_child: dict[int, int] = {}
    for i, link in enumerate(links):
        last_child[link.parent] = i
    order = _Order(links, regions, [loop.type for loop in model.loops])
    kinds: dict[object, LinkKind] = {}
    kind_of: list[LinkKind] = []
    for i, link in enumerate(links):
        c = constants_of[i]
        forced = tuple(link.u + j in forced_speeds for j in range(link.joint.freedoms))
        aligned = all(
            n not in c.shape.varying and c.values.get(n, 0.0) == float(n[2] == n[3])
            for n in (f"R.{a}{b}" for a in "xyz" for b in "xyz")
        )
        first, first_unit = (
            last_child[link.parent] == i,
            order.first_contributor.get(link.parent) == order.unit_of_link[i],
        )
        signature: object = (
            link.joint, link.frame.index, aligned, first, first_unit, link.parent != GROUND, i in has_child, forced,
            c.shape.index, pattern(c), order.place_in_ear(i), order.role_of(i), i in pulled,
            order.partners_of_link(i).structure(),
        )  # fmt: skip
        if unrolled:
            signature = i
        kind = kinds.get(signature)
        if kind is None:
            kind = kinds[signature] = LinkKind(
                c.shape, len(kinds), link.joint, link.frame.index, aligned, first, first_unit, link.parent != GROUND,
                *order.role_of(i), i in pulled, forced, order.partners_of_link(i),
            )  # fmt: skip
        kind.members.append(i)
        kind_of.append(kind)
    for kind in kinds.values():
        kind.fold([constants_of[i] for i in kind.members])
    unit_kinds, unit_kind_of = _unit_kinds(
        regions, order, list(kinds.values()), kind_of, faces, closure_constants, unrolled
    )
    kind_numbers = {GROUND: GROUND} | {i: kind.index for i, kind in enumerate(kind_of)}
    element_kinds = find_element_kinds(len(kinds) + len(unit_kinds), kind_numbers, elements, model)
    slot_of, slots = order.slots()
    gravity = None
    if model.gravity is not None:
        g = model.gravity

        def write_gravity(x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
            statements = Statements(x, leaf)
            return {f"a.{i}": x.let("a", -statements.write(slots.tree(g[k]))) for k, i in enumerate("xyz")}

        gravity = make_constants(
            shapes, ("gravity",), lambda slots: [slots.tree(e) for e in g], write_gravity,
            lambda: {f"a.{i}": -evaluate(g[k]) for k, i in enumerate("xyz")}, len(constants),
        )  # fmt: skip
        constants.append(gravity)
    return System(
        model, links, carriers, list(kinds.values()), kind_of, constants_of, constants, list(shapes.values()),
        regions, unit_kinds, unit_kind_of, faces, closure_constants, element_kinds,
        elements, slot_of, slots, gravity, force_of, partition,
    )  # fmt: skip


def in_order_of_units(links: list[Link], carriers: list[Carrier], regions: Regions) -> tuple[list[Link], list[Carrier]]:
    """Links renumbered so that the links of an ear stand together, in the order in which units are worked on."""
    new = {old: n for n, old in enumerate(i for unit in regions.order if unit.role != "region" for i in unit.links)}
    new[GROUND] = GROUND
    renumbered = sorted(range(len(links)), key=new.__getitem__)
    found = [replace(links[i], parent=new[links[i].parent]) for i in renumbered]
    return found, [(new[link], steps) for link, steps in carriers]


class _Order:
    """Who uses whom, along the order of units."""

    def __init__(self, links: list[Link], regions: Regions, loop_types: list[str]):
        self.links = links
        self.regions = regions
        self.loop_types = loop_types
        self.unit_of_link: dict[int, int] = {}
        for n, unit in enumerate(regions.order):
            if unit.role != "region":
                self.unit_of_link.update(dict.fromkeys(unit.links, n))
        self.last_use: dict[int, int] = dict(self.unit_of_link)
        self.first_contributor: dict[int, int] = {}
        self.first_follower: dict[int, int] = {}
        self._carriers: set[int] = set()
        self._structures: dict[int, tuple[object, ...]] = {}
        self.partners = regions.elimination.partners
        for n, unit in enumerate(regions.order):
            coupled = [] if unit.role == "ear" else self.partners[n].links
            if unit.role == "ear":
                ear = regions.ears[unit.number]
                base = regions.regions[ear.region].base
                used = [*ear.roots, base]
                # an ear without links, whose loop asks nothing new, hands nothing on
                for root in ear.roots if ear.links else ():
                    if root != base and root not in regions.regions[ear.region].far:
                        self.first_follower[root] = n
            else:
                region = regions.regions[unit.number] if unit.role == "region" else None
                base = region.base if region else links[unit.number].parent
                used = [base, *coupled]
                for i in (base, *coupled):
                    self.first_contributor[i] = n
                    self._carriers.add(i)
            for i in used:
                if i != GROUND:
                    self.last_use[i] = n
        for n, unit in enumerate(regions.order):
            mine = self.partners[n]
            if unit.role != "ear" and mine.links:
                mine.first = [self.first_contributor[i] == n for i in mine.links]
        self._closed_on = self._followed()

    def _followed(self) -> dict[int, str]:
        """Links whose motion some loop closes on, and those between them and the link that carries them all.

        That one is the ``origin``, unless it is between others itself: motions against the ground, say, of links on a satellite
        would lose the digits of its distance.
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
                # where another walk has been, its end is next: this one ends there or further in
                front.add(top.get(i, parent))
            top.update(dict.fromkeys(passed, *front))
            origins |= front - {GROUND}
        return dict.fromkeys(origins, "origin") | dict.fromkeys(top, "moving")

    def partners_of_link(self, i: int) -> Partners:
        """Couplings of a link that is a unit."""
        return NOBODY if self.regions.ear_of[i] is not None else self.partners[self.unit_of_link[i]]

    def carries(self, link: int) -> bool:
        return link in self._carriers

    def place_in_ear(self, link: int) -> tuple[object, ...] | None:
        """What makes links of ears differ: place, ear's structure."""
        e = self.regions.ear_of[link]
        if e is None:
            return None
        ear = self.regions.ears[e]
        return (ear.links.index(link), *self.ear_structure(e))

    def ear_structure(self, e: int) -> tuple[object, ...]:
        """Equal for ears of the same structure."""
        found = self._structures.get(e)
        if found is None:
            found = self._structures[e] = self._structure(e)
        return found

    def _structure(self, e: int) -> tuple[object, ...]:
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        n = self.unit_of_link[ear.links[0]] if ear.links else -1
        return (
            tuple(ear.parents), self.roles(e), tuple(self.first_follower.get(r) == n for r in ear.roots),
            tuple(i in self.first_follower for i in ear.links),
            tuple((c.paths, c.roots, c.faces, c.gaps, c.dropped) for c in ear.closures),
            tuple(map(tuple, ear.dependent)), tuple(tuple(sorted(c.items())) for c in ear.columns), ear.length,
            len(region.freedoms), region.carried, region.rigid, tuple(self.role_of(i) for i in ear.links), self.far(e),
            self.slides(region), tuple(i == GROUND for i in region.far),
            self.partners[n].structure() if n >= 0 else (),
        )  # fmt: skip

    def slides(self, region: Region) -> bool:
        """Whether the way between the faces of some loop of a region matters."""
        return any(c.slides(self.loop_types[c.loop]) for e in region.ears for c in self.regions.ears[e].closures)

    def roles(self, e: int) -> tuple[str, ...]:
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        return tuple(
            "frame" if r == region.base else "far" if r in region.far else "ground" if r == GROUND else "link"
            for r in ear.roots
        )

    def far(self, e: int) -> tuple[int, ...]:
        """For each root of an ear, its place among the far links of the region."""
        ear = self.regions.ears[e]
        region = self.regions.regions[ear.region]
        return tuple(region.far.index(r) if r in region.far else -1 for r in ear.roots)

    def role_of(self, link: int) -> tuple[bool, str]:
        """Whether others hang on a link, and whether a loop closes on its motion."""
        return self.carries(link), self._closed_on.get(link, "")

    def slots(self) -> tuple[list[int], int]:
        """Slots for values that live from a link to its last use; slot 0 is the ground's."""
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
            # the last freed is taken first: along a chain, neighbours alternate between two slots
            for i in sorted(ending.get(n, ()), reverse=True):
                free.append(slot_of[i])
        return slot_of, count


def total_sources(region: Region) -> int:
    """Independent speeds, and components of the motion of links."""
    moving = 1 if region.carried and not region.rigid else len(region.far)
    return len(region.freedoms) + 6 * moving


def _unit_kinds(
    regions: Regions,
    order: _Order,
    kinds: list[LinkKind],
    kind_of: list[LinkKind],
    faces: list[LoopFaces],
    closure_constants: list[Constants],
    unrolled: bool,
) -> tuple[list[UnitKind], list[UnitKind]]:
    """Kinds of units: plain links, ears, regions."""
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
            key: object = (
                "region", r, region.carried, region.rigid, first, far, partners.structure(), unit.number if unrolled else 0,
            )  # fmt: skip
            kind = found.setdefault(
                key,
                RegionKind(
                    len(kinds) + len(found),
                    r,
                    total_sources(region),
                    region.carried,
                    region.rigid,
                    first,
                    far,
                    partners,
                ),
            )
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
    order: _Order,
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
        "ear", order.ear_structure(e), tuple(kind_of[i].index for i in ear.links),
        tuple(
            (f.loop.type, f.frames[0].index, f.frames[1].index, closure_constants[c.loop].shape.index,
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
                f.loop.type,
                f.frames[0].index,
                f.frames[1].index,
                c.paths,
                c.roots,
                c.faces,
                c.gaps,
                c.dropped,
                c.slides(f.loop.type),
            )
            for f, c in zip(loops, ear.closures, strict=True)
        ]
        r = len(region.freedoms)
        angular = any(CLOSURE_ROWS[c.type][1] for c in closures)
        kind = found[key] = EarKind(
            index, [kind_of[i] for i in ear.links], ear.parents, list(order.roles(e)), list(order.far(e)),
            [order.first_follower.get(root) == n for root in ear.roots], [i in order.first_follower for i in ear.links],
            closures, ear.dependent, ear.columns, r, total_sources(region), region.carried,
            region.rigid, number(1 / ear.length) if angular else sympy.S.One, number(1 / ear.length),
            region.carried or order.slides(region), order.partners[n],
        )  # fmt: skip
    assert isinstance(kind, EarKind)
    kind.members.append(e)
    return kind


def _write(link: Link, x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
    """Write the constants of a link as statements."""
    statements = Statements(x, leaf)
    return link_constants(link, lambda e: statements.write(slots.tree(e)), SYMBOLIC, x.let)


def _visit(link: Link, slots: Slots) -> None:
    """Bring all expressions of a link into slots, in a fixed order."""
    for frame in (link.parent_frame, link.frame):
        if frame.vector is not None:
            for e in frame.vector:
                slots.tree(e)
    for steps in (link.steps, *(steps for _, steps in link.members)):
        for at, rotation in steps:
            for e in at:
                slots.tree(e)
            for axis, angle in rotation:
                for e in (*axis, angle):
                    slots.tree(e)
    for body, _ in link.members:
        for e in (body.mass, *body.com, *body.inertia):
            slots.tree(e)


def _visit_faces(faces: LoopFaces, slots: Slots) -> None:
    for e in faces.expressions():
        slots.tree(e)


def _write_faces(faces: LoopFaces, x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
    """Write the constants of a loop's faces as statements."""
    statements = Statements(x, leaf)
    return face_constants(faces, lambda e: statements.write(slots.tree(e)), SYMBOLIC, x.let)
