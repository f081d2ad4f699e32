"""Numerical joints of every type: against products of elementary matrices in 50 digits, and loops of the same type."""

import dataclasses

import mpmath
import numpy as np
import pytest
from joint_types import TYPES, coordinates, every_type, extended, given_axes, joint, known_types, one_body, pose, twist
from loop_closure import closure, closure_matrix
from random_models import vector

from codegen.loops.geometry import Geometry, advance, padded
from codegen.loops.speed_groups import speed_groups
from codegen.model.model import GROUND, Face, Loop

__all__ = ["known_types"]

SEEDS = range(3)


def floats(x) -> np.ndarray:
    return np.array(x.tolist(), dtype=float)


@every_type
def test_pose_is_the_product_of_the_elementary_motions(kind):
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        model = one_body(kind, rng)
        q = coordinates(model, rng)
        R, o = frame(model, q)
        with mpmath.workdps(50):
            T = floats(pose(model.bodies[0].joint, extended(q)))
        np.testing.assert_allclose(R, T[:3, :3], atol=2e-15)
        np.testing.assert_allclose(o, T[:3, 3], atol=2e-15)


@every_type
def test_screws_are_derivatives_of_the_pose(kind):
    for seed in SEEDS:
        rng = np.random.default_rng(10 + seed)
        model = one_body(kind, rng)
        q = coordinates(model, rng)
        w, v = (np.broadcast_to(x, (1, model.nu, 3))[0] for x in Geometry(model).all_joints.screws(padded(q)))
        for j, unit in enumerate(np.eye(model.nu)):
            with mpmath.workdps(50):
                expected = twist(model.bodies[0].joint, extended(q), extended(unit)).astype(float)
            np.testing.assert_allclose([*w[j], *v[j]], expected, atol=4e-15)


def frame(model, q) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) of the only body."""
    R, o = Geometry(model).all_joints.transforms(padded(q) if np.ndim(q) == 1 else q)
    return R[0, 0], np.broadcast_to(o, (1, 1, 3))[0, 0]


@every_type
def test_a_step_moves_a_joint_along_its_speeds(kind):
    """To first order: what is left falls to half or less when the step is halved."""
    rng = np.random.default_rng(20)
    model = one_body(kind, rng)
    q, u = coordinates(model, rng), rng.normal(size=model.nu)
    with mpmath.workdps(50):
        expected = twist(model.bodies[0].joint, extended(q), extended(u)).astype(float)
    R, o = frame(model, q)
    errors = []
    for step in (1e-4, 5e-5):
        R1, o1 = frame(model, advance(Geometry(model), padded(q), range(model.nu), step * u[None]))
        W, v = R.T @ (R1 - R) / step, R.T @ (o1 - o) / step
        errors.append(np.abs([W[2, 1], W[0, 2], W[1, 0], *v] - expected).max())
    assert errors[0] < 5e-3
    assert errors[1] < 0.52 * errors[0] + 1e-9


@every_type
def test_groups_hold_every_speed_and_coordinate_once(kind):
    model = one_body(kind, np.random.default_rng(0))
    groups = speed_groups(model)
    assert [s for g in groups for s in g.speeds] == list(range(model.nu))
    assert sorted(i for g in groups for i in range(model.nq)[g.coordinates]) == list(range(model.nq))


@pytest.mark.parametrize("kind", [k for k in TYPES if k.closure], ids=lambda kind: kind.name)
def test_closure_allows_the_motion_of_the_joint_and_no_other(kind):
    """A loop beside a joint of its own type, on the same axes: closed wherever the joint goes, its rows blind to its speeds."""
    for seed in SEEDS:
        rng = np.random.default_rng(30 + seed)
        model = one_body(kind, rng)
        given = given_axes(kind, np.random.default_rng(30 + seed))
        on_axes = dataclasses.replace(
            model.bodies[0].joint, axes=kind.axes_of_motion(tuple(vector(*a) for a in given), {})
        )
        same = Loop(
            "l", kind.name, tuple(vector(*a) for a in given), Face(GROUND, vector(0, 0, 0)), Face(0, vector(0, 0, 0))
        )
        model = dataclasses.replace(model, bodies=(dataclasses.replace(model.bodies[0], joint=on_axes),), loops=(same,))
        q, u = coordinates(model, rng), rng.normal(size=model.nu)
        position, velocity = closure(model, q, u)
        assert len(position) == sum(kind.closure)
        np.testing.assert_allclose(position, 0, atol=1e-14)
        np.testing.assert_allclose(velocity, 0, atol=1e-14)
        assert np.abs(closure_matrix(model, 0, q)[1]).max(initial=0) < 1e-14
        # and it holds everything else: on a free body its rows are independent, as many as the joint's speeds leave
        body = dataclasses.replace(model.bodies[0], joint=joint(TYPES[[k.name for k in TYPES].index("free")], rng))
        free = dataclasses.replace(model, bodies=(body,))
        R, o = frame(model, q)
        at = [*o, *quaternion(R)]
        E = closure_matrix(free, 0, at)[1]
        np.testing.assert_allclose(closure(free, at, np.zeros(6))[0], 0, atol=1e-14)
        assert np.linalg.matrix_rank(E, tol=1e-6) == sum(kind.closure) == 6 - model.nu


def quaternion(R: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation matrix, as eigenvector of a symmetric matrix."""
    K = np.array([
        [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
        [0, R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
        [0, 0, R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
        [0, 0, 0, np.trace(R)],
    ])  # fmt: skip
    x, y, z, w = np.linalg.eigh(K, UPLO="U")[1][:, -1]
    return np.array([w, x, y, z])
