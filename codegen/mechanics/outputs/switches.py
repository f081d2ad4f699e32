"""Switching functions: formulas of the state, some also of positions and velocities of points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.outputs import Output
from ...model.places import Face, Point
from ...model.switches import MODE, Switch
from ...program.algebra import Expr, expression
from ...program.block import Expansion
from ...program.field import XYZ
from ...program.formula import Formula
from ...program.functions import SYMBOLIC
from ...program.scalar import Matrix, Value
from ...program.store import argument
from ..formulas import FormulaSlots, formula_kinds, leaf_of
from ..spatial import dot, matmul, minus, transpose
from ..structure.constants import Statements
from ..structure.element_kinds import PlacedElement
from ..structure.links import ORIGIN, frame_matrix, place
from ..structure.system import System
from .outputs import record_formula
from .records import Records, expressions_of, links_of

MEASURED = {"position": ("pose",), "velocity": ("pose", "kinetic")}
"""Quantities of points that a switching function may read, each with the name in `quantities.QUANTITIES` that provides
it."""


def quantities_of(switch: Switch) -> set[str]:
    """Names of the quantities that a switching function reads."""
    if switch.kind == "turn" or switch.ends:
        return {"pose"}
    first = {name.partition(".")[0] for name in Expression(switch.value).names}
    return {q for what, needed in MEASURED.items() if what in first for q in needed}


def switch_formulas(system: System) -> tuple[list[Formula], list[Formula]]:
    """The switching functions of the model: formulas of the state, and formulas over the records of links."""
    found = system.model.switches.found
    plain = [(s.number, s.value) for s in found if not quantities_of(s)]
    places = {s.number: s.places[0] for s in found}
    of_points = [s for s in found if quantities_of(s)]
    records = [_writer(s)(system, s, n) for n, s in enumerate(of_points)]
    return formula_kinds(system.model, "switches", plain, places), records


def _writer(switch: Switch) -> Callable[[System, Switch, int], Formula]:
    if switch.kind == "turn":
        return _turn
    return _ends if switch.ends else _record


class _Slots(FormulaSlots):
    """Slots of formulas that read positions and velocities of points."""

    def _slot(self, name: str) -> Tree:
        what, _, rest = name.partition(".")
        if what not in MEASURED:
            return super()._slot(name)
        point, _, component = rest.rpartition(".")
        return ("name", what, point, XYZ.index(component))


def _turn(system: System, switch: Switch, index: int) -> Formula:
    """The angle of a torsion spring, plus whole turns so that it is within half a turn of its mode (`elements.torsion`)."""
    (element,) = (e for e in system.elements if e.element.name == switch.element)
    axis = element.axis.index
    mode: Tree = ("name", f"{MODE}{switch.number}")

    def write(x: Expansion, bases: Sequence[Matrix], slot: Callable[[Tree], Tree]) -> Value:
        sine, cosine = _sine_and_cosine(x, bases, axis)
        angle = x.let("angle", x.call("atan2", sine, cosine))
        held = slot(mode)
        return x.let("value", x.call("held_turn", angle, x.entry(argument(held[1]), held[2])))

    return _of_faces(system, switch, index, element, write, "an angle that jumps at half a turn")


def _ends(system: System, switch: Switch, index: int) -> Formula:
    """The square of the distance between two points, or a function that is zero where two faces are half a turn
    apart."""
    if isinstance(switch.ends[0], Face):
        (element,) = (e for e in system.elements if e.element.ends == switch.ends)

        def write(x: Expansion, bases: Sequence[Matrix], slot: Callable[[Tree], Tree]) -> Value:
            if switch.axis is None:
                start, end = bases
                return x.let("value", 1 + sum((dot(a, b) for a, b in zip(start, end, strict=True)), expression(0)))
            sine, cosine = _sine_and_cosine(x, bases, element.axis.index)
            return x.let("value", sine * sine + cosine * cosine)

        return _of_faces(system, switch, index, element, write, "zero where faces are half a turn apart")
    points = tuple(end for end in switch.ends if isinstance(end, Point))
    output = Output(f"switch_{switch.number}", "distance", points=points)
    links = links_of(system, output)
    slots = FormulaSlots(system.model)
    canonical = {e: slots.convert(e.tree) for e in (*output.expressions(), *expressions_of(system, output.on))}

    def squared(x: Expansion, tangents: bool) -> list[Value]:
        records = Records(x, system, links, canonical, tangents)
        start, end = map(records.position, points)
        line = [x.let("line", e) for e in minus(end, start)]
        return [x.let("value", dot(line, line))]

    return _of_switch(switch, record_formula(squared, index, "switches", "a squared distance"), slots, links)


def _sine_and_cosine(x: Expansion, bases: Sequence[Matrix], axis: int) -> tuple[Value, Value]:
    """Sine and cosine of the rotation between two faces about an axis, both times the same factor. The rows of `bases` are
    base vectors of the faces."""
    (x_s, y_s), (x_e, y_e) = ((base[(axis + 1) % 3], base[(axis + 2) % 3]) for base in bases)
    return x.let("sine", dot(x_e, y_s) - dot(x_s, y_e)), x.let("cosine", dot(x_s, x_e) + dot(y_s, y_e))


def _of_faces(
    system: System, switch: Switch, index: int, element: PlacedElement,
    write: Callable[[Expansion, Sequence[Matrix], Callable[[Tree], Tree]], Value], title: str,
) -> Formula:  # fmt: skip
    """A switching function that depends on base vectors of two faces of a force element. One base vector of each face is
    the element's axis."""
    axis = element.axis
    faces = [face for face in element.element.ends if isinstance(face, Face)]
    output = Output(f"switch_{switch.number}", "rotation", bodies=tuple(face.body for face in faces))
    links = links_of(system, output)
    slots = FormulaSlots(system.model)
    expressions = [*ORIGIN, *expressions_of(system, output.on), *(axis.vector or ())]
    for face in faces:
        expressions += [e for turn, angle in face.rotation for e in (*turn, angle)]
    canonical = {e: slots.convert(e.tree) for e in expressions}

    def values(x: Expansion, tangents: bool) -> list[Value]:
        records = Records(x, system, links, canonical, tangents)

        def base(face: Face) -> Matrix:
            _, R = place(((ORIGIN, face.rotation),), records.evaluate, SYMBOLIC, x.let)
            F = frame_matrix(axis, records.evaluate, SYMBOLIC, x.let)
            return transpose(
                [[x.let("face", e) for e in row] for row in matmul(records.attitude(face.body), matmul(R, F))]
            )

        return [write(x, [base(face) for face in faces], slots.convert)]

    return _of_switch(switch, record_formula(values, index, "switches", title), slots, links)


