"""State Jacobians and mass matrices of chains and of robots beside Pinocchio's `computeABADerivatives` and `crba`.

    pip install pin example-robot-data
    python benchmarks/jacobians_against_pinocchio.py [--instructions avx2] [--robots FOLDER] [--cache FOLDER] [--rounds 7]

C level, one core, one run, all contestants in turns. Ours: `jacobians` by coordinates, speeds and a force along every freedom,
and `mass_matrix`, each at the best of -O1, -O2, -O3; theirs: the template library compiled for this processor at -O3, with few
joint types (with `--all-joints` also with its default collection), with and without Eigen's vectorisation, `crba` in both
conventions; the fastest is counted. Ours has quaternions' four columns where theirs has three. Results are compared first.

`--robots` is the folder `robots` of example-robot-data (in `cmeel.prefix/share/example-robot-data` of the packages). A URDF is
read by Pinocchio; the model is built from its joints, placements and inertias.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

import ctiming
import numpy as np
import pinocchio as pin
from chains import c_files
from ctiming import Contestant, Timing, alternate, compile_variant, default_cache, table, use_one_core
from loops_against_pinocchio import EIGEN, FLAGS, include_folders

from codegen.emit.solver import write_solver
from codegen.model import ModelBuilder

HERE = Path(__file__).parent
COLLECTIONS = {"few joints": "FewJoints", "all joints": "pinocchio::JointCollectionDefaultTpl"}
ROBOTS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", False),
    "Panda": ("panda_description/urdf/panda.urdf", False),
    "Solo12": ("solo_description/robots/solo12.urdf", True),
    "ANYmal": ("anymal_b_simple_description/robots/anymal.urdf", True),
    "Talos": ("talos_data/robots/talos_reduced.urdf", True),
}
"""Files, and whether a robot moves freely."""

DECLARATIONS = """\
void *pinocchio_make(int joints, const double *of);
int pinocchio_jacobians(void *solver, const double *q, const double *u, const double *tau);
int pinocchio_mass(void *solver, const double *q, int world);
void pinocchio_results(void *solver, double *udot, double *by_q, double *by_u, double *mass);
static void *solver;"""
AGREEMENT = 1e-8


def chain(n: int) -> Any:
    """CHAIN(n): uniform rods, hinges about y and x by turns."""
    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([(3 * 0.05**2 + 1) / 12] * 2 + [0.05**2 / 2]))
    for k in range(n):
        joint = pin.JointModelRY() if k % 2 == 0 else pin.JointModelRX()
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if k else 0.0]))
        model.appendBodyToJoint(model.addJoint(k, joint, at, f"link{k}"), inertia, pin.SE3.Identity())
    return model


def robot(file: Path, free: bool) -> Any:
    """A URDF, read by Pinocchio; joints that turn without end as others that turn."""
    read = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer()) if free else pin.buildModelFromUrdf(str(file))
    model = pin.Model()
    for i in range(1, read.njoints):
        kind = read.joints[i].shortname().removeprefix("JointModel")
        joint = read.joints[i]
        if kind.startswith("RUB"):
            joint = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}[kind[3]]()
        model.addJoint(read.parents[i], joint, read.jointPlacements[i], read.names[i])
        model.appendBodyToJoint(i, read.inertias[i], pin.SE3.Identity())
    return model


def axis_of(joint: Any) -> tuple[int, np.ndarray]:
    """Type (0 revolute, 1 prismatic, 2 free) and axis."""
    name = joint.shortname().removeprefix("JointModel")
    if name == "FreeFlyer":
        return 2, np.zeros(3)
    if name in ("RX", "RY", "RZ", "PX", "PY", "PZ"):
        return int(name[0] == "P"), np.eye(3)["XYZ".index(name[1])]
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    motion = data.S.ravel()
    linear, angular = motion[:3], motion[3:]
    return (0, angular) if np.abs(angular).max() > 0 else (1, linear)


def numbers(model: Any) -> np.ndarray:
    """The model as a list of numbers, see pinocchio_derivatives.cpp."""
    rows = []
    for i in range(1, model.njoints):
        type_, axis = axis_of(model.joints[i])
        at, body = model.jointPlacements[i], model.inertias[i]
        rows.append([model.parents[i], type_, *axis, *at.rotation.ravel(), *at.translation, body.mass, *body.lever,
                     *body.inertia.ravel()])  # fmt: skip
    return np.array(rows, dtype=float)


def matrix_to_rpy(R: np.ndarray) -> list[float]:
    return [float(x) for x in pin.rpy.matrixToRpy(R)]


def ours(model: Any, name: str) -> Any:
    """The same model here, with a force along every freedom as an input."""
    builder = ModelBuilder(name, gravity=[0, 0, -9.81])
    for i in range(1, model.njoints):
        type_, axis = axis_of(model.joints[i])
        at, body = model.jointPlacements[i], model.inertias[i]
        parent = "ground" if model.parents[i] == 0 else f"b{model.parents[i]}"
        entries = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        builder.body(
            f"b{i}", parent, ("revolute", "prismatic", "free")[type_],
            **({"axis": [float(x) for x in axis]} if type_ < 2 else {}), at=[float(x) for x in at.translation],
            **({} if np.array_equal(at.rotation, np.eye(3)) else {"rpy": matrix_to_rpy(at.rotation)}),
            mass=float(body.mass), com=[float(x) for x in body.lever],
            inertia={n: float(body.inertia[place]) for n, place in entries.items()},
        )  # fmt: skip
        inputs = [builder.input(f"tau{i}_{k}") for k in range(6 if type_ == 2 else 1)]
        builder.joint_force(f"drive{i}", f"b{i}", inputs if len(inputs) > 1 else inputs[0])
    return builder.build()


def places(model: Any) -> tuple[np.ndarray, np.ndarray]:
    """For each of Pinocchio's coordinates and speeds, where it stands in ours."""
    q: list[int] = []
    u: list[int] = []
    for i in range(1, model.njoints):
        at, v = model.joints[i].idx_q, model.joints[i].idx_v
        free = model.joints[i].nv == 6
        q += [at + k for k in (0, 1, 2, 4, 5, 6, 3)] if free else [at]
        u += [v + k for k in (3, 4, 5, 0, 1, 2)] if free else [v]
    return np.array(q), np.array(u)


