"""Rounding of the generated C on CHAIN(n), against 50 digits: udot and eight directions.

    python benchmarks/accuracy.py [--cache FOLDER] [n ...]

The reference is the generic recursive engine in mpmath numbers of 50 digits, started from the same doubles; it is itself
compared with central differences (60 digits, steps of 1e-20) of a hand-written articulated-body algorithm that shares
nothing with it. Relative errors are per direction: the largest difference over the largest entry; the componentwise
figure beside them divides every difference by its own entry.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mpmath
import numpy as np
from chains import chain_model, chain_seeds, chain_source, chain_state, sensitivities
from ctiming import LEVELS, compile_variant, default_cache, table

from codegen.measure import articulated_chain
from codegen.reference import RecursiveEngine

CLAIM = 1e-13


def relative(x: np.ndarray, exact: np.ndarray) -> float:
    """Largest over the directions (rows)."""
    x, exact = np.atleast_2d(x), np.atleast_2d(exact)
    return max(float(max(abs(a - b)) / max(abs(b))) for a, b in zip(x, exact, strict=True))


def componentwise(x: np.ndarray, exact: np.ndarray) -> float:
    return max(float(abs((a - b) / b)) for a, b in zip(np.ravel(x), np.ravel(exact), strict=True))


def other_witness(n: int, direction: int) -> tuple[np.ndarray, np.ndarray]:
    """udot and its derivative along one direction by differences of the hand-written algorithm."""
    q, u = chain_state(n)
    dq, du, dL = (seed[direction] for seed in chain_seeds(n))

    def udot(h: mpmath.mpf) -> np.ndarray:
        moved = [
            [mpmath.mpf(float(a)) + h * mpmath.mpf(float(b)) for a, b in zip(*x, strict=True)]
            for x in ((q, dq), (u, du))
        ]
        L = 1 + h * mpmath.mpf(float(dL[0]))
        # The generated code and the engine know density, radius and g as doubles.
        constants = (mpmath.mpf(1), mpmath.mpf(0.05), mpmath.mpf(9.81))
        return np.array(articulated_chain.accelerations(*moved, L, mpmath.sin, mpmath.cos, *constants), dtype=object)

    h = mpmath.mpf(10) ** -20
    return udot(mpmath.mpf(0)), (udot(h) - udot(-h)) / (2 * h)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("n", nargs="*", type=int, default=[4, 12, 100])
    parser.add_argument("--layouts", nargs="*", default=["kinds", "unrolled"], choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--unrolled-to", type=int, default=12)
    parser.add_argument("--cache", type=Path, default=default_cache())
    arguments = parser.parse_args()

    rows, failed = [], False
    for n in arguments.n:
        dq, du, dL = chain_seeds(n)
        with mpmath.workdps(50):
            exact, dexact = RecursiveEngine(chain_model(n), numbers="mpmath").sensitivities(
                *chain_state(n), dq=dq, du=du, dp=dL
            )
        with mpmath.workdps(60):
            udot, dudot = other_witness(n, 3)
            witnesses = max(relative(udot, exact), relative(dudot, dexact[3]))
        for layout in arguments.layouts:
            if layout == "unrolled" and n > arguments.unrolled_to:
                continue
            contestant = sensitivities(chain_source(n, layout), n, 8)
            for level in LEVELS:
                variant = compile_variant(contestant, level, arguments.cache)
                variant.seconds(1)
                values, tangents = variant.arrays[6], variant.arrays[7].reshape(n, 8).T
                errors = relative(values, exact), relative(tangents, dexact)
                components = componentwise(values, exact), componentwise(tangents, dexact)
                failed |= max(errors) > CLAIM
                figures = [f"{x:.1e}" for x in (errors[0], components[0], errors[1], components[1], witnesses)]
                rows.append([n, layout, level, *figures])
                print(rows[-1], flush=True)
    head = ["n", "layout", "gcc", "udot", "componentwise", "8 directions", "componentwise", "between the references"]
    print("\n" + table(head, rows))
    if failed:
        raise SystemExit(f"an error is above {CLAIM}")


if __name__ == "__main__":
    main()
