"""How a sweep grows with its workers: the same designs on one process and on two.

    python benchmarks/sweep.py [--designs 2000] [--rounds 3]

Every design is a motion of the double pendulum with sensitivities, of about two milliseconds. Workers are started and have
opened the package before the clock runs; rounds alternate, and the least time of each counts.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np

import codegen
from codegen.measure.clock import elapsed, in_rounds
from codegen.measure.models import example


def swing(solver: Any, case: dict[str, float]) -> dict[str, float]:
    """Where the pendulum is at the end, and the derivative of that by its first parameter."""
    name = solver.parameter_names[0]
    motion = solver.simulate([0.0, case["end"]], p={name: case["value"]}, sensitivities=name)
    return {"q": motion.q[-1, 0], "dq": motion.dq[0, -1, 0]}


def main() -> None:
    parser = argparse.ArgumentParser(description="how a sweep grows with its workers")
    parser.add_argument("--designs", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--end", type=float, default=20.0, help="of every motion, s")
    options = parser.parse_args()
    found: dict[int, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        codegen.generate(codegen.parse_model(example("double_pendulum")), folder)
        solver = codegen.load(folder)
        base = solver.parameters[0]
        cases = {"value": np.linspace(0.9, 1.1, options.designs) * base, "end": options.end}

        def seconds(workers: int) -> float:
            with ProcessPoolExecutor(workers) as pool:
                codegen.sweep(solver, {"value": base * np.linspace(1.2, 1.3, 50), "end": 0.1}, swing, pool, chunk=1)
                return elapsed(lambda: found.update({workers: codegen.sweep(solver, cases, swing, pool)}))()

        times = in_rounds({str(n): partial(seconds, n) for n in (1, 2)}, options.rounds)
        assert np.array_equal(found[1]["q"], found[2]["q"]) and found[2].succeeded.all()
    one, two = (x.least for x in times.values())
    each = f"{1e3 * one / options.designs:.2f} ms each"
    print(f"{options.designs} designs: one worker {one:.2f} s ({each}), two {two:.2f} s: {one / two:.2f} times")


if __name__ == "__main__":
    main()
