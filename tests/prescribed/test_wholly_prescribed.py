"""Mechanisms whose whole motion is prescribed, trees and loops: `simulate` and `judge` against closed forms."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from comparison import error
from prescribed_models import driven_crank

import codegen
from codegen.cli import main
from codegen.model import parse_model
from codegen.reference import DenseEngine
from codegen.runtime.standalone.motion.functionals import Final, Integral

LIFT = """
model: lift
gravity: [0, 0, -g]
parameters: {a: 0.12, w: 2.5, g: 9.7, rate: 0.8}
bodies:
  lift: {parent: ground, joint: {type: prismatic, axis: z}, mass: 2}
  arm: {parent: lift, joint: {type: revolute, axis: y}, mass: 1.5, com: [0.4, 0, 0], inertia: {xx: 0.01, yy: 0.05, zz: 0.05}}
motion: {lift: a*sin(w*t), arm: rate*t}
outputs:
  motor: {driving_force: lift}
  torque: {driving_force: arm}
  power: {value: 0}
"""


def lift_in_closed_form(p: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force of the lift and torque of the arm, by Newton and Euler by hand; p = a, w, g, rate; (nt,) each."""
    a, w, g, rate = p
    up = -a * w * w * np.sin(w * t)  # acceleration of the lift
    angle = rate * t
    # the centre of mass is 0.4 (cos, 0, -sin) of the angle from the joint
    force = 3.5 * (g + up) + 1.5 * 0.4 * rate**2 * np.sin(angle)
    return force, -1.5 * 0.4 * np.cos(angle) * (g + up)


