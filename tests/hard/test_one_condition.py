"""Loops with a single condition at their dead points: the measure of their conditioning, and motions through these points.

The condition number of a matrix with one entry is always 1, so such a loop seemed to be as far from a dead point as can be, up
to the dead point itself.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard.one_condition import SINGULAR, Body, Mechanism, random_mechanism

from codegen.loops.partition import partition
from codegen.model import parse_model

MOTION = {"target": "c", "functions": ("motion", "energies")}
TIMES = np.linspace(0.0, 2.0, 9)
SEEDS = 100
"""Of the campaign: mechanisms 0 to 99."""


def rod_slider_crank() -> Mechanism:
    """A crank of 0.3 m, a massless rod of about 1 m and a slider."""
    crank = Body(True, (0.0, 0.0), 0.0, 1.0, 0.1, 0.05, 0.3)
    slider = Body(False, (0.0, 0.0), 0.0, 1.0, 0.0, 0.0, 0.0)
    m = Mechanism([crank, slider], np.array([1.2, 1.06]))
    m.distance(0, 1)
    J = m.jacobian()[0]
    m.u = np.array([-J[1] / J[0], 1.0]) * -1.5
    return m


@pytest.fixture(scope="module")
def rod(build: Callable[..., Any]) -> Any:
    return build(rod_slider_crank().text([1]), partitions=2, **MOTION)


@pytest.mark.parametrize("angle", [1e-1, 1e-3, 1e-6, 1e-9])
def test_the_condition_of_one_condition_grows_towards_its_dead_point(rod: Any, angle: float) -> None:
    """By the slider, as one over what the crank's unit speed does along the rod; not by the crank."""
    q, _ = rod.initial
    length = 0.0
    for _ in range(2):  # the length, then the place of the slider
        x = 0.3 * np.cos(q[0]) + np.sqrt(length**2 - (0.3 * np.sin(q[0])) ** 2) if length else q[1]
        length = length or float(np.hypot(q[1] - 0.3 * np.cos(q[0]), 0.3 * np.sin(q[0])))
    x = 0.3 * np.cos(angle) + np.sqrt(length**2 - (0.3 * np.sin(angle)) ** 2)
    found = rod.condition([angle, x])
    along = 0.3 * x * np.sin(angle) / length / 0.25  # in parts of the characteristic length, a power of two
    assert found[0] == pytest.approx(1 / along, rel=1e-6) or found[0] == pytest.approx(2 / along, rel=1e-6)
    assert found[1] < 2


@pytest.mark.parametrize("method", ["dop853", "radau", "rk4"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_a_motion_over_the_dead_points_keeps_its_energy(rod: Any, method: str, tolerance: float) -> None:
    """Radau went over the dead centre with an energy drift of 0.3, the explicit method stood still before it."""
    q, u, _ = rod_slider_crank().reference(TIMES)
    step = {"step": 1e-3} if method == "rk4" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = rod.simulate(TIMES, method=method, rtol=tolerance, atol=tolerance, **step)
    assert rod.independent_names == ("b1",)
    assert found.stats["partitions_changed"] >= 1
    allowed = 3e-3 if method == "rk4" else 3e3 * tolerance
    np.testing.assert_allclose(found.q, q, rtol=0, atol=allowed)
    np.testing.assert_allclose(found.u, u, rtol=0, atol=10 * allowed)
    energy = np.sum(found.energy, axis=-1)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=allowed)


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_with_one_choice_it_ends_before_the_dead_point_and_says_so(rod: Any, monkeypatch: Any, method: str) -> None:
    monkeypatch.setattr(rod, "_manifest", {k: x for k, x in rod._manifest.items() if k != "others"})
    with pytest.warns(RuntimeWarning, match=r"--partitions 2"):
        found = rod.simulate(2.0, method=method, on_failure="return")
    assert abs(np.sin(found.q[-1, 0])) < 0.05
    energy = np.sum(found.energy, axis=-1)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-5)


def test_a_coupling_alone_has_no_dead_point() -> None:
    """Its ratios are constant: no choice of its dependent coordinate is a poor one."""
    crank, wheel = (Body(True, (x, 0.0), 0.0, 1.0, 0.0, 0.1, 0.1) for x in (0.0, 1.0))
    for independent in (0, 1):
        m = Mechanism([crank, wheel], np.array([0.1, 0.2]), u=np.zeros(2))
        m.gear(0, 1, 1e-3)
        assert partition(parse_model(m.text([independent]))).ears[0].condition == 1.0


