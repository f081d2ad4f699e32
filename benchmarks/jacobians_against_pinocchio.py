"""State Jacobians and mass matrices of chains and of robots beside Pinocchio's `computeABADerivatives` and `crba`.

    pip install pin cmeel-eigen example-robot-data
    python benchmarks/jacobians_against_pinocchio.py [--of CHAIN(7) UR5 ...] [--json FILE] [--instructions native avx2]
                                                     [--robots FOLDER] [--cache FOLDER] [--rounds 5]

C level, one core, one run, all contestants in turns. Ours: `jacobians` by coordinates, speeds and a force along every freedom,
`mass_matrix` and `inverse_mass_matrix`, for each set of instructions at the best of -O2 and -O3; theirs: the template library
with few joint types in all builds of `pinocchio_builds`, `crba` in both conventions; the fastest counts, of builds without
AVX-512 beside ours without. Ours has quaternions' four columns where theirs has three. Results are compared with theirs first,
and, where mpmath is installed, Jacobians, mass matrices and inverses with the same statements in 40 digits.

`--robots` is the folder `robots` of the package example-robot-data. A URDF is read by Pinocchio; our model is built from its
joints, placements and inertias (`codegen/bench/peers/pinocchio_models.py`). The first run compiles for minutes; what is compiled
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
from chains import c_files
from ctiming import Contestant, Timing, alternate, compile_variant, default_cache, table, use_one_core
from pinocchio_builds import Build, libraries

import codegen
from codegen.measure import pinocchio_models
from codegen.measure.machine import machine
from codegen.measure.pinocchio_models import ROBOTS, axis_of, robots_folder, usual_state
from codegen.own_files import refuse_foreign_file
from codegen.pipeline import write_solver
from codegen.runtime.standalone.whole_file import MARK

LEVELS = ("-O2", "-O3")
FUNCTIONS = ("jacobians", "mass_matrix", "inverse_mass_matrix")
NAMES = {"native": "all instructions", "avx2": "AVX2"}
MODELS = ("CHAIN(7)", "CHAIN(12)", "CHAIN(24)", "CHAIN(50)", *ROBOTS)
CLAIMS = {
    "Jacobian": dict.fromkeys(("CHAIN(7)", "CHAIN(12)", "UR5", "Panda", "Solo12", "ANYmal"), 0.6)
    | dict.fromkeys(("CHAIN(24)", "CHAIN(50)", "G1", "Talos"), 0.9),
    "mass matrix": dict.fromkeys(("UR5", "Solo12", "ANYmal", "G1", "Talos"), 0.6),
}
"""Time of ours over that of theirs, at most."""

DECLARATIONS = """\
void *pinocchio_make(int joints, const double *of);
int pinocchio_jacobians(void *solver, const double *q, const double *u, const double *tau);
int pinocchio_mass(void *solver, const double *q, int world);
static void *solver;"""
AGREEMENT = 1e-8
DIGITS = 1e-12
"""What results may differ by: from Pinocchio's, and from 40 digits; relative to the largest entry."""


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

    def __init__(self, name: str, theirs: Any, layout: str = "auto"):
        self.name, self.theirs = name, theirs
        self.model = pinocchio_models.ours(theirs, name.lower().replace("(", "").replace(")", ""))
        self.source = write_solver(self.model, layout, functions=FUNCTIONS)
        self.state = usual_state(theirs)

    def ours(self, instructions: str) -> list[Contestant]:
        name, n, nq = self.model.name, self.model.nu, self.model.nq
        q, u = self.state.ours
        files, header = c_files(self.source), f'#include "{name}.h"'
        work = np.zeros(self.source.manifest["workspace"])
        given = [q, u, np.zeros(n), np.zeros(n), np.zeros((n, nq)), np.zeros((n, n)), np.zeros((n, n)), work]
        calls = {"Jacobian": (f"jacobians({', '.join(f'a[{i}]' for i in range(8))})", given)}
        calls["by the state"] = ("jacobians(a[0], a[1], a[2], a[3], a[4], a[5], (double *)0, a[7])", given)
        calls["mass matrix"] = ("mass_matrix(a[0], a[1], a[2])", [q, np.zeros((n, n)), work])
        calls["inverse"] = ("inverse_mass_matrix(a[0], a[1], a[2])", [q, np.zeros((n, n)), work])
        return [
            Contestant(f"{what}, {instructions}", files, header, f"{name}_{call}", arrays, LEVELS, (), instructions)
            for what, (call, arrays) in calls.items()
        ]

    def pinocchio(self, build: Build, path: Path) -> list[Contestant]:
        q, u = self.state.theirs
        of = numbers(self.theirs)
        made = f"solver ? solver : (solver = pinocchio_make({len(of)}, a[3]))"
        calls = {"computeABADerivatives": f"pinocchio_jacobians({made}, a[0], a[1], a[2])"}
        calls |= {f"crba {how}": f"pinocchio_mass({made}, a[0], {i})" for i, how in enumerate(("local", "world"))}
        return [
            Contestant(f"{what}, {build}", {}, DECLARATIONS, call, [q, u, np.zeros_like(u), of], ["-O3"], [path])
            for what, call in calls.items()
        ]

    def found(self, instructions: str, cache: Path) -> dict[str, np.ndarray]:
        """What ours computes."""
        found = {}
        for c in self.ours(instructions):
            variant = compile_variant(c, LEVELS[-1], cache)
            variant.seconds(1)
            what = c.name.partition(",")[0]
            if what == "Jacobian":
                found |= dict(zip(("udot", "q", "u", "inputs"), variant.arrays[3:7], strict=True))
            elif what != "by the state":
                found[what] = variant.arrays[1]
        return found

    def difference(self, found: dict[str, np.ndarray]) -> float:
        """Largest relative difference from theirs, of udot, derivatives along the configuration's tangent, M^-1 and M."""
        q, u = self.state.theirs
        data = self.theirs.createData()
        pin.computeABADerivatives(self.theirs, data, q, u, np.zeros_like(u))
        inverse = np.triu(data.Minv) + np.triu(data.Minv, 1).T
        mass = pin.crba(self.theirs, self.theirs.createData(), q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        square = np.ix_(self.state.order, self.state.order)
        pairs = [
            (found["udot"][self.state.order], data.ddq), ((found["q"] @ self.state.rates)[square], data.ddq_dq),
            (found["u"][square], data.ddq_dv), (found["inputs"][square], inverse), (found["inverse"][square], inverse),
            (found["mass matrix"][square], mass),
        ]  # fmt: skip
        return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)

    def exact(self, cache: Path) -> dict[str, np.ndarray] | None:
        """The same in 40 digits, rounded: computed once and kept."""
        try:
            import mpmath  # noqa: F401
        except ImportError:
            return None
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


