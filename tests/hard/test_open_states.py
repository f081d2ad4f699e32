"""States whose loops are open: the measured residuals, repairs with a warning, and functions that use the state as it is."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard import slider

import codegen
from codegen.runtime import AssemblyError

ROD, PISTON = 0.1, 0.05
"""How far the rod, rad, and the piston, m, are off."""


@pytest.fixture(scope="module")
def crank(build: Callable[..., Any]) -> Any:
    return build(slider.model("crank"), target="c", functions=("motion",))


def opened(crank: Any) -> tuple[Any, Any, Any]:
    """The closed state, and a state in which rod and piston are displaced."""
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
    said = rf"the initial state does not close the loops \(scaled residual {gap:.3g}\); dependent coordinates have been changed"
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
        with pytest.raises(AssemblyError, match=r"loop pin cannot be closed: its residual is 0\.\d+") as caught:
            call({"rod": 0.3})
        assert caught.value.loop == "pin"


# --- loops that make no speed dependent ---------------------------------------------------------------------------------

DOOR = """
model: door
gravity: [0, 0, -9.81]
bodies:
  door: {parent: ground, joint: {type: revolute, axis: z}, mass: 20, com: [0.4, 0, 1], inertia: {zz: 1}}
loops:
  upper: {joint: {type: revolute, axis: z}, from: {body: door, at: [OFF, 0, 1.8]}, to: {body: ground, at: [0, 0, 1.8]}}
initial: {u: {door: 1.0}}
"""


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-6, 1e-3])
def test_a_second_hinge_asks_nothing_new(build: Callable[..., Any], off: float) -> None:
    """Off by less than the tolerance of the model it is dropped whole; there was an IndexError."""
    solver = build(DOOR.replace("OFF", repr(off)), target="numpy", functions=None)
    q, u = solver.initial
    assert solver.accelerations(q, u)[0] == 0.0
    assert solver.condition(q)[0] == 1.0
    found = solver.diagnose(q, u)
    assert found.closures == () and found.all_loops is None and found.distance == 1.0
    np.testing.assert_array_equal(solver.assemble([[0.3], [0.5]], [[1.0], [1.0]])[0], [[0.3], [0.5]])


def test_a_second_hinge_too_far_off_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(codegen.ModelError, match=r"loop upper .* cannot be closed"):
        codegen.generate(codegen.parse_model(DOOR.replace("OFF", "0.01")), tmp_path / "p")


FAR = """
model: far
gravity: [0, 0, -9.81]
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, mass: 1}
  coupler: {parent: crank, joint: {type: revolute, axis: -y, at: [0.4, 0, 0]}, mass: 1, inertia: {yy: 1}}
  rocker: {parent: coupler, joint: {type: revolute, axis: -y, at: [1.2, 0, 0]}, mass: 1, com: [FAR, 0, 0]}
loops:
  bearing: {joint: {type: revolute, axis: -y}, from: {body: rocker, at: [0.9, 0, 0]}, to: {body: ground, at: [1.1, 0, 0]}}
initial: {q: {crank: 0.8, coupler: -0.4, rocker: -1.9}}
independent: [crank]
"""


@pytest.mark.parametrize("far", [1e60, 1e120, 4.5e307])
def test_a_mass_centre_as_far_as_can_be_is_no_traceback(tmp_path: Path, far: float) -> None:
    """The engine that checks a package finds no closure then, for it moves mass centres: that is a remark."""
    with np.errstate(all="ignore"):
        model = codegen.parse_model(FAR.replace("FAR", repr(far)))
        if far > 1e154:  # its square is no number
            with pytest.raises(
                codegen.ModelError, match=r"numbers of the model overflow .* check lengths, masses and units"
            ):
                codegen.generate(model, tmp_path / "p", target="numpy")
            return
        report = codegen.generate(model, tmp_path / "p", target="numpy", check=True)
    assert report.errors or any("not checked against the generic engine" in x for x in report.remarks)
