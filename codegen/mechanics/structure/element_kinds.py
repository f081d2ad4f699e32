"""Force elements on bodies: their attachment points, the forms of their coefficients, and the kinds of the elements.

A coefficient is an expression of the model. The element's block computes its terms in positions and velocities of points.
The largest subexpressions without such terms are *coefficients* of the generated code: formulas evaluated before the
sweeps. Elements of one kind may differ in these subexpressions only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field

from ...model.axes import Vector as Axis
from ...model.errors import ModelError
from ...model.expressions import Expression
from ...model.forces import ForceElement
from ...model.grammar import Tree
from ...model.model import Model
from ...model.places import GROUND, Face, Point
from ...program.field import XYZ
from ...program.scalar import Value
from ...program.shape import Constants
from ...records import dataclass
from ..spatial import matmul, matvec, transpose
from ..stores import ELEMENT_CONSTANTS
from .constants import split
from .links import (
    BODY_FRAME,
    Carrier,
    Evaluate,
    Frame,
    Functions,
    Let,
    Link,
    NumberOf,
    Placement,
    axis_frame,
    expressions_of_steps,
    form_of_steps,
    frame_matrix,
    place,
)
from .model_constants import ModelConstants
from .shared_constants import SharedConstants, pattern


@dataclass(slots=True, eq=False)
class PlacedElement:
    """A force element on links.

    Attributes
    ----------
    links : tuple of int
        Links (or `GROUND`) on which the element acts or whose motion it reads, each once.
    ends : tuple of int
        For each attachment point, then for each point whose motion is only read: index of its link in `links`.
    steps : tuple of tuples of Placement
        From the body frame of the point's link to the point.
    frames : tuple of Frame
        For each point, the frame of its link in the link's body.
    oriented : tuple of bool
        Whether the element uses axes at the point.
    axis : Frame
        The frame whose coordinate axis is the axis of the element's faces.
    forms : tuple of Tree
        Its coefficients, then the mode of its angle or line and the direction of the line, if any. They contain
        ``("name", "coefficient", i)`` for the parts that are evaluated before the sweeps. Points have the names
        ``("name", "position", end, i)`` and ``("name", "velocity", end, i)``.
    parts : tuple of (str, Tree)
        The parts that are evaluated before the sweeps, each with its key in the model file.
    first : int
        Index of the first of these parts in its array.
    constants : Constants
    """

    element: ForceElement
    links: tuple[int, ...]
    ends: tuple[int, ...]
    steps: tuple[tuple[Placement, ...], ...]
    frames: tuple[Frame, ...]
    oriented: tuple[bool, ...]
    axis: Frame
    forms: tuple[Tree, ...]
    parts: tuple[tuple[str, Tree], ...]
    first: int
    constants: Constants = field(init=False)

    @property
    def acted_on(self) -> list[int]:
        """The link of each attachment point."""
        return [self.links[j] for j in self.ends[: len(self.element.ends)]]

    def expressions(self) -> list[Expression]:
        """The expressions in its constants, in a fixed order."""
        found: list[Expression] = []
        for steps, frame, oriented in zip(self.steps, self.frames, self.oriented, strict=True):
            found += frame.vector or ()
            if oriented:
                found += self.axis.vector or ()
            found += expressions_of_steps(steps)
        return found

    def structure(self) -> tuple[object, ...]:
        """A key, equal for elements whose constants differ only in numbers and parameters."""
        return (
            "ends", self.oriented, self.axis.form(), *(f.form() for f in self.frames),
            *map(form_of_steps, self.steps),
        )  # fmt: skip

    def write_constants(self, evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
        """Positions of the attachment points along the links' axes, and the axes of faces.

        Returns
        -------
        dict
            For each point ``A``, ``B``, ...: ``A.r.i`` position, m; ``A.F.ij`` link components from those of the face. One base
            vector of the face is the element's axis.
        """
        out: dict[str, Value] = {}
        for n, (steps, frame, oriented) in enumerate(zip(self.steps, self.frames, self.oriented, strict=True)):
            name = end_name(n)
            Q = frame_matrix(frame, evaluate, functions, let)
            r, R = place(steps, evaluate, functions, let)
            for k, value in zip(XYZ, matvec(transpose(Q), r), strict=True):
                out[f"{name}.r.{k}"] = let("r", value)
            if oriented:
                half = [[let("F", v) for v in row] for row in matmul(transpose(Q), R)]
                F = matmul(half, frame_matrix(self.axis, evaluate, functions, let))
                out |= {f"{name}.F.{i}{j}": let("F", F[a][b]) for a, i in enumerate(XYZ) for b, j in enumerate(XYZ)}
        return out


@dataclass(slots=True, eq=False)
class ElementKind(SharedConstants):
    """The common properties of force elements of one kind, from which their blocks are written.

    Attributes
    ----------
    first : ForceElement
        The first member; the others differ from it in numbers and names.
    grounded : tuple of bool
        For each link, whether it is the ground.
    ends, oriented : tuple
        See `PlacedElement`; attachment points come first.
    axis : int
        Index of the base vector of the faces that lies along the element's axis.
    forms : tuple of Tree
        See `PlacedElement`.
    model : Model
        For messages about coefficients that have no finite value.
    members : list of int
        Force elements.
    """

    index: int
    first: ForceElement
    grounded: tuple[bool, ...]
    ends: tuple[int, ...]
    oriented: tuple[bool, ...]
    axis: int
    forms: tuple[Tree, ...]
    model: Model = field(repr=False)
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    role = "element"
    store = ELEMENT_CONSTANTS

    def no_value(self, what: str) -> ModelError:
        """The error that reports coefficients without a finite value or derivative in any state."""
        path = f"forces.{self.first.name}"
        message = f"{what} has no value or no derivative (a division by zero? an overflow?) for any state; change it"
        return ModelError([self.model.problem(path, message)])


def end_name(i: int) -> str:
    """Name of a point among the constants: A, B, ..."""
    return chr(ord("A") + i) if i < 26 else f"E{i}"


def without_parts(tree: Tree, ends: Mapping[str, int], parts: list[Tree]) -> Tree:
    """The form of a coefficient. Subexpressions without positions or velocities of points are replaced by names and
    appended to `parts`."""

    def part(unmeasured: Tree) -> Tree:
        parts.append(unmeasured)
        return ("name", "coefficient", len(parts) - 1)

    def measured(name: Tree) -> Tree:
        what, point, component = name[1].split(".")
        return ("name", what, ends[point], XYZ.index(component))

    if tree[0] == "number":
        return part(tree) if tree[1] else tree
    return split(tree, lambda inner: not _measures(inner), part, measured)


def _measures(tree: Tree) -> bool:
    """Whether an expression contains a position or velocity of a point."""
    return any(name.startswith(("position.", "velocity.")) for name in Expression(tree).names)


def placed_elements(
    model: Model,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    way_of_ground: tuple[Placement, ...],
    constants: ModelConstants,
) -> list[PlacedElement]:
    """The force elements on bodies, in the model's order."""
    found = []
    carriers = [*carriers, (GROUND, way_of_ground)]  # the index `GROUND` refers to this last entry
    first = {True: 0, False: 0}
    for element in model.loads:
        e = _placed(element, links, carriers, constants.evaluate, first[element.has_energy], model.switches.hold,
            model.switches.mode_of(element.name))  # fmt: skip
        first[element.has_energy] += len(e.parts)
        e.constants = constants.of(e)
        found.append(e)
    return found


