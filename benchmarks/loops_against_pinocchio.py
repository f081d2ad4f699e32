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
peer has derivatives with respect to lengths in linear time.

The first run compiles five C++ libraries, up to several minutes each; they stay in the cache folder. `CMEEL_PREFIX` may name the
folder with Pinocchio's headers where it is not that of this interpreter's packages.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import ctiming
import numpy as np
from ctiming import Contestant, Timing, alternate, compile_variant, default_cache, table, use_one_core
from ladders import Mechanism, accelerations, mechanism, sensitivities, source_of

from codegen.loops import complete_speeds, partition

HERE = Path(__file__).parent
FLAGS = (
    "-std=c++17", "-DNDEBUG", "-w", "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_FUSION_INVOKE_MAX_ARITY=12", "-DPINOCCHIO_IGNORE_DEPRECATED_HEADER",
)  # fmt: skip
COLLECTIONS = {"hinges only": "HingesOnly", "all joints": "pinocchio::JointCollectionDefaultTpl"}
EIGEN: dict[str, tuple[str, ...]] = {"": (), ", Eigen not vectorised": ("-DEIGEN_DONT_VECTORIZE",)}
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


class Claim(NamedTuple):
    """Time of ours over time of theirs, at most, for some mechanisms; for others the ratio is only shown."""

    ours: str
    theirs: str
    ratio: float | None = None
    of: tuple[str, ...] = ()


CLAIMS = (
    Claim("udot", "lcaba", 0.25, ("LADDER",)),
    Claim("udot", "lcaba", 0.3, ("PINNED",)),
    Claim("udot + 8", "lcaba", 0.6, ("LADDER", "PINNED")),
    Claim("udot + 1", "CppADCodeGen udot + 1", 1.0, ("LADDER",)),
    Claim("udot", "CppADCodeGen udot"),
    Claim("udot", "constraintDynamics"),
)


# --- C++ ------------------------------------------------------------------------------------------------------------


def include_folders() -> list[str]:
    prefix = Path(os.environ.get("CMEEL_PREFIX", Path(sysconfig.get_path("purelib")) / "cmeel.prefix"))
    if not (prefix / "include" / "pinocchio").is_dir():
        raise SystemExit(f"no Pinocchio headers in {prefix / 'include'}: pip install pin, or set CMEEL_PREFIX")
    eigen = [p for p in (prefix / "include" / "eigen3", Path("/usr/include/eigen3")) if p.is_dir()]
    if not eigen:
        raise SystemExit("no Eigen headers: pip install cmeel-eigen, or install libeigen3-dev")
    return [word for folder in (prefix / "include", eigen[0]) for word in ("-isystem", str(folder))]


def compile_cpp(name: str, options: Sequence[str], cache: Path) -> Path:
    """Compile one of the C++ files, or take it from the cache."""
    texts = [(HERE / file).read_text() for file in (f"{name}.cpp", "pinocchio_mechanisms.hpp")]
    compiler = os.environ.get("CXX", "g++")
    words = [compiler, *FLAGS, *options, *include_folders()]
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
    digest = hashlib.sha256(repr((texts, words, version)).encode()).hexdigest()[:20]
    target = cache / f"{name}-{digest}"
    if not target.exists():
        cache.mkdir(parents=True, exist_ok=True)
        print(f"compiling {name}.cpp ({' '.join(options)}), minutes", flush=True)
        unfinished = target.with_suffix(".unfinished")
        subprocess.run([*words, str(HERE / f"{name}.cpp"), "-o", str(unfinished), "-ldl"], check=True)
        unfinished.rename(target)
    return target


# --- contestants ----------------------------------------------------------------------------------------------------


class Library(NamedTuple):
    """Pinocchio, compiled with one collection of joint types, and with or without vector instructions in Eigen."""

    build: str
    path: Path


def libraries(cache: Path) -> list[Library]:
    options = ("-O3", *ctiming.FLAGS)
    return [
        Library(f"{name}{how}", compile_cpp("pinocchio_loops", [*options, f"-DJOINTS={joints}", *flags], cache))
        for name, joints in COLLECTIONS.items()
        for how, flags in EIGEN.items()
    ]


