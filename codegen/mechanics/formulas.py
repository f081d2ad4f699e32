"""Formulas of the model: expressions over coordinates, speeds, parameters, inputs and time, such as joint forces.

Formulas of the same form share one block; the coordinates and numbers that each reads are data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from ..model.errors import ModelError
from ..model.expressions import Expression
from ..model.grammar import ExpressionError, Tree
from ..model.model import Model
from ..model.rates import rate
from ..model.slopes import has_quotient, is_singular, leaves, slope
from ..model.switches import MODE
from ..program import algebra
from ..program.algebra import Expr
from ..program.block import Block, Expansion
from ..program.derivatives import Tangents
from ..program.formula import Formula, Row
from ..program.functions import Along
from ..program.passes import simplify
from ..program.store import MODES, NUMBER, Store, argument
from .structure.constants import Leaf, Statements, to_slots
from .structure.system import System, speeds_with_forces

MOST_OPERANDS = 24
"""Largest number of operands of a formula whose second derivatives are written one by one."""


def has_derivative(store: Store) -> bool:
    """Whether a store of formulas has tangents; numbers and modes of switches have none."""
    return store is not NUMBER and store.name != MODES.name


def seed_of(store: Store) -> Store:
    """The store of the seeds that belong to an argument's store."""
    return argument(f"d{store.name}", lanes=True)


class FormulaSlots:
    """Numbered slots for the names and numbers of a formula."""

    def __init__(self, model: Model):
        self.slots: dict[tuple[str, int], int] = {}
        self.numbers: list[float] = []
        self._places: dict[str, tuple[str, int]] = {}
        for category, names in (
            ("q", [f"q.{n}" for n in model.coordinate_names]),
            ("u", [f"u.{n}" for n in model.speed_names]),
            ("p", list(model.parameter_names)),
            ("inputs", list(model.inputs)),
            ("t", ["t"]),
        ):
            for i, name in enumerate(names):
                self._places[name] = (category, i)

    def clear(self) -> None:
        """Empties the slots and numbers for the next formula."""
        self.slots, self.numbers = {}, []

    def convert(self, tree: Tree) -> Tree:
        """The tree with slots for its numbers and names."""
        return to_slots(tree, self.numbers, self._slot)

    def row(self, index: int, links: tuple[int, ...]) -> Row:
        """The row of a formula that writes an entry of its target, with the slots and numbers found since the last
        `clear`."""
        return index, links, [i for _, i in self.slots], list(self.numbers)

    def _slot(self, name: str) -> Tree:
        place = ("modes", int(name.removeprefix(MODE))) if name.startswith(MODE) else self._places[name]
        return ("name", place[0], self.slots.setdefault(place, len(self.slots)))


def formula_kinds(
    model: Model, target: str, formulas: Sequence[tuple[int, Tree]], places: Mapping[int, str] | None = None
) -> list[Formula]:
    """Blocks for formulas: one for each form.

    Parameters
    ----------
    formulas : sequence of (index, tree)
        Target index and expression tree.
    places : mapping of int to str, optional
        Paths in the model file by target index, for messages.
    """
    forms: dict[Tree, tuple[Tree, list[Row]]] = {}
    template = FormulaSlots(model)
    for index, tree in formulas:
        template.clear()
        canonical = template.convert(tree)
        _, rows = forms.setdefault(canonical, (tree, []))
        rows.append(template.row(index, ()))
    kinds: list[Formula] = []
    for canonical, (tree, rows) in forms.items():
        # numbers that all formulas share become literals
        literal = {j: row for j, row in enumerate(rows[0][3]) if all(r[3][j] == row for r in rows)}
        where = [places[i] if places else _place(model, target, i) for i, *_ in rows]
        try:
            kind = _make(len(kinds), target, _with_numbers(canonical, literal))
        except ExpressionError:  # the derivative contains a number that is not finite
            raise _without_value(model, where[0], tree) from None
        kind.rows.extend(rows)
        kind.places += where
        if not (has_values(kind.value) and has_values(kind.tangent)):
            raise _without_value(model, where[0], tree)
        kinds.append(kind)
    return kinds


