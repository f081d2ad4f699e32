"""Operations counted in the emitted blocks: udot, and one more total direction, of chains, ladders and robots.

    python benchmarks/operations.py [CHAIN LADDER HOOKE PINNED UR5 ...] [--sizes 12 100] [--layouts kinds unrolled]
        [--sweeps] [--products]

Of models of any size for each body, of robots (``CHAIN(12)``, ``UR5``, ..., see `codegen.measure.pinocchio_models`) in all. A
direction is dq, du and a parameter together; what all directions share is computed once, after udot. Additions and
multiplications are counted together; divisions, and sines and cosines, apart. Of Jacobians and mass matrices a column is one that
concerns every link. With ``--products``, the counts are those of products with the
Hessian of a weighted sum of udot, beside those of a gradient of the same sum.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from codegen.measure.models import SIZES, sized
from codegen.measure.operations import of_manifest, plain, total
from codegen.measure.tables import markdown
from codegen.pipeline import write_solver

DEFAULT = {"CHAIN": (12, 24, 50, 100), "LADDER": (10, 30, 100), "HOOKE": (10, 30, 100), "PINNED": (10, 30, 100)}
CLAIMS = {("CHAIN", "unrolled"): 270, ("CHAIN", "kinds"): 330, ("LADDER", "auto"): 125, ("HOOKE", "auto"): 700}
"""Operations for each body of udot, at most; one more direction of CHAIN at most 1.0, of LADDER at most 1.2 of them."""

HEAD = ("", "layout", "bodies", "udot", "claim", "divisions", "sin, cos", "one more direction", "of udot", "its divisions",
        "once for all directions")  # fmt: skip
HEAD_PRODUCTS = (
    "",
    "layout",
    "udot",
    "a gradient",
    "products, once for all directions",
    "each direction",
    "one product, in gradients",
)
HEAD_ROBOTS = (
    "",
    "udot",
    "one more direction",
    "once for all directions",
    "Jacobians",
    "a column",
    "mass matrix",
    "a column",
)


def of_each_body(name: str, size: int, layout: str, sweeps: bool) -> list[Any]:
    """A row for a model of any size."""
    m = sized(name, size)
    manifest = m.source(layout).manifest
    forward, along = (of_manifest(manifest, f) for f in ("accelerations", "sensitivities"))
    if sweeps:
        for sweep, parts in along.items():
            print(m, layout, sweep, {p: {k: round(v / m.bodies, 1) for k, v in c.items()} for p, c in parts.items()})
    udot, shared, each = total(forward), total(along), total(along, "per_direction")
    n, direction = m.bodies, plain(each) / plain(udot)
    figures = [x / n for x in (udot["divisions"], udot["functions"], plain(each))]
    more = [each["divisions"] / n, (plain(shared) - plain(udot)) / n]
    return [m, layout, n, f"{plain(udot) / n:.1f}", CLAIMS.get((name, layout), ""), *(f"{x:.1f}" for x in figures),
            f"{direction:.3f}", *(f"{x:.1f}" for x in more)]  # fmt: skip


def products_of_each_body(name: str, size: int, layout: str) -> list[Any]:
    """A row of second derivatives. Sweeps that run repeatedly count repeatedly."""
    m = sized(name, size)
    manifest = m.source(layout, ("accelerations", "gradients", "hessian_products")).manifest

    def counted(function: str) -> list[float]:
        sweeps, runs = of_manifest(manifest, function), manifest["functions"][function]["sweeps"]
        return [plain(total(sweeps, part, runs)) / m.bodies for part in ("per_call", "per_direction")]

    (udot, _), gradient, (once, each) = map(counted, ("accelerations", "sensitivities_transposed", "hessian_products"))
    return [m, layout, *(f"{x:.1f}" for x in (udot, sum(gradient), once, each)), f"{(once + each) / sum(gradient):.2f}"]


def of_robot(folder: Path, name: str, layout: str) -> list[Any]:
    """A row for a robot."""
    from codegen.measure.pinocchio_models import ours, theirs_of

    manifest = write_solver(ours(theirs_of(name, folder), name), layout).manifest
    once, each = (
        {f: plain(total(of_manifest(manifest, f), part)) for f in ("accelerations", "sensitivities", "jacobians", "mass_matrix")}
        for part in ("per_call", "per_direction")
    )  # fmt: skip
    udot = once["accelerations"]
    return [name, udot, each["sensitivities"], once["sensitivities"] - udot,
            *(x[f] for f in ("jacobians", "mass_matrix") for x in (once, each))]  # fmt: skip


def rows(options: argparse.Namespace) -> Iterator[list[Any]]:
    """Of models of any size, by name, size and layout."""
    for name in (n for n in options.names if n in SIZES):
        for layout in options.layouts or (("kinds", "unrolled") if name == "CHAIN" else ("auto",)):
            for size in options.sizes or DEFAULT[name]:
                if options.products:
                    yield products_of_each_body(name, size, layout)
                else:
                    yield of_each_body(name, size, layout, options.sweeps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=["CHAIN"], help="models of any size, or robots")
    parser.add_argument("--sizes", nargs="*", type=int, help="rods, or loops of ladders")
    parser.add_argument("--layouts", nargs="*", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--sweeps", action="store_true", help="print every sweep as well")
    parser.add_argument("--products", action="store_true", help="count second derivatives")
    parser.add_argument("--robots", type=Path, help="the folder `robots` of example-robot-data")
    options = parser.parse_args()
    if found := list(rows(options)):
        print("For each body:\n\n" + markdown(HEAD_PRODUCTS if options.products else HEAD, found))
    if robots := [n for n in options.names if n not in SIZES]:
        layout = (options.layouts or ["unrolled"])[0]
        print("\nIn all:\n\n" + markdown(HEAD_ROBOTS, [of_robot(options.robots, n, layout) for n in robots]))


if __name__ == "__main__":
    main()
