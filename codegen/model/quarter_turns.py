"""Rotations by quarter turns, which are exact.

pi/2 is no floating-point number, and the cosine of the nearest one is 6e-17. Who writes ``rpy: [0, 0, pi/2]`` means a quarter
turn, whose matrix has zeros and ones: so a turned frame costs nothing, and all engines turn by the same matrix.
"""

from __future__ import annotations

import math

from .expressions import Expression

MOST = 64
"""Angles of more quarter turns are taken as they are: so far from zero neighbouring numbers are no longer close to each other."""


def quarter_turns(angle: Expression) -> int | None:
    """How often a fixed angle is a quarter turn, 0 to 3; None where it is none, or depends on parameters.

    It is one where it is the nearest number to a multiple of pi/2, as ``pi/2``, ``-90 deg`` and ``3*pi/2`` are; 1.5707963 is not.
    """
    if not angle.is_number:
        return None
    value = float(angle.value)
    count = round(value / (math.pi / 2)) if abs(value) < MOST else 0
    nearest = abs(value - count * (math.pi / 2)) <= math.ulp(value) / 2
    return count % 4 if value == 0 or (count and nearest) else None


def cosine_and_sine(quarters: int) -> tuple[int, int]:
    """Of so many quarter turns."""
    return (1, 0, -1, 0)[quarters], (0, 1, 0, -1)[quarters]
