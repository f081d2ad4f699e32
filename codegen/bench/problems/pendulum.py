"""A01 of the IFToMM library of multibody benchmarks: a planar pendulum, exact by Jacobi's functions.

Two versions are in use: 10 s from x = -1 (IFToMM's page), and 2000 s from x = +1 (the specification of 2005).
"""

from __future__ import annotations

from functools import cache

from ...measure.models import example
from ..elliptic import swing
from ..problem import Goal, Motion, tolerances

SOURCE = (
    "closed form: an oscillation between -90 and 90 degrees by Jacobi's functions in 40 digits; "
    "problem A01 of the IFToMM library of multibody benchmarks"
)


@cache
def _end(start: float, end: float) -> tuple[float, float]:
    """The coordinates x and y of the ball, which starts at the height of the pivot, at x = `start` (-1 or 1)."""
    angle, _ = swing("9.81", end)
    return start * float(angle.sin), -float(angle.cos)


def _short() -> tuple[float, float]:
    return _end(-1.0, 10.0)


def _long() -> tuple[float, float]:
    return _end(1.0, 2000.0)


def _derivatives() -> list[list[float]]:
    """Derivatives of `_short` with respect to g and length, by the chain rule on the phase; x = length*f(t*sqrt(g/length))."""
    angle, rate = swing("9.81", 10.0)
    x, y, g = -angle.sin, -angle.cos, 9.81
    dx, dy = -angle.cos * rate * 10.0, angle.sin * rate * 10.0  # derivatives with respect to the logarithm of time
    return [[float(dx / (2 * g)), float(dy / (2 * g))], [float(x - dx / 2), float(y - dy / 2)]]


PENDULUM = Motion(
    name="pendulum",
    title="A01, a pendulum for 10 s",
    text=lambda: example("pendulum"),
    end=10.0,
    quantities=("x", "y"),
    exact=_short,
    source=SOURCE,
    settings=tolerances("dop853", 5, 14) + tolerances("radau", 5, 12),
    quick=tolerances("dop853", 6, 6) + tolerances("radau", 6, 6),
    within=1e-3,
    derivatives=_derivatives,
    sensitivities=("g", "length"),
)
LONG_PENDULUM = Motion(
    name="long_pendulum",
    title="A01, a pendulum for 2000 s (845 periods), from x = +1",
    text=lambda: example("pendulum"),
    end=2000.0,
    quantities=("x", "y"),
    exact=_long,
    source=SOURCE,
    settings=tolerances("dop853", 10, 14),
    quick=tolerances("dop853", 11, 11),
    within=1e-5,
    goals=(Goal(1e-8),),
    start={"bar": 1.5707963267948966},
)
PROBLEMS = (PENDULUM, LONG_PENDULUM)
