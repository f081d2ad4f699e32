"""Springs and dampers along and about three axes: `type: bushing`."""

from __future__ import annotations

import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from comparison import worst
from force_elements import TREE, loop_errors, power, problems, tree_errors, with_elements
from random_models import random_state

import codegen
from codegen import ModelBuilder
from codegen.listing import list_model
from codegen.model import Model, parse_model
from codegen.model.forces import Bushing
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine
from codegen.runtime import SingularForceError

DAMPING = "damping: [0.3, 0.2*l, 0.1], rotational_damping: [0.2, 0.1*k, 0.3]"
BUSH = (
    "bush: {type: bushing, from: {body: a, at: [0.1, l, 0.2], rpy: [0.3, w, 0.1]}, "
    "to: {body: d, at: [0, 0.1, l], rpy: [0.1, l, 0]}, "
    "stiffness: [k, 2, 3*w], preload: [1, pull, w], rotational_stiffness: [k, 2*w, 1 + 0.1*pull], "
    f"rotational_preload: [0.3, 0.2*t, w], {DAMPING}}}"
)
WALL = "wall: {type: bushing, from: ground, to: c, stiffness: [0, 0, 3], rotational_stiffness: [0, 2, 0]}"
DAMPERS = "dampers: {type: bushing, from: c, to: d, damping: [0, 0.4, 0], rotational_damping: [0.3, 0, 0]}"
PUSH = "push: {type: bushing, from: top, to: tip, preload: [0, k, 0]}"
ALL = f"{BUSH}\n{WALL}\n{DAMPERS}\n{PUSH.replace('from: top, to: tip', 'from: ground, to: b')}"

BALL = """
model: ball
parameters: {k: 3}
bodies:
  b: {parent: ground, joint: {type: free}, mass: 1, com: [0.1, 0, 0.2], inertia: {xx: 1, yy: 1.2, zz: 1.1}}
forces:
  mount: {type: bushing, from: {body: ground, at: [0.1, 0.2, 0.3]}, to: {body: b, at: [0.1, 0.2, 0.3]}, stiffness: [4, 5, k],
    rotational_stiffness: [k, 2, 1], rotational_damping: [0, 0.1, 0.2]}
"""
"""At q = 0 the faces coincide."""


