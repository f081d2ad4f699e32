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
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from ctiming import INSTRUCTIONS, add_instructions, restrict_instructions, table, use_one_core

import codegen

MODEL = Path(__file__).parents[1] / "examples" / "excavator.yaml"
END = 5.0
DIRECTIONS = (
    "boom_length", "stick_length", "payload", "damping", "boom_mass", "stick_mass", "bucket_length", "bucket_mass",
)  # fmt: skip
CLAIM = 5.0
"""ms of the call with four directions."""

PAUSE = 0.004
"""s of sleep before each call of the rows below: a core that slept is cold, and slower by what its machine takes to wake."""


def one_motion(solver: Any, k: int, runs: int, pause: float) -> list[str]:
    """A row of the first table: motions with so many directions, so many seconds apart."""
    calls, inside, evaluations = [], [], 0
    for _ in range(runs):
        if pause:
            time.sleep(pause)
        start = time.perf_counter()
        motion = solver.simulate([0.0, END], sensitivities=DIRECTIONS[:k])
        calls.append(time.perf_counter() - start)
        inside.append(motion.stats["seconds"])
        evaluations = motion.stats["evaluations"]
    return [
        str(k),
        f"{1e3 * pause:g}",
        str(evaluations),
        *(f"{1e3 * f(x):.2f}" for x in (inside, calls) for f in (min, statistics.median)),
    ]


def many_motions(solver: Any, n: int, threads: list[int], rounds: int) -> dict[int, float]:
    """Seconds of a batch by number of threads."""
    payloads = {"payload": np.linspace(500.0, 1500.0, n)}
    best = dict.fromkeys(threads, np.inf)
    for _ in range(rounds):
        for count in threads:
            time.sleep(0.02)
            start = time.perf_counter()
            codegen.simulate_many(solver, [0.0, END], p=payloads, sensitivities=DIRECTIONS[:4], threads=count)
            best[count] = min(best[count], time.perf_counter() - start)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_instructions(parser)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--many", type=int, default=16)
    options = parser.parse_args()
    instructions = restrict_instructions(options.instructions)
    os.environ["CC"] = " ".join(["gcc", *INSTRUCTIONS[options.instructions]])  # levels are those of packages
    os.environ.pop("ORDERNM_CFLAGS", None)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # what is compiled here has flags of its own
        codegen.generate(MODEL, Path(folder) / "excavator")
        solver = codegen.load(Path(folder) / "excavator")
        cores = sorted(os.sched_getaffinity(0))
        counts = [1, *(c for c in (2, 4, 8, 16) if c <= len(cores))]
        best = many_motions(solver, options.many, counts, options.rounds)
        use_one_core()
        rows = [one_motion(solver, k, 5 * options.rounds, pause) for pause in (0.0, PAUSE) for k in (0, 1, 4, 8)]
    print(f"excavator, {END:g} s at 1e-9; {instructions}, gcc; claim: {CLAIM:g} ms from Python with four directions\n")
    print(
        table(
            ["directions", "pause, ms", "evaluations", "ms, C: least", "median", "ms, Python: least", "median"], rows
        ),
        "\n",
    )
    print(f"{options.many} motions with four directions by simulate_many\n")
    rows = [[str(c), f"{1e3 * s:.1f}", f"{best[1] / s:.2f}"] for c, s in best.items()]
    print(table(["threads", "ms", "speed-up"], rows))


if __name__ == "__main__":
    main()
