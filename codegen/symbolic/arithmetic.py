"""Polynomials as the numbers of the reference engines, and expressions of a model as those of sympy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import sympy

from ..elementary import TABLE
from ..model.expressions import Expression
from ..model.sympy_output import to_sympy
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
            function = sympy.floor if name == "floor" else getattr(sympy, TABLE[name].spelled("sympy"))
            return self.algebra.convert(function(*(x.expression for x in arguments)))

        return of

    def power(self, x: Polynomial, y: Polynomial) -> Polynomial:
        """x**y."""
        return self.algebra.convert(sympy.Pow(x.expression, y.expression))

    def value_of(self, expression: Expression, values: Mapping[str, Polynomial]) -> Polynomial:
        """An expression of a model, with polynomials for its names."""
        known = {name: values[name].expression for name in expression.names}
        return self.algebra.convert(to_sympy(expression, known, number=exact))
