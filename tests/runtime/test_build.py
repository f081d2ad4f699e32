"""Compilation: only once, into the right folder, safe with several processes, and with an error if it fails."""

import multiprocessing
import os
import shutil
import stat
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest

from codegen.runtime import CompileError, NoCompilerError, SingularJointError, TargetsDifferError, load
from codegen.runtime.standalone.files import build, user_cache
from codegen.runtime.standalone.files.compiler import find_compiler, searches

EXPECTED = -9.81 / 0.5 * np.sin(0.3)


def libraries(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


def accelerate(solver) -> float:
    return float(solver.accelerations([0.3], [0.0])[0])


def script(path: Path, text: str) -> Path:
    """An executable shell script."""
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_a_package_is_compiled_once(pendulum):
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    (library,) = libraries(pendulum)
    before = library.stat()
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    after = library.stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)
    assert not list(pendulum.glob(".build*"))


def test_another_source_compiler_or_flag_is_another_library(pendulum, monkeypatch, tmp_path):
    load(pendulum)
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O1")
    load(pendulum)
    assert len(libraries(pendulum)) == 2
    other = script(tmp_path / "other_cc", f'exec {shutil.which("cc") or shutil.which("gcc")} "$@"')
    monkeypatch.setenv("CC", str(other))
    load(pendulum)
    assert len(libraries(pendulum)) == 3
    source = pendulum / "pendulum.c"
    source.write_text(source.read_text().replace("sin(q[0]) - 0.1", "sin(q[0]) - 0.2"))
    assert load(pendulum).accelerations([0.0], [1.0]) == pytest.approx(-0.2)
    header = pendulum / "pendulum.h"
    header.write_text(header.read_text() + "/* more */\n")
    load(pendulum)
    assert len(libraries(pendulum)) == 5


def test_a_library_is_known_by_what_its_sources_include(tmp_path):
    """Also what that includes; other files beside it do not matter."""
    (tmp_path / "part").mkdir()
    texts = {"m.c": '#include "part/a.h"\n#include <math.h>\n', "m_calls.c": "", "part/a.h": '#  include "b.h"\n', "part/b.h": "",
             "m_other.h": ""}  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    made = build.Build(tmp_path, "m")
    before = made.key()
    (tmp_path / "m_other.h").write_text("int x;\n")
    assert made.key() == before
    for name, text in texts.items():
        if name != "m_other.h":
            (tmp_path / name).write_text(text + "int y;\n")
            assert made.key() != before, name
            (tmp_path / name).write_text(text)
            assert made.key() == before


def test_the_processor_is_part_of_the_key(pendulum, monkeypatch):
    load(pendulum)
    monkeypatch.setattr(build, "processor", lambda: "another processor")
    load(pendulum)
    assert len(libraries(pendulum)) == 2