def measured(case: Case, builds: dict[Build, Path], options: argparse.Namespace) -> dict[str, Any]:
    """Figures of a model."""
    result: dict[str, Any] = {
        "model": case.name, "speeds": case.model.nu, "links": len(case.source.system.links),
        "kinds": len(case.source.system.kinds), "layout": case.source.layout, "ratios": {}, "seconds": {}, "best": {},
    }  # fmt: skip
    exact = case.exact(options.cache)
    for instructions in options.instructions:
        found = case.found(instructions, options.cache)
        result["difference"] = max(result.get("difference", 0.0), case.difference(found))
        if exact is not None:
            errors = {n: float(np.abs(found[n] - e).max() / np.abs(e).max()) for n, e in exact.items()}
            before = result.setdefault("errors", errors)
            result["errors"] = {n: max(e, before[n]) for n, e in errors.items()}
    if result["difference"] > AGREEMENT or max(result.get("errors", {"": 0.0}).values()) > DIGITS:
        raise SystemExit(f"{case.name}: results differ by {result['difference']:.1e}, errors {result.get('errors')}")
    everyone = [c for which in options.instructions for c in case.ours(which)]
    everyone += [c for build, path in builds.items() for c in case.pinocchio(build, path)]
    times = alternate(everyone, options.cache, options.rounds, options.batches, 1e-3)
    for which in options.instructions:
        allowed = [b for b in builds if which == "native" or b.instructions == which]
        for what, peer in (
            ("Jacobian", "computeABADerivatives"),
            ("by the state", "computeABADerivatives"),
            ("mass matrix", "crba"),
            ("inverse", "computeABADerivatives"),
        ):
            mine, other = times[f"{what}, {which}"], fastest(times, peer, allowed)
            result["ratios"].setdefault(which, {})[what] = mine.ratio(other)
            result["seconds"].setdefault(which, {})[what] = mine.median
            result["best"].setdefault(which, {})[what] = f"{mine.level}; {other.name}"
            result["seconds"][which][f"{what}, Pinocchio"] = other.median
    result["all"] = {name: t.all_levels for name, t in times.items()}
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


def rows(results: Sequence[dict[str, Any]], which: str) -> list[list[object]]:
    """Lines of the table of a set of instructions."""
    found: list[list[object]] = []
    for r in results:
        s, ratio, errors = r["seconds"][which], r["ratios"][which], r.get("errors")
        found.append([r["model"], r["speeds"]])
        for what in ("Jacobian", "mass matrix"):
            found[-1] += [f"{1e6 * s[what]:.3g}", f"{1e6 * s[f'{what}, Pinocchio']:.3g}", f"{ratio[what]:.2f}"]
        found[-1] += [f"{1e6 * s['inverse']:.3g}", "" if errors is None else f"{max(errors.values()):.0e}"]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--instructions", nargs="*", default=list(NAMES), choices=tuple(NAMES))
    parser.add_argument("--robots", type=Path, default=robots_folder())
    parser.add_argument("--cache", type=Path, default=default_cache())
    parser.add_argument("--of", nargs="*", default=list(MODELS), metavar="MODEL")
    parser.add_argument("--layout", default="auto")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=15)
    options = parser.parse_args()
    if options.json:
        refuse_foreign_file(options.json)
    builds = libraries(options.cache)
    use_one_core()
    here = machine()
    print(f"{here['processor']}, {here['instructions']}; {here['compiler']}; " + ", ".join(map(str, builds)))
    results = []
    for name in options.of:
        if name in ROBOTS and not (options.robots / ROBOTS[name].file).is_file():
            print(
                f"{name}: left out, {options.robots / ROBOTS[name].file} is not there (pip install example-robot-data)"
            )
            continue
        size = name.removeprefix("CHAIN(").removesuffix(")")
        theirs = pinocchio_models.chain(int(size)) if size.isdigit() else pinocchio_models.robot(options.robots, name)
        r = measured(Case(name, theirs, options.layout), builds, options)
        results.append(r)
        print(f"{name}: {r['speeds']} speeds, {r['kinds']} kinds, {r['layout']}, difference {r['difference']:.1e}")
        for which, best in r["best"].items():
            shown = (
                f"{w} {1e6 * r['seconds'][which][w]:.3g} us, {r['ratios'][which][w]:.2f} ({best[w]})" for w in best
            )
            print(f"  {NAMES[which]}: " + "; ".join(shown), flush=True)
    for which in options.instructions:
        print(f"\n{NAMES[which]}\n\n{table(HEAD, rows(results, which))}")
    found = claims(results, options.instructions)
    print("\n" + "\n".join(found))
    if options.json:
        record = {"written": MARK, "machine": here, "models": results, "claims": found}
        options.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
