"""``ordernm export --c``: the folder compiles as strict C99, gives the solver's results, and has the sizes that it reports."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen import cli
from codegen.folders import FolderError

EXAMPLES = Path(__file__).parents[2] / "examples"
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-DORDERNM_PLAIN_C"]
MATHEMATICS = re.compile(r"(cos|sin|sincos|sqrt|fmax|fmin|fabs|floor|pow|exp|log|tanh|atan2|memcpy|memmove|memset)f?")

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


def example(folder: Path, command: list[str], runner: tuple[str, ...] = ()) -> np.ndarray:
    """The numbers that the example prints: a column of accelerations and a column of derivatives."""
    (source,) = (f for f in folder.glob("*.c") if f.name != "example.c")
    subprocess.run(
        [*command, "example.c", source.name, "-lm", "-o", "built"], cwd=folder, check=True, capture_output=True
    )
    done = subprocess.run([*runner, "./built"], cwd=folder, check=True, capture_output=True, text=True)
    return np.array([line.split() for line in done.stdout.splitlines()], float)


def expected(name: str, tmp_path: Path) -> np.ndarray:
    """The numbers that the example of an export must print, in doubles."""
    codegen.generate(EXAMPLES / f"{name}.yaml", tmp_path / f"{name}_solver", target="numpy")
    solver = codegen.load(tmp_path / f"{name}_solver")
    q, u = solver.initial
    if solver.closure_names:
        q[solver.coordinate_names.index(solver.independent_names[0])] += 0.001
        q, u = solver.assemble(q, u)
    udot, dudot = solver.sensitivities(q, u, dp=np.eye(solver.np)[0])
    return np.stack([udot, dudot[0]], axis=1)


def agree(found: np.ndarray, wanted: np.ndarray, bound: float) -> None:
    assert (np.abs(found - wanted).max(axis=0) <= bound * np.abs(wanted).max(axis=0)).all()


@needs_compiler
@pytest.mark.parametrize("name", ["four_bar", "pendulum", "arm"])
@pytest.mark.parametrize(("scalar", "bound"), [("float64", 1e-12), ("float32", 1e-5)])
def test_the_example_compiles_as_strict_c99_and_computes_what_the_solver_computes(name, scalar, bound, tmp_path):
    found = codegen.export_c(
        EXAMPLES / f"{name}.yaml", tmp_path / name, functions="accelerations,sensitivities", scalar=scalar
    )
    agree(example(tmp_path / name, ["gcc", "-O0", *STRICT]), expected(name, tmp_path), bound)
    assert all(MATHEMATICS.fullmatch(f) for f in found.library), found.library  # no heap, no input and output
    assert {r.name for r in found.functions} >= {"accelerations", "sensitivities_1", "sensitivities_8"}
    assert all(r.code and r.stack is not None and sum(r.operations) > 0 for r in found.functions)


@needs_compiler
def test_the_code_has_no_variables_of_its_own(tmp_path):
    codegen.export_c(EXAMPLES / "four_bar.yaml", tmp_path / "c")
    subprocess.run(["gcc", *STRICT, "-O1", "-c", "four_bar.c"], cwd=tmp_path / "c", check=True)
    symbols = subprocess.run(
        ["nm", "four_bar.o"], cwd=tmp_path / "c", check=True, capture_output=True, text=True
    ).stdout
    assert " T four_bar_accelerations" in symbols
    assert not re.findall(r"^\w* [bBdDC] \w+$", symbols, re.MULTILINE)  # written variables, static ones too


@needs_compiler
def test_operations_and_workspace_are_those_of_the_solver(tmp_path):
    found = codegen.export_c(EXAMPLES / "double_pendulum.yaml", tmp_path / "c")
    codegen.generate(EXAMPLES / "double_pendulum.yaml", tmp_path / "s", compile=False)
    solver = codegen.load(tmp_path / "s", target="numpy")
    by_name = {r.name: r.operations for r in found.functions}

    def of_solver(name: str, part: str) -> np.ndarray:
        columns = ("additions", "multiplications", "divisions", "functions")
        return np.array([[s[part][c] for c in columns] for s in solver.operations[name].values()]).sum(axis=0)

    assert by_name["accelerations"] == tuple(of_solver("accelerations", "per_call"))
    wanted = of_solver("sensitivities", "per_call") + 8 * of_solver("sensitivities", "per_direction")
    assert by_name["sensitivities_8"] == tuple(wanted)
    header = (tmp_path / "c" / "double_pendulum.h").read_text()
    assert found.workspace == 8 * int(re.search(r"DOUBLE_PENDULUM_WORKSPACE = (\d+)", header)[1])
    written = json.loads((tmp_path / "c" / "model.json").read_text())
    assert (
        written["workspace_bytes"] == found.workspace and written["functions"][0]["stack"] == found.functions[0].stack
    )


def test_files_of_others_stay(tmp_path):
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "notes.txt").write_text("mine")
    with pytest.raises(FolderError, match=r"contains files that generate did not write"):
        codegen.export_c(EXAMPLES / "pendulum.yaml", tmp_path / "c")
    assert [f.name for f in (tmp_path / "c").iterdir()] == ["notes.txt"]
    codegen.export_c(EXAMPLES / "pendulum.yaml", tmp_path / "c", force=True)
    assert (tmp_path / "c" / "notes.txt").read_text() == "mine"
    codegen.export_c(EXAMPLES / "pendulum.yaml", tmp_path / "d")
    codegen.export_c(EXAMPLES / "pendulum.yaml", tmp_path / "d", functions="accelerations")  # its own files
    assert "pendulum_sensitivities" not in (tmp_path / "d" / "pendulum.h").read_text()


def test_without_a_compiler_the_report_has_no_sizes(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert cli.main(["export", str(EXAMPLES / "pendulum.yaml"), "--c", "-o", str(tmp_path / "c")]) == 0
    printed = capsys.readouterr().out
    assert "no C compiler, so code and stack are not measured" in printed and "bytes of code" not in printed
    assert "There was no C compiler" in (tmp_path / "c" / "README.md").read_text()


@pytest.mark.parametrize("export", [codegen.export_c, codegen.export_fmu])
def test_wrong_arguments_are_refused(export, tmp_path):
    with pytest.raises(TypeError, match=r"^an object is given; a Model, or the path of its file, is needed"):
        export(object(), tmp_path / "written")
    with pytest.raises(ValueError, match=r"^force is 'no'; allowed are True and False"):
        export("examples/pendulum.yaml", tmp_path / "written", force="no")


def test_functions_and_times_of_other_types_are_refused(tmp_path):
    with pytest.raises(ValueError, match="functions contains 3, expected names such as"):
        codegen.export_c("examples/pendulum.yaml", tmp_path / "written", functions=3)
    with pytest.raises(ValueError, match="stop='1', expected a positive number of seconds"):
        codegen.export_fmu("examples/pendulum.yaml", tmp_path / "written", stop="1")


def test_wrong_requests_are_refused(tmp_path, capsys):
    model, out = str(EXAMPLES / "pendulum.yaml"), str(tmp_path / "c")
    assert cli.main(["export", model, "--c", "-o", out, "--functions", "speed"]) == 2
    assert "the model has no function 'speed'" in capsys.readouterr().err
    assert cli.main(["export", str(tmp_path / "none.yaml"), "--c", "-o", out]) != 0
    assert not (tmp_path / "c").exists()
    codegen.export_c(model, out, functions="accelerations")
    with pytest.raises(codegen.runtime.PackageError):
        codegen.load(out)


# ---- other processors ------------------------------------------------------------------------------------------------


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["four_bar", "arm"])
@pytest.mark.parametrize(("scalar", "bound"), [("float64", 1e-12), ("float32", 1e-5)])
def test_aarch64_computes_the_same(name, scalar, bound, tmp_path, monkeypatch):
    compiler = shutil.which("aarch64-linux-gnu-gcc") or pytest.skip("needs aarch64-linux-gnu-gcc")
    machine = shutil.which("qemu-aarch64") or pytest.skip("needs qemu-aarch64")
    monkeypatch.setenv("CC", compiler)
    found = codegen.export_c(EXAMPLES / f"{name}.yaml", tmp_path / name, functions="dynamics", scalar=scalar)
    assert "aarch64" in found.compiler and all(r.code for r in found.functions)
    numbers = example(tmp_path / name, [compiler, "-O2", "-static", *STRICT], (machine,))
    agree(numbers, expected(name, tmp_path), bound)


@pytest.mark.campaign
def test_a_cortex_m_compiles_it(tmp_path, monkeypatch):
    compiler = shutil.which("arm-none-eabi-gcc") or pytest.skip("needs arm-none-eabi-gcc")
    monkeypatch.setenv("CC", f"{compiler} -mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard {' '.join(STRICT)}")
    found = codegen.export_c(EXAMPLES / "arm.yaml", tmp_path / "arm", functions="accelerations", scalar="float32")
    (row,) = (r for r in found.functions if r.name == "accelerations")
    assert 0 < row.stack < 4096 and row.code < 64 * 1024 and not any("__aeabi_d" in f for f in found.library)


PAINTED = """
#include <stdio.h>
#include <string.h>
#include <ucontext.h>
#include "{name}.h"
#include "{name}_model.h"
#define SIZE (1 << 18)
static unsigned char stack[SIZE];
static ucontext_t here, there;
static double work[{NAME}_WORKSPACE], inputs[{NAME}_NINPUTS + 1], udot[{NAME}_NU], dudot[{NAME}_NU];
static double dq[{NAME}_NQ], du[{NAME}_NU], dp[{NAME}_NP + 1], dinputs[{NAME}_NINPUTS + 1];
static void nothing(void) {{}}
static void accelerations(void) {{ {name}_accelerations({NAME}_INITIAL_Q, {NAME}_INITIAL_U, {arguments}udot, work); }}
static void sensitivities_1(void)
{{
    {name}_sensitivities_1({NAME}_INITIAL_Q, {NAME}_INITIAL_U, {arguments}dq, du, {seeds}udot, dudot, work);
}}
static long used(void (*f)(void))
{{
    memset(stack, 0xA5, SIZE);
    getcontext(&there);
    there.uc_stack.ss_sp = stack, there.uc_stack.ss_size = SIZE, there.uc_link = &here;
    makecontext(&there, f, 0);
    swapcontext(&here, &there);
    long low = 0;
    while (low < SIZE && stack[low] == 0xA5) ++low;
    return SIZE - low;
}}
int main(void)
{{
    used(accelerations), used(sensitivities_1);    /* the dynamic linker needs stack at the first calls */
    const long none = used(nothing);
    printf("%ld %ld\\n", used(accelerations) - none, used(sensitivities_1) - none);
    return 0;
}}
"""

OF_THE_LIBRARY = 512
"""Bytes of stack that functions of the C library may use, which the report leaves out."""


@pytest.mark.campaign
@needs_compiler
@pytest.mark.parametrize("name", ["four_bar", "arm", "quadruped"])
def test_painted_stacks_are_as_deep_as_reported(name, tmp_path):
    found = codegen.export_c(EXAMPLES / f"{name}.yaml", tmp_path / "c", functions="accelerations,sensitivities")
    functions = codegen.load_model(EXAMPLES / f"{name}.yaml")
    header = (tmp_path / "c" / f"{name}.h").read_text()
    taken = re.search(rf"{name}_sensitivities_1\((.*?)\);", header, re.DOTALL)[1]
    words = [w.strip(" *\n") for w in re.findall(r"\*?(\w+)(?:,|$)", taken)]
    before = "".join(f"{f'{name.upper()}_PARAMETERS' if w == 'p' else w}, " for w in ("p", "inputs") if w in words)
    seeds = "".join(f"{w}, " for w in ("dp", "dinputs") if w in words)
    assert functions.nq
    (tmp_path / "c" / "painted.c").write_text(
        PAINTED.format(name=name, NAME=name.upper(), arguments=before, seeds=seeds)
    )
    build = ["gcc", *found.compiler.split()[1:], "-D_GNU_SOURCE", "painted.c", f"{name}.c", "-lm", "-o", "painted"]
    subprocess.run(build, cwd=tmp_path / "c", check=True, capture_output=True)
    done = subprocess.run(["./painted"], cwd=tmp_path / "c", check=True, capture_output=True, text=True)
    reported = {r.name: r.stack for r in found.functions}
    for measured, row in zip(map(int, done.stdout.split()), ("accelerations", "sensitivities_1"), strict=True):
        assert reported[row] - 64 <= measured <= reported[row] + OF_THE_LIBRARY, (row, measured, reported[row])


JUSTIFIED = {
    "2.2",
    "8.14",
    "9.3",
    "10.1",
    "10.3",
    "10.4",
    "10.7",
    "11.3",
    "11.8",
    "11.9",
    "14.4",
    "15.6",
    "20.7",
}
"""Required rules of MISRA C:2012 from which the code deviates; docs/howto/export.md gives the reasons."""

ADVISORY = {
    "2.3", "2.4", "2.5", "8.7", "8.9", "8.13", "10.5", "11.4", "12.1", "12.3", "13.3", "15.4", "15.5", "17.8", "18.4", "19.2",
    "20.1", "20.5", "20.10",
}  # fmt: skip
"""Rules that MISRA C:2012 calls advisory."""


@pytest.mark.campaign
@pytest.mark.parametrize(
    "name",
    [
        "four_bar", "arm", "shaken_pendulum", "flyball", "coupler", "slider_crank", "screw_jack", "quadrotor", "jansen", "axle",
        "four_cylinder", "stewart", "valve_train", "loader", "quadruped",
    ],
)  # fmt: skip
def test_misra_rules_are_kept_or_their_deviation_is_justified(name, tmp_path):
    checker = shutil.which("cppcheck") or pytest.skip("needs cppcheck")
    codegen.export_c(next(EXAMPLES.rglob(f"{name}.yaml")), tmp_path / "c")
    command = [checker, "--addon=misra", "--std=c99", "-DORDERNM_PLAIN_C", "--quiet", f"{name}.c"]
    done = subprocess.run(command, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
    found = set(re.findall(r"misra-c2012-([\d.]+)", done.stderr + done.stdout))
    assert found and found - JUSTIFIED - ADVISORY == set()
    page = (EXAMPLES.parent / "docs" / "howto" / "export.md").read_text()
    explained = {rule for row in re.findall(r"^\| ([\d., ]+) \|", page, re.MULTILINE) for rule in row.split(", ")}
    assert found & JUSTIFIED <= explained
