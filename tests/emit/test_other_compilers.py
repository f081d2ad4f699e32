"""The generated C with other compilers: as C++20, and for WebAssembly, which is run where there is something to run it."""

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
    for file, text in source.files.items():
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
