"""Random force elements on the bodies of any model: one or two of each type, one of each law along a line."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np
from random_models import expression, vector

from codegen.model.expressions import Expression
from codegen.model.forces import ALONG_LINES, AlongLine, Bushing, Force, ForceElement, Spring, Torque, Torsion
from codegen.model.model import GROUND, Face, Model, Point, Vector

TYPES = (Spring, Force, Torque, Torsion, Bushing, *ALONG_LINES.values())


def with_random_elements(rng: np.random.Generator, model: Model, laws: Collection[str] = tuple(ALONG_LINES)) -> Model:
    """The model with additional force elements on its bodies; along lines, with the given laws only."""
    draw = _Draw(rng, model)
    makers = (draw.spring, draw.force, draw.torque, draw.torsion)
    more = [make(f"element{i}_{n}") for i, make in enumerate(makers) for n in range(int(rng.integers(1, 3)))]
    for kind, own in zip(
        ALONG_LINES.values(), rng.spawn(len(ALONG_LINES)), strict=True
    ):  # a new law changes no other draw
        if kind.type in laws:
            more.append(_Draw(own, model).along_line(f"{kind.type}_0", kind))
    more.append(_Draw(rng.spawn(1)[0], model).bushing("bushing_0"))
    assert {type(e) for e in more} == {t for t in TYPES if t not in ALONG_LINES.values() or t.type in laws}
    return dataclasses.replace(model, loads=(*model.loads, *more))


class _Draw:
    def __init__(self, rng: np.random.Generator, model: Model) -> None:
        self.rng, self.model = rng, model
        self.seen = tuple(self.point(f"seen{i}", GROUND) for i in range(3))

    def number(self, low: float, high: float) -> str:
        """An expression whose value is about between the given numbers."""
        x = round(float(self.rng.uniform(low, high)), 3)
        names = [p.name for p in self.model.parameters]
        forms = [
            f"{x}",
            f"{x}*(1 + 0.2*sin(t))",
            *(f"{x}*{n}" for n in names),
            *(f"{x}*(1 + 0.1*{n})" for n in self.model.inputs),
        ]
        return str(self.rng.choice(forms))

    def vector(self) -> Vector:
        return vector(*(round(float(x), 3) for x in self.rng.uniform(-0.7, 0.7, 3)))

    def body(self, least: int = 0) -> int:
        return int(self.rng.integers(least, len(self.model.bodies)))

    def point(self, name: str = "", least: int = 0) -> Point:
        return Point(name, self.body(least), self.vector())

    def points(self) -> tuple[Point, Point]:
        """Points of different bodies, or of a body and the ground."""
        first, second = (int(x) for x in self.rng.choice(np.arange(GROUND, len(self.model.bodies)), 2, replace=False))
        return Point("", first, self.vector()), Point("", second, self.vector())

    def moving(self) -> str:
        """An expression of all quantities that forces may contain."""
        rng = self.rng
        seen = str(
            rng.choice([f"{what}.{p.name}.{c}" for what in ("position", "velocity") for p in self.seen for c in "xyz"])
        )
        other = str(rng.choice([f"position.{p.name}.{c}" for p in self.seen for c in "xyz"]))
        u = f"u.{rng.choice(self.model.speed_names)}" if self.model.nu else "t"
        c = self.number(-2, 2)
        forms = [c, f"{c}*{seen}", f"{c} - {seen}*{other}", f"{c}*{seen}**3 + {u}", f"{c}*sin({seen})/(2 + {other}**2)",
                 f"{c}*tanh({u}) - sqrt(1 + {seen}**2)", f"{c}*exp(-{other}**2)*{seen}", f"atan2({seen}, 2 + {c}**2)", "0",
                 f"{c}*{u}"]  # fmt: skip
        return forms[int(rng.integers(len(forms)))]

    def looked_at(self, *expressions: Expression) -> tuple[Point, ...]:
        names = {n.split(".")[1] for e in expressions for n in e.names if n.startswith(("position.", "velocity."))}
        return tuple(p for p in self.seen if p.name in names)

    # --- types ----------------------------------------------------------------------------------------------------

    def spring(self, name: str) -> ForceElement:
        damping = self.number(0, 1) if self.rng.random() < 0.7 else "0"
        return Spring(name, *self.points(), *map(expression, (self.number(1, 9), damping, self.number(0.2, 1))))

    def _components(self) -> tuple[Expression, Expression, Expression]:
        a, b, c = (expression(self.moving()) for _ in range(3))
        return a, b, c

    def force(self, name: str) -> ForceElement:
        value, axes = self._components(), str(self.rng.choice(["ground", "body"]))
        return Force(name, self.point(), value, axes, measured=self.looked_at(*value))

    def torque(self, name: str) -> ForceElement:
        value, axes = self._components(), str(self.rng.choice(["ground", "body"]))
        return Torque(name, self.point(), value, axes, measured=self.looked_at(*value))

    def torsion(self, name: str) -> ForceElement:
        faces = []
        for point in self.points():
            angle = str(self.rng.choice(["0.4", *(f"0.4*{p.name}" for p in self.model.parameters)]))
            turned = ((self.vector(), expression(angle)),)
            faces.append(Face(point.body, point.at, turned if self.rng.random() < 0.5 else ()))
        exact = [(1, 0, 0), (0, 1, 0), (0, 0, -1)]
        axis = vector(*exact[int(self.rng.integers(3))]) if self.rng.random() < 0.5 else self.vector()
        numbers = (expression(self.number(*limits)) for limits in ((1, 9), (0, 1), (-1, 1)))
        return Torsion(name, faces[0], faces[1], axis, *numbers)

    def bushing(self, name: str) -> ForceElement:
        """A bushing of soft springs; a third of its rows are left out."""
        faces = []
        for point in self.points():
            angle = str(self.rng.choice(["0.4", *(f"0.4*{p.name}" for p in self.model.parameters)]))
            turned = ((self.vector(), expression(angle)),)
            faces.append(Face(point.body, point.at, turned if self.rng.random() < 0.5 else ()))
        values = []
        for limits in ((1, 9), (0, 1), (-1, 1)) * 2:
            a, b, c = (expression(self.number(*limits) if self.rng.random() < 0.7 else "0") for _ in range(3))
            values.append((a, b, c))
        return Bushing(name, faces[0], faces[1], tuple(values))

    def along_line(self, name: str, kind: type[AlongLine]) -> AlongLine:
        """Coefficients of ordinary size; for a law without energy they depend on the motion."""
        values = []
        for c in kind.law.coefficients.values():
            if c.default is not None and self.rng.random() < 0.3:
                values.append(Expression.number(c.default))
                continue
            number = self.number(*c.between)
            values.append(expression(number if kind.has_energy else f"{number}*(1 + 0.2*tanh({self.moving()}))"))
        return kind(name, *self.points(), tuple(values), measured=self.looked_at(*values))
