"""Cylindrical joints of bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from body_joints import accelerations_and_mujocos, dependents, loop_errors, tree_errors

from codegen.mechanics.joints.cylindrical import Cylindrical
from codegen.mechanics.structure.links import parts_of
from codegen.model.joints import JOINTS

JOINT = "cylindrical, axis: [0.3, w, 1]"
IN_LOOPS = [
    {"independent": "base, b.1, b.2, c.1", "closing": "{type: spherical}", "base": "{type: revolute, axis: y}"},
    {"independent": "base", "closing": "{type: universal, axes: [x, z]}", "base": "{type: prismatic, axis: y}"},
]


def test_in_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(JOINT, 2, tmp_path / "m")
    assert max(errors.values()) < 1e-11, errors
    constant = tree_errors("cylindrical, axis: -y", 2, tmp_path / "constant")
    assert max(constant.values()) < 1e-11, constant


@pytest.mark.parametrize("case", IN_LOOPS, ids=["independent", "dependent"])
def test_in_a_loop(tmp_path: Path, case: dict[str, str]) -> None:
    errors = loop_errors(JOINT, 2, tmp_path / "m", **case)
    assert max(errors.values()) < 1e-10, errors


def test_the_cases_have_dependent_and_independent_speeds() -> None:
    first, second = (dependents(JOINT, 2, **case) for case in IN_LOOPS)
    assert not first & {"b.1", "b.2", "c.1"}
    assert second & {"b.1", "b.2", "c.1", "c.2"}


def test_it_is_one_link() -> None:
    (part,) = parts_of(JOINTS["cylindrical"].motion)
    assert part == (Cylindrical, 0, 0, 0, ())


def test_as_a_slide_and_a_hinge_of_mujoco() -> None:
    rng = np.random.default_rng(1)
    joints = '<joint type="slide" axis="0 3 4"/><joint type="hinge" axis="0 3 4"/>'
    ours, theirs = accelerations_and_mujocos(
        "{type: cylindrical, axis: [0, 3, 4]}", joints, rng.normal(size=3), rng.normal(size=3)
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-11)
