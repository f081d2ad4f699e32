"""Inputs over time that prescribed motion follows: rates and accelerations of their splines, with derivatives."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import made_once
import numpy as np
import pytest
from comparison import compare, error
from prescribed_models import driven_crank
from scipy.interpolate import BSpline, CubicHermiteSpline, CubicSpline, make_interp_spline

import codegen
from codegen.model import parse_model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime.standalone.motion.functionals import Final, Integral

TROLLEY = """
model: trolley
gravity: [0, 0, -9.81]
parameters: {m: 40, l: 2.5, w: 1.3}
inputs: [pull, way]
bodies:
  trolley: {parent: ground, joint: {type: prismatic, axis: x}, mass: 120}
  rope: {parent: trolley, joint: {type: revolute, axis: y}, mass: m, com: [0, 0, -l], inertia: {xx: 1, yy: 2, zz: 1}}
motion: {trolley: "WAY"}
forces:
  brake: {type: joint, joint: rope, value: -2*u.rope + pull + 0.1*u.trolley}
outputs:
  angle: {value: q.rope}
  x: {position: trolley, axis: x}
  v: {velocity: trolley, axis: x}
  force: {driving_force: trolley}
"""
LOAD = """
  load: {parent: rod, joint: {type: revolute, axis: y, at: [0, 0, rod/2]}, mass: 0.2, com: [0, 0, -0.1], inertia: {yy: 1e-3}}
