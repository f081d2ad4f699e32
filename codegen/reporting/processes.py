"""Times of several processes, one after another.

Where a process has its code, its stack and its arrays is chance, and all its calls share what that costs or saves; what others do
on the machine goes on for seconds. A spread that another run of the same report is to meet is that of processes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..bench.timing import summary
from ..runtime import load
from . import integrating, times
from .integrating import Setting
from .states import State

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PROCESSES = 5

LONG = 0.2
"""A motion that has taken so many seconds is timed no more, but for once by the first process."""


def timed(
    folder: Path, state: State | None, budget: float, moving: Path, settings: Sequence[tuple[Setting, float]],
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[dict[str, Any], list[dict[str, float]]]:  # fmt: skip
    """Times of functions and of motions.

    Parameters
    ----------
    folder : Path
        Of the package whose functions are timed.
    state : State, optional
        Where; without one functions are not timed.
    budget : float
        Seconds for each function, about.
    moving : Path
        Of the package that is integrated.
    settings : sequence of (Setting, float)
        Of the motions, and the seconds that each has taken in this process.
    progress : callable, optional
        Called with how many processes have ended, and of how many.

    Returns
    -------
    dict
        See `times.times`; empty without a state.
    list of dict
        For each motion ``seconds``, the least, and ``seconds_high``; nine of ten took no longer.

    Raises
    ------
    RuntimeError
        A process ended with an error; it holds what it printed.
    """
    functions: list[dict[str, Any]] = []
    taken = [[seconds] for _, seconds in settings]
    for i in range(PROCESSES):
        progress(i, PROCESSES)
        wanted = [n for n, x in enumerate(taken) if i == 0 or sum(x) < LONG]
        found = _in_process(
            {
                "folder": str(folder),
                "state": asdict(state) if state else None,
                "budget": budget / PROCESSES,
                "moving": str(moving),
                "settings": [asdict(settings[n][0]) for n in wanted],
            }
        )
        functions += found["functions"]
        for n, seconds in zip(wanted, found["motions"], strict=True):
            taken[n] += seconds
    records = [summary(x) for x in taken]
    return times.times(functions) if functions else {}, [{"seconds": x.least, "seconds_high": x.high} for x in records]


def _in_process(wanted: dict[str, Any]) -> dict[str, Any]:
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-m", __name__], input=json.dumps(wanted, default=lambda x: x.tolist()), capture_output=True,
        text=True, env={**os.environ, "PYTHONPATH": paths}, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"a process that takes times ended with {done.returncode}: {done.stderr[-2000:]}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _answer(wanted: dict[str, Any]) -> dict[str, Any]:
    """What one process measures."""
    solver = load(wanted["folder"])
    moving = solver if wanted["moving"] == wanted["folder"] else load(wanted["moving"])
    return {
        "functions": [times.turns(solver, State.of(wanted["state"]), wanted["budget"])] if wanted["state"] else [],
        "motions": [integrating.seconds(moving, Setting(**x)) for x in wanted["settings"]],
    }


if __name__ == "__main__":
    json.dump(_answer(json.load(sys.stdin)), sys.stdout)
