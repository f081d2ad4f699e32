"""The code that shares batches among threads, under thread and address sanitizers, with all warnings, and as C++."""

import subprocess
from pathlib import Path

import pytest
from sanitizers.builds import ADDRESS, ENVIRONMENT, Build

import codegen

EXAMPLES = Path(__file__).parents[2] / "examples"
C = "-std=gnu11"
CPP = (
    "-std=c++20", "-Drestrict=__restrict__", "-Wno-unused-function", "-Wno-attributes", "-Wno-missing-field-initializers",
    "-Wno-deprecated-enum-enum-conversion", "-x", "c++",
)  # fmt: skip
PROGRAM = Path(__file__).with_name("threads.c")


@pytest.mark.parametrize(
    "build",
    [Build("gcc", (C, "-fsanitize=thread")), Build("gcc", (C, *ADDRESS)), Build("clang", (C,)), Build("g++", CPP)],
    ids=str,
)
def test_batches_on_threads_are_those_of_one(build, tmp_path):
    if build.missing:
        pytest.skip(build.missing)
    codegen.generate(EXAMPLES / "arm.yaml", tmp_path / "arm", functions=["accelerations"], compile=False)
    command = [
        build.compiler, "-O1", "-g", "-march=native", "-Wall", "-Wextra", "-Werror", "-pthread", *build.flags,
        "-I.", str(PROGRAM), "arm.c", "arm_states.c", "arm_threads.c", "-lm", "-o", "program",
    ]  # fmt: skip
    made = subprocess.run(command, cwd=tmp_path / "arm", capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    done = subprocess.run(
        ["./program"], cwd=tmp_path / "arm", capture_output=True, text=True, env=ENVIRONMENT, check=False
    )
    assert (done.returncode, done.stdout) == (0, "same\n"), done.stdout + done.stderr
