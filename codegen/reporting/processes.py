"""Times of several processes, one after another.

Where a process has its code, its stack and its arrays is chance, and all its calls share what that costs or saves; what others do
on the machine goes on for seconds. A spread that another run of the same report is to meet is that of processes.
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
"""Seconds after which a motion is timed no more, except once by the first process."""


class ProcessError(Failure, RuntimeError):
    """A process that takes times ended with an error."""

    code = NUMBERS_FAILED


def timed(
    core: Core, folder: Path, state: State | None, budget: float, moving: Path, settings: Sequence[tuple[Setting, Turn]],
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, dict[str, Any]]]:  # fmt: skip
    """Times of functions and of motions, and what the core does at best.

    Parameters
    ----------
    core : Core
    folder : Path
        Of the package whose functions are timed.
    state : State, optional
        Where; without one functions are not timed.
    budget : float
        Seconds for each function, about.
    moving : Path
        Of the package that is integrated.
    settings : sequence of (Setting, Turn)
        Of the motions, and what each has taken in this process.
    progress : callable, optional
        Called with how many processes have ended, and of how many.

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
        It holds what the process printed.
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
    """`_answer` of a process of its own."""
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-m", __name__], input=pickle.dumps(asked), capture_output=True,
        env={**os.environ, "PYTHONPATH": paths}, check=False,
    )  # fmt: skip
    if done.returncode:
        why = done.stderr.decode(errors="replace")[-2000:]
        raise ProcessError(f"a process that takes times ended with {done.returncode}: {why}")
    found: dict[str, Any] = pickle.loads(done.stdout)
    return found


def _answer(
    library: Path, folder: Path, state: State | None, budget: float, moving: Path, settings: Sequence[Setting]
) -> dict[str, Any]:
    """What one process measures."""
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
