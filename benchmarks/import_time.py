"""CPU time of the way from a URDF to a compiled solver: import, generate, compile, each with an empty cache.

python benchmarks/import_time.py [--robots FOLDER] [--runs 3]

Needs the package example-robot-data. Every run is a process of its own; the smallest of each part is printed, in CPU seconds of
the process and its children, so that other work on the machine counts little. The claim is 10 s for humanoids of 30 joints.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from ctiming import table

from codegen.measure.pinocchio_models import robots_folder

ROBOTS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "fixed"),
    "ANYmal C": ("anymal_c_simple_description/urdf/anymal.urdf", "free"),
    "G1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "free"),
    "Talos": ("talos_data/robots/talos_reduced.urdf", "free"),
}

RUN = """
import json, resource, sys, time
begin = time.process_time()
import codegen, codegen.generation, codegen.runtime
def used():
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime
start, wall = used(), time.perf_counter()
found = codegen.import_model(sys.argv[1], base=sys.argv[2], free_mimic=True)
read = used()
codegen.generate(found.model, sys.argv[3])
done = used()
print(json.dumps({"python": start[0], "import": read[0] - start[0], "generate": done[0] - read[0],
                  "compile": done[1] - read[1], "wall": time.perf_counter() - wall, "speeds": found.model.nu}))
"""


def measured(path: Path, base: str) -> dict[str, float]:
    """One run in a fresh folder."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"XDG_CACHE_HOME": f"{folder}/cache"}
        command = [sys.executable, "-c", RUN, str(path), base, f"{folder}/package"]
        ended = subprocess.run(command, check=True, env=environment, cwd=Path(__file__).parents[1], capture_output=True)
        found: dict[str, float] = json.loads(ended.stdout)
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robots", type=Path, default=robots_folder(), help="folder robots of example-robot-data")
    parser.add_argument("--runs", type=int, default=3)
    arguments = parser.parse_args()
    rows = []
    for name, (file, base) in ROBOTS.items():
        runs = [measured(arguments.robots / file, base) for _ in range(arguments.runs)]
        least = {key: min(run[key] for run in runs) for key in runs[0]}
        parts = ("import", "generate", "compile")
        rows.append([name, f"{least['speeds']:.0f}", *(f"{least[p]:.2f}" for p in parts),
                     f"{sum(least[p] for p in parts):.2f}", f"{least['wall']:.1f}"])  # fmt: skip
    print(table(["robot", "speeds", "import, s", "generate, s", "compile, s", "together, s", "least wall, s"], rows))


if __name__ == "__main__":
    main()
