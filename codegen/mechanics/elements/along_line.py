"""Forces along the line between two points, by laws that are data: see `model.forces.line_laws`."""

from __future__ import annotations

import random
from collections.abc import Sequence

from ...model.binding import bind
from ...model.expressions import Expression, functions_for
from ...model.forces.line_law import LineLaw, LineLawError
from ...model.grammar import Tree
from ...program.scalar import Value, Vector
from ..spatial import dot, minus
from .element import Element, Law, Wrench

DISTANCES = (0.3, 3.0)
"""m, at which energies are compared with forces."""
POINTS = 8
"""So many distances and coefficients are tried, where both have a value."""
TRIES = 100


class AlongLineLaw(Law):
    """A law as statements: its formulas, with distance and rate of the line between the ends.

    Before the first ones are written it is checked that the force belongs to the energy.
    """

    def __init__(self, law: LineLaw):
        self.law = law
        self._checked = False

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        if not self._checked:
            check_energy(self.law)
            self._checked = True
        line, length = e.line()
        formula = bind(self.law.formula, e.absent)  # what is multiplied by zero is not asked for
        known = {"distance": length}
        if e.turns_over:
            along = e.along(line, length)
            if "rate" in formula.names:
                start, end = (end.velocity for end in e.ends[:2])
                known["rate"] = e.let("rate", dot(along, minus(end, start)))
            push = self._value(e, formula, known)
            pushed: Vector = e.vector("force", [push * c for c in along])
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
        _, length = e.line()
        return e.let("V", self._value(e, bind(self.law.potential, e.absent), {"distance": length}))

    @staticmethod
    def _value(e: Element, formula: Expression, known: dict[str, Value]) -> Value:
        def leaf(tree: Tree) -> Value:
            name: str = tree[1]
            return known[name] if name in known else e.coefficient(name)

        return e.formula(formula.tree, leaf)


def check_energy(law: LineLaw) -> None:
    """Whether the force at rest is minus the derivative of the energy by the distance, at some distances and coefficients.

    The derivative is sympy's, of the formula as it stands; nothing of blocks is in it.

    Raises
    ------
    LineLawError
    """
    if law.potential is None:
        return
    import sympy  # statements need none, and it takes longer to import than most models to generate

    functions = functions_for(sympy)
    names = {name: sympy.Symbol(name, real=True) for name in ("distance", "rate", *law.coefficients)}
    force = law.formula.evaluate({**names, "rate": sympy.Integer(0)}, functions)
    slope = -sympy.diff(law.potential.evaluate(names, functions), names["distance"])
    ranges = {"distance": DISTANCES, **{key: c.between for key, c in law.coefficients.items()}}
    drawn, compared = random.Random(0), 0
    for _ in range(TRIES):
        at = {name: round(drawn.uniform(*limits), 3) for name, limits in ranges.items()}
        values = [sympy.sympify(x).evalf(subs={names[n]: v for n, v in at.items()}) for x in (force, slope)]
        if not all(v.is_Float or v.is_Integer for v in values):
            continue
        acting, falling = map(float, values)
        if abs(acting - falling) > 1e-9 * max(abs(acting), abs(falling)):
            where = ", ".join(f"{name} = {value:g}" for name, value in at.items())
            raise LineLawError(
                f"{law.type}: at {where} the force at rest is {acting:.9g} N, but minus the derivative of its energy by the "
                f"distance is {falling:.9g} N; force {law.force!r} and energy {law.energy!r} do not belong together"
                + (
                    "; the sign of one is wrong"
                    if acting * falling < 0
                    else "; change one of them, or leave energy out"
                )
            )
        compared += 1
        if compared == POINTS:
            return
    raise LineLawError(
        f"{law.type}: force {law.force!r} and energy {law.energy!r} have values in {compared} of {TRIES} places only; "
        f"let `between` of its coefficients say where it has some"
    )
