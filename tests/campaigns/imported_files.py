"""Model files of installed packages, imported, and how their accelerations differ from those of the program that they are for.

    python tests/campaigns/imported_files.py --results /tmp/imported.jsonl
    python tests/campaigns/imported_files.py --packages drake mujoco --states 3

URDF is compared with Pinocchio, MJCF with MuJoCo and SDF with Drake, at random states, with the generic engine: nothing is
compiled. Joints that follow others are left independent and loops open on both sides, contacts and stops are off. A file
is imported, rejected with a message, not for an import (a part of a file, a scene without freedoms), or has no peer that
reads it. One that differs has to say so: a line of `Imported.differences`, or a warning; a medium that is listed is left
out on both sides. Packages that are not installed are named and passed over.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import os
import sys
import time
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import codegen  # noqa: E402
from codegen.reference import RecursiveEngine  # noqa: E402

PACKAGES = {
    "example-robot-data": "example_robot_data", "mujoco": "mujoco", "dm_control": "dm_control", "drake": "pydrake",
    "gymnasium-robotics": "gymnasium_robotics", "robosuite": "robosuite", "pybullet": "pybullet_data",
}  # fmt: skip
"""Packages, and the modules in whose folders more of their files may be."""
ENDINGS = (".urdf", ".xml", ".mjcf", ".sdf", ".world")
TOLERANCE = 1e-7
"""Of accelerations, relative to the largest: mass matrices of hands and humanoids have conditions of up to 1e9."""
KNOWN = (ArithmeticError, LookupError, ValueError, TypeError, RuntimeError, OSError, AssertionError, AttributeError)


def files_of(package: str) -> list[Path] | None:
    """The model files of a package; None if it is not installed."""
    try:
        listed = importlib.metadata.files(package)
    except importlib.metadata.PackageNotFoundError:
        return None
    found = {Path(os.path.realpath(str(f.locate()))) for f in listed or () if str(f).endswith(ENDINGS)}
    spec = importlib.util.find_spec(PACKAGES.get(package, package))
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        found |= {path.resolve() for path in Path(folder).rglob("*") if path.suffix in ENDINGS}
    return sorted(path for path in found if path.is_file())


def kind_of(path: Path) -> str:
    """The format of a file, from its root element."""
    text = path.read_bytes()[:200_000].decode("utf-8", "replace")
    for tag, kind in (
        ("<robot", "URDF"),
        ("<mujocoinclude", "part"),
        ("<mujoco", "MJCF"),
        ("<sdf", "SDF"),
        ("<gazebo", "SDF"),
    ):
        place = text.find(tag)
        if place >= 0 and "<" not in text[:place].replace("<!--", "").replace("<?", ""):
            return kind
        if place >= 0 and not _outside_comments(text[:place]):
            return kind
    return "other"


def _outside_comments(text: str) -> str:
    """A text without its comments and declarations."""
    import re

    return re.sub(r"<!--.*?-->|<\?.*?\?>|\s", "", text, flags=re.DOTALL)


def side_of(found: Any) -> tuple[Any, Any]:
    """The engine of a model without its loops, and what the helpers take for a solver."""
    model = replace(found.model, loops=())
    names = SimpleNamespace(
        initial=(np.zeros(len(model.coordinate_names)), np.zeros(len(model.speed_names))),
        coordinate_names=list(model.coordinate_names), speed_names=list(model.speed_names),
    )  # fmt: skip
    return RecursiveEngine(model), names


def apart(ours: np.ndarray, right: np.ndarray) -> float:
    """The largest difference divided by the largest entry; accelerations of free fall count as one."""
    if not np.all(np.isfinite(right)):
        raise LookupError("the peer's accelerations are not finite")
    return float(np.abs(ours - right).max() / max(np.abs(right).max(), 1.0))


def against_pinocchio(path: Path, found: Any, states: int) -> float:
    import pinocchio as pin
    from pinocchio_agreement import states as state_of

    free = found.model.bodies[0].joint.type == "free" and found.model.bodies[0].name not in found.joints.values()
    theirs = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer()) if free else pin.buildModelFromUrdf(str(path))
    if theirs.nv != found.model.nu:
        raise LookupError(f"Pinocchio has {theirs.nv} speeds, here are {found.model.nu}")
    if any(joint.nv not in (1, 6) for joint in list(theirs.joints)[1:]):
        raise LookupError("a planar joint, whose coordinates differ")
    engine, names = side_of(found)
    data, worst = theirs.createData(), 0.0
    for seed in range(states):
        (q, u), here, order, _ = state_of(theirs, found, names, seed)
        right = pin.aba(theirs, data, q, u, -np.array(theirs.damping) * u)
        worst = max(worst, apart(engine.accelerations(*here)[order], right))
    return worst


def against_mujoco(path: Path, found: Any, states: int) -> float:
    import mujoco
    from mujoco_agreement import of_mujoco, ours_of

    model = mujoco.MjModel.from_xml_path(str(path))
    if "of the medium" in " ".join(getattr(found, "differences", ())):  # listed; what else there is has to agree
        model.opt.density = model.opt.viscosity = 0
        model.opt.wind = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    engine, names = side_of(found)
    data, worst = mujoco.MjData(model), 0.0
    rng = np.random.default_rng(0)
    for _ in range(states):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.5)
        data.qvel[:] = rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        q, u, T = of_mujoco(model, data, found, names)
        worst = max(worst, apart(engine.accelerations(q, u), ours_of(model, data, T, data.qacc)))
    return worst


def against_drake(path: Path, found: Any, states: int, name: str) -> float:
    from drake_agreement import accelerations, plant_of

    plant = plant_of(str(path))
    engine, _ = side_of(found)
    return max(apart(*accelerations(plant, name, found, engine, seed)) for seed in range(states))


def imported(path: Path, kind: str, **more: Any) -> Any:
    """The import of a file; the base of a URDF is fixed, or free if nothing else moves."""
    options: dict[str, Any] = {"free_mimic": True, "package_paths": [folder_of(path)], **more}
    try:
        return codegen.import_model(path, **options)
    except codegen.ModelError as error:
        if kind != "URDF" or "everything is fixed" not in str(error):
            raise
        return codegen.import_model(path, base="free", **options)


def folder_of(path: Path) -> Path:
    """The folder of the package that contains a file; all files in it may be read."""
    parts = path.parts
    tops = [i for i, part in enumerate(parts) if part in ("site-packages", "share")]
    return Path(*parts[: tops[-1] + 2]) if tops else path.parent


def models_of(path: Path, kind: str) -> list[str | None]:
    """The values that `--model` may have: the models of a world, if it has several."""
    try:
        imported(path, kind)
    except codegen.ModelError as error:
        if "--model" in str(error) and "no joint connects them" in str(error):
            root = codegen.importing.xml_reading.parse_xml(path.read_bytes(), str(path))
            worlds = list(root.all("world")) or [root]
            return [m.attributes["name"] for w in worlds for m in w.all("model")]
    return [None]


def judged(path: Path, kind: str, states: int, chosen: str | None) -> dict[str, Any]:
    """The outcome of importing a file and comparing it."""
    more = {"model": chosen} if chosen is not None else {}
    try:
        found = imported(path, kind, **more)
    except codegen.ModelError as error:
        first = next(p for p in error.problems if p.severity == "error")
        nothing = "everything is fixed" in str(error)
        return {"outcome": "nothing moves" if nothing else "rejected", "message": first.message, "line": first.line}
    except KNOWN as error:
        return {"outcome": "crashed", "message": f"{type(error).__name__}: {error}"}
    lines = [*getattr(found, "differences", ()), *found.warnings]
    said = {"nu": found.model.nu, "lines": lines, "left_out": list(found.left_out)}
    try:
        if kind == "URDF":
            error_ = against_pinocchio(path, found, states)
        elif kind == "MJCF":
            error_ = against_mujoco(path, found, states)
        else:
            error_ = against_drake(path, found, states, chosen or found_name(path))
    except ImportError as error:
        return {"outcome": "no peer", "message": str(error), **said}
    except KNOWN as error:
        return {"outcome": "not comparable", "message": f"{type(error).__name__}: {error}"[:400], **said}
    if error_ <= TOLERANCE:
        return {"outcome": "agrees", "error": error_, **said}
    return {"outcome": "differs" if lines else "differs in silence", "error": error_, **said}


def found_name(path: Path) -> str:
    """The name, in the file, of the only model of an SDF that moves."""
    root = codegen.importing.xml_reading.parse_xml(path.read_bytes(), str(path))
    models = [*root.all("model"), *(m for w in root.all("world") for m in w.all("model"))]
    moving = [m for m in models if (s := m.first("static")) is None or s.text.strip().lower() not in ("1", "true")]
    return str((moving or models)[0].attributes.get("name", ""))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packages", nargs="+", default=list(PACKAGES))
    parser.add_argument("--states", type=int, default=2)
    parser.add_argument("--every", type=int, default=1, help="take every N-th file only")
    parser.add_argument("--results", type=Path, help="a file of lines of JSON to write")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    if options.results:
        options.results.write_text("")
    table: dict[str, Counter[str]] = {}
    silent = []
    for package in options.packages:
        files = files_of(package)
        if files is None:
            print(f"{package}: not installed; pip install {package}")
            continue
        counts = table.setdefault(package, Counter())
        for path in files[:: options.every]:
            kind = kind_of(path)
            if kind not in ("URDF", "MJCF", "SDF"):
                counts[f"not a model ({kind})"] += 1
                continue
            for chosen in models_of(path, kind) if kind == "SDF" else [None]:
                start = time.process_time()
                record = judged(path, kind, options.states, chosen)
                record = {"package": package, "file": path.name, "kind": kind, "model": chosen, **record}
                record["path"], record["seconds"] = str(path), round(time.process_time() - start, 2)
                counts[f"{kind} {record['outcome']}"] += 1
                if record["outcome"] in ("differs in silence", "crashed"):
                    silent.append(f"{path}: {record['outcome']}: {record.get('error', record.get('message'))}")
                if options.results:
                    with options.results.open("a", encoding="utf-8") as out:
                        out.write(json.dumps(record) + "\n")
        print(f"{package}: {len(files)} files: " + ", ".join(f"{k} {v}" for k, v in sorted(counts.items())), flush=True)
    for line in silent:
        print(line)
    return bool(silent)


if __name__ == "__main__":
    sys.exit(main())
