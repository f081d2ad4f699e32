"""Exact motions of a plane pendulum, phi'' = -c sin(phi), by Jacobi's elliptic functions in 40 digits.

Oscillation between -90 and 90 degrees: sin(phi/2) = k sn(K - sqrt(c) t, k), k = sin(45 degrees). Rotation: sin(phi/2) = sn(w t/2,
k), k = 2 sqrt(c)/w, where w is the angular velocity at the lowest point (Whittaker, Analytical Dynamics, art. 44).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath

DIGITS = 40


@dataclass(frozen=True)
class Angle:
    """The angle that has the given sine and cosine, which are mpmath numbers."""

    sin: Any
    cos: Any


def swing(c: str, t: float) -> tuple[Angle, Any]:
    """Angle from the lowest point, and its rate, at time t; at rest at 90 degrees at time 0.

    Parameters
    ----------
    c : str
        g/length, 1/s^2, as a decimal number.
    t : float
    """
    with mpmath.workdps(DIGITS):
        rate, m = mpmath.sqrt(mpmath.mpf(c)), mpmath.mpf(1) / 2
        k = mpmath.sqrt(m)
        phase = mpmath.ellipk(m) - rate * mpmath.mpf(t)
        sn, cn, dn = (mpmath.ellipfun(name, phase, m=m) for name in ("sn", "cn", "dn"))
        # sin(phi/2) = k sn and cos(phi/2) = dn
        return Angle(2 * k * sn * dn, 1 - 2 * m * sn * sn), -2 * k * rate * cn


def rotation(c: Any, speed: Any, t: Any) -> tuple[Angle, Any]:
    """Angle and angular velocity of a pendulum that rotates: at time 0 it is at the top, with angular velocity `speed` in 1/s.

    Parameters
    ----------
    c, speed, t : mpmath numbers
    """
    with mpmath.workdps(DIGITS):
        lowest = mpmath.sqrt(speed * speed + 4 * c)
        m = 4 * c / lowest**2
        phase = lowest * t / 2 + mpmath.ellipk(m)
        sn, cn, dn = (mpmath.ellipfun(name, phase, m=m) for name in ("sn", "cn", "dn"))
        return Angle(2 * sn * cn, cn * cn - sn * sn), lowest * dn
