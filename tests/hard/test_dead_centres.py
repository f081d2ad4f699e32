"""A slider-crank whose independent coordinate is that of the piston passes its dead centres.

There the piston says nothing of the crank. With two partitions the motion goes on with the crank, and so do its derivatives;
with one it ends, and says why.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard import slider

from codegen.runtime import SimulationError

MOTION = {"target": "c", "functions": ("motion",)}
BY = ("g", "rod", "mass", "flywheel")
TIMES = np.linspace(0.0, 2.0, 21)
FULL = {"rtol": 1e-12, "atol": 1e-12}


@pytest.fixture(scope="module")
def by_crank(build: Callable[..., Any]) -> Any:
    return build(slider.model("crank"), **MOTION)


@pytest.fixture(scope="module")
def by_piston(build: Callable[..., Any]) -> Any:
    return build(slider.model("piston"), partitions=2, **MOTION)


@pytest.fixture(scope="module")
def four_bar(build: Callable[..., Any]) -> Any:
    return build((Path(__file__).parents[2] / "examples/four_bar.yaml").read_text(), partitions=3, **MOTION)


def test_values_and_derivatives_go_on_with_the_crank(by_crank: Any, by_piston: Any) -> None:
    """Against a motion in the crank's angle, which has no dead centre, and its energy in closed form."""
    q, u = by_crank.initial
    dp = np.zeros((len(BY), by_crank.np))
    dp[np.arange(len(BY)), [by_crank.parameter_names.index(n) for n in BY]] = 1.0
    _, _, dq, du = by_crank.assemble_sensitivities(
        q, u, dp=dp
    )  # the crank is held, so the piston moves with the lengths
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = by_crank.simulate(TIMES, q, u, sensitivities=BY, **FULL)
        found = by_piston.simulate(TIMES, q, u, sensitivities=BY, dq0=dq, du0=du, **FULL)
    assert by_piston.independent_names == ("piston",)
    assert found.stats["partitions_changed"] >= 1
    dead = np.abs(np.diff(np.floor(expected["q.crank"] / np.pi))).sum()
    assert dead >= 2, "the piston turns round in mid-motion"
    np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=3e-10)
    np.testing.assert_allclose(found.u, expected.u, rtol=0, atol=3e-9)
    for k in range(len(BY)):
        for x, y in ((found.dq[k], expected.dq[k]), (found.du[k], expected.du[k])):
            np.testing.assert_allclose(x, y, rtol=0, atol=2e-9 * np.abs(y).max(), err_msg=BY[k])
    g, crank, rod, mass, flywheel, _ = by_crank.parameters
    total = slider.energy(found["q.crank"], found["u.crank"], g, crank, rod, mass, flywheel)
    np.testing.assert_allclose(total, total[0], rtol=1e-9)
    np.testing.assert_allclose(found["q.piston"], slider.places(found["q.crank"], crank, rod)[1], rtol=0, atol=1e-12)
    assert found.closure_drift < 1e-13


def test_right_after_the_dead_centre(by_crank: Any, by_piston: Any) -> None:
    """A tenth of a millisecond behind it, where the piston hardly moves."""
    q, u = by_crank.initial
    far = by_crank.simulate(2.0, q, u, **FULL)
    n = int(np.flatnonzero(np.diff(np.floor(far["q.crank"] / np.pi)))[0])
    share = (np.ceil(far["q.crank"][n] / np.pi) * np.pi - far["q.crank"][n]) / (
        far["q.crank"][n + 1] - far["q.crank"][n]
    )
    times = np.array([0.0, far.t[n] + share * (far.t[n + 1] - far.t[n]) + 1e-4])
    expected, found = (s.simulate(times, q, u, sensitivities="mass", **FULL) for s in (by_crank, by_piston))
    np.testing.assert_allclose(found.q[1], expected.q[1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.u[1], expected.u[1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.dq[0, 1], expected.dq[0, 1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.du[0, 1], expected.du[0, 1], rtol=0, atol=1e-9)


def test_with_one_choice_of_independents_it_ends_and_says_why(by_piston: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(by_piston, "_manifest", {k: x for k, x in by_piston._manifest.items() if k != "others"})
    with pytest.raises(SimulationError, match=r"--partitions 2") as caught:
        by_piston.simulate(2.0, u={"piston": -4.0})
    reached = caught.value.trajectory
    assert abs(np.sin(reached["q.crank"][-1])) < 0.05
    assert np.isfinite(reached.q).all() and reached.closure_drift < 1e-10


@pytest.mark.parametrize("steps", [4, 12, 16])
def test_a_constant_step_that_is_poor_with_all_independents_changes_them_once_each(four_bar: Any, steps: int) -> None:
    """Stages far behind the state may be poor with each choice; they were tried in turn until no steps were left, or for ever."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = four_bar.simulate([0.0, 5.0], method="rk4", step=5.0 / steps, on_failure="return", most_steps=300)
    assert len(four_bar.partitions) == 3
    assert found.stats["rejected"] <= (3 + 1) * (found.stats["steps"] + 1)
    assert "allow more" not in found.ended
