"""Exponent of time against the number of loops: LADDER(L), HOOKE(L) and PINNED(n), udot alone and with eight directions.

    python benchmarks/loops_scaling.py [--rounds 3] [--batches 25] [--names LADDER PINNED HOOKE]
        [--layout auto] [--instructions avx2]

Time ~ size^exponent by least squares of the logarithms, over six sizes and more. A figure is the fastest of all batches (25
a round, three rounds), all sizes and functions in turns; every optimisation level is compiled and fitted for itself, so that
sizes are compared at the same one, and the table shows that with the least times all in all. The claim is at most 1.03 for
L = 30 to 1000 (HOOKE to 300).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from ctiming import add_instructions, alternate, default_cache, restrict_instructions, table, use_one_core
from ladders import accelerations, mechanism, sensitivities, source_of

SIZES = {
    "LADDER": (30, 60, 120, 250, 500, 1000),
    "PINNED": (30, 60, 120, 250, 500, 1000),
    "HOOKE": (30, 50, 80, 120, 200, 300),
}
CLAIM = 1.03
FUNCTIONS = ("udot", "udot + 8")


def exponent(sizes: list[int], seconds: list[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def measured(name: str, sizes: list[int], arguments: argparse.Namespace) -> tuple[list[list[object]], bool]:
    """Rows of the table for one mechanism, and whether its exponents are as claimed."""
    contestants, bodies = [], []
    for size in sizes:
        m = mechanism(name, size)
        source = source_of(m, arguments.layout)
        bodies.append(m.bodies)
        for contestant in (accelerations(m, source), sensitivities(m, source, 8)):
            for level in arguments.levels:
                contestants.append(replace(contestant, name=f"{contestant.name} {size} {level}", levels=[level]))
    times = alternate(contestants, arguments.cache, arguments.rounds, arguments.batches, 1e-3)
    rows, good = [], True
    for function in FUNCTIONS:
        fitted = {}
        for level in arguments.levels:
            seconds = [min(times[f"{function} {size} {level}"].rounds) for size in sizes]
            fitted[level] = exponent(sizes, seconds), seconds
        best = min(fitted, key=lambda level: float(np.sum(np.log(fitted[level][1]))))
        slope, seconds = fitted[best]
        good &= slope <= CLAIM
        a_body = ", ".join(f"{s}: {t / n * 1e9:.1f}" for s, t, n in zip(sizes, seconds, bodies, strict=True))
        others = ", ".join(f"{level} {fitted[level][0]:.3f}" for level in arguments.levels)
        rows.append([name, function, f"**{slope:.3f}**", CLAIM, best, others, f"{seconds[-1] * 1e6:.1f}", a_body])
        print(rows[-1], flush=True)
    return rows, good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--names", nargs="*", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--sizes", nargs="*", type=int, help="the same for all of them; left out: those of the claims")
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--levels", nargs="*", default=[1, 2, 3], type=int, choices=(1, 2, 3), help="of optimisation")
    add_instructions(parser)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--batches", type=int, default=25)
    parser.add_argument("--cache", type=Path, default=default_cache())
    arguments = parser.parse_args()
    arguments.levels = [f"-O{level}" for level in arguments.levels]
    instructions = restrict_instructions(arguments.instructions)
    use_one_core()
    rows: list[list[object]] = []
    good = True
    for name in arguments.names:
        more, fine = measured(name, arguments.sizes or list(SIZES[name]), arguments)
        rows, good = rows + more, good and fine
    head = ["", "function", "exponent", "claim", "gcc", "at other levels", "us, largest", "ns a body, by size"]
    print(f"\n{instructions}\n\n" + table(head, rows))
    if not good:
        raise SystemExit(f"an exponent is above {CLAIM}")


if __name__ == "__main__":
    main()
