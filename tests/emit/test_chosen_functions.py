"""Packages of chosen functions: other functions leave no trace, chosen ones give the same numbers, calls of others say so."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.cli import generate_main
from codegen.mechanics.procedures import UnknownFunctionError
from codegen.mechanics.procedures.choice import GROUPS, METHODS
from codegen.model import load_model, parse_model
from codegen.pipeline import write_solver
from codegen.runtime.standalone.calls.functions import MADE_OF
from codegen.runtime.standalone.errors import SingularForceError
from codegen.runtime.standalone.files.compiler import find_compiler
from codegen.runtime.standalone.solver import Solver

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = ("double_pendulum", "four_bar")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Packages with all functions, by model."""
    folder = tmp_path_factory.mktemp("whole")
    return {name: package(name, folder / name) for name in MODELS}


def package(name, folder, *functions):
    codegen.generate(EXAMPLES / f"{name}.yaml", folder, "numpy", functions=functions or None, compile=False)
    return codegen.load(folder)


def state(solver):
    rng = np.random.default_rng(3)
    q, u = solver.initial
    u = u + rng.normal(size=solver.nu)
    seeds = {f"d{n}": rng.normal(size=(2, size)) for n, size in (("q", solver.nq), ("u", solver.nu), ("p", solver.np))}
    return (q, u, None, rng.normal(size=solver.ninputs), 0.2), seeds, rng.normal(size=(2, solver.nu))


@pytest.mark.parametrize("name", MODELS)
def test_gradients_alone(name, whole, tmp_path):
    """The transpose of the sensitivities without the sensitivities: the same numbers, and members of what is left out tell."""
    solver = package(name, tmp_path / name, "gradients", "coordinate_rates")
    given, seeds, weights = state(solver)
    for ours, theirs in zip(
        solver.gradients(*given, weights=weights), whole[name].gradients(*given, weights=weights), strict=True
    ):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(solver.coordinate_rates(*given), whole[name].coordinate_rates(*given))
    without = "was generated without {}; generate it with --functions .*gradients.*,{}, or without --functions for all"
    for member, more in (
        ("accelerations", {}), ("sensitivities", seeds), ("jacobians", {}), ("outputs", {}), ("energies", {}),
        ("output_gradients", {"weights": np.zeros(solver.noutputs)}),
    ):  # fmt: skip
        with pytest.raises(AttributeError, match=without.format(member, member)):
            getattr(solver, member)(*given, **more)


@pytest.mark.parametrize("name", MODELS)
def test_what_is_left_out_is_nowhere(name, whole, tmp_path):
    solver = package(name, tmp_path / name, "accelerations", "sensitivities")
    given, seeds, _ = state(solver)
    for ours, theirs in zip(
        solver.sensitivities(*given, **seeds), whole[name].sensitivities(*given, **seeds), strict=True
    ):
        assert np.array_equal(ours, theirs)
    manifest = json.loads((tmp_path / name / "model.json").read_text())
    assert {"accelerations", "sensitivities"} <= set(manifest["functions"])
    assert {"jacobians", "gradients", "outputs"} <= set(manifest["left_out"])
    texts = [p.read_text() for p in (tmp_path / name).glob(f"{name}*")]
    assert len(texts) == 8  # the last two work on several states at once, and on threads
    for word in ("jacobians", "_transposed", "moments(", "link_kept", ".kept"):
        assert not any(word in text for text in texts), word
    assert not (tmp_path / name / "_runtime" / "state" / "weighted_gradients.py").exists()
    assert "def outputs(" not in (tmp_path / name / "_runtime" / "solver.py").read_text()


def test_values_alone_have_no_directions():
    source = write_solver(load_model(EXAMPLES / "double_pendulum.yaml"), functions=["accelerations"])
    assert "double_pendulum_directions.h" not in source.files and "WIDTH 1" not in source.files["double_pendulum.c"]


