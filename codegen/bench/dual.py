"""Dual numbers over any scalar type: a value and its derivatives along directions. Code for numbers accepts them."""

from __future__ import annotations

from typing import Any

import mpmath


class Dual:
    """value + slope*epsilon with epsilon^2 = 0; the slope is a number, or an array with an entry for each direction."""

    __slots__ = ("slope", "value")

    def __init__(self, value: Any, slope: Any = 0) -> None:
        self.value, self.slope = value, slope

    @staticmethod
    def of(x: Any) -> Dual:
        return x if isinstance(x, Dual) else Dual(x)

    def __add__(self, other: Any) -> Dual:
        y = Dual.of(other)
        return Dual(self.value + y.value, self.slope + y.slope)

    def __sub__(self, other: Any) -> Dual:
        y = Dual.of(other)
        return Dual(self.value - y.value, self.slope - y.slope)

    def __mul__(self, other: Any) -> Dual:
        y = Dual.of(other)
        return Dual(self.value * y.value, self.slope * y.value + y.slope * self.value)

    def __truediv__(self, other: Any) -> Dual:
        y = Dual.of(other)
        quotient = self.value / y.value
        return Dual(quotient, (self.slope - y.slope * quotient) / y.value)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __rsub__(self, other: Any) -> Dual:
        return Dual.of(other) - self

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual.of(other) / self

    __radd__, __rmul__ = __add__, __mul__


def sine(x: Any) -> Dual:
    """The sine of a dual number whose scalars are mpmath numbers."""
    y = Dual.of(x)
    return Dual(mpmath.sin(y.value), y.slope * mpmath.cos(y.value))


def cosine(x: Any) -> Dual:
    """The cosine of a dual number whose scalars are mpmath numbers."""
    y = Dual.of(x)
    return Dual(mpmath.cos(y.value), -(y.slope * mpmath.sin(y.value)))
