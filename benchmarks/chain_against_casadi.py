"""CHAIN(n), generated code against CasADi's: udot, and eight directions of ours against one of CasADi's.

    python benchmarks/chain_against_casadi.py [--instructions avx2] [--rounds 9] [--cache FOLDER] [n ...]

CasADi gets a hand-written articulated-body algorithm in SX scalars (codegen/measure/articulated_chain.py), its own derivative
(jtimes along one direction of q, u and L), and its own C, with and without its common-subexpression pass; every one compiled
at -O1, -O2 and -O3 with the flags of everybody else, the best of them counted. gcc takes minutes for its derivative of 100
bodies; compiled files stay in the cache folder. Numbers are compared before anything is timed.
"""

from __future__ import annotations

import argparse

import casadi
import numpy as np

from codegen.measure import articulated_chain
from codegen.measure.accuracy import relative
from codegen.measure.clock import one_core
from codegen.measure.compiled import Contestant, Functions, Workshop, add_options, workshop
from codegen.measure.models import Sized, sized
from codegen.measure.tables import markdown

AGREEMENT = 1e-11
HEAD = ("n", "ordernm", "ns", "CasADi", "ns", "ratio", "of single rounds", "claim", "largest difference")


def casadis(m: Sized, directional: bool, cse: bool) -> Contestant:
    """udot of CHAIN(n) and, if asked, its total derivative along seeds of q, u and L."""
    n = m.size
    q, u, L = (casadi.SX.sym(name, size) for name, size in (("q", n), ("u", n), ("L", 1)))
    scalars = [q[i] for i in range(n)], [u[i] for i in range(n)], L
    udot = casadi.vertcat(*articulated_chain.accelerations(*scalars, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    inputs, results, found = [q, u, L], [udot], {"udot": np.zeros(n)}
    if directional:
        inputs += [casadi.SX.sym("dq", n), casadi.SX.sym("du", n), casadi.SX.sym("dL")]
        results.append(casadi.jtimes(udot, casadi.vertcat(q, u, L), casadi.vertcat(*inputs[3:])))
        found["dudot"] = np.zeros(n)
    function = casadi.Function("f", inputs, casadi.cse(results) if cse else results)
    generator = casadi.CodeGenerator("casadi_chain.c")
    generator.add(function)
    arrays = {name: x[0] if name.startswith("d") else x for name, x in m.given(int(directional)).items()}
    call = f"f((const double **)a, a + {len(arrays)}, 0, a[{len(arrays) + len(found)}], 0)"
    name = f"CasADi {'udot + 1' if directional else 'udot'}{', cse' if cse else ''}"
    arrays |= found | {"work": np.zeros(max(1, function.sz_w()))}
    declaration = "int f(const double **, double **, long long *, double *, int);"
    return Contestant(name, {"casadi_chain.c": generator.dump()}, declaration, call, arrays)


def compare(m: Sized, options: argparse.Namespace, shop: Workshop) -> list[list[object]]:
    """Rows of one chain."""
    functions = Functions.of(m.source(options.layout))
    ours = [functions.contestant("accelerations", m.given(), name="udot")]
    ours += [functions.contestant("sensitivities", m.given(w), w, f"udot + {w}") for w in (1, 8)]
    plain = [casadis(m, d, False) for d in (False, True)]
    exact = shop.evaluated(plain[1])
    found = [shop.evaluated(c) for c in (*ours, plain[0])]
    worst = max(*(relative(x["udot"], exact["udot"]) for x in found), relative(found[2]["dudot"][:, 0], exact["dudot"]))
    if worst > AGREEMENT:
        raise SystemExit(f"{m}: the contestants differ by {worst:.1e}")
    theirs = plain if options.no_cse else [*plain, *(casadis(m, d, True) for d in (False, True))]
    times = shop.compete([*ours, *theirs], options.rounds, options.batches)
    rows: list[list[object]] = []
    of_eight = 0.55 if shop.widest == "AVX-512" else 0.75
    for mine, other, claim in (
        ("udot", "udot", 1.05),
        ("udot + 8", "udot + 1", of_eight),
        ("udot + 1", "udot + 1", ""),
    ):
        a = times[mine]
        b = min((t for n, t in times.items() if n.removesuffix(", cse") == f"CasADi {other}"), key=lambda t: t.median)
        rows.append([m.size, mine, *a.beside(b), claim, f"{worst:.1e}"])
    print(*times.values(), sep="\n", flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", nargs="*", type=int, default=[12, 24, 50, 100])
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--no-cse", action="store_true", help="leave out CasADi's variant with its own cse pass")
    add_options(parser)
    options = parser.parse_args()
    shop = workshop(options)
    with one_core():
        rows = [row for n in options.n for row in compare(sized("CHAIN", n), options, shop)]
    print(f"\n{shop.widest}\n\n{markdown(HEAD, rows)}")


if __name__ == "__main__":
    main()
