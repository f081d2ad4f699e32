"""Outputs and potential energy: formulas over the records of links and over sums of all links.

Outputs of the same form share a block; the links are data. Each measure has a file of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.model import GROUND, Model, Output
from ...program import algebra
from ...program.algebra import Expr, Symbol
from ...program.block import Block, Expansion
from ...program.derivatives import Tangents
from ...program.formula import Formula
from ...program.functions import SYMBOLIC
from ...program.passes import simplify
from ...program.scalar import Value, Vector
from ...program.store import argument
from .. import fields
from ..formulas import FormulaSlots, formula_kinds, has_derivative, leaf_of, seed_of
from ..spatial import add, dot
from ..stores import LME, ME, MY_LANE, RECORD, TANGENT_OF
from ..structure.constants import Statements
from ..structure.links import rigid_inertia
from ..structure.system import System
from . import MEASURES
from .energy import OUTBOARD
from .measure import FormulaMeasure, RecordMeasure
from .records import Records, expressions_of, links_of, structure_of


def pivoted_outputs(model: Model) -> list[str]:
    """Outputs that have no derivative where two of their points coincide."""
    measures = {o.name: MEASURES[o.measure] for o in model.outputs}
    return [name for name, m in measures.items() if isinstance(m, RecordMeasure) and m.pivots]


def output_formulas(system: System) -> tuple[list[Formula], list[Formula]]:
    """The outputs of the model: those that are formulas of the state, and those that read records. Outputs that are
    energies are missing, since procedures copy them."""
    model = system.model
    values: list[tuple[int, Tree]] = []
    found = RecordFormulas(system, "outputs", "an output of the model")
    for i, o in enumerate(model.outputs):
        measure = MEASURES[o.measure]
        if isinstance(measure, FormulaMeasure):
            assert o.expression is not None
            values.append((i, model.switches.hold(o.expression.tree)))
        elif isinstance(measure, RecordMeasure):
            links = links_of(system, o)
            expressions = [*o.expressions(), *expressions_of(system, o.on), *measure.more(o, system)]
            places = [o.on.index(body) for body in (*(p.body for p in o.points), *o.bodies)]
            key = (o.measure, o.choice, structure_of(system, o.on, links), places)
            found.add(i, f"outputs.{o.name}", links, expressions, key, partial(_write_output, o, measure))
    return formula_kinds(model, "outputs", values), found.formulas


def _write_output(o: Output, measure: RecordMeasure, records: Records) -> list[Value]:
    for e in o.expressions():
        records.evaluate(e)
    return [records.x.let("value", measure.write(records, o))]


class RecordFormulas:
    """Formulas over the records of links, collected one by one; those of the same form share a block.

    Parameters
    ----------
    system : System
    target, title : str
        Name and comment of the blocks.
    """

    def __init__(self, system: System, target: str, title: str):
        self.system, self.target, self.title = system, target, title
        self.by_form: dict[str, Formula] = {}
        self._slots = FormulaSlots(system.model)

    @property
    def formulas(self) -> list[Formula]:
        return list(self.by_form.values())

    def add(
        self, entry: int, place: str, links: tuple[int, ...], expressions: Sequence[Expression], key: object,
        write: Callable[[Records], Sequence[Value]],
    ) -> None:  # fmt: skip
        """Add a row that writes entries of the target, starting at `entry`. `key` and `expressions` determine its form."""
        self._slots.clear()
        canonical: dict[Expression, Tree] = {}
        for e in expressions:
            if e not in canonical:
                canonical[e] = self._slots.convert(e.tree)
        form = repr((key, [str(canonical[e]) for e in expressions]))
        if form not in self.by_form:

            def written(x: Expansion, tangents: bool) -> Sequence[Value]:
                return write(Records(x, self.system, links, canonical, tangents))

            self.by_form[form] = record_formula(written, len(self.by_form), self.target, self.title)
        self.by_form[form].rows.append(self._slots.row(entry, links))
        self.by_form[form].places.append(place)


def record_formula(write: Callable[[Expansion, bool], Sequence[Value]], index: int, target: str, title: str) -> Formula:
    """A formula that reads records of links, as yet without rows. It stores the values that `write` returns in
    consecutive entries."""
    x = Expansion(f"{target}_{index}", title, lambda a, f: True)
    for i, e in enumerate(write(x, False)):
        x.set_entry(argument(target), i, e)
    y = Expansion(f"d{target}_{index}", f"tangent of {title}", lambda a, f: True)
    values = [algebra.expression(e) for e in write(y, True)]
    stores = [*y.block.stores, *((argument(target), str(i), value) for i, value in enumerate(values))]
    differentiable = Block(target, title, dict(y.block.loads), list(y.block.statements), stores)
    seeds: dict[Symbol, Expr] = {}
    for s, (a, n) in list(y.block.loads.items()):
        if a.memory is RECORD:
            lanes = LME if n in OUTBOARD else MY_LANE
            seeds[s] = y.component(lanes if a.place is None else lanes[a.place], n)
        elif has_derivative(a):
            seeds[s] = y.component(TANGENT_OF.get(a) or seed_of(a), n)
    d = Tangents(y, seeds, {})
    for statement in list(y.block.statements):
        d.statement(statement)
    for i, value in enumerate(values):
        y.set_entry(argument(f"d{target}", lanes=True), i, d.value(value))
    name = f"{target}_of_link_{index}"
    return Formula(name, target, simplify(x.finish()), simplify(y.finish()), differentiable=differentiable)


def potential_formula(system: System) -> Formula | None:
    """Potential energy of gravity, ``-g . sum m r``, r from the ground's origin; None without gravity."""
    model = system.model
    if model.gravity is None:
        return None
    gravity = model.gravity
    slots = FormulaSlots(model)
    grounded = [(model.bodies[k], steps) for k, (link, steps) in enumerate(system.carriers) if link == GROUND and steps]

    def write(x: Expansion, tangents: bool) -> list[Value]:
        fresh = FormulaSlots(model)
        statements = Statements(x, leaf_of(x))

        def evaluate(e: Expression) -> Expr:
            return statements.write(fresh.convert(e.tree))

        g = [evaluate(e) for e in gravity]
        h: Vector = x.load(ME, fields.outboard_moment)
        if grounded:
            _, own, _ = rigid_inertia(grounded, evaluate, SYMBOLIC, x.let)
            h = [x.let("h", e) for e in add(h, own)]
        slots.slots, slots.numbers = fresh.slots, fresh.numbers
        return [x.let("value", -dot(g, h))]

    formula = record_formula(write, 0, "energy", "potential energy of gravity")
    formula.rows.append(slots.row(1, (GROUND,)))
    return formula
