"""Force elements on bodies: where their ends are, of which form their coefficients are, and which are alike.

A coefficient is an expression of the model. What it contains of positions and velocities of points is computed in the element's
block; the largest parts without any are *coefficients* in the generated code, formulas that are evaluated beforehand. Elements
whose coefficients are alike but for those parts are of one kind.
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
    """A force element between links.

    Attributes
    ----------
    links : tuple of int
        That it acts on or looks at, each once; `GROUND`.
    ends : tuple of int
        For each end, where it acts and then the points that it only looks at, the place of its link among `links`.
    steps : tuple of tuples of Placement
        From the body frame of that link to the end.
    frames : tuple of Frame
        Of that link.
    oriented : tuple of bool
        Whether the axes of an end matter.
    axis : Frame
        Of the axis of its faces.
    forms : tuple of Tree
        Its coefficients, then the mode of its angle or its line, if that has one, and the line's direction, with
        ``("name", "coefficient", i)`` for the parts that are evaluated beforehand and ``("name",
        "position", end, i)`` and ``("name", "velocity", end, i)`` for what points do.
    parts : tuple of (str, Tree)
        Those parts, each with the key of the model file where it stands.
    first : int
        Place of the first of them in its array.
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
        """Links that it acts on, for each end."""
        return [self.links[j] for j in self.ends[: len(self.element.ends)]]

    def expressions(self) -> list[Expression]:
        """All that its constants are made of, in a fixed order."""
        found: list[Expression] = []
        for steps, frame, oriented in zip(self.steps, self.frames, self.oriented, strict=True):
            found += frame.vector or ()
            if oriented:
                found += self.axis.vector or ()
            found += expressions_of_steps(steps)
        return found

    def structure(self) -> tuple[object, ...]:
        """Equal for elements whose constants are the same but for numbers and parameters."""
        return (
            "ends", self.oriented, self.axis.form(), *(f.form() for f in self.frames),
            *map(form_of_steps, self.steps),
        )  # fmt: skip

    def write_constants(self, evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
        """Places of the ends, in link components, and axes of those whose axes matter.

        Returns
        -------
        dict
            ``A``, ``B``, ... the ends: ``A.r.i`` the place, m; ``A.F.ij`` link components from those of the face, one of whose
            base vectors is the element's axis.
        """
        out: dict[str, Value] = {}
        for n, (steps, frame, oriented) in enumerate(zip(self.steps, self.frames, self.oriented, strict=True)):
            name = end_name(n)
            Q = frame_matrix(frame, evaluate, functions["sqrt"], let)
            r, R = place(steps, evaluate, functions, let)
            for k, value in zip(XYZ, matvec(transpose(Q), r), strict=True):
                out[f"{name}.r.{k}"] = let("r", value)
            if oriented:
                half = [[let("F", v) for v in row] for row in matmul(transpose(Q), R)]
                F = matmul(half, frame_matrix(self.axis, evaluate, functions["sqrt"], let))
                out |= {f"{name}.F.{i}{j}": let("F", F[a][b]) for a, i in enumerate(XYZ) for b, j in enumerate(XYZ)}
        return out


@dataclass(slots=True, eq=False)
class ElementKind(SharedConstants):
    """What the blocks of a kind of force elements are written from.

    Attributes
    ----------
    first : ForceElement
        The first member: the others differ from it in numbers and names.
    grounded : tuple of bool
        For each link, whether it is the ground.
    ends, oriented : tuple
        See `PlacedElement`; those where it acts come first.
    axis : int
        Which base vector of its faces is its axis.
    forms : tuple of Tree
        See `PlacedElement`.
    model : Model
        For what is said when a coefficient has no value.
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
        """The error for coefficients that have no value for any state."""
        path = f"forces.{self.first.name}"
        message = f"{what} has no value or no derivative (a division by zero? an overflow?) for any state; change it"
        return ModelError([self.model.problem(path, message)])


def end_name(i: int) -> str:
    """What an end is called among the constants: A, B, ..."""
    return chr(ord("A") + i) if i < 26 else f"E{i}"


def without_parts(tree: Tree, ends: Mapping[str, int], parts: list[Tree]) -> Tree:
    """A coefficient without the parts that no position or velocity of a point is in; these are appended to `parts`."""

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
    """Whether a position or velocity of a point is in it."""
    return any(name.startswith(("position.", "velocity.")) for name in Expression(tree).names)


def placed_elements(
    model: Model,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    way_of_ground: tuple[Placement, ...],
    constants: ModelConstants,
) -> list[PlacedElement]:
    """The force elements on bodies in their order."""
    found = []
    carriers = [*carriers, (GROUND, way_of_ground)]  # which is the one at `GROUND`
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
    return BODY_FRAME if axis is None else axis_frame(axis, evaluate)


def find_element_kinds(
    index: int, kind_of: Mapping[int, int], elements: Sequence[PlacedElement], model: Model
) -> list[ElementKind]:
    """Kinds of elements, numbered from `index`; `kind_of` numbers the kinds of links."""
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
