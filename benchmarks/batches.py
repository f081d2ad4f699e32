"""Batches: several states at once in the lanes of vectors, against the same states by a call of each.

    python benchmarks/batches.py [--rounds 5] [--instructions avx2] [--threads 2]

First in C, on one core: a loop of calls, against `NAME_accelerations_states` and `NAME_sensitivities_states`, by CPU time. Then
these on one thread and on several with `NAME_on_threads`, by the wall clock, twenty calls of each in turns: caches are then those
of the one or of the other. Last a batch as Python calls it, by the wall clock, with directions first.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

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
"""Calls of a batch in C, one after the other, before the other way has its turn."""

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


def of_python(model: Model, folder: Path, threads: int, rounds: int) -> list[dict[str, float]]:
    """Seconds of a batch by the wall clock, for each function: one state after the other, several at once, on threads."""
    codegen.generate(model, folder / model.name, functions=ASKED, check=False)
    solvers: dict[str, Any] = {}
    for kind, of in (("one", 1), ("several", 1), ("threads", threads)):
        solvers[kind] = codegen.load(folder / model.name)
        solvers[kind].batch_threads = of
    solvers["one"]._target.batches.takes = lambda *_: False
    rng = np.random.default_rng(2)
    q, u = (rng.uniform(-1.0, 1.0, (STATES, n)) for n in (model.nq, model.nu))
    dq, du = (rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, n)) for n in (model.nq, model.nu))
    found = []
    for function, seeds in zip(ASKED, ({}, {"dq": dq, "du": du}), strict=True):
        calls = {kind: partial(getattr(solver, function), q, u, **seeds) for kind, solver in solvers.items()}
        found.append(least({kind: [call] for kind, call in calls.items()}, rounds))
    return found


def least(calls: dict[str, list[Callable[[], object]]], rounds: int) -> dict[str, float]:
    """The least wall time of a call; those in a list come one after the other within a turn."""
    turns = {kind: lambda several=several: min(elapsed(call)() for call in several) for kind, several in calls.items()}
    return {kind: x.least for kind, x in in_rounds(turns, rounds).items()}


def in_c_on_threads(
    model: Model, folder: Path, sizes: dict[str, int], threads: int, rounds: int
) -> list[dict[str, float]]:
    """Seconds of a batch in C by the wall clock, for each function: on one thread, and on several."""
    solver: Any = codegen.load(folder)
    solver.batch_threads = threads
    rng = np.random.default_rng(3)
    q, u = (rng.uniform(-1.0, 1.0, (STATES, n)) for n in (model.nq, model.nu))
    solver.accelerations(q, u)  # what is called below is compiled and opened
    solver.sensitivities(q, u, dq=rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, model.nq)))
    over, found = solver._target.batches, []
    for function in ASKED:
        b = over._ffi.new("states *", {"count": STATES, "directions": DIRECTIONS})
        kept = [np.empty(threads * over._over_states["workspace"])]
        b.work = solver._target.pointer(kept[0])
        for name in over._over_states["arrays"]:
            lanes = DIRECTIONS if name.startswith("d") else 1
            shared, entries = name in ("p", "dp"), sizes[name] * lanes
            array = rng.uniform(-1.0, 1.0, (1 if shared else STATES, entries))
            kept.append(np.array([list(model.defaults.values())]) if name == "p" else array)
            setattr(b, name, (solver._target.pointer(kept[-1]), 0 if shared else entries, 1, lanes))
        call = over._several[f"{model.name}_{function}_states"]
        ways = {"one": partial(call, b), "threads": partial(over._shared(), call, b, threads)}
        found.append(least({kind: [way] * TURNS for kind, way in ways.items()}, rounds))
    return found


def check(a: dict[Any, np.ndarray], b: dict[Any, np.ndarray]) -> None:
    """Compare what contestants have found, number by number; the last array is the workspace."""
    for x, y in list(zip(a.values(), b.values(), strict=True))[:-1]:
        if not np.allclose(x, y, rtol=1e-9, atol=1e-9 * (1.0 + largest(x))):
            raise ValueError("several states at once give other numbers")


def ns(seconds: float) -> str:
    """Of a batch, for each state."""
    return f"{seconds / STATES * 1e9:.0f}"


def rows_of(model: Model, folder: Path, options: argparse.Namespace) -> list[list[str]]:
    """Rows of a model, a function each."""
    source, shop, rows = write_solver(model, functions=ASKED), workshop(options), []
    python = of_python(model, folder, options.threads, 20 * options.rounds)
    sizes = Functions.of(source).sizes()
    shared = in_c_on_threads(model, folder / model.name, sizes, options.threads, 4 * options.rounds)
    for function, wall, in_c in zip(ASKED, python, shared, strict=True):
        one, several = shop.compete(contestants(source, model, function), options.rounds, options.batches).values()
        check(one.variant.arrays, several.variant.arrays)
        along = f" + {DIRECTIONS}" if function == "sensitivities" else ""
        rows.append(
            [f"{model.name}, {model.nu} joints, udot{along}", ns(one.median), ns(several.median), f"{several.ratio(one):.2f}",
             *map(ns, in_c.values()), f"{in_c['one'] / in_c['threads']:.2f}", *map(ns, wall.values()),
             f"{wall['several'] / wall['one']:.2f}", f"{wall['several'] / wall['threads']:.2f}"]
        )  # fmt: skip
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=2)
    add_options(parser, 5, 5)
    options = parser.parse_args()
    if options.instructions != "native":
        os.environ["ORDERNM_CFLAGS"] = " ".join(["-O2", "-march=native", *INSTRUCTIONS[options.instructions]])
    batches.WORTH_COMPILING = 0
    with tempfile.TemporaryDirectory() as folder:
        models = [sized("CHAIN", 12).model, codegen.parse_model(example("arm"))]
        rows = [row for model in models for row in rows_of(model, Path(folder), options)]
    on_threads = f"{options.threads} threads"
    heads = ["ns per state", "calls in C", "several at once", "ratio", "C, one thread", on_threads, "times", "Python: one by one",
             "several at once", on_threads, "ratio", "times"]  # fmt: skip
    print(f"{workshop(options).widest}, {STATES} states; calls in C and several at once: CPU time, median over the rounds, "
          "best of -O2 and -O3; others: least by the wall clock\n")  # fmt: skip
    print(markdown(heads, rows))


if __name__ == "__main__":
    main()
