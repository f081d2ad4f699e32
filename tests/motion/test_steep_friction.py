"""Smooth but steep friction: derivatives stay exact after a fast component has decayed, or a warning is issued."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

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


@pytest.mark.parametrize(("integrator", "allowed"), [("dop853", 1e-7), ("radau", 1e-6)])
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


CHAIN = """
model: steep_chain
parameters: {k: 31.0, mu: 0.7, x0: 0.5, w: 1.0e-3, c: 0.3, v0: 1.0, m: 0.4, a: 0.0}
inputs: [push]
gravity: [0, -3, 0]
bodies:
  x: {parent: ground, joint: {type: JOINT, axis: z}, mass: 1, com: [0.5, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  b: {parent: x, joint: {type: JOINT, axis: z, at: [0.7, 0, 0]}, mass: m, com: [0.5, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  f: {type: joint, joint: x, value: "-k*q.x - mu*(FIRST) + a*sin(7*t) + push"}
  g: {type: joint, joint: b, value: "-k*q.b - c*(SECOND)"}
initial: {q: {x: x0, b: 0.3}, u: {x: v0}}
outputs: {x: {value: q.x}, b: {value: q.b}, vx: {value: u.x}, vb: {value: u.b}}
"""
ALONG = ["k", "mu", "x0", "c", "v0", "m"]
LAWS = ("tanh({v}/w)", "atan({v}/w)", "{v}/sqrt({v}**2 + w**2)", "2*step({v}, -w, w) - 1", "{v}/(abs({v}) + w)")
TIMES = np.linspace(0.0, 2.0, 41)


def chain(joint: str, first: int, second: int) -> Any:
    text = CHAIN.replace("JOINT", joint)
    return parsed(text.replace("FIRST", LAWS[first].format(v="u.x")).replace("SECOND", LAWS[second].format(v="u.b")))


def values(seed: int) -> dict[str, float]:
    """Random parameters, and widths of layers from 1e-4 to 3e-2 rad/s."""
    rng = np.random.default_rng(seed)
    low, high = np.array([[5.0, 60.0], [0.2, 1.5], [0.1, 1.0], [0.1, 0.8], [-2.0, 2.0], [0.2, 1.5]]).T
    return dict(zip(ALONG, rng.uniform(low, high), strict=True)) | {"w": 10.0 ** rng.uniform(-4.0, -1.5)}


def error_across_layers(solver: Any, seed: int, integrator: str) -> float:
    """The largest error of derivatives at many times, relative to their largest value; a motion at 1e-13 is the reference.

    Over the width w of a layer, derivatives change by as much as their own size. So at times inside a layer, an error e of the
    state explains an error e/w of derivatives.
    """
    p = values(seed)
    fine = {"rtol": 1e-13, "atol": 1e-14, "atol_sensitivities": 1e-11}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*stability")
        exact = solver.simulate(TIMES, p=p, sensitivities=ALONG, **fine)
        found = solver.simulate(TIMES, p=p, sensitivities=ALONG, method=integrator)
    errors = np.abs(found.doutputs - exact.doutputs) / np.abs(exact.doutputs).max(axis=(0, 1))
    inside = (np.abs(exact.u) < p["w"]).any(axis=1)
    explained = np.abs(found.u - exact.u).max(axis=1) / p["w"] * inside
    return float((errors.max(axis=(0, 2)) - explained).max())


@pytest.mark.parametrize(("integrator", "allowed"), [("dop853", 1e-6), ("radau", 5e-6)])
def test_layers_of_random_chains(made: Callable[..., Made], integrator: str, allowed: float) -> None:
    """Steps resolve layers as derivatives require; before, 5e-6 to 6e-5 with these values."""
    for laws, seeds in (((2, 3), (0, 6, 7)), ((0, 2), (6, 8))):
        solver = made(chain, "revolute", *laws).solver
        assert max(error_across_layers(solver, seed, integrator) for seed in seeds) < allowed


@pytest.mark.campaign
@pytest.mark.parametrize("laws", [(0, 1), (2, 3), (4, 0), (1, 2), (3, 4), (3, 3)])
def test_campaign_of_layers(made: Callable[..., Made], laws: tuple[int, int]) -> None:
    for joint in ("prismatic", "revolute"):
        solver = made(chain, joint, *laws).solver
        for seed in range(20):
            for integrator, allowed in (("dop853", 1e-6), ("radau", 5e-6)):
                assert error_across_layers(solver, seed, integrator) < allowed, (joint, laws, seed, integrator)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_wide_layers_cost_no_steps(made: Callable[..., Made], integrator: str) -> None:
    """Derivatives along the motion itself include those by time, of forces and of inputs: nothing is steep here."""
    solver = made(chain, "revolute", 0, 2).solver
    given = {"p": {"w": 5.0, "a": 3.0}, "inputs": {"push": (TIMES[::5], np.sin(3.0 * TIMES[::5]), "cubic")}}
    without = solver.simulate(2.0, method=integrator, **given).stats
    along = solver.simulate(2.0, method=integrator, sensitivities=ALONG, **given).stats
    assert along["steps"] + along["rejected"] < 1.1 * (without["steps"] + without["rejected"])


@pytest.mark.parametrize(("step", "along"), [(1e-2, True), (1e-2, False), (5e-4, True), (1e-4, True)])
def test_constant_steps_that_pass_a_layer(made: Callable[..., Made], step: float, along: bool) -> None:
    """Values and derivatives are off by 1e-4 to 0.5; the warning names steps, time and speed."""
    solver = made(chain, "revolute", 0, 2).solver
    with pytest.warns(
        RuntimeWarning, match=r"do not resolve the motion, least of all at t = .* most likely with u\."
    ) as said:
        solver.simulate(TIMES, method="rk4", step=step, sensitivities=ALONG if along else ())
    assert ("errors of derivatives" in str(said[0].message)) == along


def test_constant_steps_that_resolve_a_layer(made: Callable[..., Made]) -> None:
    """No warning, and errors below those at which warnings begin."""
    solver = made(chain, "revolute", 0, 2).solver
    p = {"w": 0.03}
    found = solver.simulate(TIMES, p=p, method="rk4", step=1e-4, sensitivities=ALONG).doutputs
    exact = solver.simulate(TIMES, p=p, rtol=1e-13, atol=1e-14, sensitivities=ALONG).doutputs
    assert (np.abs(found - exact) / np.abs(exact).max(axis=(0, 1))).max() < 1e-6