def pinocchio(
    m: Mechanism, state: tuple[np.ndarray, np.ndarray], library: Library, linear: bool, mu: float
) -> Contestant:
    """lcaba, or constraintDynamics; the result is array 2."""
    ladder = int(m.name == "LADDER")
    accuracy, iterations = (1e-10, 50) if linear else (1e-12, 10 if ladder else 1)
    function = "pinocchio_lcaba" if linear else "pinocchio_constraint_dynamics"
    make = f"pinocchio_make({int(linear)}, {ladder}, {m.size}, {mu!r}, {accuracy!r}, {iterations})"
    call = f"{function}(solver ? solver : (solver = {make}), a[0], a[1], a[2])"
    name = f"lcaba, {mu:.0e}, {library.build}" if linear else "constraintDynamics"
    return Contestant(name, {}, DECLARATIONS, call, [*state, np.zeros(m.model.nu)], ["-O3"], [library.path])


def cppadcodegen(m: Mechanism, state: tuple[np.ndarray, np.ndarray], derivative: int, cache: Path) -> Contestant:
    """Straight-line code; the result is array 1: udot, and d udot/d length behind it."""
    generator = compile_cpp("pinocchio_codegen", ["-O1"], cache)
    command = [str(generator), m.name.lower(), str(m.size), str(derivative)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    arrays = [np.concatenate([[1.0], *state]), np.zeros((1 + derivative) * m.model.nu)]
    name = f"CppADCodeGen udot{' + 1' if derivative else ''}"
    return Contestant(name, {"f.c": text}, "void f(const double *, double *);", "f(a[0], a[1])", arrays)


def ours(m: Mechanism, state: tuple[np.ndarray, np.ndarray], layout: str) -> list[Contestant]:
    """udot, udot + 1, udot + 8; the single direction is that of the length alone, to compare it."""
    source = source_of(m, layout)
    result = [accelerations(m, source), sensitivities(m, source, 1), sensitivities(m, source, 8)]
    for contestant in result:
        contestant.arrays = [*state, *contestant.arrays[2:]]
    alone = [np.zeros((m.model.nu, 1)), np.zeros((m.model.nu, 1)), np.ones((1, 1))]
    result[1].arrays = [*result[1].arrays[:3], *alone, *result[1].arrays[6:]]
    return result


# --- comparing ------------------------------------------------------------------------------------------------------


def values(contestant: Contestant, array: int, cache: Path) -> np.ndarray:
    """One evaluation, at one level."""
    variant = compile_variant(contestant, contestant.levels[-1], cache)
    variant.seconds(1)
    return variant.arrays[array].ravel().copy()


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(x - reference).max() / np.abs(reference).max())


def ladder_accelerations(loops: int) -> np.ndarray:
    """Of LADDER at a lean of 30 degrees: a pendulum of one angle, rungs about their feet, rails on circles."""
    foot = 1 / 3 + 0.05**2 / 4
    rung = 9.81 / 2 * ((loops + 1) / 2 + loops) / ((loops + 1) * foot + loops)
    signs = np.ones(2 * loops + 1)
    signs[1::2] = -1
    return rung * signs


def errors(m: Mechanism, everyone: Sequence[Contestant], cache: Path) -> dict[str, float]:
    """Relative errors of udot, of PINNED against constraintDynamics; of the derivative, ours against CppADCodeGen's."""
    by_name, n = {c.name: c for c in everyone}, m.model.nu
    theirs = values(by_name["constraintDynamics"], 2, cache)
    exact = ladder_accelerations(m.size) if m.name == "LADDER" else theirs
    result = {"constraintDynamics": relative(theirs, exact)}
    result |= {"udot": relative(values(by_name["udot"], 3, cache), exact)}
    for name, place in (("udot + 1", 6), ("udot + 8", 6)):
        result[name] = relative(values(by_name[name], place, cache), exact)
    for name, contestant in by_name.items():
        if name.startswith("lcaba"):
            result[name] = relative(values(contestant, 2, cache), exact)
        elif name.startswith("CppAD"):
            result[name] = relative(values(contestant, 1, cache)[:n], exact)
    # At fixed q a pinned chain's d/d length is another one: its pin is fixed, so that dependent q move with the length.
    if "CppADCodeGen udot + 1" in by_name and m.name == "LADDER":
        theirs = values(by_name["CppADCodeGen udot + 1"], 1, cache)[n:]
        result["derivative"] = relative(values(by_name["udot + 1"], 7, cache), theirs)
    return result


