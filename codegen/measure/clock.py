"""Reliable times on a shared machine: contestants are timed in turns, and the smallest time of each counts."""

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
"""Type of contestants, which do some work and return its duration, and of clocks, which return the time, s."""


@dataclass(frozen=True)
class Seconds:
    """The times that one contestant took.

    Attributes
    ----------
    least, median, high : float
        Least, median and upper time of its turns, s; nine of ten turns took at most `high`.
    turns : int
        Number of turns.
    """

    least: float
    median: float
    high: float
    turns: int


def elapsed(run: Callable[[], object], repetitions: int = 1, clock: Timed = time.perf_counter) -> Timed:
    """Return a function that measures a call.

    Parameters
    ----------
    run : callable
        The call.
    repetitions : int, optional
        Number of calls in a row.
    clock : callable, optional
        Returns the time, s.

    Returns
    -------
    callable
        Returns the mean time of one call, s.

    Examples
    --------
    >>> elapsed(lambda: sum(range(10)), 5)() > 0
    True
    """

    def timed() -> float:
        start = clock()
        for _ in range(repetitions):
            run()
        return (clock() - start) / repetitions

    return timed


def calibrated(run: Callable[[], object], batch: float = 2e-3) -> Timed:
    """Return a function that measures a call by the CPU time of this thread.

    Parameters
    ----------
    run : callable
        The call.
    batch : float, optional
        Time of the calls in a row, s, which sets their number.

    Returns
    -------
    callable
        Returns the mean time of one call, s.

    Examples
    --------
    >>> calibrated(lambda: sum(range(1000)), 1e-4)() > 0
    True
    """
    return repeated(lambda n: n * elapsed(run, n, time.thread_time)(), batch)


def repeated(run: Callable[[int], float], batch: float = 2e-3, warm_up: bool = False) -> Timed:
    """Return a function that measures one of many repetitions.

    Parameters
    ----------
    run : callable
        Repeats something N times and returns the total time, s.
    batch : float, optional
        Time of the repetitions, s, which sets their number.
    warm_up : bool, optional
        Before each turn, run a quarter of the repetitions, untimed, to bring code and data into the caches.

    Returns
    -------
    callable
        Returns the mean time of one repetition, s.

    Examples
    --------
    >>> repeated(lambda n: n * 1e-3)()
    0.001
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
    """Measure contestants that take turns.

    Parameters
    ----------
    contestants : mapping of str to callable
        Each returns the seconds of one turn.
    budget : float
        Approximate time for each contestant, s. A slow contestant has `least_turns`.
    least_turns, most_turns : int, optional
        Bounds of the number of turns.

    Returns
    -------
    dict of str to Seconds
        Times of each contestant.

    Examples
    --------
    >>> alternate({"one": lambda: 1.0, "two": lambda: 2.0}, 0.0)["two"].least
    2.0
    """
    return {name: summary(x) for name, x in turns(contestants, budget, least_turns, most_turns).items()}


def turns(
    contestants: Mapping[str, Timed], budget: float, least_turns: int, most_turns: int = 1000
) -> dict[str, list[float]]:
    """Return the seconds of every turn of contestants that take turns.

    Parameters
    ----------
    contestants : mapping of str to callable
        Each returns the seconds of one turn.
    budget : float
        Approximate time for each contestant, s. A slow contestant has `least_turns`.
    least_turns : int
        Least number of turns.
    most_turns : int, optional
        Largest number of turns.

    Returns
    -------
    dict of str to list of float
        Seconds of the turns of each contestant.

    Examples
    --------
    >>> turns({"one": lambda: 1.0, "two": lambda: 2.0}, 0.0, 2)
    {'one': [1.0, 1.0], 'two': [2.0, 2.0]}
    """
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
    """Times of one contestant by rounds, so that ratios compare times of the same period.

    Attributes
    ----------
    seconds : list of float
        Least time of the turns of each round, s.
    """

    seconds: list[float]

    @property
    def median(self) -> float:
        """Median of the rounds, s."""
        return statistics.median(self.seconds)

    @property
    def least(self) -> float:
        """Least time of all rounds, s."""
        return min(self.seconds)

    def ratios(self, other: Rounds) -> list[float]:
        """Return the times relative to another contestant, round by round.

        Parameters
        ----------
        other : Rounds
            The other contestant.

        Returns
        -------
        list of float
            This time over the other one.

        Examples
        --------
        >>> Rounds([2.0, 3.0]).ratios(Rounds([1.0, 2.0]))
        [2.0, 1.5]
        """
        return [a / b for a, b in zip(self.seconds, other.seconds, strict=True)]

    def ratio(self, other: Rounds) -> float:
        """Return the median time relative to another contestant.

        Parameters
        ----------
        other : Rounds
            The other contestant.

        Returns
        -------
        float
            Median of `ratios`.

        Examples
        --------
        >>> Rounds([2.0, 3.0]).ratio(Rounds([1.0, 2.0]))
        1.75
        """
        return statistics.median(self.ratios(other))


def in_rounds(contestants: Mapping[str, Timed], rounds: int = 9, batches: int = 1) -> dict[str, Rounds]:
    """Measure contestants that take turns, and keep the least time of each round.

    Parameters
    ----------
    contestants : mapping of str to callable
        Each returns the seconds of one turn.
    rounds : int, optional
        Number of rounds.
    batches : int, optional
        Turns of each contestant in a round.

    Returns
    -------
    dict of str to Rounds
        Times of each contestant.

    Examples
    --------
    >>> in_rounds({"one": lambda: 1.0}, rounds=2)["one"].seconds
    [1.0, 1.0]
    """
    found: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, times in turns(contestants, 0.0, batches, batches).items():
            found[name].append(min(times))
    return {name: Rounds(seconds) for name, seconds in found.items()}


def exponent(sizes: Sequence[int], seconds: Sequence[float]) -> float:
    """Return the exponent k of ``time ~ size^k``, by least squares of the logarithms.

    Parameters
    ----------
    sizes : sequence of int
        Sizes.
    seconds : sequence of float
        Times, s.

    Returns
    -------
    float
        k; NaN for fewer than two sizes.

    Examples
    --------
    >>> round(exponent([10, 100], [1.0, 10.0]), 12)
    1.0
    """
    if len(sizes) < 2:
        return math.nan
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def summary(seconds: Sequence[float]) -> Seconds:
    """Return the times of a contestant from its turns.

    Parameters
    ----------
    seconds : sequence of float
        Seconds of the turns.

    Returns
    -------
    Seconds
        Least, median and upper time.

    Examples
    --------
    >>> summary([1.0, 2.0, 4.0]).median
    2.0
    """
    n = len(seconds)
    return Seconds(min(seconds), statistics.median(seconds), sorted(seconds)[(9 * n - 1) // 10], n)


def cores() -> list[int]:
    """Return the processor cores that this process may use.

    Returns
    -------
    list of int
        Numbers of the cores; empty if the system does not report them.

    Examples
    --------
    >>> isinstance(cores(), list)
    True
    """
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []


@contextmanager
def one_core(core: int | None = None) -> Iterator[None]:
    """Keep this process on one core within a ``with`` statement, if the system can do that.

    Parameters
    ----------
    core : int, optional
        Number of the core. Default: the last of those allowed.

    Yields
    ------
    None
        Afterwards the process may use all its cores again.

    Examples
    --------
    >>> with one_core():
    ...     print(len(cores()) <= 1)
    True
    """
    allowed = cores()
    if not allowed:
        yield
        return
    os.sched_setaffinity(0, {allowed[-1] if core is None else core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
