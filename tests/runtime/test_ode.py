"""`Solver.ode`: against motions of the compiled integrator, Jacobians of trees, and differences in 40 digits."""

from pathlib import Path

import numpy as np
import pytest
from made_once import made, solvers
from random_elements import with_random_elements
from random_mechanisms import random_mechanisms
from random_models import EVERY, random_state, random_tree
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import codegen

EXAMPLES = Path(__file__).parents[2] / "examples"

DRIVEN = """
model: driven
gravity: [0, 0, -9.81]
parameters: {l: 0.7, m: 1.2, c: 0.1}
inputs: [way, torque]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  rod: {parent: cart, joint: {type: revolute, axis: y}, mass: m, com: [0, 0, -l], inertia: {yy: 0.02}}
motion: {cart: way}
forces:
  drive: {type: joint, joint: rod, value: torque - c*u.rod}
"""

FREE = DRIVEN.replace("motion: {cart: way}\n", "").replace("inputs: [way, torque]", "inputs: [torque]")

TIMES = np.linspace(0.0, 2.0, 21)


@pytest.fixture(scope="module")
def numpy_solver(tmp_path_factory):
    return solvers(tmp_path_factory)


def difference(solver, end, **given):
    """The largest difference of SciPy's motion from that of `simulate`."""
    ode = solver.ode(**given)
    found = solve_ivp(ode, (0.0, end), ode.initial, method="DOP853", rtol=1e-11, atol=1e-11)
    assert found.success
    q, u = ode.state(found.t, found.y)
    run = solver.simulate([0.0, end], rtol=1e-11, atol=1e-11, **given)
    return max(np.abs(q[-1] - run.q[-1]).max(), np.abs(u[-1] - run.u[-1]).max())


@pytest.mark.parametrize("name", ["four_bar", "double_pendulum"])
def test_examples_move_as_in_simulate(name, tmp_path):
    assert difference(made(codegen.load_model(EXAMPLES / f"{name}.yaml"), tmp_path / name, check=False), 1.5) < 1e-8


@pytest.mark.parametrize(
    "inputs",
    [(TIMES, np.sin(TIMES)[:, None] * [0.4, 0.2], "cubic"), CubicSpline(TIMES, np.cos(TIMES)[:, None] * [0.4, 0.2])],
)
def test_inputs_over_time_drive_joints_and_forces(inputs, tmp_path):
    solver = made(DRIVEN, tmp_path / "driven", check=False)
    assert difference(solver, 2.0, inputs=inputs) < 1e-8
    with pytest.raises(ValueError, match=r"prescribed motion reads 'way' and its time derivatives; give \(times"):
        solver.ode(inputs=lambda t: [0.0, t])


def test_functions_of_time_are_called(tmp_path):
    solver = made(FREE, tmp_path / "free", check=False)
    assert difference(solver, 2.0, inputs=lambda t: [np.sin(3.0 * t)]) < 1e-8


@pytest.mark.parametrize("seed", range(3))
def test_jacobians_of_trees_are_those_of_accelerations(seed, numpy_solver):
    rng = np.random.default_rng(7100 + seed)
    model = with_random_elements(rng, random_tree(rng, 5, EVERY))
    solver, at = numpy_solver(model), random_state(rng, model)
    ode = solver.ode(at.q, at.u, at.p, at.inputs, at.t)
    y = ode.initial
    q, u = ode.state(at.t, y)
    J = solver.jacobians(q, u, at.p, at.inputs, at.t)
    assert ode.jacobian(at.t, y)[solver.nq :] == pytest.approx(np.concatenate([J.q, J.u], axis=1), rel=1e-13, abs=1e-13)
    assert ode.parameter_jacobian(at.t, y)[solver.nq :] == pytest.approx(J.p, rel=1e-13, abs=1e-13)
    rates = solver.coordinate_rates(q, u, at.p, at.inputs, at.t)
    udot = solver.accelerations(q, u, at.p, at.inputs, at.t)
    assert ode(at.t, y) == pytest.approx(np.concatenate([rates, udot]), rel=1e-13)
    several = ode(at.t, np.stack([y, 1.01 * y, 0.99 * y], axis=1))
    assert several[:, 1] == pytest.approx(ode(at.t, 1.01 * y), rel=1e-12, abs=1e-12)


