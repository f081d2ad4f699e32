"""Parallel cranks with nearly equal lengths in their flat pose, and derivatives with respect to lengths that must be equal."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import codegen
from codegen.loops.partition import partition
from codegen.reference import DenseEngine
from codegen.runtime import At, Final, Integral, SimulationError

MOTION = {"target": "c", "functions": None}

CRANKS = """
model: cranks
gravity: [0, 0, -9.81]
parameters: {c1: 1.0, c2: 1.0, c3: THIRD, g: 2.0, L: 1.0, m: 1.0}
bodies:
  A: {parent: ground, joint: {type: revolute, axis: -y}, mass: m, com: [0.5, 0, 0], inertia: {yy: 0.08, xx: 0.2, zz: 0.2}}
  B: {parent: A, joint: {type: revolute, axis: -y, at: [c1, 0, 0]}, mass: m, com: [g/2, 0, 0], inertia: {yy: 0.3, zz: 1}}
  C: {parent: ground, joint: {type: revolute, axis: -y, at: [g, 0, 0]}, mass: m, com: [0.5, 0, 0], inertia: {yy: 0.08, zz: 1}}
  D: {parent: ground, joint: {type: revolute, axis: -y, at: [g/2, 0, 0]}, mass: m, com: [0.5, 0, 0], inertia: {yy: 0.08, zz: 1}}
loops:
  r: {joint: {type: revolute, axis: -y}, from: {body: B, at: [g, 0, 0]}, to: {body: C, at: [c2, 0, 0]}}
  m: {joint: {type: revolute, axis: -y}, from: {body: B, at: [g/2, 0, 0]}, to: {body: D, at: [c3, 0, 0]}}
