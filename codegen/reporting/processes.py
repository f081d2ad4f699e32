"""Timing in several processes, one after another.

The addresses of code, stack and arrays are random for each process, and affect the times of all its calls. Other processes
disturb the measurement for seconds at a time. Times are reproducible only as a spread over several processes.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..ending import NUMBERS_FAILED, Failure
from ..measure.core import Core, Turn, record
from ..runtime import load
from . import integrating, times
from .integrating import Setting
from .states import State

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PROCESSES = 5

LONG = 0.2
"""Total seconds of a motion's turns after which no further process times this motion."""


class ProcessError(Failure, RuntimeError):
    """Raised if a timing process ends with an error."""

    code = NUMBERS_FAILED


def timed(
    core: Core, folder: Path, state: State | None, budget: float, moving: Path, settings: Sequence[tuple[Setting, Turn]],
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, dict[str, Any]]]:  # fmt: skip
    """Times of functions and motions, and the peak performance of the core.

    Parameters
    ----------
    core : Core
    folder : Path
        Folder of the package whose functions are timed.
    state : State, optional
        State of the evaluations; without it, functions are not timed.
    budget : float
        Approximate seconds for each function.
    moving : Path
        Folder of the package that is integrated.
    settings : sequence of (Setting, Turn)
        Settings of the motions, each with its time in the calling process, which counts as its first turn.
    progress : callable, optional
        Called with the number of finished processes and their total number.

    Returns
    -------
    dict
        See `times.times`; empty without a state.
    list of dict
        For each motion, see `record`.
    dict of str to dict
        Seconds per operation and per byte, see `Core.peaks` and `record`.

    Raises
    ------
    ProcessError
        With the output of the process.
    """
    functions: list[dict[str, Any]] = []
    taken = [[turn] for _, turn in settings]
    peaks: dict[str, list[Turn]] = {}
    for i in range(PROCESSES):
        progress(i, PROCESSES)
        wanted = [n for n, x in enumerate(taken) if i == 0 or sum(t.seconds for t in x) < LONG]
        motions = [settings[n][0] for n in wanted]
        found = _in_process(core.library, folder, state, budget / PROCESSES, moving, motions)
        functions += found["functions"]
        for n, turns in zip(wanted, found["motions"], strict=True):
            taken[n] += turns
        for name, turns in found["peaks"].items():
            peaks.setdefault(name, []).extend(turns)
    summed = times.times(functions) if functions else {}
    return summed, [record(x) for x in taken], {name: record(x) for name, x in peaks.items()}


def _in_process(*asked: Any) -> dict[str, Any]:
    """Run `_answer` in a new process, and return its result."""
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-m", __name__], input=pickle.dumps(asked), capture_output=True,
        env={**os.environ, "PYTHONPATH": paths}, check=False,
    )  # fmt: skip
    if done.returncode:
        why = done.stderr.decode(errors="replace")[-2000:]
        raise ProcessError(f"a timing process ended with exit code {done.returncode}: {why}")
    found: dict[str, Any] = pickle.loads(done.stdout)
    return found


def _answer(
    library: Path, folder: Path, state: State | None, budget: float, moving: Path, settings: Sequence[Setting]
) -> dict[str, Any]:
    """The measurements that one process makes."""
    core, solver = Core(library), load(folder)
    moved = solver if moving == folder else load(moving)
    found: dict[str, Any] = {"functions": [], "peaks": {}}
    with core.fastest():
        if state is not None:
            found["functions"] = [times.turns(solver, state, budget, core)]
            found["peaks"] = core.peaks()
        found["motions"] = [integrating.turns(moved, x, core) for x in settings]
    return found


if __name__ == "__main__":
    pickle.dump(_answer(*pickle.load(sys.stdin.buffer)), sys.stdout.buffer)
