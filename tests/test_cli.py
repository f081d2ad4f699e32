"""The command line: its output, and its exit codes 0 ok, 1 model, 2 usage, 3 compilation, 4 numerical failure."""

import os
import re
import shlex
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
    """A working directory that contains a model."""
    monkeypatch.chdir(tmp_path)
    Path("rod.yaml").write_text(MODEL)
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def shell(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess:
    """Run ``python -m codegen`` in a new process."""
    env = {**os.environ, "PYTHONPATH": str(Path(codegen.__file__).parents[1]), **environment}
    command = [sys.executable, "-m", "codegen", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


# ---- generate --------------------------------------------------------------------------------------------------------


def test_generate_writes_compiles_and_checks(here, capsys):
    assert generate_main(["rod.yaml"]) == 0
    out, err = capsys.readouterr()
    assert not err
    assert str(here / "generated" / "rod") in out
    assert "1 body, 1 coordinate, 1 speed, 1 parameter;" in out and "target c" in out
    assert re.search(r"udot: \d+ operations .* per direction", out, re.S)
    assert re.search(r"relative error of udot \d\.\de[-+]\d\d, of its derivatives \d\.\de-\d\d", out)
    assert list((here / "generated" / "rod").glob("rod*.so"))
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
    for word in ("sweep", "triangularize", "pass", "per direction", "rod_numpy.py", "_runtime/calls/package.py"):
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
    monkeypatch.delenv("ORDERNM_CFLAGS")
    monkeypatch.setenv("ORDERNM_CFFI", "ctypes")
    assert generate_main(["rod.yaml"]) == 3
    assert "ORDERNM_CFFI is 'ctypes'; allowed are" in capsys.readouterr().err


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
    assert capsys.readouterr().out == "rod.yaml: 1 body, 1 coordinate, 1 speed: ok\n"
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


def test_a_mechanism_that_cannot_move_is_told(here, capsys):
    """Stretched to the full: the rank there is one, and there is no other configuration to look at."""
    Path("flat.yaml").write_text(bars(3.5))
    assert main(["check", "flat.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "warning: loop pin cannot be closed in any other configuration" in out
        and "singular" in out
        and "rank 1 of 5" in out
    )
    Path("hinted.yaml").write_text(bars(3.5, "a"))
    assert main(["check", "hinted.yaml"]) == 1
    err = capsys.readouterr().err
    assert "a cannot be independent; remove it" in err and "seems to be singular" in err
    assert generate_main(["hinted.yaml"]) == 1
    assert capsys.readouterr().err.startswith("hinted.yaml: loops: loop pin")


@pytest.mark.parametrize("short", [1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
def test_a_mechanism_that_can_hardly_move_has_no_condition_dropped(here, capsys, short):
    """Nearly stretched, a loop is open by the square of how far it is off, less than the tolerance: not a redundant condition."""
    Path("flat.yaml").write_text(bars(3.5 - short))
    assert main(["check", "flat.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "dropped" not in out and "inf" not in out
    if short < 2e-7:  # it moves by less than a millirad
        assert (
            "cannot be closed in any other configuration" in out
            and "lengths are just long enough" in out
            and "rank 1 of 5" in out
        )
    else:
        assert "1 degree of freedom" in out and "rank 2 of 5" in out and "does not close from the initial values" in out


@pytest.mark.parametrize("long", [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
def test_a_distance_that_is_too_long_by_less_than_the_tolerance_is_told(here, capsys, long):
    Path("open.yaml").write_text(bars(3.5 + long))
    assert main(["check", "open.yaml"]) == 1
    err = " ".join(capsys.readouterr().err.split())
    assert "loop pin (revolute joint between c and ground) cannot be closed" in err and f"{long:.3g} m" in err


def test_a_package_that_could_not_be_checked_says_why(here, capsys):
    """A linkage that moves, started flat."""
    Path("folded.yaml").write_text(bars(1.5, "a", "q: {a: 0, b: 0, c: 3.141592653589793}"))
    assert generate_main(["folded.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "warning: loop pin: the closure matrix" in out and "start from another configuration" in out
    assert "warning: not checked against the generic engine: at the initial configuration loop pin has lost rank" in out


def test_check_refuses_what_generate_refuses(here, capsys):
    Path("light.yaml").write_text(
        bars(1.5, "a", "q: {a: -1, b: 1, c: 1}").replace("mass: 1, com: [0.4, 0, 0]", "mass: 0")
    )
    errors = []
    for run in (lambda: main(["check", "light.yaml"]), lambda: generate_main(["light.yaml", "--no-compile"])):
        assert run() == 1
        errors.append(capsys.readouterr().err)
    assert (
        errors[0] == errors[1]
        and "nothing that moves with a has inertia; give the bodies of the loops mass" in errors[0]
    )


def test_initial_values_that_do_not_close_are_told(here, capsys):
    Path("bars.yaml").write_text(bars(1.5, "a", "q: {a: -1, b: 1, c: 1}, u: {a: 2, b: 17}"))
    assert main(["check", "bars.yaml"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "initial values u of dependent speeds do not close the loops and were changed: b from 17 to" in out
    Path("far.yaml").write_text(bars(3.4, "a", "q: {a: -2, b: 1, c: 1}"))
    assert main(["check", "far.yaml"]) == 0
    assert "they were changed, a from -2 to" in " ".join(capsys.readouterr().out.split())


EVERYTHING = """\
model: press
gravity: [0, 0, -9.81]
parameters:
  arm: {value: 0.25, unit: m, min: 0.1}
  k: 40.0
inputs: [motor, clamp]
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, mass: 4*arm, com: [arm/2, 0, 0], inertia: {yy: 0.02}}
  rod: {parent: crank, joint: {type: revolute, axis: -y, at: [arm, 0, 0]}, mass: 0.7, inertia: {yy: 0.03}}
  ram: {parent: ground, joint: {type: prismatic, axis: [0, 0, 2], rpy: [0, 0, 0.1]}, mass: 2}
loops:
  pin: {joint: {type: point}, from: {body: rod, at: [3*arm, 0, 0]}, to: ram}
forces:
  drive: {type: joint, joint: crank, value: motor - 0.5*u.crank}
  return: {type: spring, from: ram, to: {body: ground, at: [0, 0, 2]}, stiffness: k*(1 + clamp), damping: 3, free_length: 0.5}
initial:
  q: {crank: 0.3, rod: 1.5, ram: 0.8}
  u: {crank: 2*arm}
independent: [crank]
outputs:
  height: {position: ram, axis: z}
  stored: potential_energy
"""
LISTED = [
    "press: 3 bodies, 3 coordinates, 3 speeds, 1 loop",
    "  gravity: [0, 0, -9.81] m/s^2",
    "  parameter arm = 0.25 m (at least 0.1)",
    "  parameter k = 40.0",
    "  inputs: motor, clamp",
    "  body crank: revolute -y on ground; mass 4*arm = 1 kg at [arm/2, 0, 0], inertia [0, 0.02, 0, 0, 0, 0] kg m^2",
    "    body rod: revolute -y at [arm, 0, 0]; mass 0.7 kg, inertia [0, 0.03, 0, 0, 0, 0] kg m^2",
    "  loop pin: spherical from rod [3*arm, 0, 0] to ram",
    "  force drive: on joint crank: motor - 0.5*u.crank",
    "  spring return: from ram to ground [0, 0, 2]; stiffness k*(1 + clamp), damping 3, free length 0.5",
    "  initial q: crank = 0.3, rod = 1.5, ram = 0.8",
    "  initial u: crank = 2*arm",
    "  independent, as the model asks: crank",
    "  output height: position of ram along z",
    "  output stored: potential energy",
]


def test_show_says_all_that_a_model_holds(here, capsys):
    Path("press.yaml").write_text(EVERYTHING)
    assert main(["show", "press.yaml"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert [line for line in LISTED if line not in out] == []
    (ram,) = [line for line in out if line.startswith("  body ram")]
    assert ram.startswith("  body ram: prismatic [0, 0, 2] turned ") and "0.1 about z" in ram and "mass 2 kg" in ram
    assert any("of 3 speeds" in line and "of freedom: crank" in line for line in out)
    # what cannot be closed is listed too
    Path("press.yaml").write_text(EVERYTHING.replace("to: ram}", "to: {body: ram, at: [9, 0, 0]}}", 1))
    assert main(["show", "press.yaml"]) == 1
    out, err = capsys.readouterr()
    assert "loop pin: spherical from rod" in out and err.startswith("press.yaml: loops: ")


def test_show_a_package(here, capsys, monkeypatch):
    assert main(["show", "."]) == 2
    assert "no complete generated solver" in capsys.readouterr().err
    Path("press.yaml").write_text(EVERYTHING)
    assert generate_main(["press.yaml", "-o", "c", "--no-compile"]) == 0
    assert generate_main(["press.yaml", "-o", "plain", "--target", "numpy", "--no-check"]) == 0
    capsys.readouterr()
    assert main(["show", "plain"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert "generated from press.yaml by ordernm" in out[0] and str(here / "plain") in out[0]
    assert "target numpy" in out[1] and "NumPy computes" in out[1]
    assert [line for line in LISTED if line not in out] == [] and any("of freedom: crank" in line for line in out)
    # what computes is what would compute here
    assert main(["show", "c"]) == 0
    line = capsys.readouterr().out.splitlines()[1]
    assert "target c" in line and "C computes" in line and "when it is loaded first" in line
    codegen.load("c")
    (library,) = Path("c").glob("press.*.so")  # of what nearly everybody calls
    assert main(["show", "c"]) == 0
    assert re.search(
        rf"compiled C computes: {re.escape(library.name)}(, (AVX-512|AVX2?|SSE2|NEON))?$",
        capsys.readouterr().out.splitlines()[1],
    )
    library.unlink()
    monkeypatch.setenv("CC", "no-such-compiler")
    assert main(["show", "c"]) == 0
    assert "NumPy computes, since there is no C compiler" in capsys.readouterr().out.splitlines()[1]


def test_large_models_are_no_walls(here, capsys):
    text = """\
model: endless
bodies:
  repeat k in 1..500:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -1]}
      mass: 1
      inertia: {xx: 1, yy: 1, zz: 9}
      first: {parent: ground}
forces:
  repeat k in 1..500:
    friction(k): {type: joint, joint: link(k), value: -u.link(k)}
initial:
  q: {repeat k in 1..500: {link(k): 0.1*k}}
"""
    Path("long.yaml").write_text(text)
    assert main(["show", "long.yaml"]) == 0
    out = capsys.readouterr().out
    assert len(out) < 4000 and "link_1, link_3, link_5 and 247 more: revolute y" in out
    assert "and 490 forces more" in out and "link_10 = 1 and 490 more" in out
    assert main(["show", "-v", "long.yaml"]) == 0
    assert capsys.readouterr().out.count("\n") > 1000
    # every body breaks the triangle inequality: one warning a body
    assert main(["check", "long.yaml"]) == 0
    assert capsys.readouterr().out.count("\n") < 60
    Path("wrong.yaml").write_text(text.replace("mass: 1", "mass: -1"))
    assert main(["check", "wrong.yaml"]) == 1
    assert capsys.readouterr().err.count("\n") < 60


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


NOWHERE = {"": "working directory", ".": "working directory", "..": "working directory", "rod.yaml": "is a file",
           "rod.yaml/x/y": "is a file", "round": "cannot write", "x" * 300: "too long", "/dev/null": "is a file"}  # fmt: skip


@pytest.mark.parametrize("folder", NOWHERE)
def test_folders_that_cannot_be_are_told_before_the_work(here, capsys, monkeypatch, folder):
    import codegen.pipeline

    monkeypatch.setattr(codegen.pipeline, "write_solver", lambda *a, **k: pytest.fail("the work has begun"))
    Path("round").symlink_to("round")
    before = sorted(p.name for p in here.iterdir())
    assert generate_main(["rod.yaml", "-o", folder]) == 2
    err = capsys.readouterr().err
    assert err.startswith("generate: ") and NOWHERE[folder] in err and err.count("\n") == 1
    assert sorted(p.name for p in here.iterdir()) == before


@pytest.mark.parametrize("command", ["generate", "check", "show"])
def test_files_that_cannot_be_read(here, capsys, command):
    Path("folder").mkdir()
    Path("round.yaml").symlink_to("round.yaml")
    Path("binary.yaml").write_bytes(bytes(range(128, 256)))
    for name in ("folder", "round.yaml", "binary.yaml", "/dev/null", "nowhere/x.yaml"):
        code = main([command, name])
        out, err = capsys.readouterr()
        assert code == (2 if (command, name) == ("show", "folder") else 1) and not out
        assert name in err and err.count("\n") == 1


def test_a_model_from_a_pipe(here):
    run = subprocess.run(
        [sys.executable, "-m", "codegen", "generate", "/dev/stdin", "--target", "numpy", "--no-check"], cwd=here, input=MODEL,
        env={**os.environ, "PYTHONPATH": str(Path(codegen.__file__).parents[1])}, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert run.returncode == 0 and (here / "generated" / "rod" / "rod.c").exists(), run.stderr


ODD_COMPILERS = {
    "/bin/cat": 3,
    "/bin/true": 3,
    "/bin/false": 3,
    "": 0,
    " ": 0,
    "/tmp": 0,
    "'cc": 0,
    "no such": 0,
    "cc -fnope": 3,
}


@pytest.mark.parametrize("compiler", ODD_COMPILERS)
def test_odd_compilers(here, capsys, monkeypatch, compiler):
    """A failing one is an error that names the log; none is a remark, and NumPy serves."""
    monkeypatch.setenv("CC", compiler)
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0")
    assert generate_main(["rod.yaml", "--no-check"]) == ODD_COMPILERS[compiler]
    out, err = capsys.readouterr()
    if ODD_COMPILERS[compiler]:
        assert not out and err.startswith("generate: the C compiler failed") and "rod.log" in err
    else:
        assert not err and ("no C compiler" in out) == bool(compiler.strip())


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


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing_else(here, closed):
    def run(*arguments):
        command = f"exec {shlex.join([sys.executable, '-m', 'codegen', *arguments])} {closed}"
        env = {**os.environ, "PYTHONPATH": str(Path(codegen.__file__).parents[1])}
        return subprocess.run(command, shell=True, env=env, capture_output=True, text=True, check=False)

    for arguments, code in (
        (("check", "rod.yaml"), 0), (("generate", "rod.yaml"), 0), (("new", "rod.yaml"), 2), (("check", "no.yaml"), 1)
    ):  # fmt: skip
        done = run(*arguments)
        assert done.returncode == code
        assert not done.stderr if code == 0 or "2>" in closed else done.stderr.count("\n") == 1
        if ">&-" not in closed.split():
            assert bool(done.stdout) == (code == 0)
    assert (here / "generated" / "rod" / "model.json").is_file()


def test_output_needs_no_unicode_terminal(here):
    run = shell(
        "generate", "rod.yaml", "--no-compile", "-v", cwd=here, PYTHONIOENCODING="ascii", LC_ALL="C", COLUMNS="40"
    )
    assert run.returncode == 0 and "Traceback" not in run.stderr
    run = shell("show", "rod.yaml", cwd=here, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert run.returncode == 0 and "revolute" in run.stdout


def test_show_names_the_scalar_of_a_package(tmp_path, capsys):
    file = Path(__file__).parents[1] / "examples" / "pendulum.yaml"
    for scalar in ("float64", "float32"):
        folder = tmp_path / scalar
        assert (
            main(["generate", str(file), "--scalar", scalar, "--output", str(folder), "--no-check", "--no-compile"])
            == 0
        )
        capsys.readouterr()
        assert main(["show", str(folder)]) == 0
        assert f"scalar {scalar}, layout" in capsys.readouterr().out