initial: {q: {A: 1.0, B: -1.0, C: 1.0, D: 1.0}, u: {A: 1.0}}
independent: [A]
outputs: {x: {value: q.A}}
"""
"""Three cranks on one rod: any two of them determine the third."""

TWO = "\n".join(x for x in CRANKS.replace(", D: 1.0", "").splitlines() if not x.startswith(("  D:", "  m:"))).replace(
    "c3: THIRD, ", ""
)
TOGETHER = TWO.replace("[c1,", "[L,").replace("[c2,", "[L,")
"""A parallelogram by two lengths, and by one."""


def three(build: Callable[..., Any], length: float) -> Any:
    return build(CRANKS.replace("THIRD", repr(length)), **MOTION)


# --- conditions that were dropped -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["dop853", "radau", "rk4"])
def test_no_dropped_condition_opens_in_silence(build: Callable[..., Any], method: str) -> None:
    """The third crank turned back at the flat pose, and the rod went two metres away from it."""
    solver = three(build, 1.00001)
    step = {"step": 1e-3} if method == "rk4" else {}
    try:
        found = solver.simulate(1.2, method=method, **step)
    except SimulationError as error:
        assert (
            "condition m.l" in str(error)
            and "loop_tolerance" in str(error)
            and "exchange its `from` and `to`" in str(error)
        )
        found = error.trajectory
    assert 1e-6 < found.closure_drift <= 1e-3  # it counts dropped conditions
    np.testing.assert_allclose(found["q.D"], found["q.A"], rtol=0, atol=1e-3)


def test_along_the_other_face_the_branch_is_kept(build: Callable[..., Any]) -> None:
    """What the message advises: conditions along the crank's own axes determine it in all poses."""
    text = CRANKS.replace("THIRD", "1.00001")
    ends = (
        "from: {body: B, at: [g/2, 0, 0]}, to: {body: D, at: [c3, 0, 0]}",
        "to: {body: B, at: [g/2, 0, 0]}, from: {body: D, at: [c3, 0, 0]}",
    )
    solver, exact = build(text.replace(*ends), **MOTION), build(TOGETHER, **MOTION)
    found = solver.simulate([0.0, 1.0, 2.0])
    np.testing.assert_allclose(found["q.D"], found["q.A"], rtol=0, atol=1e-4)
    assert found.closure_drift < 2e-5
    assert exact.simulate([0.0, 1.0, 2.0])["q.A"][-1] < -2


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4])
def test_a_length_may_be_off_by_the_tolerance_at_run_time_too(build: Callable[..., Any], off: float) -> None:
    """A length that generation accepts was refused in a solver that had been generated with the exact one."""
    exact, given = three(build, 1.0), three(build, 1.0 + off)
    p = np.array(exact.parameters)
    p[exact.parameter_names.index("c3")] += off
    with pytest.warns(RuntimeWarning, match="redundant condition m.l"):
        q, u = exact.assemble(*exact.initial, p)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        batch = exact.assemble(np.tile(q, (3, 1)), np.tile(u, (3, 1)), p)[0]
        found = exact.simulate([0.0, 0.5], p=p)
        stiff = exact.simulate([0.0, 0.5], p=p, method="radau")
        expected = given.simulate([0.0, 0.5])
    np.testing.assert_allclose(batch, np.tile(q, (3, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(exact.accelerations(q, u, p), given.accelerations(*given.initial), rtol=0, atol=30 * off)
    np.testing.assert_allclose(found.q[-1], expected.q[-1], rtol=0, atol=10 * off + 1e-8)
    np.testing.assert_allclose(stiff.q[-1], found.q[-1], rtol=0, atol=1e-7)
    assert found.closure_drift == pytest.approx(off, rel=0.3)


# --- derivatives ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "tolerance"), [("dop853", 1e-9), ("dop853", 1e-12), ("radau", 1e-9)])
def test_derivatives_by_one_length_end_at_the_flat_pose(
    build: Callable[..., Any], method: str, tolerance: float
) -> None:
    """With one crank longer it cannot be assembled there. Numbers were of any size, others at every tolerance."""
    solver, together = build(TWO, **MOTION), build(TOGETHER, **MOTION)
    options = {"method": method, "rtol": tolerance, "atol": tolerance}
    times = [0.0, 0.5, 1.0, 2.0]
    with pytest.warns(RuntimeWarning, match=r"^derivatives with respect to c1, c2 do not exist after t = 0\.730"):
        found = solver.simulate(times, sensitivities=("c1", "c2", "m", "u0.A", "g"), **options)
    assert np.isnan(found.dq[:2, 2:]).all() and np.isnan(found.du[:2, 2:]).all()
    assert np.isfinite(found.dq[:2, :2]).all() and np.isfinite(found.dq[2:]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = together.simulate(times, sensitivities=("L", "m", "u0.A", "g"), **options)
    np.testing.assert_allclose(found.dq[2:], expected.dq[1:], rtol=0, atol=1e3 * tolerance)
    # both lengths together keep the loop closed
    np.testing.assert_allclose(found.dq[0, :2] + found.dq[1, :2], expected.dq[0, :2], rtol=0, atol=1e3 * tolerance)


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_gradients_say_so_both_ways(build: Callable[..., Any], way: str) -> None:
    solver, together = build(TWO, **MOTION), build(TOGETHER, **MOTION)
    wanted = [Final("x"), At("x", 0.3), Integral("x")]
    with pytest.warns(RuntimeWarning, match="derivatives with respect to c1, c2 do not exist"):
        found = solver.judge(2.0, wanted, wrt=("c1", "c2", "m", "u0.A"), method=way)
    assert np.isnan(found.gradients[[0, 2], :2]).all()
    assert np.isfinite(found.gradients[1]).all() and np.isfinite(found.gradients[:, 2:]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = together.judge(2.0, wanted, wrt=("L", "m", "u0.A"), method=way)
    np.testing.assert_allclose(found.gradients[:, 2:], expected.gradients[:, 1:], rtol=0, atol=1e-7)
    assert found.gradients[1, 0] + found.gradients[1, 1] == pytest.approx(expected.gradients[1, 0], abs=1e-7)


def test_every_function_says_that_a_dropped_condition_is_open(build: Callable[..., Any]) -> None:
    """At a state in which the third crank is the other way round; alone and in a batch."""
    solver = three(build, 1.00001)
    q, u = solver.initial
    other = np.array([1.0, -1.0, 1.0, 1.0 - np.pi])
    calls: dict[str, Callable[[Any], Any]] = {
        "accelerations": lambda x: solver.accelerations(x, u), "outputs": lambda x: solver.outputs(x, u),
        "sensitivities": lambda x: solver.sensitivities(x, u, du=np.ones((1, 4))), "energies": lambda x: solver.energies(x, u),
        "gradients": lambda x: solver.gradients(x, u, weights=np.ones(4)),
        "jacobians": lambda x: solver.jacobians(x, u, wrt="q"),
    }  # fmt: skip
    for name, call in calls.items():
        with pytest.warns(RuntimeWarning, match=r"condition m\.l\d.* open by [12]\.?\d*"):
            call(other)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            call(q)
        assert not any("is open by" in str(w.message) for w in said), name
    with pytest.warns(RuntimeWarning, match=r"open by [12]\.?\d* \(state \[1\] of the batch\)"):
        solver.accelerations(np.array([q, other]), u)


# --- along which face's axes conditions are kept ----------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_parallel_cranks_pass_in_the_branch_that_keeps_all_conditions(build: Callable[..., Any], method: str) -> None:
    """The condition across the third crank determines it in all poses; it is along the axes of `to` here."""
    solver, exact = three(build, 1.00001), three(build, 1.0)
    times = np.linspace(0.0, 3.0, 7)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, expected = (s.simulate(times, method=method) for s in (solver, exact))
    assert expected["q.A"].min() < -np.pi
    np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=1e-3)
    np.testing.assert_allclose(found["q.D"], found["q.A"], rtol=0, atol=1e-5)
    energy = np.sum(found.energy, axis=-1)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-5)
    assert found.closure_drift == pytest.approx(1e-5, rel=0.1)


def test_reactions_are_on_the_same_face_whichever_way_a_loop_is_taken(tmp_path: Path) -> None:
    """Against the dense engine, and with `from` and `to` exchanged in the file, where they are the opposite."""
    text = CRANKS.replace("THIRD", "1.00001")
    there = "from: {body: B, at: [g/2, 0, 0]}, to: {body: D, at: [c3, 0, 0]}"
    back = "to: {body: B, at: [g/2, 0, 0]}, from: {body: D, at: [c3, 0, 0]}"
    found = []
    for name, of in (("there", text), ("back", text.replace(there, back))):
        model = codegen.parse_model(of)
        assert partition(model).turned == ((1,) if name == "there" else ())
        report = codegen.generate(model, tmp_path / name, target="numpy", reactions=True, check=True)
        assert max(report.errors.values()) < 1e-12
        solver, engine = codegen.load(tmp_path / name), DenseEngine(model)
        q, u = solver.initial
        joints, loops = solver.reactions(q, u)
        np.testing.assert_allclose(loops, engine.reactions(q, u), rtol=0, atol=1e-12)
        np.testing.assert_allclose(joints, engine.joint_reactions(q, u), rtol=0, atol=1e-12)
        dp = np.eye(solver.np)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # lengths open the loops
            along = solver.reaction_sensitivities(q, u, dp=dp)[3]
            np.testing.assert_allclose(along, engine.reaction_sensitivities(q, u, dp=dp)[1], rtol=0, atol=1e-11)
        found.append(loops[1])
    np.testing.assert_allclose(found[0], -found[1], rtol=0, atol=1e-9)
