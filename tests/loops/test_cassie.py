"""Cassie with the digits of its file: planar loops that are planar to 7e-8 rad, chosen and assembled over its joints' range."""

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.loops import AssemblyError, assemble, partition
from codegen.loops.assembling import first_assembly
from codegen.loops.geometry import Geometry, padded
from codegen.loops.ordering import loop_order
from codegen.runtime import AssemblyError as NotAssembled

FILE = Path(__file__).parent / "cassie_v2.yaml"

LIMITS = {
    "left_hip_roll": (-0.2618, 0.3491), "right_hip_roll": (-0.3491, 0.2618), "hip_yaw": (-0.3840, 0.3840),
    "hip_pitch": (-0.8727, 1.3963), "knee": (-2.07694, 0.13963), "shin": (-0.34907, 0.34907),
    "tarsus": (-0.13963, 1.95477), "foot_crank": (-2.4435, -0.6109), "foot": (-2.4435, -0.6109),
}  # fmt: skip
"""rad, of the SDF file; the heel springs, Achilles rods and plantar rods have none there."""


def limits(name):
    return LIMITS.get(name) or LIMITS.get(name.partition("_")[2])


@pytest.fixture(scope="module")
def cassie():
    return codegen.load_model(FILE)


@pytest.fixture(scope="module")
def chosen(cassie):
    return partition(cassie)


@pytest.fixture(scope="module")
def states(cassie):
    """Random closed states within the limits: all joints drawn, closed by moving all of them a little, others discarded.

    The joints without limits are drawn up to a radian off.
    """
    g, rng = Geometry(cassie), np.random.default_rng(5)
    order = loop_order(g, set())
    found = []
    bounds = [limits(name) for name in cassie.coordinate_names]
    for _ in range(400):
        q = np.array([rng.uniform(*(b or (-1.0, 1.0))) for b in bounds])
        e = rng.normal(size=4)
        q[3:7] = e / np.linalg.norm(e)
        try:
            q = first_assembly(g, order, padded(q), set(), rng, set())[0][0, :-1]
        except AssemblyError:
            continue
        if all(b is None or b[0] <= x <= b[1] for x, b in zip(q, bounds, strict=True)):
            found.append(q)
        if len(found) == 20:
            break
    assert len(found) == 20
    return found


def test_the_nearly_planar_loop_is_told_though_the_initial_pose_is_flat(chosen):
    (told,) = [x for x in chosen.remarks if "right_plantar" in x]
    assert "taken as planar: axes agree to 7.4e-08 rad" in told
    assert len(chosen.independent) == 18


def test_random_states_within_the_limits_are_assembled_from_the_initial_dependents(cassie, chosen, states):
    kept = list(chosen.independent_coordinates(cassie))
    closed = 0
    for state in states:
        q = np.array(chosen.q)
        q[kept] = state[kept]
        try:
            found = assemble(cassie, chosen, q)
        except AssemblyError:
            continue
        assert np.array_equal(found[kept], state[kept])
        closed += 1
    assert closed >= 18


@pytest.mark.campaign
def test_the_generated_solver_agrees_and_assembles_the_same_states(tmp_path, states):
    report = codegen.generate(FILE, tmp_path / "cassie", target="numpy", check=True)
    assert 0 < max(report.errors.values()) < 1e-9
    solver = codegen.load(tmp_path / "cassie")
    q0, u0 = solver.initial
    kept = [list(solver.coordinate_names).index(name) for name in solver.independent_names]
    closed = 0
    for state in states:
        q = q0.copy()
        q[kept] = state[kept]
        try:
            solver.assemble(q, u0)
        except NotAssembled:
            continue
        closed += 1
    assert closed >= 18
