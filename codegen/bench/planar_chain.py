"""Accelerations of a planar chain of rods on any scalars, in O(n): written in ground axes for the benchmark alone.

No joint has a torque, so what a rod hands to the one before it is a force, and its absolute angular acceleration follows from
the acceleration of its hinge alone. About its hinge a rod, with all that it carries, has an inertia J, a coupling s and a mass
matrix M: moment = J alpha + s.a + m0 = 0, force = M a + s alpha + f0, a the acceleration of the hinge against one that falls.
Shares nothing with the generator or the generic engine. Axes are (z, x), in which a turn about y is anticlockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

Scalars = Sequence[Any]


def accelerations(
    q: Scalars, u: Scalars, length: Any, mass: Any, g: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]
) -> list[Any]:
    """udot (n,) of n equal thin rods that point along -z at angle zero, each angle against the rod before.

    Parameters
    ----------
    q, u : (n,)
        rad, rad/s.
    length, mass : scalar
        Of one rod, m and kg.
    g : scalar
        Along -z, m/s^2.
    """
    n = len(q)
    arms: list[tuple[Any, Any]] = []
    rates: list[Any] = []
    angle, rate = 0 * q[0], 0 * u[0]
    for k in range(n):
        angle, rate = angle + q[k], rate + u[k]
        arms.append((-length * cos(angle), -length * sin(angle)))
        rates.append(rate * rate)

    handed: tuple[Any, Any, Any, Any, Any] | None = None
    solved: list[Any] = [None] * n
    for k in reversed(range(n)):
        rx, ry = arms[k]
        half = mass / 2
        J, m0 = mass * length * length / 3, 0 * mass
        s = (-half * ry, half * rx)
        Mxx, Mxy, Myy = mass, 0 * mass, mass
        f0 = (-rates[k] * half * rx, -rates[k] * half * ry)
        if handed is not None:  # the next hinge is at the arm's end and moves with it
            Hxx, Hxy, Hyy, hx, hy = handed
            tx, ty = -ry, rx
            Htx, Hty = Hxx * tx + Hxy * ty, Hxy * tx + Hyy * ty
            px = hx - rates[k] * (Hxx * rx + Hxy * ry)
            py = hy - rates[k] * (Hxy * rx + Hyy * ry)
            J, m0 = J + tx * Htx + ty * Hty, m0 + tx * px + ty * py
            s = (s[0] + Htx, s[1] + Hty)
            Mxx, Mxy, Myy = Mxx + Hxx, Mxy + Hxy, Myy + Hyy
            f0 = (f0[0] + px, f0[1] + py)
        solved[k] = (J, s, m0)
        gx, gy = s[0] / J, s[1] / J
        handed = (Mxx - gx * s[0], Mxy - gx * s[1], Myy - gy * s[1], f0[0] - gx * m0, f0[1] - gy * m0)

    udot: list[Any] = []
    before: Any = 0
    ax, ay = g, 0 * g  # the ground rises
    for k in range(n):
        J, s, m0 = solved[k]
        alpha = -(m0 + s[0] * ax + s[1] * ay) / J
        udot.append(alpha - before)
        before = alpha
        rx, ry = arms[k]
        ax, ay = ax - alpha * ry - rates[k] * rx, ay + alpha * rx - rates[k] * ry
    return udot
