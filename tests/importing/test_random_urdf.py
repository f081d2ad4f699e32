"""Random URDF files against Pinocchio: ``python -m pytest -m campaign tests/importing/test_random_urdf.py``.

Pinocchio leaves joints with <mimic> free, so that its mass matrix and bias forces are reduced here by the followers' factors.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from pinocchio_agreement import states
from random_urdf import RandomUrdf

import codegen
from codegen.reference import RecursiveEngine

SEEDS = range(700)


def apart(path, robot):
    """Relative difference of the accelerations at a random state."""
    import pinocchio as pin

    found = codegen.import_model(path, base="free" if robot.free else "fixed")
    assert not found.differences, (path, found.differences)
    base = (pin.JointModelFreeFlyer(),) if robot.free else ()
    theirs, model = pin.buildModelFromUrdf(str(path), *base), found.model
    names, speeds = list(model.coordinate_names), list(model.speed_names)
    assert theirs.nv == len(speeds), path
    zeros = (np.zeros(len(names)), np.zeros(len(speeds)))
    solver = SimpleNamespace(initial=zeros, coordinate_names=names, speed_names=speeds)
    (q, u), (here_q, here_u), order, _ = states(theirs, found, solver, 0)
    S = np.eye(theirs.nv)
    for name, leader, factor, offset in robot.followers:
        follower, led = (theirs.joints[theirs.getJointId(n)] for n in (name, leader))
        place = names.index(found.joints[name])
        angle = here_q[place] = factor * here_q[names.index(found.joints[leader])] + offset
        q[follower.idx_q : follower.idx_q + follower.nq] = (np.cos(angle), np.sin(angle)) if follower.nq == 2 else angle
        u[follower.idx_v] = factor * u[led.idx_v]
        S[follower.idx_v] = factor * S[led.idx_v]
    followers = [theirs.joints[theirs.getJointId(name)].idx_v for name, *_ in robot.followers]
    S, here_u[order] = np.delete(S, followers, axis=1), u
    M = pin.crba(theirs, theirs.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    bias = pin.nonLinearEffects(theirs, theirs.createData(), q, u) + np.array(theirs.damping) * u
    right = S @ np.linalg.solve(S.T @ M @ S, -S.T @ bias)
    assert np.all(np.isfinite(right)), path
    return np.abs(RecursiveEngine(model).accelerations(here_q, here_u)[order] - right).max() / max(
        np.abs(right).max(), 1
    )


def check(tmp_path, seeds):
    pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    for seed in seeds:
        robot, path = RandomUrdf(seed), tmp_path / f"robot_{seed}.urdf"
        path.write_text(robot.text(), encoding="utf-8")
        assert apart(path, robot) < 1e-8, path


def test_some_random_files_move_as_pinocchio_says(tmp_path):
    check(tmp_path, range(1000, 1010))


@pytest.mark.campaign
@pytest.mark.parametrize("start", range(0, len(SEEDS), 50))
def test_random_files_move_as_pinocchio_says(tmp_path, start):
    check(tmp_path, SEEDS[start : start + 50])
