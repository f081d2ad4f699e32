"""Forces on bodies: `type: force`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from force_elements import TREE, accelerations_and_mujocos, loop_errors, power, problems, tree_errors, with_elements
from random_models import random_state

from codegen.model.errors import ModelError
from codegen.pipeline import write_solver

PUSH = "push: {type: force, on: tip, value: [k*sin(t) + q.a, pull*u.b*position.tip.z, position.top.y*l - 3*velocity.tip.x]}"
JET = "jet: {type: force, on: {body: c, at: [0.1, 0, l]}, value: [k, 0, 2*position.d.x**3/(1 + velocity.b.y**2)], axes: body}"
ON_LOOP = "push: {type: force, on: tip, value: [k*sin(t) + q.a, pull, -3*velocity.tip.x]}"


def test_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(f"{PUSH}\n{JET}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(f"{ON_LOOP}\n{JET}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_equal_and_opposite_forces_leave_the_momentum() -> None:
    pair = "one: {type: force, on: tip, value: [k, pull, 2]}\nother: {type: force, on: tip, value: [-k, -pull, -2]}"
    model = with_elements(TREE, pair)
    state = random_state(np.random.default_rng(1), model)
    done, _, unbalanced = power(model, state)
    assert abs(done) < 1e-13 and unbalanced < 1e-14
    alone = with_elements(TREE, pair.splitlines()[0])
    assert power(alone, state)[2] > 1


@pytest.mark.parametrize("axes", ["ground", "body"])
def test_as_in_mujoco(axes: str) -> None:
    """An external force through a point of the second of two links, on a hinge and a ball."""
    push = f"push: {{type: force, on: {{body: b, at: [0.3, -0.2, 0.4]}}, value: [3, -2, 5], axes: {axes}}}"
    ours, theirs = accelerations_and_mujocos(push, [3, -2, 5], [0, 0, 0], [0.3, -0.2, 0.4], axes == "body")
    np.testing.assert_allclose(ours, theirs, rtol=1e-10)


def test_no_position_is_followed_for_a_force_in_the_axes_of_its_body() -> None:
    model = with_elements(TREE.partition("outputs")[0], "push: {type: force, on: tip, value: [k, 1, u.a], axes: body}")
    swept = write_solver(model).program.blocks
    assert any(block.stores for block in swept["loads"].values())
    assert not any(block.stores for name in ("pose", "velocities") for block in swept[name].values())


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        (
            "{type: force, on: tipp, value: [1, 2, 3]}",
            "on",
            "unknown point 'tipp'; a point or a body is allowed: *'tip'?",
        ),
        (
            "{type: force, on: ground, value: [1, 2, 3]}",
            "on",
            "force 'f' acts on the ground, which it cannot move; a body*",
        ),
        ("{type: force, on: tip, value: 3}", "value", "'3'; three numbers are needed*"),
        ("{type: force, on: tip, value: [1, 2]}", "value", "too few numbers; three numbers*"),
        (
            "{type: force, on: tip, value: [1, 2, position.tipp.x]}",
            "value[2]",
            "unknown point 'tipp' in position.tipp.x; *'tip'?",
        ),
        ("{type: force, on: tip, value: [1, 2, q.aa]}", "value[2]", "unknown coordinate 'q.aa'; *"),
        (
            "{type: force, on: tip, value: [1, 2, 3], axes: world}",
            "axes",
            "'world'; ground or body is allowed: along whose*",
        ),
        ("{type: force, at: tip, value: [1, 2, 3]}", "at", "unknown key 'at'; *did you mean 'on'?"),
        ("{type: force, on: tip}", "", "key 'value' is missing*"),
        ("{type: wrench, on: tip, value: [1, 2, 3]}", "type", "unknown force type 'wrench'; *did you mean 'force'?"),
    ],
)
def test_what_is_wrong_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"f: {entry}")
    assert found.startswith(f"forces.f{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found


def test_a_force_on_what_is_fixed_to_the_ground_is_refused() -> None:
    fixed = TREE.replace("bodies:\n", "bodies:\n  wall: {parent: ground, joint: {type: fixed}, mass: 1}\n")
    with pytest.raises(ModelError, match="acts on 'wall', which is fixed to the ground, so it moves nothing"):
        with_elements(fixed, "f: {type: force, on: wall, value: [1, 2, 3]}")
