"""The paper's Figs. 5 and 7: cost of forward dynamics and of a sensitivity for closed loops, against n and against m.

    python examples/paper_loops.py [--folder examples/figures] [--small]

Fig. 5: a chain of n rods held at both ends (closed_chain.yaml, 5 constraints). Fig. 7: the ladder of Hooke joints
(hooke_ladder.yaml, L loops, n = 4 L + 2 coordinates, m = 4 L constraints). Four methods, in C with the same flags, each at
the best of -O1, -O2, -O3:

- embedded: the generated code of this project, loops eliminated recursively, O(n + m);
- unconstrained: the generated code of the same tree without its loops, another mechanism: what the paper calls constraints not
  considered, O(n);
- multipliers: M^-1 K and M^-1 J^T by the generated O(n) recursion of the tree, eight columns at once with M's factors at hand,
  and a dense S = J M^-1 J^T: the conventional "order n" method, O(n + n m + n m^2 + m^3);
- dense: M and its direct differentiation (Eqs. 4-9) from composite inertias, Cholesky, and the same S.

The latter two are constrained_chain.c, hand-written; J x, J^T y and all tangents are recursions there, S and Cholesky's method
work in tiles, and a sensitivity uses the factors at hand. Both keep the tree of the model, in which the ladder is one long
chain, and a dense S, as the paper does. With rungs as trees of their own and sparse elimination multipliers are linear in the
ladder too (which is what benchmarks/loops_against_pinocchio.py is against).

Measured is one evaluation from the same consistent arguments: udot; and udot with its total derivative along dq, du and dL, L
the common length of all rods. Embedded loops solve for dependent speeds and complete the seeds in that time; the others take
both as they are given. All constrained methods are compared before anything is timed. Operations are additions and
multiplications: counted in the emitted blocks, and by counters in the hand-written C.

Writes paper_loops.md, two .csv and, where matplotlib is installed, .png.
"""

from __future__ import annotations

import argparse
import csv
import functools
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

HERE = Path(__file__).parent

from ordernm.loops import complete_speeds, partition
from ordernm.measure.clock import one_core
from ordernm.measure.compiled import LEVELS, Contestant, Functions, Workshop, default_cache
from ordernm.measure.models import Sized, sized, text_of
from ordernm.measure.operations import total
from ordernm.measure.tables import markdown
from ordernm.model import Model, parse_model
from ordernm.pipeline import Source, write_solver

AGREEMENT = 1e-9
"""Largest allowed relative difference between two constrained methods, as long as M is well conditioned."""

WELL_CONDITIONED = 50
"""Largest number of coordinates for this check; with more, methods with M lose digits with its condition."""

COMPARED = ("accelerations", "sensitivities")
"""Functions of the generated solvers that are timed."""

METHODS = ("embedded", "unconstrained", "multipliers", "dense")
WORKS = ("forward", "sensitivity")

# --- the mechanisms, for everybody ----------------------------------------------------------------------------------


class Case(NamedTuple):
    """A mechanism with a consistent state and direction: q, u, L, dq, du, dL."""

    mechanism: Sized
    arguments: list[np.ndarray]


def tree_text(name: str, size: int) -> str:
    """The model without its loops."""
    text = text_of(name, size)
    sections, kept = [], True
    for line in text.splitlines():
        if line[:1].isalpha():
            kept = not line.startswith(("loops:", "independent:"))
        if kept:
            sections.append(line)
    return "\n".join(sections).replace("model: ", "model: tree_of_", 1)


@functools.cache
def tree_source(name: str, size: int) -> Source:
    model = parse_model(tree_text(name, size), f"tree of {name}({size})")
    return write_solver(model, functions=(*COMPARED, "solve_mass", "solve_mass_sensitivities"))


