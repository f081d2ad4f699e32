"""The double pendulum from (90, 90) degrees: sensitivities of a chaotic motion are right, and finally reported as meaningless.

Two points of 1 kg on massless rods of 1 m, g = 9.81 m/s^2, at rest. Reference: the equations of motion in absolute angles and
their variational equations, by extrapolation (Gragg, Bulirsch, Stoer) of order 28 in 40 digits; steps of 1/25 s and 1/40 s agree
to the digits that stand here, but for the last.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from codegen.runtime import Final

MODEL = """
model: chaotic
parameters: {g: 9.81, l: 1.0, m: 1.0}
gravity: [0, 0, -g]
bodies:
  upper: {parent: ground, joint: {type: revolute, axis: -y}, mass: m, com: [0, 0, -l]}
  lower: {parent: upper, joint: {type: revolute, axis: -y, at: [0, 0, -l]}, mass: m, com: [0, 0, -l]}
initial: {q: {upper: pi/2}}
outputs: {kinetic: kinetic_energy}
"""
TIGHT = {"rtol": 1e-13, "atol": 1e-13}
EXACT = {  # t: th1, th2, w1, w2, and their derivatives by th1(0)
    10.0: [-0.56847466401594865, -0.52639372793240715, 6.0783848857619678, -9.6813606817088810,
           -70.960663373035648, 81.328705818270773, -77.022247188637344, 142.65027753400697],
    20.0: [0.748760975479, -25.832461998894, 4.078003969275, 2.779889455387,
           -935845.269063, -213918.215583, 44175.332275, 808395.501857],
}  # fmt: skip
BEYOND = r"have grown beyond 1e\+10: the motion is chaotic"


@pytest.fixture(scope="module")
def pendulum(build: Callable[..., Any]) -> Any:
    return build(MODEL, target="c", functions=("motion", "energies"))


def absolute(rows: Any) -> Any:
    """Angles and speeds relative to the vertical, from those relative to the preceding rod."""
    return np.concatenate([np.cumsum(rows[..., :2], axis=-1), np.cumsum(rows[..., 2:], axis=-1)], axis=-1)


def test_state_and_sensitivities_against_forty_digits(pendulum: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # th1 alone: the lower rod keeps its direction
        found = pendulum.simulate([0.0, *EXACT], dq0=[[1.0, -1.0]], **TIGHT)
    state = absolute(np.hstack([found.q, found.u]))
    along = absolute(np.hstack([found.dq[0], found.du[0]]))
    for row, (t, exact) in enumerate(EXACT.items(), start=1):
        size = np.linalg.norm(exact[4:])
        # what the motion itself makes of an error of 5e-12 at the beginning
        np.testing.assert_allclose(state[row], exact[:4], rtol=0, atol=5e-12 * size, err_msg=f"t = {t}")
        np.testing.assert_allclose(along[row], exact[4:], rtol=0, atol=5e-12 * size * size, err_msg=f"t = {t}")
    assert np.linalg.norm(along[1]) == pytest.approx(194.759601506403, rel=1e-9)
    assert np.linalg.norm(along[2]) == pytest.approx(1255795.41247, rel=1e-5)
    assert found.energy_drift < 1e-11


def test_derivatives_beyond_use_are_told(pendulum: Any) -> None:
    """At 30 s they are 6e11, and a change of 1e-12 rad of the beginning is one of half a radian.

    At the default tolerance the motion is another one by then, with other derivatives.
    """
    with pytest.warns(RuntimeWarning, match=f"sensitivities {BEYOND}"):
        pendulum.simulate([0.0, 30.0], sensitivities="q0.upper", **TIGHT)
    for method in ("forward", "adjoint"):
        with pytest.warns(RuntimeWarning, match=f"gradients {BEYOND}"):
            pendulum.judge(30.0, [Final("kinetic")], wrt="q0.upper", method=method, **TIGHT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pendulum.judge(20.0, [Final("kinetic")], wrt=("q0.upper", "g"), method="adjoint")
