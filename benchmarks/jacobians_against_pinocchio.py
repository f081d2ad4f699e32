"""State Jacobians and mass matrices of chains and of robots beside Pinocchio's `computeABADerivatives` and `crba`.

    pip install pin cmeel-eigen example-robot-data
    python benchmarks/jacobians_against_pinocchio.py [--of CHAIN(7) UR5 ...] [--json FILE] [--allowed native avx2]
                                                     [--robots FOLDER] [--cache FOLDER] [--rounds 5]

C level, one core, one run, all contestants in turns. Ours: `jacobians` by coordinates, speeds and a force along every freedom,
`mass_matrix` and `inverse_mass_matrix`, for each set of instructions at the best of -O2 and -O3; theirs: the template library
with few joint types in all builds of `pinocchio_builds`, `crba` in both conventions; the fastest counts, of builds without
AVX-512 beside ours without. Ours has quaternions' four columns where theirs has three. Results are compared with theirs first,
and Jacobians, mass matrices and inverses with the same statements in 40 digits.

`--robots` is the folder `robots` of the package example-robot-data. A URDF is read by Pinocchio; our model is built from its
joints, placements and inertias (`codegen/measure/pinocchio_models.py`). The first run compiles for minutes; what is compiled
and what is computed in 40 digits stays in the cache folder.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from pinocchio_builds import SCALAR, Build, libraries

import codegen
from codegen.measure.accuracy import relative
from codegen.measure.clock import one_core
from codegen.measure.compiled import Contestant, Functions, Timing, Workshop, add_options, workshop
from codegen.measure.machine import machine
from codegen.measure.pinocchio_models import ROBOTS, ours, theirs_of, usual_state
from codegen.measure.tables import markdown
from codegen.own_files import refuse_foreign_file
from codegen.pipeline import write_solver
from codegen.runtime.standalone.files.whole_file import MARK

LEVELS = ("-O2", "-O3")
FUNCTIONS = ("jacobians", "mass_matrix", "inverse_mass_matrix")
NAMES = {"native": "all instructions", "avx2": "AVX2"}
BUILDS = [
    *(Build("g++", which, ("-O3", *more)) for which in NAMES for more in ((), (SCALAR,))),
    *(Build("g++", which, ("-O2",)) for which in NAMES),
    *(Build("clang++", which) for which in NAMES),
]
"""The widest instructions are no must: on a machine with AVX-512 builds without them compete too."""

MODELS = ("CHAIN(7)", "CHAIN(12)", "CHAIN(24)", "CHAIN(50)", *ROBOTS)
CLAIMS = {
    "Jacobian": dict.fromkeys(("CHAIN(7)", "CHAIN(12)", "UR5", "Panda", "Solo12", "ANYmal"), 0.6)
    | dict.fromkeys(("CHAIN(24)", "CHAIN(50)", "G1", "Talos"), 0.9),
    "mass matrix": dict.fromkeys(("UR5", "Solo12", "ANYmal", "G1", "Talos"), 0.6),
}
"""Time of ours over that of theirs, at most."""

PEERS = {"Jacobian": "computeABADerivatives", "by the state": "computeABADerivatives", "mass matrix": "crba",
         "inverse": "computeABADerivatives"}  # fmt: skip
"""What ours is compared with."""

DECLARATIONS = """\
void *pinocchio_make(int joints, const double *of);
int pinocchio_jacobians(void *solver, const double *q, const double *u, const double *tau);
int pinocchio_mass(void *solver, const double *q, int world);
static void *solver;"""
AGREEMENT = 1e-8
DIGITS = 1e-12
"""What results may differ by: from Pinocchio's, and from 40 digits; relative to the largest entry."""


REVOLUTE, PRISMATIC, FREE, SPHERICAL = range(4)


def axis_of(joint: Any) -> tuple[int, np.ndarray]:
    """Type and axis of a joint."""
    name = joint.shortname().removeprefix("JointModel")
    if name == "FreeFlyer":
        return FREE, np.zeros(3)
    if name == "Spherical":
        return SPHERICAL, np.zeros(3)
    if name in ("RX", "RY", "RZ", "PX", "PY", "PZ"):
        return (PRISMATIC if name[0] == "P" else REVOLUTE), np.eye(3)["XYZ".index(name[1])]
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    motion = np.asarray(data.S).ravel()
    linear, angular = motion[:3], motion[3:]
    return (REVOLUTE, angular) if np.abs(angular).max() > 0 else (PRISMATIC, linear)


def numbers(model: Any) -> np.ndarray:
    """The model as a list of numbers, see pinocchio_derivatives.cpp."""
    rows = []
    for i in range(1, model.njoints):
        type_, axis = axis_of(model.joints[i])
        at, body = model.jointPlacements[i], model.inertias[i]
        rows.append([model.parents[i], type_, *axis, *at.rotation.ravel(), *at.translation, body.mass, *body.lever,
                     *body.inertia.ravel()])  # fmt: skip
    return np.array(rows, dtype=float)


