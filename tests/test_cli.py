"""The command line: what it prints, and its exit codes 0 ok, 1 model, 2 usage, 3 compiling, 4 numbers."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import codegen
from codegen import generation
from codegen.cli import generate_main, main

MODEL = """\
model: rod
gravity: [0, 0, -9.81]
parameters:
  length: {value: 1.0, unit: "[m]"}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 1
    com: [0, 0, -length/2]
    inertia: {xx: 0.1, yy: 0.1, zz: 0.01}
"""
EXAMPLES = Path(codegen.__file__).parents[1] / "examples"
SHORT = (
    MODEL
    + """\
loops:
  pin:
    joint: {type: revolute, axis: y}
    from: {body: rod, at: [0, 0, -length]}
    to: {body: ground, at: [9, 0, 0]}
"""
)
WRONG = MODEL.replace("mass: 1", "mas: 1").replace("revolute", "revolving")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a model in it."""
    monkeypatch.chdir(tmp_path)
    Path("rod.yaml").write_text(MODEL)
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def shell(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess:
    """``python -m codegen`` in a process of its own."""
    env = {**os.environ, "PYTHONPATH": str(Path(codegen.__file__).parents[1]), **environment}
    command = [sys.executable, "-m", "codegen", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


# ---- generate --------------------------------------------------------------------------------------------------------


def test_generate_writes_compiles_and_checks(here, capsys):
    assert generate_main(["rod.yaml"]) == 0
    out, err = capsys.readouterr()
    assert not err
    assert str(here / "generated" / "rod") in out
    assert "1 bodies, 1 coordinates, 1 speeds, 1 parameters" in out and "target c" in out
    assert re.search(r"udot: \d+ operations .* per direction", out, re.S)
    assert re.search(r"relative error of udot \d\.\de[-+]\d\d, of its derivatives \d\.\de-\d\d", out)
    assert list((here / "generated" / "rod").glob("rod-*.so"))
    # a second time nothing is made anew
    before = files(here / "generated")
    assert main(["generate", "rod.yaml"]) == 0
    assert files(here / "generated") == before and "unchanged" in capsys.readouterr().out


def test_generate_options(here, capsys):
    assert generate_main(["rod.yaml", "-o", "out/deep", "--no-compile"]) == 0
    assert not list((here / "out" / "deep").glob("*.so")) and (here / "out" / "deep" / "rod.c").exists()
    assert "checked" not in capsys.readouterr().out
    assert generate_main(["rod.yaml", "-o", "plain", "--target", "numpy", "-v"]) == 0
    out = capsys.readouterr().out
    assert "target numpy" in out and "checked against" in out
    for word in ("sweep", "triangularize", "pass", "per direction", "rod_numpy.py", "_runtime.py"):
        assert word in out
    assert not list((here / "plain").glob("*.so"))
    assert generate_main(["rod.yaml", "-o", "unrolled", "--layout", "unrolled", "--target", "numpy", "--no-check"]) == 0
    out = capsys.readouterr().out
    assert "layout unrolled" in out and "checked" not in out
    assert generate_main(["rod.yaml", "-o", "kinds", "--layout", "kinds", "--target", "numpy", "--no-check"]) == 0
    assert "layout kinds" in capsys.readouterr().out


def test_warnings_and_folders_are_printed_as_they_are(here, capsys):
    # rich would take [..] for markup and drop it
    Path("rod.yaml").write_text(MODEL.replace("bodies:", "  unused: 2\nbodies:"))
    assert generate_main(["rod.yaml", "-o", "[bold]x[/bold]", "--no-compile"]) == 0
    out = capsys.readouterr().out
    assert "[bold]x[/bold]" in out
    assert re.search(r"rod\.yaml:\d+:\d+: warning: parameters\.unused", out)


@pytest.mark.parametrize("command", ["generate", "check", "show"])
def test_a_wrong_model_is_exit_code_1(here, capsys, command):
    Path("wrong.yaml").write_text(WRONG)
    assert main([command, "wrong.yaml"]) == 1
    out, err = capsys.readouterr()
    assert not out and "Traceback" not in err
    lines = err.splitlines()
    assert len(lines) == 2  # all at once
    assert lines[0].startswith("wrong.yaml:8:") and "revolving" in lines[0] and "revolute" in lines[0]
    assert lines[1].startswith("wrong.yaml:9:") and "bodies.rod.mas" in lines[1] and "did you mean 'mass'" in lines[1]
    assert not (here / "generated").exists()


@pytest.mark.parametrize("command", ["generate", "check", "show"])
@pytest.mark.parametrize("content", [None, "", "[1, 2", "just text", b"\xff\xfe\x00", "model: x\nmodel: y\n"])
def test_no_model_at_all_is_exit_code_1(here, capsys, command, content):
    if content is not None:
        Path("x.yaml").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main([command, "x.yaml"]) == 1
    out, err = capsys.readouterr()
    assert not out and "x.yaml" in err and "Traceback" not in err


def test_a_singular_model_names_its_body(here, capsys):
    # the inertia of the last body is zero at the initial parameters: the equations would divide by zero
    Path("rod.yaml").write_text(
        MODEL.replace("mass: 1", "mass: 0").replace("0.1, yy: 0.1, zz: 0.01", "0, yy: 0, zz: 0")
    )
    assert generate_main(["rod.yaml"]) == 1
    assert "rod" in capsys.readouterr().err and not (here / "generated").exists()


USAGES = ["", "bogus", "generate", "generate rod.yaml --target rust", "generate rod.yaml --layout flat",
          "generate rod.yaml --fast", "check", "new a.yaml b.yaml"]  # fmt: skip


@pytest.mark.parametrize("arguments", USAGES)
def test_wrong_usage_is_exit_code_2(here, capsys, arguments):
    with pytest.raises(SystemExit) as end:
        main(arguments.split())
    assert end.value.code == 2
    assert "usage: ordernm" in capsys.readouterr().err


def test_a_foreign_folder_is_exit_code_2(here, capsys):
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("precious")
    before = files(here)
    for folder, said in (("mine", "did not write"), ("rod.yaml", "is a file"), (".", "working directory")):
        assert generate_main(["rod.yaml", "-o", folder]) == 2
        err = capsys.readouterr().err
        assert err.startswith("generate: ") and said in err and "-o" in err and err.count("\n") == 1
    assert files(here) == before


def test_a_folder_that_cannot_be_made_is_exit_code_2(here, capsys):
    assert generate_main(["rod.yaml", "-o", "rod.yaml/x", "--no-compile"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("generate: ") and "rod.yaml/x" in err and "Traceback" not in err
    assert sorted(p.name for p in here.iterdir()) == ["rod.yaml"]


def test_a_failing_compiler_is_exit_code_3(here, capsys, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-fno-such-flag")
    assert generate_main(["rod.yaml"]) == 3
    err = capsys.readouterr().err
    assert "no-such-flag" in err and ".log" in err and "Traceback" not in err
    assert (here / "generated" / "rod" / "rod.c").exists()


@pytest.mark.parametrize("target", ["c", "both"])
def test_no_compiler_is_no_failure(here, capsys, monkeypatch, target):
    monkeypatch.setenv("CC", "no-such-compiler")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # it is said once, by the command
        assert generate_main(["rod.yaml", "--target", target]) == 0
    out, err = capsys.readouterr()
    assert out.count("no-such-compiler") == 1 and "NumPy" in out and not err
    assert "checked against" in out


def test_forbidden_flags_are_no_traceback(here, capsys, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O3 -ffast-math")
    assert generate_main(["rod.yaml"]) == 3
    err = capsys.readouterr().err
    assert "-ffast-math" in err and "ORDERNM_CFLAGS" in err and "Traceback" not in err
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O3 '")
    assert generate_main(["rod.yaml"]) == 3
    assert "ORDERNM_CFLAGS" in capsys.readouterr().err


@pytest.mark.parametrize("error", [1e-3, float("nan"), float("inf")])
def test_wrong_numbers_are_exit_code_4(here, capsys, monkeypatch, error):
    def check(model, report):
        report.errors = {"udot": 1e-16, "dudot": error}

    monkeypatch.setattr(generation, "check_solver", check)
    assert generate_main(["rod.yaml", "--target", "numpy"]) == 4
    err = capsys.readouterr().err
    assert "dudot" in err and "'udot'" not in err and "report" in err


def test_models_too_large_to_check_are_said(here, capsys, monkeypatch):
    monkeypatch.setattr(generation, "CHECK_LIMIT", 0)
    assert generate_main(["rod.yaml", "--target", "numpy"]) == 0
    assert "not checked" in capsys.readouterr().out


# ---- check, show, new ------------------------------------------------------------------------------------------------


def test_check(here, capsys):
    assert main(["check", "rod.yaml"]) == 0
    assert capsys.readouterr().out == "rod.yaml: 1 bodies, 1 coordinates, 1 speeds: ok\n"
    Path("rod.yaml").write_text(MODEL.replace("bodies:", "  unused: 2\nbodies:"))
    assert main(["check", "rod.yaml"]) == 0
    out = capsys.readouterr().out
    assert "warning" in out and "unused" in out and out.count("warning:") == 1


def test_check_closes_the_loops(here, capsys):
    Path("bars.yaml").write_text((EXAMPLES / "four_bar.yaml").read_text())
    assert main(["check", "bars.yaml"]) == 0
    assert "1 degree of freedom" in capsys.readouterr().out
    assert not list(here.glob("generated"))


def test_check_tells_a_loop_that_does_not_close(here, capsys):
    text = (EXAMPLES / "four_bar.yaml").read_text()
    Path("bars.yaml").write_text(text)
    assert main(["show", "bars.yaml"]) == 0
    assert "loop " in capsys.readouterr().out
    Path("short.yaml").write_text(SHORT)
    assert main(["check", "short.yaml"]) == 1
    out, err = capsys.readouterr()
    assert "ok" not in out and "pin" in err and "cannot be closed" in err


def bars(ground: float, hint: str = "", initial: str = "q: {}") -> str:
    """A four-bar of lengths 1, 1.5, 1 in the plane; all angles are zero where it is stretched."""
    rod = "{{parent: {}, joint: {{type: revolute, axis: y, at: [{}, 0, 0]}}, mass: 1, com: [0.4, 0, 0]}}"
    bodies = [("a", "ground", 0), ("b", "a", 1), ("c", "b", 1.5)]
    return (
        "model: bars\ngravity: [0, 0, -9.81]\nbodies:\n"
        + "".join(f"  {name}: {rod.format(parent, at)}\n" for name, parent, at in bodies)
        + "loops:\n  pin: {joint: {type: revolute, axis: y}, from: {body: c, at: [1, 0, 0]}, "
        f"to: {{body: ground, at: [{ground}, 0, 0]}}}}\nindependent: [{hint}]\ninitial: {{{initial}}}\n"
    )


def test_a_singular_start_is_told(here, capsys):
    """Stretched to the full: the rank there is one, and there is no other configuration to look at."""
    Path("flat.yaml").write_text(bars(3.5))
    assert main(["check", "flat.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "warning: loop pin cannot be closed otherwise" in out and "singular" in out and "rank 1 of 5" in out
    Path("hinted.yaml").write_text(bars(3.5, "a"))
    assert main(["check", "hinted.yaml"]) == 1
    err = capsys.readouterr().err
    assert "a cannot be independent; remove it" in err and "seems to be singular" in err
    assert generate_main(["hinted.yaml"]) == 1
    assert capsys.readouterr().err.startswith("hinted.yaml: loops: loop pin")


def test_a_package_that_could_not_be_checked_says_why(here, capsys):
    """A linkage that moves, started flat."""
    Path("folded.yaml").write_text(bars(1.5, "a", "q: {a: 0, b: 0, c: 3.141592653589793}"))
    assert generate_main(["folded.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "warning: loop pin: the closure matrix" in out and "start from another configuration" in out
    assert "warning: not checked against the generic engine: at the initial configuration loop pin has lost rank" in out


def test_initial_values_that_do_not_close_are_told(here, capsys):
    Path("bars.yaml").write_text(bars(1.5, "a", "q: {a: -1, b: 1, c: 1}, u: {a: 2, b: 17}"))
    assert main(["check", "bars.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "initial u of dependent speeds do not close the loops; they are changed, b from 17 to" in out
    Path("far.yaml").write_text(bars(3.4, "a", "q: {a: -2, b: 1, c: 1}"))
    assert main(["check", "far.yaml"]) == 0
    assert "they were moved, a from -2 to" in " ".join(capsys.readouterr().out.split())


def test_show_a_model_and_a_package(here, capsys):
    assert main(["show", "rod.yaml"]) == 0
    out = capsys.readouterr().out
    assert "rod ground" in out and "rod revolute" in out and "parameter length = 1.0 [m]" in out
    assert main(["show", "."]) == 2
    assert "no generated solver" in capsys.readouterr().err
    assert generate_main(["rod.yaml", "-o", "out", "--no-compile"]) == 0
    capsys.readouterr()
    assert main(["show", "out"]) == 0
    assert "<Solver rod: nq=1" in capsys.readouterr().out


def test_new_makes_a_model_without_warnings(here, capsys):
    assert main(["new", "pendulum.yaml"]) == 0
    assert "generate pendulum.yaml" in capsys.readouterr().out
    assert codegen.load_model("pendulum.yaml").warnings == ()
    assert generate_main(["pendulum.yaml", "--target", "numpy"]) == 0
    out, err = capsys.readouterr()
    assert "warning" not in out and not err
    solver = codegen.load("generated/pendulum")
    assert solver.parameter_names == ("length",) and solver.output_names == ("energy",)


@pytest.mark.parametrize(
    "name", ["a b.yaml", "class.yaml", "double.yaml", "7up.yaml", "é.yaml", "rod.yaml", "no/where.yaml"]
)
def test_new_refuses(here, capsys, name):
    before = files(here)
    assert main(["new", name]) == 2
    err = capsys.readouterr().err
    assert err.startswith("new: ") and err.count("\n") == 1
    assert files(here) == before


# ---- as a program ----------------------------------------------------------------------------------------------------


def test_python_m_codegen_is_ordernm(here):
    run = shell("--version", cwd=here)
    assert run.returncode == 0 and run.stdout == f"ordernm {codegen.__version__}\n"
    run = shell("generate", "missing.yaml", cwd=here)
    assert run.returncode == 1 and run.stderr.startswith("missing.yaml") and "Traceback" not in run.stderr
    Path("wrong.yaml").write_text(WRONG)
    run = shell("check", "wrong.yaml", cwd=here)
    assert run.returncode == 1 and run.stderr.count("\n") == 2 and "Traceback" not in run.stderr
    assert shell("frobnicate", cwd=here).returncode == 2


def test_output_needs_no_unicode_terminal(here):
    run = shell(
        "generate", "rod.yaml", "--no-compile", "-v", cwd=here, PYTHONIOENCODING="ascii", LC_ALL="C", COLUMNS="40"
    )
    assert run.returncode == 0 and "Traceback" not in run.stderr
    run = shell("show", "rod.yaml", cwd=here, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert run.returncode == 0 and "revolute" in run.stdout