def tables_h(model: Model, workspace: int) -> str:
    """The chain of revolute joints and its supports, for constrained_chain.c, relative to the length of the rods."""
    values = {p.name: 1.0 for p in model.parameters}

    def numbers(vector: Any) -> list[float]:
        return [round(float(e.evaluate(values)), 12) for e in vector]

    hinges: list[str] = []
    ends: list[int] = []
    for k, body in enumerate(model.bodies):
        if body.parent != k - 1:
            raise ValueError(f"{model.name} is not a chain")
        axes = [numbers(axis).index(1.0) for axis in body.joint.axes]
        at, middle = numbers(body.joint.at), numbers(body.com)
        along = int(np.argmax(np.abs(middle)))
        rod = (1 + along) * (1 if middle[along] > 0 else -1)
        for i, axis in enumerate(axes):
            place = at if i == 0 else [0.0, 0.0, 0.0]
            last = rod if i == len(axes) - 1 else 0
            hinges.append(f"    {{{{{', '.join(map(repr, place))}}}, {int(any(place))}, {axis}, {last}}},")
        ends.append(len(hinges) - 1)
    feet, rows = [], []
    for i, loop in enumerate(model.loops):
        universal = int(loop.type == "universal")
        feet.append(
            f"    {{{{{', '.join(map(repr, numbers(loop.start.at)))}}}, {ends[loop.start.body]}, {universal}, {len(rows)}}},"
        )
        rows += [i] * (4 if universal else 5)
    return "\n".join([
        f"enum {{ JOINTS = {len(hinges)}, LOOPS = {len(feet)}, ROWS = {len(rows)}, WORK = {workspace} }};",
        "static const struct { double at[3]; int moved, axis, rod; } joints[JOINTS] = {", *hinges, "};",
        "static const struct { double at[3]; int joint, type, row; } loops[LOOPS] = {", *feet, "};",
        f"static const int row_loop[ROWS] = {{{', '.join(map(str, rows))}}};", "",
    ])  # fmt: skip


def constrained_files(m: Sized, tree: bool, count: bool) -> dict[str, str]:
    """constrained_chain.c, and for the recursion of the tree its generated code."""
    head = f"#define TREE {int(tree)}\n" + ("#define COUNT 1\n" if count else "")
    workspace = 1
    files = {"rods.h": (HERE / "rods.h").read_text()}
    if tree:
        source = tree_source(m.name, m.size)
        workspace = source.manifest["workspace"]
        files["tree_solves.c"] = (HERE / "tree_solves.c").read_text()
        for name, text in Functions.of(source).files.items():
            files["tree.inc" if name.endswith(".c") else name] = text
    files["tables.h"] = tables_h(m.model, workspace)
    files["constrained_chain.c"] = head + (HERE / "constrained_chain.c").read_text()
    return files


def case(name: str, size: int, cache: Path) -> Case:
    """Speeds and a direction that keep the loops closed; all lengths change together, so J dq = 0 and J du = -dJ u."""
    m = sized(name, size)
    q, u = m.q, complete_speeds(m.model, partition(m.model), m.q, m.u)
    n, rows = m.model.nu, len(m.model.closure_names)
    k = np.arange(1, n + 1)
    dq, du, length, zero = 0.1 * np.sin(2.0 * k), 0.1 * np.cos(3.0 * k), np.ones(1), np.zeros(n)
    declaration = (
        "void times_rows(const double *, const double *, const double *, const double *, const double *, const double *,"
        " const double *, int, double *);"
    )

    def variant(tangent: int) -> Any:
        arrays = [x.copy() for x in (q, u, length, zero, zero, length, zero, np.zeros(rows))]
        call = f"times_rows(a[0], a[1], a[2], a[3], a[4], a[5], a[6], {tangent}, a[7])"
        files = constrained_files(m, False, False)
        return Workshop(cache).compiled(Contestant("rows", files, declaration, call, arrays, ["-O1"]), "-O1")

    J, plain = np.zeros((rows, n)), variant(0)
    for i in range(n):
        plain.arrays[6][:] = 0
        plain.arrays[6][i] = 1
        plain.seconds(1)
        J[:, i] = plain.arrays[7]
    gram = np.linalg.pinv(J)
    u = u - gram @ (J @ u)  # within the rounding of this J
    dq = dq - gram @ (J @ dq)
    moved = variant(1)
    for place, x in ((1, u), (3, dq), (4, du), (6, u)):
        moved.arrays[place][:] = x
    moved.seconds(1)
    du = du - gram @ (J @ du + moved.arrays[7])
    return Case(m, [q, u, length, dq, du, length])


# --- the methods ----------------------------------------------------------------------------------------------------


class Method(NamedTuple):
    """Contestants for both tasks, with their additions and multiplications."""

    contestants: tuple[Contestant, Contestant]
    operations: tuple[float, float]


RESULTS = (6, 7)
"""Arrays udot and d udot of every contestant."""


def plain(counts: dict[str, int]) -> int:
    return counts["additions"] + counts["multiplications"]


