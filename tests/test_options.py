"""Every option of every command has an effect, or is refused with a message: none is silently ignored."""

import argparse
import contextlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from codegen import cli, simulating
from codegen.runtime.standalone.trajectory.trajectory import FINISHED, Trajectory

MODEL = """\
model: swing
gravity: [0, 0, -9.81]
parameters: {length: 1.0}
inputs: [torque]
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}
forces: {motor: {type: joint, joint: rod, value: torque}}
"""

WITHOUT = "without"
"""Given for an option that a command needs: the command without it."""

MADE = {
    ("generate", "--output"): "-o here",
    ("generate", "--target"): "--target numpy",
    ("generate", "--layout"): "--layout kinds",
    ("generate", "--scalar"): "--scalar float32",
    ("generate", "--partitions"): "--partitions 2",
    ("generate", "--reactions"): "--reactions",
    ("generate", "--frames"): "--frames",
    ("generate", "--functions"): "--functions mass",
    ("generate", "--no-check"): "--no-check",
    ("generate", "--no-compile"): "--no-compile",
    ("generate", "--compile-all"): "--compile-all",
    ("generate", "--verbose"): "-v",
    ("generate", "--force"): "--force",
    ("simulate", "--time"): "-t 2",
    ("simulate", "--samples"): "--samples 5",
    ("simulate", "--at"): "--at 0.5",
    ("simulate", "--sensitivities"): "--sensitivities length",
    ("simulate", "--parameter"): "-p length=2",
    ("simulate", "--inputs"): "--inputs torque=1",
    ("simulate", "--between"): "--between hold",
    ("simulate", "--method"): "--method radau",
    ("simulate", "--step"): "--step 0.1",
    ("simulate", "--rtol"): "--rtol 1e-5",
    ("simulate", "--atol"): "--atol 1e-5",
    ("simulate", "--output"): "-o run.npz",
    ("simulate", "--plot"): "--plot run.svg",
    ("simulate", "--force"): "--force",
    ("view", "--time"): "-t 2",
    ("view", "--trajectory"): "--trajectory run.npz",
    ("view", "--parameter"): "-p length=2",
    ("view", "--reactions"): "--reactions",
    ("view", "--forces"): "--forces",
    ("view", "--html"): "--html page.html",
    ("view", "--picture"): "--picture pose.png",
    ("view", "--animate"): "-t 1 --animate run.gif",
    ("view", "--port"): "--port 8123",
    ("view", "--no-browser"): "--no-browser",
    ("view", "--force"): "--force",
    ("import", "--output"): "-o -",
    ("import", "--force"): "-o - --force",
    ("import", "--name"): "--name other",
    ("import", "--model"): "--model other",
    ("import", "--key"): "--key home",
    ("import", "--base"): "--base free",
    ("import", "--keep-fixed"): "--keep-fixed",
    ("import", "--loops"): "--loops side.yaml",
    ("import", "--motors"): "--motors",
    ("import", "--exact-angles"): "--exact-angles",
    ("import", "--parameterize"): "--parameterize arm:mass",
    ("import", "--repair"): "--repair",
    ("import", "--free-mimic"): "--free-mimic",
    ("import", "--package-path"): "--package-path nowhere",
    ("report", "--output"): "-o elsewhere",
    ("report", "--time"): "-t 3",
    ("report", "--compare"): "--compare nowhere",
    ("report", "--force"): "--force",
    ("bench", "--list"): "--list",
    ("bench", "--quick"): "--quick",
    ("bench", "--peers"): "--peers",
    ("bench", "--output"): "-o out.json",
    ("bench", "--compare"): "--compare nowhere.json",
    ("bench", "--results"): "--results nowhere.json",
    ("bench", "--plots"): "--plots pictures",
    ("bench", "--page"): "--page page.md",
    ("bench", "--force"): "--force",
    ("show", "--verbose"): "-v",
    ("new", "--force"): "--force",
    ("new", "--from"): "--force --from arm",
    ("new", "--list"): "--list",
    ("equations", "--latex"): "--latex",
    ("equations", "--mathml"): "--mathml",
    ("equations", "--sympy"): "--sympy",
    ("equations", "--html"): "--html",
    ("equations", "--form"): "--form embedded",
    ("equations", "--values"): "--values",
    ("equations", "--set"): "--set length=2",
    ("equations", "--simplify"): "--simplify",
    ("equations", "--output"): "-o equations.md",
    ("equations", "--intermediates"): "--intermediates",
    ("equations", "--force-size"): "--force-size",
    ("equations", "--force-file"): "-o there.yaml --force-file",
    ("equations", "--force"): "-o there.yaml --force",
    ("export", "--c"): WITHOUT,
    ("export", "--casadi"): "--casadi",
    ("export", "--fmu"): "--fmu",
    ("export", "--fmi"): "--fmi 2.0",
    ("export", "--platforms"): "--platforms none",
    ("export", "--method"): "--method radau",
    ("export", "--energies"): "--energies",
    ("export", "--stop"): "--stop 2",
    ("export", "--output"): "-o elsewhere",
    ("export", "--scalar"): "--scalar float32",
    ("export", "--functions"): "--functions mass",
    ("export", "--force"): "--force",
    ("statements", "--latex"): "--latex",
    ("statements", "--html"): "--html",
    ("statements", "--functions"): "--functions outputs",
    ("statements", "--reactions"): "--reactions",
    ("statements", "--frames"): "--frames",
    ("statements", "--output"): "-o statements.md",
    ("statements", "--force"): "-o there.yaml --force",
}
"""What is given for each option."""

