"""LADDER and PINNED, generated code against Pinocchio's `lcaba` and against CppADCodeGen on its `constraintDynamics`.

    pip install pin cmeel-cppad cmeel-cppadcodegen cmeel-eigen
    python benchmarks/loops_against_pinocchio.py [--instructions avx2] [--rounds 9] [--cache FOLDER] [--ladders 3 12 100]
                                                 [--pinned 12 100]

C level, one run, all contestants in turns. Ours: `accelerations` and `sensitivities_8`, each at the best of -O1, -O2, -O3;
Pinocchio's template library: compiled for this processor at -O3 with its default collection of joint types and with one of
hinges about x and y only, each with and without Eigen's own vectorisation, lcaba with two proximal parameters, the fastest of
these counted (it is an iteration, so its accuracy is shown); CppADCodeGen: straight-line C of udot and d udot/d length, at
the best of the three levels. The state is closed in positions and speeds, so that everybody computes the same accelerations;
they are compared with the closed form of LADDER, and for PINNED with constraintDynamics, which solves for multipliers. No
peer has derivatives with respect to lengths in linear time. The builds are those of `pinocchio_builds`.
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pinocchio_builds import SCALAR, Build, compiled, libraries

from codegen.bench.problems.families import ladder
from codegen.loops import complete_speeds, partition
from codegen.measure.accuracy import relative
from codegen.measure.clock import one_core
from codegen.measure.compiled import Contestant, Functions, Workshop, add_options, workshop
from codegen.measure.models import Sized, sized
from codegen.measure.tables import markdown

BUILDS = [
    Build(flags=("-O3", f"-DJOINTS={joints}", *more))
    for joints in ("HingesOnly", "pinocchio::JointCollectionDefaultTpl")
    for more in ((), (SCALAR,))
]
"""Small matrices are often faster without Eigen's vector instructions."""

PROXIMAL = (1e-6, 1e-8)
"""Pinocchio's manual: a typical value is 1e-6."""

AGREEMENT = {"ours": 1e-9, "CppADCodeGen": 1e-6}
"""Largest relative error; CppADCodeGen's regularises redundant conditions."""

DECLARATIONS = """\
void *pinocchio_make(int linear, int ladder, int size, double mu, double accuracy, int iterations);
int pinocchio_lcaba(void *solver, const double *q, const double *u, double *udot);
int pinocchio_constraint_dynamics(void *solver, const double *q, const double *u, double *udot);
static void *solver;"""

HEAD = ("", "N", "ordernm", "ns", "Pinocchio", "ns", "ratio", "of single rounds", "claim", "our error", "their error")


class Claim(NamedTuple):
    """Time of ours over time of theirs, at most, for some mechanisms; for others the ratio is only shown."""

    ours: str
    theirs: str
    ratio: float | None = None
    of: tuple[str, ...] = ("LADDER", "PINNED")


CLAIMS = (
    Claim("udot", "lcaba", 0.25, ("LADDER",)),
    Claim("udot", "lcaba", 0.3, ("PINNED",)),
    Claim("udot + 8", "lcaba", 0.6),
    Claim("udot + 1", "CppADCodeGen udot + 1", 1.0, ("LADDER",)),
    Claim("udot", "CppADCodeGen udot"),
    Claim("udot", "constraintDynamics"),
)


def pinocchio(m: Sized, build: Build, path: Path, linear: bool, mu: float) -> Contestant:
    """lcaba, or constraintDynamics."""
    ladder = int(m.name == "LADDER")
    accuracy, iterations = (1e-10, 50) if linear else (1e-12, 10 if ladder else 1)
    function = "pinocchio_lcaba" if linear else "pinocchio_constraint_dynamics"
    make = f"pinocchio_make({int(linear)}, {ladder}, {m.size}, {mu!r}, {accuracy!r}, {iterations})"
    call = f"{function}(solver ? solver : (solver = {make}), a[0], a[1], a[2])"
    name = f"lcaba, {mu:.0e}, {build}" if linear else "constraintDynamics"
    return Contestant(name, {}, DECLARATIONS, call, {"q": m.q, "u": m.u, "udot": np.zeros(m.model.nu)}, ["-O3"], [path])


