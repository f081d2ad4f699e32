"""Forces along the line between two points; their laws are data, see `model.forces.line_laws`."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.binding import bind
from ...model.expressions import Expression
from ...model.forces.line_law import LineLaw, in_squares
from ...model.grammar import Tree
from ...program.scalar import Value, Vector
from ..spatial import dot, minus
from .element import Element, Law, Wrench


class AlongLineLaw(Law):
    """A law along a line: its formulas depend on the distance between the ends and on the rate of that distance."""

    def __init__(self, law: LineLaw):
        self.law = law

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        formula = bind(self.law.formula, e.absent)  # coefficients of terms that are zero are not read
        if (smooth := in_squares(formula, 1)) is not None:
            way = e.way()
            pushed: Vector = e.vector("force", [e.let("push", self._of_square(e, smooth, way)) * c for c in way])
            return Wrench([-c for c in pushed]), Wrench(pushed)
        line, length = e.line()
        known = {"distance": length}
        if e.turns_over:
            along = e.along(line, length)
            if "rate" in formula.names:
                start, end = (end.velocity for end in e.ends[:2])
                known["rate"] = e.let("rate", dot(along, minus(end, start)))
            push = self._value(e, formula, known)
            pushed = e.vector("force", [push * c for c in along])
            return Wrench([-c for c in pushed]), Wrench(pushed)
        if "rate" in formula.names:
            inverse = e.let("inverse", 1 / length)
            start, end = (end.velocity for end in e.ends[:2])
            known["rate"] = e.let("rate", dot(line, minus(end, start)) * inverse)
            push = e.let("push", self._value(e, formula, known) * inverse)
        else:
            push = e.let("push", self._value(e, formula, known) / length)
        force: Vector = e.vector("force", [push * c for c in line])
        return Wrench([-c for c in force]), Wrench(force)

    def energy(self, e: Element) -> Value:
        if self.law.potential is None:
            return super().energy(e)
        potential = bind(self.law.potential, e.absent)
        if (smooth := in_squares(potential, 0)) is not None:
            return e.let("V", self._of_square(e, smooth, e.way()))
        _, length = e.line()
        return e.let("V", self._value(e, potential, {"distance": length}))

    def _of_square(self, e: Element, formula: Expression, way: Vector) -> Value:
        return self._value(e, formula, {"square": e.let("square", dot(way, way))})

    @staticmethod
    def _value(e: Element, formula: Expression, known: dict[str, Value]) -> Value:
        def leaf(tree: Tree) -> Value:
            name: str = tree[1]
            return known[name] if name in known else e.coefficient(name)

        return e.formula(formula.tree, leaf)
