"""Motions with derivatives that begin, or stay, where plain rules give 0 times infinity; remainders as events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import codegen
from codegen.model import parse_model

HERTZ = """\
model: hertz
gravity: [0, 0, -9.81]
parameters: {k: 1e4, m: 0.5, n: 1.5}
bodies:
  ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
forces:
  floor: {type: joint, joint: ball, value: "k*max(0, -q.ball)**n"}
initial: {q: {ball: 0.05}}
outputs: {h: {value: q.ball}, root: {value: sqrt(q.ball - 0.05)*k}}
"""


def bounce(p: tuple[float, float, float]) -> float:
    """The height after 0.15 s."""
    k, m, n = p
    found = solve_ivp(
        lambda t, x: [x[1], -9.81 + k * max(0.0, -x[0]) ** n / m],
        (0, 0.15),
        [0.05, 0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
    )
    return float(found.y[0, -1])


def test_a_bouncing_ball_and_an_output_that_nobody_asks_for(tmp_path: Path) -> None:
    codegen.generate(parse_model(HERTZ), tmp_path / "hertz")
    solver = codegen.load(tmp_path / "hertz")
    p = np.array([1e4, 0.5, 1.5])
    steps = 1e-6 * p
    expected = [(bounce(tuple(p + e)) - bounce(tuple(p - e))) / (2 * e.sum()) for e in np.diag(steps)]
    run = solver.simulate([0, 0.15], sensitivities=["k", "m", "n"], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.dq[-1, :, 0], expected, rtol=1e-5)
    for method in ("forward", "adjoint"):
        judged = solver.judge(0.15, codegen.Final("h"), wrt=["k", "m", "n"], method=method, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(judged.gradients[0], expected, rtol=1e-5)
