"""How a sweep grows with its workers: the same designs on one process and on two.

    python benchmarks/sweep.py [--designs 2000] [--rounds 3]

Every design is a motion of the double pendulum with sensitivities, of about two milliseconds. Workers are started and have
opened the package before the clock runs; rounds alternate, and the least time of each counts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import codegen

EXAMPLE = Path(__file__).parents[1] / "examples" / "double_pendulum.yaml"


def swing(solver: Any, case: dict[str, float]) -> dict[str, float]:
    """Where the pendulum is at the end, and the derivative of that by its first parameter."""
    motion = solver.simulate(
        [0.0, case["end"]], p={solver.parameter_names[0]: case["value"]}, sensitivities=solver.parameter_names[0]
    )
    return {"q": motion.q[-1, 0], "dq": motion.dq[0, -1, 0]}


def main() -> None:
    parser = argparse.ArgumentParser(description="how a sweep grows with its workers")
    parser.add_argument("--designs", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--end", type=float, default=20.0, help="of every motion, s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        codegen.generate(codegen.load_model(EXAMPLE), folder)
        solver = codegen.load(folder)
        base = solver.parameters[0]
        cases = {"value": np.linspace(0.9, 1.1, options.designs) * base, "end": options.end}
        times: dict[int, list[float]] = {1: [], 2: []}
        found = {}
        for _ in range(options.rounds):
            for workers, of in times.items():
                with ProcessPoolExecutor(workers) as pool:
                    codegen.sweep(solver, {"value": base * np.linspace(1.2, 1.3, 50), "end": 0.1}, swing, pool, chunk=1)
                    begin = time.perf_counter()
                    found[workers] = codegen.sweep(solver, cases, swing, pool)
                    of.append(time.perf_counter() - begin)
        assert np.array_equal(found[1]["q"], found[2]["q"]) and found[2].succeeded.all()
    one, two = min(times[1]), min(times[2])
    each = f"{1e3 * one / options.designs:.2f} ms each"
    print(f"{options.designs} designs: one worker {one:.2f} s ({each}), two {two:.2f} s: {one / two:.2f} times")


if __name__ == "__main__":
    main()
