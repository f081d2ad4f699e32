"""Constants of links and the statements that compute them: zeros, numbers, and functions of design parameters.

Links whose constants come from expressions of the same form share a *shape*. This is a block that computes, from the link's
parameters and numbers, the constants that depend on parameters and the derivatives of these constants.
"""

from __future__ import annotations

from collections.abc import Callable

import mpmath

from ...model.expressions import FLOAT_FUNCTIONS, Expression, functions_for
from ...model.grammar import CHOICE, VANISHING, Tree
from ...model.trees import mapped
from ...program import algebra
from ...program.algebra import Expr, Number, Symbol
from ...program.block import Expansion, Scope
from ...program.derivatives import Tangents
from ...program.digits import are_long, number, value_of
from ...program.functions import SYMBOLIC, Power, computed
from ...program.passes import simplify
from ...program.scalar import Value
from ...program.shape import Shape
from ...program.store import NUMBER, SHAPE
from ..stores import PARAMETER

_LARGE = 100

Leaf = Callable[[Tree], Expr]
"""A function that returns the symbol of a name or of a numbered slot."""


class Slots:
    """Replaces parameters and numbers by numbered slots, so that expressions of the same form give the same tree."""

    def __init__(self) -> None:
        self.parameters: list[str] = []
        self.numbers: list[float] = []
        self.trees: list[Tree] = []
        self._made: dict[Expression, Tree] = {}

    def tree(self, expression: Expression) -> Tree:
        made = self._made.get(expression)
        if made is None:
            made = self._made[expression] = to_slots(expression.tree, self.numbers, self._slot)
        self.trees.append(made)
        return made

    def _slot(self, name: str) -> Tree:
        if name not in self.parameters:
            self.parameters.append(name)
        return ("parameter", self.parameters.index(name))


def split(
    tree: Tree, is_part: Callable[[Tree], bool], part: Callable[[Tree], Tree], name: Callable[[Tree], Tree]
) -> Tree:
    """A tree whose largest subtrees that satisfy `is_part` are replaced by `part`, and its other names by `name`.

    The numbers 0, 1, -1 and 2, and exponents, remain: they determine the structure.
    """
    if tree[0] == "number" and tree[1] in (0, 1, -1, 2):
        return tree
    if is_part(tree):
        return part(tree)
    if tree[0] == "name":
        return name(tree)
    if tree[0] == "**" and tree[2][0] == "number":
        return ("**", split(tree[1], is_part, part, name), tree[2])
    return mapped(tree, lambda inner: split(inner, is_part, part, name))


def to_slots(tree: Tree, numbers: list[float], slot: Callable[[str], Tree]) -> Tree:
    """A tree with numbered slots in place of its names and numbers; the numbers are appended to `numbers`. See
    `split`."""

    def numbered(part: Tree) -> Tree:
        numbers.append(float(part[1]))
        return ("slot", len(numbers) - 1)

    return split(tree, lambda part: part[0] == "number", numbered, lambda name: slot(name[1]))


class Statements:
    """Writes an expression tree as statements; intermediate values get names, so that no expression becomes long.

    `tag` is the equation number in the comments of the statements.
    """

    def __init__(self, x: Expansion, leaf: Leaf, tag: str = ""):
        self.x = x
        self.leaf = leaf
        self.tag = tag

    def write(self, tree: Tree) -> Expr:
        kind = tree[0]
        if kind == "number":
            return number(tree[1])
        if kind in ("name", "slot", "parameter"):
            return self.leaf(tree)
        if kind == "call":
            arguments = [self.named(a) for a in tree[2:]]
            numbers = [a for a in arguments if isinstance(a, Number)]
            if len(numbers) == len(arguments) and not all(-_LARGE < float(a) < _LARGE for a in numbers):
                functions = functions_for(mpmath) if are_long() else FLOAT_FUNCTIONS
                return computed(lambda: functions[tree[1]](*map(value_of, arguments)))
            if tree[1] in (CHOICE, VANISHING):
                arguments[0] = self.let(arguments[0])
            function = SYMBOLIC[tree[1]]
            if tree[1] in ("min", "max"):
                value = arguments[0]
                for a in arguments[1:]:
                    value = self.let(function(value, a))
                return value
            return self.let(function(*arguments))
        if kind == "neg":
            return -self.named(tree[1])
        if kind in ("+", "-"):
            a, b = self.write(tree[1]), self.write(tree[2])
            if len(a.args) + len(b.args) > 8:
                a = self.let(a)
            return a + b if kind == "+" else a - b
        a, b = self.named(tree[1]), self.named(tree[2])
        if kind == "*":
            return a * b
        if kind == "/":
            return a / b
        if not (isinstance(b, Number) and b.is_Integer and abs(b) <= 2):
            a = self.let(a)  # named, since powers of the factors of `a` may overflow
        return self.let(Power(a, b))

    def named(self, tree: Tree) -> Expr:
        value = self.write(tree)
        return self.let(value) if value.is_Add else value

    def let(self, value: Expr) -> Expr:
        return self.x.let("e", value, self.tag)