def cppadcodegen(m: Sized, derivative: int, shop: Workshop) -> Contestant:
    """Straight-line code; the result is udot, and d udot/d length behind it."""
    generator = compiled("pinocchio_codegen", Build(flags=("-O1",)), shop, shared=False)
    command = [str(generator), m.name.lower(), str(m.size), str(derivative)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    arrays = {"given": np.concatenate([[1.0], m.q, m.u]), "udot": np.zeros((1 + derivative) * m.model.nu)}
    name = f"CppADCodeGen udot{' + 1' if derivative else ''}"
    return Contestant(name, {"f.c": text}, "void f(const double *, double *);", "f(a[0], a[1])", arrays)


def ours(m: Sized, layout: str) -> list[Contestant]:
    """udot, udot + 1, udot + 8; the single direction is that of the length alone, to compare it."""
    functions, nothing = Functions.of(m.source(layout)), np.zeros((1, m.model.nu))
    alone = m.given() | {"dq": nothing, "du": nothing, "dp": np.ones((1, 1))}
    return [
        functions.contestant("accelerations", m.given(), name="udot"),
        functions.contestant("sensitivities", alone, 1, "udot + 1"),
        functions.contestant("sensitivities", m.given(8), 8, "udot + 8"),
    ]


def errors(m: Sized, everyone: Sequence[Contestant], shop: Workshop) -> dict[str, float]:
    """Relative errors of udot, of PINNED against constraintDynamics; of the derivative, ours against CppADCodeGen's."""
    n, found = m.model.nu, {c.name: shop.evaluated(c) for c in everyone}
    exact = found["constraintDynamics"]["udot"]
    if m.name == "LADDER":
        exact = np.array(ladder(m.size).reference().udot, float)
    result = {name: relative(x["udot"][:n], exact) for name, x in found.items()}
    # At fixed q a pinned chain's d/d length is another one: its pin is fixed, so that dependent q move with the length.
    if "CppADCodeGen udot + 1" in found and m.name == "LADDER":
        theirs = found["CppADCodeGen udot + 1"]["udot"][n:]
        result["derivative"] = relative(found["udot + 1"]["dudot"], theirs)
    return result


def contestants(m: Sized, options: argparse.Namespace, shop: Workshop) -> list[Contestant]:
    """Everybody on one mechanism."""
    builds = libraries("pinocchio_loops", BUILDS, shop)
    everyone = ours(m, options.layout)
    everyone += [pinocchio(m, build, path, True, mu) for build, path in builds.items() for mu in PROXIMAL]
    last = list(builds)[-1]
    everyone.append(pinocchio(m, last, builds[last], False, 1e-10 if m.name == "LADDER" else 0.0))
    if m.bodies <= options.codegen_to:
        everyone += [cppadcodegen(m, derivative, shop) for derivative in (0, 1)]
    return everyone


def compare(m: Sized, options: argparse.Namespace, shop: Workshop) -> tuple[list[list[object]], bool]:
    """Rows of the table for one mechanism, and whether the claims hold."""
    everyone = contestants(m, options, shop)
    difference = errors(m, everyone, shop)
    print(f"{m.name} N = {m.bodies}: " + ", ".join(f"{k} {v:.1e}" for k, v in difference.items()), flush=True)
    limits = {name: AGREEMENT["ours"] for name in difference if name.startswith("udot")}
    for name, limit in {**limits, "derivative": AGREEMENT["CppADCodeGen"]}.items():
        if difference.get(name, 0.0) > limit:
            raise SystemExit(f"{m.name} N = {m.bodies}, {name}: is off by {difference[name]:.1e}")
    times = shop.compete(everyone, options.rounds, options.batches, options.batch)
    rows: list[list[object]] = []
    good = True
    for claim in CLAIMS:
        peers = [t for name, t in times.items() if name == claim.theirs or name.startswith(f"{claim.theirs},")]
        if not peers or m.name not in claim.of:
            continue
        a, b = times[claim.ours], min(peers, key=lambda t: t.median)
        good &= claim.ratio is None or a.ratio(b) <= claim.ratio
        errors_of = (f"{difference[x.name]:.0e}" for x in (a, b))
        rows.append(
            [m.name, m.bodies, claim.ours, *a.beside(b), "" if claim.ratio is None else claim.ratio, *errors_of]
        )
    print(*times.values(), sep="\n", flush=True)
    return rows, good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ladders", nargs="*", type=int, default=[3, 12, 100], help="loops: N = 7, 25, 201 bodies")
    parser.add_argument("--pinned", nargs="*", type=int, default=[12, 100], help="rods")
    parser.add_argument("--codegen-to", type=int, default=12, help="bodies up to which CppADCodeGen takes part")
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--batch", type=float, default=2e-3, help="seconds")
    add_options(parser)
    options = parser.parse_args()
    shop = workshop(options)
    rows: list[list[object]] = []
    good = True
    with one_core():
        for name, sizes in (("LADDER", options.ladders), ("PINNED", options.pinned)):
            for m in (sized(name, size) for size in sizes):
                closed = replace(m, u=complete_speeds(m.model, partition(m.model), m.q, m.u))
                more, fine = compare(closed, options, shop)
                rows, good = rows + more, good and fine
    print(f"\n{shop.widest}. Errors of udot: LADDER against its closed form, PINNED against constraintDynamics.\n")
    print(markdown(HEAD, rows))
    if not good:
        raise SystemExit("a ratio is above its claim")


if __name__ == "__main__":
    main()
