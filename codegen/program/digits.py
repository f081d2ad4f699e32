"""How many digits the numbers of a program have: those of a double, or more for a program that is to be evaluated in more.

A program whose numbers have more digits is the same but for what was computed with numbers alone, such as inertias about joints.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import mpmath

from .algebra import Expr, Number, value_of_number

_digits: ContextVar[int] = ContextVar("digits", default=0)


@contextmanager
def long_numbers(digits: int) -> Iterator[None]:
    """While this lasts, numbers are computed and printed with so many decimal digits."""
    token = _digits.set(digits)
    try:
        with mpmath.workdps(digits):
            yield
    finally:
        _digits.reset(token)


def are_long() -> bool:
    """Whether numbers have more digits than doubles."""
    return _digits.get() > 0


def number(value: float) -> Number:
    """A number that prints as the same double, or as the same long number."""
    return Number(mpmath.mpf(value) if are_long() and not isinstance(value, int) else value)


def long_number(value: float) -> float:
    """A double, or the long number of the same value."""
    found: float = mpmath.mpf(value) if are_long() else value
    return found


def value_of(e: Expr) -> float:
    """The value of a constant expression as a double, or as a long number of mpmath's."""
    if not are_long():
        return float(value_of_number(e))
    found: float = mpmath.mpf(value_of_number(e))
    return found


def text_of(value: Expr | float) -> str:
    """A number as it stands in Python: as a double, or with all its digits where it is none."""
    if not are_long():
        return repr(value_of(value) if isinstance(value, Expr) else float(value))
    exact = value_of(value) if isinstance(value, Expr) else mpmath.mpf(value)
    nearest = float(exact)
    if nearest == exact or not math.isfinite(nearest):
        return repr(nearest)
    text: str = mpmath.nstr(exact, _digits.get(), strip_zeros=False)
    return text
