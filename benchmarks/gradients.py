"""The gradient of one scalar of udot with respect to everything (q, u, p), against udot alone: one C call each.

    python benchmarks/gradients.py [--rounds 9] [--instructions avx2] [--scaling]

The transpose of the sensitivities costs about as much as one direction, however many parameters there are; udot comes with it.
`--scaling` measures CHAIN(n) to n = 10 000 instead.
"""

from __future__ import annotations

import argparse

import numpy as np

from codegen.measure.clock import exponent, one_core
from codegen.measure.compiled import Contestant, Functions, add_options, workshop
from codegen.measure.models import Sized, sized
from codegen.measure.tables import markdown

CLAIM = 2.5
"""At most so many times udot."""

HEAD = (
    "",
    "udot",
    "udot + 1",
    "gradient",
    "8 gradients",
    "udot + 1 / udot",
    f"gradient / udot (claim: {CLAIM})",
    "8 / udot",
)


def contestants(m: Sized) -> list[Contestant]:
    """udot, along one direction, and the gradients of one and of eight weighted sums of its entries."""
    functions, given, n = Functions.of(m.source()), m.given(), m.model.nu
    found = [functions.contestant("accelerations", given, name=f"udot {m}")]
    found.append(functions.contestant("sensitivities", m.given(1), 1, f"along {m}"))
    for width in (1, 8):
        weights = np.cos(1.0 + np.arange(n * width, dtype=float)).reshape(n, width).T
        found.append(
            functions.contestant("sensitivities_transposed", given | {"dudot": weights}, width, f"{width} {m}")
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scaling", action="store_true")
    add_options(parser, 9, 15)
    options = parser.parse_args()
    shop = workshop(options)
    chains = [sized("CHAIN", n) for n in ((100, 300, 1000, 3000, 10000) if options.scaling else (12, 100))]
    models = chains if options.scaling else [*chains, sized("LADDER", 25)]
    with one_core():
        times = shop.compete([c for m in models for c in contestants(m)], options.rounds, options.batches, 5e-4)
    rows = []
    for m in models:
        udot, *others = (times[f"{kind} {m}"] for kind in ("udot", "along", "1", "8"))
        each = (f"{t.median / m.bodies * 1e9:.1f}" for t in (udot, *others))
        rows.append([m, *each, *(f"{t.ratio(udot):.2f}" for t in others)])
    print(f"{shop.widest}: ns for each body; least of many batches, median over the rounds, best of -O1, -O2, -O3\n")
    print(markdown(HEAD, rows))
    if options.scaling:
        slope = exponent([m.size for m in models], [times[f"1 {m}"].median for m in models])
        print(f"\ngradient: exponent of n from {models[0].size} to {models[-1].size}: {slope:.3f}")


if __name__ == "__main__":
    main()
