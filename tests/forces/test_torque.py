"""Torques on bodies: `type: torque`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from force_elements import TREE, accelerations_and_mujocos, loop_errors, power, problems, tree_errors, with_elements
from random_models import random_state

from codegen.model.errors import ModelError

TURN = (
    "turn: {type: torque, on: d, value: [k*sin(t) + q.a, pull*u.b*position.tip.z, position.top.y*l - 3*velocity.tip.x]}"
)
WHEEL = "wheel: {type: torque, on: c, value: [k, 0, 2*position.d.x**3/(1 + velocity.b.y**2)], axes: body}"


def test_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(f"{TURN}\n{WHEEL}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(
        "turn: {type: torque, on: tip, value: [k*q.a, pull, -3*velocity.tip.x]}\n" + WHEEL, tmp_path / "m"
    )
    assert max(errors.values()) < 1e-9, errors


def test_equal_and_opposite_torques_leave_the_momentum() -> None:
    """Also of places that differ, as a pair of equal and opposite forces at its ends is a torque."""
    pair = "one: {type: torque, on: tip, value: [k, pull, 2]}\nother: {type: torque, on: a, value: [-k, -pull, -2]}"
    state = random_state(np.random.default_rng(1), with_elements(TREE, pair))
    done, _, unbalanced = power(with_elements(TREE, pair), state)
    assert abs(done) > 0.1 and unbalanced < 1e-14
    couple = (
        "turn: {type: torque, on: d, value: [0, 0, 2*k], axes: body}\n"
        "left: {type: force, on: {body: d, at: [1, 0, l]}, value: [0, -k, 0], axes: body}\n"
        "right: {type: force, on: {body: d, at: [-1, 0, l]}, value: [0, k, 0], axes: body}"
    )
    done, _, unbalanced = power(with_elements(TREE, couple), state)
    assert abs(done) < 1e-13 and unbalanced < 1e-13


@pytest.mark.parametrize("axes", ["ground", "body"])
def test_as_in_mujoco(axes: str) -> None:
    turn = f"turn: {{type: torque, on: b, value: [0.3, -2, 0.5], axes: {axes}}}"
    ours, theirs = accelerations_and_mujocos(turn, [0, 0, 0], [0.3, -2, 0.5], [0, 0, 0], axes == "body")
    np.testing.assert_allclose(ours, theirs, rtol=1e-10)


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        ("{type: torque, on: arm, value: [1, 2, 3]}", "on", "unknown point 'arm'; a point or a body is allowed: *"),
        (
            "{type: torque, on: ground, value: [1, 2, 3]}",
            "on",
            "torque 'n' acts on the ground, which it cannot move; a body*",
        ),
        ("{type: torque, on: d, value: 3}", "value", "'3'; three numbers are needed*"),
        (
            "{type: torque, on: d, value: [1, 2, velocity.tipp.x]}",
            "value[2]",
            "unknown point 'tipp' in velocity.tipp.x; *'tip'?",
        ),
        (
            "{type: torque, on: d, value: [1, 2, 3], axes: [0, 0, 1]}",
            "axes",
            "a list of 3; ground or body is allowed: along*",
        ),
        ("{type: torque, body: d, value: [1, 2, 3]}", "body", "unknown key 'body'; *did you mean 'on'?"),
        ("{type: torque, value: [1, 2, 3]}", "", "key 'on' is missing*"),
        ("{type: moment, on: d, value: [1, 2, 3]}", "type", "unknown force type 'moment'; *did you mean 'torque'?"),
    ],
)
def test_what_is_wrong_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"n: {entry}")
    assert found.startswith(f"forces.n{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found


def test_a_torque_on_what_is_fixed_to_the_ground_is_refused() -> None:
    fixed = TREE.replace("bodies:\n", "bodies:\n  wall: {parent: ground, joint: {type: fixed}, mass: 1}\n")
    with pytest.raises(ModelError, match="torque 'n' acts on 'wall', which is fixed to the ground, so it moves"):
        with_elements(fixed, "n: {type: torque, on: wall, value: [1, 2, 3]}")
