"""Rounding of the generated C on CHAIN(n), against 50 digits: udot and eight directions.

    python benchmarks/accuracy.py [--cache FOLDER] [n ...]

The reference is the generic recursive engine in mpmath numbers of 50 digits, started from the same doubles; it is itself
compared with an articulated-body algorithm that is written by hand, on dual numbers, and shares nothing with it. Relative errors
are per direction: the largest difference over the largest entry; the componentwise figure beside them divides every difference by
its own entry.
"""

from __future__ import annotations

import argparse
from typing import Any

import mpmath
import numpy as np

from codegen.bench.problems import families
from codegen.measure.accuracy import by_direction, relative
from codegen.measure.compiled import LEVELS, Functions, add_options, workshop
from codegen.measure.models import seeds, sized
from codegen.measure.tables import markdown
from codegen.reference import RecursiveEngine

CLAIM = 1e-13
HEAD = ("n", "layout", "gcc", "udot", "componentwise", "8 directions", "componentwise", "between the references")


def componentwise(x: Any, exact: Any) -> float:
    """The largest error of an entry over itself."""
    return max(relative(a, b) for a, b in zip(np.ravel(x), np.ravel(exact), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", nargs="*", type=int, default=[4, 12, 100])
    parser.add_argument("--layouts", nargs="*", default=["kinds", "unrolled"], choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--unrolled-to", type=int, default=12)
    add_options(parser)
    options = parser.parse_args()
    shop, rows, worst = workshop(options), [], 0.0
    for n in options.n:
        m, (dq, du, dp) = sized("CHAIN", n), seeds(n)
        with mpmath.workdps(50):
            exact = RecursiveEngine(m.model, numbers="mpmath").sensitivities(m.q, m.u, dq=dq, du=du, dp=dp)
        other = families.along(families.chain_rates, m.q, m.u, 1.0, dq, du, dp)
        witnesses = max(relative(other.udot, exact[0]), *by_direction(other.dudot, exact[1]))
        for layout in [x for x in options.layouts if x != "unrolled" or n <= options.unrolled_to]:
            contestant = Functions.of(m.source(layout)).contestant("sensitivities", m.given(8), 8)
            for level in LEVELS:
                variant = shop.compiled(contestant, level)
                variant.seconds()
                found = variant.arrays["udot"], variant.arrays["dudot"].T
                errors = relative(found[0], exact[0]), max(by_direction(found[1], exact[1]))
                parts = [componentwise(a, b) for a, b in zip(found, exact, strict=True)]
                worst = max(worst, *errors)
                rows.append(
                    [n, layout, level, *(f"{x:.1e}" for x in (errors[0], parts[0], errors[1], parts[1], witnesses))]
                )
                print(rows[-1], flush=True)
    print("\n" + markdown(HEAD, rows))
    if worst > CLAIM:
        raise SystemExit(f"an error is above {CLAIM}")


if __name__ == "__main__":
    main()
