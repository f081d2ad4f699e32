"""The generated C with other compilers: as C++20, and for WebAssembly, which is run if a program for it is installed."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.pipeline import write_solver
from codegen.runtime.sections import carried_files

EXAMPLES = Path(__file__).parents[2] / "examples"
TOLERANCE = {"float64": 1e-13, "float32": 1e-5}

MAIN = """
#include <stdio.h>
#include "{name}.h"
{real} work[{NAME}_WORKSPACE], q[{nq}] = {{{q}}}, u[{nu}] = {{{u}}}, p[] = {{{p}}}, inputs[{ninputs} + 1];
{real} udot[{nu}], dq[{nq}*8], du[{nu}*8], dp[{np}*8], dinputs[{ninputs}*8 + 1], dudot[{nu}*8];
int main(void)
{{
    for (int i = 0; i < {np}*8; ++i) dp[i] = 0.1f*(i % 7);
    int status = {call};
    for (int i = 0; i < {nu}; ++i) printf("%.17g\\n", (double)udot[i]);
    for (int i = 0; i < {nu}*8; ++i) printf("%.17g\\n", (double)dudot[i]);
    return status;
}}
"""


@pytest.fixture(params=[("four_bar", "float64"), ("double_pendulum", "float32")], ids=lambda x: f"{x[0]}-{x[1]}")
def program(request, tmp_path):
    """A folder with a solver and ``main.c``, the solver's name, and its scalar type."""
    name, scalar = request.param
    model = codegen.model.load_model(EXAMPLES / f"{name}.yaml")
    source = write_solver(model, functions=["dynamics"], scalar=scalar)
    for file, text in {**carried_files(source.manifest), **source.files}.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    made = source.manifest
    q, u = made["initial"]["q"], made["initial"]["u"]
    f = made["functions"]["sensitivities"]
    given = ", ".join(["0" if a == "t" else a for a in f["arguments"]] + f["seeds"])
    call = f"{name}_sensitivities_8({given}, udot, dudot, work)"
    text = MAIN.format(
        name=name, NAME=name.upper(), real="float" if scalar == "float32" else "double", nq=model.nq, nu=model.nu,
        np=len(model.parameters), ninputs=len(model.inputs), q=", ".join(map(repr, q)), u=", ".join(map(repr, u)),
        p=", ".join(repr(x) for x in made["parameters"]), call=call,
    )  # fmt: skip
    (tmp_path / "main.c").write_text(text)
    return tmp_path, name, scalar


def numbers(folder: Path, *command: str) -> np.ndarray:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.array([float(x) for x in done.stdout.split()])


