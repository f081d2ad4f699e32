"""Generated C against the reference engines, and rules that the C code follows."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from comparison import compare, error, worst
from random_models import random_tree

import codegen
from codegen.emit.c import C, sines
from codegen.emit.c.block_lines import FEW
from codegen.emit.c.vectors import words
from codegen.emit.repetition import json_text
from codegen.emit.target import Scalar
from codegen.emit.templates import render
from codegen.model import parse_model
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime.standalone.trust.rounding import DIRECTED, rounding

CHAIN = """
model: chain
gravity: [0, 0, -9.81]
constants: {{n: {n}, rho: 1.0, radius: 0.05}}
parameters:
  L: {{value: 1.0, unit: m}}
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {{type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -L]}}
      shape: {{type: cylinder, axis: z, length: L, radius: radius, mass: rho*L, center: [0, 0, -L/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
"""


def test_functions_of_many_links_compute_values_common_to_all_directions_once() -> None:
    """Not once for each vector of directions: compilers do not see that stored vectors leave these values alone."""
    text = write_solver(parse_model(CHAIN.format(n=20)), "kinds", functions=("sensitivities",)).files
    functions = re.findall(r"\(DIRECTIONS\(call\) \*a, int i\)\n\{\n(.*?)\n\}", text["chain_directions.h"], re.S)
    few = 0
    for before, _, inside in (body.partition("EACH_VECTOR {") for body in functions):
        assert "const VECTOR" not in before
        count = before.count("const double ") + inside.count("const double ")
        few += 0 < count <= FEW
        assert "const double " not in inside or count > FEW
    assert few > 2


def check_random_trees(seeds: range, folder: Path, largest: int, layout: str = "auto") -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        model = random_tree(rng, int(rng.integers(1, largest + 1)))
        codegen.generate(model, folder / str(seed), layout=layout, compile="all")
        recursive, dense = RecursiveEngine(model), DenseEngine(model)
        for target in ("c", "numpy"):
            solver = codegen.load(folder / str(seed), target)
            for engine in (recursive, dense):
                found = compare(model, solver, engine, np.random.default_rng(seed), transposed=engine is recursive)
                bad = {name: e for name, e in found.items() if not e < 1e-11}
                assert not bad, (seed, target, type(engine).__name__, bad)


def test_generated_is_generic_is_dense_on_random_trees(tmp_path: Path) -> None:
    check_random_trees(range(1002, 1003), tmp_path, largest=5)


@pytest.mark.campaign
def test_generated_is_generic_is_dense_on_many_random_trees(tmp_path: Path) -> None:
    check_random_trees(range(1001, 1002), tmp_path, largest=5)
    check_random_trees(range(2000, 2040), tmp_path, largest=10)


@pytest.mark.parametrize("layout", ["kinds", "unrolled"])
def test_both_layouts(tmp_path: Path, layout: str) -> None:
    check_random_trees(range(3000, 3001), tmp_path, largest=5, layout=layout)


@pytest.mark.parametrize("n", [4, 30, pytest.param(100, marks=pytest.mark.campaign)])
def test_the_chain_agrees_with_fifty_digits(tmp_path: Path, n: int) -> None:
    model = parse_model(CHAIN.format(n=n))
    codegen.generate(model, tmp_path / "chain")
    solver = codegen.load(tmp_path / "chain")
    k = np.arange(1, n + 1)
    q, u = 0.3 * np.sin(k), 0.2 * np.cos(k)
    dq = np.array([np.zeros(n), 0.1 * np.sin(2.0 * k)])
    du = np.array([np.zeros(n), 0.1 * np.cos(3.0 * k)])
    dp = np.ones((2, 1))
    udot, dudot = solver.sensitivities(q, u, dq=dq, du=du, dp=dp)
    with mpmath.workdps(50):
        reference, dreference = RecursiveEngine(model, numbers="mpmath").sensitivities(q, u, dq=dq, du=du, dp=dp)
    reference, dreference = np.asarray(reference, dtype=float), np.asarray(dreference, dtype=float)
    assert error(udot, reference) < 1e-13
    assert worst(dudot, dreference) < 1e-13


# -- what the C is ---------------------------------------------------------------------------------------------------------

EVERYTHING = """
model: everything
gravity: [0, 0, -g]
parameters: {g: 9.81, a: 0.4, m: 1.3}
inputs: [motor]
bodies:
  base: {parent: ground, joint: {type: free}, mass: m, inertia: {xx: 0.2, yy: 0.3, zz: 0.25}}
  arm: {parent: base, joint: {type: revolute, axis: [1, 2, a], at: [a, 0, 0.1]}, mass: 1, com: [0, 0, a/2],
        inertia: {xx: 0.1, yy: 0.1, zz: 0.05}}
  slide: {parent: arm, joint: {type: prismatic, axis: -x, at: [0, 0, a]}, mass: 0.5, inertia: {xx: 0.1, yy: 0.1, zz: 0.05}}
  ball: {parent: base, joint: {type: spherical, at: [0, a, 0]}, mass: 0.5, com: [0, 0.1, 0],
         inertia: {xx: 0.1, yy: 0.1, zz: 0.05}}
  cross: {parent: slide, joint: {type: universal, axes: [y, x], at: [0, 0.1, 0]}, mass: 0.5, com: [0, 0, 0.2],
          inertia: {xx: 0.1, yy: 0.1, zz: 0.05}}
  plate: {parent: cross, joint: {type: fixed, at: [0, 0, 0.3], rotate: [{axis: y, angle: a}]}, mass: 0.2,
          inertia: {xx: 0.01, yy: 0.01, zz: 0.02}}
forces:
  drive: {type: joint, joint: arm, value: "motor*sin(t) - max(u.arm, abs(q.slide))*a"}
outputs:
  height: {position: {body: plate, at: [0, 0, a]}, axis: [1, 0, 1]}
  speed: {velocity: {body: cross, at: [0, a, 0]}, axis: z}
  kinetic: kinetic_energy
  potential: potential_energy
  power: {value: motor*u.arm}
"""


@cache
def files_of_everything() -> dict[str, str]:
    return codegen.pipeline.write_solver(parse_model(EVERYTHING)).files  # once in all processes, as `made_once` has it


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of a model with everything, not compiled."""
    folder = tmp_path_factory.mktemp("package") / "everything"
    codegen.generate(parse_model(EVERYTHING), folder, compile=False)
    return folder


def write(folder: Path) -> Path:
    for name, content in files_of_everything().items():
        (folder / name).write_text(content)
    return folder / "everything.c"


def compilers() -> list[Any]:
    return [
        pytest.param(c, marks=[] if shutil.which(c) else pytest.mark.skip(reason=f"{c} is not installed"))
        for c in ("gcc", "clang")
    ]


@pytest.mark.parametrize("compiler", compilers())
@pytest.mark.parametrize(
    "flags",
    [
        pytest.param("-O1 -march=native", marks=pytest.mark.campaign),
        "-O0 -DORDERNM_PLAIN_C -std=c99 -pedantic",
        "-fsyntax-only -march=native",
        "-fsyntax-only -mavx2",
        "-fsyntax-only",
    ],
)
def test_no_warnings(tmp_path: Path, compiler: str, flags: str) -> None:
    """Warnings of the optimiser: the sanitizers' tests build with -O2 and -O3."""
    if "avx2" in flags and os.uname().machine != "x86_64":
        pytest.skip("-mavx2 is a flag of x86-64")
    source = write(tmp_path)
    command = [compiler, "-Wall", "-Wextra", "-Werror", *flags.split(), "-c", str(source), "-o", str(tmp_path / "x.o")]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[:2000]


CORNERS = {
    "a rotation that nothing depends on": """
bodies:
  ball: {parent: ground, joint: {type: spherical}, mass: 2, inertia: {xx: 0.4, yy: 0.4, zz: 0.4}}
""",
    "springs that store no energy": """
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  b: {parent: ground, joint: {type: prismatic, axis: y}, mass: 2}
  c: {parent: ground, joint: {type: prismatic, axis: z}, mass: 2}
forces:
  ab: {type: spring, from: a, to: b, stiffness: 0, damping: 3}
  ac: {type: spring, from: a, to: c, stiffness: 0, damping: 4}
outputs: {stored: potential_energy}
""",
    "units that look like comments, names that C uses": """
parameters:
  call: {value: 1.0, unit: "kg/*m*/ */* %"}
  link: {value: 0.3, unit: "*/"}
  linux: 2
  asm: 1
  bool: 1
  _Bool: 1
  __x86_64__: 1
bodies:
  lanes: {parent: ground, joint: {type: prismatic, axis: [call, link, 0]}, mass: call*linux*asm*bool*_Bool*__x86_64__}
forces:
  NU: {type: joint, joint: lanes, value: link*t}
""",
}


@pytest.mark.parametrize("text", CORNERS.values(), ids=CORNERS)
@pytest.mark.parametrize("flags", ["", "-DORDERNM_PLAIN_C"])
def test_no_warnings_in_corners(tmp_path: Path, text: str, flags: str) -> None:
    model = parse_model("model: corner" + text)
    for name, content in write_solver(model, "kinds").files.items():
        (tmp_path / name).write_text(content)
    command = ["cc", "-O0", "-Wall", "-Wextra", "-Werror", *flags.split(), "-c", "corner.c", "-o", "x.o"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[:2000]


@pytest.mark.parametrize(
    "flags", ["-Ofast", "-ffast-math", "-ffinite-math-only", "-fassociative-math -fno-signed-zeros -fno-trapping-math"]
)
@pytest.mark.parametrize("compiler", compilers())
def test_arithmetic_in_another_order_is_an_error(tmp_path: Path, compiler: str, flags: str) -> None:
    if compiler == "clang" and flags.startswith("-fassociative"):
        pytest.skip("clang has no macro for it")
    source = write(tmp_path)
    for given, refused in ((flags, True), ("-O3", False)):
        command = [compiler, *given.split(), "-fsyntax-only", str(source)]
        result = subprocess.run(command, capture_output=True, text=True)
        assert bool(result.returncode) == refused
        assert ("everything.c needs sums in the given order" in result.stderr) == refused


def test_header_is_a_header_of_cpp(tmp_path: Path) -> None:
    if not shutil.which("g++"):
        pytest.skip("g++ is not installed")
    write(tmp_path)
    (tmp_path / "use.cpp").write_text(
        '#include "everything.h"\nint main() { return EVERYTHING_NQ - 14; }\n'
        "static const double p[3] = {9.81, 0.4, 1.3};\nvoid fill(everything_batch *b) { b->p.at = p; }\n"
    )
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "-c", "use.cpp", "-o", "use.o"], cwd=tmp_path, check=True)


def test_no_globals_no_allocation_libc_only(tmp_path: Path) -> None:
    if not shutil.which("nm") or not shutil.which("gcc"):
        pytest.skip("needs gcc and nm")
    source = write(tmp_path)
    subprocess.run(["gcc", "-O0", "-c", str(source), "-o", str(tmp_path / "x.o")], check=True)
    symbols = subprocess.run(["nm", str(tmp_path / "x.o")], capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )
    kinds = {line[17]: line[19:] for line in symbols if len(line) > 19}
    assert not set(kinds) & set("bBdDCs"), f"mutable data: {kinds}"
    undefined = {line[19:] for line in symbols if len(line) > 19 and line[17] == "U"}
    assert undefined <= {
        "sin",
        "cos",
        "sincos",
        "sqrt",
        "fmax",
        "fmin",
        "fabs",
        "memmove",
        "memset",
        "memcpy",
        "_GLOBAL_OFFSET_TABLE_",
    }


RARE = ("-O2", "-O1 -march=native -DORDERNM_PLAIN_C", "-O3 -march=native", "-O1 -march=native -mno-avx512f")
"""Left to the campaign: the sanitizers' builds compute the same in plain C and in the vectors of every machine."""


@pytest.mark.parametrize(
    "flags",
    [
        "-O2 -march=native",
        "-O0 -march=native -mno-avx512f",
        *(pytest.param(f, marks=pytest.mark.campaign) for f in RARE),
    ],
)
def test_every_way_to_compile_gives_the_same_numbers(
    everything: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: str
) -> None:
    """The first are the flags of users; with the second, libraries of some functions are compiled when they are called."""
    monkeypatch.setenv("ORDERNM_CFLAGS", flags)
    model = parse_model(EVERYTHING)
    shutil.copytree(everything, tmp_path / "everything")
    if "-O0" not in flags:
        codegen.generate(model, tmp_path / "everything", compile="all")  # in half the time of its libraries
    found = compare(
        model, codegen.load(tmp_path / "everything"), RecursiveEngine(model), np.random.default_rng(5), k=11
    )
    assert max(found.values()) < 1e-11, found


def test_memory_and_files_of_a_chain_grow_with_its_bodies() -> None:
    """100 000 bodies need 100 times the workspace of 1000, and no more words to be told."""
    workspace, words = [], []
    for n in (400, 800, 1200):
        source = write_solver(parse_model(CHAIN.format(n=n)))
        workspace.append(source.manifest["workspace"])
        words.append(len(json_text(source.manifest)))
    assert workspace[2] - workspace[1] == workspace[1] - workspace[0] < 500 * 400
    assert max(words) - min(words) < 200


def test_equal_input_gives_equal_bytes() -> None:
    assert write_solver(parse_model(EVERYTHING)).files == files_of_everything()


@cache
def angles_and_exact_values(dtype: str) -> tuple[Any, Any, Any]:
    """Angles, with their cosines and sines from 60 digits: rounded to doubles, and the remainders."""
    rng = np.random.default_rng(0)
    quarter = np.arange(-40, 40) * (np.pi / 2)
    angles = np.concatenate([
        rng.uniform(-4, 4, 2000), rng.uniform(-1e6, 1e6, 1000), 10.0 ** rng.uniform(-300, -1, 400), quarter, quarter + 1e-9,
        [0.0, -0.0, 1e-320, 999999.99, 1e6, 1e7, -1e15, 1e300, np.pi, 355.0, 103993.0, 0.785398163397448],
        rng.uniform(-1e4, 1e4, 1000),
    ])  # fmt: skip
    angles = angles[np.abs(angles) < np.finfo(dtype).max].astype(dtype)
    angles = np.concatenate([angles, np.zeros(-len(angles) % 8, dtype)])
    with mpmath.workdps(60):
        values = [f(mpmath.mpf(float(x))) for f in (mpmath.cos, mpmath.sin) for x in angles]
        exact = np.array([float(x) for x in values])
        rest = np.array([float(x - mpmath.mpf(e)) for x, e in zip(values, exact.tolist(), strict=True)])
    return angles, exact, rest


@pytest.mark.parametrize("scalar", C.scalars, ids=lambda s: s.name)
@pytest.mark.parametrize("flags", [["-march=native"], ["-march=native", "-mno-avx512f"], [], ["-DORDERNM_PLAIN_C"]])
def test_sines_and_cosines_below_one_unit_in_the_last_place(tmp_path: Path, flags: list[str], scalar: Scalar) -> None:
    angles, exact, rest = angles_and_exact_values(scalar.name)
    n, of = len(angles), {**words(scalar), "sines": sines.words(scalar)}
    prelude = (
        f"enum {{ ANGLES = {n} }};"
        + """
#include <math.h>
#include <stdint.h>
#if defined(__GNUC__) && !defined(ORDERNM_PLAIN_C)
#define ORDERNM_VECTORS 1
"""
        + "\n".join(of["vector_lanes"])
        + f"""
typedef {scalar.word} number, vector_8 __attribute__((vector_size({scalar.bytes}*VECTOR_8), aligned({scalar.bytes}), may_alias));
#else
typedef {scalar.word} number;
#endif
"""
    )
    text = (
        prelude
        + render("c/angles_at_once.c.jinja", of)
        + render("c/sincos.c.jinja", of)
        + "\nvoid run(int n, number *trig) { sines_and_cosines(n, trig); }\n"
    )
    (tmp_path / "sc.c").write_text(text)
    command = [shutil.which("cc") or "cc", "-O2", *flags, "-fPIC", "-shared", "sc.c", "-o", "sc.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "sc.so"))
    trig = np.concatenate([np.zeros(n, scalar.name), angles])
    otherwise = {}  # with every operation rounded up or down
    for way in DIRECTED:
        otherwise[way] = trig.copy()
        with rounding(way):
            library.run(n, otherwise[way].ctypes.data_as(ctypes.c_void_p))
    library.run(n, trig.ctypes.data_as(ctypes.c_void_p))
    # an angle in float32 is itself further from multiples of pi than its sine's last place there
    ulp = np.spacing(1.0, dtype="float32") if scalar.bytes == 4 else np.maximum(np.spacing(np.abs(exact)), 5e-324)
    for way, found, most in (("nearest", trig, 1), *((way, found, 3) for way, found in otherwise.items())):
        far = np.abs((found - exact) - rest) > most * ulp  # what is near is subtracted without rounding
        assert np.isfinite(found).all() and not far.any(), (way, np.tile(angles, 2)[far], found[far])


def test_an_angle_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    codegen.generate(parse_model(CHAIN.format(n=2)), tmp_path / "chain")
    solver = codegen.load(tmp_path / "chain")
    with pytest.raises(ValueError, match=r"q\[1\].* is nan"):
        solver.accelerations([0.1, np.nan], [0.0, 0.0])
