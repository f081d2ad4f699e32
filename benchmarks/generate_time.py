"""What generating a solver takes, each run in a process of its own with an empty cache.

    python benchmarks/generate_time.py [arm CHAIN12 LADDER1000 HOOKE100 humanoid UR5 path/to/model.yaml ...] [--runs 5]
                                       [--layout auto] [--stages] [--all] [--robots FOLDER] [--before CHECKOUT]

The wall time, and the CPU time with that of compilers, of ``generate FILE --no-check`` from start to exit: the interpreter's own
start, imports included, is in the time; Python's byte code is not written anew. Accelerations and sensitivities are compiled, as
`generate` does. With ``--before`` another checkout takes turns with this one: the least CPU times of both are shown with their
ratio. With ``--stages``, and for `humanoid` and robots, the process says by itself what its CPU time went into: start,
reading, generating, compiling (``--all``: everything); the wall time by stage; and memory. Least times count there.

Names in capitals are chains and ladders of a size; `humanoid` is a random tree of 30 bodies that are all different, with dense
inertias and axes in any direction; UR5, ANYmal, G1 and Talos are URDF of example-robot-data. Claims: 1.5 s for chains of any
length, 2.5 s for the arm, 7 s for HOOKE100; 10 s of CPU time for humanoids of 30 joints.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
DEFAULT = (
    "arm",
    "tree",
    "satellite",
    "CHAIN12",
    "CHAIN100",
    "CHAIN1000",
    "LADDER100",
    "LADDER1000",
    "HOOKE100",
    "PINNED100",
)
CLAIMS = {"arm": 2.5, "CHAIN12": 1.5, "CHAIN100": 1.5, "CHAIN1000": 1.5, "HOOKE100": 7}
ROBOTS = ("UR5", "Panda", "Solo12", "ANYmal", "G1", "Talos")
HEAD = ("model", "wall s, median", "least", "most", "CPU s, median", "claim")
PARTS = ("start", "read", "generate", "compile")
HEAD_COMPARED = ("model", "CPU s before, least", "CPU s, least", "ratio")
HEAD_STAGES = ("model", "speeds", "least wall, s", *(f"{part}, CPU s" for part in PARTS), "all but start", "MB")


def humanoid(bodies: int = 30, seed: int = 3) -> Any:
    """A free body with a random tree of revolute joints on it, no two links alike."""
    import numpy as np

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


def file_of(name: str, folder: Path) -> Path:
    """The model file of a name, written if need be."""
    sized = re.fullmatch(r"([A-Z]+)(\d+)", name)
    if sized and name not in ROBOTS:
        from codegen.measure.models import text_of

        (folder / f"{name.lower()}.yaml").write_text(text_of(sized[1], int(sized[2])))
        return folder / f"{name.lower()}.yaml"
    example = ROOT / "examples" / f"{name}.yaml"
    return example if example.exists() else Path(name).resolve()


def used() -> tuple[float, float]:
    """CPU seconds of this process, and of those that it has waited for."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