def _placed(
    element: ForceElement,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    evaluate: NumberOf,
    first: int,
    hold: Callable[[Tree], Tree],
    mode: tuple[Tree, ...],
) -> PlacedElement:
    places: list[Point | Face] = [*element.ends, *element.measured]
    on: list[int] = []
    steps: list[tuple[Placement, ...]] = []
    for at in places:
        link, way = carriers[at.body]
        on.append(link)
        steps.append((*way, (at.at, at.rotation if isinstance(at, Face) else ())))
    distinct = tuple(dict.fromkeys(on))
    ends = {point.name: len(element.ends) + i for i, point in enumerate(element.measured)}
    parts: list[Tree] = []
    keys: list[str] = []
    forms = []
    for name, e in zip(element.keys, element.coefficients, strict=True):
        forms.append(without_parts(hold(e.tree), ends, parts))
        keys += [name] * (len(parts) - len(keys))
    if mode:
        forms += [without_parts(mode[0], ends, parts), *mode[1:]]
        keys.append("mode")
    return PlacedElement(
        element, distinct, tuple(distinct.index(i) for i in on), tuple(steps),
        tuple(BODY_FRAME if i == GROUND else links[i].frame for i in on),
        tuple(isinstance(at, Face) for at in places), _axis(element.axis, evaluate), tuple(forms),
        tuple(zip(keys, parts, strict=True)), first,
    )  # fmt: skip


def _axis(axis: Axis | None, evaluate: NumberOf) -> Frame:
    return BODY_FRAME if axis is None else axis_frame(axis, evaluate, is_seen=False)


def find_element_kinds(
    index: int, kind_of: Mapping[int, int], elements: Sequence[PlacedElement], model: Model
) -> list[ElementKind]:
    """The kinds of force elements, numbered from `index`; `kind_of` gives the kind of each link."""
    found: dict[object, ElementKind] = {}
    owned: dict[int, list[Constants]] = {}
    for n, e in enumerate(elements):
        c, on = e.constants, tuple(kind_of[i] for i in e.links)
        key = (
            type(e.element),
            e.element.variant,
            on,
            e.ends,
            e.oriented,
            e.axis.index,
            e.forms,
            c.shape.index,
            pattern(c),
        )
        kind = found.get(key)
        if kind is None:
            grounded = tuple(i == GROUND for i in e.links)
            kind = found[key] = ElementKind(
                c.shape, index + len(found), e.element, grounded, e.ends, e.oriented, e.axis.index, e.forms, model
            )
        kind.members.append(n)
        owned.setdefault(kind.index, []).append(c)
    for kind in found.values():
        kind.fold(owned[kind.index])
    return list(found.values())