def _without_value(model: Model, place: str, tree: Tree) -> ModelError:
    message = (
        f"{Expression(tree)} has no value or no derivative (a division by zero? an overflow?) for any state; "
        f"change the expression"
    )
    return ModelError([model.problem(place, message)])


def _with_numbers(tree: Tree, literal: dict[int, float]) -> Tree:
    """A tree in which some numbered slots are replaced by numbers."""
    if tree[0] == "slot":
        return ("number", literal[tree[1]]) if tree[1] in literal else tree
    return tuple(_with_numbers(part, literal) if isinstance(part, tuple) else part for part in tree)


def _place(model: Model, target: str, index: int) -> str:
    """Path in the model file of the formula with a target index."""
    if target == "outputs":
        return f"outputs.{model.outputs[index].name}.value"
    if target == "held_force":
        body = model.prescribed[index].body
        return next(f"forces.{f.name}.value" for f in model.forces if f.body == body)
    if target != "tau":
        names = model.coordinate_names if target == "initial_q" else model.speed_names
        return f"initial.{target[-1]}.{names[index]}"
    bodies = {k for k, (_, u) in enumerate(model.coordinate_slices) if u.start <= index < u.stop}
    return next(f"forces.{f.name}.value" for f in model.forces if f.body in bodies)


def has_values(block: Block) -> bool:
    """Whether all numbers in a block are real and finite."""
    expressions = [*(s.expression for s in block.statements), *(e for *_, e in block.stores)]
    return all(n.is_finite for e in expressions for n in algebra.numbers_of(e))


def leaf_of(x: Expansion) -> Leaf:
    """The function that returns the symbols of a formula's numbered slots and names."""
    return lambda node: x.entry(*((NUMBER, node[1]) if node[0] == "slot" else (argument(node[1]), node[2])))


def _make(index: int, target: str, tree: Tree) -> Formula:
    def expansion(name: str, title: str) -> tuple[Expansion, Statements]:
        x = Expansion(f"{name}_{index}", title, lambda a, f: True)
        return x, Statements(x, leaf_of(x))

    x, written = expansion(target, "a formula of the model")
    x.set_entry(argument(target), 0, x.let(target, written.write(tree)))
    y, written = expansion(f"d{target}", "tangent of a formula of the model")
    of_value = slopes_of(tree, target == "outputs")
    if of_value is None:
        value = y.let(target, written.write(tree))
        seeds = {
            s: y.component(seed_of(store), n) for s, (store, n) in list(y.block.loads.items()) if has_derivative(store)
        }
        statements = list(y.block.statements)
        d = Tangents(y, seeds, {})
        for s in statements:
            d.statement(s)
        along = d.value(value)
    else:
        terms = [
            Along(y.entry(seed_of(argument(leaf[1])), leaf[2]), y.let("d", written.write(slope), "primitive"))
            for leaf, slope in of_value
        ]
        along = y.let("d", algebra.add(*terms), "", lanes=True)
    y.set_entry(argument(f"d{target}", lanes=True), 0, along)
    made = Formula(f"{target}_{index}", target, simplify(x.finish()), simplify(y.finish()))
    made.curvature = partial(curvature_of, made, tree)
    return made


def curvature_of(formula: Formula, tree: Tree) -> Block | None:
    """The block of `Formula.twice` from second derivatives of a tree, if these may be infinite; otherwise None.

    A direction in which an operand does not change gets no contribution from derivatives with respect to this operand.
    """
    found = [leaf for leaf in leaves(tree) if leaf[1] != MODES.name]
    slopes = [(leaf, slope(tree, leaf)) for leaf in found]
    if len(found) > MOST_OPERANDS or not (is_singular(tree) or any(is_singular(d) for _, d in slopes)):
        return None
    x = Expansion(
        f"{formula.tangent.name}_twice", f"tangent of the adjoint of {formula.value.title}", lambda a, f: True
    )
    written = Statements(x, leaf_of(x))
    bar = x.entry(argument(f"{formula.target}_bar"), 0)
    along = x.entry(argument(f"d{formula.target}_bar", lanes=True), 0)
    for leaf, first in slopes:
        terms: list[Expr] = []
        if first != ("number", 0):
            terms.append(Along(along, x.let("d", written.write(first), "primitive")))
        for other in found:
            second = slope(first, other)
            if second != ("number", 0):
                seed = x.entry(seed_of(argument(other[1])), other[2])
                terms.append(Along(seed, x.let("d", bar * written.write(second), "primitive")))
        if terms:
            x.set_entry(argument(f"dg{leaf[1]}", lanes=True).sum, leaf[2], x.let("d", algebra.add(*terms), lanes=True))
    return x.finish()


