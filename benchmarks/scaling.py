"""How times grow with the size: CHAIN(n), LADDER(L), PINNED(n) and HOOKE(L), udot alone and with directions.

    python benchmarks/scaling.py [CHAIN LADDER PINNED HOOKE] [--sizes 12 50 ...] [--rounds 3] [--levels 2] [--instructions avx2]

Time for each body should not depend on the size: one function for each kind of body is called in a loop, and what is stored of a
body is small enough for the caches, up to where all bodies no longer are. The first table has ns for each body; a figure is the
median over the rounds at the best level. The second has the exponent of time ~ size^exponent, by least squares of the logarithms,
over the least times; each level is fitted for itself, so that sizes are compared at the same one, and that with the least times
all in all is shown. Claims: an exponent of at most 1.03 for loops of 30 to 1000 (HOOKE to 300).

With ``--gradients``: the gradient of one and of eight weighted sums of udot by all of q, u and p, as times of udot; the claim is
at most 2.5 for one. It comes with udot, and costs about as much as one direction, however many parameters there are.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from codegen.measure.clock import exponent, one_core
from codegen.measure.compiled import LEVELS, Functions, Timing, Workshop, add_options, workshop
from codegen.measure.models import Sized, sized
from codegen.measure.tables import markdown

LOOPS = (30, 60, 120, 250, 500, 1000)
SIZES = {"CHAIN": (12, 24, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 100000), "LADDER": LOOPS, "PINNED": LOOPS,
         "HOOKE": (30, 50, 80, 120, 200, 300)}  # fmt: skip
FUNCTIONS = {
    "udot": ("accelerations", 0),
    **{f"udot + {width}": ("sensitivities", width) for width in (1, 2, 8)},
    "gradient": ("sensitivities_transposed", 1), "8 gradients": ("sensitivities_transposed", 8),
}  # fmt: skip
GRADIENTS = ("udot", "udot + 1", "gradient", "8 gradients")
FITTED = ("udot", "udot + 8")
EXPONENT = 1.03
PER_BODY = ((100000, 1000, 1.30), (2000, 50, 1.15), (50, 12, 1.10))
"""Of CHAIN: time for each body with so many rods over that with fewer, at most; beyond the caches directions wait for memory, and
nothing is claimed."""


def given(m: Sized, function: str, width: int) -> dict[str, Any]:
    """State, parameters, and seeds, or the weights of as many sums of accelerations."""
    if function != "sensitivities_transposed":
        return m.given(width)
    n = m.model.nu
    return m.given() | {"dudot": np.cos(1.0 + np.arange(n * width, dtype=float)).reshape(n, width).T}


def measured(name: str, sizes: list[int], options: argparse.Namespace, shop: Workshop) -> dict[tuple[int, str], Timing]:
    """Times by size and function, all in turns."""
    contestants, labels = [], {}
    wanted = GRADIENTS if options.gradients else tuple(FUNCTIONS)[:4] if name == "CHAIN" else FITTED
    for size in sizes:
        m = sized(name, size)
        functions = Functions.of(m.source(options.layout))
        for what in wanted:
            function, width = FUNCTIONS[what]
            label, levels = f"{what} {m}", [f"-O{level}" for level in options.levels]
            contestants.append(functions.contestant(function, given(m, function, width), width, label, levels=levels))
            labels[label] = size, what
    times = shop.compete(contestants, options.rounds, options.batches, 5e-4)
    return {labels[label]: t for label, t in times.items()}


def fitted(name: str, times: dict[tuple[int, str], Timing], options: argparse.Namespace) -> list[list[Any]]:
    """Rows of exponents."""
    rows, sizes, claim = [], sorted({n for n, _ in times}), "" if name == "CHAIN" else EXPONENT
    for what in ("gradient",) if options.gradients else FITTED:
        seconds = {f"-O{k}": [times[n, what].levels[f"-O{k}"].least for n in sizes] for k in options.levels}
        slopes = {level: exponent(sizes, s) for level, s in seconds.items()}
        best = min(seconds, key=lambda level: float(np.sum(np.log(seconds[level]))))
        others = ", ".join(f"{level} {slope:.3f}" for level, slope in slopes.items())
        rows.append([name, what, f"**{slopes[best]:.3f}**", claim, best, others, f"{seconds[best][-1] * 1e6:.1f}"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=["CHAIN"])
    parser.add_argument("--sizes", nargs="*", type=int)
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument(
        "--levels", nargs="*", type=int, default=[int(level[-1]) for level in LEVELS], help="of optimisation"
    )
    parser.add_argument(
        "--gradients", action="store_true", help="of sums of accelerations, at most 2.5 times udot each"
    )
    add_options(parser, 9, 15)
    options = parser.parse_args()
    shop, slopes = workshop(options), []
    for name in options.names:
        with one_core():
            times = measured(name, options.sizes or list(SIZES[name]), options, shop)
        functions = list(dict.fromkeys(what for _, what in times))
        compared = functions[1:] if options.gradients else []
        bodies = {n: sized(name, n).bodies for n in sorted({n for n, _ in times})}
        rows = [
            [n, each, *(times[n, w].nanoseconds(each) for w in functions),
             *(f"{times[n, w].ratio(times[n, 'udot']):.2f}" for w in compared)]
            for n, each in bodies.items()
        ]  # fmt: skip
        head = ["size", "bodies", *functions, *(f"{w} / udot" for w in compared)]
        print(f"{name}, {shop.widest}: ns for each body\n\n{markdown(head, rows)}\n")
        for what in FITTED if name == "CHAIN" and not options.gradients else ():
            for many, few, claim in PER_BODY:
                if {many, few} <= bodies.keys():
                    limit = f" (claim: at most {claim})" if many <= 2000 or what == FITTED[0] else ""
                    ratio = times[many, what].ratio(times[few, what]) * few / many
                    print(f"{what}: n = {many} takes {ratio:.3f} of n = {few} for each body{limit}")
        slopes += fitted(name, times, options)
    print(markdown(("", "function", "exponent", "claim", "gcc", "at other levels", "us, largest"), slopes))


if __name__ == "__main__":
    main()
