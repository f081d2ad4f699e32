"""The paper's Fig. 3: CPU time of the sensitivity of a chain's kinetic energy to the common length of its rods, against n.

    python examples/paper_chain.py [--folder examples/figures] [--closed-form-seconds 600] [--small]

Contestants, all in C with the same flags, each at the best of -O1, -O2, -O3:

- ordernm: the solver generated from examples/chain.yaml, O(n);
- dense: M, K and their direct differentiation (Eqs. 4-9), Cholesky: dense_chain.c, hand-written, M from composite inertias;
- dense, Jacobians: the same with M and dM/dL as the sum over the partial velocities of all bodies, the textbook's way;
- closed form: the paper's own foil, "equations of motion and sensitivity were developed symbolically": M, K and their total
  derivatives as expressions of q, u and L by sympy, shared subexpressions taken out, printed to C; up to the n that the
  seconds allow.

What is measured is one evaluation of a direct differentiation along the motion: from q, u, L and dq/dL, du/dL come udot, the
kinetic energy T and the total derivatives d udot/dL and dT/dL, dT/dL = T_L + T_q dq/dL + T_u du/dL. All contestants
compute all of these 2 n + 2 numbers from the same arguments, and they are compared before anything is timed.

The second part measures time against the number of parameters, 1 to 64, on a chain of 64 rods that share so many lengths:
udot and its total derivative with respect to every one of them.

Writes paper_chain.md and .csv, and .png where matplotlib is installed.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import importlib.metadata
import json
import multiprocessing
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent

from ordernm.measure.clock import one_core
from ordernm.measure.compiled import LEVELS, Contestant, Functions, Timing, Workshop, default_cache
from ordernm.measure.models import chain_state, sized
from ordernm.measure.models import seeds as chain_seeds
from ordernm.measure.tables import markdown
from ordernm.model import parse_model
from ordernm.pipeline import write_solver

AGREEMENT = 1e-10
"""Largest allowed relative difference between two contestants, as long as M is well conditioned."""

WELL_CONDITIONED = 24
"""Largest number of rods for this check; with more, the dense method loses digits with the condition of M."""

DENSE = """int dense(int n, int directions, const double *q, const double *u, const double *l, const double *dq,
          const double *du, const double *dl, double *udot, double *dudot, double *kinetic, double *dkinetic, double *work);"""

# --- contestants for the kinetic energy -----------------------------------------------------------------------------

RESULTS = (6, 7, 8, 9)
"""Arrays udot, d udot/dL, T, dT/dL of each."""


def ordernm(n: int) -> Contestant:
    source = sized("CHAIN", n).source()
    dq, du, dL = chain_seeds(n, 1)
    results = [np.zeros(n), np.zeros(n), np.zeros(1), np.zeros(1)]
    arrays = [*chain_state(n), np.ones(1), dq, du, dL, *results, np.zeros(source.manifest["workspace"])]
    call = (
        "(chain_sensitivities_1(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[10]),"
        " chain_output_sensitivities_1(a[0], a[1], a[2], a[3], a[4], a[5], a[8], a[9], a[10]))"
    )
    return Contestant("ordernm", Functions.of(source).files, '#include "chain.h"', call, arrays)


def dense_files(composite: bool) -> dict[str, str]:
    text = (HERE / "dense_chain.c").read_text()
    return {"dense_chain.c": f"#define COMPOSITE {int(composite)}\n{text}", "rods.h": (HERE / "rods.h").read_text()}


def dense(n: int, composite: bool) -> Contestant:
    dq, du, dL = chain_seeds(n, 1)
    results = [np.zeros(n), np.zeros(n), np.zeros(1), np.zeros(1)]
    arrays = [*chain_state(n), np.ones(n), dq, du, np.full(n, dL[0, 0]), *results, np.zeros(2 * n * n + 104 * n)]
    call = f"dense({n}, 1, a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10])"
    return Contestant("dense" if composite else "dense, Jacobians", dense_files(composite), DENSE, call, arrays)


def closed_form(n: int, text: str, levels: Sequence[str]) -> Contestant:
    dq, du, dL = chain_seeds(n, 1)
    results = [np.zeros(n), np.zeros(n), np.zeros(1), np.zeros(1)]
    arrays = [*chain_state(n), np.ones(1), dq, du, dL, *results]
    declaration = "void closed_form(" + ", ".join(["const double *"] * 6 + ["double *"] * 4) + ");"
    call = "closed_form(" + ", ".join(f"a[{i}]" for i in range(10)) + ")"
    return Contestant("closed form", {"closed_form.c": text}, declaration, call, arrays, levels)


# --- the closed form ------------------------------------------------------------------------------------------------

CLOSED_FORM = """\
#include <math.h>
static void equations(const double *q, const double *u, double L, const double *dq, const double *du, double dL,
                      double M[N][N], double *K, double dM[N][N], double *dK, double *T, double *dT)
{
%s
}

