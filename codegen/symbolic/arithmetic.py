"""Polynomials as the numbers of the reference engines, and expressions of a model as those of sympy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import reduce
from typing import Any

import sympy

from ..elementary import TABLE
from ..model.expressions import Expression
from ..model.grammar import AT_LEAST, CHOICE, VANISHING, WRAPPED, Tree
from ..reference.arithmetic import Arithmetic
from .polynomials import Algebra, Polynomial, exact


class SymbolicArithmetic(Arithmetic):
    """Numbers are `Polynomial`; what compares symbols raises `UndecidedError`.

    Attributes
    ----------
    algebra : Algebra
    """

    symbolic = True

    def __init__(self, most_products: int | None = None) -> None:
        super().__init__("mpmath")
        self.algebra = Algebra(most_products)

    def number(self, x: Any) -> Polynomial:
        """A polynomial: an int, a fraction or an expression of sympy's as it is, a float as `exact` reads it."""
        if isinstance(x, Polynomial):
            return x
        if isinstance(x, int | Fraction):
            return self.algebra.constant(x)
        return self.algebra.convert(x if isinstance(x, sympy.Expr) else exact(float(x)))

    def function(self, name: str) -> Callable[..., Polynomial]:
        """The elementary function of that name, on polynomials."""

        def of(*arguments: Polynomial) -> Polynomial:
            return self.algebra.convert(FUNCTIONS[name](*(x.expression for x in arguments)))

        return of

    def power(self, x: Polynomial, y: Polynomial) -> Polynomial:
        """x**y."""
        return self.algebra.convert(sympy.Pow(x.expression, y.expression))

    def value_of(self, expression: Expression, values: Mapping[str, Polynomial]) -> Polynomial:
        """An expression of a model, with polynomials for its names."""
        known = {name: values[name].expression for name in expression.names}
        return self.algebra.convert(to_sympy(expression.tree, known))


def _sympy_function(name: str) -> Callable[..., sympy.Expr]:
    found: Callable[..., sympy.Expr] = getattr(sympy, TABLE[name].spelled("sympy"))
    return found


FUNCTIONS: dict[str, Callable[..., sympy.Expr]] = {
    **{name: _sympy_function(name) for name in TABLE},
    AT_LEAST: lambda a, b: sympy.Piecewise((1, sympy.Ge(a, b)), (0, True)),
    VANISHING: lambda a, b: sympy.Piecewise((0, sympy.Eq(a, 0)), (a * b, True)),
    WRAPPED: sympy.Mod,
    "floor": sympy.floor,
}
"""The functions of the grammar as those of sympy."""

OPERATORS: dict[str, Callable[[sympy.Expr, sympy.Expr], sympy.Expr]] = {
    "+": sympy.Expr.__add__, "-": sympy.Expr.__sub__, "*": sympy.Expr.__mul__, "/": sympy.Expr.__truediv__,
    "**": sympy.Expr.__pow__,
}  # fmt: skip


def to_sympy(tree: Tree, values: Mapping[str, sympy.Expr]) -> sympy.Expr:
    """The expression of sympy's of a bound tree, with a value for each of its names; numbers are exact."""
    kind = tree[0]
    if kind == "number":
        return exact(tree[1]) if isinstance(tree[1], float) else sympy.Integer(tree[1])
    if kind == "name":
        return values[tree[1]]
    if kind == "call" and tree[1] == CHOICE:
        return sympy.Piecewise(
            (to_sympy(tree[3], values), condition(tree[2], values)), (to_sympy(tree[4], values), True)
        )
    if kind == "call":
        arguments = [to_sympy(a, values) for a in tree[2:]]
        two = tree[1] in ("min", "max")
        return reduce(FUNCTIONS[tree[1]], arguments) if two else FUNCTIONS[tree[1]](*arguments)
    if kind == "neg":
        return -to_sympy(tree[1], values)
    return OPERATORS[kind](to_sympy(tree[1], values), to_sympy(tree[2], values))


def condition(tree: Tree, values: Mapping[str, sympy.Expr]) -> sympy.Basic:
    """The condition that a tree, which is 1 or 0, is 1."""
    if tree[:2] == ("call", AT_LEAST):
        return sympy.Ge(*(to_sympy(a, values) for a in tree[2:]))
    if tree[0] == "-" and tree[1] == ("number", 1):
        return sympy.Not(condition(tree[2], values))
    if tree[0] == "*":
        return sympy.And(condition(tree[1], values), condition(tree[2], values))
    return sympy.Ne(to_sympy(tree, values), 0)
