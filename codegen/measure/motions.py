"""A motion that is measured: as far as it comes, and what the integrator takes for it."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from ..runtime import Solver, Trajectory

T = TypeVar("T")


def simulated(solver: Solver, times: Any, **options: Any) -> Trajectory:
    """`Solver.simulate` without warnings, as far as it comes: its figures say all of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return solver.simulate(times, on_failure="return", **options)


def timed(run: Callable[[], T]) -> tuple[T, float]:
    """What a call gives, and the seconds of the integrator in it.

    The wall time of C and the CPU time of the whole call are both no less than what the integrator took of the core, so the
    smaller one counts; where no motion comes of it, the latter.
    """
    began = time.thread_time()
    found = run()
    spent = time.thread_time() - began
    stats: dict[str, Any] = getattr(found, "stats", {})
    return found, min(spent, float(stats.get("seconds", spent)))
