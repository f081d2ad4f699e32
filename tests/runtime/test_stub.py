"""Stubs of packages: type checkers and editors see exactly the members that a solver has."""

import ast
import inspect
import random
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime.loading import _package
from codegen.runtime.standalone.solver import Solver

TREE = """
model: swing
gravity: [0, 0, -9.81]
parameters: {length: 0.7, mass: 2, hinge: [0.1, 0, -1]}
inputs: [pull]
bodies:
  upper: {parent: ground, joint: {type: revolute, axis: y}, mass: mass, com: [0.1, 0, -length], inertia: {xx: 1, yy: 1, zz: 1}}
  lower: {parent: upper, joint: {type: revolute, axis: y, at: hinge}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  push: {type: joint, joint: upper, value: pull}
"""
OUTPUTS = "outputs: {tip: {position: {body: lower, at: [0, 0, -1]}, axis: x}}\n"
LOOP = """
loops:
  rod: {joint: {type: distance, length: 1.5}, from: {body: lower, at: [0, 0, -1]}, to: {body: ground, at: [0.5, 0, -3]}}
"""
CASES = {
    "tree": (TREE + OUTPUTS, {}),
    "without outputs": (TREE, {}),
    "loop": (TREE + LOOP, {}),
    "everything": (TREE + OUTPUTS, {"frames": True, "reactions": True}),
    "two functions": (TREE + OUTPUTS, {"functions": ("accelerations", "outputs")}),
    "energies of a loop": (TREE + LOOP, {"functions": ("energies",)}),
    "gradients alone": (TREE, {"functions": ("gradients", "inverse_dynamics")}),
    "motions without derivatives": (TREE + OUTPUTS, {"functions": ("state_rates",)}),
    "prescribed": (TREE + "motion: {lower: 0.3*sin(t)}\n", {}),
    "single precision": (TREE, {"scalar": "float32"}),
}


def methods(stub: str) -> dict[str, ast.FunctionDef]:
    (solver,) = (node for node in ast.parse(stub).body if isinstance(node, ast.ClassDef))
    return {node.name: node for node in solver.body if isinstance(node, ast.FunctionDef)}


def arguments(solver: Solver, name: str) -> dict[str, object]:
    """Values for all arguments of a method except options."""
    q, u = solver.initial
    weights = {"energy_gradients": 2, "output_gradients": solver.noutputs, "coordinate_rate_gradients": solver.nq}
    known = {
        "q": q, "u": u, "b": u, "udot": u, "weights": np.ones(weights.get(name, solver.nu)), "dp": np.eye(solver.np),
        "weights_q": q, "partition": 0,
    }  # fmt: skip
    taken = inspect.signature(vars(Solver)[name]).parameters
    return {n: x for n, x in known.items() if n in taken and (n, name) != ("dp", "diagnose")}