DAMAGES = {
    "empty": lambda whole: b"",
    "no library": lambda whole: b"no library at all",
    "half": lambda whole: whole[: len(whole) // 2],
    "last byte": lambda whole: whole[:-1],
    "zeros": lambda whole: whole[: len(whole) // 2] + bytes(len(whole) - len(whole) // 2),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_library_is_built_anew(pendulum, damage):
    # opening a library that was cut short would kill the process (SIGBUS)
    library = build.Build(pendulum, "pendulum").library()
    library.write_bytes(DAMAGES[damage](library.read_bytes()))
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    (library,) = libraries(pendulum)
    assert library.stat().st_size > 1000


def test_a_library_that_does_not_open_is_built_anew(pendulum, monkeypatch):
    # whole, but made for another machine
    library = build.Build(pendulum, "pendulum").library()
    digest = library.stem.rpartition("-")[2]
    monkeypatch.setattr(build, "digest", lambda file: digest)
    library.write_bytes(b"for another machine")
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    assert library.stat().st_size > 1000


def test_a_user_without_a_home_is_served(pendulum, monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(build, "user_cache", homeless)
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)


def test_a_failed_compile_keeps_source_and_log(pendulum):
    source = pendulum / "pendulum.c"
    source.write_text(source.read_text() + "this is no C;\n")
    with pytest.raises(CompileError, match=r"pendulum\.log") as caught:
        load(pendulum)
    log = pendulum / "pendulum.log"
    assert str(source) in str(caught.value)
    assert "error" in str(caught.value)
    assert "error" in log.read_text()
    assert source.exists()
    assert not libraries(pendulum)
    assert not list(pendulum.glob(".build*"))
    source.write_text(source.read_text().replace("this is no C;\n", ""))
    load(pendulum)
    assert not log.exists()


def test_a_compiler_that_fails_is_no_missing_compiler(pendulum, monkeypatch, tmp_path):
    monkeypatch.setenv("CC", str(script(tmp_path / "cc", "echo out of order; exit 7")))
    with pytest.raises(CompileError, match="out of order"):
        load(pendulum)


def test_a_compiler_that_writes_nothing_is_told(pendulum, monkeypatch, tmp_path):
    monkeypatch.setenv("CC", str(script(tmp_path / "cc", "exit 0")))
    with pytest.raises(CompileError, match="reported no error, but wrote no library"):
        load(pendulum)


def test_what_fails_for_another_reason_is_not_tried_without_march_native(pendulum):
    (pendulum / "pendulum.c").write_text("no C\n")
    with pytest.raises(CompileError):
        load(pendulum)
    (command,) = [line for line in (pendulum / "pendulum.log").read_text().splitlines() if line.startswith("$ ")]
    assert "-march=native" in command


@pytest.mark.parametrize("flags", [["march=native"], ["--param"], ["march=native", "--param"]])
def test_a_compiler_without_some_flags_is_served(pendulum, monkeypatch, tmp_path, flags):
    real = shutil.which("cc") or shutil.which("gcc")
    refuse = [f'case "$*" in *{flag}*) echo "error: unknown {flag}" >&2; exit 1;; esac' for flag in flags]
    note = f'case "$*" in *--version*) ;; *) echo "$*" >> {tmp_path / "commands"};; esac'
    monkeypatch.setenv("CC", str(script(tmp_path / "cc", "\n".join([note, *refuse, f'exec {real} "$@"']))))
    monkeypatch.delenv("ORDERNM_CFLAGS", raising=False)
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    first, *_, last = (tmp_path / "commands").read_text().splitlines()
    assert all(flag in first and flag not in last for flag in flags)


def test_flags_of_the_environment_have_none_beside_them(monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O1")
    assert searches(find_compiler()) == ()
    monkeypatch.delenv("ORDERNM_CFLAGS")
    assert searches(["clang, which is not there"]) == ()


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-fassociative-math", "-fsingle-precision-constant"])
def test_arithmetic_that_breaks_the_solver_is_refused(pendulum, monkeypatch, flag):
    monkeypatch.setenv("ORDERNM_CFLAGS", f"-O3 {flag}")
    with pytest.raises(ValueError, match=f"ORDERNM_CFLAGS contains {flag}"):
        load(pendulum)
    monkeypatch.delenv("ORDERNM_CFLAGS")
    monkeypatch.setenv("CC", f"{shutil.which('cc') or shutil.which('gcc')} {flag}")
    with pytest.raises(CompileError, match=f"CC contains {flag}"):
        load(pendulum)


def test_the_compiler_may_have_arguments(pendulum, monkeypatch):
    monkeypatch.setenv("CC", f"{shutil.which('cc') or shutil.which('gcc')} -DUNUSED=1")
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)


@pytest.mark.parametrize("environment", [{"CC": "no-such-compiler"}, {"PATH": os.devnull, "CC": ""}])
def test_without_compiler_numpy_serves(pendulum, monkeypatch, environment):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.warns(RuntimeWarning, match="no C compiler found.*NumPy"):
        solver = load(pendulum)
    assert solver.target == "numpy"
    assert accelerate(solver) == pytest.approx(EXPECTED, rel=1e-15)


def test_without_compiler_a_library_of_before_serves(pendulum, monkeypatch):
    load(pendulum)
    monkeypatch.setenv("CC", "no-such-compiler")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(pendulum).target == "c"


def test_without_cffi_numpy_serves(pendulum, monkeypatch):
    monkeypatch.setitem(sys.modules, "cffi", None)
    with pytest.warns(RuntimeWarning, match=r"cffi.*NumPy"):
        assert load(pendulum).target == "numpy"


def test_a_library_goes_to_the_users_cache_if_the_package_is_read_only(pendulum, monkeypatch, tmp_path):
    real = tempfile.TemporaryDirectory

    def refuse(*arguments, dir, **options):
        if Path(dir) == pendulum:
            raise PermissionError(13, "Permission denied", str(dir))
        return real(*arguments, dir=dir, **options)

    monkeypatch.setattr(build.tempfile, "TemporaryDirectory", refuse)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "platform", "linux")
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    assert not libraries(pendulum)
    (library,) = libraries(tmp_path / "cache" / "ordernm" / "pendulum")
    before = library.stat().st_ino
    load(pendulum)
    assert library.stat().st_ino == before
    monkeypatch.setenv("XDG_CACHE_HOME", str(pendulum / "model.json"))
    with pytest.raises(CompileError, match="no folder to write"):
        load(pendulum)


def test_where_a_folder_is_in_the_librarys_place_the_cache_serves(pendulum, monkeypatch, tmp_path):
    # what makes a place unfit may show only when the library is moved there: a full disk, a folder of that name
    library = build.Build(pendulum, "pendulum").library()
    library.unlink()
    library.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "platform", "linux")
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)
    assert len(libraries(tmp_path / "cache" / "ordernm" / "pendulum")) == 1
    assert not list(pendulum.glob(".build*"))
    monkeypatch.setattr(build, "user_cache", lambda: pendulum / "model.json")
    with pytest.raises(CompileError, match=r"no folder to write the library of pendulum to: .*Is a directory"):
        load(pendulum)


