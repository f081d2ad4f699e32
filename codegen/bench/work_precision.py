"""Work-precision diagrams: the error of a motion at several tolerances, with its evaluations and time."""

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
"""Largest number of steps of a motion. A motion that takes `LONG` times the time budget is timed only twice."""


@dataclass(frozen=True)
class Point:
    """A motion at one setting.

    Attributes
    ----------
    setting : Setting
        Method and tolerances.
    error : float
        Largest absolute error; NaN if the motion ended early.
    evaluations, steps, rejected : int
        Evaluations of the accelerations, steps, rejected steps.
    seconds : float
        Least time of the integrator in C over several turns: the smaller of the wall time of the C and the CPU time of
        the call.
    ended : str
        "finished", or the reason of an early end.
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
    """Return the motion from 0 to a time at one setting.

    Parameters
    ----------
    solver : Solver
        The model.
    end : float
        End of the motion, s.
    setting : Setting
        Method and tolerances.
    start : dict of str to float, optional
        Initial coordinates that differ from the model's.
    sensitivities : sequence of str, optional
        Derivatives that are integrated with error control.

    Returns
    -------
    Trajectory
        The motion; up to its end if it cannot continue.

    Examples
    --------
    >>> from codegen.bench.problem import Setting
    >>> integrate(solver, 0.5, Setting("dop853", 1e-6, 1e-6)).t[-1]
    np.float64(0.5)
    """
    q = solver.assemble(start)[0] if start else None
    found = simulated(
        solver, [0.0, end], q=q, sensitivities=sensitivities, rtol=setting.rtol, atol=setting.atol,
        atol_sensitivities=setting.atol if sensitivities else None, method=setting.method, most_steps=MOST_STEPS,
    )  # fmt: skip
    if found.stats["reason"] == INTERRUPTED:  # Ctrl-C ended the simulation early
        raise KeyboardInterrupt
    return found


def error_at_end(trajectory: Trajectory, end: float, quantities: Sequence[str], exact: Sequence[float]) -> float:
    """Return the largest absolute error of some quantities at the end of a motion.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    end : float
        Time of the exact values, s.
    quantities : sequence of str
        Names of series.
    exact : sequence of float
        Exact values.

    Returns
    -------
    float
        The error; NaN if the motion ended early.

    Examples
    --------
    >>> error_at_end(solver.simulate([0.0, 1.0]), 1.0, ["q.upper"], [0.0]) > 0
    True
    """
    if not len(trajectory) or trajectory.t[-1] != end:
        return math.nan
    return max(abs(float(trajectory[name][-1]) - x) for name, x in zip(quantities, exact, strict=True))


def diagram(
    solver: Solver, end: float, settings: Sequence[Setting], error: Callable[[Trajectory], float],
    start: dict[str, float] | None = None, budget: float = 0.1,
) -> list[Point]:  # fmt: skip
    """Integrate a motion at several settings in turn, and measure each.

    Parameters
    ----------
    solver : Solver
        The model.
    end : float
        End of the motion, s.
    settings : sequence of Setting
        Methods and tolerances.
    error : callable
        Returns the error of a trajectory; see `error_at_end`.
    start : dict of str to float, optional
        Initial coordinates that differ from the model's.
    budget : float, optional
        Time for each setting, s, approximately. At least three turns, but two for a motion that takes `LONG` times as long.

    Returns
    -------
    list of Point
        A point for each setting.

    Examples
    --------
    >>> from codegen.bench.problem import Setting
    >>> points = diagram(solver, 0.5, [Setting("dop853", 1e-6, 1e-6)], lambda run: abs(run["q.upper"][-1]), budget=0.0)
    >>> points[0].ended
    'finished'
    """
    points: list[Point] = []
    contestants: dict[str, Timed] = {}
    for i, setting in enumerate(settings):

        def again(setting: Setting = setting) -> float:
            return timed(lambda: integrate(solver, end, setting, start))[1]

        x = integrate(solver, end, setting, start)
        stats, found = x.stats, error(x)
        seconds = float(stats["seconds"])
        if math.isfinite(found):
            seconds = min(seconds, again())  # the first motion may have compiled functions for singular poses
            if seconds < budget * LONG:
                contestants[str(i)] = again
        points.append(
            Point(setting, found, stats["evaluations"], stats["steps"], stats["rejected"], seconds, stats["reason"])
        )
    for name, times in alternate(contestants, budget).items():
        points[int(name)] = replace(points[int(name)], seconds=min(points[int(name)].seconds, times.least))
    return points


def best(points: Sequence[Point], error: float, by: str = "evaluations") -> Point | None:
    """Return, among the points with at most a given error, the one with the fewest evaluations or the least time.

    Parameters
    ----------
    points : sequence of Point
        The points.
    error : float
        Largest error.
    by : {"evaluations", "seconds"}, optional
        The quantity to minimise.

    Returns
    -------
    Point or None
        The point; None if all have larger errors.

    Examples
    --------
    >>> best([], 1e-6) is None
    True
    """
    return min((p for p in points if p.error <= error), key=lambda p: getattr(p, by), default=None)


def seconds_at(points: Sequence[Point], error: float) -> float:
    """Return the time at which a diagram reaches an error.

    The diagram is interpolated linearly in logarithms, between points that no other point beats in both error and time.

    Parameters
    ----------
    points : sequence of Point
        The points.
    error : float
        The error.

    Returns
    -------
    float
        Time, s; NaN beyond the ends of the diagram.

    Examples
    --------
    >>> seconds_at([], 1e-6)
    nan
    """
    known = sorted((p for p in points if math.isfinite(p.error) and p.error > 0), key=lambda p: (p.error, p.seconds))
    front: list[Point] = []
    for p in known:  # from the least error on: a point with larger error is useful only if it takes less time
        if not front or p.seconds < front[-1].seconds:
            front.append(p)
    if not front or not front[0].error <= error <= front[-1].error:
        return math.nan
    x, y = np.log([p.error for p in front]), np.log([p.seconds for p in front])
    return float(np.exp(np.interp(math.log(error), x, y)))
