"""Second derivatives of inverse dynamics of robots, contracted with weights, beside Pinocchio's.

    pip install pin cmeel-eigen example-robot-data
    python benchmarks/second_order_against_pinocchio.py [--of G1 ...] [--allowed native avx2] [--robots FOLDER]
                                                        [--cache FOLDER] [--rounds 5]

C level, one core, one run, all contestants in turns. Ours: `inverse_dynamics_hessian_products`, eight directions at a time, along
every coordinate and speed; its results also contain the derivatives by accelerations. Theirs:
`ComputeRNEASecondOrderDerivatives`, whose tensors are multiplied by the weights, in all builds of `pinocchio_builds`; the fastest
counts, of builds without AVX-512 beside ours without. Numbers are compared first, where both sides have the same coordinates:
speeds twice, and joints of one degree of freedom.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from jacobians_against_pinocchio import AGREEMENT, BUILDS, LEVELS, NAMES, fastest, numbers
from pinocchio_builds import libraries

from codegen.measure.accuracy import relative
from codegen.measure.clock import one_core
from codegen.measure.compiled import Contestant, Functions, add_options, workshop
from codegen.measure.machine import machine
from codegen.measure.pinocchio_models import ours, theirs_of, usual_state
from codegen.measure.tables import markdown
from codegen.pipeline import write_solver

FUNCTION = "inverse_dynamics_hessian_products"
PEER = "ComputeRNEASecondOrderDerivatives"
CLAIM = 0.7
DECLARATIONS = """\
void *pinocchio_make(int joints, const double *of);
int pinocchio_second(void *, const double *q, const double *u, const double *udot, const double *weights, double *found);
static void *solver;"""
HEAD = ("", "speeds", "instructions", f"{FUNCTION}, us", f"{PEER}, us", "ratio", "claim", "largest difference")


class Case:
    """A robot on both sides, a state, accelerations and weights."""

    def __init__(self, name: str, theirs: Any):
        self.name, self.theirs, self.model = name, theirs, ours(theirs, name)
        self.source = write_solver(self.model, "auto", functions=(FUNCTION,))
        self.state = usual_state(theirs)
        n = theirs.nv
        self.udot, self.weights = 0.4 * np.sin(1.3 * np.arange(n)), np.cos(1.7 * np.arange(1, n + 1))

    def ours(self, instructions: str) -> Contestant:
        """The whole Hessian: a loop over groups of eight directions."""
        f, name = self.source.manifest["functions"][FUNCTION], self.model.name
        sizes = Functions.of(self.source).sizes()
        order, n = self.state.order, sizes["u"]
        sizes |= dict.fromkeys(("dgudot", "dudot", "force_weights"), n)
        self.places = np.empty(n, int)
        self.places[order] = np.arange(n)
        q, u = self.state.ours
        given = {
            "q": q,
            "u": u,
            "udot": self.udot[self.places],
            "force_weights": self.weights[self.places],
            "t": np.zeros(1),
        }
        count = sizes["q"] + n
        groups = -(-count // 8)
        units = np.zeros((groups * 8, sizes["q"] + n))
        units[:count] = np.eye(count)
        seeds = dict(zip(("dq", "du"), np.split(units, [sizes["q"]], axis=1), strict=True))
        arrays: dict[str, Any] = {}
        passed = []
        for i, argument in enumerate((*f["arguments"], *f["seeds"], *f["results"])):
            width = i >= len(f["arguments"])
            size = sizes[argument]
            value = np.zeros((groups, size, 8)) if width else given.get(argument, np.zeros(size))
            if argument in seeds:
                value = np.ascontiguousarray(seeds[argument].reshape(groups, 8, size).transpose(0, 2, 1))
            arrays[argument] = value
            passed.append(f"*a[{i}]" if argument == "t" else f"a[{i}] + k*{size * 8}" if width else f"a[{i}]")
        arrays["work"] = np.zeros(self.source.manifest["workspace"])
        call = f"{name}_{FUNCTION}_8({', '.join([*passed, f'a[{len(passed)}]'])});"
        loop = f"static int whole(double **a) {{ for (int k = 0; k < {groups}; ++k) {call} return 0; }}"
        include = f'#include "{name}.h"\n{loop}'
        files = Functions.of(self.source).files
        return Contestant(
            f"ordernm, {instructions}", files, include, "whole(a)", arrays, LEVELS, instructions=instructions
        )

    def pinocchio(self, build: Any, path: Path) -> Contestant:
        (q, u), of = self.state.theirs, numbers(self.theirs)
        made = f"solver ? solver : (solver = pinocchio_make({len(of)}, a[4]))"
        arrays = {"q": q, "u": u, "udot": self.udot, "weights": self.weights, "of": of,
                  "found": np.zeros((4, len(u), len(u)))}  # fmt: skip
        call = f"pinocchio_second({made}, a[0], a[1], a[2], a[3], a[5])"
        return Contestant(f"{PEER}, {build}", {}, DECLARATIONS, call, arrays, ["-O3"], [path])

    def difference(self, mine: dict[str, Any], found: np.ndarray) -> float:
        """The largest relative difference where both have the same coordinates."""
        n, order = self.theirs.nv, self.state.order
        nq = self.theirs.nq
        q, u, udot = (
            mine[x].transpose(0, 2, 1).reshape(-1, mine[x].shape[1])[: nq + n] for x in ("dgq", "dgu", "dgudot")
        )
        joints = list(self.theirs.joints)[1:]
        of_v = np.array([j.idx_v for j in joints if j.nv == 1])
        of_q = np.array([j.idx_q for j in joints if j.nv == 1])
        qq, uu, qu, aq = found.transpose(0, 2, 1)  # written by columns
        pairs = [
            (u[nq:][np.ix_(order, order)], uu), (q[np.ix_(of_q, of_q)], qq[np.ix_(of_v, of_v)]),
            (u[of_q][:, order], qu[of_v]), (udot[of_q][:, order].T, aq[:, of_v]),
        ]  # fmt: skip
        return max(relative(a, b) for a, b in pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--allowed", nargs="*", default=list(NAMES), choices=tuple(NAMES), help="sets of instructions")
    parser.add_argument("--robots", type=Path)
    parser.add_argument("--of", nargs="*", default=["G1"], metavar="MODEL")
    add_options(parser, 5, 15)
    options = parser.parse_args()
    shop, here, rows = workshop(options), machine(), []
    builds = libraries("pinocchio_derivatives", BUILDS, shop)
    print(f"{here['processor']}, {here['instructions']}; {here['compiler']}; " + ", ".join(map(str, builds)))
    with one_core():
        for name in options.of:
            case = Case(name, theirs_of(name, options.robots))
            theirs = [case.pinocchio(build, path) for build, path in builds.items()]
            mine = {which: case.ours(which) for which in options.allowed}
            found = shop.evaluated(theirs[0])["found"].reshape(4, case.theirs.nv, -1)
            worst = max(case.difference(shop.evaluated(c), found) for c in mine.values())
            if worst > AGREEMENT:
                raise SystemExit(f"{name}: results differ by {worst:.1e}")
            times = shop.compete([*mine.values(), *theirs], options.rounds, options.batches, 1e-3)
            for which in options.allowed:
                allowed = [b for b in builds if which == "native" or b.instructions == which]
                own, other = times[f"ordernm, {which}"], fastest(times, PEER, allowed)
                rows.append([name, case.model.nu, NAMES[which], f"{1e6 * own.median:.3g}", f"{1e6 * other.median:.3g}",
                             f"{own.ratio(other):.2f}", CLAIM, f"{worst:.0e}"])  # fmt: skip
    print(f"\n{markdown(HEAD, rows)}")


if __name__ == "__main__":
    main()
