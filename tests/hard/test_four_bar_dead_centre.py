"""A crank-rocker with independent rocker, which stops where crank and coupler are in line, while the crank turns.

No method may go over such a point without a word: steps of the implicit one are smooth there, and constant ones know no errors.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard import slider

from codegen.runtime import Final

MODEL = """
model: crank_rocker
gravity: [0, 0, -g]
parameters: {g: 9.81, crank: 0.4, coupler: 1.2, rocker: 0.9, base: 1.1, mass: 1.5, w0: 7.0}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y},
          shape: {type: rod, axis: x, length: crank, mass: mass, center: [crank/2, 0, 0]}}
  coupler: {parent: crank, joint: {type: revolute, axis: -y, at: [crank, 0, 0]},
            shape: {type: rod, axis: x, length: coupler, mass: mass, center: [coupler/2, 0, 0]}}
  rocker: {parent: ground, joint: {type: revolute, axis: -y, at: [base, 0, 0]},
           shape: {type: rod, axis: x, length: rocker, mass: mass, center: [rocker/2, 0, 0]}}
loops:
  pin: {joint: {type: inline, axis: y}, from: {body: coupler, at: [coupler, 0, 0]}, to: {body: rocker, at: [rocker, 0, 0]}}
initial:
  q: {crank: 0.9, coupler: -0.5, rocker: 1.4}
  u: {SPEED}
independent: [INDEPENDENT]
outputs: {angle: {value: q.rocker}, kinetic: kinetic_energy}
"""

MOTION = {"target": "c", "functions": ("motion", "energies")}
TIMES = np.linspace(0.0, 1.5, 31)
FULL = {"rtol": 1e-12, "atol": 1e-12}
BY = ("g", "mass")


def model(independent: str) -> str:
    speed = "crank: w0" if independent == "crank" else "rocker: 0"
    return MODEL.replace("SPEED", speed).replace("INDEPENDENT", independent)


@pytest.fixture(scope="module")
def by_crank(build: Callable[..., Any]) -> Any:
    return build(model("crank"), **MOTION)


@pytest.fixture(scope="module")
def by_rocker(build: Callable[..., Any]) -> Any:
    return build(model("rocker"), partitions=2, **MOTION)


def in_line(found: Any) -> np.ndarray:
    """The sine of the angle between coupler and crank."""
    return np.sin(found["q.coupler"])


@pytest.mark.parametrize(
    ("method", "tolerance", "allowed"),
    [
        ("dop853", 1e-3, 0.1),
        ("dop853", 1e-10, 1e-7),
        ("radau", 1e-3, 0.3),
        ("radau", 1e-5, 1e-2),
        ("radau", 1e-10, 1e-5),
    ],
)
def test_goes_on_with_other_independents(
    by_crank: Any, by_rocker: Any, method: str, tolerance: float, allowed: float
) -> None:
    """Two turns of the crank, over dead centres at both ends, as the motion in the crank's angle, which has none."""
    q, u = by_crank.initial
    accuracy = {"rtol": tolerance, "atol": tolerance}
    expected = by_crank.simulate(TIMES, q, u, sensitivities=BY, **FULL)
    assert np.abs(np.diff(np.sign(in_line(expected)))).sum() >= 4
    found = by_rocker.simulate(TIMES, q, u, sensitivities=BY, method=method, **accuracy)
    assert found.stats["partitions_changed"] >= 1 and found.ended == "finished"
    np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=allowed)
    assert found.energy_drift < allowed and found.closure_drift < 1e-10
    np.testing.assert_allclose(found.dq, expected.dq, rtol=0, atol=30 * allowed * np.abs(expected.dq).max())


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_gradients_over_it(by_crank: Any, by_rocker: Any, integrator: str) -> None:
    q, u = by_crank.initial
    options = {"wrt": BY, "integrator": integrator, "rtol": 1e-8, "atol": 1e-8}
    forward, adjoint = (
        by_rocker.judge(1.5, Final("kinetic"), q, u, method=m, **options) for m in ("forward", "adjoint")
    )
    assert forward.counts["steps"] == adjoint.counts["steps"]
    np.testing.assert_allclose(adjoint.gradients, forward.gradients, rtol=1e-9)


@pytest.mark.parametrize(
    "options",
    [
        *({"method": m, "rtol": t, "atol": t} for m in ("dop853", "radau") for t in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)),
        *({"method": "rk4", "step": h} for h in (0.03, 0.01, 0.001)),
    ],
    ids=str,
)
@pytest.mark.parametrize("mechanism", ["slider", "four_bar"])
def test_with_one_choice_nothing_leaps_over_it(
    request: Any,
    by_crank: Any,
    by_rocker: Any,
    build: Callable[..., Any],
    monkeypatch: Any,
    mechanism: str,
    options: Any,
) -> None:
    """Steps end before the first dead centre, and the reason is told, with everything until there."""
    if mechanism == "slider":
        driver, driven = (
            build(slider.model(x), **MOTION | y) for x, y in (("crank", {}), ("piston", {"partitions": 2}))
        )
        angle = "q.crank"
    else:
        driver, driven, angle = by_crank, by_rocker, "q.coupler"
    monkeypatch.setattr(driven, "_manifest", {k: x for k, x in driven._manifest.items() if k != "others"})
    q, u = driver.initial
    expected = driver.simulate([0.0, 2.0], q, u, **FULL)
    assert expected.ended == "finished"
    every = driver.simulate(2.0, q, u, **FULL)
    first = every.t[int(np.flatnonzero(np.diff(np.sign(np.sin(every[angle]))))[0]) + 1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = driven.simulate(2.0, q, u, on_failure="return", **options)
    assert "at a dead point" in found.ended or "not determined" in found.ended
    assert 0.5 * first < found.t[-1] < first + 1e-3
    assert found.closure_drift < 1e-9 and np.isfinite(found.q).all()
    if options["method"] != "rk4":  # at its end dependent speeds may be known to 1e-4 of themselves only
        assert found.energy_drift < max(300 * options["rtol"], 2e-4)
