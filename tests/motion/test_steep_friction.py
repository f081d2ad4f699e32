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


LAYER = """
model: layer
parameters: {k: 31.0, mu: 0.7, x0: 0.5, w: 1.0e-3, c: 0.3}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: x, joint: {type: prismatic, axis: x}, mass: 0.4}
forces:
  f: {type: joint, joint: x, value: "-k*q.x - mu*tanh(u.x/w)"}
  g: {type: joint, joint: b, value: "-k*q.b - c*atan(u.b/w)"}
initial: {q: {x: x0, b: 0.3}, u: {x: 1.0}}
outputs: {x: {value: q.x}, b: {value: q.b}}
"""


@pytest.mark.parametrize(("integrator", "allowed"), [("dop853", 1e-7), ("radau", 5e-6)])
def test_layers_that_a_motion_passes(made: Callable[..., Made], integrator: str, allowed: float) -> None:
    """Steps across a steep layer are as short as derivatives need, 4e-5 before; motions at 1e-13 are the reference."""
    solver = made(parsed, LAYER).solver
    by, times = ["k", "mu", "x0", "c"], np.linspace(0.0, 3.0, 61)
    exact = solver.simulate(times, sensitivities=by, rtol=1e-13, atol=1e-14, atol_sensitivities=1e-11).doutputs
    size = np.abs(exact).max(axis=(0, 1))
    found = solver.simulate(times, sensitivities=by, method=integrator)
    assert (np.abs(found.doutputs - exact) / size).max() < allowed
    back = solver.judge(3.0, [Final("x"), Final("b")], wrt=by, method="adjoint", integrator=integrator)
    assert (np.abs(back.gradients - exact[:, -1].T) / size[:, None]).max() < allowed
    h = 1e-5
    ends = [solver.judge(3.0, Final("x"), p={"mu": 0.7 + step}, rtol=1e-13, atol=1e-13).values[0] for step in (h, -h)]
    assert abs((ends[0] - ends[1]) / (2 * h) - exact[1, -1, 0]) < 1e-6 * size[0]