"""
TIMES = np.linspace(0.0, 2.0, 9)


made = partial(made_once.made, compile="all")


@pytest.fixture(scope="module")
def trolley(tmp_path_factory):
    return made(TROLLEY.replace("WAY", "way"), tmp_path_factory.mktemp("trolley") / "trolley")


@pytest.fixture(scope="module")
def written_out(tmp_path_factory):
    text = TROLLEY.replace("WAY", "0.3*t + w*t**2/2 - 0.2*t**3").replace("[pull, way]", "[pull]")
    return made(text, tmp_path_factory.mktemp("written") / "written")


def cubic(t):
    return 0.3 * t + 1.3 * t**2 / 2 - 0.2 * t**3


def test_inputs_of_prescribed_motion_bring_rate_and_acceleration(trolley, written_out) -> None:
    assert trolley.input_names == ("pull", "way", "way.rate", "way.acceleration")
    assert trolley.signal_names == ("pull", "way")
    assert written_out.input_names == ("pull",)
    model = parse_model(TROLLEY.replace("WAY", "way"))
    assert model.inputs == trolley.input_names and model.signals == ("pull", "way")


@pytest.mark.parametrize("method", ["dop853", "radau", "rk4"])
def test_a_polynomial_as_a_spline_is_the_polynomial_written_out(trolley, written_out, method: str) -> None:
    options = {"method": method, "rtol": 1e-12, "atol": 1e-12, "step": 1e-3 if method == "rk4" else None}
    expected = written_out.simulate(TIMES, inputs=[0.7], sensitivities=["m", "l"], **options)
    t = np.array([0.0, 0.4, 0.9, 1.7, 2.0])
    pull = np.full(5, 0.7)
    for way in ((t, cubic(t), "cubic"), CubicSpline(t, cubic(t)), make_interp_spline(t, cubic(t), k=3), cubic):
        found = trolley.simulate(TIMES, inputs={"pull": 0.7, "way": way}, sensitivities=["m", "l"], **options)
        tolerance = 1e-11 if method == "dop853" else 1e-9
        assert error(found.outputs, expected.outputs) < tolerance
        assert error(found.doutputs, expected.doutputs) < 10 * tolerance
    both = trolley.simulate(TIMES, inputs=(t, np.stack([pull, cubic(t)], axis=1), "cubic"), **options)
    assert error(both.outputs, expected.outputs) < tolerance


def test_single_states_have_the_rates_that_they_are_given(trolley, written_out) -> None:
    """Values, all derivatives and both targets: with rates of the polynomial they are those of the polynomial."""
    q, u, t = [0.3], [-0.4], 0.7
    inputs = {"pull": 0.7, "way": cubic(t), "way.rate": 0.3 + 1.3 * t - 0.6 * t**2, "way.acceleration": 1.3 - 1.2 * t}
    for name in ("accelerations", "driving_forces", "outputs"):
        found, expected = getattr(trolley, name)(q, u, None, inputs), getattr(written_out, name)(q, u, None, [0.7], t)
        assert error(found, expected) < 1e-14
    jacobians = trolley.jacobians(q, u, None, inputs), written_out.jacobians(q, u, None, [0.7], t)
    assert (
        error(jacobians[0].q, jacobians[1].q) < 1e-14 and error(jacobians[0].inputs[:, :1], jacobians[1].inputs) < 1e-14
    )
    by_t = jacobians[0].inputs[:, 1:] @ [0.3 + 1.3 * t - 0.6 * t**2, 1.3 - 1.2 * t, -1.2]
    assert error(by_t, jacobians[1].t) < 1e-14
    assert trolley.driving_forces(q, u, inputs={"way.acceleration": 1.0}).shape == (1,)
    with pytest.raises(ValueError, match=r"one number for each of pull, way, way\.rate, way\.acceleration"):
        trolley.accelerations(q, u, inputs=[0.7, 1.0])


@pytest.mark.parametrize("motion", ["way", "way**2/3 - sin(w*t)*pull", "atan(way*t) + pull*w"])
def test_every_function_is_that_of_both_engines(tmp_path: Path, motion: str) -> None:
    model = parse_model(TROLLEY.replace("WAY", motion))
    codegen.generate(model, tmp_path / "made", target="both", compile="all")
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "made", target=target)
        for engine in (DenseEngine(model), RecursiveEngine(model)):
            found = compare(model, solver, engine, np.random.default_rng(3), transposed=isinstance(engine, DenseEngine))
            assert max(found.values()) < 1e-12, found


def test_accelerations_are_those_of_the_spline_to_rounding(trolley) -> None:
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0.1, 1.9, 6))
    knots = np.concatenate([[0.0] * 4, t, [2.0] * 4])
    for spline in (BSpline(knots, rng.normal(size=10), 3), BSpline(np.linspace(-2, 4, 17), rng.normal(size=11), 5)):
        inputs = trolley.simulate(TIMES, inputs={"way": spline}, rtol=1e-10, atol=1e-10)
        assert error(inputs["x"], spline(TIMES)) < 1e-14
        assert error(inputs["v"], spline(TIMES, 1)) < 1e-13
        q, u = inputs.q, inputs.u
        rates = {"way": spline(TIMES), "way.rate": spline(TIMES, 1), "way.acceleration": spline(TIMES, 2)}
        assert error(inputs["force"], trolley.driving_forces(q, u, inputs=rates)[:, 0]) < 1e-12


def test_derivatives_by_values_of_the_spline_forward_and_adjoint(trolley) -> None:
    """The map from the values to the motion is linear in the trolley's; others by the spline with one value changed."""
    t = np.array([0.0, 0.5, 0.8, 1.3, 2.0])
    values = np.array([0.0, 0.4, 0.1, -0.3, 0.2])
    names = [f"inputs.way[{i}]" for i in range(5)] + ["inputs.way", "inputs.pull", "l"]
    tight = {"rtol": 1e-12, "atol": 1e-12}
    inputs = {"way": (t, values, "cubic"), "pull": 0.3}
    run = trolley.simulate(TIMES, inputs=inputs, sensitivities=names, **tight)
    for i in range(5):
        unit = make_interp_spline(t, np.eye(5)[i], k=3)
        assert error(run.doutputs[i, :, run.output_names.index("x")], unit(TIMES)) < 1e-13
        assert error(run.doutputs[i, :, run.output_names.index("v")], unit(TIMES, 1)) < 1e-13
    assert error(run.doutputs[5], run.doutputs[:5].sum(axis=0)) < 1e-11
    h = 1e-5
    for i in (1, 3):
        ends = [
            trolley.simulate(
                TIMES, inputs={"way": (t, values + s * np.eye(5)[i], "cubic"), "pull": 0.3}, **tight
            ).outputs
            for s in (h, -h)
        ]
        assert error(run.doutputs[i], (ends[0] - ends[1]) / (2 * h)) < 1e-7
    wanted = [Final("angle"), Integral("force")]
    forward, adjoint = (
        trolley.judge(2.0, wanted, inputs=inputs, wrt=names, method=m, **tight) for m in ("forward", "adjoint")
    )
    assert error(adjoint.gradients, forward.gradients) < 1e-11
    assert error(forward.gradients[0], run.doutputs[:, -1, 0]) < 1e-10


