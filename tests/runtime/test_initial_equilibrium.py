"""Models that begin in equilibrium: the state, its derivatives, and motions from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import codegen
from codegen.model import ModelError, parse_model
from codegen.runtime import Final

HANG = """\
model: hang
gravity: [0, 0, -9.81]
parameters: {L: 0.5, k: 30.0}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 2, com: [L, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  slide: {parent: arm, joint: {type: prismatic, axis: x, at: [L, 0, 0]}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  along: {type: joint, joint: slide, value: -k*q.slide - 2*u.slide}
  turn: {type: joint, joint: arm, value: -k*q.arm - u.arm/2}
initial: {equilibrium: true, q: {arm: 0.2}}
outputs: {height: {position: slide, axis: z}}
"""

BAR = """\
model: bar
gravity: [0, 0, -9.81]
parameters: {length: 1.0, k: 250.0}
bodies:
  crank:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: &bar {type: cylinder, axis: z, length: length, radius: 0.02, mass: 0.8, center: [0, 0, length/2]}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, length]}, shape: *bar}
  rocker: {parent: coupler, joint: {type: revolute, axis: y, at: [0, 0, length]}, shape: *bar}
points: {end: {body: rocker, at: [0, 0, length]}}
loops:
  foot: {joint: {type: revolute, axis: y}, from: end, to: {body: ground, at: [1.2*length, 0, 0]}}
forces:
  back:
    {type: spring, from: coupler, to: {body: ground, at: [-0.5, 0, 2]}, stiffness: k, free_length: 0.8}
initial: {q: {crank: 0.3, coupler: 1.27, rocker: 1.87}, equilibrium: true}
independent: [crank]
outputs: {height: {position: coupler, axis: z}}
"""


@pytest.fixture(scope="module")
def solvers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    found = {}
    for text in (HANG, BAR):
        model = parse_model(text)
        folder: Path = tmp_path_factory.mktemp("rest") / model.name
        codegen.generate(model, folder)
        found[model.name] = codegen.load(folder)
    return found


@pytest.mark.parametrize("name", ["hang", "bar"])
def test_it_is_at_rest_and_stays_there(solvers: dict[str, Any], name: str) -> None:
    solver = solvers[name]
    q, u = solver.initial
    assert not u.any() and np.abs(solver.accelerations(q, u)).max() < 1e-12
    for p in (None, solver.parameters * [1.05, 0.9]):
        q, u = solver.initial_state(p)
        found = solver.equilibrium(solver.assemble(p=p)[0], p, sensitivities=solver.parameter_names)
        assert np.array_equal(found.q, q)
        dq, du = solver.initial_sensitivities(p, dp=np.eye(2))[2:]
        assert np.array_equal(dq, found.dq) and not du.any() and dq.any(axis=1).all()
        # udot is zero whatever the parameters are
        along = solver.sensitivities(q, u, p, dq=dq, dp=np.eye(2))[1]
        assert np.abs(along).max() < 1e-10
    run = solver.simulate(0.5, sensitivities=solver.parameter_names, rtol=1e-10, atol=1e-10)
    assert np.abs(run.q - run.q[0]).max() < 1e-9
    assert np.abs(run.dq - run.dq[:, :1]).max() < 1e-8


@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_functionals_know_how_rest_moves(solvers: dict[str, Any], method: str) -> None:
    solver = solvers["bar"]
    judged = solver.judge(0.3, [Final("height")], wrt=solver.parameter_names, method=method, rtol=1e-10, atol=1e-10)
    q, u = solver.initial
    dq = solver.initial_sensitivities(dp=np.eye(2))[2]
    expected = solver.output_sensitivities(q, u, dq=dq, dp=np.eye(2))[1][:, 0]
    assert judged.gradients[0] == pytest.approx(expected, rel=1e-8)


def test_other_speeds_from_rest(solvers: dict[str, Any]) -> None:
    solver = solvers["hang"]
    run = solver.simulate([0.0, 0.1], u=[0.5, 0.0])
    assert np.array_equal(run.q[0], solver.initial[0]) and np.array_equal(run.u[0], [0.5, 0.0])
    assert np.array_equal(solver.assemble({"slide": 0.4})[0], [solver.initial[0][0], 0.4])


def test_only_such_a_model_says_so(tmp_path: Path) -> None:
    report = codegen.generate(parse_model(HANG.replace("equilibrium: true, ", "")), tmp_path / "m", compile=False)
    assert "at_rest" not in (Path(report.folder) / "model.json").read_text()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("equilibrium: true", "equilibrium: maybe", "initial.equilibrium: 'maybe'; true or false is allowed"),
        (
            "equilibrium: true",
            "equilibrium: true, u: {arm: 1}",
            "equilibrium excludes initial speeds; leave u out",
        ),
        ("equilibrium: true", "equilibrum: true", "unknown key 'equilibrum'; keys here: q, u, equilibrium"),
    ],
)
def test_mistakes(old: str, new: str, expected: str) -> None:
    with pytest.raises(ModelError, match=expected):
        parse_model(HANG.replace(old, new))


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    codegen.generate(parse_model(HANG), tmp_path / "hang", functions="accelerations", target="numpy")
    with pytest.raises(AttributeError, match=r"generated without sensitivities, .* which equilibrium needs"):
        _ = codegen.load(tmp_path / "hang").initial
