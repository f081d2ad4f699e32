"""Switching functions: formulas of the state, or of the positions and velocities of points too."""

from __future__ import annotations

from ...model.expressions import Expression, Tree
from ...model.outputs import Output
from ...model.switches import Switch
from ...program.block import Expansion
from ...program.expressions import Expr
from ...program.field import XYZ
from ...program.scalar import Value
from ..formulas import FormulaKind, FormulaSlots, formula_kinds
from ..stores import NUMBER, argument
from ..structure.constants import Statements
from ..structure.system import System
from .outputs import RecordFormula, value_and_tangent
from .records import Records, expressions_of, links_of, value_of

MEASURED = {"position": ("pose",), "velocity": ("pose", "kinetic")}
"""What of points a switching function may read, with the quantities that this takes."""


def quantities_of(switch: Switch) -> set[str]:
    """Names of the quantities that a switching function reads."""
    first = {name.partition(".")[0] for name in Expression(switch.value).names}
    return {q for what, needed in MEASURED.items() if what in first for q in needed}


def switch_formulas(system: System) -> tuple[list[FormulaKind], list[RecordFormula]]:
    """The switching functions of the model, as value formulas and as formulas over the records of links."""
    found = system.model.switches.found
    plain = [(s.number, s.value) for s in found if not quantities_of(s)]
    places = {s.number: s.places[0] for s in found}
    records = [_record(system, s, n) for n, s in enumerate(s for s in found if quantities_of(s))]
    return formula_kinds(system.model, "switches", plain, places), records


class _Slots(FormulaSlots):
    """Slots of formulas that read positions and velocities of points."""

    def _slot(self, name: str) -> Tree:
        what, _, rest = name.partition(".")
        if what not in MEASURED:
            return super()._slot(name)
        point, _, component = rest.rpartition(".")
        return ("name", what, point, XYZ.index(component))


def _record(system: System, switch: Switch, index: int) -> RecordFormula:
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
            if node[0] == "slot":
                return value_of(x.entry(NUMBER, node[1]))
            if node[1] not in MEASURED:
                return value_of(x.entry(argument(node[1]), node[2]))
            point = points[node[2]]
            moved = records.position(point) if node[1] == "position" else records.velocity(point)
            return value_of(x.let("x", moved[node[3]]))

        return [x.let("value", Statements(x, leaf).write(form))]

    value, tangent = value_and_tangent(write, index, "switches", "a switching function of the model")
    made = RecordFormula(
        index, "switches", value, tangent, [(c, j) for j, (c, _) in enumerate(slots.slots)],
        [(switch.number, links, [j for _, j in slots.slots], list(slots.numbers))], [switch.places[0]],
    )  # fmt: skip
    return made