def library(build: str, options: list[str], cache: Path) -> Path:
    text = (HERE / "pinocchio_derivatives.cpp").read_text()
    words = [os.environ.get("CXX", "g++"), *FLAGS, "-O3", *ctiming.FLAGS, *options, *include_folders()]
    target = cache / f"pinocchio_derivatives-{ctiming.hashlib.sha256(repr((text, words)).encode()).hexdigest()[:20]}.so"
    if not target.exists():
        cache.mkdir(parents=True, exist_ok=True)
        print(f"compiling Pinocchio, {build}: minutes", flush=True)
        subprocess.run([*words, str(HERE / "pinocchio_derivatives.cpp"), "-o", f"{target}.unfinished"], check=True)
        Path(f"{target}.unfinished").rename(target)
    return target


class Case:
    """A model on both sides, and a state of it."""

    def __init__(self, name: str, theirs: Any, layout: str = "auto"):
        self.name, self.theirs = name, theirs
        self.model = ours(theirs, name.lower().replace("(", "").replace(")", ""))
        self.source = write_solver(self.model, layout)
        where_q, where_u = places(theirs)
        k = np.arange(1, theirs.nq + 1)
        q, u = 0.3 * np.sin(k), 0.2 * np.cos(np.arange(1, theirs.nv + 1))
        for joint in theirs.joints[1:]:
            if joint.nv == 6:
                e = q[joint.idx_q + 3 : joint.idx_q + 7] + [0, 0, 0, 1]
                q[joint.idx_q + 3 : joint.idx_q + 7] = e / np.linalg.norm(e)
        self.their_state = q, u
        self.state = np.empty_like(q), np.empty_like(u)
        self.state[0][where_q], self.state[1][where_u] = q, u
        self.order = where_u

    def ours(self) -> list[Contestant]:
        name, n, nq = self.model.name, self.model.nu, self.model.nq
        q, u = self.state
        work = np.zeros(self.source.manifest["workspace"])
        files = c_files(self.source)
        given = [q, u, np.zeros(n), np.zeros(n), np.zeros((n, nq)), np.zeros((n, n)), np.zeros((n, n)), work]
        calls = ", ".join(f"a[{i}]" for i in range(8))
        found = [Contestant("jacobians", files, f'#include "{name}.h"', f"{name}_jacobians({calls})", given)]
        states = f"{name}_jacobians(a[0], a[1], a[2], a[3], a[4], a[5], (double *)0, a[7])"
        if "IfAsked" in self.model.name or ASKED:
            found.append(Contestant("jacobians by the state", files, f'#include "{name}.h"', states, given))
        call = f"{name}_mass_matrix(a[0], a[1], a[2])"
        found.append(Contestant("mass", files, f'#include "{name}.h"', call, [q, np.zeros((n, n)), work]))
        return found

    def pinocchio(self, build: str, path: Path) -> list[Contestant]:
        q, u = self.their_state
        of = numbers(self.theirs)
        n = self.theirs.nv
        made = f"solver ? solver : (solver = pinocchio_make({len(of)}, a[3]))"
        results = [np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))]
        given = [q, u, np.zeros(n), of, *results]
        calls = {"computeABADerivatives": f"pinocchio_jacobians({made}, a[0], a[1], a[2])"}
        calls |= {f"crba {how}": f"pinocchio_mass({made}, a[0], {i})" for i, how in enumerate(("local", "world"))}
        return [
            Contestant(f"{what}, {build}", {}, DECLARATIONS, call, given, ["-O3"], [path])
            for what, call in calls.items()
        ]

    def agrees(self, cache: Path) -> float:
        """Largest relative difference of udot, of derivatives along the configuration's tangent, of M^-1 and of M."""
        pq, pu = self.their_state
        data = self.theirs.createData()
        pin.computeABADerivatives(self.theirs, data, pq, pu, np.zeros_like(pu))
        by_tau = np.triu(data.Minv) + np.triu(data.Minv, 1).T
        mass = pin.crba(self.theirs, self.theirs.createData(), pq)
        mass = np.triu(mass) + np.triu(mass, 1).T
        jacobians, *_, of_mass = self.ours()
        for contestant in (jacobians, of_mass):
            compile_variant(contestant, "-O2", cache).seconds(1)
        _, _, _, udot, J_q, J_u, J_tau, _ = jacobians.arrays
        square = np.ix_(self.order, self.order)
        rates = self.rates()
        pairs = [
            (udot[self.order], data.ddq), ((J_q @ rates)[square], data.ddq_dq), (J_u[square], data.ddq_dv),
            (J_tau[square], by_tau), (of_mass.arrays[1][square], mass),
        ]  # fmt: skip
        return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)

    def rates(self) -> np.ndarray:
        """How coordinates change along speeds."""
        n, q = self.model.nu, self.state[0]
        rates = np.zeros((self.model.nq, n))
        for joint in self.theirs.joints[1:]:
            i, v = joint.idx_q, joint.idx_v
            if joint.nv == 1:
                rates[i, v] = 1
                continue
            w, x, y, z = q[i + 3 : i + 7]
            rates[i + 3 : i + 7, v : v + 3] = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
            rates[i : i + 3, v + 3 : v + 6] = pin.Quaternion(w, x, y, z).matrix()
        return rates


