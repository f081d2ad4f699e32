"""The gradient of one scalar of udot with respect to everything (q, u, p), against udot alone: one C call each.

    python benchmarks/gradients.py [--rounds 9] [--instructions avx2] [--scaling]

The transpose of the sensitivities costs about as much as one direction, however many parameters there are; udot comes with it.
`--scaling` measures CHAIN(n) to n = 10 000 instead.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import chains
import ladders
import numpy as np
from ctiming import Contestant, add_instructions, alternate, default_cache, restrict_instructions, table, use_one_core

from codegen.pipeline import Source

CLAIM = 2.5
"""At most so many times udot."""


def gradient(source: Source, package: str, state: tuple[np.ndarray, np.ndarray], width: int, name: str) -> Contestant:
    """udot, and the gradients of `width` weighted sums of its entries; one design parameter."""
    n = len(state[0])
    weights = np.ascontiguousarray(np.cos(1.0 + np.arange(n * width, dtype=float)).reshape(n, width))
    arrays = [
        *state,
        np.ones(1),
        weights,
        np.zeros(n),
        np.zeros((n, width)),
        np.zeros((n, width)),
        np.zeros((1, width)),
    ]
    call = f"{package}_sensitivities_transposed_{width}({', '.join(f'a[{i}]' for i in range(9))})"
    files = chains.c_files(source)
    return Contestant(name, files, f'#include "{package}.h"', call, [*arrays, np.zeros(source.manifest["workspace"])])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batches", type=int, default=15)
    parser.add_argument("--cache", type=Path, default=default_cache())
    add_instructions(parser)
    arguments = parser.parse_args()
    instructions = restrict_instructions(arguments.instructions)
    use_one_core()

    contestants: list[Contestant] = []
    names: list[tuple[str, int]] = []
    for n in (100, 300, 1000, 3000, 10000) if arguments.scaling else (12, 100):
        name, source = f"CHAIN({n})", chains.chain_source(n)
        names.append((name, n))
        contestants.append(chains.accelerations(source, n, f"udot {name}"))
        contestants.append(chains.sensitivities(source, n, 1, f"along {name}"))
        contestants += [gradient(source, "chain", chains.chain_state(n), w, f"{w} {name}") for w in (1, 8)]
    for size in () if arguments.scaling else (25,):
        m = ladders.mechanism("LADDER", size)
        name, source = f"LADDER({size})", ladders.source_of(m)
        names.append((name, m.bodies))
        contestants.append(ladders.accelerations(m, source, f"udot {name}"))
        contestants.append(ladders.sensitivities(m, source, 1, f"along {name}"))
        contestants += [gradient(source, m.model.name, m.state, w, f"{w} {name}") for w in (1, 8)]
    times = alternate(contestants, arguments.cache, arguments.rounds, arguments.batches, 5e-4)
    print(f"{instructions}: ns per body; fastest of many batches, median over the rounds, best of -O1, -O2, -O3\n")
    rows = []
    for name, n in names:
        udot, along, one, eight = (times[f"{kind} {name}"] for kind in ("udot", "along", "1", "8"))
        row: list[object] = [name, *(f"{t.median / n * 1e9:.1f}" for t in (udot, along, one, eight))]
        rows.append([*row, *(f"{t.ratio(udot):.2f}" for t in (along, one, eight))])
    heads = [
        "",
        "udot",
        "udot + 1",
        "gradient",
        "8 gradients",
        "udot + 1 / udot",
        f"gradient / udot (claim: {CLAIM})",
        "8 / udot",
    ]
    print(table(heads, rows))
    if arguments.scaling:
        x = [math.log(n) for _, n in names]
        y = [math.log(times[f"1 {name}"].median) for name, _ in names]
        print(f"\ngradient: exponent of n from {names[0][1]} to {names[-1][1]}: {np.polyfit(x, y, 1)[0]:.3f}")


if __name__ == "__main__":
    main()
