"""The full Hessian of a fit, and profile likelihood intervals, against closed forms of the oscillator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from oscillator import FREE, MODEL, swing
from scipy.optimize import brentq, minimize_scalar

import ordernm

T = np.linspace(0.0, 5.0, 41)
NAMES = ("stiffness", "start")


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("fit") / "oscillator"
    ordernm.generate(ordernm.parse_model(MODEL), folder, functions="motion,hessian_products")
    return ordernm.load(folder)


def noisy(sigma: float = 0.15) -> np.ndarray:
    x = swing(T, stiffness=8.4, start=0.53)[0] + sigma * np.random.default_rng(3).normal(size=len(T))
    x[7] = np.nan
    return x


def gradient(x: np.ndarray, samples: np.ndarray, sigma: float) -> np.ndarray:
    """Derivatives of half the sum of squares with respect to stiffness and start, also for complex values."""
    known = np.isfinite(samples)
    place, by = swing(T[known], stiffness=x[0], start=x[1])
    return np.array([(by[n] * (place - samples[known])).sum() for n in NAMES]) / sigma**2


@pytest.mark.parametrize(("given", "integrator"), [(True, "dop853"), (False, "dop853"), (True, "radau")])
def test_hessian_and_covariance_are_those_of_the_closed_form(solver: Any, given: bool, integrator: str) -> None:
    samples, sigma = noisy(), 0.15 if given else 1.0
    found = ordernm.fit(
        solver, T, {"x": samples}, {"stiffness": (5, 12), "start": None}, sigma=sigma if given else None,
        integrator=integrator, hessian=True, rtol=1e-11, atol=1e-11,
    )  # fmt: skip
    wanted = np.array([gradient(found.values + 1e-30j * e, samples, sigma).imag for e in np.eye(2)]) / 1e-30
    np.testing.assert_allclose(found.hessian, wanted, rtol=1e-8)
    inverse = np.linalg.inv(wanted) * (1.0 if given else found.variance)
    np.testing.assert_allclose(found.full_covariance, inverse, rtol=1e-7)
    assert np.abs(found.full_covariance / found.covariance - 1.0).max() > 1e-2, "residuals have curvature here"
    ratios = np.sqrt(np.diag(found.full_covariance)) / found.deviations
    line = f"with the full Hessian, standard deviations are {ratios.min():.3g} to {ratios.max():.3g} times these"
    assert line in repr(found)


def test_several_experiments_add_their_hessians(solver: Any) -> None:
    first = noisy()
    parts = [{"times": T[:20], "samples": {"x": first[:20]}}, {"times": T[20:], "samples": {"x": first[20:]}}]
    both = ordernm.fit(solver, variables=NAMES, experiments=parts, hessian=True)
    whole = ordernm.fit(solver, T, {"x": first}, NAMES, hessian=True)
    np.testing.assert_allclose(both.hessian, whole.hessian, rtol=1e-4)


def test_profile_of_a_linear_model_is_its_interval(solver: Any) -> None:
    x = 0.3 - 0.2 * T + 0.05 * np.random.default_rng(7).normal(size=len(T))
    found = ordernm.fit(solver, T, {"x": x}, ["q0.block", "u0.block"], p=FREE, u={"block": -1.0})
    for name in found.names:
        for probability in (0.5, 0.95):
            np.testing.assert_allclose(found.profile(name, probability), found.interval(name, probability), rtol=1e-4)


def test_ends_of_profiles_have_the_sum_of_squares_that_belongs_to_them(solver: Any) -> None:
    samples, sigma = noisy(0.4), 0.4
    known = np.isfinite(samples)
    found = ordernm.fit(solver, T, {"x": samples}, NAMES, sigma=sigma, rtol=1e-10, atol=1e-10)

    def least(stiffness: float) -> float:
        """The smallest sum of squares for a given stiffness; the best start follows from a linear equation."""
        shape = swing(T[known], stiffness=stiffness, start=1.0)[0]
        start = shape @ samples[known] / (shape @ shape)
        return float(((start * shape - samples[known]) ** 2).sum() / sigma**2)

    best = minimize_scalar(least, bounds=(7.0, 10.0), method="bounded", options={"xatol": 1e-12})
    assert found["stiffness"] == pytest.approx(best.x, rel=1e-5)
    wanted = [
        brentq(lambda k: least(k) - best.fun - 1.959963984540054**2, *ends) for ends in ((4.0, best.x), (best.x, 14.0))
    ]
    assert found.profile("stiffness") == pytest.approx(wanted, rel=1e-5)
    linear = np.array(found.interval("stiffness"))
    assert np.abs(linear - wanted).max() > 1e-2 * found.deviation("stiffness"), "the profile is not symmetric"


def test_profiles_end_at_bounds_and_are_infinite_without_information(solver: Any) -> None:
    samples = noisy()
    near = ordernm.fit(solver, T, {"x": samples}, {"stiffness": (7.9, 9.0), "start": None}, sigma=0.5)
    assert near.profile("stiffness", 0.9999) == pytest.approx((7.9, 9.0))
    lost = ordernm.fit(solver, T, {"x": swing(T)[0]}, ["mass", "stiffness", "start"])
    assert lost.profile("mass") == (-math.inf, math.inf)
    at_bound = ordernm.fit(solver, T, {"x": samples}, {"stiffness": (7.0, 8.1), "start": None})
    with pytest.raises(ValueError, match="profile: stiffness is at its upper bound; move the bound"):
        at_bound.profile("stiffness")


def test_refusals(solver: Any) -> None:
    given = (solver, T, {"x": noisy()}, "stiffness")
    with pytest.raises(ValueError, match="hessian needs loss='linear', and loss is 'soft_l1'"):
        ordernm.fit(*given, loss="soft_l1", hessian=True)
    with pytest.raises(ValueError, match="profile: the loss of this fit is not 'linear'"):
        ordernm.fit(*given, loss="soft_l1").profile("stiffness")
    with pytest.raises(ValueError, match=r"hessian needs samples of outputs, and experiment 1 has samples of q.block"):
        ordernm.fit(solver, T, {"q.block": noisy()}, "stiffness", hessian=True)
    with pytest.raises(ValueError, match="probability is 2, expected"):
        ordernm.fit(*given).profile("stiffness", 2)