def generated(name: str, source: Source, c: Case) -> Method:
    """A generated solver's accelerations and sensitivities_1."""
    manifest, n = source.manifest, c.mechanism.model.nu
    package, operations = manifest["name"], manifest["operations"]
    arrays = [*c.arguments, np.zeros(n), np.zeros(n), np.zeros(manifest["workspace"])]
    calls = (
        f"{package}_accelerations(a[0], a[1], a[2], a[6], a[8])",
        f"{package}_sensitivities_1(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8])",
    )
    contestants = [
        Contestant(f"{name} {work}", Functions.of(source).files, f'#include "{package}.h"', call, arrays)
        for work, call in zip(WORKS, calls, strict=True)
    ]
    forward, both = (tuple(manifest["functions"][f]["sweeps"]) for f in ("accelerations", "sensitivities"))
    counts = (
        plain(total(operations, "per_call", forward)),
        plain(total(operations, "per_call", both)) + plain(total(operations, "per_direction", both)),
    )
    return Method((contestants[0], contestants[1]), counts)


def constrained(name: str, c: Case, tree: bool, cache: Path) -> Method:
    """constrained_chain.c by one of its two methods."""
    m, n = c.mechanism, c.mechanism.model.nu
    declaration = "int constrained(int" + ", const double *" * 6 + ", double *, double *, double *);"
    contestants, counts = [], []
    for directions, work in enumerate(WORKS):
        arrays = [*c.arguments, np.zeros(n), np.zeros(n), np.zeros(1)]
        call = f"constrained({directions}, a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8])"
        files = constrained_files(m, tree, False)
        contestants.append(Contestant(f"{name} {work}", files, declaration, call, arrays))
        counting = Contestant("count", constrained_files(m, tree, True), declaration, call, arrays, ["-O1"])
        variant = Workshop(cache).compiled(counting, "-O1")
        variant.seconds(1)
        counted = float(variant.arrays[8][0])
        if tree:
            counted += tree_operations(tree_source(m.name, m.size), len(m.model.closure_names), directions)
        counts.append(counted)
    return Method((contestants[0], contestants[1]), (counts[0], counts[1]))


def tree_operations(source: Source, rows: int, directions: int) -> int:
    """The work of tree_solves.c: forward dynamics, solutions for all rows and some more, a tangent of the forces."""
    manifest = source.manifest
    operations = manifest["operations"]
    forward = plain(total(operations, "per_call", tuple(manifest["functions"]["accelerations"]["sweeps"])))
    one = plain(total(operations, "per_direction", ("solve_in", "balance_back")))
    tangent = sum(
        plain(total(operations, part, ("balance_out", "force_tangents"))) for part in ("per_call", "per_direction")
    )
    return forward + (rows + 1) * one + directions * (tangent + 2 * one)


def methods(c: Case, cache: Path) -> dict[str, Method]:
    m = c.mechanism
    return {
        "embedded": generated("embedded", m.source(functions=COMPARED), c),
        "unconstrained": generated("unconstrained", tree_source(m.name, m.size), c),
        "multipliers": constrained("multipliers", c, True, cache),
        "dense": constrained("dense", c, False, cache),
    }


def largest_difference(everyone: dict[str, Method], level: str, cache: Path) -> float:
    """Ratios of the times for udot and its derivative to those of the embedded loops."""
    values = {}
    for name, method in everyone.items():
        variant = Workshop(cache).compiled(method.contestants[1], level)
        variant.seconds(1)
        values[name] = [variant.arrays[i].copy() for i in RESULTS]
    worst = 0.0
    for name in ("multipliers", "dense"):
        for a, b in zip(values[name], values["embedded"], strict=True):
            worst = max(worst, float(np.abs(a - b).max() / np.abs(b).max()))
    return worst


# --- tables and plots -----------------------------------------------------------------------------------------------

HEAD = ["size", "n", "m", *(f"{m} {w}, operations" for w in WORKS for m in METHODS),
        *(f"{m} {w}, us" for w in WORKS for m in METHODS), "largest difference"]  # fmt: skip

Rows = list[list[Any]]


def measured(name: str, sizes: list[int], arguments: argparse.Namespace) -> Rows:
    rows = []
    for size in sizes:
        c = case(name, size, arguments.cache)
        everyone = methods(c, arguments.cache)
        n, m = c.mechanism.model.nu, len(c.mechanism.model.closure_names)
        worst = largest_difference(everyone, arguments.levels[0], arguments.cache)
        if not worst < AGREEMENT and (n <= WELL_CONDITIONED or np.isnan(worst)):
            raise SystemExit(f"{name}({size}): the methods differ by {worst:.1e}")
        contestants = [replace(x, levels=arguments.levels) for method in everyone.values() for x in method.contestants]
        times = Workshop(arguments.cache).compete(contestants, arguments.rounds, arguments.batches, arguments.batch)
        counts = [f"{everyone[x].operations[w]:.0f}" for w in range(2) for x in METHODS]
        took = [f"{times[f'{x} {w}'].median * 1e6:.4g}" for w in WORKS for x in METHODS]
        rows.append([size, n, m, *counts, *took, f"{worst:.0e}"])
        print(
            f"{name}({size}): " + ", ".join(f"{h} {x}" for h, x in zip(HEAD[1:], rows[-1][1:], strict=True)), flush=True
        )
    return rows