def fastest(times: dict[str, Timing], start: str) -> Timing | None:
    found = [t for name, t in times.items() if name == start or name.startswith(f"{start},")]
    return min(found, key=lambda t: t.median, default=None)


def compare(m: Mechanism, arguments: argparse.Namespace) -> tuple[list[list[object]], bool]:
    """Rows of the table for one mechanism, and whether the claims hold."""
    chosen = partition(m.model)
    state = m.state[0], complete_speeds(m.model, chosen, *m.state)
    everyone = ours(m, state, arguments.layout)
    for library in libraries(arguments.cache):
        everyone += [pinocchio(m, state, library, True, mu) for mu in PROXIMAL]
    redundant = 1e-10 if m.name == "LADDER" else 0.0
    everyone.append(pinocchio(m, state, library, False, redundant))
    if m.bodies <= arguments.codegen_to:
        everyone += [cppadcodegen(m, state, derivative, arguments.cache) for derivative in (0, 1)]
    difference = errors(m, everyone, arguments.cache)
    print(f"{m.name} N = {m.bodies}: " + ", ".join(f"{k} {v:.1e}" for k, v in difference.items()), flush=True)
    for name, error in difference.items():
        if error > AGREEMENT["ours"] and name.startswith("udot"):
            raise SystemExit(f"{m.name} N = {m.bodies}, {name}: is off by {error:.1e}")
    if difference.get("derivative", 0.0) > AGREEMENT["CppADCodeGen"]:
        raise SystemExit(f"{m.name} N = {m.bodies}: the derivatives differ by {difference['derivative']:.1e}")

    times = alternate(everyone, arguments.cache, arguments.rounds, arguments.batches, arguments.batch)
    rows, good = [], True
    for claim in CLAIMS:
        a, b = times[claim.ours], fastest(times, claim.theirs)
        if b is None:
            continue
        ratio, (low, high) = a.ratio(b), a.spread(b)
        limit = claim.ratio if m.name in claim.of else None
        if claim.of and limit is None:
            continue
        good &= limit is None or ratio <= limit
        error = difference.get(b.name, np.nan)
        rows.append(
            [m.name, m.bodies, claim.ours, f"{a.median * 1e9:.0f} ({a.level})", b.name, f"{b.median * 1e9:.0f}",
             f"**{ratio:.3f}**", f"{low:.3f} to {high:.3f}", "" if limit is None else limit,
             f"{difference[claim.ours]:.0e}", "" if np.isnan(error) else f"{error:.0e}"]
        )  # fmt: skip
        print(rows[-1], flush=True)
    for name, timing in times.items():
        levels = ", ".join(f"{level} {t * 1e9:.0f}" for level, t in timing.all_levels.items())
        print(f"  {name}: {levels}", flush=True)
    return rows, good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--ladders", nargs="*", type=int, default=[3, 12, 100], help="loops: N = 7, 25, 201 bodies")
    parser.add_argument("--pinned", nargs="*", type=int, default=[12, 100], help="rods")
    parser.add_argument("--codegen-to", type=int, default=12, help="bodies up to which CppADCodeGen is asked")
    parser.add_argument("--layout", default="auto", choices=("auto", "kinds", "unrolled"))
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batches", type=int, default=25)
    parser.add_argument("--batch", type=float, default=2e-3, help="seconds")
    parser.add_argument("--cache", type=Path, default=default_cache())
    ctiming.add_instructions(parser)
    arguments = parser.parse_args()
    instructions = ctiming.restrict_instructions(arguments.instructions)
    use_one_core()

    rows: list[list[object]] = []
    good = True
    for name, sizes in (("LADDER", arguments.ladders), ("PINNED", arguments.pinned)):
        for size in sizes:
            more, fine = compare(mechanism(name, size), arguments)
            rows, good = rows + more, good and fine
    head = [
        "",
        "N",
        "ordernm",
        "ns",
        "Pinocchio",
        "ns",
        "ratio",
        "of single rounds",
        "claim",
        "our error",
        "their error",
    ]
    print(f"\n{instructions}. Errors of udot: LADDER against its closed form, PINNED against constraintDynamics.\n")
    print(table(head, rows))
    if not good:
        raise SystemExit("a ratio is above its claim")


if __name__ == "__main__":
    main()
