"""Operations per body of LADDER(L), HOOKE(L), PINNED(n), counted in the emitted blocks: udot, and one more total direction.

python benchmarks/loops_operations.py [--sizes 10 30 100] [--sweeps]

A direction is dq, du and the length of all bars together. Additions and multiplications are counted together, divisions, and
sines and cosines, apart. What all directions share is computed once, after udot.
"""

from __future__ import annotations

import argparse

from ctiming import table
from ladders import mechanism, source_of
from operations import total

CLAIMS = {"LADDER": "125", "HOOKE": "700", "PINNED": ""}
"""Operations per body for udot, at most."""

DIRECTION_CLAIM = 1.2
"""Of udot, for one more direction of LADDER, at most."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", nargs="*", type=int, default=[10, 30, 100], help="loops, or rods of PINNED")
    parser.add_argument("--names", nargs="*", default=list(CLAIMS), choices=list(CLAIMS))
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--sweeps", action="store_true", help="print every sweep as well")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.names:
        for size in arguments.sizes:
            m = mechanism(name, size)
            manifest = source_of(m, arguments.layout).manifest
            operations, functions = manifest["operations"], manifest["functions"]
            forward, both = (tuple(functions[f]["sweeps"]) for f in ("accelerations", "sensitivities"))
            if arguments.sweeps:
                for sweep in both:
                    parts = {p: {k: round(v / m.bodies, 1) for k, v in c.items()} for p, c in operations[sweep].items()}
                    print(name, size, sweep, parts)
            udot = total(operations, forward, "per_call")
            more, each = total(operations, both, "per_call"), total(operations, both, "per_direction")
            plain = [(x["additions"] + x["multiplications"]) / m.bodies for x in (udot, more, each)]
            limit = DIRECTION_CLAIM if name == "LADDER" else ""
            rows.append(
                [name, size, m.bodies, f"{plain[0]:.1f}", CLAIMS[name], f"{udot['divisions'] / m.bodies:.1f}",
                 f"{udot['functions'] / m.bodies:.1f}", f"{plain[2]:.1f}", f"{plain[2] / plain[0]:.3f}", limit,
                 f"{each['divisions'] / m.bodies:.1f}", f"{plain[1] - plain[0]:.1f}"]
            )  # fmt: skip
    head = ["", "size", "bodies", "udot", "claim", "divisions", "sin, cos", "one more direction", "of udot", "claim",
            "its divisions", "once for all directions"]  # fmt: skip
    print(table(head, rows))


if __name__ == "__main__":
    main()