BASES = {
    "generate": "generate swing.yaml", "simulate": "simulate swing.yaml -t 1", "import": "import robot.urdf",
    "report": "report swing.yaml", "bench": "bench pendulum", "show": "show large.yaml", "new": "new there.yaml",
    "doctor": "doctor", "completion": "completion bash",
    "check": "check swing.yaml", "view": "view swing.yaml",
    "equations": "equations swing.yaml", "statements": "statements swing.yaml", "export": "export swing.yaml --c",
}  # fmt: skip


def commands():
    (found,) = [a for a in cli.parser_of_commands()._actions if isinstance(a, argparse._SubParsersAction)]
    return found.choices


def options():
    return {
        (name, action.option_strings[-1])
        for name, parser in commands().items()
        for action in parser._actions
        if action.option_strings and not isinstance(action, argparse._HelpAction)
    }


def test_every_option_is_in_this_file():
    assert options() == MADE.keys() and commands().keys() == BASES.keys()


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """Replaces the work of commands by a record of their calls, so that nothing is generated, simulated or measured."""
    calls = []

    def keep(name, result=None):
        def kept(*given, **named):
            calls.append(f"{name} {given} {sorted(named.items(), key=str)}")
            return result

        return kept

    monkeypatch.chdir(tmp_path)
    Path("swing.yaml").write_text(MODEL)
    Path("robot.urdf").write_text("<robot name='r'/>")
    Path("there.yaml").write_text("mine")
    bodies = "\n".join(
        f"  b{i}: {{parent: ground, joint: fixed, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}" for i in range(99)
    )
    Path("large.yaml").write_text(f"model: large\nbodies:\n{bodies.replace('fixed', '{type: revolute, axis: z}')}\n")
    report = SimpleNamespace(
        errors={},
        disagreeing={},
        remarks=[],
        name="swing",
        folder="x",
        lines=lambda *a: calls.append(f"lines {a}") or [],
    )
    monkeypatch.setattr("codegen.generation.generate", keep("generate", report))
    still = Trajectory("still", [0.0, 1.0], np.zeros((2, 1)), np.zeros((2, 1)), coordinate_names=("rod",), speed_names=("rod",),
                       stats={"reason": FINISHED, "t": 1.0})  # fmt: skip
    solver = SimpleNamespace(simulate=keep("simulate", still), partitions=[1], input_names=("torque",), ninputs=1)
    monkeypatch.setattr(simulating, "solver_of", lambda *a, **k: contextlib.nullcontext(solver))
    view = SimpleNamespace(url="somewhere", html=keep("page of a state"), wait=keep("wait"), close=keep("close"))
    shown = SimpleNamespace(
        view=keep("view", view), picture=keep("picture"), simulate=keep("simulate", still), initial=(0, 0),
        parameter_names=("length",), assemble=keep("assemble", (0, 0)),
    )  # fmt: skip
    monkeypatch.setattr("codegen.viewing.solver_of", lambda *_, **k: keep("solver", contextlib.nullcontext(shown))(**k))
    monkeypatch.setattr("codegen.viewing.webbrowser.open", keep("browser"))
    monkeypatch.setattr("codegen.runtime.standalone.display.viewer.need", keep("viser"))
    monkeypatch.setattr(Trajectory, "load", classmethod(keep("load", still)))
    for name in ("view", "html", "animate"):
        monkeypatch.setattr(Trajectory, name, keep(f"{name} of a motion", view))
    for name in ("save", "plot"):
        monkeypatch.setattr(Trajectory, name, lambda _, *a, name=name, **k: calls.append(f"{name} {a} {k}"))
    imported = SimpleNamespace(
        warnings=(),
        left_out=(),
        differences=(),
        text="",
        model=SimpleNamespace(name="m", bodies=(), nu=0),
        save=lambda p: p,
    )
    monkeypatch.setattr("codegen.importing.command.import_model", keep("import", imported))
    exported = SimpleNamespace(folder="x", files=(), workspace=0, compiler="cc", functions=())
    monkeypatch.setattr("codegen.exporting.plain_c.export_c", keep("export", exported))
    monkeypatch.setattr("codegen.reporting.report", keep("report", {"skipped": []}))
    monkeypatch.setattr("codegen.bench.command.run", lambda p, quick, peers, *_: keep("bench", results)(quick, peers))
    results = {"machine": {}, "problems": {}, "quick": True, "format": 1}
    monkeypatch.setattr("codegen.bench.lines.machine_line", lambda machine: "")
    monkeypatch.setattr("codegen.bench.page.page_of", keep("page", ""))
    return calls


