"""Work-precision diagrams: a motion at several tolerances, its error beside evaluations and time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..measure.clock import Timed, alternate
from ..measure.motions import simulated, timed
from ..runtime.standalone.trajectory.trajectory import INTERRUPTED
from .problem import Setting

if TYPE_CHECKING:
    from ..runtime import Solver, Trajectory

MOST_STEPS = 5_000_000
LONG = 5.0
"""Budgets."""


@dataclass(frozen=True)
class Point:
    """A motion at one setting.

    Attributes
    ----------
    setting : Setting
    error : float
        The largest, absolute; NaN if the motion did not come to its end.
    evaluations, steps, rejected : int
    seconds : float
        Of the integrator in C, the least of several turns; the wall time of C and the CPU time of the whole call are both no
        less, so the smaller one counts.
    ended : str
        "finished", or why it did not.
    """

    setting: Setting
    error: float
    evaluations: int
    steps: int
    rejected: int
    seconds: float
    ended: str


def integrate(solver: Solver, end: float, setting: Setting, start: dict[str, float] | None = None,
              sensitivities: Sequence[str] = ()) -> Trajectory:  # fmt: skip
    """The motion from 0 to `end`, s; what cannot go on is returned as far as it came."""
    q = solver.assemble(start)[0] if start else None
    found = simulated(
        solver, [0.0, end], q=q, sensitivities=sensitivities, rtol=setting.rtol, atol=setting.atol,
        atol_sensitivities=setting.atol if sensitivities else None, method=setting.method, most_steps=MOST_STEPS,
    )  # fmt: skip
    if found.stats["reason"] == INTERRUPTED:  # which a simulation ends with what it has
        raise KeyboardInterrupt
    return found


def error_at_end(trajectory: Trajectory, end: float, quantities: Sequence[str], exact: Sequence[float]) -> float:
    """The largest absolute error of the quantities; NaN if the motion ended before."""
    if not len(trajectory) or trajectory.t[-1] != end:
        return math.nan
    return max(abs(float(trajectory[name][-1]) - x) for name, x in zip(quantities, exact, strict=True))


def diagram(
    solver: Solver, end: float, settings: Sequence[Setting], error: Callable[[Trajectory], float],
    start: dict[str, float] | None = None, sensitivities: Sequence[str] = (), budget: float = 0.1,
) -> list[Point]:  # fmt: skip
    """A motion at several settings, which take turns.

    Parameters
    ----------
    solver : Solver
    end : float
        s.
    settings : sequence of Setting
    error : callable
        Of a trajectory; see `error_at_end`.
    start : dict, optional
        Initial coordinates by name, where they are not the model's.
    sensitivities : sequence of str
        Derivatives that are integrated with the motion, under error control.
    budget : float
        Seconds for each setting, about; three turns at least, but two for a motion that takes `LONG` of it.
    """
    points: list[Point] = []
    contestants: dict[str, Timed] = {}
    for i, setting in enumerate(settings):

        def again(setting: Setting = setting) -> float:
            return timed(lambda: integrate(solver, end, setting, start, sensitivities))[1]

        x = integrate(solver, end, setting, start, sensitivities)
        stats, found = x.stats, error(x)
        seconds = float(stats["seconds"])
        if math.isfinite(found):
            seconds = min(seconds, again())  # the first may have compiled what it needs near singular poses
            if seconds < budget * LONG:
                contestants[str(i)] = again
        points.append(
            Point(setting, found, stats["evaluations"], stats["steps"], stats["rejected"], seconds, stats["reason"])
        )
    for name, times in alternate(contestants, budget).items():
        points[int(name)] = replace(points[int(name)], seconds=min(points[int(name)].seconds, times.least))
    return points


def cheapest(points: Sequence[Point], error: float) -> Point | None:
    """The point with the fewest evaluations among those with at most this error."""
    return min((p for p in points if p.error <= error), key=lambda p: p.evaluations, default=None)


def fastest(points: Sequence[Point], error: float) -> Point | None:
    """The point that takes least time among these."""
    return min((p for p in points if p.error <= error), key=lambda p: p.seconds, default=None)


def seconds_at(points: Sequence[Point], error: float) -> float:
    """The time at which a diagram meets an error, by lines in logarithms between points none of which is better in both;
    NaN beyond its ends."""
    known = sorted((p for p in points if math.isfinite(p.error) and p.error > 0), key=lambda p: (p.error, p.seconds))
    front: list[Point] = []
    for p in known:  # from the least error on: a larger one is of use only where it takes less time
        if not front or p.seconds < front[-1].seconds:
            front.append(p)
    if not front or not front[0].error <= error <= front[-1].error:
        return math.nan
    x, y = np.log([p.error for p in front]), np.log([p.seconds for p in front])
    return float(np.exp(np.interp(math.log(error), x, y)))
