"""CHAIN(n), products of the Hessian of a weighted sum of udot with directions, against CasADi's.

    python benchmarks/hessian_products_against_casadi.py [--instructions avx2] [--rounds 9] [--cache FOLDER] [n ...]

CasADi gets the hand-written algorithm of chain_against_casadi.py. Its product is `jtimes` of the gradient along one direction
of q, u and L, as its own C, with and without its common-subexpression pass. Numbers are compared before anything is timed.
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

AGREEMENT = 1e-10
FUNCTIONS = ("accelerations", "gradients", "hessian_products")
HEAD = ("n", "ordernm", "ns", "against", "ns", "ratio", "of single rounds", "claim", "largest difference")


def weights(n: int) -> np.ndarray:
    return np.cos(1.7 * np.arange(1, n + 1))


def casadis(m: Sized, cse: bool) -> Contestant:
    """The product along one direction."""
    n = m.size
    q, u, L = (casadi.SX.sym(name, size) for name, size in (("q", n), ("u", n), ("L", 1)))
    w, v = casadi.SX.sym("b", n), casadi.SX.sym("v", 2 * n + 1)
    scalars = [q[i] for i in range(n)], [u[i] for i in range(n)], L
    udot = casadi.vertcat(*articulated_chain.accelerations(*scalars, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    x = casadi.vertcat(q, u, L)
    product = casadi.jtimes(casadi.gradient(casadi.dot(w, udot), x), x, v)
    results = [product[:n], product[n : 2 * n], product[2 * n]]
    function = casadi.Function("f", [q, u, L, w, v], casadi.cse(results) if cse else results)
    generator = casadi.CodeGenerator("casadi_chain.c")
    generator.add(function)
    given = m.given(1)
    direction = np.concatenate([given[s][0] for s in ("dq", "du", "dp")])
    arrays = {"q": given["q"], "u": given["u"], "p": given["p"], "b": weights(n), "v": direction}
    call = f"f((const double **)a, a + {len(arrays)}, 0, a[{len(arrays) + 3}], 0)"
    arrays |= {"dgq": np.zeros(n), "dgu": np.zeros(n), "dgp": np.zeros(1), "work": np.zeros(max(1, function.sz_w()))}
    declaration = "int f(const double **, double **, long long *, double *, int);"
    return Contestant(
        f"CasADi{', cse' if cse else ''}", {"casadi_chain.c": generator.dump()}, declaration, call, arrays
    )


def compare(m: Sized, options: argparse.Namespace, shop: Workshop) -> list[list[object]]:
    """Rows of one chain."""
    functions = Functions.of(m.source(options.layout, FUNCTIONS))
    given = {"b": weights(m.size)}
    ours = [functions.contestant("accelerations", m.given(), name="udot")]
    ours += [functions.contestant("hessian_products", m.given(w) | given, w, f"product {w}") for w in (1, 8)]
    theirs = [] if options.no_casadi else [casadis(m, cse) for cse in ((False,) if options.no_cse else (False, True))]
    worst: object = "-"
    if theirs:
        exact, found = shop.evaluated(theirs[0]), shop.evaluated(ours[2])
        worst = max(relative(np.ravel(found[x][..., 0]), np.ravel(exact[x])) for x in ("dgq", "dgu", "dgp"))
        if worst > AGREEMENT:
            raise SystemExit(f"{m}: the contestants differ by {worst:.1e}")
        worst = f"{worst:.1e}"
    times = shop.compete([*ours, *theirs], options.rounds, options.batches)
    rows: list[list[object]] = []
    of_eight = 8 if shop.widest == "AVX-512" else 10
    casadi_best = min((t for n, t in times.items() if n.startswith("CasADi")), key=lambda t: t.median, default=None)
    for mine, other, claim in (
        ("product 1", times["udot"], 6),
        ("product 8", times["udot"], of_eight),
        ("product 1", casadi_best, 0.35),
        ("product 8", casadi_best, 0.6),
    ):
        if other is not None:
            rows.append([m.size, mine, *times[mine].beside(other), claim, worst])
    print(*times.values(), sep="\n", flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", nargs="*", type=int, default=[12, 50, 100])
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--no-cse", action="store_true", help="leave out CasADi's variant with its own cse pass")
    parser.add_argument("--no-casadi", action="store_true", help="compare with udot only")
    add_options(parser)
    options = parser.parse_args()
    shop = workshop(options)
    with one_core():
        rows = [row for n in options.n for row in compare(sized("CHAIN", n), options, shop)]
    print(f"\n{shop.widest}\n\n{markdown(HEAD, rows)}")


if __name__ == "__main__":
    main()
