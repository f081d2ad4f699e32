"""``ordernm simulate``: arguments, table, files, pictures, Ctrl-C, exit codes; a substitute solver integrates with SciPy."""

import argparse
import contextlib
import io
import itertools
import os
import re
import signal
import time
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import codegen
from codegen import cached_solver, cli, generation, simulating, terminal
from codegen.cli import main
from codegen.runtime import AssemblyError, SingularLoopError, Solver
from codegen.runtime.standalone.trajectory.trajectory import FINISHED, INTERRUPTED, Trajectory
from codegen.terminal import StatusLine

MODEL = """\
model: swing
gravity: [0, 0, -9.81]
parameters:
  length: {value: 1.0, unit: m}
  damping: 0.05
inputs: [torque]
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}
forces:
  hinge: {type: joint, joint: rod, value: torque - damping*u.rod}
initial:
  q: {rod: 0.5}
outputs:
  height: {position: {body: rod, at: [0, 0, -length]}, axis: z}
  energy: kinetic_energy
"""


REAL = Solver.simulate


class StandIn:
    """A substitute for `Solver.simulate` with the same signature, which tests can interrupt."""

    def __init__(self):
        self.calls = []
        self.at_half = None
        """Called once half of the time is reached."""

    def __call__(
        self, solver, t, q=None, u=None, p=None, inputs=None, *, sensitivities=(), rtol=1e-9, atol=1e-9, method="dop853",
        progress=None, on_failure="raise",
    ):  # fmt: skip
        self.calls.append({"t": t, "p": p, "inputs": inputs, "rtol": rtol, "atol": atol, "method": method})
        q, u = solver.assemble(q, u, p)
        for name in sensitivities:
            if name not in solver.parameter_names:
                raise ValueError(f"sensitivities: {name!r} is not known; expected one of {solver.parameter_names}")
        dp = np.array([[float(n == name) for n in solver.parameter_names] for name in sensitivities])
        k, nq, nu = len(sensitivities), solver.nq, solver.nu
        sizes = np.cumsum([nq, nu, k * nq])

        def rates(time_, y):
            q, u, dq, du = np.split(y, sizes)
            if not k:
                return np.concatenate([solver.coordinate_rates(q, u, p), solver.accelerations(q, u, p, inputs, time_)])
            seeds = {"dq": dq.reshape(k, nq), "du": du.reshape(k, nu), "dp": dp}
            qdot, dqdot = solver.coordinate_rate_sensitivities(q, u, p, **seeds)
            udot, dudot = solver.sensitivities(q, u, p, inputs, time_, **seeds)
            return np.concatenate([qdot, udot, dqdot.ravel(), dudot.ravel()])

        rows, reason = [np.concatenate([q, u, np.zeros(k * (nq + nu))])], FINISHED
        try:
            for a, b in itertools.pairwise(t):
                rows.append(solve_ivp(rates, (a, b), rows[-1], method="DOP853", rtol=rtol, atol=atol).y[:, -1])
                if progress is not None:
                    progress(b, t[-1])
                if self.at_half is not None and b >= t[-1] / 2:
                    self.at_half()
        except KeyboardInterrupt:
            reason = INTERRUPTED
        except StopIteration as stop:
            reason = str(stop)
        y = np.array(rows)
        nt = len(y)
        q, u, dq, du = np.split(y, sizes, axis=1)
        dq, du = (x.reshape(nt, k, n).transpose(1, 0, 2) for x, n in ((dq, nq), (du, nu)))
        outputs, doutputs = solver.outputs(q, u, p, inputs), None
        if k:
            outputs, doutputs = solver.output_sensitivities(q, u, p, inputs, dq=dq, du=du, dp=dp[:, None])
        return Trajectory(
            solver.name, t[:nt], q, u, dq, du, outputs, doutputs, coordinate_names=solver.coordinate_names,
            speed_names=solver.speed_names, output_names=solver.output_names, parameter_names=solver.parameter_names,
            input_names=solver.input_names, sensitivity_names=sensitivities,
            **{f"{kind}_units": solver._manifest[f"{kind}_units"] for kind in ("coordinate", "speed", "output", "parameter")},
            stats={"method": method, "steps": nt - 1, "evaluations": 12 * nt, "seconds": 0.01, "reason": reason,
                   "t": t[nt - 1] if nt else 0.0},
        )  # fmt: skip


