"""Warnings about angles that seem to be in degrees, and about angles and axes that are rounded from exact values, such as
1.5708 for pi/2. With rounded axes, revolute joints that should be parallel are not exactly so, and intended motion may be
locked.
"""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from typing import Final

from ..expressions import Expression
from ..model import Vector
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader

_PART: Final = math.pi / 12
_EXACT: Final = 1e-13
_MOST: Final = 48
"""Largest multiple of pi/12 that is recognised: two turns in either sense."""
_MOST_DEGREES: Final = 3600
"""Largest number that is taken for an angle in degrees."""


def check_angle(reader: Reader, angle: Expression, at: Instance, sub: Path_) -> None:
    """Warn of an angle that is a rounded multiple of pi/12."""
    value = _number(angle)
    if value is not None and (count := cut_twelfths(value)):
        off = abs(value - count * _PART)
        message = (
            f"{value!r} is {_multiple(count)} up to {off:.1e} rad; write {_multiple(count)}, so that axes are parallel"
        )
        reader.report(at, sub, message, severity="warning")


def check_degrees(reader: Reader, angle: Expression, at: Instance, sub: Path_) -> None:
    """Warn of an angle that seems to be in degrees."""
    value = _number(angle)
    if value is not None and seems_in_degrees(angle):
        message = f"{value:g} rad is {value / math.tau:.3g} turns; if it is in degrees, write {value:g} deg"
        reader.report(at, sub, message, severity="warning")


def seems_in_degrees(angle: Expression) -> bool:
    """Whether an angle is a whole number of radians between one turn and `_MOST_DEGREES`."""
    value = _number(angle)
    return value is not None and math.tau < abs(value) <= _MOST_DEGREES and value == round(value)


def cut_twelfths(value: float) -> int:
    """The integer n for which a number is n pi/12 rounded to its decimals; 0 if there is none.

    A number with two decimals is accepted only as a multiple of pi/2, since a number such as 0.52 may be meant exactly.
    """
    if not abs(value) <= (_MOST + 0.5) * _PART:
        return 0
    decimals = _decimals(value)
    count = round(value / _PART)
    return count if count and decimals >= (2 if count % 6 == 0 else 3) and _is_cut(value, count, decimals) else 0


def check_axis(reader: Reader, axis: Vector, at: Instance, sub: Path_) -> None:
    """Warn of an axis in a coordinate plane if its angle in this plane is a rounded multiple of pi/12."""
    values = [_number(e) for e in axis]
    numbers = [v for v in values if v is not None]
    plane = [i for i, v in enumerate(numbers) if v != 0]
    if len(numbers) != 3 or len(plane) != 2:
        return
    i, j = plane
    decimals = max(_decimals(v) for v in numbers)
    angle = math.atan2(numbers[j], numbers[i])
    count = round(angle / _PART)
    off = abs(angle - count * _PART)
    if decimals >= 3 and abs(math.hypot(*numbers) - 1) < 2 * 10.0**-decimals and _EXACT < off < 2 * 10.0**-decimals:
        exact = ["0"] * 3
        exact[i], exact[j] = (f"{f}({_multiple(count)})" for f in ("cos", "sin"))
        message = f"the axis is [{', '.join(exact)}] up to {off:.1e} rad; write that, so that axes are parallel"
        reader.report(at, sub, message, severity="warning")


def _number(e: Expression) -> float | None:
    """The value of an expression that is a number, with or without a minus sign; otherwise None."""
    if e.is_number:
        return float(e.value)
    return -float(e.tree[1][1]) if e.tree[0] == "neg" and e.tree[1][0] == "number" else None


def _decimals(value: float) -> int:
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return max(0, -exponent) if isinstance(exponent, int) else 0


def _is_cut(value: float, count: int, decimals: int) -> bool:
    """Whether a number is a multiple of pi/12 rounded, or cut off, after its decimals."""
    exact = abs(count) * _PART
    off = abs(abs(value) - exact)
    if off < _EXACT:
        return False
    return off <= 0.5000001 * 10.0**-decimals or (abs(value) < exact and off < 10.0**-decimals)


def _multiple(count: int) -> str:
    part = Fraction(count, 12)
    over = f"/{part.denominator}" if part.denominator > 1 else ""
    size = abs(part.numerator)
    return f"{'-' * (count < 0)}{f'{size}*' if size > 1 else ''}pi{over}" if count else "0"