def by_parameters(p: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Derivatives (4, nt, 2) of force and torque with respect to p, by complex steps."""
    steps = np.eye(4) * 1e-30j
    return np.array([np.stack(lift_in_closed_form(p + s, t), axis=-1).imag / 1e-30 for s in steps])


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lift") / "lift"
    codegen.generate(parse_model(LIFT), folder, target="both", compile="all")
    return codegen.load(folder)


@pytest.mark.parametrize("method", ["dop853", "radau", "rk4"])
def test_a_tree_without_freedoms_is_simulated_with_its_derivatives(lift, method: str) -> None:
    p, step = np.array([0.2, 1.9, 9.81, 1.1]), 0.01 if method == "rk4" else None
    run = lift.simulate(
        np.linspace(0.3, 2.0, 7), p=p, sensitivities=list(lift.parameter_names), method=method, step=step
    )
    assert run.q.shape == run.u.shape == (7, 0) and run.dq.shape == run.du.shape == (4, 7, 0)
    expected = np.stack(lift_in_closed_form(p, run.t), axis=-1)
    assert error(run.outputs[:, :2], expected) < 1e-14
    assert error(run.doutputs[..., :2], by_parameters(p, run.t)) < 1e-14


def test_a_motion_of_so_many_seconds_has_results_between_its_ends(lift) -> None:
    assert len(lift.simulate(1.0).t) > 50


@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_the_mean_torque_of_a_tree_without_freedoms_and_its_gradient(lift, method: str) -> None:
    p, end = lift.parameters.copy(), 1.7
    x, weight = np.polynomial.legendre.leggauss(40)
    t, weight = 0.5 * end * (x + 1.0), 0.5 * end * weight
    judged = lift.judge(end, [Integral("torque"), Final("motor")], wrt=list(lift.parameter_names), p=p, method=method)
    torque, force = lift_in_closed_form(p, t)[1], lift_in_closed_form(p, np.array([end]))[0]
    assert error(judged.values, [weight @ torque, force[0]]) < 1e-12
    expected = [by_parameters(p, t)[:, :, 1] @ weight, by_parameters(p, np.array([end]))[:, 0, 0]]
    assert error(judged.gradients, expected) < 1e-12


def test_every_function_of_a_state_takes_empty_states(lift) -> None:
    t = np.linspace(0.0, 1.0, 6).reshape(2, 3)
    q = u = np.zeros((2, 3, 0))
    dp = np.broadcast_to(np.eye(4)[:, None, None], (4, 2, 3, 4))
    for target in ("c", "numpy"):
        solver = codegen.load(lift.folder, target=target)
        assert solver.accelerations(q, u, t=t).shape == (2, 3, 0)
        assert [x.shape for x in solver.sensitivities(q, u, t=t, dp=dp)] == [(2, 3, 0), (4, 2, 3, 0)]
        assert solver.mass_matrix(q, t=t).shape == (2, 3, 0, 0)
        assert solver.inverse_mass_matrix(q, t=t).shape == (2, 3, 0, 0)
        assert solver.inverse_dynamics(q, u, u, t=t).shape == (2, 3, 0)
        assert solver.jacobians(q, u, t=t).p.shape == (2, 3, 0, 4)
        force, torque = lift_in_closed_form(solver.parameters, t)
        assert error(solver.driving_forces(q, u, t=t), np.stack([force, torque], axis=-1)) < 1e-14
        assert solver.driving_forces(q[:, :0], u[:, :0], t=t[:, :0]).shape == (2, 0, 2)
    assert "no accelerations" in repr(lift.diagnose([], []))


BARE = """
model: bare
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1.5, com: [0.4, 0, 0], inertia: {xx: 0.01, yy: 0.05, zz: 0.05}}
motion: {arm: 0.3}
"""


def test_a_model_without_speeds_parameters_inputs_and_outputs(tmp_path: Path) -> None:
    codegen.generate(parse_model(BARE), tmp_path / "bare", target="both", compile="all")
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "bare", target=target)
        assert (solver.nq, solver.nu, solver.np, solver.ninputs, solver.noutputs) == (0,) * 5
        assert solver.driving_forces([], []).tolist() == [0.0]
        assert solver.driving_force_sensitivities([], [], dt=np.ones(3))[1].tolist() == [[0.0]] * 3
    assert codegen.load(tmp_path / "bare").simulate(1.0).outputs.shape[1] == 0


CRANK = partial(driven_crank, "w*t", 60, forces="gas: {type: joint, joint: piston, value: -300*(1 + q.piston)}")
BESIDE = "  free: {parent: ground, joint: {type: prismatic, axis: x, at: [1, 0, 0]}, mass: 1}\n"


@pytest.fixture(scope="module")
def cranks(tmp_path_factory):
    found = []
    for name, text in (("alone", CRANK()), ("beside", CRANK(bodies=BESIDE))):
        folder = tmp_path_factory.mktemp("cranks") / name
        codegen.generate(parse_model(text), folder, compile="all")
        found.append(codegen.load(folder))
    return found


def test_a_driven_loop_follows_its_branch_over_many_turns(cranks) -> None:
    alone, _ = cranks
    for t in (np.linspace(0.0, 1.0, 7), 1.0):  # nearly ten turns, in 6 intervals of a turn and a half
        run = alone.simulate(t, sensitivities=["r", "rod", "w"])
        r, rod, w = alone.parameters
        s, c = np.sin(w * run.t), np.cos(w * run.t)
        slope = np.sqrt(rod**2 - (r * s) ** 2)
        assert np.abs(run.outputs[:, 0] - (r * c + slope)).max() < 1e-14
        by = np.stack([c - r * s**2 / slope, rod / slope, -run.t * (r * s + r**2 * s * c / slope)])
        assert error(run.doutputs[:, :, 0], by) < 1e-12
        rod_by_crank = run.q[:, alone.coordinate_names.index("rod")]
        assert np.abs(rod_by_crank + w * run.t + np.arcsin(r * s / rod)).max() < 1e-12  # with no turn too many


def test_driving_torques_of_a_driven_loop_are_those_of_the_engine(cranks) -> None:
    alone, _ = cranks
    run, engine = alone.simulate(np.linspace(0.0, 0.3, 5)), DenseEngine(parse_model(CRANK()))
    for q, u, t, outputs in zip(run.q, run.u, run.t, run.outputs, strict=True):
        assert error(outputs[1], engine.driving_forces(q, u, t=t)[0]) < 1e-12


def test_the_mean_torque_of_a_driven_loop_is_that_with_a_free_body_beside_it(cranks) -> None:
    wanted, wrt = [Integral("torque"), Final("x")], ["r", "rod", "w"]
    alone, beside = cranks
    expected = beside.judge(0.2, wanted, wrt=wrt, method="forward", rtol=1e-12, atol=1e-12)
    for method in ("forward", "adjoint"):
        found = alone.judge(0.2, wanted, wrt=wrt, method=method, rtol=1e-12, atol=1e-12)
        assert error(found.values, expected.values) < 1e-10
        assert error(found.gradients, expected.gradients) < 1e-9


def test_nothing_is_said_to_be_free(tmp_path: Path) -> None:
    report = codegen.generate(parse_model(CRANK()), tmp_path / "crank")
    assert "no degree of freedom; prescribed: crank" in str(report)


def test_the_command_line_simulates_it(tmp_path: Path, capsys) -> None:
    model, rows = tmp_path / "lift.yaml", tmp_path / "rows.npz"
    model.write_text(LIFT)
    assert main(["simulate", str(model), "-t", "1", "-o", str(rows)]) == 0
    assert "0 coordinates" in capsys.readouterr().out
    assert len(codegen.load_trajectory(rows).t) > 50