@pytest.mark.parametrize("case", CASES)
def test_a_stub_has_the_methods_that_can_be_called(case, tmp_path):
    text, options = CASES[case]
    folder = tmp_path / "swing"
    codegen.generate(codegen.parse_model(text), folder, compile=False, **options)
    stub = (folder / "__init__.pyi").read_text()
    found, solver = methods(stub), _package(folder, []).Solver("numpy")
    for name in (n for n, x in vars(Solver).items() if inspect.isfunction(x) and not n.startswith("_")):
        if name in ("simulate", "judge"):  # which are compiled
            there = "state_rates" in solver._functions and (
                name == "simulate" or "outputs" in solver._functions or not solver.output_names
            )
        elif name == "in_precision":
            there = True
        elif name == "view":  # which needs a browser
            there = "display" in solver._manifest
        else:
            try:
                getattr(solver, name)(**arguments(solver, name))
                there = True
            except AttributeError as error:
                assert "swing" in str(error)
                there = False
        assert (name in found) == there, name
    assert {n for n, x in vars(Solver).items() if isinstance(x, property) and not n.startswith("_")} < found.keys()
    for name, method in found.items():
        if name in vars(Solver) and not method.decorator_list:
            ours = [a.arg for a in (*method.args.args, *method.args.kwonlyargs)]
            assert ours == list(inspect.signature(vars(Solver)[name]).parameters), name
    for kind, names in (
        ("_Parameters", solver.parameter_names),
        ("_Inputs", solver.input_names),
        ("_Outputs", solver.output_names),
    ):
        entries = re.search(rf'{kind} = TypedDict\("{kind}", {{\n(.*?)}}', stub, re.DOTALL)
        assert tuple(re.findall(r'"(.+?)":', entries[1] if entries else "")) == (names if entries else ()), kind
        assert entries or not names or kind == "_Outputs"
    assert f"NDArray[{options.get('scalar', 'float64')}]" in stub
    assert (folder / "py.typed").read_text() == "\n"


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(30))
def test_a_stub_has_the_methods_that_can_be_called_of_any_functions(seed, tmp_path, monkeypatch):
    rng = random.Random(seed)
    text = TREE + rng.choice(("", LOOP)) + rng.choice(("", OUTPUTS)) + rng.choice(("", "motion: {lower: 0.3*sin(t)}\n"))
    options = {"frames": rng.random() < 0.3, "reactions": rng.random() < 0.3}
    made = codegen.generate(codegen.parse_model(text), tmp_path / "whole", compile=False, **options).folder
    functions = codegen.load(made, "numpy")._manifest["functions"]
    known = sorted({f.get("member", name) for name, f in functions.items()})
    monkeypatch.setitem(CASES, seed, (text, options | {"functions": rng.sample(known, rng.randint(1, 4))}))
    test_a_stub_has_the_methods_that_can_be_called(seed, tmp_path)


USE = """\
from swing import AssemblyError, Jacobians, Solver
solver = Solver()
q, u = solver.initial
solver.accelerations(q, u, {"length": 2.0, "hinge.x": 0.1})
solver.accelerations([0.1, 0.2], u, p=None, inputs={"pull": [1.0, 2.0]})
solver.sensitivities({"upper": 0.1}, u, dp={"mass": [1.0]})[1].sum()
solver.linearize(outputs=["tip"]).A.shape
solver.equilibrium(sensitivities="length").q.sum()
solver.simulate(1.0, p={"mass": 3.0}).q.sum()
reveal_type(solver.jacobians(q, u).p)
"""
WRONG = {
    'solver.accelerations(q, u, {"lenght": 2.0})': "Argument 3 to .accelerations.",
    'solver.accelerations(q, u, inputs={"push": 1.0})': "Argument .inputs. to .accelerations.",
    "solver.reactions(q, u)": "has no attribute .reactions.",
    'solver.linearize(outputs="top")': "Argument .outputs. to .linearize.",
    "solver.outputs(q, u, parameters=q)": "Unexpected keyword argument .parameters.",
}


def test_a_type_checker_finds_wrong_names_and_missing_functions(tmp_path):
    pytest.importorskip("mypy", reason="needs mypy")
    codegen.generate(codegen.parse_model(TREE + OUTPUTS), tmp_path / "swing", "numpy", compile=False)
    (tmp_path / "use.py").write_text(USE + "".join(f"{line}\n" for line in WRONG))
    (tmp_path / "mypy.ini").write_text("[mypy]\n[mypy-swing._runtime.*]\nignore_errors = True\n")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), "use.py"], cwd=tmp_path, capture_output=True,
        text=True, env={"PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    errors = dict(re.findall(r"^use\.py:(\d+): error: (.*)$", done.stdout, re.MULTILINE))
    start = USE.count("\n") + 1
    assert errors.keys() == {str(start + i) for i in range(len(WRONG))}, done.stdout + done.stderr
    for number, expected in zip(range(start, start + len(WRONG)), WRONG.values(), strict=True):
        assert re.search(expected, errors[str(number)])
    assert "float64" in done.stdout


def test_stubs_are_the_same_bytes_every_time(tmp_path):
    made = [codegen.generate(codegen.parse_model(TREE), tmp_path / n, compile=False).folder for n in "ab"]
    assert len({Path(folder, "__init__.pyi").read_bytes() for folder in made}) == 1
