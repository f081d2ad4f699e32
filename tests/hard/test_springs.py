"""Very stiff springs, and springs of length zero.

A block on a rail with a spring from a point of the rail is linear, and known in closed form with its derivatives. Where a spring
is almost rigid, a swinging block is a pendulum. Where the ends of a spring meet it has no direction: it is named.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from hard.errors import errors
from scipy.integrate import solve_ivp

import codegen
from codegen.reference import DenseEngine
from codegen.runtime import SimulationError, SingularForceError

MODEL = """
model: held
parameters: {k: 250.0, c: 3.0, l0: 0.2, m: 1.5, far: 1.0, g: 9.81}
gravity: [0, 0, -g]
bodies:
  slide: {parent: ground, joint: {type: prismatic, axis: x}}
  block: {parent: slide, joint: {type: prismatic, axis: z}, mass: m}
forces:
  strut: {type: spring, from: block, to: {body: ground, at: [far, 0, 0]}, stiffness: k, damping: c, free_length: l0}
"""
NAMES = ("k", "c", "l0", "m")


@pytest.fixture(scope="module")
def held(build: Callable[..., Any]) -> Any:
    return build(MODEL, target="c", functions=("motion", "accelerations", "sensitivities"))


def closed_form(t: float, k: float, c: float, l0: float, m: float, x0: float) -> Any:
    """The spring's length over time, from l0 + x0 at rest, and its derivatives by k, c, l0, m: real exponents, in 50 digits."""

    def length(k: Any, c: Any, l0: Any, m: Any) -> Any:
        a, b = c / (2 * m), mpmath.sqrt((c / (2 * m)) ** 2 - k / m)
        slow, fast = -(k / m) / (a + b), -a - b
        start = mpmath.mpf(0.2) + x0 - l0
        return l0 + start * (fast * mpmath.exp(slow * t) - slow * mpmath.exp(fast * t)) / (fast - slow)

    with mpmath.workdps(50):
        at = tuple(mpmath.mpf(x) for x in (k, c, l0, m))
        along = [mpmath.diff(length, at, tuple(int(i == j) for j in range(4))) for i in range(4)]
        return float(length(*at)), [float(x) for x in along]


@pytest.mark.parametrize("k, c", [(1e6, 1e5), (1e9, 1e7), (1e12, 1e10)])
def test_stiff_spring_in_closed_form(held: Any, k: float, c: float) -> None:
    """Rates from 1e5 to 1e10 per second beside one of some ten; steps follow the slow one."""
    p = [k, c, 0.2, 1.5, 1.0, 0.0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = held.simulate([0.0, 0.02, 0.1], [0.3, 0.0], [0.0, 0.0], p, sensitivities=NAMES, method="radau",
                              rtol=1e-10, atol=1e-12, atol_sensitivities=1e-8)  # fmt: skip
    for row in (1, 2):
        length, along = closed_form(float(found.t[row]), k, c, 0.2, 1.5, 0.5)
        assert 1.0 - found["q.slide"][row] == pytest.approx(length, rel=1e-9)
        scale = np.array([k, c, 1.0, 1.5])
        np.testing.assert_allclose(-found.dq[:, row, 0] * scale, along * scale, rtol=1e-7, atol=1e-8)
    assert found.stats["steps"] < 400


def test_an_explicit_method_says_what_would_do(held: Any) -> None:
    with pytest.raises(SimulationError, match=r"method='radau' serves stiff models"):
        held.simulate(1.0, [0.3, 0.0], [0.0, 0.0], [1e12, 1e10, 0.2, 1.5, 1.0, 0.0], most_steps=2000)


def test_an_almost_rigid_spring_is_a_pendulums_rod(held: Any) -> None:
    """1e9 N/m, well damped: it stretches by 1e-7 m; the block swings as on a rod of 0.2 m."""
    times = np.array([0.0, 0.2, 0.5])
    found = held.simulate(
        times, [0.8, 0.0], [0.0, 0.2], [1e9, 1e6, 0.2, 1.5, 1.0, 9.81], method="radau", rtol=1e-8, atol=1e-9
    )

    def swing(t: float, y: Any) -> Any:
        return [y[1], -9.81 / 0.2 * np.sin(y[0])]  # from the downward vertical

    exact = solve_ivp(swing, (0, 0.5), [-np.pi / 2, -1.0], method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12).y[0]
    np.testing.assert_allclose(found["q.slide"], 1 + 0.2 * np.sin(exact), rtol=0, atol=3e-7)
    np.testing.assert_allclose(found["q.block"], -0.2 * np.cos(exact), rtol=0, atol=3e-7)


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_springs_of_no_length_are_named(held: Any, target: str) -> None:
    """Down to 1e-100 m they have a direction, and all derivatives their digits; below none."""
    solver = codegen.load(held.folder, target)
    witness = DenseEngine(codegen.parse_model(MODEL), numbers="mpmath")
    p, dp = solver.parameters, np.zeros((3, solver.np))
    dq = np.vstack([np.eye(2), np.zeros(2)])
    dp[2, 2] = 1.0
    for size in (1e-3, 1e-12, 1e-100):
        p[4] = size  # across and along alike
        found, along = solver.sensitivities([0.0, size], [1.0, 2.0], p, dq=dq, dp=dp)
        exact, exact_along = witness.sensitivities([0.0, size], [1.0, 2.0], p, dq=dq, dp=dp)
        assert max(errors([found, *along], [exact, *exact_along])) < 1e-14
    for size in (1e-150, 1e-160, 1e-300, 0.0):
        p[4] = size
        with pytest.raises(SingularForceError, match="spring strut: its ends coincide"):
            solver.sensitivities([0.0, size], [1.0, 2.0], p, dq=dq, dp=dp)
        with pytest.raises(SingularForceError, match="spring strut: its ends coincide"):
            solver.accelerations([0.0, size], [1.0, 2.0], p)


def test_a_motion_that_begins_without_length_is_named(held: Any) -> None:
    with pytest.raises(SimulationError, match="at t = 0 s: spring strut: its ends coincide"):
        held.simulate(1.0, [1.0, 0.0], [0.0, 0.0])


def test_a_spring_of_no_free_length_passes_through_its_end(held: Any) -> None:
    """It pulls in proportion to the way from its end: a harmonic oscillator that swings through the point without direction."""
    p = [250.0, 0.0, 0.0, 1.5, 1.0, 0.0]
    found = held.simulate([0.0, 0.3, 1.0], [0.5, 0.0], [0.0, 0.0], p, sensitivities="k", rtol=1e-11, atol=1e-11)
    w = np.sqrt(250 / 1.5)
    np.testing.assert_allclose(found["q.slide"], 1 - 0.5 * np.cos(w * found.t), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.dq[0, :, 0], 0.25 * found.t * np.sin(w * found.t) * w / 250, rtol=0, atol=1e-9)
