"""How nearly conditions of loops have to follow from others."""

from __future__ import annotations

from typing import Final

from ..model import LOOP_TOLERANCE
from ..reading import Reader

_LARGEST: Final = 0.01


def read_loop_tolerance(reader: Reader) -> float:
    """A number from 0 to 0.01."""
    given = reader.document.root.get("loop_tolerance")
    if given is None:
        return LOOP_TOLERANCE
    at = reader.top("loop_tolerance")
    expression = reader.scalar(at, (), given, "constants")
    if expression is None:
        return LOOP_TOLERANCE
    value = float(expression.value)
    if not 0 <= value <= _LARGEST:
        reader.report(
            at, (), f"loop_tolerance is {value:g}; 0 to {_LARGEST:g} is allowed, left out it is {LOOP_TOLERANCE:g}"
        )
    return value
