"""Operations of chains and robots, counted in the emitted blocks: udot, one more direction, Jacobians, mass matrix.

    pip install pin example-robot-data
    python benchmarks/robots_operations.py --robots FOLDER [--names UR5 Panda] [--layout unrolled]

`--robots` as in `jacobians_against_pinocchio.py`, whose models these are. Additions and multiplications are counted together. Of
Jacobians and mass matrices a column is one that concerns every link; beside it stands what all columns share.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ctiming import table

from codegen.measure.pinocchio_models import chain, ours, robot
from codegen.pipeline import write_solver


def counted(manifest: dict[str, Any], function: str) -> tuple[int, int]:
    """Additions and multiplications of a function: once, and per direction or column."""
    found = []
    for part in ("per_call", "per_direction"):
        counts = [manifest["operations"][sweep][part] for sweep in manifest["functions"][function]["sweeps"]]
        found.append(sum(c["additions"] + c["multiplications"] for c in counts))
    return found[0], found[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robots", type=Path, required=True)
    parser.add_argument("--names", nargs="*", default=["CHAIN(12)", "UR5", "Panda", "Solo12"])
    parser.add_argument("--layout", default="unrolled", choices=("auto", "kinds", "unrolled"))
    arguments = parser.parse_args()
    rows = []
    for name in arguments.names:
        theirs = chain(int(name[6:-1])) if name.startswith("CHAIN(") else robot(arguments.robots, name)
        model = ours(theirs, name.lower().replace("(", "").replace(")", ""))
        manifest = write_solver(model, arguments.layout).manifest
        udot, _ = counted(manifest, "accelerations")
        shared, each = counted(manifest, "sensitivities")
        jacobians, mass = counted(manifest, "jacobians"), counted(manifest, "mass_matrix")
        rows.append([name, *map(str, (udot, each, shared - udot, *jacobians, *mass))])
    head = [
        "",
        "udot",
        "one more direction",
        "once for all directions",
        "Jacobians",
        "a column",
        "mass matrix",
        "a column",
    ]
    print(table(head, rows))


if __name__ == "__main__":
    main()
