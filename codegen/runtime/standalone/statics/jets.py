"""Dual numbers over arrays: a value and its derivatives along directions, for NumPy's elementwise functions.

Derivatives are exact to rounding: there is no step size and no difference of neighbouring values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ....elementary import ON_ARRAYS, TABLE, Elementary
from ..arrays import Array


class Jet(np.lib.mixins.NDArrayOperatorsMixin):
    """An array and its derivatives along m directions.

    Parameters
    ----------
    value : (...,) array
    slope : (..., m) array
        The derivatives, with directions last, so that NumPy's broadcasting rules apply to the axes of values.
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Any, slope: Array):
        self.value, self.slope = np.asarray(value, float), slope

    def __getitem__(self, at: Any) -> Jet:
        from_end = isinstance(at, tuple) and any(part is Ellipsis for part in at)
        return Jet(self.value[at], self.slope[(*at, slice(None))] if from_end else self.slope[at])

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Iterator[Jet]:
        return (self[i] for i in range(len(self)))

    @property
    def T(self) -> Jet:
        """The transpose of the values' axes."""
        return Jet(self.value.T, np.moveaxis(self.slope.T, 0, -1))

    def __array_ufunc__(self, ufunc: Any, method: str, *given: Any, **options: Any) -> Any:
        rule = RULES.get(ufunc.__name__)
        if rule is None or method != "__call__" or options:
            return NotImplemented
        return rule(*given)


def value_of(x: Any) -> Any:
    """The value of a jet or of a plain number."""
    return x.value if isinstance(x, Jet) else x


def _wide(x: Any) -> Array:
    """An array of numbers with one more axis, for directions."""
    return np.asarray(x, float)[..., None]


def _scaled(*terms: tuple[Any, Any]) -> Array:
    """The slope of a function: the sum of partial derivative times slope over the arguments that are jets. Each term is a
    callable, which returns the partial derivative, and an argument."""
    # a zero slope contributes nothing, even if its factor is infinite
    parts = [np.where(x.slope != 0.0, _wide(factor()) * x.slope, 0.0) for factor, x in terms if isinstance(x, Jet)]
    return parts[0] if len(parts) == 1 else parts[0] + parts[1]


def _add(x: Any, y: Any) -> Jet:
    slopes = [z.slope for z in (x, y) if isinstance(z, Jet)]
    return Jet(value_of(x) + value_of(y), slopes[0] if len(slopes) == 1 else slopes[0] + slopes[1])


def _of_values(function: Callable[..., Any], *given: Any) -> Any:
    """Applies a piecewise constant function, whose derivative is zero, to the values."""
    return function(*map(value_of, given))


def _multiply(x: Any, y: Any) -> Jet:
    a, b = value_of(x), value_of(y)
    return Jet(a * b, _scaled((lambda: b, x), (lambda: a, y)))


def _divide(x: Any, y: Any) -> Jet:
    a, b = value_of(x), value_of(y)
    found = np.divide(a, b)
    return Jet(found, _scaled((lambda: np.divide(1.0, b), x), (lambda: -found / b, y)))


def _power(x: Any, y: Any) -> Jet:
    a, b = value_of(x), value_of(y)
    found = np.power(a, b)

    def by_exponent() -> Any:
        return found * np.log(np.where(np.equal(found, 0.0), 1.0, np.abs(a)))

    return Jet(found, _scaled((lambda: np.where(np.equal(b, 0.0), 0.0, b * np.power(a, b - 1.0)), x), (by_exponent, y)))


def choice(c: Any, x: Any, y: Any) -> Any:
    """Replaces `choice` in generated modules: x where the condition c is 1, y where c is 0."""
    holds = np.not_equal(value_of(c), 0.0)
    value = np.where(holds, value_of(x), value_of(y))
    slopes = [z.slope for z in (x, y) if isinstance(z, Jet)]
    if not slopes:
        return value
    a, b = (z.slope if isinstance(z, Jet) else np.zeros(1) for z in (x, y))
    return Jet(value, np.where(_wide(holds), a, b))


def vanishing(x: Any, y: Any) -> Any:
    """Replaces `vanishing` of generated modules: x*y, but zero wherever x is zero, whatever y."""
    a, b = value_of(x), value_of(y)
    value = np.where(np.not_equal(a, 0.0), a * b, 0.0)
    if not isinstance(x, Jet) and not isinstance(y, Jet):
        return value
    slope: Any = 0.0
    if isinstance(x, Jet):
        slope = np.where(x.slope != 0.0, _wide(b) * x.slope, 0.0)
    if isinstance(y, Jet):
        slope = slope + np.where(_wide(a) != 0.0, _wide(a) * y.slope, 0.0)
    return Jet(value, slope)


def _elementary(e: Elementary) -> Callable[..., Any]:
    """The differentiation rule of an elementary function."""
    function = getattr(ON_ARRAYS, e.name)

    def rule(*given: Any) -> Jet:
        of = [value_of(x) for x in given]
        found = function(*of)
        if not any(isinstance(x, Jet) for x in given):
            return found
        terms = [(partial(slope, ON_ARRAYS, found, *of), x) for slope, x in zip(e.slopes, given, strict=True)]
        return Jet(found, _scaled(*terms))

    return rule


ELEMENTARY: dict[str, Callable[..., Any]] = {e.spelled("numpy") or e.name: _elementary(e) for e in TABLE.values()}

RULES: dict[str, Callable[..., Any]] = {
    **ELEMENTARY, "add": _add, "subtract": lambda x, y: _add(x, -y), "multiply": _multiply, "divide": _divide, "power": _power,
    "negative": lambda x: Jet(-x.value, -x.slope), "absolute": ELEMENTARY["abs"],
    **{f.__name__: partial(_of_values, f) for f in (np.floor, np.greater, np.less, np.greater_equal, np.less_equal)},
}  # fmt: skip
"""Differentiation rules by the names of NumPy functions in generated statements."""