def stages(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """CPU seconds of the parts of generating a model, in this process."""
    import codegen
    from codegen.generation import generate
    from codegen.measure.pinocchio_models import ROBOTS, robots_folder

    begun, begin = used(), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = f"{folder}/cache"
        if name in ROBOTS:
            base = "free" if ROBOTS[name].free else "fixed"
            file = (options.robots or robots_folder()) / ROBOTS[name].file
            model = codegen.import_model(file, base=base, free_mimic=True).model
        else:
            model = humanoid() if name == "humanoid" else codegen.load_model(file_of(name, Path(folder)))
        read = used()
        report = generate(
            model, Path(folder) / "package", layout=options.layout, compile="all" if options.all else True
        )
    done = used()
    cpu = (begun[0], read[0] - begun[0], done[0] - read[0], done[1] - begun[1])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    figures = {"speeds": model.nu, "wall": time.perf_counter() - begin, "MB": memory, "by stage": report.seconds}
    return figures | dict(zip(PARTS, cpu, strict=True))


def process(command: list[str], folder: str, checkout: Path = ROOT) -> tuple[float, float, str]:
    """Wall time, CPU time with that of its children, and output of a process with an empty cache."""
    path = os.pathsep.join([str(checkout), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"XDG_CACHE_HOME": f"{folder}/cache", "PYTHONPATH": path}
    before, begin = used()[1], time.perf_counter()
    done = subprocess.run(
        [sys.executable, *command], check=True, env=environment, cwd=folder, stdout=subprocess.PIPE, text=True
    )
    return time.perf_counter() - begin, used()[1] - before, done.stdout


def generated(name: str, options: argparse.Namespace, checkout: Path = ROOT) -> tuple[float, float]:
    """Wall and CPU time of the command."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(file_of(name, Path(folder)))
        command = ["-m", "codegen", "generate", file, "--no-check", "-o", f"{folder}/package"]
        return process([*command, "--layout", options.layout], folder, checkout)[:2]


def whole_runs(name: str, options: argparse.Namespace) -> list[Any]:
    """A row of wall and CPU times of the command."""
    wall, cpu = (sorted(x) for x in zip(*(generated(name, options) for _ in range(options.runs)), strict=True))
    figures = statistics.median(wall), wall[0], wall[-1], statistics.median(cpu)
    return [name, *(f"{x:.2f}" for x in figures), CLAIMS.get(name, "")]


def compared_runs(name: str, options: argparse.Namespace) -> list[Any]:
    """A row of least CPU times of another checkout and of this one, which take turns."""
    runs = [[generated(name, options, of)[1] for of in (options.before, ROOT)] for _ in range(options.runs)]
    before, after = (min(x) for x in zip(*runs, strict=True))
    return [name, f"{before:.2f}", f"{after:.2f}", f"{after / before:.3f}"]


def staged_runs(name: str, options: argparse.Namespace) -> list[Any]:
    """A row of CPU times by stage, the least of several runs each."""
    more = ["--here", "--layout", options.layout, *(["--all"] if options.all else [])]
    more += ["--robots", str(options.robots)] if options.robots else []
    runs = []
    for _ in range(options.runs):
        with tempfile.TemporaryDirectory() as folder:
            runs.append(json.loads(process([__file__, name, *more], folder)[2]))
    print(
        f"{name}: wall by stage: " + ", ".join(f"{stage} {s:.2f}" for stage, s in runs[-1]["by stage"].items()),
        flush=True,
    )
    least = {key: min(run[key] for run in runs) for key in ("wall", "MB", *PARTS)}
    together = sum(least[part] for part in PARTS[1:])
    figures = [f"{least[key]:.2f}" for key in ("wall", *PARTS)]
    return [name, runs[0]["speeds"], *figures, f"{together:.2f}", f"{least['MB']:.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=list(DEFAULT))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--stages", action="store_true", help="CPU time by stage")
    parser.add_argument("--all", action="store_true", help="with --stages: compile all functions")
    parser.add_argument("--robots", type=Path, help="the folder `robots` of example-robot-data")
    parser.add_argument("--before", type=lambda text: Path(text).resolve(), help="another checkout to compare with")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        print(json.dumps(stages(options.models[0], options)))
        return
    from codegen.measure.tables import markdown

    if options.before:
        print(markdown(HEAD_COMPARED, [compared_runs(m, options) for m in options.models]))
        return
    staged = [m for m in options.models if options.stages or m == "humanoid" or m in ROBOTS]
    if whole := [m for m in options.models if m not in staged]:
        print(markdown(HEAD, [whole_runs(m, options) for m in whole]))
    if staged:
        print(markdown(HEAD_STAGES, [staged_runs(m, options) for m in staged]))


if __name__ == "__main__":
    main()
