"""Sweeps: many designs on any number of workers, such as threads, processes or clusters; results survive interruptions."""

from __future__ import annotations

import functools
import os
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from typing import Any

from ..runtime.standalone.calls.threads import processors
from ..runtime.standalone.warning import warn
from ..terminal import with_status
from .given_solver import check_given
from .sweep_cases import Case, key, listed
from .sweep_journal import Journal, Row
from .sweep_result import Sweep
from .sweep_tasks import Bearer, run

TASKS, LARGEST = 200, 50
"""Approximate number of tasks into which the cases are divided, and largest number of cases in a task."""

AHEAD = 64
"""Number of tasks that are submitted to an executor at a time."""

FEWER = 8
"""Factor by which groups of tasks become smaller when they are repeated because the executor broke, until the faulty
task is alone."""

NO_EXECUTOR = "executor is {!r}, expected one of concurrent.futures, or a callable that returns one"

LOST = ("KilledWorker",)
"""Errors of Dask for a lost worker, after which Dask continues."""

IN_VAIN = 3
"""The sweep ends early after this number of successive executors that died on a single case and gave no result."""

SAME_ERROR = 8
"""A sweep is given up after this number of cases that all fail by errors in the measure."""


@with_status("measuring cases")
def sweep(
    solver: Any, cases: Any, measure: Callable[[Any, Case], Any],
    executor: Executor | Callable[[], Executor] | None = None, *,
    journal: str | os.PathLike[str] | None = None, chunk: int | None = None, progress: Callable[[int, int], None] | None = None,
    retry_failed: bool = False,
) -> Sweep:  # fmt: skip
    """Measure many cases of a model, with any executor.

    Parameters
    ----------
    solver : Solver
        The model.
    cases : iterable of mappings, mapping of str to value or array_like (n,), or pandas.DataFrame
        Cases: names with numbers, words or truth values. `measure` interprets them. Equal cases are measured once.
    measure : callable
        ``measure(solver, case)`` returns a mapping of names to numbers, words, truth values or arrays of them, a few
        kilobytes at most. For processes it has to be a function of a module that the workers can import.
    executor : concurrent.futures.Executor, or callable that makes one, optional
        Default: as many threads as processors. A given executor stays open. An executor from a callable, such as
        ``functools.partial(ProcessPoolExecutor, 8)``, is closed at the end, and replaced if it dies. Workers open the
        solver's package by its path.
    journal : path, optional
        File that records every computed case at once. Cases in an existing journal are not computed again;
        `Sweep.from_journal` counts them. A journal belongs to one package and one measure: the code of the measure,
        variables that it closes over, and functions and values of modules that are not installed are compared.
        Installed packages, and files and variables that the measure reads or changes, are not compared.
    chunk : int, optional
        Number of cases that are sent together. Default: the cases in 200 parts, at most 50 together.
    progress : callable, optional
        Called as ``progress(done, n)``. A KeyboardInterrupt in it ends the sweep; the results so far are returned.
    retry_failed : bool, optional
        Compute cases again that failed according to the journal.

    Returns
    -------
    Sweep
        Results in the order of the cases. A case whose measure raises an error is recorded in ``failures``, and so is a
        case that ends its process if `executor` is a callable. If a given executor dies, the sweep ends with a warning
        and ``left`` lists the cases that were not computed.

    Raises
    ------
    TypeError
        If cases, or results of the measure, are of other kinds or cannot be sent to other processes.
    ValueError
        If an argument has a wrong value.
    SweepJournalError
        If the journal belongs to another package or measure, or is damaged.
    OSError
        If the journal cannot be read or written.
    RuntimeError
        If the first eight cases, or all, failed by errors in the measure, so that no case was measured.

    Examples
    --------
    >>> def measure(solver, case):
    ...     return {"reach": solver.simulate(1.0, p=case)["tip_x"].max()}
    >>> found = ordernm.sweep(solver, {"length_1": [0.8, 1.0, 1.2]}, measure)
    >>> found["reach"].round(3)
    array([1.331, 1.423, 1.471])
    """
    # long: the docstring describes every argument and result
    if not callable(measure):
        raise TypeError(f"measure is {type(measure).__name__}, expected a function of the solver and a case")
    check_given(solver)
    if chunk is not None and (not isinstance(chunk, int) or chunk < 1):
        raise ValueError(f"chunk is {chunk!r}, expected a number of cases from 1 on")
    if executor is not None and not callable(executor) and not hasattr(executor, "submit"):
        raise TypeError(NO_EXECUTOR.format(executor))
    wanted = listed(cases)
    keys = [key(case) for case in wanted]
    book = None if journal is None else Journal(journal, solver, measure)
    try:
        known = {} if book is None else {k: book.rows[k] for k in keys if k in book.rows}
        if retry_failed:
            known = {k: row for k, row in known.items() if row.failure is None}
        from_journal = sum(k in known for k in keys)
        todo = {k: case for k, case in zip(keys, wanted, strict=True) if k not in known}
        crew = _Crew(solver, measure, todo, known, book, progress)
        try:
            crew.work(executor, chunk)
        except KeyboardInterrupt:
            crew.cancel()
    finally:
        if book is not None:
            book.close()
    rows = [known.get(k) for k in keys]
    return Sweep(
        wanted,
        [None if row is None else row.values for row in rows],
        {i: row.failure for i, row in enumerate(rows) if row is not None and row.failure is not None},
        [i for i, row in enumerate(rows) if row is None],
        from_journal,
    )


