"""Rotation of bodies: orthogonal matrices, their quaternions and rates, and the sign of quaternions after half a turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_body
from random_models import random_state

import codegen
from codegen.model import parse_model
from codegen.model.model import GROUND, Model, Output
from codegen.model.outputs import MATRIX, QUATERNION
from codegen.reference import DenseEngine

BALL = """
model: ball
bodies:
  a: {parent: ground, joint: {type: spherical}, mass: 1, inertia: {xx: 1, yy: 2, zz: 1.5}}
outputs:
"""


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    body = some_body(rng, model)
    others = [k for k in range(-1, len(model.bodies)) if k != body]
    found = []
    for entry in ("xy", "zz", *QUATERNION[:3]):
        other = GROUND if rng.random() < 0.3 else others[int(rng.integers(len(others)))]
        found.append(Output(f"rotation_{entry}", "rotation", bodies=(body, other), choice=(entry,)))
    return found


@pytest.mark.parametrize(
    ("body", "other"), [("ring", "ground"), ("ring", "wheel"), ("stand", "wheel"), ("hull", "arm")]
)
def test_matrices_are_orthogonal_and_their_quaternions_have_them(body: str, other: str) -> None:
    lines = [f"{e}: {{rotation: {body}, entry: {e}, relative_to: {other}}}" for e in (*MATRIX, *QUATERNION)]
    engine = DenseEngine(parse_model(TREE + outputs_of("\n".join(lines))))
    seen = Seen(engine, *random_state(np.random.default_rng(4), engine.model))
    R, dR = (np.array([of[e] for e in MATRIX]).reshape(3, 3) for of in (seen.value, seen.rate))
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-14 and np.linalg.det(R) > 0
    w, x, y, z = (seen.value[e] for e in QUATERNION)
    assert w > 0
    v, vx = np.array([x, y, z]), np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert np.abs((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * vx - R).max() < 1e-14
    # the matrix turns with the relative angular velocity, and so does the quaternion: e' = (0, omega) e / 2
    W = dR @ R.T
    assert np.abs(W + W.T).max() < 1e-13
    turning = np.array([W[2, 1], W[0, 2], W[1, 0]])
    rates = np.array([seen.rate[e] for e in QUATERNION])
    expected = np.array([-turning @ v, *(w * turning + np.cross(turning, v))]) / 2
    assert np.abs(rates - expected).max() < 1e-13


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    folder: Path = tmp_path_factory.mktemp("ball") / "ball"
    lines = "\n".join(f"{e}: {{rotation: a, entry: {e}}}" for e in QUATERNION)
    codegen.generate(parse_model(BALL + outputs_of(lines)), folder, target="numpy")
    return codegen.load(folder)


@pytest.mark.parametrize(
    "e",
    [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 0.6, 0.8, 0), (0, -0.6, 0, 0.8), (0.1, 0.7, -0.7, 0.1),
     (-0.5, 0.5, 0.5, 0.5), (1e-9, 0, 0, -1), (-1e-9, 0.3, 0.1, -1), (0.5, 0.5, 0.5, 0.5)],
)  # fmt: skip
def test_the_quaternion_of_a_ball_is_its_own_coordinates(ball: codegen.Solver, e: tuple[float, ...]) -> None:
    """Also where qw is zero, and where components are equal: value and derivative are those of the side that is taken."""
    q = np.array(e, float) * 1.7
    unit = q / np.linalg.norm(q)
    values, along = ball.output_sensitivities(q, np.zeros(3), dq=np.eye(4))
    sign = 1.0 if values @ unit > 0 else -1.0
    assert values[0] >= 0
    assert np.abs(values - sign * unit).max() < 1e-15
    expected = sign * (np.eye(4) - np.outer(unit, unit)) / np.linalg.norm(q)
    assert np.abs(along - expected).max() < 1e-14
    gradients = ball.output_gradients(q, np.zeros(3), weights=np.eye(4))
    assert np.abs(gradients.q - expected).max() < 1e-14
    if e[0] == 0:  # after half a turn the largest component is positive
        assert values[np.argmax(np.abs(values))] > 0


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{rotation: arm}", "rotation needs entry; add entry: qw, qx, qy, qz of the quaternion, or xx, xy"),
        ("{rotation: arm, entry: w}", "'w'; qw, qx, qy, qz, xx, xy, xz, yx, yy, yz, zx, zy or zz is allowed"),
        ("{rotation: amr, entry: qw}", "unknown body 'amr'; *did you mean 'arm'?"),
        ("{rotation: tip, entry: qw}", "unknown body 'tip'; ground or one of"),
        ("{rotation: arm, entry: qw, relative_to: arm}", "relative_to: the rotation of a body relative to itself"),
        (
            "{rotation: ground, entry: qw}",
            "rotation: the rotation of a body relative to itself is constant; two different",
        ),
        ("{rotation: arm, entry: qw, axis: z}", "an axis is given with rotation; axis belongs to"),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert all(part in found for part in said.split("*")), found
