"""The scale to which pivots of links are compared: it detects joints that move no inertia, even if rounding hides them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from codegen.model import parse_model
from codegen.pipeline import write_solver

ABOUT_Y, ABOUT_X = "type: revolute, axis: y", "type: revolute, axis: x"
ALONG_Z, ALONG_X = "type: prismatic, axis: z", "type: prismatic, axis: x"


def chain(joints: list[str], places: list[float], masses: list[float], tip: float, own: float = 0.0) -> dict[str, Any]:
    """The NumPy module of a chain along z; the last body is a point mass below its joint, each with inertias of its own."""
    bodies = ""
    for k, (joint, place, mass) in enumerate(zip(joints, places, masses, strict=True)):
        parent, com = f"b{k - 1}" if k else "ground", tip if k == len(joints) - 1 else 0.0
        bodies += f"""
  b{k}: {{parent: {parent}, joint: {{{joint}, at: [0, 0, {place}]}}, mass: {mass}, com: [0, 0, {com}],
       inertia: {{xx: {own * mass}, yy: {own * mass}, zz: {own * mass}}}}}"""
    module: dict[str, Any] = {}
    exec(
        write_solver(parse_model(f"model: chain\ngravity: [0, 0, -9.81]\nbodies:{bodies}")).files["chain_numpy.py"],
        module,
    )
    return module


def stopped(module: dict[str, Any], q: list[float]) -> str:
    """The message that names the singular joint of a state; empty if there is none."""
    with np.errstate(all="ignore"):
        try:
            module["accelerations"](np.array(q), np.zeros(len(q)))
        except module["SingularJointError"] as error:
            return str(error)
    return ""


@pytest.mark.parametrize(
    ("joints", "places", "masses", "q"),
    [
        ([ABOUT_Y] * 2, [0, -1], [0, 1], [0.3, 0]),
        ([ABOUT_Y] * 2, [0, -1], [0, 1], [0.3, np.pi]),
        ([ABOUT_Y] * 2, [0, -1e3], [0, 1], [1.1, 0]),
        ([ABOUT_Y] * 3, [0, -1, -0.7], [1e-19] * 2 + [1], [0.3, -1.1, 0.7]),  # three freedoms of a point in a plane
        ([ABOUT_Y, ALONG_Z, ABOUT_Y], [0, -1, 0], [1e-19] * 2 + [1], [0.3, 0.2, 0.9]),
        ([ABOUT_Y, ALONG_Z, ABOUT_Y], [0, -1e3, 0], [1e-19] * 2 + [1], [0.3, 0.2, 0.9]),
        ([ALONG_X, ABOUT_Y, ABOUT_Y], [0, 0, -1], [1e-19] * 2 + [1], [0.3, 0.2, 0.9]),
        ([ABOUT_Y, ABOUT_X, ABOUT_Y], [0, -1, -1], [1e-19] * 2 + [1], [0, 0, 0]),
    ],
)
def test_a_joint_that_moves_no_inertia_stops(
    joints: list[str], places: list[float], masses: list[float], q: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "codegen.model.checks.singular_joint", lambda *_: None
    )  # what the loader finds at the initial state
    assert "nothing outboard" in stopped(chain(joints, places, masses, -1.0), q)


@pytest.mark.parametrize(
    ("joints", "places", "masses", "tip", "own"),
    [
        ([ABOUT_Y] * 2, [0, -1], [0, 1], -1.0, 0.0),
        ([ABOUT_Y] * 2, [0, -1], [1e-12, 1e-12], -1.0, 1e-6),
        ([ABOUT_Y] * 3, [0, -1, -1], [1e-12, 1e-12, 1], -1.0, 1.0),
        ([ABOUT_Y] * 2, [0, -1], [1, 1e-12], -1e-6, 1e-12),  # a tip that hardly weighs on a heavy link
        ([ABOUT_Y] * 2, [0, -1e6], [1e-3, 1e-12], -1.0, 1e-12),
        ([ABOUT_Y] * 2, [0, -1], [1e9, 1e-3], -1e-3, 1e-6),
        ([ALONG_X, ABOUT_Y], [0, -1], [0, 1], -1.0, 0.0),
    ],
)
def test_small_inertias_are_no_zeros(
    joints: list[str], places: list[float], masses: list[float], tip: float, own: float
) -> None:
    module = chain(joints, places, masses, tip, own)
    assert not any(stopped(module, q) for q in np.random.default_rng(1).uniform(0.3, 2.5, (20, len(joints))).tolist())