def _record(system: System, switch: Switch, index: int) -> Formula:
    """A switching function that reads positions or velocities of points."""
    model = system.model
    names = {n.split(".")[1] for n in Expression(switch.value).names if n.partition(".")[0] in MEASURED}
    points = {p.name: p for load in model.loads for p in load.measured if p.name in names}
    output = Output(f"switch_{switch.number}", "position", points=tuple(points.values()))
    links = links_of(system, output)
    slots = _Slots(model)
    canonical = {e: slots.convert(e.tree) for e in (*output.expressions(), *expressions_of(system, output.on))}
    form = slots.convert(switch.value)

    def write(x: Expansion, tangents: bool) -> list[Value]:
        records = Records(x, system, links, canonical, tangents)

        def leaf(node: Tree) -> Expr:
            if node[1] not in MEASURED:
                return leaf_of(x)(node)
            point = points[node[2]]
            moved = records.position(point) if node[1] == "position" else records.velocity(point)
            return expression(x.let("x", moved[node[3]]))

        return [x.let("value", Statements(x, leaf).write(form))]

    return _of_switch(
        switch, record_formula(write, index, "switches", "a switching function of the model"), slots, links
    )


def _of_switch(switch: Switch, formula: Formula, slots: FormulaSlots, links: tuple[int, ...]) -> Formula:
    """The formula, with the switch as its only row."""
    formula.rows.append(slots.row(switch.number, links))
    formula.places.append(switch.places[0])
    return formula
