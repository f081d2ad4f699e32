"""Elementary functions of expressions, and their derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace

import mpmath

from ..elementary import BY_SYMBOL, ODD
from .algebra import (
    MEANINGS,
    MINUS_ONE,
    ONE,
    ZERO,
    Expr,
    Function,
    Made,
    Meaning,
    Number,
    coefficient,
    expression,
    function,
    negative,
    sqrt,
)  # fmt: skip
from .digits import are_long, number, value_of

MULTIPLIED = 16
"""Integer powers up to this exponent are written as products."""


def computed(compute: Callable[[], float]) -> Expr:
    """Value of a function of numbers; NaN where the value is undefined or overflows."""
    try:
        value = compute()
        return number(value) if math.isfinite(value) else Number(math.nan)
    except (ArithmeticError, ValueError, TypeError):
        return Number(math.nan)


def value_of_function(name: str, values: Sequence[float]) -> float:
    """The value of a function of numbers."""
    a, b = values[0], values[-1]
    match name:
        case "AtLeast":
            return int(a >= b)
        case "Maximum":
            return max(a, b)
        case "Minimum":
            return min(a, b)
        case "Sign":
            return (a > 0) - (a < 0)
        case "Absolute":
            return abs(a)
        case "Floor":
            return mpmath.floor(a) if are_long() else math.floor(a)
        case "Choice":
            return values[1] if a else values[2]
        case "Vanishing" | "Along":
            return a * b if a else 0
        case "Power":
            found: float = mpmath.power(a, b) if are_long() else math.pow(a, b)
        case _:
            of_long = mpmath, BY_SYMBOL[name].spelled("mpmath")
            found = getattr(*of_long if are_long() else (math, name))(*values)
    return found


def _elementary(name: str, parity: int = 0) -> Made:
    """A function that computes the value immediately if all operands are numbers. For an odd or even function, f(-x) becomes
    -f(x) or f(x)."""

    def of(*arguments: object) -> Expr:
        args = tuple(map(expression, arguments))
        if all(a.is_Number for a in args):
            return computed(lambda: value_of_function(name, [value_of(a) for a in args]))
        if parity and coefficient(args[0])[0] < 0:
            positive = function(name, negative(args[0]))
            return negative(positive) if parity == ODD else positive
        return function(name, *args)

    return of


def _plain(name: str) -> Made:
    return lambda *arguments: function(name, *map(expression, arguments))


AtLeast = _plain("AtLeast")
"""1 if the first argument is at least the second, else 0."""

Maximum = _plain("Maximum")
"""The larger of two numbers; where the numbers are equal, it has the derivative of the first."""

Minimum = _plain("Minimum")
"""The smaller of two numbers; where the numbers are equal, it has the derivative of the first."""

Sign = _plain("Sign")
"""-1, 0 or 1; its derivative is taken as zero."""

Absolute = _plain("Absolute")
"""|x|; at zero the derivative is taken as zero."""


HeldAtLeast, HeldMaximum, HeldMinimum, HeldSign, HeldAbsolute, HeldTurn = map(
    _plain, ("HeldAtLeast", "HeldMaximum", "HeldMinimum", "HeldSign", "HeldAbsolute", "HeldTurn")
)
"""Variants with a mode as last argument. A positive mode selects the branch for a positive argument, or for a positive difference
of the arguments; a negative mode selects the other branch. With mode zero, the arguments decide, as above. The mode of
`HeldTurn` is an angle: whole turns are added to the argument until it differs from the mode by at most half a turn."""

HeldAngle = _plain("HeldAngle")
"""atan2(y, x) with a mode, the sign of y. Where y has the other sign and x is negative, the result continues beyond
pi, or below -pi. For x = 0 it is a quarter turn."""

Floor = _elementary("Floor")
"""The largest integer not above x; its derivative is zero."""

HeldFloor = _plain("HeldFloor")
"""Rounding with a mode: a positive mode selects the nearest even integer, a negative mode the nearest odd integer."""


def Modulo(*arguments: object) -> Expr:
    """The remainder of x divided by m, ``x - m floor(x/m)``, in [0, m)."""
    x, m = map(expression, arguments)
    return x - m * Floor(x / m)


def HeldModulo(*arguments: object) -> Expr:
    """The remainder ``x - m n``; a mode determines the integer n, so that the remainder does not jump."""
    x, m, mode = map(expression, arguments)
    return x - m * HeldFloor(x / m, mode)


def Choice(*arguments: object) -> Expr:
    """The second argument if the first is 1, the third if the first is 0. The argument that is not chosen may be
    infinite."""
    c, x, y = map(expression, arguments)
    if isinstance(c, Number):
        return x if c else y
    return x if x is y else function("Choice", c, x, y)


def Vanishing(*arguments: object) -> Expr:
    """A product that is zero if its first factor is zero, even if the second is infinite."""
    a, b = map(expression, arguments)
    return a * b if a.is_Number or b.is_Number else function("Vanishing", a, b)


def Along(*arguments: object) -> Expr:
    """A value per direction times a number that may be infinite; the product is zero in directions where the value is zero.

    It is linear in the first argument; see `transpose.coefficients`.
    """
    along, factor = map(expression, arguments)
    if along is ZERO or factor.is_Number:
        return along * factor
    return function("Along", along, factor)


def Power(*arguments: object) -> Expr:
    """base**exponent for a base that is not a number; powers of products and of powers are kept unexpanded.

    Otherwise ``(2 q)**1000000000`` would need a number of 300 million digits, and ``(q**1000)**1000`` would overflow as a float.
    """
    b, n = map(expression, arguments)
    if isinstance(n, Number) and isinstance(n.value, int) and abs(n.value) <= MULTIPLIED:
        return b**n
    if b.is_Number and n.is_Number:
        return computed(lambda: value_of_function("Power", (value_of(b), value_of(n))))
    return function("Power", b, n)


def _square_root(*arguments: object) -> Expr:
    return sqrt(*arguments)


_PIECEWISE = {
    "AtLeast": AtLeast, "Maximum": Maximum, "Minimum": Minimum, "Sign": Sign, "Absolute": Absolute, "HeldAtLeast": HeldAtLeast,
    "HeldMaximum": HeldMaximum, "HeldMinimum": HeldMinimum, "HeldSign": HeldSign, "HeldAbsolute": HeldAbsolute,
    "HeldTurn": HeldTurn, "HeldFloor": HeldFloor, "HeldAngle": HeldAngle, "Floor": Floor, "Choice": Choice,
    "Vanishing": Vanishing, "Along": Along, "Power": Power,
}  # fmt: skip
_SMOOTH: dict[str, Made] = {
    name: _elementary(name, e.parity) for name, e in BY_SYMBOL.items() if name and name not in ("sqrt", *_PIECEWISE)
}

SYMBOLIC: dict[str, Made] = {
    **_SMOOTH, "sqrt": _square_root, "abs": Absolute, "sign": Sign, "min": Minimum, "max": Maximum,
    "at_least": AtLeast, "held_at_least": HeldAtLeast, "held_max": HeldMaximum, "held_min": HeldMinimum,
    "held_sign": HeldSign, "held_abs": HeldAbsolute, "held_turn": HeldTurn, "held_mod": HeldModulo, "held_atan2": HeldAngle,
    "mod": Modulo,
    "wrapped": Modulo, "choice": Choice, "vanishing": Vanishing,
}  # fmt: skip
"""Elementary functions that expression trees call, by name."""

_FUNCTIONS = SimpleNamespace(**SYMBOLIC)


def slope(e: Function, place: int) -> Expr:
    """The derivative of a function with respect to one of its arguments."""
    if e.name in BY_SYMBOL:
        return expression(BY_SYMBOL[e.name].slopes[place](_FUNCTIONS, e, *e.args))
    x = e.args[0]
    match e.name:
        case "HeldAngle":  # integration steps end where y is zero, and x may be zero at that state
            y, x, _ = e.args
            inverse = 1 / (x**2 + y**2)
            return (Vanishing(x, inverse), -Vanishing(y, inverse), ZERO)[place]
        case "AtLeast" | "Floor" | "HeldSign" | "HeldAtLeast" | "HeldFloor":
            return ZERO
        case "HeldTurn":
            return ONE if place == 0 else ZERO
        case "HeldAbsolute":
            return HeldSign(*e.args) if place == 0 else ZERO
        case "HeldMaximum" | "HeldMinimum":
            a, b, mode = e.args
            first = HeldAtLeast(a, b, mode) if e.name == "HeldMaximum" else HeldAtLeast(b, a, negative(mode))
            return (first, ONE - first, ZERO)[place]
        case "Choice":
            return ZERO if place == 0 else Choice(x, *((ONE, ZERO) if place == 1 else (ZERO, ONE)))
        case "Vanishing":
            return e.args[1 - place]
        case "Power":
            base, exponent = e.args
            return exponent * Power(base, exponent + MINUS_ONE) if place == 0 else e * _SMOOTH["log"](base)
    raise ValueError(f"{e.name} has no derivative here")


MEANINGS |= {
    name: Meaning(make, partial(value_of_function, name), slope) for name, make in (_SMOOTH | _PIECEWISE).items()
}
