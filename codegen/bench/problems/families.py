"""Chains, closed chains and ladders of growing size: accelerations and derivatives at one state, compared with an independent
method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np

from ...measure import articulated_chain
from ...measure.models import chain_state, seeds, text_of
from ..dual import Dual, cosine, sine
from ..problem import Array, Evaluation, Family, Reference

DIGITS = 40
ENGINE_TO = 60
"""Largest number of bodies that the generic engine computes in 40 digits; ten bodies take about a second."""
ALL_DIRECTIONS_TO, ONE_DIRECTION_TO = 100, 1000
"""Largest chains computed in 40 digits for eight directions and for one direction; 1 ms per rod and direction."""


def exact(x: Array) -> Any:
    """Convert doubles to mpmath numbers of equal value."""
    return np.array([mpmath.mpf(float(a)) for a in x], object)


def along(function: Callable[[Sequence[Any], Sequence[Any], Any], Sequence[Any]], q: Array, u: Array, p: float,
          dq: Array, du: Array, dp: Array) -> Reference:  # fmt: skip
    """The function of q, u and one parameter, with its derivatives along directions computed by dual numbers."""
    with mpmath.workdps(DIGITS):
        seeded = [[Dual(x, y) for x, y in zip(exact(v), map(exact, w.T), strict=True)] for v, w in ((q, dq), (u, du))]
        found = [Dual.of(x) for x in function(seeded[0], seeded[1], Dual(mpmath.mpf(p), exact(dp[:, 0])))]
        slopes = [np.broadcast_to(np.asarray(x.slope, object), len(dq)) for x in found]
        return Reference([x.value for x in found], np.transpose(slopes).tolist())


# -- the chain -------------------------------------------------------------------------------------------------------------


def chain_rates(q: Sequence[Any], u: Sequence[Any], length: Any) -> list[Any]:
    """Accelerations udot of the chain, and their derivatives, by an algorithm that shares no code with the
    generator."""
    constants = [mpmath.mpf(x) for x in (1.0, 0.05, 9.81)]
    return articulated_chain.accelerations(list(q), list(u), length, sine, cosine, *constants)


def chain(n: int) -> Evaluation:
    q, u = chain_state(n)
    directions = seeds(n)

    def reference() -> Reference:
        count = 8 if n <= ALL_DIRECTIONS_TO else 1
        return along(chain_rates, q, u, 1.0, *(x[:count] for x in directions))

    text = text_of("CHAIN", n)
    return Evaluation(text, q, u, *directions, reference if n <= ONE_DIRECTION_TO else None)


# -- loops -----------------------------------------------------------------------------------------------------------------


def ladder(loops: int) -> Evaluation:
    """The ladder, with one independent angle: that of the rungs, which lean by 30 degrees."""
    n = 2 * loops + 1
    text, directions = text_of("LADDER", loops), seeds(2 * loops + 1)

    def rates(q: Sequence[Any], u: Sequence[Any], length: Any) -> list[Any]:
        foot = length * length / 3 + mpmath.mpf(0.05) ** 2 / 4
        moment = (loops + 1) * foot + loops * length * length
        lever = (mpmath.mpf(loops + 1) / 2 + loops) * length
        rung = mpmath.mpf(9.81) * lever * sine(q[0]) / moment
        return [-rung if k % 2 else rung for k in range(n)]

    def reference() -> Reference:
        with mpmath.workdps(DIGITS):
            lean = float(mpmath.pi / 6)
        return along(rates, np.full(n, lean), np.zeros(n), 1.0, *directions)

    return Evaluation(text, None, None, *directions, reference)


def by_the_engine(name: str, size: int, speeds: int, bodies: int) -> Evaluation:
    """An example model in its initial state, compared with the generic recursive engine in 40 digits."""
    text, directions = text_of(name, size), seeds(speeds)

    def reference() -> Reference:
        from ...loops import initial_configuration
        from ...model import parse_model
        from ...reference import RecursiveEngine

        model = parse_model(text, name)
        q, u = initial_configuration(model)
        dq, du, dp = directions
        with mpmath.workdps(DIGITS):
            udot, dudot = RecursiveEngine(model, numbers="mpmath").sensitivities(q, u, dq=dq, du=du, dp=dp)
        return Reference(list(udot), [list(row) for row in dudot])

    return Evaluation(text, None, None, *directions, reference if bodies <= ENGINE_TO else None)


def closed_chain(n: int) -> Evaluation:
    return by_the_engine("CLOSED", n, n, n)


def hooke_ladder(loops: int) -> Evaluation:
    return by_the_engine("HOOKE", loops, 4 * loops + 2, 2 * loops + 1)


ENGINE = f"the generic recursive engine in {DIGITS} digits, up to {ENGINE_TO} bodies; larger ones have no reference"
CHAIN = Family(
    name="chain",
    title="a chain of rods, revolute joints about y, x, y, ...",
    source=f"a hand-written articulated-body algorithm on dual numbers of {DIGITS} digits; above "
    f"{ALL_DIRECTIONS_TO} rods, only one direction is compared, and above {ONE_DIRECTION_TO} rods, nothing",
    unit="rods",
    make=chain,
    sizes=(4, 12, 50, 100, 1000, 10000),
    quick=(12,),
    within=1e-11,
)
CLOSED_CHAIN = Family(
    name="closed_chain",
    title="a chain of rods held at both ends, n - 5 degrees of freedom",
    source=ENGINE,
    unit="rods",
    make=closed_chain,
    sizes=(16, 48, 200, 1000),
    quick=(8,),
    within=1e-10,
)
LADDER = Family(
    name="ladder",
    title="a swaying ladder, one degree of freedom",
    source="closed form: the equivalent pendulum of all rungs, with derivatives by dual numbers",
    unit="loops",
    make=ladder,
    sizes=(3, 12, 100, 1000),
    quick=(3,),
    within=1e-10,
)
HOOKE_LADDER = Family(
    name="hooke_ladder",
    title="a ladder of Hooke joints, two degrees of freedom",
    source=ENGINE,
    unit="loops",
    make=hooke_ladder,
    sizes=(3, 12, 100),
    quick=(2,),
    within=1e-10,
)
PROBLEMS = (CHAIN, CLOSED_CHAIN, LADDER, HOOKE_LADDER)
