"""Motions across forces that jump or have a kink: their derivatives in closed form, forward and by the adjoint."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed

from codegen.runtime import Final, Integral, SimulationError

JUMPS = """
model: jumping
parameters: {t0: 0.7, x0: 1.0, s: 0.5, v0: 3.0, mu: 2.0, w: 5.0, h: 0.4, k: 200.0}
inputs: [push]
bodies:
  timed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  band: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  slope: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  kink: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  pushed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  timed: {type: joint, joint: timed, value: "if(t < t0, 1, 0)"}
  band: {type: joint, joint: band, value: "if(q.band > s, -12, -6)"}
  slope: {type: joint, joint: slope, value: "-w - mu*sign(u.slope)"}
  kink: {type: joint, joint: kink, value: "k*max(0, h - q.kink) - 10"}
  pushed: {type: joint, joint: pushed, value: "if(push > mu, 3, 1)"}
initial: {q: {band: x0, kink: x0}, u: {slope: v0}}
outputs:
  timed: {value: q.timed}
  band: {value: q.band}
  slope: {value: q.slope}
  kink: {value: q.kink}
  pushed: {value: q.pushed}
  high: {value: "if(q.band > s, 1, 3)"}
"""
NAMES = ["t0", "x0", "s", "v0", "mu", "w", "h", "k"]

METHODS: list[dict[str, Any]] = [
    {}, {"rtol": 1e-6, "atol": 1e-6}, {"integrator": "radau"}, {"integrator": "radau", "rtol": 1e-6, "atol": 1e-6},
    {"integrator": "rk4", "step": 0.002},
]  # fmt: skip


def closed_forms(kink_end: float) -> tuple[list[float], np.ndarray]:
    """Values and derivatives by `NAMES` at t = 1 s, but for the value of `kink` and its derivatives."""
    t0, x0, s, v0, mu, w = 0.7, 1.0, 0.5, 3.0, 2.0, 5.0
    values, by = [], np.zeros((6, len(NAMES)))
    values.append(t0 * t0 / 2 + t0 * (1 - t0))
    by[0, 0] = 1 - t0
    t1 = math.sqrt((x0 - s) / 6)
    values.append(s - 12 * t1 * (1 - t1) - 3 * (1 - t1) ** 2)
    by_t1 = -12 * (1 - 2 * t1) + 6 * (1 - t1)
    by[1, 1], by[1, 2] = by_t1 / (12 * t1), 1 - by_t1 / (12 * t1)
    t2 = v0 / (w + mu)
    values.append(v0 * t2 / 2 - (w - mu) / 2 * (1 - t2) ** 2)
    by[2, 3] = t2 + (w - mu) * (1 - t2) / (w + mu)
    by[2, 4] = -t2 * t2 / 2 + (1 - t2) ** 2 / 2 - (w - mu) * (1 - t2) * t2 / (w + mu)
    by[2, 5] = -t2 * t2 / 2 - (1 - t2) ** 2 / 2 - (w - mu) * (1 - t2) * t2 / (w + mu)
    values.append(kink_end)
    values.append(0.5 + 0.5 + 3 * 0.5**2 / 2 - 0.5**2 / 2 - 0.5)
    values.append(t1 + 3 * (1 - t1))
    by[5, 1], by[5, 2] = -2 / (12 * t1), 2 / (12 * t1)
    return values, by


def kinked(x0: float, h: float, k: float) -> float:
    """Free fall with 10 m/s^2 onto a spring, and off it again, at t = 1 s."""
    r, t1 = math.sqrt(k), math.sqrt((x0 - h) / 5)
    v, deep = -10 * t1, 10 / k  # oscillates about h - deep
    a = math.hypot(deep, v / r)
    first = math.atan2(-v / r, deep)  # x = h - deep + a cos(r t + first)
    t2 = t1 + (2 * math.pi - 2 * first) / r
    if t2 > 1:
        return h - deep + a * math.cos(r * (1 - t1) + first)
    return h + -v * (1 - t2) - 5 * (1 - t2) ** 2


def derivative(f: Callable[[float], float], x: float, h: float = 1e-4) -> float:
    """Of order six."""
    return sum(c * (f(x + n * h) - f(x - n * h)) for n, c in ((1, 45), (2, -9), (3, 1))) / (60 * h)


@pytest.fixture(scope="module")
def jumping(made: Callable[..., Made]) -> Any:
    return made(parsed, JUMPS).solver


@pytest.mark.parametrize("way", ["forward", "adjoint"])
@pytest.mark.parametrize("options", METHODS, ids=["dop853", "dop853 loose", "radau", "radau loose", "rk4"])
def test_derivatives_across_jumps_and_kinks(jumping: Any, options: dict[str, Any], way: str) -> None:
    values, by = closed_forms(kinked(1.0, 0.4, 200.0))
    for column, name in ((1, 0), (6, 1), (7, 2)):
        at = [1.0, 0.4, 200.0]
        by[3, column] = derivative(
            lambda x, at=at, name=name: kinked(*at[:name], x, *at[name + 1 :]), at[name], 1e-3 * at[name]
        )
    wanted = [Final("timed"), Final("band"), Final("slope"), Final("kink"), Integral("high")]
    found = jumping.judge(1.0, wanted, inputs=[0.0], wrt=NAMES, method=way, **options)
    of_rk4 = options.get("integrator") == "rk4"
    tolerance = 1e-7 if of_rk4 else 300 * options.get("rtol", 1e-9)
    np.testing.assert_allclose(found.values, np.delete(values, 4), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(found.gradients, np.delete(by, 4, axis=0), rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_a_switch_of_a_held_input_moves_with_nothing(jumping: Any, way: str) -> None:
    """The input jumps from 0 to 5 at 0.5 s: the force does then, whatever mu is."""
    push = ([0.0, 0.5, 1.0], [[0.0], [5.0], [5.0]], "hold")
    found = jumping.judge(1.0, Final("pushed"), inputs=push, wrt=["mu"], method=way)
    assert found.values[0] == pytest.approx(0.125 + 0.25 + 0.375, rel=1e-12)
    assert abs(found.gradients[0, 0]) < 1e-13


STUCK = """
model: stuck
parameters: {mu: 4.0, k: 10.0}
bodies: {block: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces: {friction: {type: joint, joint: block, value: "-mu*sign(u.block) - k*q.block"}}
initial: {q: {block: 1.5}}
outputs: {x: {value: q.block}}
"""


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_a_block_that_sticks_is_told_by_name(made: Callable[..., Made], method: str) -> None:
    """From 1.5 m it swings to -0.7 m, where 7 N do push it on, and then to -0.1 m, where friction holds it."""
    solver = made(parsed, STUCK).solver
    with pytest.raises(
        SimulationError, match=r"sign\(u\.block\) in forces\.friction\.value changes its branch"
    ) as ended:
        solver.simulate(10.0, method=method)
    stopped = ended.value.trajectory
    assert stopped.t[-1] == pytest.approx(2 * math.pi / math.sqrt(10), rel=1e-7)
    assert stopped["x"][-1] == pytest.approx(-0.1, abs=1e-7)
    assert stopped.stats["steps"] < 500