def compiled(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def in_c(folder: Path, name: str) -> np.ndarray:
    compiled(folder, shutil.which("cc") or "cc", "-O1", "main.c", f"{name}.c", "-lm", "-o", "in_c")
    found = numbers(folder, "./in_c")
    assert np.isfinite(found).all() and np.abs(found).max() > 0
    return found


def test_it_is_cpp20_but_for_restrict(program):
    folder, name, scalar = program
    if not shutil.which("g++"):
        pytest.skip("needs g++: apt install g++")
    flags = ("-std=c++20", "-Drestrict=__restrict__", "-Wall", "-Wno-unused-function", "-Wno-attributes", "-Werror")
    for file in ("main", name, f"{name}_states", f"{name}_calls"):
        compiled(folder, "g++", *flags, "-O1", "-x", "c++", "-c", f"{file}.c", "-o", f"{file}.o")
    compiled(folder, "g++", "main.o", f"{name}.o", "-o", "in_cpp")
    expected = in_c(folder, name)
    assert np.abs(numbers(folder, "./in_cpp") - expected).max() <= TOLERANCE[scalar] * np.abs(expected).max()


RUN = """
import { readFile } from 'node:fs/promises';
import { WASI } from 'node:wasi';
const wasi = new WASI({ version: 'preview1' });
const module = await WebAssembly.compile(await readFile('main.wasm'));
wasi.start(await WebAssembly.instantiate(module, wasi.getImportObject()));
"""


@pytest.mark.campaign  # zig builds its C library first
def test_it_is_compiled_for_webassembly(program):
    folder, name, scalar = program
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs a compiler for wasm32: pip install ziglang")
    zig = (sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-wasi", "-O1")
    for flags in ((), ("-msimd128",)):
        compiled(folder, *zig, *flags, "-Wno-unused-function", "main.c", f"{name}.c", "-o", "main.wasm")
        node = shutil.which("node")
        if node is None:
            pytest.skip("compiled, not run, which needs Node.js 20 or later: https://nodejs.org")
        (folder / "run.mjs").write_text(RUN)
        expected = in_c(folder, name)
        found = numbers(folder, node, "--no-warnings", "run.mjs")
        assert np.abs(found - expected).max() <= TOLERANCE[scalar] * np.abs(expected).max()


@pytest.mark.parametrize("name", ["flyball", "slider_crank"])
def test_all_that_motions_call_is_declared(name: str, tmp_path: Path) -> None:
    """Functions of switches, too, without modes and with them: undeclared functions are an error in C++ and in C23."""
    codegen.generate(EXAMPLES / f"{name}.yaml", tmp_path / name, functions="motion,hessian_products", compile=False)
    assert f"{name}_switches" in (tmp_path / name / f"{name}_motion.c").read_text()
    flags = ("-Wall", "-Wno-unused-function", "-Werror", "-fsyntax-only")
    compiled(tmp_path / name, shutil.which("cc") or "cc", *flags, f"{name}_motion.c")


MOTION = """
#include <stdio.h>
#include <stdlib.h>
#include "{name}.h"
#include "motion/motion.h"
extern const ordernm_system {name}_system;
extern void {name}_four(ordernm_system *system);
static double allowed[32], q[] = {{{q}}}, u[] = {{{u}}}, p[] = {{{p}}}, dp[3*{np}], times[] = {{0.1, 0.2}};
static double gradient[64], weights[{noutputs}*2];
int main(void)
{{
    for (int method = ORDERNM_RK4; method <= ORDERNM_RADAU; ++method) {{
        ordernm_system system = {name}_system;
        {name}_four(&system);
        for (int i = 0; i < 32; ++i) allowed[i] = 1e-9;
        for (int i = 0; i < 3; ++i) dp[i*{np} + i] = 1.0;
        ordernm_problem problem = {{0}};
        problem.system = &system, problem.method = method, problem.p = p, problem.q = q, problem.u = u;
        problem.end = 0.2, problem.ntimes = 2, problem.times = times, problem.rtol = 1e-9, problem.atol = allowed;
        problem.step = 0.01, problem.inputs.count = 1, problem.ndirections = 3, problem.dp = dp;
        ordernm_results r = {{0}};
        const long size = ordernm_row_size(&problem);
        r.rows = (double *)calloc(2*size, sizeof(double)), r.capacity = 2;
        ordernm_motion *m = ordernm_begin(&problem, (double *)calloc(ordernm_room(&problem), sizeof(double)));
        if (ordernm_go(m, &r, 0.0) || r.count != 2) return 1;
        for (long i = 0; i < 2*size; ++i) printf("%.17g\\n", r.rows[i]);
        problem.ndirections = 0;
        ordernm_results kept = {{0}};
        kept.rows = r.rows, kept.capacity = 2, kept.steps_capacity = 1000;
        kept.steps = (double *)calloc(1000*ordernm_step_size(&problem), sizeof(double));
        m = ordernm_begin(&problem, (double *)calloc(ordernm_room(&problem), sizeof(double)));
        if (ordernm_go(m, &kept, 0.0)) return 2;
        weights[{noutputs}] = 1.0;
        ordernm_gradients g = {{0}};
        g.nfunctionals = 1, g.ntimes = 2, g.times = times, g.weights = weights, g.q = gradient, g.u = gradient + 16;
        g.p = gradient + 32, g.inputs = gradient + 60;
        for (int i = 0; i < 64; ++i) gradient[i] = 0.0;
        double *const room = (double *)calloc(ordernm_adjoint_room(&problem, &g), sizeof(double));
        ordernm_adjoint *a = ordernm_adjoint_begin(&problem, &g, room);
        if (ordernm_backwards(a, kept.steps, kept.steps_count)) return 3;
        ordernm_adjoint_end(a);
        for (int i = 0; i < {np}; ++i) printf("%.17g\\n", g.p[i]);
    }}
    return 0;
}}
"""


def test_motions_are_cpp20_but_for_restrict(tmp_path: Path) -> None:
    """The integrators, what they call, and four directions: the same sources as C and as C++ give the same."""
    if not shutil.which("g++"):
        pytest.skip("needs g++: apt install g++")
    name = "four_bar"
    folder = tmp_path / name
    codegen.generate(EXAMPLES / f"{name}.yaml", folder, functions="motion", compile=False)
    made = codegen.load(folder)
    text = MOTION.format(
        name=name, np=made.np, noutputs=made.noutputs, q=", ".join(map(repr, made.initial_state()[0].tolist())),
        u=", ".join(map(repr, made.initial_state()[1].tolist())), p=", ".join(map(repr, made.parameters.tolist())),
    )  # fmt: skip
    (folder / "main.c").write_text(text)
    sources = ["main.c", f"{name}.c", f"{name}_motion.c", f"{name}_four.c"]
    sources += [f"motion/{f.name}" for f in sorted((folder / "motion").glob("*.c"))]
    compiled(folder, shutil.which("cc") or "cc", "-O0", *sources, "-lm", "-o", "in_c")
    flags = ("-std=c++20", "-Drestrict=__restrict__", "-Wall", "-Wno-unused-function", "-Wno-attributes", "-Werror")
    compiled(folder, "g++", *flags, "-O0", "-x", "c++", *sources, "-lm", "-o", "in_cpp")
    expected = numbers(folder, "./in_c")
    assert np.isfinite(expected).all() and np.abs(expected).max() > 0
    assert np.abs(numbers(folder, "./in_cpp") - expected).max() <= 1e-12 * np.abs(expected).max()
