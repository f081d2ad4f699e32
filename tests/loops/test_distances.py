"""Loops closed by a distance: against the dense engine, and reactions along the rod."""

import numpy as np
import pytest

import codegen
from codegen.reference import DenseEngine

TEXT = """
model: rodded
gravity: [0, 0, -9.81]
parameters: {l: 0.7, r: 0.4}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, mass: 1.5, com: [0, 0, 0.15], inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
  rocker: {parent: ground, joint: {type: revolute, axis: y, at: [0.6, 0, 0]}, mass: 1, com: [0.1, 0, 0.3],
    inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
loops:
  rod: {joint: {type: distance, length: l}, from: {body: crank, at: [0, 0, r]}, to: {body: rocker, at: [0, 0, 0.6]}}
initial: {q: {crank: 0.3, rocker: 0.1}}
independent: [crank]
"""


def test_a_distance_agrees_with_the_dense_engine(tmp_path):
    model = codegen.parse_model(TEXT)
    codegen.generate(model, tmp_path / "out", reactions=True)
    solver, engine = codegen.load(tmp_path / "out"), DenseEngine(model)
    q, u = solver.assemble(solver.initial[0], [1.3, 0.0])
    for name, n in (("dq", model.nq), ("du", model.nu), ("dp", 2)):
        found = solver.sensitivities(q, u, **{name: np.eye(n)})
        for x, y in zip(found, engine.sensitivities(q, u, **{name: np.eye(n)}), strict=True):
            np.testing.assert_allclose(x, np.asarray(y, float), rtol=0, atol=1e-12 * np.abs(y).max())
    force = solver.reactions(q, u)[1][0, 3:]
    np.testing.assert_allclose(
        force, np.asarray(engine.reactions(q, u), float)[0, 3:], rtol=0, atol=1e-12 * np.abs(force).max()
    )


def test_a_length_is_positive():
    with pytest.raises(codegen.ModelError, match="no direction"):
        codegen.parse_model(TEXT.replace("l: 0.7", "l: 0.0"))
