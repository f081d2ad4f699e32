"""Forces between points of bodies that slide along one direction, so that the points may pass each other.

Near the point where they meet, derivatives keep their digits, whatever the direction is and wherever the line stands: what
is across it is rounding, which the distance divides by itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import codegen
from codegen.reference import DenseEngine, RecursiveEngine

MODEL = """
model: {name}
parameters: {{k: 3, l0: 0.4, c: 0.2, e: 0.7}}
bodies:
  cart: {{parent: ground, joint: {{type: prismatic, axis: {axis}, at: {at}}}, mass: 2}}
points:
  P: {{body: cart, at: {arm}}}
  O: {{body: ground, at: {point}}}
forces:
  f: {{{force}}}
"""
FORCES = {
    "spring": "type: spring, from: O, to: P, stiffness: k, damping: c, free_length: l0",
    "cubic": "type: hardening_spring, from: O, to: P, stiffness: k, hardening: e, free_length: l0",
    "actuator": "type: actuator, from: P, to: O, force: k*(1 + e*position.P.x)",
}
LINES = {
    "aside": ("x", [0, 0.3, 0], [0, 0, 0], [0, 0.3, 0]),  # was a traceback
    "rounding": ("-y", [0.1, 0, 0], [0.2, 0, 0.5], [0.3, 0, 0.5]),
    "in a plane": ("[3, 4, 0]", [0.2, 0.3, 0.1], [0.1, 0.2, 0], [0.3, 0.5, 0.1]),
    "in space": ("[0.3, 0.4, 0.7]", [0.2, 0.3, 0.1], [0.1, 0.2, 0], [0.3, 0.5, 0.1]),
}


def text_of(line: str, force: str) -> str:
    axis, at, arm, point = LINES[line]
    return MODEL.format(name="passing", axis=axis, at=at, arm=arm, point=point, force=FORCES[force])


def expected(force: str, x: float, u: float, start: float, ax: float) -> tuple[float, list[float]]:
    """Acceleration at x from the meeting point, and its derivatives by x, u, k and l0; position.P.x is `start + ax*x`."""
    k, l0, c, e, s = 3.0, 0.4, 0.2, 0.7, np.sign(x)
    stretch = abs(x) - l0
    if force == "spring":
        return -(k * s * stretch + c * u) / 2, [-k / 2, -c / 2, -s * stretch / 2, k * s / 2]
    if force == "cubic":
        slope = k + 3 * e * stretch**2
        return -s * (k * stretch + e * stretch**3) / 2, [-slope / 2, 0.0, -s * stretch / 2, slope * s / 2]
    push = k * (1 + e * (start + ax * x))
    return -s * -push / 2, [s * k * e * ax / 2, 0.0, s * push / k / 2, 0.0]


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("line", LINES)
def test_derivatives_keep_their_digits_where_ends_pass_each_other(tmp_path: Any, line: str, force: str) -> None:
    model = codegen.parse_model(text_of(line, force))
    codegen.generate(model, tmp_path, target="numpy", check=False)
    solvers = [codegen.load(tmp_path), RecursiveEngine(model), DenseEngine(model)]
    along_x = {"aside": 1.0, "rounding": 0.0, "in a plane": 0.6, "in space": 0.3 / np.sqrt(0.74)}[line]
    dp = np.zeros((4, 4))
    dp[2, 0] = dp[3, 1] = 1.0
    for x in (-1.2, 1e-3, -1e-6, 1e-9, -1e-12):
        udot, along = expected(force, x, 0.7, LINES[line][3][0], along_x)
        for solver in solvers:
            found, slopes = solver.sensitivities([x], [0.7], dq=[[1], [0], [0], [0]], du=[[0], [1], [0], [0]], dp=dp)
            np.testing.assert_allclose(found, udot, rtol=3e-15 + 1e-16 / abs(x))
            np.testing.assert_allclose(slopes[:, 0], along, rtol=1e-14 + 1e-16 / abs(x), atol=1e-15)


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_a_motion_through_the_point_is_that_along_x(tmp_path: Any, target: str) -> None:
    """The same body on an oblique line, started at rest beside the point, passes it and comes back, with its derivatives."""
    runs = []
    for line in ("aside", "in space"):
        folder = tmp_path / line.replace(" ", "_")
        codegen.generate(codegen.parse_model(text_of(line, "spring")), folder, target=target, check=False)
        solver = codegen.load(folder)
        runs.append(
            solver.simulate(np.linspace(0, 2, 5), [0.1], [-1.5], sensitivities=("k", "l0"), rtol=1e-10, atol=1e-12)
        )
    assert runs[0]["q.cart"].min() < -0.05
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=1e-8)
    np.testing.assert_allclose(runs[1].dq, runs[0].dq, atol=1e-7)
