"""Gravity that depends on time or inputs, against constant gravity of the same value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import Model, ModelError, parse_model
from codegen.reference import DenseEngine

TEXT = """\
model: swing
gravity: {gravity}
parameters: {{g: 9.81, length: 0.4}}
inputs: [lift]
bodies:
  base: {{parent: ground, joint: {{type: fixed}}, mass: 3}}
  arm:
    parent: base
    joint: {{type: universal, axes: [x, y]}}
    shape: {{type: cylinder, axis: z, length: length, radius: 0.02, mass: 2, center: [0, 0, -length/2]}}
  frame: {{parent: arm, joint: {{type: fixed, at: [0, 0, -length]}}}}
  hand:
    parent: frame
    joint: {{type: spherical}}
    mass: 1.3
    com: [0.1, length/5, 0]
    inertia: {{xx: 0.1, yy: 0.1, zz: 0.1}}
forces: {{drive: {{type: joint, joint: arm, value: [lift, 0]}}}}
"""


def model(gravity: str) -> Model:
    return parse_model(TEXT.format(gravity=gravity))


def test_it_is_a_force_on_what_moves_and_has_mass() -> None:
    moving = model("[0, sin(t), -g*(1 + lift)]")
    assert moving.gravity is None and [e.name for e in moving.loads] == ["gravity.arm", "gravity.hand"]
    assert model("[0, 0, -g]").loads == () and model("[0, 0, -g]").gravity is not None


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_motion_and_derivatives(tmp_path: Path, target: str) -> None:
    moving = model("[0.3*sin(2*t), 0.1*lift, -g*(1 + 0.2*lift + t**2)]")
    functions = ("accelerations", "sensitivities", "jacobians", "inverse_dynamics")
    codegen.generate(moving, tmp_path / "swing", target=target, functions=functions)
    solver = codegen.load(tmp_path / "swing")
    rng = np.random.default_rng(5)
    q, u = rng.normal(size=6), rng.normal(size=5)
    t, lift = 0.7, 0.4
    frozen = model(f"[{0.3 * np.sin(2 * t)}, {0.1 * lift}, -g*{1 + 0.2 * lift + t**2}]")
    expected = DenseEngine(frozen).accelerations(q, u, None, [lift], t)
    found = solver.accelerations(q, u, None, [lift], t)
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()
    given, wanted = solver.jacobians(q, u, None, [lift], t), DenseEngine(moving).jacobians(q, u, None, [lift], t)
    for name in ("q", "u", "p", "inputs", "t"):
        a, b = getattr(given, name), getattr(wanted, name)
        assert np.abs(a - b).max() <= 1e-11 * np.abs(b).max(), name
    assert np.abs(wanted.t).max() > 1
    tau = solver.inverse_dynamics(q, u, found, None, [lift], t)
    assert np.abs(tau).max() < 1e-11


def test_coordinates_are_refused() -> None:
    with pytest.raises(ModelError, match=r"gravity\[2\]: .*q.arm.1.* is not allowed here|gravity\[2\]: unknown"):
        model("[0, 0, -q.arm.1]")
