"""Prescribed motion in trees: generated code against both engines, against the free model, and with other gravity."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from comparison import compare, error
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import EVERY, random_seeds, random_state, random_tree

import codegen
from codegen.model import parse_model
from codegen.model.expressions import functions_for
from codegen.reference import DenseEngine, RecursiveEngine

ARM = """
model: arm
gravity: [0, 0, -9.81]
parameters: {a: 0.2, w: 3.0, L: 0.7}
inputs: [f]
bodies:
  base: {parent: ground, joint: {type: prismatic, axis: [0.3, 0.2, 1]}, mass: 2}
  turn: {parent: base, joint: {type: revolute, axis: y, at: [0.1, 0, 0.2]}, mass: 1.5, com: [0.1, 0.2, 0.3],
         inertia: {xx: 0.1, yy: 0.2, zz: 0.15, xy: 0.01}}
  arm: {parent: turn, joint: {type: revolute, axis: x, at: [0, 0, -L]}, mass: 1, com: [0.1, 0, -0.3],
        inertia: {xx: 0.1, yy: 0.2, zz: 0.15, xy: 0.01}}
  nut: {parent: arm, joint: {type: screw, axis: [1, 2, 3], pitch: 0.3*L}, mass: 1, com: [0.1, 0.2, 0.3],
        inertia: {xx: 0.1, yy: 0.2, zz: 0.15}}
  fore: {parent: nut, joint: {type: universal, axes: [y, x], at: [0, 0, -L]}, mass: 1, com: [0.1, 0, -0.3],
         inertia: {xx: 0.1, yy: 0.2, zz: 0.15, xy: 0.01}}
MOTION
forces:
  friction: {type: joint, joint: arm, value: -0.1*u.arm + 0.3*u.turn*q.base}
  brake: {type: joint, joint: turn, value: -0.7*u.turn}
outputs:
  kinetic: kinetic_energy
  potential: potential_energy
"""
MOTION = """
motion:
  base: a*sin(w*t)
  turn: f*t + a*w*t**2
  nut: 0.4 + L*sin(2*t)
  fore.2: 0.3 + L*cos(t)
"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    model = parse_model(ARM.replace("MOTION", MOTION))
    folder = tmp_path_factory.mktemp("arm")
    codegen.generate(model, folder / "arm", target="both", compile="all")
    return model, codegen.load(folder / "arm")


def test_every_function_is_that_of_both_engines(arm) -> None:
    model, solver = arm
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(3), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-12, found


