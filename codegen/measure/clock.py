"""Times that mean something on a machine that others share: contestants take turns, the least time of each counts."""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

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
    """The time of a call by a clock, as the mean of n calls in a row."""

    def timed() -> float:
        start = clock()
        for _ in range(repetitions):
            run()
        return (clock() - start) / repetitions

    return timed


def calibrated(run: Callable[[], object], batch: float = 2e-3) -> Timed:
    """The time of a call, as the mean of as many in a row as take about `batch` seconds.

    It is the time that this thread has the core: what others do on it meanwhile does not count.
    """
    return repeated(lambda n: n * elapsed(run, n, time.thread_time)(), batch)


def repeated(run: Callable[[int], float], batch: float = 2e-3, warm_up: bool = False) -> Timed:
    """The time of one of as many repetitions as take about `batch` seconds.

    Parameters
    ----------
    run : callable
        Repeats something N times and returns the seconds of all.
    warm_up : bool
        Before each turn repeat a quarter of them, untimed, which brings code and data into the caches.
    """
    n, seconds = 1, run(1)
    while seconds < batch / 2 and n < 10**8:
        n *= 2
        seconds = run(n)
    n = max(1, round(n * batch / max(seconds, 1e-9)))

    def timed() -> float:
        if warm_up:
            run(n // 4 + 1)
        return run(n) / n

    return timed


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


@dataclass(frozen=True)
class Rounds:
    """Seconds of one contestant, a figure for each round, so that ratios are those of the same moments.

    Attributes
    ----------
    seconds : list of float
        Of each round the least of its turns.
    """

    seconds: list[float]

    @property
    def median(self) -> float:
        """Over the rounds."""
        return statistics.median(self.seconds)

    @property
    def least(self) -> float:
        """Of all rounds."""
        return min(self.seconds)

    def ratios(self, other: Rounds) -> list[float]:
        """This one's time over the other's, round by round."""
        return [a / b for a, b in zip(self.seconds, other.seconds, strict=True)]

    def ratio(self, other: Rounds) -> float:
        """The median of `ratios`."""
        return statistics.median(self.ratios(other))


def in_rounds(contestants: Mapping[str, Timed], rounds: int = 9, batches: int = 1) -> dict[str, Rounds]:
    """Let contestants take turns, and keep of each round the least of its `batches` turns."""
    found: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, times in turns(contestants, 0.0, batches, batches).items():
            found[name].append(min(times))
    return {name: Rounds(seconds) for name, seconds in found.items()}


def exponent(sizes: Sequence[int], seconds: Sequence[float]) -> float:
    """k of time ~ size^k, by least squares of the logarithms; NaN for less than two sizes."""
    if len(sizes) < 2:
        return math.nan
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


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