@pytest.mark.parametrize(
    "functions",
    [
        "coordinate_rates",
        "solve_mass,mass_matrix,jacobians",
        "outputs,energy_gradients",
        "mass_matrix",
        "jacobians",
        "inverse_mass_matrix",
    ],
)
def test_chosen_functions_leave_nothing_unused(functions, tmp_path):
    """Static functions and tables that nobody uses would be warned of."""
    codegen.generate(EXAMPLES / "double_pendulum.yaml", tmp_path / "chosen", functions=functions, compile=False)
    command = [*find_compiler(), "-O0", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    for file in sorted((tmp_path / "chosen").glob("*.c")):
        subprocess.run([*command, file.name], cwd=tmp_path / "chosen", check=True)


@pytest.mark.parametrize(
    ("function", "said"),
    [
        ("sensitivity", "'sensitivity'; did you mean 'sensitivities'"),
        ("gradient", "'gradient'; did you mean 'gradients'"),
        ("solve_mass", "no function 'solve_mass'; available are accelerations, "),
        ("mass", "no function 'mass'; available are .*, and the groups dynamics, rates, states"),
        ("bias_force", "no function 'bias_force'; available are .*assemble"),
        ("point_jacobians", "point_jacobians is a method of solvers with frames: select frames; available are"),
    ],
)
def test_unknown_functions_are_told(function, said):
    with pytest.raises(UnknownFunctionError, match=said):
        write_solver(load_model(EXAMPLES / "four_bar.yaml"), functions=[function])


@pytest.mark.parametrize("method", METHODS)
def test_functions_to_select_for_methods_are_those_that_they_call(method):
    assert hasattr(Solver, method)
    selected = GROUPS.get(METHODS[method], (METHODS[method],))
    assert not set(MADE_OF[method]).isdisjoint(selected)


def test_no_functions_are_told():
    with pytest.raises(UnknownFunctionError, match="none are given; available are accelerations"):
        write_solver(load_model(EXAMPLES / "four_bar.yaml"), functions=[])


@pytest.mark.parametrize("target", ["c", "numpy"])
@pytest.mark.parametrize(("function", "weights"), [("energy_gradients", [0.0, 1.0]), ("output_gradients", [1.0])])
def test_gradients_alone_tell_of_springs_without_length(tmp_path, function, weights, target):
    """Others would have looked at the pivots."""
    text = """
model: sliders
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces: {rope: {type: spring, from: a, to: b, stiffness: 3, free_length: 0.1}}
outputs: {stored: potential_energy}
"""
    codegen.generate(parse_model(text), tmp_path / "m", target, functions=[function])
    solver = codegen.load(tmp_path / "m", target)
    with pytest.raises(SingularForceError, match="rope"):
        getattr(solver, function)([0.5, 0.5], [0.0, 0.0], weights=weights)


def test_the_command_takes_functions(tmp_path, capsys):
    model = str(EXAMPLES / "double_pendulum.yaml")
    assert generate_main([model, "-o", str(tmp_path / "a"), "--functions", "dynamics, rates", "--no-compile"]) == 0
    kept = json.loads((tmp_path / "a" / "model.json").read_text())["functions"]
    assert list(kept) == [
        "accelerations", "sensitivities", "jacobians", "coordinate_rates", "coordinate_rate_sensitivities",
    ]  # fmt: skip
    assert generate_main([model, "-o", str(tmp_path / "b"), "--functions", "dynamic", "--no-compile"]) == 2
    assert "did you mean 'dynamics'" in capsys.readouterr().err


@pytest.mark.parametrize("chosen", ["initial_sensitivities", "state_rate_sensitivities", "closing_step"])
def test_functions_bring_what_they_are_of_no_use_without(chosen, tmp_path):
    """Derivatives of the initial state of loops are those of an assembled one."""
    model = (EXAMPLES / "four_bar.yaml").read_text(encoding="utf-8").replace("{crank: 0.8,", "{crank: 0.8*base/1.1,")
    codegen.generate(parse_model(model), tmp_path / "four_bar", "numpy", functions=(chosen,), compile=False)
    solver = codegen.load(tmp_path / "four_bar")
    brought = {
        "initial_sensitivities": {"initial_sensitivities", "completion_sensitivities"},
        "state_rate_sensitivities": {
            "initial_sensitivities", "completion_sensitivities", "state_rates", "state_rate_sensitivities", "closing_step",
        },
        "closing_step": {"closing_step"},
    }[chosen]  # fmt: skip
    basic = {"closure", "conditions", "newton_step", "completion", "initial"}
    assert set(solver._functions) - basic == brought
    if "initial_sensitivities" in brought:
        q, u, dq, _ = solver.initial_sensitivities(dp=np.eye(solver.np))
        assert np.abs(solver.closure(q, u)[0]).max() < 1e-10
        assert dq[solver.parameter_names.index("base"), 0] == pytest.approx(0.8 / 1.1, rel=1e-14)