@pytest.mark.parametrize("load", ["", LOAD], ids=["wholly driven", "with a freedom"])
def test_a_loop_that_is_driven_by_an_input(tmp_path: Path, load: str) -> None:
    by_input = made(driven_crank("turn + w*t", 7, inputs="turn", bodies=load), tmp_path / "turn")
    written = made(driven_crank("0.3 + 0.5*t**2 - 0.2*t**3 + w*t", 7, bodies=load), tmp_path / "out")
    t = np.array([0.0, 0.3, 0.7, 1.0, 2.0])
    turn = (t, 0.3 + 0.5 * t**2 - 0.2 * t**3, "cubic")
    tight = {"rtol": 1e-12, "atol": 1e-12}
    found = by_input.simulate(TIMES, inputs=turn, sensitivities=["r", "rod", "w"], **tight)
    expected = written.simulate(TIMES, sensitivities=["r", "rod", "w"], **tight)
    assert error(found.outputs, expected.outputs) < 1e-10 and error(found.doutputs, expected.doutputs) < 1e-9
    wanted, names = [Integral("torque"), Final("x")], ["r", "w", "inputs.turn", "inputs.turn[2]"]
    forward, adjoint = (
        by_input.judge(2.0, wanted, inputs=turn, wrt=names, method=m, **tight) for m in ("forward", "adjoint")
    )
    assert error(adjoint.gradients, forward.gradients) < 1e-10


def test_a_spline_that_is_at_rest_at_its_ends_is_held_beyond_them(trolley, tmp_path: Path) -> None:
    """Its acceleration jumps there, in both directions of time, and the motion knows: that of a smooth step written out."""
    smooth = made(
        TROLLEY.replace("WAY", "if(t < 0.5, 0, if(t > 1.5, 1, 3*(t - 0.5)**2 - 2*(t - 0.5)**3))"), tmp_path / "smooth"
    )
    rest = CubicHermiteSpline([0.5, 1.5], [0.0, 1.0], [0.0, 0.0])
    found = trolley.simulate(TIMES, inputs={"way": rest}, rtol=1e-12, atol=1e-12)
    expected = smooth.simulate(TIMES, rtol=1e-12, atol=1e-12, largest_step=0.01)
    assert error(found.outputs[:, :3], expected.outputs[:, :3]) < 1e-9


@pytest.mark.parametrize(
    "way, says",
    [
        ((TIMES, np.sin(TIMES)), "joined by straight lines.*'cubic'"),
        ((TIMES, np.sin(TIMES), "hold"), "held from one time to the next.*'cubic'"),
        ((TIMES[:5], np.sin(TIMES[:5]), "cubic"), r"jumps from 0\.5.* to 0 at t = 1 s.*held after its last time"),
        ((TIMES + 1, np.sin(TIMES), "cubic"), r"jumps from 0 to .* at t = 1 s.*held before its first time"),
        (BSpline([0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2], [0, 1, 2, 3, 1, 0, 1], 3), "the velocity of 'way'.* at t = 1 s"),
        (BSpline([0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2], [0, 1, 2, 3, 1, 0, 1, 2], 3), "the value of 'way'.* at t = 1 s"),
        (lambda t: abs(t - 1), "not smooth.*t = 1.*'cubic'"),
        (lambda t: [t, t], r"shape \(2,\), expected \(1,\)"),
        (BSpline([0, 0, 1, 2, 2], [0, 1, 0], 1), "joined by straight lines"),
    ],
)
def test_inputs_whose_velocity_jumps_are_refused(trolley, way, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        trolley.simulate(2.0, inputs={"way": way})


def test_constant_inputs_of_prescribed_motion_stand_still(trolley) -> None:
    for inputs in ([0.0, 2.0], {"way": 2.0}, {"way": (TIMES, np.full(9, 2.0))}, {"way": lambda t: 2.0}):
        run = trolley.simulate(TIMES, inputs=inputs)
        assert np.abs(run["x"] - 2.0).max() < 1e-14 and np.abs(run["v"]).max() < 1e-12
    with pytest.raises(ValueError, match=r"'way.rate' is not known.*follow from their values"):
        trolley.simulate(1.0, inputs={"way.rate": 1.0})


def test_energies_at_both_ends_of_a_spline_have_its_velocity(trolley, written_out) -> None:
    found = trolley.simulate(TIMES, inputs={"pull": 0.7, "way": (TIMES, cubic(TIMES), "cubic")}, rtol=1e-11, atol=1e-11)
    expected = written_out.simulate(TIMES, inputs=[0.7], rtol=1e-11, atol=1e-11)
    assert error(found.energy, expected.energy) < 1e-10
