"""The constants of a model: of links, loop faces, force elements and gravity. Equal constants are computed once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import mpmath

from ...model.expressions import Expression
from ...program import algebra
from ...program.block import Expansion
from ...program.digits import are_long
from ...program.field import XYZ
from ...program.functions import SYMBOLIC
from ...program.scalar import Value
from ...program.shape import Constants, Shape
from .constants import Leaf, Slots, Statements, make_shape
from .links import Evaluate, Function, Functions, Let, NumberOf

Written = Callable[[Evaluate, Functions, Let], dict[str, Value]]
"""Type of a function that computes constants from the values of expressions, which are numbers or symbols."""


class Owner(Protocol):
    """An object with constants: a link, the faces of a loop, a force element."""

    def structure(self) -> tuple[object, ...]:
        """A key, equal for owners whose constants differ only in numbers and parameters."""

    def expressions(self) -> list[Expression]:
        """The expressions in its constants, in a fixed order."""

    def write_constants(self, evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
        """Writes the constants of this owner, and returns their values by name."""


class ModelConstants:
    """The constants of a model; equal ones are stored once.

    Attributes
    ----------
    shapes : dict of object to Shape
        By structure and expressions.
    found : list of Constants
    """

    def __init__(self, evaluate: NumberOf):
        self.evaluate = evaluate
        self.shapes: dict[object, Shape] = {}
        self.found: list[Constants] = []
        self._by_key: dict[object, Constants] = {}

    def of(self, owner: Owner, *beside: object) -> Constants:
        """The constants of an owner. Two owners share them only if their values of `beside` are equal too."""
        structure, expressions = owner.structure(), owner.expressions()
        key = (structure, beside, *map(id, expressions))
        found = self._by_key.get(key)
        if found is None:
            found = self._by_key[key] = self._make(structure, expressions, owner.write_constants)
        return found

    def of_gravity(self, g: Sequence[Expression]) -> Constants:
        """The constants of -g, minus the acceleration of gravity."""

        def written(evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
            return {f"a.{i}": let("a", -evaluate(e)) for i, e in zip(XYZ, g, strict=True)}

        return self._make(("gravity",), g, written)

    def _make(self, structure: object, expressions: Sequence[Expression], written: Written) -> Constants:
        """The constants of a set of expressions; the shape of the set is expanded unless an earlier set has the same
        shape."""
        slots = Slots()
        for e in expressions:
            slots.tree(e)
        key = (structure, tuple(slots.trees))
        shape = self.shapes.get(key)
        if shape is None:

            def write(x: Expansion, leaf: Leaf) -> dict[str, Value]:
                statements = Statements(x, leaf)
                return written(lambda e: statements.write(slots.tree(e)), SYMBOLIC, x.let)

            shape = self.shapes[key] = make_shape(len(self.shapes), slots, write)
        numeric: dict[str, float] = {}
        for name, v in written(self.evaluate, NUMERIC, keep).items():
            if name not in shape.varying and shape.fields[name] is not algebra.ZERO:
                assert isinstance(v, (int, float, mpmath.mpf))
                numeric[name] = float(v) if isinstance(v, int) else v
        self.found.append(Constants(shape, tuple(slots.parameters), tuple(slots.numbers), numeric, len(self.found)))
        return self.found[-1]


def _of_numbers(name: str) -> Function:
    def of(*values: Value) -> float:
        assert all(isinstance(value, (int, float, mpmath.mpf)) for value in values)
        found: float = getattr(mpmath if are_long() else math, name)(*values)
        return found

    return of


def _at_least(*values: Value) -> int:
    a, b = values
    assert isinstance(a, (int, float, mpmath.mpf)) and isinstance(b, (int, float, mpmath.mpf))
    return int(a >= b)


NUMERIC: Functions = {"at_least": _at_least, **{name: _of_numbers(name) for name in ("sqrt", "cos", "sin")}}
"""Functions that compute constants from numbers."""


def keep(name: str, value: Value) -> Value:
    """A `let` for numbers: it returns the value itself, since numbers need no names."""
    return value
