"""The first library is compiled from a copy while the rest of the package is printed, without leftovers."""

import os
import stat
import tempfile
import time
from pathlib import Path

import pytest

import codegen
from codegen.compiling_ahead import CompilingAhead
from codegen.runtime.standalone.files.build import Build

PENDULUM = Path(__file__).parents[1] / "examples" / "pendulum.yaml"


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A user's compiler flags, and a folder for the copies of this test."""
    monkeypatch.delenv("ORDERNM_CFLAGS")
    monkeypatch.setenv("TMPDIR", str(tmp_path / "room"))
    (tmp_path / "room").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", None)
    yield tmp_path / "room"
    tempfile.tempdir = None


@pytest.fixture
def compiled(monkeypatch):
    """Folders in which the C code of common calls has been compiled."""
    folders = []
    compile_ = Build._compile

    def noted(build, output, log_file):
        folders.extend([build.folder] if build.part in ("", "dynamics") and build.name == "pendulum" else [])
        compile_(build, output, log_file)

    monkeypatch.setattr(Build, "_compile", noted)
    return folders


def compiler(path, text):
    """A script that acts as the compiler."""
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def test_a_copy_is_compiled_and_its_library_put_into_the_package(room, compiled, tmp_path):
    package = tmp_path / "pendulum"
    assert codegen.generate(PENDULUM, package).compiled
    (copy,) = compiled
    assert copy.parent == room and not copy.exists() and not list(room.iterdir())
    assert [p.name for p in package.glob("*.so")]
    solver = codegen.load(package)
    q, u = solver.initial
    assert solver.sensitivities(q, u, dp=[[1.0] * solver.np])[1].shape == (1, solver.nu)
    assert compiled == [copy]


def test_what_is_compiled_already_is_not_compiled_again(room, compiled, tmp_path):
    codegen.generate(PENDULUM, tmp_path / "pendulum")
    codegen.generate(PENDULUM, tmp_path / "pendulum")
    assert len(compiled) == 1


def test_the_same_library_as_without(room, tmp_path, monkeypatch):
    codegen.generate(PENDULUM, tmp_path / "ahead")
    monkeypatch.setattr(CompilingAhead, "begin", lambda *_: None)
    codegen.generate(PENDULUM, tmp_path / "after")
    ahead, after = ([p.name for p in (tmp_path / x).glob("*.so")] for x in ("ahead", "after"))
    assert ahead == after != []  # the name has a digest of what is in it


def test_other_flags_are_for_the_package_itself(room, compiled, tmp_path, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-g -O0")
    codegen.generate(PENDULUM, tmp_path / "pendulum")
    assert compiled == [tmp_path / "pendulum"]


def test_a_compiler_that_fails_is_told_of_with_the_package_and_leaves_no_copy(room, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", compiler(tmp_path / "bad", "echo it is broken; exit 1"))
    with pytest.raises(codegen.runtime.CompileError, match="it is broken") as told:
        codegen.generate(PENDULUM, tmp_path / "pendulum")
    assert str(tmp_path / "pendulum" / "pendulum.log") in str(told.value)
    assert (tmp_path / "pendulum" / "pendulum.log").exists() and not list(room.iterdir())


def test_what_ends_the_work_ends_the_compilers(room, tmp_path, monkeypatch):
    begun = tmp_path / "begun"
    monkeypatch.setenv(
        "CC", compiler(tmp_path / "slow", f'[ "$1" = --version ] && exit 0; echo $$ >> {begun}; exec sleep 100')
    )

    def interrupted(stage, step, steps):
        if stage == "printing NumPy":
            while not begun.exists():
                time.sleep(0.01)
            raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        codegen.generate(PENDULUM, tmp_path / "pendulum", progress=interrupted)
    assert time.monotonic() - start < 50
    for number in map(int, begun.read_text().split()):
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)
    assert not list(room.iterdir()) and not (tmp_path / "pendulum").exists()


def test_without_a_place_for_the_copy_the_package_is_compiled_itself(room, compiled, tmp_path):
    room.rmdir()
    tempfile.tempdir = str(room)
    assert codegen.generate(PENDULUM, tmp_path / "pendulum").compiled
    assert compiled == [tmp_path / "pendulum"]