def slopes_of(tree: Tree, optional: bool = False) -> list[tuple[Tree, Tree]] | None:
    """The derivatives of a tree with respect to its leaves, if they may be infinite; otherwise None.

    `optional`: the derivative may not be needed, so quotients with a varying divisor count as well.
    """
    found = [leaf for leaf in leaves(tree) if leaf[1] != MODES.name]
    moving = frozenset(leaf for leaf in found if leaf[1] != "p")
    if not (is_singular(tree) or (optional and has_quotient(tree, moving))):
        return None
    slopes = [(leaf, slope(tree, leaf)) for leaf in found]
    return [(leaf, d) for leaf, d in slopes if d != ("number", 0)]


def force_formulas(system: System) -> list[Formula]:
    """Joint forces, summed for each degree of freedom; the target index is the index of its speed."""
    trees: dict[int, Tree] = {}
    hold = system.model.switches.hold
    for forces in system.force_of.values():
        for f in forces:
            for i, value in speeds_with_forces(system.model, f):
                tree = hold(value.tree)
                trees[i] = ("+", trees[i], tree) if i in trees else tree
    on_speeds = [(i, tree) for i, tree in sorted(trees.items()) if i >= 0]
    held = [(-1 - i, tree) for i, tree in sorted(trees.items()) if i < 0]
    return formula_kinds(system.model, "tau", on_speeds) + formula_kinds(system.model, "held_force", held)


def motion_formulas(model: Model) -> list[Formula]:
    """Prescribed coordinates, their rates and accelerations, as functions of time, parameters and inputs."""
    found: list[tuple[int, Tree]] = []
    places: dict[int, str] = {}
    moving = frozenset(model.moving_inputs)
    for n, x in enumerate(model.prescribed):
        values, held = x.values, Expression(model.switches.hold(x.value.tree, moves=True))
        if held is not x.value:  # modes hold the branches of switches during an integration step
            values = held, rate(held, moving=moving), rate(rate(held, moving=moving), moving=moving)
        for order, e in enumerate(values):
            if e.tree != ("number", 0):
                found.append((3 * n + order, e.tree))
                places[3 * n + order] = f"motion.{x.name}"
    return formula_kinds(model, "prescribed", found, places)


def coefficient_formulas(system: System) -> list[Formula]:
    """Coefficients of force elements (`PlacedElement.parts`): those of elements with an energy, and those of elements
    without."""
    found: list[Formula] = []
    for target, has_energy in (("coefficient", True), ("drive", False)):
        of = [
            (e.first + j, tree, f"forces.{e.element.name}.{key}")
            for e in system.elements
            if e.element.has_energy == has_energy
            for j, (key, tree) in enumerate(e.parts)
        ]
        found += formula_kinds(system.model, target, [(i, tree) for i, tree, _ in of], {i: place for i, _, place in of})
    return found


def initial_formulas(model: Model) -> list[Formula]:
    """Initial values of all coordinates and speeds in the model file; none if no parameter changes them."""
    if not model.initial_depends_on_parameters:
        return []
    q = [
        (i, model.initial_q.get(n, Expression(("number", int(n.endswith(".qw"))))).tree)
        for i, n in enumerate(model.coordinate_names)
    ]
    u = [(i, model.initial_u.get(n, Expression(("number", 0))).tree) for i, n in enumerate(model.speed_names)]
    return formula_kinds(model, "initial_q", q) + formula_kinds(model, "initial_u", u)
