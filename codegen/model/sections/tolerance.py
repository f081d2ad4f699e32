"""How nearly conditions of loops have to follow from others."""

from __future__ import annotations

from typing import Final

from ..model import LOOP_TOLERANCE
from ..reading import Reader

_LARGEST: Final = 0.01


def read_loop_tolerance(reader: Reader) -> float:
    """A number from 0 to 0.01."""
    at = reader.only("loop_tolerance")
    if at is None:
        return LOOP_TOLERANCE
    expression = reader.scalar(at, (), at.value, "constants")
    if expression is None:
        return LOOP_TOLERANCE
    value = float(expression.value)
    if not 0 <= value <= _LARGEST:
        reader.report(
            at, (), f"loop_tolerance is {value:g}; 0 to {_LARGEST:g} is allowed, left out it is {LOOP_TOLERANCE:g}"
        )
    return value