@pytest.mark.skipif(sys.platform == "darwin", reason="file names are text there")
def test_a_folder_whose_name_is_no_text_works(pendulum):
    folder = pendulum.with_name("h\udcfclle")  # latin-1 for u with two dots
    pendulum.rename(folder)
    assert accelerate(load(folder)) == pytest.approx(EXPECTED, rel=1e-15)


@pytest.mark.parametrize("seconds", ["inf", "1e300", "1e9"])
def test_a_compiler_may_take_as_long_as_one_likes(pendulum, monkeypatch, seconds):
    monkeypatch.setenv("ORDERNM_COMPILE_SECONDS", seconds)
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)


def _build(folder: str, results) -> None:
    try:
        results.put(accelerate(load(folder)))
    except BaseException as error:
        results.put(repr(error))
        raise


def test_processes_may_build_at_once(pendulum, monkeypatch, tmp_path):
    real = shutil.which("cc") or shutil.which("gcc")
    slow = (
        f'case "$*" in *--version*) ;; *) sleep 0.3;; esac\nexec {real} "$@"'  # all find nothing and start to compile
    )
    monkeypatch.setenv("CC", str(script(tmp_path / "cc", slow)))
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    processes = [context.Process(target=_build, args=(str(pendulum), results)) for _ in range(3)]
    for p in processes:
        p.start()
    found = [results.get(timeout=60) for _ in processes]
    for p in processes:
        p.join(60)
    assert found == [pytest.approx(EXPECTED, rel=1e-15)] * 3
    assert [p.exitcode for p in processes] == [0] * 3
    assert len(libraries(pendulum)) == 1
    assert not list(pendulum.glob(".build*"))