@pytest.mark.parametrize("seed", [2, 5, 7, 21])
def test_random_trees_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, int(rng.integers(2, 5)), EVERY)
    model = with_prescribed(rng, with_random_elements(rng, model) if seed % 2 else model, 0.5)
    codegen.generate(model, tmp_path / "tree", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    solver = codegen.load(tmp_path / "tree")
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(seed), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-11, found


def test_forces_and_accelerations_are_those_of_the_model_set_free(arm) -> None:
    """With the prescribed accelerations imposed, inverse dynamics of the free model asks for the driving forces."""
    model, solver = arm
    q, u, p, inputs, t = random_state(np.random.default_rng(4), model)
    free = DenseEngine(model.released)
    at = dict(zip(model.parameter_names, p, strict=True)) | dict(zip(model.inputs, inputs, strict=True)) | {"t": t}
    whole = {n: {} for n in "qua"}
    for name, x, v, a in zip(model.coordinate_names, q, u, solver.accelerations(q, u, p, inputs, t), strict=True):
        whole["q"][name], whole["u"][name], whole["a"][name] = x, v, a
    for x in model.prescribed:
        for key, e in zip("qua", x.values, strict=True):
            whole[key][x.name] = float(e.evaluate(at))
    Q, U, A = ([whole[k][n] for n in model.released.coordinate_names] for k in "qua")
    asked = dict(zip(model.released.speed_names, free.inverse_dynamics(Q, U, A, p, inputs, t), strict=True))
    driving = solver.driving_forces(q, u, p, inputs, t)
    assert error(driving, [asked[n] for n in solver.prescribed_names]) < 1e-13
    assert max(abs(asked[n]) for n in model.speed_names) < 1e-12


def test_energy_changes_by_the_power_of_driving_forces_and_of_friction(arm) -> None:
    model, solver = arm
    q, u, p, inputs, t = random_state(np.random.default_rng(5), model)
    udot = solver.accelerations(q, u, p, inputs, t)
    at = dict(zip(model.parameter_names, p, strict=True)) | dict(zip(model.inputs, inputs, strict=True)) | {"t": t}
    changes = {"f": at["f.rate"], "f.rate": at["f.acceleration"]}
    (_, _), (dT, dV) = solver.energy_sensitivities(q, u, p, inputs, t, dq=u, du=udot, dt=1.0, dinputs=changes)
    rates = {x.name: float(x.values[1].evaluate(at)) for x in model.prescribed}
    power = solver.driving_forces(q, u, p, inputs, t) @ [rates[n] for n in solver.prescribed_names]
    u_arm = u[solver.speed_names.index("arm")]
    q_base = float(model.prescribed[0].value.evaluate(at))
    power += (-0.1 * u_arm + 0.3 * rates["turn"] * q_base) * u_arm - 0.7 * rates["turn"] ** 2
    assert abs(dT[0] + dV[0] - power) < 1e-12 * (abs(dT[0]) + abs(dV[0]))


def test_derivatives_hold_in_extended_precision(arm) -> None:
    model, solver = arm
    q, u, p, inputs, t = random_state(np.random.default_rng(6), model)
    seeds = random_seeds(np.random.default_rng(7), model, 2)
    with mpmath.workdps(40):
        engine = RecursiveEngine(model, "mpmath")
        expected = engine.sensitivities(q, u, p, inputs, t, **seeds)[1]
        forces = engine.driving_force_sensitivities(q, u, p, inputs, t, **seeds)[1]
    assert error(solver.sensitivities(q, u, p, inputs, t, **seeds)[1], expected) < 1e-14
    assert error(solver.driving_force_sensitivities(q, u, p, inputs, t, **seeds)[1], forces) < 1e-14


PENDULUM = """
model: pendulum
gravity: [0, 0, GRAVITY]
parameters: {a: 0.1, w: 4.0, g: 9.81}
bodies:
BASE
  rod: {parent: PARENT, joint: {type: revolute, axis: y}, mass: 1.3, com: [0.1, 0, -0.4], inertia: {yy: 0.2}}
  tip: {parent: rod, joint: {type: revolute, axis: y, at: [0, 0, -0.8]}, mass: 0.4, com: [0, 0.1, -0.2], inertia: {yy: 0.1}}
MOTION
"""


def test_a_shaken_base_is_a_change_of_gravity(tmp_path: Path) -> None:
    shaken = (
        PENDULUM.replace("GRAVITY", "-g").replace("PARENT", "cart").replace("MOTION", "motion: {cart: a*t**2/2 - w*t}")
    )
    shaken = shaken.replace("BASE", "  cart: {parent: ground, joint: {type: prismatic, axis: z}}")
    still = (
        PENDULUM.replace("GRAVITY", "-g - a").replace("PARENT", "ground").replace("BASE\n", "").replace("MOTION", "")
    )
    solvers = []
    for name, text in (("shaken", shaken), ("still", still)):
        codegen.generate(parse_model(text), tmp_path / name, target="numpy")
        solvers.append(codegen.load(tmp_path / name))
    q, u, p, t = [0.3, -0.7], [1.1, 0.4], [0.7, 3.0, 9.7], 0.6
    udot, others = (s.accelerations(q, u, p, t=t) for s in solvers)
    assert error(udot, others) < 1e-14
    dp = np.eye(3)
    assert error(*(s.sensitivities(q, u, p, t=t, dp=dp)[1] for s in solvers)) < 1e-14


def test_a_locked_joint_is_a_fixed_one(tmp_path: Path) -> None:
    text = PENDULUM.replace("GRAVITY", "-g").replace("PARENT", "ground").replace("BASE\n", "")
    codegen.generate(parse_model(text.replace("MOTION", "motion: {tip: a}")), tmp_path / "locked", target="numpy")
    fixed = text.replace(
        "{type: revolute, axis: y, at: [0, 0, -0.8]}", "{type: fixed, at: [0, 0, -0.8], rpy: [0, a, 0]}"
    )
    codegen.generate(parse_model(fixed.replace("MOTION", "")), tmp_path / "fixed", target="numpy")
    locked, fixed = (codegen.load(tmp_path / n) for n in ("locked", "fixed"))
    assert locked.coordinate_names == fixed.coordinate_names == ("rod",)
    dp = np.eye(3)
    for a, b in zip(
        locked.sensitivities([0.4], [1.2], dp=dp, dq=np.zeros((3, 1))),
        fixed.sensitivities([0.4], [1.2], dp=dp, dq=np.zeros((3, 1))),
        strict=True,
    ):
        assert error(a, b) < 1e-14


def test_a_mechanism_that_is_driven_altogether(tmp_path: Path) -> None:
    text = PENDULUM.replace("GRAVITY", "-g").replace("PARENT", "ground").replace("BASE\n", "")
    model = parse_model(
        text.replace("MOTION", "motion: {rod: a*t, tip: sin(w*t)}\noutputs: {h: {position: tip, axis: z}}")
    )
    codegen.generate(model, tmp_path / "driven", target="numpy")
    solver, engine = codegen.load(tmp_path / "driven"), DenseEngine(model)
    assert (solver.nq, solver.nu, solver.prescribed_names) == (0, 0, ("rod", "tip"))
    p, t = [0.7, 3.0, 9.7], 0.6
    seeds = {"dp": np.eye(3), "dt": np.ones(3)}
    for name in ("driving_force_sensitivities", "output_sensitivities", "energy_sensitivities"):
        for a, b in zip(
            getattr(solver, name)([], [], p, t=t, **seeds), getattr(engine, name)([], [], p, t=t, **seeds), strict=True
        ):
            assert error(a, b) < 1e-13
    assert solver.accelerations([], [], p, t=t).shape == (0,)
    assert solver.jacobians([], [], p, t=t).p.shape == (0, 3)


def test_a_motion_is_integrated_with_what_is_prescribed(arm) -> None:
    """Derivatives of the motion against the same motion with parameters moved: a coarse witness of exact ones."""
    _, solver = arm
    found = solver.simulate([0, 0.8], inputs=[0.3], sensitivities=["a", "w"], rtol=1e-11, atol=1e-11)
    for k, name in enumerate(("a", "w")):
        i, h = solver.parameter_names.index(name), 1e-5
        ends = [
            solver.simulate([0, 0.8], p=solver.parameters + s * np.eye(3)[i], inputs=[0.3], rtol=1e-12, atol=1e-12).q[
                -1
            ]
            for s in (h, -h)
        ]
        assert error(found.dq[k, -1], (ends[0] - ends[1]) / (2 * h)) < 1e-7


SWUNG = """
model: swung
gravity: [0, 0, -9.81]
parameters: {w: 5}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, 0.1], inertia: {yy: 0.1}}
  end: {parent: arm, joint: {type: revolute, axis: y, at: [0.5, 0, 0]}, mass: 1, com: [0.1, 0, 0], inertia: {yy: 0.1}}
motion: {end: MOTION}
"""


@pytest.mark.parametrize(
    ("motion", "t", "rest"), [("0.5*tanh(w*t)", 72, 0.5), ("tanh(400*(t - 1))", 0, -1), ("tanh(w*t)", 290, 1)]
)
def test_a_transition_is_over_far_from_its_middle(motion: str, t: float, rest: float) -> None:
    """Squares of cosh overflow there; rates and all derivatives are those of a joint that stands still."""
    moving, still = (RecursiveEngine(parse_model(SWUNG.replace("MOTION", str(x)))) for x in (motion, rest))
    seeds = {"dq": [[1]], "du": [[2]], "dp": [[1]], "dt": [1]}
    with np.errstate(over="ignore"):
        both = [e.sensitivities([0.3], [0.7], t=t, **seeds) for e in (moving, still)]
    for found, right in zip(*both, strict=True):
        assert error(found, right) < 1e-14


@pytest.mark.parametrize("motion", ["1/cosh(w*t)", "3/cosh(w*t)**2", "w*t/cosh(w*t)**1.5"])
def test_a_pulse_by_cosh_is_over_far_from_its_middle(motion: str) -> None:
    model, still = (parse_model(SWUNG.replace("MOTION", x)) for x in (motion, "0"))
    for order in (1, 2):
        at = {"w": 5.0, "t": 0.3}
        right = mpmath.diff(lambda t: model.motion["end"].evaluate({"w": 5, "t": t}, functions_for(mpmath)), 0.3, order)
        assert abs(model.prescribed[0].values[order].evaluate(at) - right) < 1e-12
    with np.errstate(all="ignore"):
        found = RecursiveEngine(model).accelerations([0.3], [0.7], t=290)
    assert error(found, RecursiveEngine(still).accelerations([0.3], [0.7])) < 1e-14