@pytest.fixture
def stand_in(monkeypatch):
    found = StandIn()
    monkeypatch.setattr(Solver, "simulate", lambda solver, *a, **k: found(solver, *a, **k), raising=False)
    return found


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One cache for the module: the model is generated once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def here(tmp_path, monkeypatch, cache, stand_in):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    Path("swing.yaml").write_text(MODEL)
    return tmp_path


def run(*arguments: object) -> int:
    return main(["simulate", *map(str, arguments)])


def one_line(capsys) -> str:
    """The only line on stderr; a line that refers to docs/errors.md may follow."""
    out, err = capsys.readouterr()
    err = re.sub(r"^See docs/errors\.md#[a-z-]+\n\Z", "", err, flags=re.MULTILINE)
    assert not out and err.count("\n") == 1 and err.startswith("simulate: ") and "Traceback" not in err
    return err


# ---- what it does ----------------------------------------------------------------------------------------------------


def test_a_motion_with_its_table_file_and_picture(here, capsys):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    assert run("swing.yaml", "-t", 2, "--sensitivities", "length,damping", "-o", "run.npz", "--plot", "out.svg") == 0
    out, err = capsys.readouterr()
    assert not err
    lines = out.splitlines()
    assert lines[0] == "Trajectory of swing: 201 times from 0 to 2 s"
    assert any("dop853: 200 steps" in line and "finished" in line for line in lines)
    header = next(line for line in lines if "at t = 2 s" in line)
    assert header.split() == "at t = 2 s value unit d / d length d / d damping".split()
    found = codegen.load_trajectory("run.npz")
    assert found.sensitivity_names == ("length", "damping") and found["height"][0] == pytest.approx(-np.cos(0.5))
    height = next(line for line in lines if line.strip().startswith("height")).split()
    expected = [found["height"][-1], *(found.derivative("height", by)[-1] for by in found.sensitivity_names)]
    assert height[2] == "m"
    np.testing.assert_allclose([float(x) for x in (height[1], *height[3:])], expected, rtol=1e-7)
    assert Path("out.svg").read_bytes().startswith(b"<?xml") and lines[-1] == "  written: run.npz, out.svg"
    assert sorted(os.listdir()) == ["out.svg", "run.npz", "swing.yaml"]  # nothing is generated here


def test_units_are_shown_where_they_are_known():
    run_ = simulating.Run(Trajectory("m", [0.0, 1.0], [[1.0], [2.0]], [[0.0], [0.0]], coordinate_names=["a"], speed_names=["a"],
                                     coordinate_units=["rad"]), 1.0)  # fmt: skip
    lines = simulating.lines_of(run_, None)
    assert [line.split() for line in lines[-3:]] == ["at t = 1 s value unit".split(), ["q.a", "2", "rad"], ["u.a", "0"]]


def test_large_tables_are_cut():
    n, k = 40, 9
    x = Trajectory("m", [0.0], np.zeros((1, n)), np.zeros((1, n)), np.zeros((k, 1, n)), np.zeros((k, 1, n)),
                   coordinate_names=[f"a{i}" for i in range(n)], speed_names=[f"a{i}" for i in range(n)],
                   sensitivity_names=[f"p{i}" for i in range(k)])  # fmt: skip
    lines = simulating.lines_of(simulating.Run(x, 0.0), None)
    assert "  and 56 more" in lines and "  and derivatives with respect to 3 more" in lines and len(lines) < 40


