"""Times of generated functions: of single calls from Python, and per state of a batch, for the C code alone."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..measure.clock import calibrated, elapsed, summary
from ..measure.clock import turns as alternating
from ..measure.core import FIXED_WORK, Core, Watched, record
from .states import State

if TYPE_CHECKING:
    from ..runtime import Solver

Function = Callable[..., object]

DIRECTIONS = (1, 8)
"""Numbers of directions of the sensitivities that are timed."""

BATCHES = (1, 16, 256, 4096)

LARGEST = 16e6
"""Largest size of the results of a batch, bytes."""

BATCH = 2048
"""Number of states in a batch for comparing functions; it is reduced if the results would be too large."""

LONG, LEAST_BATCH = 0.03, 64
"""Approximate longest duration of a call with a batch, s: a slow function gets fewer states, but at least `LEAST_BATCH`."""


def turns(solver: Solver, state: State, budget: float, core: Core) -> dict[str, Any]:
    """Seconds per evaluation of all functions in turns, in this process.

    Parameters
    ----------
    solver : Solver
    state : State
        Central state of the batches.
    budget : float
        Approximate seconds for each function.
    core : Core

    Returns
    -------
    dict
        ``counts``, by function, and ``sizes``: numbers of states of the batches; ``turns``: lists of `Turn`, by function or
        size, and "call", "compiled" or "batch".
    """
    rng = np.random.default_rng(4)
    runs: dict[str, Callable[[], object]] = {}
    counts: dict[str, int] = {}

    def into_its_results(function: Function, at: tuple[Any, ...]) -> Callable[[], object]:
        """Repeat the call with the same output arrays; new arrays would cost varying numbers of page faults."""
        return partial(function, at, function(at))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for name, columns, function in _functions(solver, rng):
            one = _states(state, 1)
            n = max(
                1,
                min(BATCH, int(LARGEST / (8 * max(solver.nu, 1) * max(columns, 1))), _in_time(partial(function, one))),
            )
            counts[name] = n
            many = _states(state, n)
            runs[f"{name} call"] = partial(function, one)
            runs[f"{name} compiled"] = into_its_results(function, many)
        sizes = [n for n in BATCHES if 8 * n * (solver.nq + 2 * solver.nu) <= LARGEST]
        for n in sizes:
            many = _states(state, n)
            runs[f"batch {n}"] = into_its_results(lambda at, out=None: solver.accelerations(*at, out=out), many)
        watched = {name: Watched(calibrated(run), core) for name, run in runs.items()}
        alternating(watched, budget, least_turns=1)
    states = {f"{name} compiled": n for name, n in counts.items()} | {f"batch {n}": n for n in sizes}
    return {
        "counts": counts,
        "sizes": sizes,
        "turns": {
            name: [replace(turn, seconds=turn.seconds / states.get(name, 1)) for turn in x.turns]
            for name, x in watched.items()
        },
    }


def times(taken: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Seconds per evaluation, from the turns of several processes.

    Returns
    -------
    dict
        ``functions``: for each, records for ``compiled`` (per state of a batch) and ``call`` (a single call from Python), see
        `record`; ``batches``: accelerations by batch size; ``core``, ``cache``: the fixed work beside all of them.
    """

    def of(name: str) -> dict[str, Any]:
        return record(turn for process in taken for turn in process["turns"][name])

    all_turns = [t for process in taken for turns in process["turns"].values() for t in turns]

    return {
        "functions": {
            name: {"compiled": of(f"{name} compiled"), "call": of(f"{name} call"), "states": n}
            for name, n in taken[0]["counts"].items()
        },
        "batches": {str(n): of(f"batch {n}") for n in taken[0]["sizes"]},
        **{name: asdict(summary([getattr(t, name) for t in all_turns])) for name in FIXED_WORK},
    }


def _in_time(call: Callable[[], object]) -> int:
    """Number of states for which a call takes `LONG`, estimated from the time of a single call."""
    call()  # compiles and loads the function
    return max(LEAST_BATCH, int(LONG / max(elapsed(call, clock=time.thread_time)(), 1e-9)))


def _states(state: State, n: int) -> tuple[Any, ...]:
    """The state, repeated n times with slightly different speeds; for n = 1 there is no batch axis."""
    if n == 1:
        return state.q, state.u, None, state.inputs, state.t
    scale = 1 + 1e-3 * np.linspace(-1, 1, n)[:, None]
    return np.tile(state.q, (n, 1)), state.u * scale, None, state.inputs, state.t


def _functions(solver: Solver, rng: np.random.Generator) -> list[tuple[str, int, Function]]:
    """Name, number of result columns, and a function of a state and, optionally, output arrays."""
    found: list[tuple[str, int, Function]] = [("udot", 1, lambda at, out=None: solver.accelerations(*at, out=out))]
    for k in DIRECTIONS:
        seeds = {"dq": rng.normal(size=(k, solver.nq)), "du": rng.normal(size=(k, solver.nu)),
                 "dp": rng.normal(size=(k, solver.np))}  # fmt: skip

        def along(at: tuple[Any, ...], out: Any = None, seeds: dict[str, Any] = seeds) -> object:
            batch = np.shape(at[0])[:-1]
            ones = (1,) * len(batch)
            return solver.sensitivities(*at, **{n: x.reshape(len(x), *ones, -1) for n, x in seeds.items()}, out=out)

        found.append((f"udot + {k} direction{'s' if k > 1 else ''}", k, along))
    found.append(("Jacobians", solver.nq + solver.nu + solver.np + solver.ninputs + 1,
                  lambda at, out=None: solver.jacobians(*at, out=out)))  # fmt: skip
    weights = rng.normal(size=solver.nu)

    def gradient(at: tuple[Any, ...], _: Any = None) -> object:
        batch = np.shape(at[0])[:-1]
        return solver.gradients(*at, weights=weights.reshape(1, *(1,) * len(batch), -1))

    found.append(("gradient", 2, gradient))
    if solver.output_names:
        found.append(("outputs", 1, lambda at, out=None: solver.outputs(*at, out=out)))
    return found