ASKED = True


def fastest(times: dict[str, Timing], start: str) -> Timing:
    return min((t for name, t in times.items() if name.startswith(start)), key=lambda t: t.median)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    ctiming.add_instructions(parser)
    prefix = Path(os.environ.get("CMEEL_PREFIX", Path(sysconfig.get_path("purelib")) / "cmeel.prefix"))
    parser.add_argument("--robots", type=Path, default=prefix / "share" / "example-robot-data" / "robots")
    parser.add_argument("--cache", type=Path, default=default_cache())
    parser.add_argument("--chains", type=int, nargs="*", default=[7, 12, 24, 50])
    parser.add_argument("--of", nargs="*", default=list(ROBOTS))
    parser.add_argument("--layout", default="auto")
    parser.add_argument("--all-joints", action="store_true")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=15)
    arguments = parser.parse_args()
    use_one_core()
    print(f"instructions: {ctiming.restrict_instructions(arguments.instructions)}")
    collections = list(COLLECTIONS.items())[: 2 if arguments.all_joints else 1]
    libraries = {
        f"{name}{how}": library(f"{name}{how}", [f"-DJOINTS={joints}", *flags], arguments.cache)
        for name, joints in collections
        for how, flags in EIGEN.items()
    }
    models = {f"CHAIN({n})": chain(n) for n in arguments.chains}
    models |= {name: robot(arguments.robots / ROBOTS[name][0], ROBOTS[name][1]) for name in arguments.of}
    rows = []
    for name, theirs in models.items():
        case = Case(name, theirs, arguments.layout)
        difference = case.agrees(arguments.cache)
        print(
            f"{name}: {case.model.nu} speeds, {len(case.source.system.kinds)} kinds, differences {difference:.1e}",
            flush=True,
        )
        if difference > AGREEMENT:
            raise SystemExit(f"{name}: results differ by {difference:.1e}")
        everyone = case.ours() + [c for build, path in libraries.items() for c in case.pinocchio(build, path)]
        times = alternate(everyone, arguments.cache, arguments.rounds, arguments.batches, 1e-3)
        theirs_best, crba = fastest(times, "computeABADerivatives"), fastest(times, "crba")
        both, mass = times["jacobians"], times["mass"]
        state = times["jacobians by the state"]
        rows.append([
            name, case.model.nu, f"{both.median * 1e6:.2f}", f"{state.median * 1e6:.2f}", f"{theirs_best.median * 1e6:.2f}",
            f"{both.ratio(theirs_best):.2f}", f"{mass.median * 1e6:.3f}", f"{crba.median * 1e6:.3f}", f"{mass.ratio(crba):.2f}",
        ])  # fmt: skip
        print("  " + ", ".join(map(str, rows[-1])) + f" ({both.level}, {mass.level}; {theirs_best.name})", flush=True)
    head = ["", "speeds", "J_q, J_u, J_tau, us", "J_q, J_u", "computeABADerivatives", "ratio", "M, us", "crba", "ratio"]
    print("\n" + table(head, rows))


if __name__ == "__main__":
    main()
