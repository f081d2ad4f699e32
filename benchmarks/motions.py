"""The excavator's 5 s: one motion from Python by number of directions, and many of them over threads.

    python benchmarks/motions.py [--instructions avx2] [--rounds 40] [--many 16]

examples/excavator.yaml falls from rest for 5 s at 1e-9, results at the end. The first table pins the process to one core; C is
the time within `simulate` that the integrator took, Python that of the call, least and median of the runs, one after the other
and with a pause before each. The second simulates a batch at different parameters with `codegen.simulate_many` on one thread and
on more, in turns; least times count: a speed-up can be seen only where as many cores are free.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import codegen
from codegen.measure.clock import cores, elapsed, in_rounds, one_core, summary
from codegen.measure.compiled import INSTRUCTIONS, add_options, workshop
from codegen.measure.models import example
from codegen.measure.tables import markdown

END = 5.0
DIRECTIONS = (
    "boom_length", "stick_length", "payload", "damping", "boom_mass", "stick_mass", "bucket_length", "bucket_mass",
)  # fmt: skip
CLAIM = 5.0
"""ms of the call with four directions."""

PAUSE = 0.004
"""s of sleep before each call of the rows below: a core that slept is cold, and slower by what its machine takes to wake."""

HEAD = ("directions", "pause, ms", "evaluations", "ms, C: least", "median", "ms, Python: least", "median")


def one_motion(solver: Any, k: int, runs: int, pause: float) -> list[str]:
    """A row of the first table: motions with k directions, `pause` seconds apart."""
    motions: list[Any] = []
    run = elapsed(lambda: motions.append(solver.simulate([0.0, END], sensitivities=DIRECTIONS[:k])))
    calls = []
    for _ in range(runs):
        time.sleep(pause)
        calls.append(run())
    both = summary([m.stats["seconds"] for m in motions]), summary(calls)
    times = (f"{1e3 * x:.2f}" for s in both for x in (s.least, s.median))
    return [str(k), f"{1e3 * pause:g}", str(motions[-1].stats["evaluations"]), *times]


def many_motions(solver: Any, n: int, threads: list[int], rounds: int) -> dict[str, float]:
    """Seconds of a batch by number of threads."""
    many = partial(codegen.simulate_many, solver, [0.0, END], p={"payload": np.linspace(500.0, 1500.0, n)},
                   sensitivities=DIRECTIONS[:4])  # fmt: skip

    many(threads=1)  # compiles what it needs

    def seconds(count: int) -> float:
        time.sleep(0.02)
        return elapsed(partial(many, threads=count))()

    return {name: x.least for name, x in in_rounds({str(c): partial(seconds, c) for c in threads}, rounds).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--many", type=int, default=16)
    add_options(parser, 40)
    options = parser.parse_args()
    os.environ["CC"] = " ".join(["gcc", *INSTRUCTIONS[options.instructions]])  # levels are those of packages
    os.environ.pop("ORDERNM_CFLAGS", None)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # what is compiled here has flags of its own
        codegen.generate(codegen.parse_model(example("excavator")), Path(folder) / "excavator")
        solver = codegen.load(Path(folder) / "excavator")
        counts = [1, *(c for c in (2, 4, 8, 16) if c <= len(cores()))]
        best = many_motions(solver, options.many, counts, options.rounds)
        with one_core():
            rows = [one_motion(solver, k, 5 * options.rounds, pause) for pause in (0.0, PAUSE) for k in (0, 1, 4, 8)]
    widest = workshop(options).widest
    print(f"excavator, {END:g} s at 1e-9; {widest}, gcc; claim: {CLAIM:g} ms from Python with four directions\n")
    print(markdown(HEAD, rows), "\n")
    print(f"{options.many} motions with four directions by simulate_many\n")
    rows = [[c, f"{1e3 * s:.1f}", f"{best['1'] / s:.2f}"] for c, s in best.items()]
    print(markdown(["threads", "ms", "speed-up"], rows))


if __name__ == "__main__":
    main()