class Case:
    """A model on both sides, and a state of it."""

    def __init__(self, name: str, theirs: Any, layout: str):
        self.name, self.theirs, self.model = name, theirs, ours(theirs, name)
        self.source = write_solver(self.model, layout, functions=FUNCTIONS)
        self.state = usual_state(theirs)

    def ours(self, instructions: str) -> list[Contestant]:
        functions, given = Functions.of(self.source), dict(zip("qu", self.state.ours, strict=True))
        calls: dict[str, Any] = {
            "Jacobian": {"function": "jacobians"}, "by the state": {"function": "jacobians", "without": ("J_inputs",)},
            "mass matrix": {"function": "mass_matrix"}, "inverse": {"function": "inverse_mass_matrix"},
        }  # fmt: skip
        more: dict[str, Any] = {"levels": LEVELS, "instructions": instructions}
        return [
            functions.contestant(given=given, name=f"{what}, {instructions}", **call, **more)
            for what, call in calls.items()
        ]

    def pinocchio(self, build: Build, path: Path) -> list[Contestant]:
        (q, u), of = self.state.theirs, numbers(self.theirs)
        made = f"solver ? solver : (solver = pinocchio_make({len(of)}, a[3]))"
        calls = {"computeABADerivatives": f"pinocchio_jacobians({made}, a[0], a[1], a[2])"}
        calls |= {f"crba {how}": f"pinocchio_mass({made}, a[0], {i})" for i, how in enumerate(("local", "world"))}
        arrays = {"q": q, "u": u, "tau": np.zeros_like(u), "of": of}
        return [
            Contestant(f"{what}, {build}", {}, DECLARATIONS, c, arrays, ["-O3"], [path]) for what, c in calls.items()
        ]

    def found(self, instructions: str, shop: Workshop) -> dict[str, np.ndarray]:
        """What ours computes, matrices as such."""
        n = self.model.nu
        jacobian, _, mass, inverse = (shop.evaluated(c) for c in self.ours(instructions))
        parts = {x: jacobian[f"J_{x}"].reshape(n, -1) for x in ("q", "u", "inputs")}
        named = ((mass, "mass_matrix"), (inverse, "inverse_mass_matrix"))
        results = {f: x[self.source.manifest["functions"][f]["results"][0]].reshape(n, n) for x, f in named}
        return {
            "udot": jacobian["udot"],
            **parts,
            "mass matrix": results[FUNCTIONS[1]],
            "inverse": results[FUNCTIONS[2]],
        }

    def difference(self, found: dict[str, np.ndarray]) -> float:
        """Largest relative difference from theirs, of udot, derivatives along the configuration's tangent, M^-1 and M."""
        q, u = self.state.theirs
        data = self.theirs.createData()
        pin.computeABADerivatives(self.theirs, data, q, u, np.zeros_like(u))
        inverse, mass = (
            np.triu(x) + np.triu(x, 1).T for x in (data.Minv, pin.crba(self.theirs, self.theirs.createData(), q))
        )
        order, square = self.state.order, np.ix_(self.state.order, self.state.order)
        pairs = [
            (found["udot"][order], data.ddq), ((found["q"] @ self.state.rates)[square], data.ddq_dq),
            (found["u"][square], data.ddq_dv), (found["inputs"][square], inverse), (found["inverse"][square], inverse),
            (found["mass matrix"][square], mass),
        ]  # fmt: skip
        return max(relative(a, b) for a, b in pairs)

    def exact(self, cache: Path) -> dict[str, np.ndarray]:
        """The same in 40 digits, rounded: computed once and kept."""
        text = self.source.files[f"{self.model.name}_numpy.py"]
        file = cache / f"digits-{hashlib.sha256(text.encode()).hexdigest()[:20]}.npz"
        if not file.exists():
            print(f"{self.name}: computing in 40 digits", flush=True)
            q, u = self.state.ours
            with tempfile.TemporaryDirectory() as folder:
                codegen.generate(self.model, folder, target="numpy", functions=FUNCTIONS, check=False)
                solver = codegen.load(folder).in_precision(40, self.model)
                J = solver.jacobians(q, u, inputs=np.zeros(self.model.nu))
                found = {"q": J.q, "u": J.u, "inputs": J.inputs, "mass matrix": solver.mass_matrix(q),
                         "inverse": solver.inverse_mass_matrix(q)}  # fmt: skip
            np.savez(file, **{name: value.astype(float) for name, value in found.items()})
        with np.load(file) as kept:
            return dict(kept)


def fastest(times: dict[str, Timing], start: str, builds: Sequence[Build]) -> Timing:
    """The best of theirs."""
    names = [str(b) for b in builds]
    found = [t for name, t in times.items() if name.startswith(start) and name.partition(", ")[2] in names]
    return min(found, key=lambda t: t.median)