def written(x: Scope, tree: Tree, leaf: Callable[[Tree], Value], tag: str = "") -> Value:
    """Writes an expression as statements, and returns its value. On zero patterns, returns whether it may differ from
    zero. All operands are read in either case.

    `leaf` returns the value of a name; `tag` is the equation number in the comments of the statements.
    """
    if isinstance(x, Expansion):
        value: Value = Statements(x, lambda name: algebra.expression(leaf(name)), tag).write(tree)
        return value
    kind = tree[0]
    if kind == "number":
        return x.number(tree[1])
    if kind == "name":
        return leaf(tree)
    values = [written(x, a, leaf) for a in tree[2 if kind == "call" else 1 :]]
    match kind:
        case "neg":
            return -values[0]
        case "+":
            return values[0] + values[1]
        case "-":
            return values[0] - values[1]
        case "*":
            return values[0] * values[1]
    return x.call("sqrt", 1)  # on patterns, a quotient, a power or a function may be nonzero


def make_shape(index: int, slots: Slots, write: Callable[[Expansion, Leaf], dict[str, Value]]) -> Shape:
    """Write and simplify the block of the constants of links whose expressions have the same form.

    Parameters
    ----------
    slots : Slots
        Parameters and numbers that occur in the expressions.
    write : callable (expansion, leaf) -> dict
        Writes the statements and returns the constants.
    """
    x = Expansion(
        f"constants_{index}", "constants of a link and their derivative primitives (Eq. 29)", lambda a, f: True
    )

    def leaf(tree: Tree) -> Expr:
        return x.entry(NUMBER if tree[0] == "slot" else PARAMETER, tree[1])

    fields = {name: algebra.expression(value) for name, value in write(x, leaf).items()}
    parameters = [x.symbol(PARAMETER, j) for j in range(len(slots.parameters))]
    depends: set[Symbol] = set(parameters)
    statements = list(x.block.statements)
    for s in statements:
        if s.expression.free_symbols & depends:
            depends.add(s.target)
    varying: dict[str, str] = {}
    fixed: dict[str, Expr] = {}
    first: dict[Expr, str] = {}
    for name, value in fields.items():
        if value.free_symbols & depends:
            varying[name] = first.setdefault(value, name)
            if varying[name] == name:
                x.set_component(SHAPE, name, value)
    for j, p in enumerate(parameters):
        d = Tangents(x, {p: algebra.ONE}, {}, lanes=False)
        for s in statements:
            d.statement(s)
        for name, same in list(varying.items()):
            if same != name or "/" in name:
                continue
            value = x.let("d", d.expression(fields[name]))
            key = f"{name}/{j}"
            if value.is_Number:
                fixed[key] = value
            else:
                varying[key] = first.setdefault(value, key)
                if varying[key] == key:
                    x.set_component(SHAPE, key, value)
    for name in [n for n in varying if "/" not in n]:
        same = varying[name]
        for j in range(len(parameters)):
            if same != name:
                if f"{same}/{j}" in fixed:
                    fixed[f"{name}/{j}"] = fixed[f"{same}/{j}"]
                else:
                    varying[f"{name}/{j}"] = varying[f"{same}/{j}"]
    return Shape(index, len(parameters), simplify(x.finish()), fields, varying, fixed)
