"""Springs and dampers against rotation: `type: torsion`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from force_elements import TREE, loop_errors, power, problems, tree_errors, with_elements
from random_models import random_state

import codegen
from codegen.model import parse_model
from codegen.reference import DenseEngine
from codegen.runtime import SingularForceError

BALL = (
    "ball: {type: torsion, from: a, to: {body: d, rpy: [0.1, l, 0]}, axis: [0.3, w, 0.4], stiffness: k*(1 + 0.1*pull), "
    "damping: 0.4*l, free_angle: 0.2*t*w}"
)
WALL = "wall: {type: torsion, from: ground, to: c, axis: -y, stiffness: 3}"


def test_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(f"{BALL}\n{WALL}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(f"{BALL}\n{WALL}".replace("from: a", "from: b"), tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


@pytest.mark.parametrize("axis", ["y", "-y", "[0, -2, 0]", "[0.6, w, 0.8]"])
def test_of_a_revolute_joint_the_angle_is_the_joints(axis: str) -> None:
    """Up to half a turn to both sides: the same as a force on the joint, and the same energy."""
    tree = TREE.replace("type: revolute, axis: y", f"type: revolute, axis: {axis}")
    keys = "stiffness: k, damping: 0.3, free_angle: 0.2*t"
    turned = with_elements(tree, f"coil: {{type: torsion, from: ground, to: a, axis: {axis}, {keys}}}")
    joint = with_elements(tree, "coil: {type: joint, joint: a, value: -k*(q.a - 0.2*t) - 0.3*u.a}")
    q, u, p, inputs, t = random_state(np.random.default_rng(1), turned)
    for angle in (-3.1, -1.0, 0.0, 2.0, 3.1):
        q[0] = angle
        one, other = (DenseEngine(m).accelerations(q, u, p, inputs, t) for m in (turned, joint))
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)
        stored = [DenseEngine(m).energies(q, u, p, inputs, t)[1] for m in (turned, joint)]
        np.testing.assert_allclose(stored[0] - stored[1], p[0] * (angle - 0.2 * t) ** 2 / 2, rtol=1e-10, atol=1e-12)


def test_power_is_that_of_the_energy_for_every_rotation() -> None:
    undamped = BALL.replace("damping: 0.4*l, ", "")
    for seed in range(6):
        state = random_state(np.random.default_rng(seed), with_elements(TREE, BALL))
        done, rate, unbalanced = power(with_elements(TREE, undamped), state)
        assert abs(rate) > 1e-3
        np.testing.assert_allclose(done, -rate, rtol=1e-10)
        assert unbalanced < 1e-13
        damped, rate, _ = power(with_elements(TREE, BALL), state)
        assert damped + rate < -1e-6


def test_where_the_angle_is_not_determined_the_element_is_named(tmp_path: Path) -> None:
    model = parse_model("""
model: ball
bodies:
  b: {parent: ground, joint: {type: spherical}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  coil: {type: torsion, from: ground, to: b, axis: z, stiffness: 2}
""")
    package = codegen.generate(model, tmp_path / "m", compile=False).folder
    solver = codegen.load(package, "numpy")
    over = np.array([0.0, 1.0, 0.0, 0.0])
    with pytest.raises(
        SingularForceError, match="torsion coil: one end is turned by half a turn about a line across its axis"
    ):
        solver.accelerations(over, np.ones(3))
    with pytest.raises(ValueError, match="torsion coil: one end is turned by half a turn about a line across its axis"):
        DenseEngine(model).accelerations(over, np.ones(3))
    with pytest.raises(SingularForceError, match="torsion coil"):
        solver.accelerations(np.array([1e-9, 1.0, 0.0, 1e-9]), np.zeros(3))
    nearly = np.array([1e-3, 1.0, 0.0, 1e-3])
    np.testing.assert_allclose(
        solver.accelerations(nearly, np.zeros(3)), DenseEngine(model).accelerations(nearly, np.zeros(3)), rtol=1e-6
    )
    half = np.array([0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.abs(solver.accelerations(half, np.zeros(3))[2]), 2 * math.pi, rtol=1e-12)


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        (
            "{type: torsion, from: ground, to: dd, axis: y, stiffness: 1}",
            "to",
            "unknown point 'dd'; a point or a body*'d'?",
        ),
        (
            "{type: torsion, from: ground, to: ground, axis: y, stiffness: 1}",
            "to",
            "torsion 's' joins the ground to itself, so it turns*",
        ),
        (
            "{type: torsion, from: b, to: c, axis: y, stiffness: 1}",
            "to",
            "torsion 's' joins 'b' to 'c', which the fixed joint of c*",
        ),
        ("{type: torsion, from: a, to: b, axis: w, stiffness: 1}", "axis", "'w' is not an axis; x, y, z*"),
        ("{type: torsion, from: a, to: b, axis: [0, 0, w - 1.2], stiffness: 1}", "axis", "the axis is zero*"),
        ("{type: torsion, from: a, to: b, stiffness: 1}", "", "key 'axis' is missing*"),
        ("{type: torsion, from: a, to: b, axis: y}", "", "key 'stiffness' is missing*"),
        (
            "{type: torsion, from: a, to: b, axis: y, stiffness: q.a}",
            "stiffness",
            "'q.a', which changes with the motion, is not*",
        ),
        (
            "{type: torsion, from: a, to: b, axis: y, stiffness: 1, free_angle: position.tip.x}",
            "free_angle",
            "'position.tip.x', which changes with the motion, is not*without potential energy",
        ),
        (
            "{type: torsion, from: a, to: b, axis: y, stiffness: 1, free_length: 1}",
            "free_length",
            "*did you mean 'free_angle'?",
        ),
    ],
)
def test_what_is_wrong_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"s: {entry}")
    assert found.startswith(f"forces.s{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found