@pytest.mark.parametrize(("command", "option"), sorted(MADE), ids=map(" ".join, sorted(MADE)))
def test_every_option_changes_something_or_is_refused(recorded, capsys, monkeypatch, command, option):
    if option == "--force-size":  # of a model that is small otherwise
        monkeypatch.setattr("codegen.symbolic.motion.MOST_TERMS", 1)
    seen = []
    without = BASES[command].replace(f" {option}", "")
    more = MADE[command, option]
    for line in (BASES[command], without if more == WITHOUT else f"{BASES[command]} {more}"):
        code = cli.main(line.split())
        out, err = capsys.readouterr()
        assert "Traceback" not in err and (code == 0 or err.strip())
        files = sorted(str(p) for p in Path().rglob("*") if p.is_file() and p.suffix in (".json", ".md", ".yaml"))
        seen.append((code, out + err, f"{recorded} {files}"))
        recorded.clear()
        for name in ("out.json", "page.md"):
            Path(name).unlink(missing_ok=True)
    assert seen[0] != seen[1], "it was ignored"


@pytest.mark.parametrize("command", sorted(set(BASES) - {"bench", "doctor", "completion"}))
def test_an_empty_name_is_refused(recorded, capsys, command):
    """A shell gives one for a variable that is not set; it is not the working directory."""
    assert cli.main([command, ""]) == 2
    assert capsys.readouterr().err == f"{command}: the name of the model is empty; give a file\n"


TOGETHER = {
    "simulate swing.yaml -t 1 --method rk4": "--step",
    "simulate swing.yaml -t 1 --method rk4 --step 0.1 --rtol 1e-3": "leave out --rtol",
    "simulate swing.yaml -t 1 --method rk4 --step 0": "--step is 0; expected a positive number",
    "simulate swing.yaml --samples 3 --at 1": "not allowed with",
    "generate swing.yaml --compile-all --target numpy": "--compile-all compiles the C",
    "generate swing.yaml --compile-all --no-compile": "not allowed with",
    "import robot.urdf -o - --force": "remove --force",
    "statements swing.yaml --force": "--force is for a file",
    "export swing.yaml": "give one of --c (plain C)",
    "export swing.yaml --c --fmu": "give one of --c",
    "export swing.yaml --fmu --scalar float32": "--scalar is an option of --c",
    "export swing.yaml --c --fmi 2.0": "--fmi is an option of --fmu",
    "export swing.yaml --fmu --stop 0": "--stop 0.0: expected a positive number",
    "export swing.yaml --fmu --platforms vms": "platform 'vms' is unknown; platforms are x86_64-linux",
    "export swing.yaml --fmu --fmi 2.0 --platforms aarch64-linux": "FMI 2.0 has no binaries for aarch64-linux",
    "equations swing.yaml --force-file": "--force-file is for a file",
    "equations swing.yaml --values --set length=2": "leave out one of the two options",
    "new --list --from arm": "--list writes nothing",
    "new x.yaml --from nothing": "--from nothing: no such starter",
    "view swing.yaml -t 1 --trajectory run.npz": "not allowed with",
    "view swing.yaml --trajectory run.npz -p length=2": "has its own parameters",
    "view swing.yaml --animate run.gif": "--animate draws a motion",
    "view swing.yaml --html page.html --port 8000": "nothing is served",
    "view swing.yaml --force": "--force is for files",
    "bench --list --quick -o x.json": "leave out --quick, --output",
    "bench pendulum --plots pictures": "select a family (without --quick) or robots",
    "bench --results x.json --peers": "--peers, which start a new one",
    "bench pendulum --force": "--force applies to",
}


@pytest.mark.parametrize("command", TOGETHER)
def test_what_would_have_no_effect_together_is_refused(recorded, capsys, command):
    try:
        code = cli.main(command.split())
    except SystemExit as end:
        code = end.code
    assert code == 2 and TOGETHER[command] in capsys.readouterr().err and not recorded


def test_generate_stands_alone_too():
    """``generate`` and ``ordernm generate`` are the same command."""
    made = []
    parser = argparse.ArgumentParser(prog="generate")
    cli._generate_arguments(parser)
    for of in (parser, commands()["generate"]):
        made.append({tuple(a.option_strings) or a.dest for a in of._actions})
    assert made[0] == made[1]
