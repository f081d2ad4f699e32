"""Batches: several states at once in the lanes of vectors, against the same states by a call of each.

    python benchmarks/batches.py [--rounds 5] [--instructions avx2] [--threads N]

Each row names its number of threads and its clock. One thread: CPU time, since a call that is longer than a time slice of a busy
machine waits for other processes every time. Several threads: the wall clock. Without `--threads`, their number is the one that a
solver chooses by default.

In C: a loop of calls, `NAME_accelerations_states` and `NAME_sensitivities_states`, and both by `NAME_on_threads`. From Python:
the solver's methods, with directions first, which allocate their results. All but the first two make twenty calls in a row.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import codegen
from codegen.measure.accuracy import largest
from codegen.measure.clock import elapsed, in_rounds
from codegen.measure.compiled import INSTRUCTIONS, Contestant, Functions, add_options, workshop
from codegen.measure.models import example, sized
from codegen.measure.tables import markdown
from codegen.model import Model
from codegen.pipeline import Source, write_solver
from codegen.runtime.standalone.calls import batches

STATES = 4096
DIRECTIONS = 8
ASKED = ("accelerations", "sensitivities")
TURNS = 20
"""Calls of a batch, one after the other, before the other way has its turn."""

LOOP = """\
#include "{name}.h"
static void run(double **a)
{{
    for (long s = 0; s < {states}; ++s)
        {name}_{symbol}({passed});
}}
"""

AT_ONCE = """\
#include "{name}.h"
static void run(double **a)
{{
    {name}_states b = {{.count = {states}, .directions = {directions}, {members}}};
    {name}_{function}_states(&b);
}}
"""


def contestants(source: Source, model: Model, function: str) -> list[Contestant]:
    """A loop of calls, and several states at once, on the same arrays: parameters are one for all, directions last."""
    name, f = model.name, source.manifest["functions"][function]
    functions, seeds, rng = Functions.of(source), f.get("seeds", []), np.random.default_rng(1)
    sizes = functions.sizes()
    width = DIRECTIONS if seeds else 1
    arrays, passed, members = [], [], []
    for i, a in enumerate((*f["arguments"], *seeds, *f["results"])):
        lanes = width if a.startswith("d") else 1
        entries, shared = sizes[a] * lanes, a in ("p", "dp")
        x = rng.uniform(-1.0, 1.0, (1 if shared else STATES, entries))
        arrays.append(np.array([list(model.defaults.values())]) if a == "p" else x)
        step = 0 if shared else entries
        passed.append(f"a[{i}] + s*{step}")
        members.append(f".{a} = {{a[{i}], {step}, 1, {lanes}}}")
    work = max(source.manifest["workspace"], source.manifest["over_states"]["workspace"])
    place = f"a[{len(arrays)}]"
    symbol = f"{function}_{width}" if seeds else function
    one = LOOP.format(name=name, states=STATES, symbol=symbol, passed=", ".join([*passed, place]))
    several = AT_ONCE.format(
        name=name, states=STATES, function=function, directions=width, members=", ".join([*members, f".work = {place}"])
    )
    files = {**functions.files} | {f"{name}_states.c": source.files[f"{name}_states.c"]}
    arrays.append(np.zeros(work))
    return [
        Contestant(f"{kind} {function} {name}", files, text, "run(a)", arrays, ("-O2", "-O3"))
        for kind, text in (("one", one), ("several", several))
    ]


class Way(NamedTuple):
    """A way to compute a batch: on how many threads, and the seconds that it takes."""

    name: str
    threads: int
    seconds: float


def of_python(model: Model, folder: Path, threads: int | None, rounds: int) -> list[list[Way]]:
    """A batch as Python calls it, for each function: one state after the other, several at once, on threads."""
    codegen.generate(model, folder / model.name, functions=ASKED, check=False)
    solvers: dict[str, Any] = {}
    for kind, of in (("state after state", 1), ("several at once", 1), ("on threads", threads)):
        solvers[kind] = codegen.load(folder / model.name)
        solvers[kind].batch_threads = of
    solvers["state after state"]._target.batches.takes = lambda *_: False
    rng = np.random.default_rng(2)
    q, u = (rng.uniform(-1.0, 1.0, (STATES, n)) for n in (model.nq, model.nu))
    dq, du = (rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, n)) for n in (model.nq, model.nu))
    found = []
    for function, seeds in zip(ASKED, ({}, {"dq": dq, "du": du}), strict=True):
        counts = {kind: threads_of(solver, function) for kind, solver in solvers.items()}
        calls = {kind: partial(getattr(solver, function), q, u, **seeds) for kind, solver in solvers.items()}
        times = least({kind: [call] * TURNS for kind, call in calls.items()}, counts, rounds)
        found.append([Way(f"Python, {kind}", counts[kind], seconds) for kind, seconds in times.items()])
    return found


def threads_of(solver: Any, function: str) -> int:
    """On how many threads a solver computes the batch."""
    f = solver._functions[function]
    return int(solver._target.batches.threads(f, STATES, DIRECTIONS if f.seeds else 0, True))


def least(calls: dict[str, list[Callable[[], object]]], threads: dict[str, int], rounds: int) -> dict[str, float]:
    """The least time of a call, by CPU time for one thread and wall time for several; calls in a list share a turn."""

    def turn(kind: str) -> float:
        return min(elapsed(call, clock=clock_of(threads[kind]))() for call in calls[kind])

    return {kind: x.least for kind, x in in_rounds({kind: partial(turn, kind) for kind in calls}, rounds).items()}


def clock_of(threads: int) -> Callable[[], float]:
    """CPU time of the thread if there is one, else the wall clock."""
    return time.thread_time if threads == 1 else time.perf_counter


def in_c_on_threads(model: Model, folder: Path, sizes: dict[str, int], threads: int | None, rounds: int) -> list[Way]:
    """A batch in C on threads, for each function."""
    solver: Any = codegen.load(folder)
    solver.batch_threads = threads
    rng = np.random.default_rng(3)
    q, u = (rng.uniform(-1.0, 1.0, (STATES, n)) for n in (model.nq, model.nu))
    solver.accelerations(q, u)  # what is called below is compiled and opened
    solver.sensitivities(q, u, dq=rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, model.nq)))
    over, found = solver._target.batches, []
    for function in ASKED:
        count = threads_of(solver, function)
        b = over._ffi.new("states *", {"count": STATES, "directions": DIRECTIONS})
        kept = [np.empty(count * over._over_states["workspace"])]
        b.work = solver._target.pointer(kept[0])
        for name in over._over_states["arrays"]:
            lanes = DIRECTIONS if name.startswith("d") else 1
            shared, entries = name in ("p", "dp"), sizes[name] * lanes
            array = rng.uniform(-1.0, 1.0, (1 if shared else STATES, entries))
            kept.append(np.array([list(model.defaults.values())]) if name == "p" else array)
            setattr(b, name, (solver._target.pointer(kept[-1]), 0 if shared else entries, 1, lanes))
        call = over._several[f"{model.name}_{function}_states"]
        on_threads = partial(over._shared(), call, b, count)
        seconds = least({"": [on_threads] * TURNS}, {"": count}, rounds)[""]
        found.append(Way("C, on threads", count, seconds))
    return found


def check(a: dict[Any, np.ndarray], b: dict[Any, np.ndarray]) -> None:
    """Compare what contestants have found, number by number; the last array is the workspace."""
    for x, y in list(zip(a.values(), b.values(), strict=True))[:-1]:
        if not np.allclose(x, y, rtol=1e-9, atol=1e-9 * (1.0 + largest(x))):
            raise ValueError("several states at once give other numbers")


def rows_of(model: Model, folder: Path, options: argparse.Namespace) -> list[list[str]]:
    """Rows of a model, one for each function and way."""
    source, shop, rows = write_solver(model, functions=ASKED), workshop(options), []
    python = of_python(model, folder, options.threads, 2 * options.rounds)
    sizes = Functions.of(source).sizes()
    shared = in_c_on_threads(model, folder / model.name, sizes, options.threads, 4 * options.rounds)
    for function, from_python, on_threads in zip(ASKED, python, shared, strict=True):
        one, several = shop.compete(contestants(source, model, function), options.rounds, options.batches).values()
        check(one.variant.arrays, several.variant.arrays)
        along = f" + {DIRECTIONS}" if function == "sensitivities" else ""
        ways = [
            Way("C, a loop of calls", 1, one.median),
            Way("C, several at once", 1, several.median),
            on_threads,
            *from_python,
        ]
        rows += [
            [f"{model.name}, {model.nu} joints, udot{along}", way.name, str(way.threads), "CPU" if way.threads == 1 else "wall",
             f"{way.seconds / STATES * 1e9:.0f}", f"{way.seconds / one.median:.2f}"]
            for way in ways
        ]  # fmt: skip
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int)
    add_options(parser, 5, 5)
    options = parser.parse_args()
    if options.instructions != "native":
        os.environ["ORDERNM_CFLAGS"] = " ".join(["-O2", "-march=native", *INSTRUCTIONS[options.instructions]])
    batches.WORTH_COMPILING = 0
    with tempfile.TemporaryDirectory() as folder:
        models = [sized("CHAIN", 12).model, codegen.parse_model(example("arm"))]
        rows = [row for model in models for row in rows_of(model, Path(folder), options)]
    print(f"{workshop(options).widest}, {STATES} states. C on one thread: median over the rounds, best of -O2 and -O3.")
    print("Others: least of all turns.\n")
    print(markdown(["batch", "way", "threads", "clock", "ns per state", "of calls in C"], rows))


if __name__ == "__main__":
    main()
