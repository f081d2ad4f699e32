"""Friction and limits of joints: their formulas in all engines, dissipated power, and messages about mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import ModelError, parse_model
from codegen.reference import DenseEngine

MODEL = """\
model: stops
parameters: {dry: 0.8, k: 300.0, end: 0.5}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  slide: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  ball: {parent: ground, joint: {type: universal, axes: [x, y]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  rub: {type: friction, joint: arm, coulomb: dry, viscous: 0.3, velocity: 2 deg/s}
  stop: {type: limit, joint: slide, lower: -20 cm, upper: end, stiffness: k, damping: 4 N*s/m, width: 1 cm}
"""
WIDTH = 0.01


def stop(x: float, u: float, k: float, end: float) -> float:
    """The force of a stop, as a piecewise formula."""
    force = 0.0
    for sign, beyond in ((1, -0.2 - x), (-1, x - end)):
        if beyond > WIDTH:
            force += sign * k * (beyond - WIDTH / 2) - 4 * u
        elif beyond > 0:
            force += sign * k * beyond**2 / (2 * WIDTH) - 4 * u * beyond / WIDTH
    return force


@pytest.mark.parametrize("target", ["c", "numpy", "dense"])
def test_forces_and_derivatives(tmp_path: Path, target: str) -> None:
    model = parse_model(MODEL)
    solver = DenseEngine(model)
    if target != "dense":
        codegen.generate(model, tmp_path / "stops", target=target, functions=("accelerations", "jacobians"))
        solver = codegen.load(tmp_path / "stops")
    v = np.deg2rad(2)
    for x in (-0.3, -0.205, -0.2, 0.1, 0.5, 0.504, 0.51, 0.9):
        for w in (-3.0, 0.0, 0.01):
            q, u, p = [0.2, x, 0, 0], [w, 0.7, 0, 0], [0.8, 300.0, 0.5]
            udot, J = solver.accelerations(q, u, p), solver.jacobians(q, u, p)
            assert udot[0] == pytest.approx(-0.8 * np.tanh(w / v) - 0.3 * w, rel=1e-14, abs=1e-15)
            assert udot[1] == pytest.approx(stop(x, 0.7, 300.0, 0.5), rel=1e-12, abs=1e-15)
            assert J.u[0, 0] == pytest.approx(-0.8 / v / np.cosh(w / v) ** 2 - 0.3, rel=1e-13)
            assert J.p[1, 1] == pytest.approx((stop(x, 0, 300.0, 0.5)) / 300, rel=1e-12, abs=1e-15)
            slope = stop_slope(x, 0.7)
            assert J.q[1, 1] == pytest.approx(slope, rel=1e-10, abs=1e-12)
            assert J.p[1, 2] == pytest.approx(-slope if x > 0 else 0, rel=1e-10, abs=1e-12)


def stop_slope(x: float, u: float) -> float:
    """The derivative of the stop's force with respect to x, piecewise; only the damper's part is not smooth."""
    slope = 0.0
    for sign, beyond in ((-1, -0.2 - x), (1, x - 0.5)):
        if beyond > WIDTH:
            slope -= 300
        elif beyond > 0:
            slope -= 300 * beyond / WIDTH + sign * 4 * u / WIDTH
    return slope


def test_a_stop_throws_back_no_faster(tmp_path: Path) -> None:
    codegen.generate(parse_model(MODEL), tmp_path / "stops")
    solver = codegen.load(tmp_path / "stops")
    run = solver.simulate(np.linspace(0, 3, 61), u=[2.0, 1.0, 0, 0])
    assert abs(run.u[-1, 1]) < 1.0 and run.q[:, 1].max() < 0.58 and run.q[:, 1].min() > -0.28
    assert abs(run.u[-1, 0]) < 1e-3


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (", velocity: 2 deg/s", "", "forces.rub.coulomb: coulomb is given without velocity; add velocity"),
        (
            "velocity: 2 deg/s",
            "velocity: 2 m/s",
            "forces.rub.velocity: 2 m/s is a velocity (m/s); a rate (rad/s) is needed",
        ),
        (
            "joint: arm, coul",
            "joint: ball, coul",
            "friction needs a joint with one degree of freedom, and the universal joint 'ball' has 2",
        ),
        ("lower: -20 cm, upper: end, ", "", "forces.stop: a limit has neither lower nor upper"),
        ("stiffness: k, ", "", "forces.stop: key 'stiffness' is missing"),
        (", width: 1 cm", "", "forces.stop: key 'width' is missing"),
        ("velocity: 2 deg/s", "velocity: 0", "forces.rub.velocity: velocity is 0, but the law divides by it"),
        ("viscous: 0.3", "damping: 0.3", "unknown key 'damping'"),
        ("upper: end", "upper: q.arm", "'q.arm', which changes with the motion, is not allowed here"),
    ],
)
def test_mistakes(old: str, new: str, expected: str) -> None:
    assert old in MODEL
    with pytest.raises(ModelError) as info:
        parse_model(MODEL.replace(old, new, 1), "m.yaml")
    assert expected in str(info.value)
    assert len([line for line in str(info.value).splitlines() if "warning" not in line]) == 1
