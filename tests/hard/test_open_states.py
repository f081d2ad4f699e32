"""States whose loops are open: what is measured, what is repaired with a word, and what is computed as it stands."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard import slider

from codegen.runtime import AssemblyError

ROD, PISTON = 0.1, 0.05
"""How far the rod, rad, and the piston, m, are off."""


@pytest.fixture(scope="module")
def crank(build: Callable[..., Any]) -> Any:
    return build(slider.model("crank"), target="c", functions=("motion",))


def opened(crank: Any) -> tuple[Any, Any, Any]:
    """The closed state, and coordinates with rod and piston off."""
    q, u = crank.initial
    return q, u, q + np.array([0.0, ROD, PISTON])


def test_closure_measures_the_gap(crank: Any) -> None:
    """The pin's two halves, apart as the geometry says, m, along the axes of the rod."""
    q, u, off = opened(crank)
    _, length, rod = crank.parameters[:3]
    tilt = off[0] + off[1]
    x, z = length * np.cos(q[0]) + rod * np.cos(tilt) - off[2], length * np.sin(q[0]) + rod * np.sin(tilt)
    along, across = x * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - x * np.sin(tilt)
    found = crank.closure(off, u)[0]
    np.testing.assert_allclose(np.sort(np.abs(found)), np.sort(np.abs([along, across])), rtol=1e-12)
    assert np.abs(crank.closure(q, u)[0]).max() < 1e-14


def test_accelerations_are_those_of_the_coordinates_as_they_are(crank: Any) -> None:
    """No function but `assemble` moves q: udot of an open state is off in proportion to the gap, which `closure` tells."""
    q, u, off = opened(crank)
    closed = crank.accelerations(q, u)
    shares = np.array([1e-2, 1e-4, 1e-6])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        states = q + shares[:, None] * (off - q)
        wrong = np.abs(crank.accelerations(states, u) - closed).max(axis=1) / shares
        gaps = np.abs(crank.closure(states, u)[0]).max(axis=1) / shares
        np.testing.assert_allclose(crank.accelerations(*crank.assemble(states, u)), [closed] * 3, rtol=1e-12)
    np.testing.assert_allclose(gaps, gaps[-1], rtol=0.05)
    np.testing.assert_allclose(wrong, wrong[-1], rtol=0.05)
    assert wrong[-1] > 0.1


def test_simulate_repairs_and_says_so(crank: Any) -> None:
    q, u, off = opened(crank)
    gap = np.abs(crank.closure(off, u)[0]).max()
    said = rf"the initial state is open by {gap:.3g} \(scaled\); assembled: dependent coordinates have been changed"
    with pytest.warns(RuntimeWarning, match=said):
        found = crank.simulate([0.0, 0.1], off, u)
    np.testing.assert_allclose(found.q[0], q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.u[0], u, rtol=0, atol=1e-13)
    with pytest.warns(RuntimeWarning, match="initial speeds do not keep the loops closed.*by up to 1"):
        again = crank.simulate([0.0, 0.1], q, u + np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(again.q, crank.simulate([0.0, 0.1], q, u).q)
    assert found.closure_drift < 1e-14


def test_what_cannot_be_closed_is_refused_with_the_gap(crank: Any) -> None:
    """A rod that is too short for where the crank stands: 0.5 sin(0.9) = 0.39 m."""
    q, u, _ = opened(crank)
    for call in (lambda p: crank.simulate(0.1, q, u, p), lambda p: crank.assemble(q, u, p)):
        with pytest.raises(
            AssemblyError, match=r"loop pin cannot be closed: 0\.\d+ is left of its conditions"
        ) as caught:
            call({"rod": 0.3})
        assert caught.value.loop == "pin"
