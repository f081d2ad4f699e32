"""Exact rotations by quarter turns.

pi/2 is not a floating-point number, and the cosine of the nearest one is 6e-17. ``rpy: [0, 0, pi/2]`` means a quarter turn, whose
matrix contains only zeros and ones. Such a rotation costs nothing, and all engines use the same matrix.
"""

from __future__ import annotations

import math

from .expressions import Expression

MOST = 64
"""Largest number of quarter turns that is recognised; neighbouring floating-point numbers are too far apart for larger
angles."""


def quarter_turns(angle: Expression) -> int | None:
    """Number of quarter turns of a fixed angle, 0 to 3; None if the angle is no whole number of quarter turns, or
    depends on parameters.

    The angle must be the floating-point number nearest to a multiple of pi/2, such as ``-90 deg`` or ``3*pi/2``, not 1.5707963.
    """
    if not angle.is_number:
        return None
    value = float(angle.value)
    count = round(value / (math.pi / 2)) if abs(value) < MOST else 0
    nearest = abs(value - count * (math.pi / 2)) <= math.ulp(value) / 2
    return count % 4 if value == 0 or (count and nearest) else None


def cosine_and_sine(quarters: int) -> tuple[int, int]:
    """Cosine and sine of a number of quarter turns."""
    return (1, 0, -1, 0)[quarters], (0, 1, 0, -1)[quarters]
