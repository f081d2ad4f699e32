"""Arrows of forces, against the motion that the generated code computes, and against closed forms."""

import json

import numpy as np
import pytest

import ordernm
from codegen.runtime.standalone.calls.formulas import value_of
from codegen.runtime.standalone.display.forces import KINDS, applied_kinds
from codegen.runtime.standalone.display.viewer import wanted_arrows

FREE = """
model: free
gravity: [0, 0, -9.81]
parameters: {stiffness: 40.0, arm: 0.3}
inputs: [thrust]
tables:
  law: {x: [-1, 0, 2], y: [3, 0, 5], outside: constant}
bodies:
  crate: {parent: ground, joint: {type: free}, mass: 2.5, com: [0.05, 0.02, -0.1], inertia: {xx: 0.2, yy: 0.3, zz: 0.25}}
points:
  hook: {body: crate, at: [arm, 0.1, 0.2]}
forces:
  coil: {type: spring, from: {body: ground, at: [1, 0, 2]}, to: hook, stiffness: stiffness, damping: 3, free_length: 0.4}
  other: {type: spring, from: crate, to: {body: ground, at: [0, -1, 1]}, stiffness: 10 + t}
  attraction: {type: inverse_square, from: hook, to: {body: ground, at: [0, 3, 0]}, strength: 2}
  push: {type: force, on: hook, value: [thrust, "if(u.crate.vx > 0, sqrt(u.crate.vx), 2)", position.hook.z], axes: body}
  drag: {type: force, on: crate, value: [-0.5*velocity.hook.x, law(q.crate.px), -u.crate.vz]}
  twist: {type: torque, on: crate, value: [0.1, arm, 0], axes: body}
"""

CART = """
model: cart
parameters: {k: 3.0}
inputs: [drive]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: [1, 1, 0]}, mass: 2}
  arm: {parent: cart, joint: {type: revolute, axis: z}, mass: 1, com: [0.3, 0, 0], inertia: {zz: 0.1}}
  wheel: {parent: arm, joint: {type: revolute, axis: x}, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  motor: {type: joint, joint: cart, value: drive - k*q.cart + q.wheel}
  servo: {type: joint, joint: arm, value: -k*u.wheel}
motion: {wheel: 2*t}
"""


def made(text, folder):
    ordernm.generate(ordernm.parse_model(text), folder, target="numpy", frames=True)
    return ordernm.load(folder, target="numpy")


def shown(solver, q, u, inputs, t):
    views, p = solver._views, np.array(solver.parameters)
    scene, poses = views._scene(p), views._poses(q, u, p, inputs, t)
    return poses, views._arrows(q, u, p, inputs, scene, poses)


def test_forces_on_a_free_body_are_those_that_accelerate_it(tmp_path):
    """The sum of all arrows and the weight is mass times acceleration of the centre of mass, from the generated code."""
    solver, rng = made(FREE, tmp_path / "free"), np.random.default_rng(3)
    n = 6
    q, u = rng.normal(size=(n, 7)), rng.normal(size=(n, 6))
    u[:, 3] = np.abs(u[:, 3])
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    inputs, t = rng.normal(size=(n, 1)), np.arange(n) * 0.3
    poses, found = shown(solver, q, u, inputs, t)
    assert sorted(found) == ["forces", "torques"]
    motion = solver.frames(q, u, inputs=inputs, t=t, accelerations=True)
    com = poses.rotation[:, 0] @ [0.05, 0.02, -0.1]
    w, dw = motion.angular_velocity[:, 0], motion.angular_acceleration[:, 0]
    acceleration = motion.acceleration[:, 0] + np.cross(dw, com) + np.cross(w, np.cross(w, com))
    total = found["forces"].vectors.sum(axis=1) + [0, 0, -9.81 * 2.5]
    np.testing.assert_allclose(total, 2.5 * acceleration, rtol=1e-12, atol=1e-11)
    arms = found["forces"].places - (poses.position[:, :1] + com[:, None])
    moment = np.cross(arms, found["forces"].vectors).sum(axis=1) + found["torques"].vectors[:, 0]
    inertia = poses.rotation[:, 0] @ np.diag([0.2, 0.3, 0.25]) @ poses.rotation[:, 0].swapaxes(1, 2)
    spin = np.einsum("tij,tj->ti", inertia, dw) + np.cross(w, np.einsum("tij,tj->ti", inertia, w))
    np.testing.assert_allclose(moment, spin, rtol=1e-12, atol=1e-11)