def test_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(ALL, tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(ALL.replace("body: a", "body: b"), tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_power_is_that_of_the_energy_and_wrenches_are_opposite() -> None:
    for seed in range(6):
        state = random_state(np.random.default_rng(seed), with_elements(TREE, BUSH))
        done, rate, unbalanced = power(with_elements(TREE, BUSH.replace(f", {DAMPING}", "")), state)
        assert abs(rate) > 1e-3
        np.testing.assert_allclose(done, -rate, rtol=1e-10)
        assert unbalanced < 1e-13
        damped, rate, unbalanced = power(with_elements(TREE, BUSH), state)
        assert damped + rate < -1e-6 and unbalanced < 1e-13


def _ball(tmp_path: Path, text: str = BALL) -> tuple[Model, codegen.Solver]:
    model = parse_model(text)
    return model, codegen.load(codegen.generate(model, tmp_path / "m", compile=False).folder, "numpy")


@pytest.mark.parametrize("angle", [0.0, 1e-40, 1e-25, 1e-14, 1e-9, 1e-5, 1e-2, 1.0, 3.0, 3.14159])
def test_to_all_digits_beside_the_pose_of_rest(tmp_path: Path, angle: float) -> None:
    """Values and derivatives by everything, where quotients of vanishing numbers are, and close to half a turn."""
    model, solver = _ball(tmp_path)
    rng = np.random.default_rng(3)
    axis = np.array([0.6, -0.48, 0.64])
    # `free` begins with places and goes on with a quaternion
    q = np.array([1e-3, 2e-3, -1e-3, math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
    u, seeds = (
        rng.normal(size=6),
        {"dq": rng.normal(size=(3, 7)), "du": rng.normal(size=(3, 6)), "dp": rng.normal(size=(3, 1))},
    )
    seeds["dq"][:, 3:] -= np.outer(seeds["dq"][:, 3:] @ q[3:], q[3:])
    udot, dudot = solver.sensitivities(q, u, **seeds)
    with mpmath.workdps(90):
        exact, dexact = DenseEngine(model, numbers="mpmath").sensitivities(q, u, **seeds)
        exact, dexact = np.array(exact, float), np.array(dexact, float)
    digits = 1e-14 / min(1.0, math.pi - angle)  # what rounding of the pose leaves of the axis
    np.testing.assert_allclose(udot, exact, rtol=0, atol=digits * np.abs(exact).max())
    np.testing.assert_allclose(dudot, dexact, rtol=0, atol=digits / min(1.0, math.pi - angle) * np.abs(dexact).max())


def test_second_derivatives_at_rest(tmp_path: Path) -> None:
    """Of a linearised motion about the pose where the faces coincide: stiffness over inertia, and how it changes with k."""
    _, solver = _ball(tmp_path, BALL.replace("com: [0.1, 0, 0.2]", "com: [0.1, 0.2, 0.3]"))
    found = solver.linearize(solver.equilibrium(q=[0, 0, 0, 1, 0, 0, 0]).q)
    stiffness = found.A[6:, :6]
    expected = np.sort([-4, -5, -3, -3 / 1, -2 / 1.2, -1 / 1.1])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(stiffness).real), expected, rtol=1e-12)


def test_about_one_axis_it_is_a_torsion() -> None:
    bush = "{type: bushing, from: ground, to: a, rotational_stiffness: [0, k, 0], rotational_damping: [0, 0.3, 0]}"
    one = with_elements(TREE, f"coil: {bush}")
    other = with_elements(TREE, "coil: {type: torsion, from: ground, to: a, axis: y, stiffness: k, damping: 0.3}")
    q, u, p, inputs, t = random_state(np.random.default_rng(1), one)
    for angle in (-3.1, -1.0, 0.0, 2.0, 3.1):
        q[0] = angle
        a, b = (DenseEngine(m).accelerations(q, u, p, inputs, t) for m in (one, other))
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)
        a, b = (DenseEngine(m).energies(q, u, p, inputs, t) for m in (one, other))
        np.testing.assert_allclose(a, b, rtol=1e-12)


@pytest.mark.parametrize("k", [0.0, 7.0])
def test_of_equal_stiffness_along_all_axes_it_is_a_spring_without_length(k: float) -> None:
    ends = "from: {body: a, at: [0, 0.1, 0.2]}, to: d"
    one = with_elements(TREE, f"coil: {{type: bushing, {ends}, stiffness: [{k}, {k}, {k}], damping: [1, 1, 1]}}")
    spring = f"coil: {{type: spring, {ends}, stiffness: {k}}}"
    other = with_elements(TREE, spring)
    q, u, p, inputs, t = random_state(np.random.default_rng(1), one)
    u = 0 * u
    for what in ("accelerations", "energies"):
        a, b = (getattr(DenseEngine(m), what)(q, u, p, inputs, t) for m in (one, other))
        np.testing.assert_allclose(a, b, rtol=1e-11)


def test_half_a_turn_is_an_error_that_names_it(tmp_path: Path) -> None:
    model, solver = _ball(tmp_path)
    for call in (
        lambda q: solver.accelerations(q, np.ones(6)),
        lambda q: solver.sensitivities(q, np.ones(6), dp=[[1.0]]),
        lambda q: solver.energy_sensitivities(q, np.ones(6), dp=[[1.0]]),
    ):
        with pytest.raises(SingularForceError, match="bushing mount: one end is turned by half a turn"):
            call(np.array([0, 0, 0, 0, 0.6, 0, 0.8]))
    with pytest.raises(ValueError, match="bushing mount: one end is turned by half a turn"):
        DenseEngine(model).accelerations(np.array([0, 0, 0, 0, 0.6, 0, 0.8]), np.ones(6))


def test_rows_that_are_not_used_leave_no_statement() -> None:
    def text(element: str) -> str:
        return write_solver(with_elements(TREE, f"s: {{type: bushing, from: a, to: d, {element}}}")).files["pushed.c"]

    sliding, turning = text("stiffness: [0, 3, 0]"), text("rotational_stiffness: [0, 3, 0]")
    assert "atan2" in turning and "atan2" not in sliding and "atan2" not in text("rotational_damping: [1, 2, 3]")
    whole = text("stiffness: [1, 2, 3], damping: [4, 5, 6], preload: [7, 8, 9]")
    assert len(sliding) < len(text("stiffness: [1, 3, 0]")) < len(whole)


def test_from_python_and_in_the_listing() -> None:
    b = ModelBuilder("m")
    k = b.parameter("k", 2.0)
    b.body("a", parent="ground", joint="revolute", axis="y", mass=1, inertia={"xx": 1, "yy": 1, "zz": 1})
    b.force("bush", "bushing", start="ground", end="a", stiffness=(k, 0, 1))
    (element,) = b.build().loads
    assert isinstance(element, Bushing) and not element.turns
    line = "bushing wall: from ground to c; stiffness [0, 0, 3], rotational stiffness [0, 2, 0]"
    assert line in [x.strip() for x in list_model(with_elements(TREE, WALL))]


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        ("{type: bushing, from: a, to: dd, stiffness: [1, 1, 1]}", "to", "unknown point 'dd'; a point or a body*'d'?"),
        ("{type: bushing, from: b, to: c, stiffness: [1, 1, 1]}", "to", "bushing 's' joins 'b' to 'c', which the fixed joint*"),
        ("{type: bushing, from: a, to: b}", "", "every coefficient of bushing 's' is zero, so it does nothing; give*"),
        ("{type: bushing, from: a, to: b, stiffness: 3}", "stiffness", "*three numbers are needed*"),
        ("{type: bushing, from: a, to: b, stiffness: [q.a, 0, 0]}", "stiffness[0]", "'q.a', which changes with the motion*"),
        ("{type: bushing, from: a, to: b, torque: [1, 0, 0]}", "torque", "*did you mean 'rotational_preload'?"),
        ("{type: bush, from: a, to: b}", "type", "*did you mean 'bushing'?"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"s: {entry}")
    assert found.startswith(f"forces.s{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found


def test_an_element_that_only_damps_has_no_energy(tmp_path: Path) -> None:
    model = with_elements(TREE, DAMPERS)
    solver = codegen.load(codegen.generate(model, tmp_path / "m", compile=False).folder, "numpy")
    state = random_state(np.random.default_rng(1), model)
    plain = with_elements(TREE, "none: {type: force, on: tip, value: [1, 0, 0]}")
    assert worst([solver.energies(*state[:3])], [DenseEngine(plain).energies(*state)]) < 1e-12


LOADED = """
model: loaded
gravity: [0, 0, -9.81]
parameters: {k: 3, pull: 0.7, l: 0.4, m: 1.3}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: m, com: [l, 0, 0.1], inertia: {xx: 1, yy: 1.2, zz: 1.1}}
  b:
    parent: a
    joint: {type: universal, at: [l, 0, 0], axes: [x, z]}
    mass: 0.8
    com: [0.1, 0, l]
    inertia: {xx: 0.3, yy: 0.2, zz: 0.2}
forces:
  mount: {type: bushing, from: {body: a, at: [l, 0.1, 0]}, to: {body: b, at: [0, 0.1, 0.2]}, stiffness: [4, 5, k],
    rotational_stiffness: [k, 2, 1], rotational_preload: [pull, 0.3, -0.5]}
"""


def test_second_derivatives_near_the_pose_of_rest(tmp_path: Path) -> None:
    """The faces coincide, also up to rounding, nearly coincide, or have the angle at which formulas change."""
    codegen.generate(parse_model(LOADED), tmp_path / "m", functions="hessian_products,gradients", check=False)
    solver = codegen.load(tmp_path / "m")
    u, w, p = [0.3, -0.2, 0.5], [0.7, -0.4, 1.1], solver.parameters

    def gradient(x: np.ndarray) -> np.ndarray:
        g = solver.gradients(x[:3], x[3:6], x[6:], weights=w)
        return np.concatenate([np.ravel(g.q), np.ravel(g.u), np.ravel(g.p)])

    for angle in (0.0, 1e-17, 1e-12, 1e-7, 1e-4, 0.0632, 0.0633, 0.3):
        q = [0.4, angle, 0.6 * angle]
        hessian = solver.hessians(q, u, weights=w, wrt="q, u, p")
        x, size = np.concatenate([q, u, p]), np.abs(hessian).max()
        assert np.abs(hessian - hessian.T).max() < 1e-13 * size, angle
        for i, row in enumerate(hessian):
            ends = [gradient(x + n * 1e-3 * np.eye(len(x))[i]) for n in (1, -1, 2, -2, 3, -3)]
            differences = (45 * (ends[0] - ends[1]) - 9 * (ends[2] - ends[3]) + ends[4] - ends[5]) / 60e-3
            assert np.abs(row - differences).max() < 1e-10 * size, (angle, i)
