"""Values of expression trees of `model.json`, also at many times at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....elementary import ON_ARRAYS

Known = Mapping[str, Any]
"""Values of names: numbers, or arrays over times."""


def value_of(x: Any, known: Known) -> Any:
    """The value of a number, or of an expression tree; not finite where the expression has no value."""
    with np.errstate(all="ignore"):
        return _value(x, known)


def _value(x: Any, known: Known) -> Any:
    if not isinstance(x, (list, tuple)):
        return np.float64(x)
    kind, *of = x
    if kind == "number":
        return np.float64(of[0])
    if kind == "name":
        return known[of[0]]
    if kind == "call":
        name, *operands = of
        a, *rest = (_value(y, known) for y in operands)
        if name == "choice":
            return np.where(a, *rest)[()]
        if name == "vanishing":
            return a * rest[0]
        return getattr(ON_ARRAYS, "mod" if name == "wrapped" else name)(a, *rest)
    a, *rest = (_value(y, known) for y in of)
    match kind:
        case "neg":
            return -a
        case "+":
            return a + rest[0]
        case "-":
            return a - rest[0]
        case "*":
            return a * rest[0]
        case "/":
            return a / rest[0]
    return np.power(a, rest[0])
