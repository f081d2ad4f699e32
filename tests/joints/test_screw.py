"""Screw joints of bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from body_joints import TREE, dependents, loop_errors, tree_errors, with_joint
from comparison import worst
from random_models import random_seeds, random_state

import codegen
from codegen.listing import list_model
from codegen.model import parse_model
from codegen.model.errors import ModelError
from codegen.reference import DenseEngine, RecursiveEngine

JOINT = "screw, axis: [0.3, w, 1], pitch: 0.2*k - 0.1*l**2"
IN_LOOPS = [
    {"independent": "base, b, c", "closing": "{type: cylindrical, axis: z}", "base": "{type: cylindrical, axis: y}"},
    {"independent": "base", "closing": "{type: universal, axes: [x, z]}", "base": "{type: prismatic, axis: y}"},
]
NUT = """
model: nut
gravity: [0, 0, -9.81]
parameters: {h: 0.01, m: 0.4, J: 3e-4, tau: 0.002}
bodies:
  nut: {parent: ground, joint: {type: screw, axis: z, pitch: h}, mass: m, inertia: {xx: 1e-3, yy: 1e-3, zz: J}}
forces:
  drive: {type: joint, joint: nut, value: tau}
"""


def test_in_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(JOINT, 1, tmp_path / "m")
    assert max(errors.values()) < 1e-11, errors
    constant = tree_errors("screw, axis: -y, pitch: l*k", 1, tmp_path / "constant")
    assert max(constant.values()) < 1e-11, constant


@pytest.mark.parametrize("case", IN_LOOPS, ids=["independent", "dependent"])
def test_in_a_loop(tmp_path: Path, case: dict[str, str]) -> None:
    errors = loop_errors(JOINT, 1, tmp_path / "m", **case)
    assert max(errors.values()) < 1e-10, errors


def test_the_cases_have_dependent_and_independent_speeds() -> None:
    first, second = (dependents(JOINT, 1, **case) for case in IN_LOOPS)
    assert not first & {"b", "c"}
    assert second & {"b", "c"}


def test_a_nut_on_a_threaded_rod(tmp_path: Path) -> None:
    """The nut falls as if it had the mass m + J/h^2; turned by tau, (J + m h^2) udot = tau - m g h."""
    model = parse_model(NUT)
    codegen.generate(model, tmp_path / "nut", target="numpy")
    solver = codegen.load(tmp_path / "nut")
    h, m, J, tau = 0.013, 0.5, 2e-4, 0.003
    p, g = [h, m, J, tau], 9.81
    udot = (tau - m * g * h) / (J + m * h**2)
    np.testing.assert_allclose(solver.accelerations([0.4], [2.0], p), [udot], rtol=1e-14)
    falling = solver.accelerations([0.4], [2.0], [h, m, J, 0.0])
    np.testing.assert_allclose(h * falling, [-m * g / (m + J / h**2)], rtol=1e-14)
    by_h = (-m * g - 2 * m * h * udot) / (J + m * h**2)
    by_m = (-g * h - h**2 * udot) / (J + m * h**2)
    jacobians = solver.jacobians([0.4], [2.0], p)
    np.testing.assert_allclose(jacobians.p, [[by_h, by_m, -udot / (J + m * h**2), 1 / (J + m * h**2)]], rtol=1e-13)
    np.testing.assert_allclose(solver.energies([0.4], [2.0], p), [2 * (J + m * h**2), m * g * h * 0.4], rtol=1e-14)


def test_without_pitch_it_is_a_hinge(tmp_path: Path) -> None:
    """Of a number, of a parameter that is zero, whose derivative is there, and of the hinge."""
    texts = [TREE.replace("k: 1.1", "k: 1.1, h: 0"), *[TREE] * 2]
    joints = ["screw, axis: [0.3, w, 1], pitch: h", "screw, axis: [0.3, w, 1], pitch: 0", "revolute, axis: [0.3, w, 1]"]
    models = [with_joint(text, joint, 1) for text, joint in zip(texts, joints, strict=True)]
    rng = np.random.default_rng(1)
    q, u, p, inputs, t = random_state(rng, models[-1])
    seeds = random_seeds(rng, models[-1], 2)
    found = []
    for model in models:
        codegen.generate(model, tmp_path / "m", target="numpy", functions=("sensitivities", "jacobians"))
        solver, given = codegen.load(tmp_path / "m"), dict(seeds)
        all_p = p
        if "h" in [x.name for x in model.parameters]:
            all_p, given["dp"] = (np.insert(x, 1, 0.0, axis=-1) for x in (p, seeds["dp"]))
            engines = (solver, DenseEngine(model), RecursiveEngine(model))
            by_h, *others = (e.jacobians(q, u, all_p, inputs, t).p[:, 1] for e in engines)
            assert worst([by_h] * 2, others) < 1e-12
            assert np.abs(by_h).max() > 0.1
        found.append(solver.sensitivities(q, u, all_p, inputs, t, **given))
    for udot, moved in found[:-1]:
        np.testing.assert_allclose(udot, found[-1][0], rtol=1e-12)
        assert worst(moved, found[-1][1]) < 1e-12


def test_a_pitch_of_zero_costs_what_a_hinge_costs(tmp_path: Path) -> None:
    counts = []
    for joint in ("screw, axis: y, pitch: 0", "revolute, axis: y"):
        codegen.generate(with_joint(TREE, joint, 1), tmp_path / "m", target="numpy")
        counts.append(codegen.load(tmp_path / "m").operations)
    assert counts[0] == counts[1]


def test_what_a_listing_says_of_it() -> None:
    assert "screw z, pitch h on ground" in "\n".join(list_model(parse_model(NUT)))


def test_it_closes_no_loop_and_says_what_to_do() -> None:
    text = NUT + "loops: {l: {joint: {type: screw, axis: z, pitch: h}, from: nut, to: ground}}\n"
    with pytest.raises(
        ModelError, match=r"a screw joint closes no loop, .* massless body, .* fixed joint at that body"
    ):
        parse_model(text)


def test_a_loop_closed_as_that_message_says(tmp_path: Path) -> None:
    """A slider that a screw on a driven wheel moves: the screw's own body has no mass, a fixed joint holds it on the slider."""
    model = parse_model("""
model: press
gravity: [0, 0, -9.81]
parameters: {h: 0.01, m: 0.4, J: 3e-4, I: 1e-4}
bodies:
  spindle: {parent: ground, joint: {type: revolute, axis: z}, inertia: {zz: J, xx: J, yy: J}}
  thread: {parent: spindle, joint: {type: screw, axis: z, pitch: h}}
  ram: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
loops:
  nut: {joint: {type: fixed}, from: thread, to: ram}
forces:
  drive: {type: joint, joint: spindle, value: 1e-3*t}
""")
    codegen.generate(model, tmp_path / "press", target="numpy")
    solver = codegen.load(tmp_path / "press")
    h, m, J = p = np.array([0.012, 0.5, 2e-4])
    full = np.array([*p, 1e-4])
    q, u = solver.assemble([0.3, -0.3, -0.3 * h], [1.0, -1.0, -h], full)
    spindle = (1e-3 + m * 9.81 * h) / (J + m * h**2)  # turned forward it draws the ram down: its thread stands still
    np.testing.assert_allclose(solver.accelerations(q, u, full, [], 1.0), spindle * np.array([1, -1, -h]), rtol=1e-12)
    derivative = solver.jacobians(q, u, full, [], 1.0).p[0, 0]
    np.testing.assert_allclose(derivative, (m * 9.81 - 2 * m * h * spindle) / (J + m * h**2), rtol=1e-12)