def test_what_is_asked_for_arrives(here, stand_in, capsys):
    assert run("swing.yaml", "--at", "0.1,0.5", "-p", "length=1.5", "-p", "damping=0", "--inputs", "torque=-0.2",
               "--rtol", "1e-6", "--atol", "1e-7", "--method", "radau") == 0  # fmt: skip
    assert stand_in.calls == [
        {"t": [0.0, 0.1, 0.5], "p": {"length": 1.5, "damping": 0.0}, "inputs": {"torque": -0.2}, "rtol": 1e-6, "atol": 1e-7,
         "method": "radau"}
    ]  # fmt: skip
    assert run("swing.yaml", "-t", 1, "--samples", 5) == 0
    assert stand_in.calls[1]["t"] == [0.0, 0.25, 0.5, 0.75, 1.0] and stand_in.calls[1]["p"] is None
    assert run("swing.yaml", "-t", 1, "--at", "0,0.2", "-p", "length=2,damping=1") == 0
    assert stand_in.calls[2]["t"] == [0.0, 0.2, 1.0] and stand_in.calls[2]["p"] == {"length": 2.0, "damping": 1.0}


def test_the_last_time_is_the_one_asked_for():
    for end in (0.3, 1.1, 7.7, 10.0, 1e-3, 123.456):
        options = argparse.Namespace(time=end, at=None, samples=None)
        assert simulating.times_of(options)[-1] == end


# ---- models and packages ---------------------------------------------------------------------------------------------


def test_a_model_is_generated_once(here, monkeypatch, capsys):
    assert run("swing.yaml", "-t", 0.1) == 0
    monkeypatch.setattr(generation, "generate", lambda *a, **k: pytest.fail("it is there"))
    assert run("swing.yaml", "-t", 0.1) == 0
    monkeypatch.undo()


