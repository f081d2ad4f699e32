"""A model as links, ears (graph.py), regions and their kinds, which is the input of the expansion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import mpmath

from ...loops.partition import Partition
from ...model.expressions import Expression, functions_for
from ...model.model import GROUND, JointForce, Model
from ...program.digits import are_long, long_number
from ...program.field import XYZ
from ...program.shape import Constants, Shape
from ...records import dataclass
from ..fields import explicit_acceleration, remainder, total
from .element_kinds import ElementKind, PlacedElement, find_element_kinds, placed_elements
from .faces import LoopFaces, loop_faces
from .grouping import find_link_kinds, find_unit_kinds
from .kinds import LinkKind, UnitKind
from .links import Carrier, Link, Placement, links_of
from .model_constants import ModelConstants
from .neighbours import Neighbours
from .regions import Regions, find_regions
from .world import turned_ground

LONG = 16
"""Smallest number of links in a chain for which the explicit accelerations include gravity; see
`System.fields_of_gravity`."""


@dataclass(slots=True, eq=False)
class System:
    """A model as links, ears, regions and their kinds: the input of the expansion.

    Attributes
    ----------
    links : list of Link
        In outward order.
    carriers : list of (int, tuple of Placement)
        For each body, the link that carries it and the placements from that link's body.
    kinds : list of LinkKind
        Of all links.
    kind_of, constants_of : list
        Kind and constants of each link.
    regions : Regions
        Ears, regions and the order of units.
    unit_kinds : list of UnitKind
        The kinds of units.
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
        Memory slot of each link for values that only its neighbours need; slots are reused.
    slots : int
        Number of slots, including the ground's.
    gravity : Constants or None
        Minus gravity, along the ground's axes, m/s^2.
    force_of : dict of int to list
        Joint forces by body.
    partition : Partition or None
        For models with loops.
    way_of_ground : tuple of Placement
        From the axes of the computation to those of the model's ground; see `world`.
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
    way_of_ground: tuple[Placement, ...] = ()

    @property
    def coefficient_counts(self) -> dict[str, int]:
        """Number of coefficients of force elements, by array: those of elements with an energy, and those of elements
        without."""
        counts = {"coefficient": 0, "drive": 0}
        for e in self.elements:
            counts["coefficient" if e.element.has_energy else "drive"] += len(e.parts)
        return {name: n for name, n in counts.items() if n}

    @property
    def arrays(self) -> dict[str, int]:
        """Sizes of arrays that are computed within a call: coefficients, prescribed motion."""
        n = len(self.model.prescribed)
        of_motion = {"prescribed": 3 * n, "held_force": n * bool(self.held), "driving": n}
        return self.coefficient_counts | {name: size for name, size in of_motion.items() if size}

    @property
    def held(self) -> set[int]:
        """Prescribed coordinates along which the model has a joint force."""
        return speeds_and_held(self.model)[1]

    @property
    def fields_of_gravity(self) -> dict[str, str]:
        """Components of the ground's record that gravity sets, each with the component of gravity.

        In chains of at least `LONG` links, gravity enters the explicit part of the accelerations. At the far end of a
        freely falling chain this part is then small, so no large terms cancel there. In shorter chains, and if loops
        close on the ground or couple links, the ground has no explicit part, and gravity enters the remainders.
        """
        if self.gravity is None:
            return {}
        touched = [*((r.base, *r.far) for r in self.regions.regions), *(ear.roots for ear in self.regions.ears)]
        closed = self.regions.elimination.slots > 0 or any(GROUND in links for links in touched)
        start = remainder.a if closed or longest_chain(self.links) < LONG else explicit_acceleration.linear
        return {f"{v.name}.{i}": f"{remainder.a.name}.{i}" for v in (start, total.a) for i in XYZ}

    @property
    def independent_links(self) -> bool:
        """Whether the model has no loops, so that every link is a unit."""
        return not self.regions.ears

    @property
    def independent(self) -> tuple[list[int], list[int]]:
        """Indices of independent coordinates and speeds. If loops determine a rotation or position only in part, all of
        its coordinates count as independent."""
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
        """Whether a loop closes on the motion of a link of another region."""
        return any(r.far or (r.carried and not r.rigid) for r in self.regions.regions)