def narrow(rows: Rows, unit: str) -> str:
    """The columns of one unit as a table."""
    columns = [i for i, h in enumerate(HEAD) if i < 3 or h.endswith(unit) or i == len(HEAD) - 1]
    return markdown([HEAD[i].removesuffix(unit) for i in columns], [[row[i] for i in columns] for row in rows])


def exponents(rows: Rows, against: int) -> str:
    """Slopes of time over the upper half of the sizes."""
    upper = [row for row in rows if row[against] ** 2 >= rows[0][against] * rows[-1][against]]
    if len(upper) < 3:
        return ""
    x = np.log([row[against] for row in upper])
    slopes = [
        f"{HEAD[i].removesuffix(', us')} {np.polyfit(x, np.log([float(row[i]) for row in upper]), 1)[0]:.2f}"
        for i, h in enumerate(HEAD) if h.endswith(", us")
    ]  # fmt: skip
    return f"Exponents of time over the upper half of the sizes: {', '.join(slopes)}."


def plot(figures: list[tuple[str, Rows, int]], path: Path) -> bool:
    """Operations above, times below; False without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, grid = pyplot.subplots(2, len(figures), figsize=(6 * len(figures), 8.5), layout="constrained")
    for column, (title, rows, against) in enumerate(figures):
        for line, (unit, label) in enumerate(
            ((", operations", "additions and multiplications"), (", us", "CPU time, us"))
        ):
            axes = grid[line][column]
            for i, h in enumerate(HEAD):
                if h.endswith(unit):
                    method, work = h.removesuffix(unit).split()
                    points = [(row[against], float(row[i])) for row in rows]
                    style = "-" if work == "sensitivity" else "--"
                    axes.loglog(*zip(*points, strict=True), style, marker="o", markersize=3,
                                color=f"C{METHODS.index(method)}", label=f"{method}, {work}")  # fmt: skip
            axes.set_ylabel(label)
            axes.set_xlabel("n" if against == 1 else "m")
            axes.set_title(title)
            axes.grid(True, which="both", alpha=0.3)
            axes.legend(fontsize="small")
    figure.savefig(path, dpi=150, metadata={"Software": None})
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / "figures")
    parser.add_argument("--cache", type=Path, default=default_cache(), help="folder of compiled contestants")
    parser.add_argument(
        "--n", type=int, nargs="*", default=[8, 16, 24, 32, 48, 64, 96, 128, 200], help="multiples of 8"
    )
    parser.add_argument("--loops", type=int, nargs="*", default=[1, 2, 3, 4, 6, 8, 12, 20, 30, 50, 75, 100])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=10)
    parser.add_argument("--batch", type=float, default=1e-3, help="seconds")
    parser.add_argument("--small", action="store_true", help="seconds: small mechanisms, no statistics")
    arguments = parser.parse_args()
    arguments.levels = list(LEVELS)
    if arguments.small:
        arguments.n, arguments.loops = [8], [1, 2, 3]
        arguments.rounds, arguments.batches, arguments.levels = 1, 2, ["-O0"]
    with one_core():
        chain, ladder = measured("CLOSED", arguments.n, arguments), measured("HOOKE", arguments.loops, arguments)
    figures = [("closed chain of n rods (Fig. 5)", chain, 1), ("ladder with Hooke joints (Fig. 7)", ladder, 2)]
    arguments.folder.mkdir(parents=True, exist_ok=True)
    text = []
    for title, rows, against in figures:
        text += [f"{title}, operations (additions and multiplications):\n", narrow(rows, ", operations"), ""]
        text += [f"{title}, CPU time, us:\n", narrow(rows, ", us"), "", exponents(rows, against), ""]
    (arguments.folder / "paper_loops.md").write_text("\n".join(text))
    for name, rows in (("paper_loops_chain", chain), ("paper_loops_ladder", ladder)):
        with (arguments.folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD, *rows])
    drawn = plot(figures, arguments.folder / "paper_loops.png")
    print("\n".join(text))
    print(f"written to {arguments.folder}" + ("" if drawn else "; no plot, since matplotlib is not installed"))


if __name__ == "__main__":
    main()
