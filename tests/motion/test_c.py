"""The integrators without Python: examples/motion.c, unchanged and with sanitizers, in memory full of arbitrary values."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import EXAMPLES
from sanitizers.builds import ADDRESS, CLANG, CLANG_MEMORY, ENVIRONMENT, GCC, NATIVE, Build

import codegen
from codegen.runtime import Event, Final, Integral

WARNINGS = ("-Wall", "-Wextra", "-Werror")
METHODS = ("dop853", "radau")
SANITIZED = [
    GCC,
    pytest.param(CLANG, marks=pytest.mark.campaign),
    pytest.param(CLANG_MEMORY, marks=pytest.mark.campaign),
    pytest.param(Build("gcc", ("-O3", *ADDRESS, *NATIVE)), marks=pytest.mark.campaign),
    pytest.param(Build("clang", ("-O2", "-DORDERNM_PLAIN_C")), marks=pytest.mark.campaign),
]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("c") / "four_bar"
    codegen.generate(EXAMPLES / "four_bar.yaml", folder, check=False, functions=("motion",))
    return folder


@pytest.fixture(scope="module")
def objects(package: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[str]]:
    """Compiles a package and its integrators, once for each build."""
    known: dict[Any, list[str]] = {}

    def of(command: tuple[str, ...]) -> list[str]:
        if command not in known:
            folder = tmp_path_factory.mktemp("objects")
            sources = [package / "four_bar.c", package / "four_bar_motion.c", *sorted((package / "motion").glob("*.c"))]
            said = subprocess.run(
                [*command, "-c", *map(str, sources)], cwd=folder, capture_output=True, text=True, check=False
            )
            assert not said.returncode, said.stderr[:3000]
            known[command] = [str(x) for x in sorted(folder.glob("*.o"))]
        return known[command]

    return of


def compiled(objects: Any, package: Path, folder: Path, build: Build, *flags: str, method: str = "dop853") -> Path:
    command = (build.compiler, *build.flags, *flags)
    own, program = folder / "own.c", folder / "motion"
    text = (EXAMPLES / "motion.c").read_text()
    assert text.count("ORDERNM_DOP853") == 1
    own.write_text(text.replace("ORDERNM_DOP853", f"ORDERNM_{method.upper()}"))
    linked = [*command, "-I", str(package), str(own), *objects(command), "-o", str(program), "-lm"]
    said = subprocess.run(linked, capture_output=True, text=True, check=False)
    assert not said.returncode, said.stderr[:3000]
    return program


def run(*command: str) -> dict[str, list[list[float]]]:
    said = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=120, check=False)
    assert not said.returncode, said.stderr[:3000]
    found: dict[str, list[list[float]]] = {}
    for word, *numbers in map(str.split, said.stdout.splitlines()):
        found.setdefault(word, []).append([float(x) for x in numbers])
    return found


def check(package: Path, found: dict[str, list[list[float]]], method: str = "dop853") -> None:
    solver: Any = codegen.load(package)
    times = [0.0, 0.4, 0.5, 0.6, 2.0]
    event = Event("trace_z", 0.35, stop=False)
    wrt = ("crank_length", "base")
    options = {"inputs": [0.3], "events": event, "sensitivities": wrt}
    by_name = (*solver.parameter_names, "q0.crank", "u0.crank", "inputs.motor")
    motion = solver.simulate(times, method=method, **options)
    expected = np.column_stack([motion.t, motion["trace_x"], *motion.doutputs[:, :, 0]])
    # the integral's error is looked at too there, so that steps differ
    np.testing.assert_allclose(found["row"], expected, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose([e[0] for e in found["event"]], [e.t for e in motion.events], rtol=1e-8)
    wanted = [Final("trace_x"), Integral("kinetic")]
    judged = solver.judge(2.0, wanted, inputs=[0.3], wrt=by_name, method="forward", rtol=1e-11, atol=1e-11)
    difference = np.abs(np.array(found["gradient"]) - judged.gradients).max(axis=1)
    assert (difference < 1e-6 * np.abs(judged.gradients).max(axis=1)).all()  # steps are chosen for the state, at 1e-9
    # backwards is forwards, to rounding
    np.testing.assert_allclose(found["gradient"][0][0], found["row"][-1][2], rtol=1e-11)
    np.testing.assert_allclose(found["gradient"][0][3], found["row"][-1][3], rtol=1e-11)


def test_a_program_of_ones_own(objects: Any, package: Path, tmp_path: Path) -> None:
    check(package, run(str(compiled(objects, package, tmp_path, Build("cc", ("-O0",)), *WARNINGS))))


@pytest.mark.parametrize("build", SANITIZED, ids=str)
@pytest.mark.parametrize("method", METHODS)
def test_under_sanitizers(objects: Any, package: Path, tmp_path: Path, build: Build, method: str) -> None:
    if build.missing:
        pytest.skip(build.missing)
    check(package, run(str(compiled(objects, package, tmp_path, build, "-g1", *WARNINGS, method=method))), method)


@pytest.mark.campaign
def test_under_valgrind(objects: Any, package: Path, tmp_path: Path) -> None:
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed (Debian: apt-get install valgrind)")
    program = compiled(objects, package, tmp_path, Build("gcc", ("-O1", "-g")))
    check(package, run("valgrind", "-q", "--error-exitcode=3", "--leak-check=full", str(program)))


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(
    "flags",
    [
        pytest.param((), id="plain"),
        pytest.param(("-DORDERNM_PLAIN_C",), id="portable"),
        pytest.param(("-O1", "-march=native"), id="native"),
        pytest.param(("-O3", "-march=native"), id="optimised", marks=pytest.mark.campaign),
    ],
)
def test_no_warnings(package: Path, tmp_path: Path, compiler: str, flags: tuple[str, ...]) -> None:
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not installed")
    for source in sorted((package / "motion").glob("*.c")):
        command = [
            compiler,
            "-std=c11",
            "-pedantic",
            *WARNINGS,
            *flags,
            "-c",
            str(source),
            "-o",
            str(tmp_path / "made.o"),
        ]
        said = subprocess.run(command, capture_output=True, text=True, check=False)
        assert not said.returncode, said.stderr[:2000]
