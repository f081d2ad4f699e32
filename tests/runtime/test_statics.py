"""Equilibria: closed forms, the dense engine, hanging mechanisms, loops, split joints, and messages."""

import warnings

import numpy as np
import pytest
from made_once import solvers
from random_mechanisms import random_mechanisms
from random_models import random_state, random_tree
from resting_models import PENDULUM
from split_mechanisms import BY_HAND, by_hand

import codegen
from codegen.reference import DenseEngine
from codegen.reference.arithmetic import SingularMatrixError
from codegen.runtime import EquilibriumError

CART = """
model: cart
gravity: [0, 0, -9.81]
parameters: {l: 0.7, friction: 0}
inputs: [push]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  rod: {parent: cart, joint: {type: revolute, axis: y}, mass: 0.5, com: [0, 0, -l], inertia: {xx: 0, yy: 0.01, zz: 0}}
forces:
  rail: {type: joint, joint: cart, value: push - friction*u.cart}
initial: {q: {cart: 0.3, rod: 0.5}}
"""

BALL = """
model: ball
gravity: [0, 0, -9.81]
parameters: {l: 0.5, x: 1.0}
points: {tip: {body: bob, at: [0, 0, -l]}, hook: {body: ground, at: [x, 0, -0.2]}}
bodies:
  bob: {parent: ground, joint: {type: spherical}, mass: 2, com: [0, 0, -l], inertia: {xx: 0.02, yy: 0.03, zz: 0.01}}
forces:
  rope: {type: spring, from: tip, to: hook, stiffness: 8, free_length: 0.1}
  twist: {type: joint, joint: bob, value: [0, 0, 0.0 - 0.1*u.bob.wz]}
"""

PARALLELOGRAM = """
model: parallelogram
gravity: [0, 0, -9.81]
parameters: {l: 0.6, m: 1.2, k: 5.0}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 0.5, com: [0, 0, -l/2], inertia: {xx: 0, yy: 0.02, zz: 0}}
  bar: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -l]}, mass: m, com: [0.4, 0, 0],
    inertia: {xx: 0, yy: 0.1, zz: 0}}
  b: {parent: bar, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 0.5, com: [0, 0, l/2],
    inertia: {xx: 0, yy: 0.02, zz: 0}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: b, at: [0, 0, l]}, to: {body: ground, at: [1, 0, 0]}}
forces:
  spring: {type: joint, joint: a, value: -k*(q.a - 0.5)}
initial: {q: {a: 0.3, bar: -0.3, b: 0.3}}
independent: [a]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return solvers(tmp_path_factory, ("statics", "jacobians"))


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_a_pendulum_with_a_motor_is_a_closed_form(made, target):
    """sin q = -tau/(m g l), and its derivatives."""
    solver, tau = made(PENDULUM, target), 4.0
    found = solver.equilibrium(inputs=[tau], sensitivities=("l", "inputs.motor", "m", "J"))
    l, m = 0.8, 1.5
    sine = tau / (m * 9.81 * l)
    q, cosine = np.arcsin(sine), np.sqrt(1 - sine**2)
    assert abs(found.q[0] - q) < 1e-15
    expected = np.array([-sine / l, sine / tau, -sine / m, 0.0]) / cosine
    assert np.abs(found.dq[:, 0] - expected).max() < 1e-15
    assert found.stable is True
    assert not found.relaxed
    assert found.residual < 1e-13
    assert found.names == ("l", "inputs.motor", "m", "J")


def test_the_guess_says_which_equilibrium_and_the_upper_one_is_unstable(made):
    solver = made(PENDULUM)
    up = solver.equilibrium({"rod": 2.9})
    assert abs(up.q[0] - np.pi) < 1e-14
    assert up.stable is False
    assert solver.equilibrium([-0.9]).q[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("guess", [3.1, -2.0, 1.6])
def test_a_pendulum_that_is_let_sink_hangs(made, guess):
    found = made(PENDULUM).equilibrium([guess], relax=True)
    assert abs(found.q[0]) < 1e-14
    assert found.stable is True
    assert found.relaxed
    assert "after relaxation" in repr(found)


@pytest.mark.parametrize("guess", np.linspace(-3.1, 3.1, 23))
def test_a_pendulum_ends_no_further_than_the_next_equilibrium(made, guess):
    found = made(PENDULUM).equilibrium([guess])
    assert min(abs(found.q[0] - x) for x in (-np.pi, 0.0, np.pi)) < 1e-14


def test_the_state_goes_into_sensitivities(made):
    """udot stays zero along the equilibrium."""
    solver = made(PENDULUM)
    state = solver.equilibrium(inputs=[4.0], sensitivities=("l", "inputs.motor"))
    udot, dudot = solver.sensitivities(
        state.q, state.u, inputs=[4.0], dq=state.dq, dp=[[1, 0, 0, 0], [0, 0, 0, 0]], dinputs=[[0.0], [1.0]]
    )
    assert np.abs(udot).max() < 1e-13
    assert np.abs(dudot).max() < 1e-13


def test_no_torque_that_is_too_large_is_balanced(made):
    with pytest.raises(EquilibriumError, match=r"rod still accelerates by .*give a guess nearer") as caught:
        made(PENDULUM).equilibrium(inputs=[20.0])
    assert caught.value.coordinate == "rod"
    assert caught.value.residual > 1.0
    assert caught.value.q.shape == (1,)


def test_a_cart_on_a_rail_stays_where_it_is_and_its_drift_is_told(made):
    solver = made(CART)
    found = solver.equilibrium(sensitivities=("l", "inputs.push"))
    assert abs(found.q[1]) < 1e-15
    assert abs(found.q[0] - 0.3) < 1e-15  # the least steps have none along the rail
    assert found.stable is None
    assert np.abs(np.abs(found.neutral) - [[1.0, 0.0]]).max() < 1e-12
    assert "1 neutral direction (cart most)" in repr(found)
    assert np.abs(found.dq[0]).max() < 1e-15
    assert np.isnan(found.dq[1]).all()  # a push is balanced nowhere


def test_friction_makes_a_cart_stable(made):
    assert made(CART).equilibrium(p={"friction": 1.0}).stable is True


def test_a_push_on_a_cart_has_no_equilibrium(made):
    with pytest.raises(EquilibriumError, match="cart"):
        made(CART).equilibrium(inputs=[1.0])


def test_a_falling_body_has_none(made):
    text = """