def test_forces_in_joints_are_along_their_axes_and_follow_prescribed_motion(tmp_path):
    solver = made(CART, tmp_path / "cart")
    q, u, t = np.array([[0.2, 0.5]]), np.array([[0.1, 0.3]]), np.array([0.7])
    _, found = shown(solver, q, u, np.array([1.5]), t)
    value = 1.5 - 3 * 0.2 + 1.4
    np.testing.assert_allclose(found["forces"].vectors[0, 0], np.array([1, 1, 0]) / 2**0.5 * value, atol=1e-14)
    np.testing.assert_allclose(found["torques"].vectors[0, 0], [0, 0, -6], atol=1e-14)


@pytest.mark.parametrize("text", [FREE, CART])
def test_kinds_of_a_model_are_those_of_its_arrows(text, tmp_path):
    solver = made(text, tmp_path / "made")
    (q, u), inputs = solver.initial, np.ones(solver.ninputs)
    found = shown(solver, q[None], u[None], inputs, np.zeros(1))[1]
    display = json.loads((solver.folder / "model.json").read_text())["display"]
    assert applied_kinds(display) == list(found) and set(found) <= set(KINDS)


def test_forces_that_have_no_value_have_no_arrow(tmp_path):
    text = FREE.replace("to: hook, stiffness", "to: {body: crate, at: [1, 0, 2]}, stiffness")  # begins without length
    solver = made(text, tmp_path / "made")
    q, u = solver.initial
    _, found = shown(solver, q[None], u[None], np.zeros(1), np.zeros(1))
    assert np.isfinite(found["forces"].vectors).all() and np.isfinite(found["forces"].places).all()
    assert not found["forces"].vectors[0, 0].any()


def test_arrows_that_there_are_not_are_refused(tmp_path):
    solver = made(CART, tmp_path / "cart")
    (q, u), inputs = solver.initial, np.zeros(1)
    poses, found = shown(solver, q[None], u[None], inputs, np.zeros(1))
    from dataclasses import replace

    poses = replace(poses, arrows=found)
    assert wanted_arrows("forces, torques", poses) == {"forces", "torques"}
    with pytest.raises(
        ValueError, match="arrows: 'weights' is not a kind of arrows; allowed are reactions, forces, torques"
    ):
        wanted_arrows(["weights"], poses)
    with pytest.raises(ValueError, match="arrows: there are no reactions: generate the package with reactions"):
        wanted_arrows("reactions", poses)


def test_formulas_are_those_of_the_model_format():
    from codegen.model.parsing import parse

    x = np.linspace(-2, 2, 9)
    for text, expected in (
        ("if(x > 0, sqrt(x), -x)", np.where(x > 0, np.sqrt(np.abs(x)), -x)),
        ("mod(x, 0.3) + x**2/3 - atan2(x, 2)", np.mod(x, 0.3) + x**2 / 3 - np.arctan2(x, 2)),
        ("max(x, 0.5)*step(x, -1, 1)", np.maximum(x, 0.5) * np.clip((x + 1) / 2, 0, 1) ** 3
         * (10 - 15 * np.clip((x + 1) / 2, 0, 1) + 6 * np.clip((x + 1) / 2, 0, 1) ** 2)),
    ):  # fmt: skip
        np.testing.assert_allclose(value_of(json.loads(json.dumps(parse(text).tree)), {"x": x}), expected, atol=1e-14)
    assert np.isinf(value_of(["/", 1.0, 0.0], {}))