static void solve(double A[N][N], double *x)
{
    for (int k = 0; k < N; ++k) {
        for (int i = 0; i < k; ++i) x[k] -= A[k][i] * x[i];
        x[k] /= A[k][k];
    }
    for (int k = N - 1; k >= 0; --k) {
        for (int i = k + 1; i < N; ++i) x[k] -= A[i][k] * x[i];
        x[k] /= A[k][k];
    }
}

void closed_form(const double *q, const double *u, const double *p, const double *dq, const double *du, const double *dp,
                 double *udot, double *dudot, double *T, double *dT)
{
    double M[N][N], dM[N][N];
    equations(q, u, p[0], dq, du, dp[0], M, udot, dM, dudot, T, dT);
    for (int k = 0; k < N; ++k)
        for (int i = k; i < N; ++i) {
            double x = M[i][k];
            for (int j = 0; j < k; ++j) x -= M[i][j] * M[k][j];
            M[i][k] = i == k ? sqrt(x) : x / M[k][k];
        }
    solve(M, udot);
    for (int k = 0; k < N; ++k)
        for (int i = 0; i < N; ++i) dudot[k] -= dM[k > i ? k : i][k > i ? i : k] * udot[i];
    solve(M, dudot);
}
"""


def closed_form_text(n: int) -> str:
    """M, K, T of CHAIN(n) as expressions of q, u and L, their total derivatives, and C with shared subexpressions."""
    import sympy as sp

    q, u, dq, du = (sp.symbols(f"{name}0:{n}", seq=True) for name in ("q", "u", "dq", "du"))
    L, dL = sp.symbols("L dL")
    radius, g = sp.Float("0.05"), sp.Float("9.81")
    m = L
    central = sp.diag(*(m * (3 * radius**2 + L**2) / 12,) * 2, m * radius**2 / 2)
    R, hinge = sp.eye(3), sp.zeros(3, 1)
    turning = sp.zeros(3, n)  # angular partial velocities, in body axes
    M, K, potential = sp.zeros(n, n), sp.zeros(n, 1), sp.Integer(0)
    speeds = sp.Matrix(u)
    for k in range(n):
        axis = sp.Matrix([0, 1, 0] if k % 2 == 0 else [1, 0, 0])
        turn = sp.rot_ccw_axis2(q[k]) if k % 2 == 0 else sp.rot_ccw_axis1(q[k])
        R = R * turn
        center = hinge + R * sp.Matrix([0, 0, -L / 2])
        hinge = hinge + R * sp.Matrix([0, 0, -L])
        turning = turn.T * turning
        turning[:, k] += axis
        moving = center.jacobian(q)
        omega = turning * speeds
        remainders = [
            sum((J.diff(q[i]) * u[i] for i in range(k + 1)), sp.zeros(3, n)) * speeds for J in (moving, turning)
        ]
        M += m * moving.T * moving + turning.T * central * turning
        K -= moving.T * (m * remainders[0]) + turning.T * (central * remainders[1] + omega.cross(central * omega))
        potential += m * g * center[2]
    K -= sp.Matrix([potential.diff(x) for x in q])
    T = (speeds.T * M * speeds)[0] / 2

    def total(x: Any) -> Any:
        """Total derivative along the seeds, Eq. 10."""
        return x.diff(L) * dL + sum(x.diff(a) * b for a, b in zip((*q, *u), (*dq, *du), strict=True))

    targets, expressions = [], []
    for i in range(n):
        for j in range(i + 1):
            targets += [f"M[{i}][{j}]", f"dM[{i}][{j}]"]
            expressions += [M[i, j], total(M[i, j])]
        targets += [f"K[{i}]", f"dK[{i}]"]
        expressions += [K[i], total(K[i])]
    shared, results = sp.cse([*expressions, T, total(T)], sp.numbered_symbols("x"))
    names = {s: f"{s.name.rstrip('0123456789')}[{s.name.lstrip('dqu')}]" for s in (*q, *u, *dq, *du)}
    lines = [f"    const double {s} = {sp.ccode(e, user_functions={})};" for s, e in shared]
    lines += [f"    {t} = {sp.ccode(e)};" for t, e in zip([*targets, "*T", "*dT"], results, strict=True)]
    text = "\n".join([*(f"    const double {s} = {place};" for s, place in names.items()), *lines])
    return f"#define N {n}\n" + CLOSED_FORM % text


def _write_closed_form(n: int, path: Path) -> None:
    sys.setrecursionlimit(10**6)
    path.with_suffix(".unfinished").write_text(closed_form_text(n))
    path.with_suffix(".unfinished").rename(path)


def _compile(contestant: Contestant, level: str, cache: Path) -> None:
    Workshop(cache).compiled(contestant, level)


def within(seconds: float, function: Any, *arguments: Any) -> float | None:
    """Run a function in a separate process; returns its time in s, or None if it had to be stopped."""
    begin = time.perf_counter()
    process = multiprocessing.get_context("spawn").Process(target=function, args=arguments)
    process.start()
    process.join(max(seconds, 0.0))
    if process.is_alive():
        process.terminate()
        process.join()
        return None
    if process.exitcode:
        raise SystemExit(f"{function.__name__} failed")
    return time.perf_counter() - begin


def closed_forms(ns: Sequence[int], seconds: float, cache: Path) -> dict[int, tuple[Contestant, float, float]]:
    """Closed forms of growing n until the seconds are used up: contestant, seconds for sympy, seconds for gcc -O1.

    Results and times of an earlier run are in the cache and count as if they were computed now.
    """
    result: dict[int, tuple[Contestant, float, float]] = {}
    cache.mkdir(parents=True, exist_ok=True)
    made_by = hashlib.sha256(Path(__file__).read_bytes() + importlib.metadata.version("sympy").encode()).hexdigest()[
        :12
    ]
    left = seconds
    for n in ns:
        name = f"closed_form_{n}-{made_by}"
        path, record = cache / f"{name}.c", cache / f"{name}.json"
        known = json.loads(record.read_text()) if record.exists() else {}
        if "sympy" not in known and known.get("stopped", 0.0) < 0.99 * left:
            took = within(left, _write_closed_form, n, path)
            known = {"stopped": left} if took is None else {"sympy": took}
        left -= known.get("sympy", left)
        if "sympy" in known and "gcc" not in known and left > 0:
            took = within(left, _compile, closed_form(n, path.read_text(), ["-O1"]), "-O1", cache)
            known |= {} if took is None else {"gcc": took}
        left -= known.get("gcc", left)
        record.write_text(json.dumps(known))
        if left <= 0 or "gcc" not in known:
            print(f"closed form: n = {n} not within the {seconds:.0f} s", flush=True)
            break
        text = path.read_text()
        derived, compiled = known["sympy"], known["gcc"]
        result[n] = closed_form(n, text, LEVELS if compiled < 60 else ["-O1"]), derived, compiled
        size = len(text) / 1e3
        print(f"closed form: n = {n}: sympy {derived:.1f} s, gcc -O1 {compiled:.1f} s, {size:.0f} kB of C", flush=True)
    return result


# --- comparing ------------------------------------------------------------------------------------------------------


def largest_difference(contestants: Sequence[Contestant], level: str, cache: Path) -> float:
    """Evaluate all contestants once; return the largest relative difference from the first, array by array."""
    values = []
    for contestant in contestants:
        variant = Workshop(cache).compiled(contestant, level)
        variant.seconds(1)
        values.append([variant.arrays[i].copy() for i in RESULTS])
    worst = 0.0
    for other in values[1:]:
        for a, b in zip(other, values[0], strict=True):
            worst = max(worst, float(np.abs(a.reshape(b.shape) - b).max() / np.abs(b).max()))
    return worst


def microseconds(timing: Timing | None) -> str:
    return "" if timing is None else f"{timing.median * 1e6:.4g}"


def kinetic_energy(arguments: argparse.Namespace) -> tuple[list[str], list[list[Any]]]:
    """The table of Fig. 3."""
    foils = closed_forms(range(1, arguments.closed_form_to + 1), arguments.closed_form_seconds, arguments.cache)
    head = ["n", "ordernm, us", "dense, us", "dense, Jacobians, us", "closed form, us", "dense/ordernm",
            "dense, Jacobians/ordernm", "closed form/ordernm", "largest difference", "sympy, s", "gcc, s"]  # fmt: skip
    rows = []
    for n in sorted({*arguments.n, *foils}):
        contestants = [ordernm(n), dense(n, True), dense(n, False)]
        if n in foils:
            contestants.append(foils[n][0])
        worst = largest_difference(contestants, arguments.levels[0], arguments.cache)
        if worst > AGREEMENT and n <= WELL_CONDITIONED:
            raise SystemExit(f"n = {n}: the contestants differ by {worst:.1e}")
        contestants = [replace(c, levels=sorted({*c.levels} & {*arguments.levels})) for c in contestants]
        times = Workshop(arguments.cache).compete(contestants, arguments.rounds, arguments.batches)
        mine = times["ordernm"]
        everyone = [times.get(name) for name in ("ordernm", "dense", "dense, Jacobians", "closed form")]
        ratios = ["" if t is None else f"{t.ratio(mine):.2f}" for t in everyone[1:]]
        took = [f"{s:.1f}" for s in foils[n][1:]] if n in foils else ["", ""]
        rows.append([n, *map(microseconds, everyone), *ratios, f"{worst:.0e}", *took])
        print(
            f"n = {n}: " + ", ".join(f"{h} {x}" for h, x in zip(head[1:], rows[-1][1:], strict=True) if x), flush=True
        )
    return head, rows


# --- the number of parameters ---------------------------------------------------------------------------------------

LENGTHS = """\
model: lengths
gravity: [0, 0, -9.81]
constants: {{n: {n}, lengths: {p}}}
parameters:
  repeat i in 1..lengths:
    L(i): 1.0
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {{type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -L((k - 2) % lengths + 1)]}}
      shape:
        type: cylinder
        axis: z
        length: L((k - 1) % lengths + 1)
        radius: 0.05
        mass: L((k - 1) % lengths + 1)
        center: [0, 0, -L((k - 1) % lengths + 1)/2]
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
"""


def lengths_ordernm(n: int, p: int) -> Contestant:
    """udot and all p derivatives, eight directions per call, or one or two in the narrower functions. Arrays 3 and 4."""
    source = write_solver(parse_model(LENGTHS.format(n=n, p=p)), functions=["sensitivities"])
    dq, du, _ = chain_seeds(n, p)
    groups = [(i, min(i + 8, p)) for i in range(0, p, 8)]
    widths = [8 if end - begin > 2 else end - begin for begin, end in groups]
    seeds: list[list[np.ndarray]] = [[], [], []]
    for (begin, end), width in zip(groups, widths, strict=True):
        for place, seed in zip(seeds, (dq, du, np.eye(p)), strict=True):
            block = np.zeros((seed.shape[1], width))
            block[:, : end - begin] = seed[begin:end].T
            place.append(block.ravel())
    arrays = [*chain_state(n), np.ones(p), np.zeros(n), np.zeros(n * sum(widths)), *map(np.concatenate, seeds)]
    arrays.append(np.zeros(source.manifest["workspace"]))
    calls, done = [], 0
    for width in widths:
        places = f"a[5] + {n * done}, a[6] + {n * done}, a[7] + {p * done}, a[3], a[4] + {n * done}, a[8]"
        calls.append(f"lengths_sensitivities_{width}(a[0], a[1], a[2], {places})")
        done += width
    return Contestant("ordernm", Functions.of(source).files, '#include "lengths.h"', f"({', '.join(calls)})", arrays)


def lengths_dense(n: int, p: int) -> Contestant:
    """The same by the dense method: M is factorised once, with dM/dp for every parameter. Arrays 6 and 7."""
    dq, du, _ = chain_seeds(n, p)
    dl = np.eye(p)[:, np.arange(n) % p]
    results = [np.zeros(n), np.zeros((p, n)), np.zeros(1), np.zeros(p), np.zeros(2 * n * n + 104 * n)]
    arrays = [*chain_state(n), np.ones(n), dq, du, dl, *results]
    call = f"dense({n}, {p}, a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10])"
    return Contestant("dense", dense_files(True), DENSE, call, arrays)


def parameters_difference(mine: Contestant, foil: Contestant, n: int, p: int, level: str, cache: Path) -> float:
    a, b = (Workshop(cache).compiled(c, level) for c in (mine, foil))
    a.seconds(1)
    b.seconds(1)
    blocks, done = [], 0
    for begin in range(0, p, 8):
        many = min(8, p - begin)
        width = 8 if many > 2 else many
        blocks.append(a.arrays[4][n * done : n * (done + width)].reshape(n, width)[:, :many].T)
        done += width
    derivatives, expected = np.vstack(blocks), b.arrays[7]
    worst = float(np.abs(a.arrays[3] - b.arrays[6]).max() / np.abs(b.arrays[6]).max())
    each = np.abs(derivatives - expected).max(axis=1) / np.abs(expected).max(axis=1)
    return max(worst, float(each.max()))


def parameters(arguments: argparse.Namespace) -> tuple[list[str], list[list[Any]]]:
    """The table of time against the number of parameters."""
    n = arguments.rods
    head = ["parameters", "ordernm, us", "us a parameter", "ns a parameter and rod", "dense, us", "dense/ordernm",
            "largest difference"]  # fmt: skip
    rows = []
    for p in arguments.parameters:
        mine, foil = lengths_ordernm(n, p), lengths_dense(n, p)
        worst = parameters_difference(mine, foil, n, p, arguments.levels[0], arguments.cache)
        if worst > (AGREEMENT if n <= WELL_CONDITIONED else 1e-6):
            raise SystemExit(f"{p} parameters: the contestants differ by {worst:.1e}")
        contestants = [replace(c, levels=arguments.levels) for c in (mine, foil)]
        times = Workshop(arguments.cache).compete(contestants, arguments.rounds, arguments.batches)
        a, b = times["ordernm"], times["dense"]
        each = a.median / p
        ratio = f"{b.ratio(a):.2f}"
        rows.append(
            [p, microseconds(a), f"{each * 1e6:.4g}", f"{each / n * 1e9:.1f}", microseconds(b), ratio, f"{worst:.0e}"]
        )
        print(", ".join(f"{h} {x}" for h, x in zip(head, rows[-1], strict=True)), flush=True)
    return head, rows


# --- writing --------------------------------------------------------------------------------------------------------


def plot(fig3: tuple[list[str], list[list[Any]]], lengths: tuple[list[str], list[list[Any]]], path: Path) -> bool:
    """Both figures side by side; False without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for axes, (head, rows), columns in ((left, fig3, (1, 2, 3, 4)), (right, lengths, (1, 4))):
        for column in columns:
            points = [(row[0], float(row[column])) for row in rows if row[column]]
            axes.loglog(*zip(*points, strict=True), marker="o", markersize=4, label=head[column].removesuffix(", us"))
        axes.set_ylabel("CPU time of one evaluation, us")
        axes.grid(True, which="both", alpha=0.3)
        axes.legend()
    left.set_xlabel("rods n")
    left.set_title("kinetic energy and dT/dL, udot and d udot/dL")
    right.set_xlabel("parameters p")
    right.set_title("udot and its derivatives to p lengths")
    figure.savefig(path, dpi=150, metadata={"Software": None})
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / "figures")
    parser.add_argument("--cache", type=Path, default=default_cache(), help="folder of compiled contestants")
    parser.add_argument("--closed-form-seconds", type=float, default=600.0, help="for sympy and gcc, all n together")
    parser.add_argument("--closed-form-to", type=int, default=12)
    parser.add_argument("--n", type=int, nargs="*", default=[1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 100, 150, 200])
    parser.add_argument("--parameters", type=int, nargs="*", default=[1, 2, 4, 8, 16, 24, 32, 48, 64])
    parser.add_argument("--rods", type=int, default=64, help="rods of the chain with many parameters")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batches", type=int, default=15)
    parser.add_argument("--small", action="store_true", help="a few seconds: small chains, no statistics")
    arguments = parser.parse_args()
    arguments.levels = list(LEVELS)
    if arguments.small:
        arguments.n, arguments.closed_form_to, arguments.parameters, arguments.rods = [1, 2, 4], 2, [1, 2, 3, 9], 9
        arguments.rounds, arguments.batches, arguments.levels = 1, 2, ["-O1"]
    with one_core():
        fig3, lengths = kinetic_energy(arguments), parameters(arguments)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    text = [
        "CPU time of one evaluation of T, dT/dL, udot and d udot/dL of CHAIN(n):\n", markdown(*fig3),
        f"\nudot and its total derivatives with respect to p lengths, {arguments.rods} rods:\n", markdown(*lengths), "",
    ]  # fmt: skip
    (arguments.folder / "paper_chain.md").write_text("\n".join(text))
    for name, (head, rows) in (("paper_chain", fig3), ("paper_chain_parameters", lengths)):
        with (arguments.folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])
    drawn = plot(fig3, lengths, arguments.folder / "paper_chain.png")
    print("\n".join(text))
    print(f"written to {arguments.folder}" + ("" if drawn else "; no plot, since matplotlib is not installed"))


if __name__ == "__main__":
    main()
