"""Joint forces that depend on positions and velocities of points, against equal forces that depend on coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import Model, ModelError, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

JOINTS = {
    "revolute": ("{type: revolute, axis: [1, 2, -2], PLACE}", 1),
    "prismatic": ("{type: prismatic, axis: -y, PLACE}", 1),
    "screw": ("{type: screw, axis: [0, 3, 1], pitch: 0.2, PLACE}", 1),
    "cylindrical": ("{type: cylindrical, axis: [a, 1, 0], PLACE}", 2),
    "planar": ("{type: planar, normal: [0, 1, 1], PLACE}", 3),
    "universal": ("{type: universal, axes: [x, z], PLACE}", 2),
    "spherical": ("{type: spherical, PLACE}", 3),
    "free": ("{type: free, PLACE}", 6),
}
LAW = {
    "points": "(position.eye.x + {i})*k - velocity.eye.x*sin(position.tip.z)",
    "coordinates": "(q.eye + {i})*k - u.eye*sin(height)",
}


def model_of(name: str, law: str) -> Model:
    """Two bodies in series on joints of a type, and an eye that slides along x; `tip` is at rest."""
    joint, freedoms = JOINTS[name]
    values = ", ".join(f'"{LAW[law].format(i=i)}"' for i in range(freedoms))
    lines = [
        "model: seen", "gravity: [0, 0, -9.81]", "parameters: {k: 2.0, a: 0.5, height: 0.7}", "bodies:",
        "  eye: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1.5}",
        f"  base: {{parent: ground, joint: {joint.replace('PLACE', 'at: [1, 0, 0.2]')}, mass: 2, com: [0.1, 0.2, 0.3], "
        "inertia: {xx: 1, yy: 1.2, zz: 1.4}}",
        f"  arm: {{parent: base, joint: {joint.replace('PLACE', 'at: [0.2, -0.3, a], rpy: [0.3, 0.4, 0.5]')}, mass: 1, "
        "com: [0.3, 0.1, -0.2], inertia: {xx: 1, yy: 1.2, zz: 1.4}}",
        "points: {tip: {body: ground, at: [0, 0, height]}}", "forces:",
        f"  on_base: {{type: joint, joint: base, value: [{values}]}}",
        f"  on_arm: {{type: joint, joint: arm, value: [{values}]}}",
    ]  # fmt: skip
    return parse_model("\n".join(lines))


def state(model: Model) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    q, u = rng.uniform(-1, 1, len(model.coordinate_names)), rng.uniform(-1, 1, len(model.speed_names))
    for i, n in enumerate(model.coordinate_names):
        if n.endswith(".qw"):
            q[i : i + 4] /= np.linalg.norm(q[i : i + 4])
    return q, u


@pytest.mark.parametrize("name", JOINTS)
def test_the_same_as_coordinates_in_both_engines(name: str) -> None:
    seen, known = model_of(name, "points"), model_of(name, "coordinates")
    q, u = state(known)
    for engine in (DenseEngine, RecursiveEngine):
        one, other = engine(seen), engine(known)
        np.testing.assert_allclose(one.accelerations(q, u), other.accelerations(q, u), rtol=1e-10, atol=1e-10)
    mine, theirs = DenseEngine(seen).jacobians(q, u), DenseEngine(known).jacobians(q, u)
    for x in ("q", "u", "p"):
        np.testing.assert_allclose(getattr(mine, x), getattr(theirs, x), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "target"), [("revolute", "c"), ("universal", "numpy"), ("free", "numpy"), ("planar", "c")]
)
def test_generated_code(tmp_path: Path, name: str, target: str) -> None:
    seen, known = model_of(name, "points"), model_of(name, "coordinates")
    functions = ("accelerations", "jacobians", "gradients")
    codegen.generate(seen, tmp_path / "seen", target=target, functions=functions)
    solver, engine = codegen.load(tmp_path / "seen"), DenseEngine(known)
    q, u = state(known)
    np.testing.assert_allclose(solver.accelerations(q, u), engine.accelerations(q, u), rtol=1e-10, atol=1e-10)
    mine, theirs = solver.jacobians(q, u), engine.jacobians(q, u)
    back = solver.gradients(q, u, weights=np.eye(len(u)))
    for x in ("q", "u", "p"):
        np.testing.assert_allclose(getattr(mine, x), getattr(theirs, x), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(getattr(back, x), getattr(theirs, x), rtol=1e-9, atol=1e-9)


def test_a_point_that_is_not_there() -> None:
    with pytest.raises(ModelError, match=r"unknown point 'eys' in position\.eys\.x"):
        parse_model(
            "model: m\nbodies:\n  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}\n"
            "forces:\n  f: {type: joint, joint: a, value: position.eys.x}\n"
        )
