"""Numbers with a derivative along one direction, with which an engine computes the change of its gradients along that direction.

A `Dual` is a value and its derivative. An engine whose numbers are duals computes each result with its derivative. Its
gradients come from pairs whose entries are duals, so the derivative of a gradient is a product of the Hessian with the
direction. No second derivative is written anywhere: `codegen.elementary` gives the derivatives of functions as
formulas, which duals evaluate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..elementary import TABLE
from .arithmetic import Arithmetic, Array


class Dual:
    """A number and its derivative along one direction.

    Comparisons are those of values, because they choose branches. Only ``!=`` also compares derivatives: the engines use it
    to test whether a number vanishes identically.
    """

    __slots__ = ("along", "value")

    def __init__(self, value: Any, along: Any) -> None:
        self.value = value
        self.along = along

    def __add__(self, other: Any) -> Dual:
        value, along = _parts(other)
        return Dual(self.value + value, self.along + along)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Dual:
        value, along = _parts(other)
        return Dual(self.value - value, self.along - along)

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return other * self
        value, along = _parts(other)
        return Dual(self.value * value, self.along * value + self.value * along)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        value, along = _parts(other)
        quotient = self.value / value
        return Dual(quotient, (self.along - quotient * along) / value)

    def __rtruediv__(self, other: Any) -> Dual:
        quotient = other / self.value
        return Dual(quotient, -quotient * self.along / self.value)

    def __pow__(self, exponent: int) -> Dual:
        """Integer power; the exponents 0 and 1 avoid 0**-1 for a base of zero."""
        if exponent == 0:
            return Dual(self.value**0, 0 * self.along)
        return Dual(self.value**exponent, exponent * self.value ** (exponent - 1) * self.along)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.along)

    def __abs__(self) -> Dual:
        return -self if self.value < 0 else self

    def __eq__(self, other: object) -> bool:
        return bool(self.value == _parts(other)[0])

    def __ne__(self, other: object) -> bool:
        value, along = _parts(other)
        return bool(self.value != value or self.along != along)

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < _parts(other)[0])

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= _parts(other)[0])

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > _parts(other)[0])

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= _parts(other)[0])

    def __bool__(self) -> bool:
        return bool(self.value)

    def __float__(self) -> float:
        return float(self.value)

    def __repr__(self) -> str:
        return f"Dual({self.value}, {self.along})"


def _parts(x: Any) -> tuple[Any, Any]:
    return (x.value, x.along) if isinstance(x, Dual) else (x, 0)


class DualArithmetic(Arithmetic):
    """Arithmetic on duals of another number type."""

    def __init__(self, base: Arithmetic) -> None:
        super().__init__(base.numbers)
        self.base = base
        self.extended, self.dtype = True, object
        self._zero = base.number(0)

    def number(self, x: Any) -> Dual:
        """A dual as it is; another number with the derivative 0."""
        return x if isinstance(x, Dual) else Dual(self.base.number(x), self._zero)

    def duals(self, values: Any, along: Any) -> Array:
        """Numbers with their derivatives along the direction."""
        values, along = np.asarray(values, object), np.asarray(along, object)
        found = np.empty(values.shape, object)
        for i in np.ndindex(values.shape):
            found[i] = Dual(self.base.number(values[i]), self.base.number(along[i]))
        return found

    def along(self, x: Any) -> Array:
        """The derivatives of an array of numbers."""
        return self.base.array(_each(x, lambda number: _parts(number)[1]))

    def held(self, x: Array) -> Array:
        """The same numbers with the derivative 0."""
        return self.array(_each(x, lambda number: _parts(number)[0]))

    def is_nan(self, x: Any) -> bool:
        """Whether the value or the derivative is not a number."""
        return any(self.base.is_nan(part) for part in _parts(x))

    @property
    def epsilon(self) -> Any:
        """Spacing of the values at one."""
        return self.base.epsilon

    def function(self, name: str) -> Callable[..., Dual]:
        """An elementary function of duals: its value, and its derivative by the formula of `codegen.elementary`.

        A derivative that is infinite counts only where the argument changes along the direction.
        """
        of, slopes = self.base.function(name), TABLE[name].slopes if name in TABLE else ()

        def dual(*arguments: Dual) -> Dual:
            values = [a.value for a in arguments]
            value, along = of(*values), self._zero
            for slope, a in zip(slopes, arguments, strict=False):
                if a.along != 0:
                    along = along + slope(self.base.functions, value, *values) * a.along
            return Dual(value, along)

        return dual

    def power(self, x: Dual, y: Dual) -> Dual:
        """x**y; an exponent without derivative needs no logarithm of the base."""
        value, along = self.base.power(x.value, y.value), self._zero
        if x.along != 0 and y.value != 0:
            along = along + y.value * self.base.power(x.value, y.value - 1) * x.along
        if y.along != 0:
            along = along + value * self.base.function("log")(x.value) * y.along
        return Dual(value, along)


def _each(x: Any, of: Callable[[Any], Any]) -> Array:
    """An object array with a function of each entry."""
    x = np.asarray(x, object)
    found = np.empty(x.shape, object)
    for i in np.ndindex(x.shape):
        found[i] = of(x[i])
    return found
