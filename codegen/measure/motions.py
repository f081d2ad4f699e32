"""Measurement of a motion and of the integrator's time."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from ..runtime import Solver, Trajectory

T = TypeVar("T")


def simulated(solver: Solver, times: Any, **options: Any) -> Trajectory:
    """`Solver.simulate` without warnings, up to the time that the motion reaches."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return solver.simulate(times, on_failure="return", **options)


def timed(run: Callable[[], T]) -> tuple[T, float]:
    """The result of a call, and the time of the integrator in it, s.

    The wall time in C and the CPU time of the whole call are both upper bounds of the integrator's CPU time, so the smaller one
    is used. If the call fails, its CPU time is used.
    """
    began = time.thread_time()
    found = run()
    spent = time.thread_time() - began
    stats: dict[str, Any] = getattr(found, "stats", {})
    return found, min(spent, float(stats.get("seconds", spent)))
