# ruff: noqa: E501  (tables of mistakes)
"""Tables: values and slopes in all engines, beyond the ends and exactly at the points; errors."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.tables import natural_spline
from codegen.reference import DenseEngine

MODEL = """\
model: motor
parameters: {peak: 3.0}
inputs: [pull]
tables:
  torque: {x: [0, 1, 2.5, 4], y: [0, peak, 2*peak, 1], outside: linear}
  level: {x: [0, 1], y: [-1, peak], outside: constant}
  drag: {x: [-1, 0, 1, 2, 4], y: [1, 0, 1, 3, -2], kind: cubic, outside: linear}
bodies:
  repeat k in 1..3:
    arm(k): {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  f: {type: joint, joint: arm(1), value: torque(q.arm(1) + 1)}
  g: {type: joint, joint: arm(2), value: drag(q.arm(2)) + pull*level(drag(q.arm(2)))}
  h: {type: joint, joint: arm(3), value: 2*level(u.arm(3))}
"""
X, Y = [-1.0, 0.0, 1.0, 2.0, 4.0], [1.0, 0.0, 1.0, 3.0, -2.0]


def spline(x: float) -> tuple[float, float]:
    """Value and slope of the natural spline, by its equations in one dense system; linear beyond its ends."""
    n = len(X) - 1
    A, b = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    for i in range(n):
        h = X[i + 1] - X[i]
        A[4 * i, 4 * i], b[4 * i] = 1, Y[i]
        A[4 * i + 1, 4 * i : 4 * i + 4], b[4 * i + 1] = [1, h, h**2, h**3], Y[i + 1]
        if i + 1 < n:
            A[4 * i + 2, 4 * i : 4 * i + 6] = [0, 1, 2 * h, 3 * h**2, 0, -1]
            A[4 * i + 3, 4 * i : 4 * i + 7] = [0, 0, 2, 6 * h, 0, 0, -2]
    A[4 * n - 2, 2], A[4 * n - 1, 4 * n - 2 : 4 * n] = 1, [2, 6 * (X[n] - X[n - 1])]
    c = np.linalg.solve(A, b).reshape(n, 4)
    inside = min(max(x, X[0]), X[-1])
    i = min(max(int(np.searchsorted(X, inside)) - 1, 0), n - 1)
    s = inside - X[i]
    slope = c[i] @ [0, 1, 2 * s, 3 * s**2]
    return c[i] @ [1, s, s**2, s**3] + slope * (x - inside), slope


def linear(x: float, outside: str, peak: float) -> tuple[float, float, float]:
    """Value, slope on the left, and derivative with respect to the peak, of the first table, or the second with constant ends."""
    xs, ys, by = (
        ([0, 1, 2.5, 4], [0, peak, 2 * peak, 1], [0, 1, 2, 0]) if outside == "linear" else ([0, 1], [-1, peak], [0, 1])
    )
    i = min(max(int(np.searchsorted(xs, x)) - 1, 0), len(xs) - 2)
    h = xs[i + 1] - xs[i]
    if outside == "constant" and not xs[0] < x <= xs[-1]:
        k = 0 if x <= xs[0] else -1
        return ys[k], 0.0, by[k]
    s = (x - xs[i]) / h
    return ys[i] * (1 - s) + ys[i + 1] * s, (ys[i + 1] - ys[i]) / h, by[i] * (1 - s) + by[i + 1] * s


@pytest.mark.parametrize("target", ["c", "numpy", "dense"])
def test_values_and_slopes(tmp_path: Path, target: str) -> None:
    model = parse_model(MODEL)
    assert model.warnings == ()
    if target == "dense":
        solver = DenseEngine(model)
    else:
        codegen.generate(model, tmp_path / "motor", target=target, functions=("accelerations", "jacobians"))
        solver = codegen.load(tmp_path / "motor")
    for x in (-7.3, -2.0, -1.0, -0.5, 0.0, 0.3, 1.0, 1.7, 2.0, 3.1, 4.0, 5.0, 1e3):
        q, u = [x - 1, x, 0.0], [0.0, 0.0, x]
        udot, J = solver.accelerations(q, u), solver.jacobians(q, u)
        value, slope, by = linear(x, "linear", 3.0)
        assert (udot[0], J.q[0, 0], J.p[0, 0]) == pytest.approx((value, slope, by), rel=1e-13, abs=1e-13)
        value, slope = spline(x)
        assert (udot[1], J.q[1, 1]) == pytest.approx((value, slope), rel=1e-12, abs=1e-12)
        value, slope, by = linear(x, "constant", 3.0)
        assert (udot[2], J.u[2, 2], J.p[2, 0]) == pytest.approx((2 * value, 2 * slope, 2 * by), rel=1e-13, abs=1e-13)


def test_a_natural_spline_of_two_and_of_many_points() -> None:
    assert natural_spline([0, 1], [3, 4]) == [0, 0]
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(0, 10, 120))
    bend = np.array(natural_spline(x, np.sin(x)))
    assert bend[0] == bend[-1] == 0.0 and np.abs(bend + np.sin(x))[30:90].max() < 0.02


def test_in_extended_precision_too() -> None:
    model = parse_model(MODEL)
    with mpmath.workdps(40):
        J = DenseEngine(model, numbers="mpmath").jacobians([0.4, 1.7, 0.0], [0, 0, 0.2])
        assert abs(J.p[0, 0] - (mpmath.mpf(0.4) + 1 - 1) / mpmath.mpf(1.5) - 1) < 1e-15


def test_the_builder_and_submodels_have_tables(tmp_path: Path) -> None:
    b = ModelBuilder("m")
    b.body("a", axis="y", mass=1, inertia={"xx": 1, "yy": 1, "zz": 1})
    b.table("f", [0, 1], [0, 2], outside="linear")
    b.joint_force("g", "a", "f(q.a)")
    assert DenseEngine(b.build()).accelerations([3.0], [0.0]) == [6.0]
    (tmp_path / "motor.yaml").write_text(MODEL)
    outer = "model: o\nsubmodels: {one: {use: motor.yaml, with: {peak: 5}}, two: {use: motor.yaml}}\n"
    model = parse_model(outer, folder=tmp_path)
    assert DenseEngine(model).accelerations([0.0] * 6, [0.0] * 6)[[0, 3]].tolist() == [5.0, 3.0]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("y: [0, peak, 2*peak, 1]", "y: [0, peak, 2*peak]", "m.yaml:5:34: tables.torque.y: 3 values for 4 arguments x; each x needs one y"),
        ("x: [0, 1, 2.5, 4]", "x: [0, 1, 1, 4]", "tables.torque.x[2]: 1 after 1; arguments x must increase"),
        ("x: [0, 1], y: [-1, peak]", "x: [0], y: [-1]", "tables.level.x: 1 points; 2 to 200 are allowed"),
        (", outside: constant", "", "tables.level: key 'outside' is missing"),
        ("outside: constant", "outside: error", "tables.level.outside: 'error'; constant, linear or periodic is allowed: the values beyond"),
        ("kind: cubic", "kind: quintic", "tables.drag.kind: 'quintic'; linear or cubic is allowed"),
        ("y: [1, 0, 1, 3, -2]", "y: [1, 0, 1, peak, -2]", "tables.drag.y[3]: unknown name 'peak'; constants written before it"),
        ("y: [1, 0, 1, 3, -2]", "y: [1, 0, 1, q.arm(1), -2]", "tables.drag.y[3]: "),
        ("value: 2*level(u.arm(3))", "value: 2*levl(u.arm(3))", "forces.h.value: "),
        ("value: 2*level(u.arm(3))", "value: 2*level", "forces.h.value: unknown name 'level'"),
        ("value: 2*level(u.arm(3))", "value: 2*level(u.arm(3))(2)", "forces.h.value: "),
        ("  drag:", "  peak:", "name 'peak' is already taken by a parameter"),
        ("forces:\n  f: {type: joint, joint: arm(1), value: torque(q.arm(1) + 1)}", "forces:", "warning: tables.torque: table 'torque' is not used"),
    ],
)  # fmt: skip
def test_mistakes(old: str, new: str, expected: str) -> None:
    assert old in MODEL
    try:
        found = list(parse_model(MODEL.replace(old, new, 1), "m.yaml").warnings)
    except ModelError as error:
        found = str(error).splitlines()
    assert any(expected in line for line in found), "\n".join(found)