model: stone
gravity: [0, 0, -9.81]
bodies:
  stone: {parent: ground, joint: {type: free}, mass: 1, inertia: {xx: 1, yy: 2, zz: 2.5}}
"""
    with pytest.raises(EquilibriumError, match=r"stone\.vz still accelerates by 9.81"):
        made(text).equilibrium()


def test_a_body_in_space_rests_anywhere(made):
    text = (
        "model: stone\nbodies:\n  s: {parent: ground, joint: {type: free}, mass: 1, inertia: {xx: 1, yy: 2, zz: 2.5}}\n"
    )
    found = made(text).equilibrium()
    assert found.iterations == 0
    assert len(found.neutral) == 6
    assert found.stable is None


def test_a_ball_joint_in_its_tangent_space(made):
    """The rod of a spherical pendulum points along the sum of weight and rope; spinning about itself is neutral."""
    solver = made(BALL)
    found = solver.equilibrium(sensitivities=("l", "x"))
    w, x, y, z = found.q
    assert abs(w * w + x * x + y * y + z * z - 1) < 1e-15
    tip = -0.5 * np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    rope = np.array([1.0, 0.0, -0.2]) - tip
    force = 8 * (np.linalg.norm(rope) - 0.1) * rope / np.linalg.norm(rope) + [0, 0, -2 * 9.81]
    assert np.linalg.norm(np.cross(tip, force)) < 1e-13
    assert len(found.neutral) == 1
    assert found.stable is True  # friction stops the spin, and swings about the rest are bounded
    for j, name in enumerate(("l", "x")):
        around = [solver.equilibrium(found.q, p={name: solver.parameters[j] + s}).q for s in (1e-5, -1e-5)]
        assert np.abs((around[0] - around[1]) / 2e-5 - found.dq[j]).max() < 1e-8


def test_a_parallelogram_is_a_closed_form(made):
    """k (a - 0.5) + g l (m + 0.5) sin a = 0, with closed loop: the dependents and derivatives follow."""
    solver = made(PARALLELOGRAM)
    found = solver.equilibrium(sensitivities=("k", "m", "l"))
    a, bar, b = found.q
    l, m, k, g = 0.6, 1.2, 5.0, 9.81
    weight = g * (m + 0.5)
    assert abs(k * (a - 0.5) + weight * l * np.sin(a)) < 1e-14
    assert abs(bar + a) < 1e-14
    assert abs(b - a) < 1e-14
    slope = k + weight * l * np.cos(a)
    expected = -np.array([a - 0.5, g * l * np.sin(a), weight * np.sin(a)]) / slope
    assert np.abs(found.dq - np.outer(expected, [1, -1, 1])).max() < 1e-14
    assert found.stable is True


def test_a_chain_sinks_from_a_guess_that_leads_newton_nowhere(made):
    """Ten rods thrown upward: what is found hangs, or is an equilibrium that is said to be unstable."""
    text = """
model: chain
gravity: [0, 0, -9.81]
bodies:
  repeat k in 1..10:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: y, at: [0, 0, -0.2]}
      mass: 0.3
      com: [0, 0, -0.1]
      inertia: {xx: 0, yy: 0.001, zz: 0}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
"""
    solver, rng = made(text), np.random.default_rng(2)
    for _ in range(6):
        found = solver.equilibrium(rng.uniform(-1.5, 1.5, 10))
        assert np.abs(np.sin(np.cumsum(found.q))).max() < 1e-10  # every rod hangs or stands
        hangs = np.all(np.cos(np.cumsum(found.q)) > 0)
        assert found.stable is bool(hangs)
        assert not found.relaxed or hangs
        sunk = solver.equilibrium(rng.uniform(-1.5, 1.5, 10), relax=True)
        assert sunk.stable is True
        assert np.cos(np.cumsum(sunk.q)).min() > 1 - 1e-14


@pytest.mark.parametrize("name", BY_HAND)
def test_split_joints(made, name):
    """Mechanisms whose rotations are split rest where the dense engine says so, and follow gravity's derivatives."""
    drawn = by_hand(name)
    solver = made(drawn.model)
    found = solver.equilibrium(drawn.q)
    assert np.abs(DenseEngine(drawn.model).accelerations(found.q, found.u)).max() < 1e-9
    assert np.abs(solver.closure(found.q, found.u)[0]).max() < 1e-13


