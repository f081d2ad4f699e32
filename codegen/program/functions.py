"""Elementary functions of expressions, as sympy functions that differentiate to printable ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import sympy
from sympy import Expr, Function, S

from .digits import are_long, number, value_of


class AtLeast(Function):
    """1 where the first argument is at least the second, else 0."""

    nargs = 2

    def fdiff(self, argindex: int = 1) -> Expr:
        return S.Zero


class Maximum(Function):
    """The larger of two numbers; where they are equal, the derivative is the first one's."""

    nargs = 2

    def fdiff(self, argindex: int = 1) -> Expr:
        a, b = self.args
        return AtLeast(a, b) if argindex == 1 else 1 - AtLeast(a, b)


class Minimum(Function):
    """The smaller of two numbers; where they are equal, the derivative is the first one's."""

    nargs = 2

    def fdiff(self, argindex: int = 1) -> Expr:
        a, b = self.args
        return AtLeast(b, a) if argindex == 1 else 1 - AtLeast(b, a)


class Sign(Function):
    """-1, 0 or 1; its derivative is taken as zero."""

    nargs = 1

    def fdiff(self, argindex: int = 1) -> Expr:
        return S.Zero


class Absolute(Function):
    """|x|; at zero the derivative is taken as zero."""

    nargs = 1

    def fdiff(self, argindex: int = 1) -> Expr:
        return Sign(self.args[0])


class Power(Function):
    """base**exponent of numbers not known before: what sympy would multiply out, take apart or put together stays as written.

    ``(2 q)**1000000000`` is no number of 300 million digits times a power of q, and ``(q**1000)**1000`` overflows where the
    floats do.
    """

    nargs = 2

    @classmethod
    def eval(cls, base: Expr, exponent: Expr) -> Expr | None:
        if exponent.is_Integer and abs(exponent) <= MULTIPLIED:
            return base**exponent
        if base.is_Number and exponent.is_Number:
            power: Callable[[float, float], float] = mpmath.power if are_long() else math.pow
            return computed(lambda: power(value_of(base), value_of(exponent)))
        return None

    def fdiff(self, argindex: int = 1) -> Expr:
        base, exponent = self.args
        return exponent * Power(base, exponent - 1) if argindex == 1 else Power(base, exponent) * sympy.log(base)


MULTIPLIED = 16
"""Powers up to this one are written as products."""


def computed(compute: Callable[[], float]) -> Expr:
    """What is computed with numbers; nan where it has no value or is no float."""
    try:
        value = compute()
        return number(value) if math.isfinite(value) else S.NaN
    except (ArithmeticError, ValueError):
        return S.NaN


SYMBOLIC = {
    "sin": sympy.sin, "cos": sympy.cos, "tan": sympy.tan, "asin": sympy.asin, "acos": sympy.acos,
    "atan": sympy.atan, "atan2": sympy.atan2, "sinh": sympy.sinh, "cosh": sympy.cosh, "tanh": sympy.tanh,
    "sqrt": sympy.sqrt, "exp": sympy.exp, "log": sympy.log, "abs": Absolute, "sign": Sign,
    "min": Minimum, "max": Maximum,
}  # fmt: skip
"""The functions of the model format."""
