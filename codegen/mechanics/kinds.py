"""Kinds: links of equal structure, which share every generated function.

The kind of a link is found from its signature (joint, zero pattern of its constants, which of them depend on parameters,
whether it has children, forces on its joint) before anything is expanded. Numbers that are equal across a kind
are folded into its code, the others are data of the link.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import sympy
from sympy import Expr

from ..model.model import GROUND, Model
from ..program.block import Expansion
from ..program.functions import SYMBOLIC, number
from .constants import Constants, Shape, Slots, Statements, make_shape
from .joints import freedom_axes
from .links import FLOAT, Link, keep, link_constants, links_of


@dataclass(slots=True, eq=False)
class LinkKind:
    """What the blocks of a kind are written from.

    Attributes
    ----------
    joint, axis
        See `Link`.
    aligned : bool
        The link's axes are its parent's at q = 0.
    first : bool
        The first child of its parent on the way inward.
    carried_on : bool
        It has a parent other than the ground.
    forced : tuple of bool
        Which freedoms have a force of the model.
    shape : Shape
        Of its constants.
    members : list of int
        Links, in outward order.
    literal : dict of str to Expr
        Constants that are the same number for all members.
    data : dict of str to int
        Constants that differ among members: places among a member's numbers.
    """

    index: int
    joint: str
    axis: int
    aligned: bool
    first: bool
    carried_on: bool
    forced: tuple[bool, ...]
    shape: Shape
    members: list[int] = field(default_factory=list)
    literal: dict[str, Expr] = field(default_factory=dict)
    data: dict[str, int] = field(default_factory=dict)

    @property
    def parameters(self) -> int:
        """How many design parameters its constants depend on."""
        return self.shape.parameters

    def number(self, name: str) -> Expr | None:
        """Value of a constant that is the same for the whole kind; None if it is data."""
        if name in self.shape.varying:
            return None
        if name in self.shape.fixed:
            return self.shape.fixed[name]
        if "/" in name:
            return sympy.S.Zero
        return self.literal.get(name)

    def number_of(self, array: str, name: str) -> Expr | None:
        """`number`, for the constants among all fields."""
        return self.number(name) if array == "c" else None

    def alias_of(self, array: str, name: str) -> str:
        """The first constant of equal value."""
        return self.shape.varying.get(name, name) if array == "c" else name


@dataclass(slots=True, eq=False)
class System:
    """A model as links and kinds: everything that the expansion needs.

    Attributes
    ----------
    links : list of Link
        Outward.
    carriers : list of (int, tuple of Placement)
        For each body, the link that carries it and the way to its frame.
    kinds : list of LinkKind
    kind_of, constants_of : list
        For each link.
    slot_of : list of int
        Where the values that only neighbours need are kept: few slots, reused.
    slots : int
        How many there are, with the ground's.
    gravity : Constants or None
        Minus gravity, in ground components, m/s^2.
    force_of : dict of int to list
        Joint forces by body.
    """

    model: Model
    links: list[Link]
    carriers: list[Any]
    kinds: list[LinkKind]
    kind_of: list[LinkKind]
    constants_of: list[Constants]
    constants: list[Constants]
    shapes: list[Shape]
    slot_of: list[int]
    slots: int
    gravity: Constants | None
    force_of: dict[int, list[Any]]


def analyse(model: Model, unrolled: bool) -> System:
    """Find links, constants and kinds. No symbolic work but one expansion per form of constants."""
    defaults = {p.name: p.value for p in model.parameters}

    def evaluate(e: Any) -> Any:
        return e.evaluate(defaults)

    links, carriers = links_of(model, evaluate)
    shapes: dict[Any, Shape] = {}
    by_key: dict[Any, Constants] = {}
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
    force_of: dict[int, list[Any]] = {}
    for force in model.forces:
        force_of.setdefault(force.body, []).append(force)
    forced_speeds = set()
    for body, forces in force_of.items():
        start = model.coordinate_slices[body][1].start
        for f in forces:
            for j, value in enumerate(f.values):
                if value.tree != ("number", 0):
                    forced_speeds.add(start + j)
    has_child = {link.parent for link in links}
    last_child: dict[int, int] = {}
    for i, link in enumerate(links):
        last_child[link.parent] = i
    kinds: dict[Any, LinkKind] = {}
    kind_of = []
    for i, link in enumerate(links):
        c = constants_of[i]
        forced = tuple(link.u + j in forced_speeds for j in range(len(freedom_axes(link.joint, 0))))
        pattern = tuple(sorted(n for n, v in c.values.items() if v != 0))
        aligned = all(
            n not in c.shape.varying and c.values.get(n, 0.0) == float(n[2] == n[3])
            for n in (f"R.{a}{b}" for a in "xyz" for b in "xyz")
        )
        signature: Any = (
            link.joint, link.frame.index, aligned, last_child[link.parent] == i, link.parent != GROUND,
            i in has_child, forced, c.shape.index, pattern,
        )  # fmt: skip
        if unrolled:
            signature = i
        kind = kinds.get(signature)
        if kind is None:
            kind = kinds[signature] = LinkKind(
                len(kinds), link.joint, link.frame.index, aligned, last_child[link.parent] == i,
                link.parent != GROUND, forced, c.shape,
            )  # fmt: skip
        kind.members.append(i)
        kind_of.append(kind)
    for kind in kinds.values():
        _fold_numbers(kind, constants_of)
    slot_of, slots = _slots(links, last_child)
    gravity = None
    if model.gravity is not None:
        g = model.gravity

        def write_gravity(x: Expansion, leaf: Any, slots: Slots) -> dict[str, Any]:
            statements = Statements(x, leaf)
            return {f"a.{i}": x.let("a", -statements.write(slots.tree(g[k]))) for k, i in enumerate("xyz")}

        gravity = make_constants(
            shapes, ("gravity",), lambda slots: [slots.tree(e) for e in g], write_gravity,
            lambda: {f"a.{i}": -evaluate(g[k]) for k, i in enumerate("xyz")}, len(constants),
        )  # fmt: skip
        constants.append(gravity)
    return System(
        model, links, carriers, list(kinds.values()), kind_of, constants_of, constants, list(shapes.values()),
        slot_of, slots, gravity, force_of,
    )  # fmt: skip


def make_constants(
    shapes: dict[Any, Shape],
    structure: Any,
    visit: Callable[[Slots], Any],
    write: Callable[[Expansion, Any, Slots], dict[str, Any]],
    values: Callable[[], dict[str, Any]],
    index: int,
) -> Constants:
    """The constants of one set of expressions; expands their shape if it is new."""
    slots = Slots()
    visit(slots)
    key = (structure, tuple(slots.trees))
    shape = shapes.get(key)
    if shape is None:
        shape = shapes[key] = make_shape(len(shapes), slots, lambda x, leaf: write(x, leaf, slots))
    numeric = {name: float(v) for name, v in values().items() if name not in shape.varying and shape.fields[name] != 0}
    return Constants(shape, tuple(slots.parameters), tuple(slots.numbers), numeric, index)


def _write(link: Link, x: Expansion, leaf: Any, slots: Slots) -> dict[str, Any]:
    """Write the constants of a link as statements."""
    statements = Statements(x, leaf)
    functions = {n: SYMBOLIC[n] for n in ("sqrt", "cos", "sin")}
    return link_constants(link, lambda e: statements.write(slots.tree(e)), functions, x.let)


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


def _fold_numbers(kind: LinkKind, constants_of: list[Constants]) -> None:
    names = [n for n in kind.shape.fields if n not in kind.shape.varying]
    distinct = list({id(constants_of[i]): constants_of[i] for i in kind.members}.values())
    for name in names:
        values = {c.values.get(name, 0.0) for c in distinct}
        if len(values) == 1:
            kind.literal[name] = number(values.pop())
        else:
            kind.data[name] = len(kind.data)


def _slots(links: list[Link], last_child: dict[int, int]) -> tuple[list[int], int]:
    """Slots for values that live from a link to its last child; slot 0 is the ground's."""
    free: list[int] = []
    count = 1
    slot_of = []
    for i, link in enumerate(links):
        if free:
            slot = free.pop()
        else:
            slot, count = count, count + 1
        slot_of.append(slot)
        if i not in last_child:
            free.append(slot)
        if link.parent != GROUND and last_child[link.parent] == i:
            free.append(slot_of[link.parent])
    return slot_of, count
