"""Data sent to the workers of a sweep: a solver, a measure and cases; rows are sent back."""

from __future__ import annotations

import functools
import pickle
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from ..runtime.standalone.calls.threads import one_thread
from ..runtime.standalone.warning import OURS
from .failures import FAILURES
from .sweep_cases import Case, flattened
from .sweep_journal import Row


class Bearer:
    """A solver that is opened only once in each process, whatever the number of tasks.

    Parameters
    ----------
    solver : Solver
    """

    def __init__(self, solver: Any):
        self.solver = solver
        self._packed = b""

    def __reduce__(self) -> tuple[Callable[[bytes], Bearer], tuple[bytes]]:
        self._packed = self._packed or pickle.dumps(self.solver)
        return _opened, (self._packed,)


@functools.lru_cache(maxsize=4)
def _opened(packed: bytes) -> Bearer:
    return Bearer(pickle.loads(packed))


@one_thread()
def run(bearer: Bearer, measure: Callable[[Any, Case], Any], cases: Sequence[Case]) -> list[tuple[Row, bool]]:
    """Measure cases one after the other; errors of the measure are recorded.

    Returns
    -------
    list of (Row, bool)
        Each row, and whether its failure concerns this case only, such as a mechanism that cannot be assembled.
    """
    rows = []
    for case in cases:
        of_case, place = True, ""
        try:
            measured = measure(bearer.solver, dict(case))
            of_case = False
            row = Row(case, flattened(measured), None)
            of_case = True
        except Exception as error:
            if of_case and not isinstance(error, FAILURES):
                of_case, place = False, f" ({_place(error)})"
            # the text is sent, since not every class of errors can be pickled
            row = Row(case, None, f"{type(error).__name__}: {' '.join(str(error).split())}{place}")
        rows.append((row, of_case))
    return rows


def _place(error: Exception) -> str:
    """The innermost line of the measure, or of a function it calls that is neither installed nor part of ordernm."""
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first frame is that of `run`
    own = [f for f in frames if "site-packages" not in f.filename and not f.filename.startswith(OURS)]
    innermost = (own or frames or traceback.extract_tb(error.__traceback__))[-1]
    return f"{innermost.filename}, line {innermost.lineno}"


__all__ = ["Bearer", "run"]