def test_jacobians_of_mechanisms_are_slopes_along_closed_states(numpy_solver):
    """Central differences of y' in doubles, extrapolated, whose error is about 1e-9."""
    for _, drawn in random_mechanisms(2, first=40, bodies=(3, 4), loops=(1, 1)):
        solver = numpy_solver(drawn.model)
        ode = solver.ode(drawn.q, drawn.u, drawn.p, drawn.inputs, drawn.t)
        y, h = ode.initial, 1e-3

        def slope(e, h, ode=ode, y=y, t=drawn.t):
            return (ode(t, y + h * e) - ode(t, y - h * e)) / (2.0 * h)

        found = ode.jacobian(drawn.t, y)
        for e, column in zip(np.eye(len(y)), found.T, strict=True):
            wanted = (slope(e, 2 * h) - 20 * slope(e, h) + 64 * slope(e, h / 2)) / 45.0
            assert np.abs(column - wanted).max() < 1e-7 * max(1.0, np.abs(wanted).max())


DRIVEN_LOOP = """
model: driven_loop
gravity: [0, 0, -9.81]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: -y}, mass: 1, com: [0.2, 0, 0], inertia: {yy: 0.1}}
  b: {parent: a, joint: {type: revolute, axis: -y, at: [0.4, 0, 0]}, mass: 1, com: [0.6, 0, 0], inertia: {yy: 0.1}}
  c: {parent: b, joint: {type: revolute, axis: -y, at: [1.2, 0, 0]}, mass: 1, com: [0.4, 0, 0], inertia: {yy: 0.1}}
loops:
  bearing: {joint: {type: revolute, axis: -y}, from: {body: c, at: [0.9, 0, 0]}, to: {body: ground, at: [1.1, 0, 0]}}
motion: {a: 0.8 + 2*t}
initial: {q: {b: -0.4, c: -1.9}}
"""


def test_a_wholly_prescribed_mechanism_has_the_state_of_its_time(tmp_path):
    """It has no independent entries; computing its state ended in an error of NumPy."""
    solver = made(DRIVEN_LOOP, tmp_path / "loop", check=False)
    ode, times = solver.ode(), np.linspace(0.0, 3.0, 31)
    assert ode.names == () and ode(0.5, np.zeros(0)).shape == (0,)
    run = solver.simulate(times)
    q, u = ode.state(times, np.zeros((0, len(times))))
    assert q == pytest.approx(run.q, abs=1e-9) and u == pytest.approx(run.u, abs=1e-9)
    for i in range(len(times)):
        assert ode.state(times[i], np.zeros(0))[0] == pytest.approx(run.q[i], abs=1e-9)


def test_what_does_not_fit_is_refused(tmp_path):
    solver = made(codegen.load_model(EXAMPLES / "four_bar.yaml"), tmp_path / "four_bar", check=False, target="numpy")
    ode = solver.ode()
    with pytest.raises(ValueError, match=r"y has shape \(3,\), expected \(2,\): q.crank, u.crank"):
        ode(0.0, np.zeros(3))
    with pytest.raises(ValueError, match="a batch of states, expected one state"):
        ode.jacobian(0.0, np.stack([ode.initial] * 2, axis=1))
    with pytest.raises(ValueError, match=r"the arguments are a batch of shape \(2,\), expected one state"):
        solver.ode(np.stack([solver.initial[0]] * 2))
    alone = made(FREE, tmp_path / "alone", target="numpy", functions=["accelerations"])
    with pytest.raises(AttributeError, match=r"without sensitivities, coordinate_rates.*, which ode needs"):
        alone.ode()
    assert not (tmp_path / "alone" / "_runtime" / "motion").exists()
