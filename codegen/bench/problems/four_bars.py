"""A02 of the IFToMM library of multibody benchmarks: N coupled four-bars that pass poses in which all their links lie flat.

N + 1 equal cranks and N couplers are rods of length L and mass m. They move like one pendulum of the same total energy:
phi'' = -c sin(phi), c = (g/L) ((N+1)/2 + N)/((N+1)/3 + N), with phi measured from the lowest point. The motion starts
at the highest point with v0 = 1 m/s at the tip. The published versions are N = 2 for 10 s and N = 40 for 20 s.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import mpmath

from ...measure.models import changed
from ..elliptic import DIGITS, rotation
from ..problem import Goal, Motion, tolerances

SOURCE = (
    "closed form: the mechanism moves like a pendulum that rotates, solved by Jacobi's functions in 40 digits; "
    "problem A02 of the IFToMM library of multibody benchmarks"
)


def tip(n: int, t: Any, g: Any = None, length: Any = 1, v0: Any = 1) -> list[Any]:
    """The coordinates x and y of the tip of the first crank, as mpmath numbers."""
    with mpmath.workdps(DIGITS):
        t, length, v0 = mpmath.mpf(t), mpmath.mpf(length), mpmath.mpf(v0)
        g = mpmath.mpf("9.81") if g is None else g
        cranks = mpmath.mpf(n + 1)
        c = g / length * (cranks / 2 + n) / (cranks / 3 + n)
        angle, _ = rotation(c, v0 / length, t)
        # the crank moves towards positive x; measured about the lowest point, this is a negative angle
        return [-length * angle.sin, -length * angle.cos]


@cache
def _end(n: int, end: float) -> tuple[float, float]:
    x, y = tip(n, end)
    return float(x), float(y)


DERIVATIVES = (
    (0.4907188782248584542765061, -0.170648419828776706445396),
    (-9.088104395142764417705117, 4.219145994528731061840953),
    (0.1528238792187985757603976, -0.0531447936038190314358519),
    (-0.2292358188278981636405964, 0.07971719040572854715377785),
    (4.602610311297718359904757, -1.600566457829830609450333),
)
"""Derivatives of x and y for N = 2 at 10 s, from the closed form in 40 digits.

They are with respect to g, the length of all links (masses and v0 fixed), the masses of the first crank and the first coupler,
and v0.
"""


PUBLISHED = (2, 40)
"""Numbers of loops whose motions have been published; two methods integrate these motions."""


def _four_bars(n: int, end: float, goals: tuple[Goal, ...], most: int) -> Motion:
    return Motion(
        name=f"four_bars_{n}",
        title=f"A02, {n} coupled four-bars for {end:g} s" if n > 1 else f"A02, a four-bar for {end:g} s",
        text=lambda: changed("n_four_bar", "{N: 2}", f"{{N: {n}}}"),
        end=end,
        quantities=("x", "y"),
        exact=lambda: _end(n, end),
        source=SOURCE,
        settings=tolerances("dop853", 5, most) + (tolerances("radau", 5, 12) if n in PUBLISHED else ()),
        quick=tolerances("dop853", 9, 9),
        within=1e-5,
        goals=goals,
        derivatives=(lambda: DERIVATIVES) if n == 2 else None,
        sensitivities=("g", "length", "mass_crank", "mass_coupler", "v0") if n == 2 else (),
    )


PROBLEMS = (
    _four_bars(1, 10.0, (), 13),
    _four_bars(2, 10.0, (Goal(1e-8),), 13),
    _four_bars(5, 10.0, (), 13),
    _four_bars(10, 10.0, (), 12),
    _four_bars(20, 10.0, (), 12),
    _four_bars(40, 20.0, (Goal(1e-8), Goal(1e-6, seconds=0.05)), 12),
)
