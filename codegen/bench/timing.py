"""Times that mean something on a machine that others share: contestants take turns, the least time of each counts."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

Timed = Callable[[], float]
"""Does some work and returns the seconds that count; or a clock."""


@dataclass(frozen=True)
class Seconds:
    """Seconds of one contestant.

    Attributes
    ----------
    least, median, high : float
        Of all its turns; nine of ten took no more than `high`.
    turns : int
    """

    least: float
    median: float
    high: float
    turns: int


def elapsed(run: Callable[[], object], repetitions: int = 1, clock: Timed = time.perf_counter) -> Timed:
    """The time of a call by a clock, as the mean of so many in a row."""

    def timed() -> float:
        start = clock()
        for _ in range(repetitions):
            run()
        return (clock() - start) / repetitions

    return timed


def calibrated(run: Callable[[], object], batch: float = 2e-3) -> Timed:
    """The same with as many calls in a row as take about `batch` seconds.

    It is the time that this thread has the core: what others do on it meanwhile does not count.
    """
    repetitions, seconds = 1, elapsed(run, 1, time.thread_time)()
    while seconds * repetitions < batch / 2 and repetitions < 10**7:
        repetitions *= 2
        seconds = elapsed(run, repetitions, time.thread_time)()
    return elapsed(run, max(1, round(batch / max(seconds, 1e-9))), time.thread_time)


def alternate(
    contestants: Mapping[str, Timed], budget: float, least_turns: int = 3, most_turns: int = 1000
) -> dict[str, Seconds]:
    """Let contestants take turns.

    Parameters
    ----------
    contestants : mapping of str to Timed
    budget : float
        Seconds for each, about; one that takes longer has `least_turns` all the same.
    least_turns, most_turns : int

    Returns
    -------
    dict of str to Seconds
    """
    return {name: summary(x) for name, x in turns(contestants, budget, least_turns, most_turns).items()}


def turns(
    contestants: Mapping[str, Timed], budget: float, least_turns: int, most_turns: int = 1000
) -> dict[str, list[float]]:
    """The same, every turn's seconds."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    spent = dict.fromkeys(contestants, 0.0)
    waiting = dict(contestants)
    while waiting:
        for name, run in list(waiting.items()):
            start = time.perf_counter()
            times[name].append(run())
            spent[name] += time.perf_counter() - start
            taken = len(times[name])
            if taken >= most_turns or (taken >= least_turns and spent[name] >= budget):
                del waiting[name]
    return times


def summary(seconds: Sequence[float]) -> Seconds:
    """Of all turns of a contestant."""
    n = len(seconds)
    return Seconds(min(seconds), statistics.median(seconds), sorted(seconds)[(9 * n - 1) // 10], n)


def cores() -> list[int]:
    """Those that this process may use; none where the system does not say."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []


@contextmanager
def one_core(core: int | None = None) -> Iterator[None]:
    """Stay on one core, the last of those allowed if none is given, where the system knows how; all of them again afterwards."""
    allowed = cores()
    if not allowed:
        yield
        return
    os.sched_setaffinity(0, {allowed[-1] if core is None else core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