def test_a_changed_model_is_another_one_and_a_damaged_package_is_replaced(here, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    place = tmp_path / "own" / "ordernm" / "simulated"
    assert run("swing.yaml", "-t", 0.1) == 0
    (first,) = place.iterdir()
    (first / "swing.c").write_text("nonsense")
    assert run("swing.yaml", "-t", 0.1) == 0 and "nonsense" not in (first / "swing.c").read_text()
    Path("swing.yaml").write_text(MODEL.replace("0.5", "0.6"))
    monkeypatch.setattr(cached_solver, "KEPT", 1)
    assert run("swing.yaml", "-t", 0.1) == 0
    (second,) = place.iterdir()  # what was used least lately is forgotten
    assert second != first


def test_a_generated_package(here, capsys):
    assert main(["generate", "swing.yaml", "-o", "package", "--no-check", "--target", "numpy"]) == 0
    capsys.readouterr()
    assert run("package", "-t", 0.2) == 0
    assert "Trajectory of swing" in capsys.readouterr().out
    Path("empty").mkdir()
    assert run("empty", "-t", 1) == 2
    assert "no complete generated solver" in one_line(capsys)


def test_without_a_cache_a_temporary_folder_serves(here, monkeypatch, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    assert run("swing.yaml", "-t", 0.1) == 0
    assert sorted(os.listdir()) == ["file", "swing.yaml"]


def test_a_package_without_simulate(here, monkeypatch, capsys):
    monkeypatch.setattr(Solver, "simulate", REAL)
    codegen.generate("swing.yaml", "swing", functions="accelerations")
    assert run("swing", "-t", 1) == 2
    assert "generated without state_rates" in one_line(capsys)


def test_the_real_one(here, monkeypatch, capsys):
    monkeypatch.setattr(Solver, "simulate", REAL)
    assert run("swing.yaml", "-t", 2, "--sensitivities", "length", "-o", "run.npz") == 0
    out, _ = capsys.readouterr()
    assert "ended: finished" in out
    kept = Trajectory.load("run.npz")
    assert kept.t[-1] == 2 and np.isfinite(kept.derivative("height", "length")).all()


SLIDER = """\
model: dead_points
constants: {L: 0.3}
bodies:
  crank:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: rod, axis: x, length: L, mass: 1.0, center: [L/2, 0, 0]}
  rod:
    parent: crank
    joint: {type: revolute, axis: y, at: [L, 0, 0]}
    shape: {type: rod, axis: x, length: 2*L, mass: 1.0, center: [L, 0, 0]}
  slider:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: 0.5
    inertia: {xx: 1e-3, yy: 1e-3, zz: 1e-3}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: rod, at: [2*L, 0, 0]}, to: slider}
initial: {q: {crank: 0.6, rod: -0.9, slider: 0.8}, u: {slider: 2.0}}
independent: [slider]
outputs: {kinetic: kinetic_energy}
"""
"""The slider stands still at each end of its way: as independent coordinate it says nothing there."""


def test_a_dead_point_makes_a_second_choice_of_independents(tmp_path, monkeypatch, capsys):
    """The energy is that of the beginning after several turns of the crank."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    model = tmp_path / "dead_points.yaml"
    model.write_text(SLIDER, encoding="utf-8")
    assert run(model, "-t", "3", "--samples", "31", "-o", tmp_path / "run.npz") == 0
    said = capsys.readouterr()
    assert "as at a dead point: generated a solver with 2 choices of independent coordinates" in said.err
    assert "poorly determined there" not in said.err
    found = Trajectory.load(tmp_path / "run.npz")
    assert np.ptp(found["q.crank"]) > 4 * np.pi
    assert np.ptp(found["kinetic"]) < 1e-6 * found["kinetic"][0]


def test_remarks_of_models_and_python_are_warnings(here, capsys, stand_in):
    Path("swing.yaml").write_text(MODEL.replace("inputs:", "  unused: 2\ninputs:"))
    stand_in.at_half = lambda: warnings.warn("a remark", RuntimeWarning, stacklevel=1)
    assert run("swing.yaml", "-t", 0.1) == 0
    out, err = capsys.readouterr()
    assert "warning: parameters.unused" in err and err.count("warning: a remark") == 1 and "Trajectory" in out


# ---- what is wrong ---------------------------------------------------------------------------------------------------

WRONG = {
    "": "the end of the motion is missing; give -t SECONDS, or times by --at",
    "-t 0": "-t is 0; expected a positive number",
    "-t -1": "-t is -1",
    "-t nan": "-t is nan",
    "-t inf": "-t is inf",
    "-t 1 --samples 1": "--samples is 1; at least 2 are needed",
    "--samples 5": "the end of the motion is missing",
    "--at 0,x": "--at: 'x' is not a number; expected a list such as --at 0,0.1,0.5",
    "--at 0,1,": "--at: '' is not a number",
    "--at 0,1,1": "--at: 1 follows 1; times must increase",
    "--at 0": "--at 0 is only the initial state",
    "--at nan": "--at: nan is not a valid time",
    "-t 1 --at 0,2": "--at: 2 is after the end, -t 1",
    "-t 1 --samples 100000000000": "--samples is 100000000000; at most 10000000 are allowed",
    "-t 1 --sensitivities ,": "--sensitivities ,: expected names of parameters",
    "-t 1 --rtol 0": "--rtol is 0; expected a positive number",
    "-t 1 --atol nan": "--atol is nan",
    "-t 1 -p length": "-p length: expected NAME=VALUE with a finite number",
    "-t 1 -p length=": "-p length=: expected NAME=VALUE",
    "-t 1 -p length=80mm": "-p length=80mm: expected NAME=VALUE with a finite number in SI units (80 mm is 0.08)",
    "-t 1 -p length=long": "-p length=long: expected NAME=VALUE",
    "-t 1 -p =2": "-p =2: expected NAME=VALUE",
    "-t 1 -p length=inf": "-p length=inf: expected NAME=VALUE with a finite number",
    "-t 1 --inputs torque": "--inputs torque: expected NAME=VALUE",
    "-t 1 -p length=0,6": "such as -p length=1.2; a decimal point is written ., as in 0.6",
    "-t 1 --inputs torque=0,6": "such as --inputs length=1.2; a decimal point is written ., as in 0.6",
    "-t 1 --inputs semicolons.csv": "t;torque: names and values are separated by commas, not by semicolons; a decimal point",
    "-t 1 --inputs commas.csv": "commas.csv:2: 4 values, expected 2: t, torque; a decimal point is written ., as in 0.6",
    "-t 1 -p length=1 -p length=2": "length is given twice, as 1 and 2",
    "-t 1 -p lenght=1": "did you mean 'length'",
    "-t 1 --inputs torqe=1": "did you mean 'torque'",
    "-t 1 --sensitivities lenght": "'lenght' is not known",
    "-t 1 -o run.csv": "run.csv ends in .csv; trajectories are kept in files .npz or .parquet",
    "-t 1 -o run": "run has no suffix",
    "-t 1 --plot out.jpg": "out.jpg ends in .jpg; pictures are written as .svg, .png, .pdf",
    "-t 1 -o no/run.npz": "cannot write no/run.npz: there is no folder",
    "-t 1 -o folder.npz": "folder.npz is a folder",
}


@pytest.mark.parametrize("arguments", WRONG)
def test_wrong_requests_are_one_line_and_exit_code_2(here, capsys, arguments):
    Path("folder.npz").mkdir()
    Path("semicolons.csv").write_text("t;torque\n0,0;1,5\n1,0;2,5\n")
    Path("commas.csv").write_text("t,torque\n0,0,1,5\n1,0,2,5\n")
    before = sorted(os.listdir())
    assert run("swing.yaml", *arguments.split()) == 2
    assert WRONG[arguments] in one_line(capsys)
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize(
    "arguments", ["", "swing.yaml -t x", "swing.yaml -t 1 --method euler", "swing.yaml -t 1 --at 1 --samples 3"]
)
def test_wrong_usage(here, capsys, arguments):
    with pytest.raises(SystemExit) as end:
        run(*arguments.split())
    assert end.value.code == 2 and "usage: ordernm simulate" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("simulate", "-t"),
        ("simulate", "--rtol"),
        ("simulate", "--step"),
        ("view", "-t"),
        ("report", "-t"),
        ("export", "--stop"),
    ],
)
def test_numbers_that_are_none_say_how_numbers_are_written(command, option, capsys):
    for text, hint in (
        ("0,6", "a decimal point is written ., as in 0.6"),
        ("1s", "give a number without a unit, such as 0.6"),
    ):
        with pytest.raises(SystemExit):
            cli.main([command, "swing.yaml", option, text])
        assert capsys.readouterr().err.endswith(f": {text!r} is not a number; {hint}\n")


def test_files_are_looked_at_before_the_work(here, capsys, monkeypatch):
    monkeypatch.setattr("codegen.model.load_model", lambda *a: pytest.fail("the work has begun"))
    for arguments in ("-o run.csv", "--plot out.jpg", "-o no/run.npz"):
        assert run("swing.yaml", "-t", 1, *arguments.split()) == 2
        one_line(capsys)


def test_an_extra_that_is_missing_is_told_before_the_work(here, capsys, monkeypatch):
    def missing():
        raise ImportError('plots need matplotlib: pip install "ordernm[plot]", or pip install matplotlib')

    monkeypatch.setattr("codegen.runtime.standalone.trajectory.plot.need", missing)
    assert run("swing.yaml", "-t", 1, "--plot", "out.svg") == 2
    assert "pip install" in one_line(capsys)


def test_a_wrong_model_is_exit_code_1(here, capsys):
    Path("wrong.yaml").write_text(MODEL.replace("revolute", "revolving"))
    for name in ("wrong.yaml", "nowhere.yaml"):
        assert run(name, "-t", 1) == 1
        out, err = capsys.readouterr()
        assert not out and err.startswith(name) and err.count("\n") == 1


def test_a_failing_compiler_is_exit_code_3(here, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    monkeypatch.setenv("ORDERNM_CFLAGS", "-fno-such-flag")
    assert run("swing.yaml", "-t", 1) == 3
    out, err = capsys.readouterr()
    assert not out and "no-such-flag" in err and "Traceback" not in err


@pytest.mark.parametrize(
    "error",
    [
        SingularLoopError("pin"),
        AssemblyError("pin", 0.1),
        RuntimeError("steps are too small at t = 0.3"),
        OverflowError("x"),
    ],
)
def test_a_motion_that_cannot_be_computed_is_exit_code_4(here, capsys, stand_in, error):
    def fail():
        raise error

    stand_in.at_half = fail
    assert run("swing.yaml", "-t", 1) == 4
    assert str(error) in one_line(capsys)


def test_a_motion_that_ends_early_is_exit_code_4_and_kept(here, capsys, stand_in):
    def stop():
        raise StopIteration("the steps become too small")

    stand_in.at_half = stop
    assert run("swing.yaml", "-t", 1, "--samples", 11, "-o", "run.npz") == 4
    out, err = capsys.readouterr()
    ended, see = err.splitlines()
    assert ended == "simulate: ended at t = 0.5 of 1 s: the steps become too small; until then: run.npz"
    assert see == "See docs/errors.md#a-motion-cannot-continue"
    assert "6 times from 0 to 0.5 s" in out and len(codegen.load_trajectory("run.npz")) == 6


def test_a_file_that_cannot_be_written_costs_neither_the_table_nor_the_picture(here, capsys, monkeypatch):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")

    def full(*arguments):
        raise OSError(28, "No space left on device", "run.npz")

    monkeypatch.setattr(Trajectory, "save", full)
    assert run("swing.yaml", "-t", 0.1, "-o", "run.npz", "--plot", "out.png") == 2
    out, err = capsys.readouterr()
    assert err == "simulate: run.npz: No space left on device\n" and "height" in out and Path("out.png").is_file()


def test_a_picture_that_cannot_be_drawn_costs_no_table(here, capsys, monkeypatch):
    def refuse(*arguments, **more):
        raise ValueError("there is nothing to plot")

    monkeypatch.setattr(Trajectory, "plot", refuse)
    assert run("swing.yaml", "-t", 0.1, "--plot", "out.svg", "-o", "run.npz") == 2
    out, err = capsys.readouterr()
    assert err == "simulate: there is nothing to plot\n" and "height" in out and Path("run.npz").is_file()


# ---- Ctrl-C ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "words", "code"),
    [(signal.SIGINT, "interrupted", 130), (signal.SIGTERM, "ended by SIGTERM", 143)],
)
def test_ctrl_c_leaves_what_was_computed(here, capsys, stand_in, number, words, code):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")

    def interrupt():
        signal.raise_signal(number)
        time.sleep(1)

    stand_in.at_half = interrupt
    assert run("swing.yaml", "-t", 1, "--samples", 11, "-o", "run.npz", "--plot", "out.svg") == code
    out, err = capsys.readouterr()
    assert err == f"simulate: {words} at t = 0.5 of 1 s; until then: run.npz, out.svg\n"
    assert "ended: interrupted" in out and "at t = 0.5 s" in out
    found = codegen.load_trajectory("run.npz")
    assert found.ended == INTERRUPTED and found.t[-1] == 0.5 and len(found) == 6 and Path("out.svg").is_file()


def test_ctrl_c_before_the_motion_leaves_nothing(here, capsys, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("codegen.model.load_model", interrupt)
    assert run("swing.yaml", "-t", 1, "-o", "run.npz") == 130
    assert one_line(capsys) == "simulate: interrupted while reading\n" and sorted(os.listdir()) == ["swing.yaml"]


# ---- progress --------------------------------------------------------------------------------------------------------


def test_progress_is_a_bar_on_terminals(here, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for name in ("CI", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(terminal, "PATIENCE", 0.0)
    stream = Terminal()
    with StatusLine(stream) as status:
        end = time.monotonic() + 10
        status.share("simulating, t = 5 of 10 s", 0.5)
        while "simulating" not in stream.getvalue() and time.monotonic() < end:
            time.sleep(0.05)
        assert status.where == "simulating, t = 5 of 10 s"
    assert re.search(r"simulating, t = 5 of 10 s \[#{12}-{12}\] 50% \(\d+ s\)", stream.getvalue())
    status("writing", 0, 0)
    assert "%" not in str(status._line())
    with contextlib.suppress(ValueError):
        stream.close()


def test_progress_is_told_to_the_status_line(here, monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(StatusLine, "share", lambda self, stage, share: seen.append((stage, share)))
    assert run("swing.yaml", "-t", 1, "--samples", 3) == 0
    assert seen == [("simulating, t = 0.5 of 1 s", 0.5), ("simulating, t = 1 of 1 s", 1.0)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_files_are_written_costs_none_of_them(here, capsys, monkeypatch, number):
    """Nor does a second one behind the first, as ``timeout`` sends it."""
    save = Trajectory.save

    def slowly(trajectory, path):
        signal.raise_signal(number)
        signal.raise_signal(number)
        save(trajectory, path)

    monkeypatch.setattr(Trajectory, "save", slowly)
    assert run("swing.yaml", "-t", 0.1, "-o", "run.npz") == 128 + number
    assert len(Trajectory.load("run.npz")) == simulating.SAMPLES
    assert "until then: run.npz" in capsys.readouterr().err


def test_an_edited_include_is_another_model(here, capsys):
    """Nothing of the main file has changed; the numbers are those of what it includes now."""
    Path("part.yaml").write_text("constants: {pull: 2.0}\n")
    Path("whole.yaml").write_text(MODEL.replace("model: swing\n", "model: swing\ninclude: [part.yaml]\n").replace(
        "[0, 0, -9.81]", "[0, 0, -pull]"))  # fmt: skip
    heights = []
    for pull in (2.0, 9.0, 2.0):
        Path("part.yaml").write_text(f"constants: {{pull: {pull}}}\n")
        assert run("whole.yaml", "-t", 1, "-o", "run.npz") == 0
        heights.append(Trajectory.load("run.npz")["height"][-1])
    assert heights[0] == heights[2] != heights[1]


def test_choices_of_independents_are_part_of_the_key(here, capsys):
    model = codegen.load_model("swing.yaml")
    assert (
        len({cached_solver._cached(model, n, *more) for n in (1, 2, 4) for more in product((False, True), repeat=2)})
        == 12
    )


def test_the_generator_and_what_it_needs_are_part_of_the_key(here, monkeypatch, tmp_path):
    before = cached_solver._generator()
    monkeypatch.setattr("importlib.metadata.version", lambda name: "another")
    other = cached_solver._generator()
    monkeypatch.setattr("codegen.cached_solver.SOURCES", (".py", ".jinja"))  # without the integrators' C
    assert len({before, other, cached_solver._generator()}) == 3


def test_a_pipe_without_a_cache(here, monkeypatch, capsys, tmp_path):
    """What is printed is made while the package is there."""
    monkeypatch.setattr(Solver, "simulate", REAL)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    reading, writing = os.pipe()
    os.write(writing, MODEL.encode())
    os.close(writing)
    assert run(f"/dev/fd/{reading}", "-t", 0.1, "--sensitivities", "length") == 0
    os.close(reading)
    out, err = capsys.readouterr()
    assert "height" in out and "the solver is not kept for the next run" in err


def test_the_cache_is_made_for_the_user_alone(here, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "private"))
    mask = os.umask(0)
    try:
        assert run("swing.yaml", "-t", 0.1) == 0
        assert run("swing.yaml", "-t", 0.1) == 0  # and it is used
    finally:
        os.umask(mask)
    assert capsys.readouterr().err == ""
    found = list((tmp_path / "private").rglob("*"))
    assert any(p.suffix == ".so" for p in found)
    assert all(p.stat().st_mode & 0o077 == 0 for p in found if p.is_dir())
    assert all(p.stat().st_mode & 0o022 == 0 for p in found)


@pytest.mark.parametrize("open_to_others", ["", "simulated", "simulated/*", "simulated/*/swing.c", "simulated/*/*.so"])
def test_a_cache_that_others_can_write_to_is_not_used(here, monkeypatch, tmp_path, capsys, open_to_others):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "shared"))
    assert run("swing.yaml", "-t", 0.1) == 0
    capsys.readouterr()
    place = tmp_path / "shared" / "ordernm"
    (mine, *_) = place.glob(open_to_others) if open_to_others else [place]
    mine.chmod(mine.stat().st_mode | 0o022)
    library = next(place.glob("simulated/*/*.so"))
    made = library.stat().st_mtime_ns
    assert run("swing.yaml", "-t", 0.1) == 0
    err = capsys.readouterr().err
    assert "the cache is not used" in err or library.stat().st_mtime_ns != made
    if open_to_others in ("", "simulated"):
        assert f"{mine} can be written to by other users (mode" in err and f"remove {place}" in err
