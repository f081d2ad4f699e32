"""Friction that is smooth and steep: derivatives stay exact though a fast component has died down."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from motion.models import Made, parsed

from codegen.runtime import Final

MODEL = """
model: steep
parameters: {k: 31.0, mu: 0.7, m: 0.02, c: 2.0, x0: 0.5, w: 1.0e-3}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: x, joint: {type: prismatic, axis: x}, mass: m}
forces:
  f: {type: joint, joint: x, value: "-k*q.x"}
  g: {type: joint, joint: b, value: "-c*q.b - mu*tanh(u.b/w)"}
initial: {q: {x: x0}, u: {x: 1.0, b: 0.03}}
outputs: {x: {value: q.x}, b: {value: q.b}}
"""
BY = ["k", "mu", "m", "c", "x0"]


@pytest.mark.filterwarnings("ignore:.*stability")
def test_steps_at_the_limit_of_stability(made: Callable[..., Made]) -> None:
    """Without a margin errors of derivatives grow there before they show in the state, to 2e-6; forward and adjoint alike."""
    solver = made(parsed, MODEL).solver
    exact = solver.simulate([0.0, 0.3], sensitivities=BY, rtol=1e-12, atol=1e-14).doutputs[:, 1].T
    size = np.abs(exact).max(axis=1, keepdims=True)
    for way in ("forward", "adjoint"):
        found = solver.judge(0.3, [Final("x"), Final("b")], wrt=BY, method=way)
        assert (np.abs(found.gradients - exact) / size).max() < 3e-8


def test_a_warning_names_the_limit(made: Callable[..., Made]) -> None:
    """With derivatives, too."""
    with pytest.warns(RuntimeWarning, match="stability, not accuracy"):
        made(parsed, MODEL).solver.simulate(0.3, sensitivities=BY)