def test_several_sources_are_compiled_and_linked(make_pendulum):
    folder = make_pendulum(sources=["pendulum.c", "pendulum_calls.c", "pendulum_more.c"])
    text = (folder / "pendulum.c").read_text()
    cut = text.index("#define SENSITIVITIES")
    (folder / "pendulum.c").write_text(text[:cut])
    (folder / "pendulum_more.c").write_text('#include <math.h>\n#include "pendulum.h"\n' + text[cut:])
    solver = load(folder)
    _, dudot = solver.sensitivities([0.3], [0.0], dq=[1.0])
    assert dudot[0, 0] == pytest.approx(-9.81 / 0.5 * np.cos(0.3))
    (folder / "pendulum_more.c").write_text("no C\n")
    with pytest.raises(CompileError, match=r"pendulum_more\.c"):
        load(folder)


def test_both_targets_are_compared(pendulum):
    assert load(pendulum, "both").target == "c"
    module = pendulum / "pendulum_numpy.py"
    module.write_text(module.read_text().replace("0.1 * du", "0.1000001 * du"))
    with pytest.raises(TargetsDifferError, match="dudot of sensitivities"):
        load(pendulum, "both")
    load(pendulum)


def test_a_singular_joint_is_named(pendulum):
    for target in ("c", "numpy"):
        solver = load(pendulum, target)
        with pytest.raises(SingularJointError, match="outboard of joint rod") as caught:
            solver.accelerations([0.3], [0.0], p={"length": 0.0})
        assert caught.value.link == "rod"
        assert isinstance(caught.value, np.linalg.LinAlgError)
    solver = load(pendulum)
    with pytest.raises(SingularJointError, match=r"state \[1, 0\] of the batch"):
        solver.accelerations(np.zeros((2, 1, 1)), [0.0], p=[[[9.81, 1.0]], [[9.81, 0.0]]])
    with pytest.raises(SingularJointError, match="rod"):
        solver.sensitivities([0.3], [0.0], p={"length": 0.0}, dq=[1.0])


def test_a_function_that_was_not_generated_is_said_so(pendulum):
    solver = load(pendulum)
    with pytest.raises(
        AttributeError, match=r"without the function 'mass_matrix'; it has accelerations, sensitivities"
    ):
        solver.mass_matrix([0.3])


def test_an_unknown_target_is_refused(pendulum):
    with pytest.raises(ValueError, match="'fortran'; allowed are 'c', 'numpy' and 'both'"):
        load(pendulum, "fortran")


def test_find_compiler_says_what_it_looked_for(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    with pytest.raises(NoCompilerError, match="CC=no-such-compiler -m64 was not found"):
        build.find_compiler()


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o700])
def test_a_library_that_others_planted_is_not_loaded(pendulum, monkeypatch, tmp_path, mode):
    """It has the right name and its own digest; only where nobody else can write is it taken for ours."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "platform", "linux")
    place = tmp_path / "cache" / "ordernm" / "pendulum"
    place.mkdir(parents=True)
    for folder in (place.parent, place):
        folder.chmod(mode)
    key = build.Build(pendulum, "pendulum").key()
    planted = place / "planted.so"
    planted.write_bytes(b"planted")
    planted = planted.rename(place / f"{key}-{build.digest(planted)}.so")
    planted.chmod(0o700)
    made = build.Build(pendulum, "pendulum")
    if mode == 0o700:
        assert made.found() == planted
        return
    with pytest.warns(RuntimeWarning, match="the cache is not used"):
        assert made.library().parent == pendulum
    assert accelerate(load(pendulum)) == pytest.approx(EXPECTED, rel=1e-15)


def test_a_cache_of_another_user_is_not_used(pendulum, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "platform", "linux")
    made = user_cache.make_private(tmp_path / "cache" / "ordernm" / "pendulum")
    assert stat.S_IMODE(made.stat().st_mode) == 0o700
    monkeypatch.setattr(os, "geteuid", lambda: made.stat().st_uid + 1)
    with pytest.raises(user_cache.CacheError, match=rf"ordernm belongs to user {made.stat().st_uid}"):
        user_cache.make_private(made)
