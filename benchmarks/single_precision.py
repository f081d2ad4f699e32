"""Packages in single precision against the same ones in double: differences at random states, times of a batch of 4096.

    python benchmarks/single_precision.py [chain arm four_bar Solo12] [--turns N] [--instructions avx2]

Models are those of ``examples/`` or, with Pinocchio installed, robots of example-robot-data, such as Solo12.

Both solvers are called from Python by turns, on one thread, with arrays and results in their own scalar type. The least CPU time
of all turns counts. (By the wall clock, a call that is longer than a time slice of a busy machine waits for other processes every
time: double precision then seems to take twice as long.) Differences are of the largest entry of each state's result.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import codegen
from codegen.measure.clock import elapsed, in_rounds
from codegen.measure.compiled import INSTRUCTIONS
from codegen.measure.pinocchio_models import ROBOTS, robots_folder

EXAMPLES = Path(__file__).parents[1] / "examples"
STATES, DIRECTIONS = 4096, 8
SCALARS = ("float32", "float64")


def off(found: Any, expected: Any) -> float:
    """The largest difference of any state, of its largest entry."""
    axes = tuple(i for i in range(found.ndim) if i != found.ndim - 2)
    return float(np.max(np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)))


def model_of(name: str) -> Any:
    """The file of a shipped model, or a robot on a free base or on the ground."""
    if name not in ROBOTS:
        return EXAMPLES / f"{name}.yaml"
    return codegen.import_model(
        robots_folder() / ROBOTS[name].file, base="free" if ROBOTS[name].free else "fixed"
    ).model


def measure(name: str, turns: int) -> None:
    """Print a model's lines of the table."""
    model = model_of(name)
    with tempfile.TemporaryDirectory() as folder:
        solvers = {}
        for scalar in SCALARS:
            codegen.generate(model, Path(folder) / scalar, scalar=scalar, functions="dynamics", compile=True)
            solvers[scalar] = codegen.load(Path(folder) / scalar)
            solvers[scalar].batch_threads = 1
            solvers[scalar].prepare("accelerations", "sensitivities", "batches")
        double = solvers["float64"]
        rng = np.random.default_rng(0)
        q, u = double.initial
        q = q + (0.1 if double.closure_names else 0.5) * rng.normal(size=(STATES, double.nq))
        u = u + rng.normal(size=(STATES, double.nu))
        q, u = double.assemble(q, u)
        seeds = {f"d{n}": rng.normal(size=(DIRECTIONS, STATES, getattr(double, f"n{n}"))) for n in "qu"}
        seeds["dp"] = rng.normal(size=(DIRECTIONS, double.np))
        given = {s: (q.astype("f4").astype(s), u.astype("f4").astype(s)) for s in SCALARS}
        along = {s: {n: x.astype("f4").astype(s) for n, x in seeds.items()} for s in SCALARS}
        out = {s: (np.empty((STATES, double.nu), s), np.empty((DIRECTIONS, STATES, double.nu), s)) for s in SCALARS}
        values = {s: lambda s=s: solvers[s].accelerations(*given[s], out=out[s][0]) for s in SCALARS}
        tangents = {s: lambda s=s: solvers[s].sensitivities(*given[s], **along[s], out=out[s]) for s in SCALARS}
        for what, calls in ((f"{STATES} states", values), (f"the same, {DIRECTIONS} directions", tangents)):
            found = in_rounds({s: elapsed(call, clock=time.thread_time) for s, call in calls.items()}, turns)
            t = {s: x.least for s, x in found.items()}
            times = ", ".join(f"{s} {1e6 * x:.0f} us" for s, x in t.items())
            print(f"{name}: {what}, 1 thread: {times}, ratio {t['float32'] / t['float64']:.2f}")
        (udot, dudot), (exact, exact_dudot) = out["float32"], out["float64"]
        print(f"{name}: udot within {off(udot, exact):.1e}, derivatives within {off(dudot, exact_dudot):.1e}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=["chain", "arm", "four_bar"])
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--instructions", default="native", choices=tuple(INSTRUCTIONS), help="permitted instructions")
    options = parser.parse_args()
    os.environ["ORDERNM_CFLAGS"] = " ".join(["-O2", "-march=native", *INSTRUCTIONS[options.instructions]])
    for model in options.models:
        measure(model, options.turns)


if __name__ == "__main__":
    main()
