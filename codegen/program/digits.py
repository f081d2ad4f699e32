"""Precision of the numbers in a program: double precision, or more for a program that is evaluated in extended
precision.

Extended precision changes only values that are computed from numbers alone, such as inertias about joints.
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
    """Compute and print numbers with this many decimal digits inside the context."""
    token = _digits.set(digits)
    try:
        with mpmath.workdps(digits):
            yield
    finally:
        _digits.reset(token)


def are_long() -> bool:
    """Return whether numbers are more precise than doubles."""
    return _digits.get() > 0


def number(value: float) -> Number:
    """The value as a number of the program: a double, or an extended-precision number of the same value."""
    return Number(mpmath.mpf(value) if are_long() and not isinstance(value, int) else value)


def long_number(value: float) -> float:
    """A double, or an extended-precision number of the same value."""
    found: float = mpmath.mpf(value) if are_long() else value
    return found


def value_of(e: Expr) -> float:
    """The value of a constant expression, as a double or as an ``mpmath`` number."""
    if not are_long():
        return float(value_of_number(e))
    found: float = mpmath.mpf(value_of_number(e))
    return found


def text_of(value: Expr | float) -> str:
    """A number in Python syntax: as a double if that is exact, otherwise with all its digits."""
    if not are_long():
        return repr(value_of(value) if isinstance(value, Expr) else float(value))
    exact = value_of(value) if isinstance(value, Expr) else mpmath.mpf(value)
    nearest = float(exact)
    if nearest == exact or not math.isfinite(nearest):
        return repr(nearest)
    text: str = mpmath.nstr(exact, _digits.get(), strip_zeros=False)
    return text
