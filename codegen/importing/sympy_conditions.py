"""Holonomic sympy constraints as couplings and loops of a model.

A linear constraint becomes a coupling. A constraint that holds a point of a body in a plane of the ground becomes a
loop of this kind. Any other constraint becomes a surface for a point whose coordinates are the variables of the
constraint. Massless bodies on prismatic joints carry this point, and couplings relate the joints to the variables.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from .naming import free_name
from .sympy_closures import closure_of
from .sympy_system import GROUND, SympySystem, Trouble, moves

_LETTERS: Final = "xyz"


def read_conditions(found: SympySystem, constraints: Iterable[Any], dependent: Iterable[Any]) -> None:
    """Fill the sections ``couplings`` and ``loops``.

    Parameters
    ----------
    found : SympySystem
    constraints : iterable of sympy.Expr
        Expressions that are zero when the constraints hold.
    dependent : iterable of sympy.Function
        Coordinates that the system declares dependent.
    """
    reader = _Conditions(found, list(dependent))
    for number, constraint in enumerate(constraints, 1):
        try:
            reader.read(f"constraint_{number}", constraint)
        except Trouble as error:
            found.report(f"holonomic_constraints[{number - 1}]", str(error))
    reader.write_closures()


class _Conditions:
    def __init__(self, found: SympySystem, dependent: list[Any]) -> None:
        self.found = found
        self.dependent = dependent
        self.following: list[Any] = []
        self.points: dict[tuple[Any, ...], str] = {}
        self.closures: dict[tuple[str, ...], list[tuple[str, str]]] = {}

    def read(self, name: str, constraint: Any) -> None:
        """Convert one constraint."""
        import sympy
        from sympy.core.function import AppliedUndef

        if constraint.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
            raise Trouble(f"{constraint} has a constant that is not a finite real number; only these are allowed")
        used = [q for q in self.found.scalars if constraint.has(q)]
        others = constraint.atoms(AppliedUndef) - set(used)
        if others or moves(constraint.subs(dict.fromkeys(used, 1))):
            raise Trouble(
                f"{constraint} depends on time or on other functions than coordinates; coordinates and parameters are allowed"
            )
        if not used:
            raise Trouble(f"{constraint} contains no coordinate of a joint; one is needed")
        if (line := self.line(constraint, used)) is not None:
            return self.linear(name, *line)
        if (closure := closure_of(self.found, constraint, used)) is not None:
            letters = self.letters()
            e = sum((n * x for n, x in zip(closure.normal, letters, strict=True)), closure.offset)
            place = (closure.body, *map(self.found.text, closure.point))
            self.closures.setdefault(place, []).append((name, self.found.text(e)))
            return self.forget(letters)
        if len(used) <= len(_LETTERS):
            return self.surface(name, constraint, used)
        return self.sum(name, constraint, used)

    def line(self, e: Any, used: Sequence[Any]) -> tuple[dict[Any, Any], Any] | None:
        """Coefficients of the coordinates, and the constant term; None if the expression is not linear in the
        coordinates."""
        factors = {q: e.diff(q).expand() for q in used}
        if any(_changes(c, used) for c in factors.values()):
            return None
        if any(map(moves, factors.values())):
            factors = {q: c.simplify() for q, c in factors.items()}
        if any(map(moves, factors.values())):
            return None
        return factors, e.subs(dict.fromkeys(used, 0))

    def linear(self, name: str, factors: dict[Any, Any], rest: Any) -> None:
        """Add a coupling; a constraint on a single coordinate becomes a prescribed constant."""
        free = [q for q in factors if factors[q] != 0 and q not in self.following]
        chosen = [q for q in free if q in self.dependent] or free
        if not chosen:
            raise Trouble("other constraints already determine every coordinate of this constraint; remove one of them")
        last = chosen[-1]
        self.following.append(last)
        text = self.found.text
        ratios = {self.name(q): text(-c / factors[last]) for q, c in factors.items() if q != last and c != 0}
        if not ratios:
            self.found.sections.setdefault("motion", {})[self.name(last)] = text(-rest / factors[last])
            return
        entry = {"joint": self.name(last), "follows": ratios}
        if rest != 0:
            entry["offset"] = text(-rest / factors[last])
        self.found.sections.setdefault("couplings", {})[name] = entry

    def name(self, q: Any) -> str:
        """The name of a coordinate in the model."""
        return self.found.scalars[q][0]

    def surface(self, name: str, e: Any, variables: Sequence[Any]) -> None:
        """Add the condition that an expression of up to three variables, each linear in coordinates, is zero."""
        letters = self.letters()
        equation = self.found.text(
            e.subs(dict(zip(variables, letters[: len(variables)], strict=True)), simultaneous=True)
        )
        self.forget(letters)
        joint = {"type": "surface", "equation": equation}
        self.found.sections.setdefault("loops", {})[name] = {
            "joint": joint,
            "from": GROUND,
            "to": self.point(variables),
        }

    def letters(self) -> list[Any]:
        """New symbols for the coordinates x, y and z of a point."""
        import sympy

        found = list(sympy.symbols(" ".join(_LETTERS), cls=sympy.Dummy))
        self.found.symbols |= dict(zip(found, _LETTERS, strict=True))
        return found

    def forget(self, letters: list[Any]) -> None:
        """Remove the symbols that stand for a point's coordinates."""
        for letter in letters:
            del self.found.symbols[letter]

    def write_closures(self) -> None:
        """Add the loops: two planes through a point make a curve, one plane makes a surface."""
        loops = self.found.sections.setdefault("loops", {})
        for (body, *at), planes in self.closures.items():
            to = body if at == ["0"] * 3 else {"body": body, "at": at}
            for k in range(0, len(planes), 2):
                names, equations = zip(*planes[k : k + 2], strict=True)
                joint: dict[str, Any] = {"type": "surface", "equation": equations[0]}
                if len(equations) == 2:
                    joint = {"type": "curve", "equations": list(equations)}
                loops[names[0]] = {"joint": joint, "from": GROUND, "to": to}

    def point(self, variables: Sequence[Any]) -> str:
        """The body at the point whose coordinates are the variables; the body is added if it is new."""
        key = tuple(variables)
        if key not in self.points:
            bodies = self.found.sections["bodies"]
            above = GROUND
            for letter, variable in zip(_LETTERS, variables, strict=False):
                own = free_name(f"condition_{len(self.points) + 1}_{letter}", bodies)
                bodies[own] = {"parent": above, "joint": {"type": "prismatic", "axis": letter}}
                self.follow(own, variable)
                above = own
            self.points[key] = above
        return self.points[key]

    def follow(self, own: str, variable: Any) -> None:
        """Add a coupling by which a new body's coordinate equals a linear expression of other coordinates."""
        line = self.line(variable, [q for q in self.found.scalars if variable.has(q)])
        if line is None or not line[0]:
            return
        entry = {"joint": own, "follows": {self.name(q): self.found.text(c) for q, c in line[0].items()}}
        if line[1] != 0:
            entry["offset"] = self.found.text(line[1])
        self.found.sections.setdefault("couplings", {})[f"{own}_follows"] = entry

    def sum(self, name: str, e: Any, used: Sequence[Any]) -> None:
        """Add a sum of terms of up to two variables: each term becomes a new coordinate, and a coupling makes the sum zero."""
        import sympy
        from sympy.simplify.fu import TR8

        parts: dict[tuple[Any, ...], Any] = {}
        for term in sympy.Add.make_args(sympy.expand(TR8(sympy.expand(e)))):
            variables = self.variables(term)
            if len(variables) >= len(_LETTERS):
                allowed = f"a constraint of more than {len(_LETTERS)} coordinates must be a sum of terms of two angles or lengths"
                raise Trouble(f"{term} has {len(variables)} variables; {allowed}")
            parts[variables] = parts.get(variables, 0) + term
        linear = sum((p for v, p in parts.items() if not v or self.line(p, list(used)) is not None), sympy.Integer(0))
        factors, rest = self.line(linear, list(used)) or ({}, linear)
        factors = {q: c for q, c in factors.items() if c != 0}
        for number, (variables, part) in enumerate(parts.items(), 1):
            if not variables or self.line(part, list(used)) is not None:
                continue
            term = sympy.Function(f"{name}_{number}")(sympy.Symbol("t"))
            self.surface(f"{name}_{number}", part - term, (*variables, term))
            self.found.scalars[term] = self.points[(*variables, term)], None
            factors[term] = sympy.Integer(1)
        self.linear(name, factors, rest)

    def variables(self, term: Any) -> tuple[Any, ...]:
        """The variables of a term: the angles in its sines and cosines, then its other coordinates."""
        import sympy

        angles = [f for f in term.atoms(sympy.sin, sympy.cos) if moves(f) and self._is_linear(f.args[0])]
        names = {f.args[0]: None for f in sorted(angles, key=sympy.default_sort_key)}
        bare = term.subs(dict.fromkeys(angles, 1))
        return (*names, *(q for q in self.found.scalars if bare.has(q)))

    def _is_linear(self, e: Any) -> bool:
        return self.line(e, [q for q in self.found.scalars if e.has(q)]) is not None


def _changes(e: Any, used: Sequence[Any]) -> bool:
    """Whether an expression changes with some coordinates, tested with numbers, which is faster than simplifying it."""
    if not moves(e):
        return False
    free = {x: (k + 2) / 7 for k, x in enumerate(sorted(e.free_symbols, key=str))}
    values = [
        complex(e.subs({q: (k + 1) / 10 + step for k, q in enumerate(used)}).subs(free)) for step in (0.1, 0.23, 0.57)
    ]
    return bool(max(abs(v - values[0]) for v in values) > 1e-9 * (1 + abs(values[0])))