def analyse(model: Model, unrolled: bool, partition: Partition | None = None, turning: bool = True) -> System:
    """Find links, constants and kinds. Symbolic work is one expansion for each form of constants.

    With `turning` false, the ground keeps the axes of the model.
    """
    model, way_of_ground = turned_ground(model) if turning else (model, ())
    defaults = {name: long_number(value) for name, value in model.defaults.items()}
    functions = functions_for(mpmath) if are_long() else None

    def evaluate(e: Expression) -> float:
        value: float = e.evaluate(defaults, functions)
        return value

    links, carriers = links_of(model, evaluate)
    regions = find_regions(model, links, carriers, partition)
    if regions.ears:
        links, carriers = in_order_of_units(links, carriers, regions)
        regions = find_regions(model, links, carriers, partition)
    constants = ModelConstants(evaluate)
    constants_of = [constants.of(link, link.joint, link.parent_frame.index, link.frame.index) for link in links]
    faces = [loop_faces(loop, links, carriers, evaluate) for loop in model.loops]
    closure_constants = [constants.of(f) for f in faces]
    elements = placed_elements(model, links, carriers, way_of_ground, constants)
    force_of: dict[int, list[JointForce]] = {}
    for force in model.forces:
        force_of.setdefault(force.body, []).append(force)
    order = Neighbours(links, regions, [loop.type for loop in model.loops])
    pulled = {i for e in elements for i in e.acted_on}
    kinds, kind_of = find_link_kinds(links, constants_of, order, *speeds_and_held(model), pulled, unrolled)
    unit_kinds, unit_kind_of = find_unit_kinds(regions, order, kinds, kind_of, faces, closure_constants, unrolled)
    kind_numbers = {GROUND: GROUND} | {i: kind.index for i, kind in enumerate(kind_of)}
    element_kinds = find_element_kinds(len(kinds) + len(unit_kinds), kind_numbers, elements, model)
    slot_of, slots = order.slots()
    gravity = None if model.gravity is None else constants.of_gravity(model.gravity)
    return System(
        model, links, carriers, kinds, kind_of, constants_of, constants.found, list(constants.shapes.values()),
        regions, unit_kinds, unit_kind_of, faces, closure_constants, element_kinds,
        elements, slot_of, slots, gravity, force_of, partition, way_of_ground,
    )  # fmt: skip


def speeds_and_held(model: Model) -> tuple[set[int], set[int]]:
    """Indices of the speeds, and of the prescribed coordinates, along which the model has a nonzero joint force."""
    found = {i for of in model.forces for i, _ in speeds_with_forces(model, of)}
    return {i for i in found if i >= 0}, {-1 - i for i in found if i < 0}


def speeds_with_forces(model: Model, force: JointForce) -> Iterator[tuple[int, Expression]]:
    """The nonzero values of a joint force, each with its speed; prescribed coordinates have the numbers -1, -2, ..."""
    i, places = model.coordinate_slices[force.body][1].start, model.places_of_prescribed
    for j, value in enumerate(force.values):
        n = places.get((force.body, j))
        if value.tree != ("number", 0):
            yield (i if n is None else -1 - n), value
        i += n is None


def in_order_of_units(links: list[Link], carriers: list[Carrier], regions: Regions) -> tuple[list[Link], list[Carrier]]:
    """Links renumbered so that the links of an ear are consecutive, in the order of units."""
    new = {old: n for n, old in enumerate(i for unit in regions.order if unit.role != "region" for i in unit.links)}
    new[GROUND] = GROUND
    renumbered = sorted(range(len(links)), key=new.__getitem__)
    found = [replace(links[i], parent=new[links[i].parent]) for i in renumbered]
    return found, [(new[link], steps) for link, steps in carriers]


def longest_chain(links: Sequence[Link]) -> int:
    """Number of links between the ground and the farthest tip."""
    depth: list[int] = []
    for link in links:
        depth.append(1 if link.parent == GROUND else depth[link.parent] + 1)
    return max(depth, default=0)
