"""Planar joints of bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from body_joints import TREE, accelerations_and_mujocos, dependents, loop_errors, tree_errors, with_joint

from codegen.listing import list_model
from codegen.mechanics.structure.system import analyse

JOINT = "planar, normal: [0.3, w, 1]"
IN_LOOPS = [
    {"independent": "base, b, c.1", "closing": "{type: spherical}", "base": "{type: revolute, axis: y}"},
    {"independent": "base, d", "closing": "{type: fixed}", "base": "{type: prismatic, axis: y}"},
]


def test_in_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(JOINT, 3, tmp_path / "m")
    assert max(errors.values()) < 1e-11, errors
    constant = tree_errors("planar, normal: -y", 3, tmp_path / "constant")
    assert max(constant.values()) < 1e-11, constant


@pytest.mark.parametrize("case", IN_LOOPS, ids=["independent", "dependent"])
def test_in_a_loop(tmp_path: Path, case: dict[str, str]) -> None:
    errors = loop_errors(JOINT, 3, tmp_path / "m", **case)
    assert max(errors.values()) < 1e-10, errors


def test_the_cases_have_dependent_and_independent_speeds() -> None:
    first, second = (dependents(JOINT, 3, **case) for case in IN_LOOPS)
    assert not first & {"b.1", "b.2", "b.3", "c.1"}
    assert second & {"b.1", "b.2", "b.3", "c.1", "c.2", "c.3"}


def test_what_a_listing_says_of_it() -> None:
    assert "planar -y at [" in "\n".join(list_model(with_joint(TREE, "planar, normal: -y", 3)))


@pytest.mark.parametrize("normal", ["z", "-z", "[0.3, w, 1]"])
def test_its_two_links_have_the_same_axes(normal: str) -> None:
    system = analyse(with_joint(TREE, f"planar, normal: {normal}", 3), False)
    links = {link.name: (link, kind) for link, kind in zip(system.links, system.kind_of, strict=True)}
    (slides, _), (turn, kind) = links["a.1"], links["a.2"]
    assert kind.aligned and slides.axis == turn.axis and slides.members == []


@pytest.mark.parametrize(
    ("normal", "axes"),
    [("z", ("1 0 0", "0 1 0", "0 0 1")), ("-x", ("0 1 0", "0 0 -1", "-1 0 0")), ("[0, 3, 4]", ("0 -4 3", "5 0 0", "0 3 4"))],
)  # fmt: skip
def test_as_slides_and_a_hinge_of_mujoco(normal: str, axes: tuple[str, str, str]) -> None:
    rng = np.random.default_rng(1)
    slides = [f'<joint type="slide" axis="{a}"/>' for a in axes[:2]]
    joints = "".join([*slides, f'<joint type="hinge" axis="{axes[2]}"/>'])
    joint = f"{{type: planar, normal: {normal}}}"
    ours, theirs = accelerations_and_mujocos(joint, joints, rng.normal(size=4), rng.normal(size=4))
    np.testing.assert_allclose(ours, theirs, rtol=1e-11)
