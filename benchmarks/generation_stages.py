"""What generating a solver takes, stage by stage: CPU seconds in Python, CPU seconds of the compiler, wall time, memory.

python benchmarks/generation_stages.py arm stewart humanoid CHAIN12 LADDER5000 HOOKE100 path/to/model.yaml

Each model in a process of its own with an empty cache. `humanoid` is a random tree of 30 bodies that are all different, with
dense inertias and axes in any direction; names in capitals are chains and ladders of a size. Compiled is what `generate` does;
with ``--all`` everything.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from chains import chain_text
from ladders import TEXTS

EXAMPLES = Path(__file__).parents[1] / "examples"


def humanoid(bodies: int = 30, seed: int = 3) -> Any:
    """A free body with a random tree of revolute joints on it, no two links alike."""
    from codegen.model import ModelBuilder

    rng = np.random.default_rng(seed)
    builder = ModelBuilder("humanoid", gravity=[0, 0, -9.81])
    for k in range(bodies):
        parent = "ground" if k == 0 else f"b{int(k - 1 if rng.random() < 0.8 else rng.integers(0, k))}"
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = turn @ np.diag(rng.uniform(0.02, 0.3, 3)) @ turn.T
        inertia = np.trace(moments) * np.eye(3) - moments
        axis = rng.normal(size=3)
        joint = {"axis": (axis / np.linalg.norm(axis)).tolist(), "rpy": rng.uniform(-1.5, 1.5, 3).tolist()} if k else {}
        builder.body(
            f"b{k}", parent, "revolute" if k else "free", **joint, at=rng.uniform(-0.6, 0.6, 3).tolist(),
            mass=float(rng.uniform(0.3, 2)), com=rng.uniform(-0.4, 0.4, 3).tolist(),
            inertia={a + b: float(inertia["xyz".index(a), "xyz".index(b)]) for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")},
        )  # fmt: skip
    return builder.build()


def model_of(name: str, folder: Path) -> Any:
    """A model, or the file of one."""
    if name == "humanoid":
        return humanoid()
    for family, text in [("CHAIN", chain_text), *TEXTS.items()]:
        if name.startswith(family) and name[len(family) :].isdigit():
            file = folder / f"{name.lower()}.yaml"
            file.write_text(text(int(name[len(family) :])))
            return file
    example = EXAMPLES / f"{name}.yaml"
    return example if example.exists() else Path(name)


def measure(name: str, everything: bool) -> None:
    """Generate a model and print a line."""
    begin = time.perf_counter()
    from codegen.generation import generate

    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = f"{folder}/cache"
        report = generate(model_of(name, Path(folder)), Path(folder) / "package", compile="all" if everything else True)
    wall, mine, others = (
        time.perf_counter() - begin,
        resource.getrusage(resource.RUSAGE_SELF),
        resource.getrusage(resource.RUSAGE_CHILDREN),
    )
    stages = ", ".join(f"{stage} {s:.2f}" for stage, s in report.seconds.items())
    print(
        f"{name}: wall {wall:.2f} s; CPU: Python {mine.ru_utime + mine.ru_stime:.2f} s, compiler "
        f"{others.ru_utime + others.ru_stime:.2f} s; {mine.ru_maxrss / 1024:.0f} MB; wall by stage: {stages}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("models", nargs="+")
    parser.add_argument("--all", action="store_true", help="compile all functions")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    for name in options.models:
        if options.here:
            measure(name, options.all)
        else:
            command = [sys.executable, __file__, name, "--here", *(["--all"] if options.all else [])]
            subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
