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
import time
from collections.abc import Callable
from pathlib import Path

import chains
import numpy as np
from ctiming import FLAGS, Contestant, add_instructions, alternate, default_cache, restrict_instructions, table

import codegen
from codegen.model import Model
from codegen.pipeline import Source, write_solver
from codegen.runtime.standalone import batches

STATES = 4096

DIRECTIONS = 8
ASKED = ("accelerations", "sensitivities")
EXAMPLES = Path(__file__).parents[1] / "examples"

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


def sizes_of(model: Model) -> dict[str, int]:
    """Entries of each array of a state."""
    n = {"q": model.nq, "u": model.nu, "p": len(model.parameters), "inputs": len(model.inputs), "udot": model.nu}
    return n | {f"d{name}": size for name, size in n.items()}


def contestants(source: Source, model: Model, function: str) -> list[Contestant]:
    """A loop of calls, and several states at once, on the same arrays: parameters are one for all, directions last."""
    name, f = model.name, source.manifest["functions"][function]
    seeds, sizes, rng = f.get("seeds", []), sizes_of(model), np.random.default_rng(1)
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
    files = chains.c_files(source) | {f"{name}_states.c": source.files[f"{name}_states.c"]}
    arrays.append(np.zeros(work))
    return [
        Contestant(f"{kind} {function} {name}", files, text, "run(a)", arrays, ("-O2", "-O3"))
        for kind, text in (("one", one), ("several", several))
    ]


def of_python(model: Model, folder: Path, threads: int, rounds: int) -> list[dict[str, float]]:
    """Seconds of a batch by the wall clock, for each function: one state after the other, several at once, on threads."""
    codegen.generate(model, folder / model.name, functions=ASKED, check=False)
    solvers = {}
    for kind, of in (("one", 1), ("several", 1), ("threads", threads)):
        solvers[kind] = codegen.load(folder / model.name)
        solvers[kind].batch_threads = of
    solvers["one"]._target.batches.takes = lambda *_: False
    rng = np.random.default_rng(2)
    q, u = rng.uniform(-1.0, 1.0, (STATES, model.nq)), rng.uniform(-1.0, 1.0, (STATES, model.nu))
    dq = rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, model.nq))
    du = rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, model.nu))

    def call(solver: codegen.runtime.Solver, function: str) -> Callable[[], object]:
        if function == "accelerations":
            return lambda: solver.accelerations(q, u)
        return lambda: solver.sensitivities(q, u, dq=dq, du=du)

    found = []
    for function in ASKED:
        best = dict.fromkeys(solvers, np.inf)
        for _ in range(rounds):
            for kind, solver in solvers.items():
                run = call(solver, function)
                begin = time.perf_counter()
                run()
                best[kind] = min(best[kind], time.perf_counter() - begin)
        found.append(best)
    return found


def in_c_on_threads(model: Model, folder: Path, threads: int, rounds: int) -> list[dict[str, float]]:
    """Seconds of a batch in C by the wall clock, for each function: on one thread, and on several."""
    solver = codegen.load(folder)
    solver.batch_threads = threads
    rng = np.random.default_rng(3)
    q, u = (rng.uniform(-1.0, 1.0, (STATES, n)) for n in (model.nq, model.nu))
    solver.accelerations(q, u)  # what is called below is compiled and opened
    solver.sensitivities(q, u, dq=rng.uniform(-1.0, 1.0, (DIRECTIONS, STATES, model.nq)))
    over = solver._target.batches
    ffi, sizes, found = over._ffi, sizes_of(model), []
    for function in ASKED:
        b = ffi.new("states *", {"count": STATES, "directions": DIRECTIONS})
        kept = [np.empty(threads * over._over_states["workspace"])]
        b.work = solver._target.pointer(kept[0])
        for name in over._over_states["arrays"]:
            lanes = DIRECTIONS if name.startswith("d") else 1
            shared, entries = name in ("p", "dp"), sizes[name] * lanes
            array = rng.uniform(-1.0, 1.0, (1 if shared else STATES, entries))
            kept.append(np.array([list(model.defaults.values())]) if name == "p" else array)
            setattr(b, name, (solver._target.pointer(kept[-1]), 0 if shared else entries, 1, lanes))
        call = over._several[f"{model.name}_{function}_states"]
        runs: dict[str, Callable[[], object]] = {
            "one": lambda call=call, b=b: call(b),
            "threads": lambda call=call, b=b: over._shared()(call, b, threads),
        }
        best = dict.fromkeys(runs, np.inf)
        for _ in range(rounds):
            for kind, run in runs.items():
                for _ in range(20):
                    begin = time.perf_counter()
                    run()
                    best[kind] = min(best[kind], time.perf_counter() - begin)
        found.append(best)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=default_cache())
    add_instructions(parser)
    arguments = parser.parse_args()
    instructions = restrict_instructions(arguments.instructions)
    if arguments.instructions != "native":
        os.environ["ORDERNM_CFLAGS"] = " ".join(["-O2", "-march=native", *FLAGS[1:-2]])
    batches.WORTH_COMPILING = 0

    models = [chains.chain_model(12), codegen.load_model(EXAMPLES / "arm.yaml")]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for model in models:
            python = of_python(model, Path(folder), arguments.threads, 20 * arguments.rounds)
            shared = in_c_on_threads(model, Path(folder) / model.name, arguments.threads, 4 * arguments.rounds)
            source = write_solver(model, functions=ASKED)
            for function, wall, in_c in zip(ASKED, python, shared, strict=True):
                times = alternate(
                    contestants(source, model, function), arguments.cache, arguments.rounds, arguments.batches
                )
                one, several = (times[f"{kind} {function} {model.name}"] for kind in ("one", "several"))
                check(one.variant.arrays, several.variant.arrays)
                along = f" + {DIRECTIONS}" if function == "sensitivities" else ""
                row = [
                    f"{model.name}, {model.nu} joints, udot{along}",
                    *(f"{t.median / STATES * 1e9:.0f}" for t in (one, several)),
                ]
                row += [f"{several.ratio(one):.2f}", *(f"{t / STATES * 1e9:.0f}" for t in in_c.values())]
                row += [f"{in_c['one'] / in_c['threads']:.2f}", *(f"{t / STATES * 1e9:.0f}" for t in wall.values())]
                rows.append([*row, f"{wall['several'] / wall['one']:.2f}", f"{wall['several'] / wall['threads']:.2f}"])
    heads = [
        "ns per state",
        "calls in C",
        "several at once",
        "ratio",
        "C, one thread",
        f"{arguments.threads} threads",
        "times",
        "Python: one by one",
        "several at once",
        f"{arguments.threads} threads",
        "ratio",
        "times",
    ]
    print(
        f"{instructions}, {STATES} states; calls in C and several at once: CPU time, median over the rounds, "
        "best of -O2 and -O3; others: fastest by the wall clock\n"
    )
    print(table(heads, rows))


def check(a: list[np.ndarray], b: list[np.ndarray]) -> None:
    """Compare what contestants have found, number by number; the last array is the workspace."""
    for x, y in zip(a[:-1], b[:-1], strict=True):
        if not np.allclose(x, y, rtol=1e-9, atol=1e-9 * (1.0 + np.abs(x).max())):
            raise ValueError("several states at once give other numbers")


if __name__ == "__main__":
    main()
