"""CHAIN(n), generated code against CasADi's: udot, and eight directions of ours against one of CasADi's.

    python benchmarks/chain_against_casadi.py [--instructions avx2] [--rounds 9] [--cache FOLDER] [n ...]

CasADi gets a hand-written articulated-body algorithm in SX scalars (codegen/bench/articulated_chain.py), its own derivative
(jtimes along one direction of q, u and L), and its own C, with and without its common-subexpression pass; every one compiled
at -O1, -O2 and -O3 with the flags of everybody else, the best of them counted. gcc takes minutes for its derivative of 100
bodies; compiled files stay in the cache folder. Numbers are compared before anything is timed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import casadi
import numpy as np
from chains import accelerations, chain_seeds, chain_source, chain_state, sensitivities
from ctiming import (
    LEVELS,
    Contestant,
    Timing,
    add_instructions,
    alternate,
    compile_variant,
    default_cache,
    restrict_instructions,
    table,
    use_one_core,
)  # fmt: skip

from codegen.measure import articulated_chain

AGREEMENT = 1e-11


def casadi_function(n: int, directional: bool, cse: bool) -> casadi.Function:
    """udot of CHAIN(n) and, if asked, its total derivative along seeds of q, u and L."""
    q, u, L = (casadi.SX.sym(name, size) for name, size in (("q", n), ("u", n), ("L", 1)))
    scalars = [q[i] for i in range(n)], [u[i] for i in range(n)], L
    udot = casadi.vertcat(*articulated_chain.accelerations(*scalars, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    arguments, results = [q, u, L], [udot]
    if directional:
        seeds = [casadi.SX.sym("dq", n), casadi.SX.sym("du", n), casadi.SX.sym("dL")]
        results.append(casadi.jtimes(udot, casadi.vertcat(q, u, L), casadi.vertcat(*seeds)))
        arguments += seeds
    return casadi.Function("f", arguments, casadi.cse(results) if cse else results)


def casadi_contestant(n: int, directional: bool, cse: bool) -> Contestant:
    function = casadi_function(n, directional, cse)
    generator = casadi.CodeGenerator("casadi_chain.c")
    generator.add(function)
    arrays = [*chain_state(n), np.ones(1)]
    results = [np.zeros(n)]
    if directional:
        arrays += [seed[0] for seed in chain_seeds(n)]
        results.append(np.zeros(n))
    call = f"f((const double **)a, a + {len(arrays)}, 0, a[{len(arrays) + len(results)}], 0)"
    declarations = "int f(const double **, double **, long long *, double *, int);"
    work = np.zeros(max(1, function.sz_w()))
    name = f"CasADi {'udot + 1' if directional else 'udot'}{', cse' if cse else ''}"
    return Contestant(name, {"casadi_chain.c": generator.dump()}, declarations, call, [*arrays, *results, work])


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(x - reference).max() / np.abs(reference).max())


def check(ours: Contestant, ours_8: Contestant, theirs: Contestant, theirs_1: Contestant, cache: Path) -> float:
    """The largest difference between the contestants, udot and the first direction."""
    outcome = []
    for contestant, arrays in ((ours, (3,)), (ours_8, (6, 7)), (theirs, (3,)), (theirs_1, (6, 7))):
        variant = compile_variant(contestant, "-O2", cache)
        variant.seconds(1)
        outcome.append([variant.arrays[i] for i in arrays])
    udot, dudot = outcome[3]
    worst = max(relative(o[0], udot) for o in outcome)
    return max(worst, relative(outcome[1][1][:, 0], dudot))


def best(times: dict[str, Timing], start: str) -> Timing:
    """The faster of CasADi's two."""
    return min((t for name, t in times.items() if name.removesuffix(", cse") == start), key=lambda t: t.median)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("n", nargs="*", type=int, default=[12, 24, 50, 100])
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batches", type=int, default=25)
    parser.add_argument("--cache", type=Path, default=default_cache())
    parser.add_argument("--no-cse", action="store_true", help="leave out CasADi's variant with its own cse pass")
    add_instructions(parser)
    arguments = parser.parse_args()
    instructions = restrict_instructions(arguments.instructions)
    claim_8 = 0.55 if instructions == "AVX-512" else 0.75
    use_one_core()

    rows = []
    for n in arguments.n:
        source = chain_source(n, arguments.layout)
        ours, ours_8 = accelerations(source, n, "ordernm udot"), sensitivities(source, n, 8, "ordernm udot + 8")
        ours_1 = sensitivities(source, n, 1, "ordernm udot + 1")
        theirs = [casadi_contestant(n, d, False) for d in (False, True)]
        worst = check(ours, ours_8, *theirs, arguments.cache)
        if worst > AGREEMENT:
            raise SystemExit(f"n = {n}: the contestants differ by {worst:.1e}")
        if not arguments.no_cse:
            theirs += [casadi_contestant(n, d, True) for d in (False, True)]
        everyone = [ours, ours_1, ours_8, *theirs]
        times = alternate(everyone, arguments.cache, arguments.rounds, arguments.batches)
        for mine, theirs_name, claim in (
            ("udot", "udot", 1.05),
            ("udot + 8", "udot + 1", claim_8),
            ("udot + 1", "udot + 1", ""),
        ):
            a, b = times[f"ordernm {mine}"], best(times, f"CasADi {theirs_name}")
            low, high = a.spread(b)
            rows.append(
                [n, mine, f"{a.median * 1e9:.0f} ({a.level})", theirs_name, f"{b.median * 1e9:.0f} ({b.level})",
                 f"**{a.ratio(b):.3f}**", f"{low:.3f} to {high:.3f}", claim, f"{worst:.1e}"]
            )  # fmt: skip
            print(rows[-1], flush=True)
        for name, timing in times.items():
            print(
                f"  {name}: " + ", ".join(f"{level} {timing.all_levels[level] * 1e9:.0f}" for level in LEVELS),
                flush=True,
            )
    print(f"\n{instructions}\n")
    head = ["n", "ordernm", "ns", "CasADi", "ns", "ratio", "of single rounds", "claim", "largest difference"]
    print(table(head, rows))


if __name__ == "__main__":
    main()
