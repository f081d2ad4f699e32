"""Wall time of ``generate FILE --no-check``, from start to exit of the process, with an empty cache.

python benchmarks/generate_time.py [--runs 5] [--layout auto]

Accelerations and sensitivities are compiled, as `generate` does. The interpreter's own start, imports included, is in the time;
Python's byte code is not written anew. What is asked for: 1.5 s for chains of any length, 2.5 s for the arm, 7 s for a Hooke
ladder of 100 loops.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from chains import chain_text
from ctiming import table
from ladders import TEXTS

EXAMPLES = Path(__file__).parents[1] / "examples"


def seconds(file: Path, layout: str) -> tuple[float, float]:
    """One run in a fresh folder: wall time, and CPU time of the process and its children."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"XDG_CACHE_HOME": f"{folder}/cache"}
        environment["PYTHONPATH"] = os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-m", "codegen", "generate", str(file), "--no-check", "-o", f"{folder}/package"]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(
            [*command, "--layout", layout], check=True, env=environment, cwd=folder, stdout=subprocess.DEVNULL
        )
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--only", nargs="*", help="models whose names begin so")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        files = [
            (EXAMPLES / f"{name}.yaml", name, claim)
            for name, claim in (("arm", "2.5"), ("tree", ""), ("satellite", ""))
        ]
        for n in (12, 100, 1000):
            path = Path(folder) / f"chain_{n}.yaml"
            path.write_text(chain_text(n))
            files.append((path, f"CHAIN({n})", "1.5"))
        for name, size, claim in (("LADDER", 100, ""), ("LADDER", 1000, ""), ("HOOKE", 100, "7"), ("PINNED", 100, "")):
            path = Path(folder) / f"{name.lower()}_{size}.yaml"
            path.write_text(TEXTS[name](size))
            files.append((path, f"{name}({size})", claim))
        if arguments.only:
            files = [file for file in files if file[1].startswith(tuple(arguments.only))]
        for path, name, claim in files:
            times = [seconds(path, arguments.layout) for _ in range(arguments.runs)]
            wall, cpu = (sorted(x) for x in zip(*times, strict=True))
            figures = statistics.median(wall), wall[0], wall[-1], statistics.median(cpu)
            rows.append([name, *(f"{x:.2f}" for x in figures), claim])
            print(rows[-1], flush=True)
    print("\n" + table(["model", "wall s, median", "least", "most", "CPU s, median", "claim"], rows))


if __name__ == "__main__":
    main()