def draws():
    """Random mechanisms and trees with springs and forces, and guesses."""
    for _, drawn in random_mechanisms(2, first=40, bodies=(3, 4), loops=(1, 1)):
        yield drawn.model, drawn[1:6]
    for seed in range(4):
        rng = np.random.default_rng(seed)
        model = random_tree(rng, 4, joints=("fixed", "revolute", "universal", "spherical"), forces=False)
        yield model, random_state(rng, model)._replace(p=np.array([x.value for x in model.parameters]))


@pytest.mark.campaign
def test_random_models_rest_and_follow_parameters(made):
    """At rest for the dense engine; its accelerations stay zero along dq, and its loops closed."""
    met = followed = 0
    for model, (q, _, p, inputs, t) in draws():
        solver, engine = made(model), DenseEngine(model)
        try:
            found = solver.equilibrium(q, p, inputs, t)
        except EquilibriumError as error:
            assert error.residual > 0.0
            continue
        assert np.abs(solver.closure(found.q, found.u, p)[0]).max(initial=0.0) < 1e-9
        names = solver.parameter_names[:3]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            dq = solver.equilibrium(found.q, p, inputs, t, sensitivities=names).dq
        opens = any("redundant condition" in str(w.message) for w in caught)
        met += 1
        for row, seed in zip(dq, np.eye(solver.np), strict=False):
            if opens or np.isnan(row).any():
                continue
            try:
                udot, dudot = engine.sensitivities(found.q, found.u, p, inputs, t, dq=row, dp=seed)
                closed = engine.complete(found.q, found.u, p, dq=row, dp=seed)[1]
            except SingularMatrixError:  # of what the mechanism has sunk into
                continue
            scale = 1.0 + np.abs(solver.jacobians(found.q, found.u, p, inputs, t).q).sum(axis=1)
            size = 1.0 + np.abs(row).max()
            assert np.abs(np.asarray(udot, float) / scale).max() < 1e-8
            assert np.abs(np.asarray(dudot[0], float) / scale).max() < 1e-8 * size
            assert np.abs(np.asarray(closed[0], float) - row).max() < 1e-8 * size
            followed += 1
    assert met >= 4
    assert followed >= 6


def test_what_is_wrong_is_told(made):
    solver = made(PENDULUM)
    with pytest.raises(
        ValueError, match=r"sensitivities: 'lenght' is not known; expected one of l, m, J, c, inputs.motor"
    ):
        solver.equilibrium(sensitivities="lenght")
    with pytest.raises(ValueError, match=r"did you mean 'inputs.motor'"):
        solver.equilibrium(sensitivities=["input.motor"])
    with pytest.raises(ValueError, match=r"a batch of shape \(2,\), expected one state"):
        solver.equilibrium([[0.1], [0.2]])


def test_a_package_of_statics_alone_moves_loops(tmp_path):
    codegen.generate(codegen.parse_model(PARALLELOGRAM), tmp_path / "p", target="numpy", functions=["statics"])
    solver = codegen.load(tmp_path / "p")
    state = solver.equilibrium(sensitivities="l")
    assert solver.linearize(state.q).eigenvalue_sensitivities("l").shape == (1, 2)


def test_packages_without_what_is_needed_say_so(tmp_path):
    codegen.generate(codegen.parse_model(PENDULUM), tmp_path / "p", target="numpy", functions=["accelerations"])
    solver = codegen.load(tmp_path / "p")
    for member in ("equilibrium", "linearize"):
        with pytest.raises(AttributeError, match=rf"without sensitivities, coordinate_rates.*, which {member} needs"):
            getattr(solver, member)()
    assert not (tmp_path / "p" / "_runtime" / "statics").exists()
    codegen.generate(codegen.parse_model(PENDULUM), tmp_path / "s", target="numpy", functions=["statics"])
    assert codegen.load(tmp_path / "s").equilibrium().q[0] == pytest.approx(0.0, abs=1e-15)
    assert len(codegen.load(tmp_path / "s").linearize().C) == 0


def test_a_package_brings_it_along(tmp_path, monkeypatch):
    """The generated package by itself, without codegen's own run time."""
    codegen.generate(codegen.parse_model(BALL), tmp_path / "ball_alone", target="numpy")
    monkeypatch.syspath_prepend(str(tmp_path))
    from ball_alone import Solver  # type: ignore[import-not-found]

    solver = Solver()
    assert type(solver).__module__.startswith("ball_alone")
    state = solver.equilibrium()
    assert solver.linearize(state.q).sensitivities("l").A.shape == (1, 6, 6)
