"""Work-precision diagrams: a motion at several tolerances, its error beside evaluations and time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..measure.clock import Timed, alternate
from ..measure.motions import simulated, timed
from ..runtime.standalone.trajectory.trajectory import INTERRUPTED
from .problem import Setting

if TYPE_CHECKING:
    from ..runtime import Solver, Trajectory

MOST_STEPS = 5_000_000
LONG = 5.0
"""Budgets."""


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
    start: dict[str, float] | None = None, budget: float = 0.1,
) -> list[dict[str, Any]]:  # fmt: skip
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
    budget : float
        Seconds for each setting, about; three turns at least, but two for a motion that takes `LONG` of it.

    Returns
    -------
    list of dict
        ``method``, ``rtol``, ``atol``; ``error``, the largest, absolute, None if the motion did not come to its end;
        ``evaluations``, ``steps``, ``rejected``; ``seconds`` of the integrator in C, the least of several turns; ``ended``,
        "finished", or why it did not.
    """
    points: list[dict[str, Any]] = []
    contestants: dict[str, Timed] = {}
    for i, setting in enumerate(settings):

        def again(setting: Setting = setting) -> float:
            return timed(lambda: integrate(solver, end, setting, start))[1]

        x = integrate(solver, end, setting, start)
        found, seconds = error(x), float(x.stats["seconds"])
        if math.isfinite(found):
            seconds = min(seconds, again())  # the first may have compiled what it needs near singular poses
            if seconds < budget * LONG:
                contestants[str(i)] = again
        counts = {name: x.stats[name] for name in ("evaluations", "steps", "rejected")}
        reached = {"error": found if math.isfinite(found) else None, **counts}
        points.append(asdict(setting) | reached | {"seconds": seconds, "ended": x.stats["reason"]})
    for name, times in alternate(contestants, budget).items():
        points[int(name)]["seconds"] = min(points[int(name)]["seconds"], times.least)
    return points