def _lost_by_dask(why: BaseException) -> bool:
    """Whether Dask lost a task with its worker; Dask may also fail to unpack the error."""
    tb = why.__traceback__
    while tb is not None and tb.tb_next is not None:
        tb = tb.tb_next
    unpacking = tb is not None and tb.tb_frame.f_globals.get("__name__") == "distributed.cfexecutor"
    return type(why).__name__ in LOST or (isinstance(why, ValueError) and unpacking)


class _Crew:
    """Sends cases to workers and collects their rows in `known`."""

    def __init__(
        self, solver: Any, measure: Any, cases: dict[str, Case], known: dict[str, Row], book: Journal | None,
        progress: Callable[[int, int], None] | None,
    ):  # fmt: skip
        self.bearer, self.measure = Bearer(solver), measure
        self.cases, self.known, self.book, self.progress = cases, known, book, progress
        self.n = len(cases) + len(known)
        self.waiting: deque[list[str]] = deque()
        self.flying: dict[Future[Any], list[str]] = {}
        self.ahead, self.suspects = AHEAD, set[str]()
        self.in_vain = 0
        self.wrong: dict[str, Row] | None = None if any(row.failure is None for row in known.values()) else {}

    def work(self, executor: Any, chunk: int | None) -> None:
        """Continue until every case is known or the executor has ended."""
        size = chunk or max(1, min(LARGEST, -(-len(self.cases) // TASKS)))
        todo = list(self.cases)
        self.waiting.extend(todo[i : i + size] for i in range(0, len(todo), size))
        self._tell()
        given = hasattr(executor, "submit") and not isinstance(executor, type)
        make = executor or functools.partial(ThreadPoolExecutor, processors())
        while self.waiting:
            pool = executor if given else make()
            if not hasattr(pool, "submit"):
                raise TypeError(
                    f"executor is {pool!r}, expected one of concurrent.futures, or a callable that returns one"
                )
            try:
                died = self._serve(pool)
            finally:
                if not given:
                    pool.shutdown(wait=True, cancel_futures=True)
            if died is not None and self.waiting and (given or self.in_vain >= IN_VAIN):
                why = f"{type(died).__name__}: {died}" if str(died) else type(died).__name__
                warn(
                    f"the sweep ended early because its executor died ({why}). It has results for {len(self.known)} of {self.n} "
                    f"cases; `left` lists the others. Use a journal to compute them later, or pass the executor as a callable, "
                    f"which replaces it when it dies"
                )
                return

    def cancel(self) -> None:
        """Cancel all tasks that have not begun."""
        for future in self.flying:
            future.cancel()

    def _serve(self, pool: Executor) -> BaseException | None:
        """Send tasks and collect results until nothing is left or the executor ends; return the error that ended it."""
        died: BaseException | None = None
        lost: list[list[str]] = []
        while self.flying or (self.waiting and died is None):
            while self.waiting and died is None and len(self.flying) < self.ahead:
                part = self.waiting.popleft()
                try:
                    future = pool.submit(run, self.bearer, self.measure, [self.cases[k] for k in part])
                except RuntimeError as error:  # BrokenExecutor, or an executor that was shut down
                    self.waiting.appendleft(part)
                    died = error
                else:
                    self.flying[future] = part
            for future in wait(self.flying, return_when=FIRST_COMPLETED).done:
                part = self.flying.pop(future)
                why = CancelledError() if future.cancelled() else future.exception()
                if why is None:
                    self._take(dict(zip(part, future.result(), strict=True)))
                elif isinstance(why, (BrokenExecutor, CancelledError)):
                    died = died or why
                    lost.append(part)
                elif _lost_by_dask(why):
                    self._lost_alone(part)
                else:
                    raise TypeError(
                        f"cases could not be sent to the executor's workers, or results could not be sent back: "
                        f"{type(why).__name__}: {why}. For processes, "
                        f"measure must be a function of a module that the workers can import"
                    ) from why
        if lost:
            self._fewer(lost)
        return died

    def _take(self, came: Mapping[str, tuple[Row, bool]]) -> None:
        """Keep the rows of a task. As long as the measure has failed in every case, rows are collected in `wrong` instead;
        after `SAME_ERROR` of them, an error is raised."""
        rows = {k: row for k, (row, _) in came.items()}
        if self.wrong is not None:
            self.wrong |= rows
            if any(of_case for _, of_case in came.values()):
                rows, self.wrong = self.wrong, None
            elif len(self.wrong) < min(len(self.cases), SAME_ERROR):
                return
            else:
                first = next(iter(self.wrong.values()))
                raise RuntimeError(
                    f"the measure failed in all {len(self.wrong)} cases so far. The first was {first.case}: {first.failure}"
                )
        self._keep(rows)

    def _keep(self, rows: dict[str, Row]) -> None:
        if self.book is not None:
            self.book.add(list(rows.values()))
        self.known |= rows
        self.in_vain = 0
        self.suspects -= rows.keys()
        if not self.suspects:
            self.ahead = AHEAD
        self._tell()

    def _fewer(self, lost: list[list[str]]) -> None:
        """After an executor ended: repeat its cases in smaller groups; a case that ran alone is recorded as the
        cause."""
        if len(lost) == 1 and len(lost[0]) == 1:
            self._lost_alone(lost[0])
            self.in_vain += 1
            return
        parts = [[k] for part in lost for k in part] if self.ahead == 1 else lost
        self.waiting.extendleft(reversed(parts))
        self.suspects.update(k for part in lost for k in part)
        self.ahead = max(1, self.ahead // FEWER)

    def _lost_alone(self, part: list[str]) -> None:
        """Repeats, one by one, the cases of a task that ended its worker, or records its only case as the cause."""
        if len(part) > 1:
            self.waiting.extendleft([k] for k in reversed(part))
            return
        before = self.in_vain
        self._keep({part[0]: Row(self.cases[part[0]], None, "the process that computed it ended")})
        self.in_vain = before

    def _tell(self) -> None:
        if self.progress is not None:
            self.progress(len(self.known), self.n)


__all__ = ["Sweep", "sweep"]
