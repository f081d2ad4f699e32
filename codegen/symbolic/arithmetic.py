"""The number type of the reference engines for symbols: polynomials. It also converts expressions of a model to
sympy's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import sympy

from ..elementary import TABLE
from ..model.expressions import Expression
from ..model.sympy_output import to_sympy
from ..reference.arithmetic import Arithmetic
from ..reference.pairs import Pair
from .polynomials import Algebra, Polynomial, exact

FACTORED = 3
"""Maximum number of terms of positions and velocities that are multiplied out in forces and outputs."""


class SymbolicArithmetic(Arithmetic):
    """Arithmetic on numbers of type `Polynomial`; a comparison of symbols raises `UndecidedError`.

    Attributes
    ----------
    algebra : Algebra
    """

    symbolic = True

    def __init__(self, most_products: int | None = None, intermediate: str = "") -> None:
        super().__init__("mpmath")
        self.algebra = Algebra(most_products, intermediate)

    def number(self, x: Any) -> Polynomial:
        """A polynomial from a number: an int, a fraction or an expression of sympy exactly, a float as `exact` reads
        it."""
        if isinstance(x, Polynomial):
            return x
        if isinstance(x, int | Fraction):
            return self.algebra.constant(x)
        return self.algebra.convert(x if isinstance(x, sympy.Expr) else exact(float(x)))

    def function(self, name: str) -> Callable[..., Polynomial]:
        """The elementary function with this name, for polynomials."""

        def of(*arguments: Polynomial) -> Polynomial:
            function = sympy.floor if name == "floor" else getattr(sympy, TABLE[name].spelled("sympy"))
            return self.algebra.convert(function(*(x.short for x in arguments)))

        return of

    def power(self, x: Polynomial, y: Polynomial) -> Polynomial:
        """The power x**y of two polynomials."""
        return self.algebra.convert(sympy.Pow(x.short, y.short))

    def where_zero(self, x: Polynomial, value: Polynomial, otherwise: Polynomial) -> Polynomial:
        """`value` where x is zero, else `otherwise`, as a piecewise expression."""
        return self._cases((value, sympy.Eq(x.short, 0)), (otherwise, sympy.true))

    def where_negative(self, x: Polynomial, value: Polynomial, otherwise: Polynomial) -> Polynomial:
        """`value` where x is negative, else `otherwise`, as a piecewise expression."""
        return self._cases((value, sympy.Lt(x.short, 0)), (otherwise, sympy.true))

    def of_largest(self, numbers: Sequence[Polynomial], values: Sequence[Polynomial]) -> Polynomial:
        """The largest number, as a piecewise expression; for equally large numbers, the value of any of them."""
        x = [number.short for number in numbers]
        largest = [sympy.And(*(sympy.Ge(a, b) for b in x[i + 1 :])) for i, a in enumerate(x)]
        return self._cases(*zip(values, largest, strict=True))

    def _cases(self, *cases: tuple[Polynomial, sympy.Basic]) -> Polynomial:
        return self.algebra.convert(sympy.Piecewise(*((value.short, where) for value, where in cases)))

    def closed(self, pair: Pair) -> Pair:
        """A matrix in which long entries are replaced by factors that are not multiplied out, or by intermediate
        variables."""
        value = np.empty_like(pair.value)
        for place, x in np.ndenumerate(pair.value):
            value[place] = self.algebra.closed(x, FACTORED)
        return Pair(value, pair.tangent)

    def value_of(self, expression: Expression, values: Mapping[str, Polynomial]) -> Polynomial:
        """The value of a model's expression, with polynomials for its names."""
        known = {name: values[name].short for name in expression.names}
        return self.algebra.convert(to_sympy(expression, known, number=exact))
