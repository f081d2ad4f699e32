"""Outputs and potential energy: formulas over what the sweeps leave in the records of links.

A point of a link is at ``pos + W r`` and moves at ``W (v + omega x r)`` in the ground frame. Outputs of the same form share a
block, like formulas; the link is data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import sympy
from sympy import Expr, Symbol

from ...model.expressions import Expression, Tree
from ...model.model import GROUND, Output
from ...program.block import Block, Expansion
from ...program.derivatives import Tangents
from ...program.functions import SYMBOLIC
from ...program.passes import simplify
from ...program.scalar import Vector
from .. import fields
from ..formulas import FormulaKind, FormulaSlots, formula_kinds, seed_of, transpose_of_tangent
from ..spatial import add, cross, dot, matvec, transpose
from ..stores import LME, ME, MY_LANE, NUMBER, argument
from ..structure.constants import Statements
from ..structure.kinds import System
from ..structure.links import BODY_FRAME, Frame, Placement, frame_matrix, identity, place, rigid_inertia, unit


@dataclass(eq=False)
class RecordFormula:
    """Formulas of one form over the record of a link.

    Attributes
    ----------
    value, tangent : Block
        From the record of the link, its lanes (its tangent), the ground's slot, parameters and numbers.
    rows : list of (int, int, list of int, list of float)
        Target index, link, parameter indices, numbers.
    """

    index: int
    target: str
    value: Block
    tangent: Block
    slots: list[tuple[str, int]]
    rows: list[tuple[int, int, list[int], list[float]]] = field(default_factory=list)

    @cached_property
    def transposed(self) -> Block:
        return transpose_of_tangent(self.tangent)


def output_formulas(system: System) -> tuple[list[FormulaKind], list[RecordFormula]]:
    """Outputs as value formulas and record formulas; those that are energies are copied by the procedures."""
    model = system.model
    values = [(i, o.expression.tree) for i, o in enumerate(model.outputs) if o.measure == "value" and o.expression]
    kinds: dict[object, RecordFormula] = {}
    for i, o in enumerate(model.outputs):
        if o.measure not in ("position", "velocity"):
            continue
        assert o.point is not None and o.axis is not None
        link, steps = (GROUND, ()) if o.point.body == GROUND else system.carriers[o.point.body]
        frame = BODY_FRAME if link == GROUND else system.links[link].frame
        slots = FormulaSlots(model)
        canonical: dict[Expression, Tree] = {}
        for e in _expressions(o, steps, frame):
            if e not in canonical:
                canonical[e] = slots.convert(e.tree)
        form = tuple(str(canonical[e]) for e in _expressions(o, steps, frame))
        pattern = () if link == GROUND else system.kind_of[link].index
        key = (o.measure, pattern, form, tuple(len(r) for _, r in steps), frame.index, frame.flipped, frame.start)
        kind = kinds.get(key)
        if kind is None:
            kind = kinds[key] = _make(len(kinds), o, link, steps, frame, slots, canonical)
        kind.rows.append((i, link, [j for _, j in slots.slots], list(slots.numbers)))
    return formula_kinds(model, "outputs", values), list(kinds.values())


def _expressions(o: Output, steps: tuple[Placement, ...], frame: Frame) -> list[Expression]:
    """The expressions of a point and an axis, in a fixed order."""
    assert o.point is not None and o.axis is not None
    found = [*o.point.at, *o.axis, *(frame.vector or ())]
    for at, rotation in steps:
        found += at
        for axis, angle in rotation:
            found += [*axis, angle]
    return found


def _make(
    index: int,
    o: Output,
    link: int,
    steps: tuple[Placement, ...],
    frame: Frame,
    slots: FormulaSlots,
    canonical: dict[Expression, Tree],
) -> RecordFormula:
    assert o.point is not None and o.axis is not None
    point, direction = o.point, o.axis

    def write(x: Expansion) -> Expr:
        def leaf(node: Tree) -> Expr:
            return x.entry(NUMBER, node[1]) if node[0] == "slot" else x.entry(argument(node[1]), node[2])

        statements = Statements(x, leaf)

        def evaluate(e: Expression) -> Expr:
            return statements.write(canonical[e])

        r = [evaluate(e) for e in point.at]
        axis = [evaluate(e) for e in direction]
        if any(a.free_symbols for a in map(sympy.sympify, axis)) or sum(abs(a) for a in axis) != 1:
            axis = unit(axis, SYMBOLIC["sqrt"], x.let)
        if steps:
            origin, R = place(steps, evaluate, SYMBOLIC, x.let)
            r = [x.let("r", e) for e in add(origin, matvec(R, r))]
        if frame.vector is not None:
            r = [x.let("r", e) for e in matvec(transpose(frame_matrix(frame, evaluate, SYMBOLIC["sqrt"], x.let)), r)]
        W = x.load(ME, fields.attitude) if link != GROUND else identity()
        if o.measure == "position":
            moved = [x.let("x", e) for e in matvec(W, r)]
            position: Vector = x.load(ME, fields.position) if link != GROUND else [0, 0, 0]
            return x.let("value", dot(axis, add(position, moved)))
        if link == GROUND:
            return sympy.S.Zero
        v = x.load(ME, fields.velocity)
        w = x.load(ME, fields.angular_velocity)
        moved = [x.let("v", e) for e in add(v, cross(w, r))]
        return x.let("value", dot(axis, [x.let("x", e) for e in matvec(W, moved)]))

    value, tangent = _both(write, index, "outputs", "an output of the model")
    return RecordFormula(index, "outputs", value, tangent, [(c, j) for j, (c, _) in enumerate(slots.slots)])


def _both(write: Callable[[Expansion], Expr], index: int, target: str, title: str) -> tuple[Block, Block]:
    """The block of a value and that of its tangent."""
    x = Expansion(f"{target}_{index}", title, lambda a, f: True)
    x.set_entry(argument(target), 0, write(x))
    y = Expansion(f"d{target}_{index}", f"tangent of {title}", lambda a, f: True)
    value = sympy.sympify(write(y))
    seeds: dict[Symbol, Expr] = {}
    for s, (a, n) in list(y.block.loads.items()):
        if a is ME:
            seeds[s] = y.component(LME if n.startswith("sum.") else MY_LANE, n)
        elif a is not NUMBER:
            seeds[s] = y.component(seed_of(a), n)
    d = Tangents(y, seeds, {})
    for s in list(y.block.statements):
        d.statement(s)
    y.set_entry(argument(f"d{target}", lanes=True), 0, d.value(value))
    return simplify(x.finish()), simplify(y.finish())


def potential_formula(system: System) -> RecordFormula | None:
    """Potential energy of gravity, zero at the ground's origin: ``-g . sum m r``. None without gravity."""
    model = system.model
    if model.gravity is None:
        return None
    gravity = model.gravity
    slots = FormulaSlots(model)
    grounded = [(model.bodies[k], steps) for k, (link, steps) in enumerate(system.carriers) if link == GROUND and steps]

    def write(x: Expansion) -> Expr:
        fresh = FormulaSlots(model)

        def leaf(node: Tree) -> Expr:
            return x.entry(NUMBER, node[1]) if node[0] == "slot" else x.entry(argument(node[1]), node[2])

        statements = Statements(x, leaf)

        def evaluate(e: Expression) -> Expr:
            return statements.write(fresh.convert(e.tree))

        g = [evaluate(e) for e in gravity]
        h: Vector = x.load(ME, fields.outboard_moment)
        if grounded:
            _, own, _ = rigid_inertia(grounded, evaluate, SYMBOLIC, x.let)
            h = [x.let("h", e) for e in add(h, own)]
        slots.slots, slots.numbers = fresh.slots, fresh.numbers
        return x.let("value", -dot(g, h))

    value, tangent = _both(write, 0, "energy", "potential energy of gravity")
    formula = RecordFormula(0, "energy", value, tangent, [(c, j) for j, (c, _) in enumerate(slots.slots)])
    formula.rows.append((1, GROUND, [j for _, j in slots.slots], list(slots.numbers)))
    return formula
