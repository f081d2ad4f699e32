"""Operations per body of CHAIN(n), counted in the emitted blocks: udot, and one more total direction (dq, du and dL).

python benchmarks/operations.py [n ...]

Sines and cosines, and divisions, are listed apart.
"""

from __future__ import annotations

import argparse

from chains import chain_source
from ctiming import table

CLAIMS = {"unrolled": 270, "kinds": 330}
FORWARD = ("start", "rotations", "kinematics", "triangularize", "back_substitute")
DIRECTION = ("newton_euler_out", "newton_euler_in", "balance_out", "balance_in", "balance_back")


def total(operations: dict[str, dict[str, dict[str, int]]], sweeps: tuple[str, ...], part: str) -> dict[str, int]:
    """Sum over the sweeps."""
    result = dict.fromkeys(("additions", "multiplications", "divisions", "functions"), 0)
    for sweep in sweeps:
        for name, count in operations.get(sweep, {}).get(part, {}).items():
            result[name] += count
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("n", nargs="*", type=int, default=[12, 24, 50, 100])
    parser.add_argument("--layouts", nargs="*", default=["kinds", "unrolled"])
    parser.add_argument("--sweeps", action="store_true", help="print every sweep as well")
    arguments = parser.parse_args()
    rows = []
    for layout in arguments.layouts:
        for n in arguments.n:
            operations = chain_source(n, layout).manifest["operations"]
            if arguments.sweeps:
                for sweep, parts in operations.items():
                    print(layout, n, sweep, {p: {k: round(v / n, 1) for k, v in c.items()} for p, c in parts.items()})
            udot = total(operations, FORWARD, "per_call")
            once, each = total(operations, DIRECTION, "per_call"), total(operations, DIRECTION, "per_direction")
            plain = [(x["additions"] + x["multiplications"]) / n for x in (udot, once, each)]
            row = [layout, n, f"{plain[0]:.1f}", CLAIMS.get(layout, ""), f"{udot['divisions'] / n:.1f}",
                   f"{udot['functions'] / n:.1f}", f"{plain[2]:.1f}", f"{plain[2] / plain[0]:.3f}",
                   f"{plain[1]:.1f}"]  # fmt: skip
            rows.append(row)
    head = ["layout", "n", "udot", "claim", "divisions", "sin, cos", "one more direction", "of udot (claim: 1.0)",
            "once for all directions"]  # fmt: skip
    print(table(head, rows))


if __name__ == "__main__":
    main()