@pytest.mark.parametrize(("method", "tolerance"), [("dop853", 1e-6), ("dop853", 1e-10), ("radau", 1e-10), ("rk4", 0.0)])
def test_a_parallelogram_by_a_rod_passes_its_flat_poses(
    build: Callable[..., Any], method: str, tolerance: float
) -> None:
    """All entries of its closure matrix vanish there together; steps stood still."""
    cranks = [Body(True, (x, 0.0), 0.0, 1.0, 0.5, 0.08, 1.0) for x in (0.0, 2.0)]
    m = Mechanism(cranks, np.array([1.0, 1.0]), u=np.array([1.0, 1.0]))
    m.distance(0, 1)
    solver = build(m.text([0]), **MOTION)
    options = {"rtol": tolerance, "atol": tolerance} if tolerance else {"step": 2e-3}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solver.simulate(np.linspace(0.0, 5.0, 6), method=method, **options)
    assert found.q[:, 0].min() < -np.pi  # over the flat pose on either side
    np.testing.assert_allclose(found.q[:, 0], found.q[:, 1], rtol=0, atol=1e-12)
    energy = np.sum(found.energy, axis=-1)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=max(1e3 * tolerance, 1e-6))


def compare_constant_steps(solver: Any) -> None:
    """Compare constant steps with the other method at 1e-11: errors above 3e-4 must have a warning."""
    right = solver.simulate(TIMES, rtol=1e-11, atol=1e-11)
    for step in (1e-3, 1e-2):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = solver.simulate(TIMES, method="rk4", step=step, on_failure="return")
        error = np.abs(found.q - right.q[: len(found.t)]).max()
        assert error < 3e-4 or any("do not resolve the motion" in str(w.message) for w in said), (step, error)


def test_constant_steps_that_are_too_long_near_a_loss_of_rank_warn(build: Callable[..., Any]) -> None:
    """Mechanism 3 comes near one: steps of 1e-3 s are off by 7e-3 there, of 1e-2 s by 0.3."""
    mechanism, independent = random_mechanism(3)
    solver = build(mechanism.text(independent), partitions=4, **MOTION)
    compare_constant_steps(solver)
    with pytest.warns(RuntimeWarning, match=r"steps of 0\.001 s do not resolve the motion, least of all at t = 0\.37"):
        solver.simulate(TIMES, method="rk4", step=1e-3)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(SEEDS))
def test_dead_points_of_random_mechanisms(build: Callable[..., Any], seed: int) -> None:
    """Every integrator passes them, or ends with a message; what is before is right. Against multipliers in all coordinates."""
    mechanism, independent = random_mechanism(seed)
    q, u, nearest = mechanism.reference(TIMES)
    if nearest < SINGULAR:
        compare_constant_steps(build(mechanism.text(independent), partitions=4, **MOTION))
        pytest.skip("a loop comes near a loss of rank of its own, where the reference is not exact")
    energy = mechanism.energy(q, u)
    size = 1.0 + np.abs(energy).max()
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-6 * size)
    for partitions in (1, 4):
        solver = build(mechanism.text(independent), partitions=partitions, **MOTION)
        for method, tolerance in (("dop853", 1e-9), ("dop853", 1e-6), ("radau", 1e-9), ("radau", 1e-6), ("rk4", 0.0)):
            options = {"rtol": tolerance, "atol": tolerance} if tolerance else {"step": 1e-3}
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                found = solver.simulate(TIMES, method=method, on_failure="return", **options)
            n, case = len(found.t), (seed, partitions, method, tolerance)
            assert found.ended == "finished" or "at t = " in found.ended, case
            assert found.ended == "finished" or partitions == 1, case
            # steps of constant size are too long where a loop comes near a loss of rank of its own: then there is a warning
            warned = any("do not resolve the motion" in str(w.message) for w in said)
            allowed = max(1e4 * tolerance, 1e-4) if tolerance or not warned else max(1e-2, 1e-3 / nearest)
            np.testing.assert_allclose(found.q, q[:n], rtol=0, atol=allowed, err_msg=str(case))
            np.testing.assert_allclose(found.u, u[:n], rtol=0, atol=10 * allowed, err_msg=str(case))
            drift = np.abs(mechanism.energy(found.q, found.u) - energy[0]).max()
            assert drift < allowed * size, case