def measured(case: Case, builds: dict[Build, Path], options: argparse.Namespace, shop: Workshop) -> dict[str, Any]:
    """Figures of a model."""
    result: dict[str, Any] = {
        "model": case.name, "speeds": case.model.nu, "links": len(case.source.system.links),
        "kinds": len(case.source.system.kinds), "layout": case.source.layout, "difference": 0.0,
    }  # fmt: skip
    exact = case.exact(shop.folder)
    errors = dict.fromkeys(exact, 0.0)
    for which in options.allowed:
        found = case.found(which, shop)
        result["difference"] = max(result["difference"], case.difference(found))
        errors = {n: max(errors[n], relative(found[n], e)) for n, e in exact.items()}
    if result["difference"] > AGREEMENT or max(errors.values()) > DIGITS:
        raise SystemExit(f"{case.name}: results differ by {result['difference']:.1e}, errors {errors}")
    everyone = [c for which in options.allowed for c in case.ours(which)]
    everyone += [c for build, path in builds.items() for c in case.pinocchio(build, path)]
    times = shop.compete(everyone, options.rounds, options.batches, 1e-3)
    result |= {"errors": errors, "ratios": {}, "seconds": {}, "best": {}}
    for which in options.allowed:
        allowed = [b for b in builds if which == "native" or b.instructions == which]
        pairs = {what: (times[f"{what}, {which}"], fastest(times, peer, allowed)) for what, peer in PEERS.items()}
        result["ratios"][which] = {what: mine.ratio(other) for what, (mine, other) in pairs.items()}
        result["best"][which] = {what: f"{mine.level}; {other.name}" for what, (mine, other) in pairs.items()}
        result["seconds"][which] = {what: mine.median for what, (mine, _) in pairs.items()}
        result["seconds"][which] |= {f"{what}, Pinocchio": other.median for what, (_, other) in pairs.items()}
    result["all"] = {name: {level: x.median for level, x in t.levels.items()} for name, t in times.items()}
    return result


def claims(results: Sequence[dict[str, Any]], instructions: Sequence[str]) -> list[str]:
    """Which claims hold, and what misses them."""
    lines = []
    for what, limits in CLAIMS.items():
        for which in instructions:
            of = [(r["model"], r["ratios"][which][what], limits[r["model"]]) for r in results if r["model"] in limits]
            missed = [f"{name} {ratio:.2f} (at most {limit})" for name, ratio, limit in of if ratio > limit]
            lines.append(f"{what}, {NAMES[which]}: {len(of) - len(missed)} of {len(of)} hold"
                         + (f"; missed: {', '.join(missed)}" if missed else ""))  # fmt: skip
    return lines


HEAD = ("", "speeds", "J_q, J_u, J_tau, us", "computeABADerivatives", "ratio", "M, us", "crba", "ratio", "M^-1, us",
        "error of J, M, M^-1")  # fmt: skip


def row(r: dict[str, Any], which: str) -> list[object]:
    """A line of the table of a set of instructions."""
    s, ratio = r["seconds"][which], r["ratios"][which]
    pairs = (
        (f"{1e6 * s[what]:.3g}", f"{1e6 * s[f'{what}, Pinocchio']:.3g}", f"{ratio[what]:.2f}")
        for what in ("Jacobian", "mass matrix")
    )
    return [
        r["model"],
        r["speeds"],
        *(x for p in pairs for x in p),
        f"{1e6 * s['inverse']:.3g}",
        f"{max(r['errors'].values()):.0e}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--allowed", nargs="*", default=list(NAMES), choices=tuple(NAMES), help="sets of instructions")
    parser.add_argument("--robots", type=Path)
    parser.add_argument("--of", nargs="*", default=list(MODELS), metavar="MODEL")
    parser.add_argument("--layout", default="auto")
    parser.add_argument("--json", type=Path)
    add_options(parser, 5, 15)
    options = parser.parse_args()
    if options.json:
        refuse_foreign_file(options.json)
    shop, here, results = workshop(options), machine(), []
    builds = libraries("pinocchio_derivatives", BUILDS, shop)
    print(f"{here['processor']}, {here['instructions']}; {here['compiler']}; " + ", ".join(map(str, builds)))
    with one_core():
        for name in options.of:
            try:
                theirs = theirs_of(name, options.robots)
            except FileNotFoundError as error:
                print(f"{name}: left out, {error}")
                continue
            results.append(r := measured(Case(name, theirs, options.layout), builds, options, shop))
            print(f"{name}: {r['speeds']} speeds, {r['kinds']} kinds, {r['layout']}, difference {r['difference']:.1e}")
            for which, best in r["best"].items():
                shown = (
                    f"{w} {1e6 * r['seconds'][which][w]:.3g} us, {r['ratios'][which][w]:.2f} ({best[w]})" for w in best
                )
                print(f"  {NAMES[which]}: " + "; ".join(shown), flush=True)
    for which in options.allowed:
        print(f"\n{NAMES[which]}\n\n{markdown(HEAD, [row(r, which) for r in results])}")
    found = claims(results, options.allowed)
    print("\n" + "\n".join(found))
    if options.json:
        record = {"written": MARK, "machine": here, "models": results, "claims": found}
        options.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
