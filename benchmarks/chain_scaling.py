"""Nanoseconds per body of CHAIN(n) from 12 rods to 100 000: udot alone and with eight directions.

    python benchmarks/chain_scaling.py [--rounds 9] [--layout auto] [--instructions avx2] [n ...]

Time a body should not depend on n: one function per kind of body is called in a loop, and what is stored of a body is
small enough for the caches (up to where n bodies no longer are).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from chains import accelerations, chain_source, sensitivities
from ctiming import add_instructions, alternate, default_cache, restrict_instructions, table, use_one_core


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("n", nargs="*", type=int, default=[12, 24, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 100000])
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    add_instructions(parser)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batches", type=int, default=15)
    parser.add_argument("--cache", type=Path, default=default_cache())
    arguments = parser.parse_args()
    instructions = restrict_instructions(arguments.instructions)
    use_one_core()

    contestants, names = [], ("udot", "udot + 1", "udot + 2", "udot + 8")
    for n in arguments.n:
        source = chain_source(n, arguments.layout)
        contestants.append(accelerations(source, n, f"udot {n}"))
        contestants += [sensitivities(source, n, width, f"udot + {width} {n}") for width in (1, 2, 8)]
    times = alternate(contestants, arguments.cache, arguments.rounds, arguments.batches, 5e-4)
    print(
        f"{instructions}: ns per body, CHAIN(n); fastest of many batches, median over the rounds, best of -O1, -O2, -O3\n"
    )
    rows = []
    for n in arguments.n:
        row: list[object] = [n]
        for name in names:
            timing = times[f"{name} {n}"]
            row.append(f"{timing.median / n * 1e9:.1f} ({timing.level})")
        rows.append(row)
    print(table(["n", *names], rows))
    print()
    for name in (names[0], names[-1]):
        for many, few, claim in ((100000, 1000, 1.30), (2000, 50, 1.15), (50, 12, 1.10)):
            if {many, few} <= set(arguments.n):
                a, b = times[f"{name} {many}"], times[f"{name} {few}"]
                ratio = a.ratio(b) * few / many
                # beyond the caches directions wait for memory, and nothing is claimed
                limit = f" (claim: at most {claim})" if many <= 2000 or name == names[0] else ""
                print(f"{name}: n = {many} takes {ratio:.3f} of n = {few} per body{limit}")


if __name__ == "__main__":
    main()
