"""Forces along the line between two points, by laws that are data: see `model.forces.line_laws`."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.expressions import Expression
from ...model.forces import AlongLine
from ..pairs import Pair, Pairs
from .law import End, Law, Wrench, line


class AlongLineLaw(Law[AlongLine]):
    """The force f of the law along the unit vector from the start to the end acts on the end, the opposite on the start."""

    def wrenches(self, element: AlongLine, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        along, distance = line(element, pairs, ends)
        rate = pairs.dot(along, end.v - start.v)
        push = along * self._value(element.law.formula, element, pairs, {"distance": distance, "rate": rate})
        return Wrench(-push), Wrench(push)

    def energy(self, element: AlongLine, pairs: Pairs, ends: Sequence[End]) -> Pair | None:
        if element.law.potential is None:
            return None
        _, distance = line(element, pairs, ends)
        return self._value(element.law.potential, element, pairs, {"distance": distance})

    @staticmethod
    def _value(formula: Expression, element: AlongLine, pairs: Pairs, measures: dict[str, Pair]) -> Pair:
        """Of a formula, whose names are those of measures and coefficients."""
        of = {key: pairs.expression(e) for key, e in zip(element.keys, element.coefficients, strict=True)}
        return Pairs(pairs.arithmetic, pairs.k, measures | of).expression(formula)
