"""Joints of every type in the reference engines, in 50 digits: against elementary matrices, and between the engines."""

import mpmath
import numpy as np
from joint_types import (
    DIGITS,
    body,
    coordinates,
    every_type,
    extended,
    joint,
    known_types,
    moved,
    one_body,
    pose,
    twist,
)

from codegen.model.joints import JOINTS
from codegen.model.model import GROUND, Model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.arithmetic import Arithmetic
from codegen.reference.pairs import Pair, Pairs
from codegen.reference.primitives import joint_terms

__all__ = ["known_types"]

EXACT = 1e-45
DIFFERENCE = 1e-30
"""What a central difference with steps of 1e-17 leaves."""


def column(x) -> Pair:
    value = np.array([[mpmath.mpf(y)] for y in x], dtype=object).reshape(-1, 1)
    return Pair(value, np.zeros((0, *value.shape), dtype=object))


def assert_close(a, b, tolerance):
    assert np.shape(a) == np.shape(b)
    assert max((abs(x) for x in (np.asarray(a) - np.asarray(b)).flat), default=0) < tolerance


@every_type
def test_terms_of_a_joint(kind):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        model = one_body(kind, rng)
        with mpmath.workdps(DIGITS):
            q, u = extended(coordinates(model, rng)), extended(rng.normal(size=model.nu))
            pairs = Pairs(Arithmetic("mpmath"), 0, {})

            def terms(at, u=u, model=model, pairs=pairs):
                return joint_terms(model.bodies[0], pairs, column(at), column(u))

            found, on = terms(q), model.bodies[0].joint
            T = np.array(pose(on, q).tolist(), dtype=object)
            assert_close(found.R.value, T[:3, :3], EXACT)
            assert_close(found.d.value, T[:3, 3:], EXACT)
            for j in range(model.nu):
                unit = [mpmath.mpf(int(i == j)) for i in range(model.nu)]
                assert_close(found.P.value[:, j], twist(on, q, unit), DIFFERENCE)
            h = mpmath.mpf(10) ** -17
            ahead, back = (terms(moved(on, q, u, s)).P.value for s in (h, -h))
            assert_close(found.Pdot_u.value, (ahead - back) / (2 * h) @ column(u).value, DIFFERENCE)


@every_type
def test_coordinate_rates(kind):
    rng = np.random.default_rng(5)
    model = one_body(kind, rng)
    with mpmath.workdps(DIGITS):
        q, u, h = extended(coordinates(model, rng)), extended(rng.normal(size=model.nu)), mpmath.mpf(10) ** -17
        ahead, back = (np.array(moved(model.bodies[0].joint, q, u, s), dtype=object) for s in (h, -h))
        for engine in (DenseEngine, RecursiveEngine):
            assert_close(engine(model, "mpmath").coordinate_rates(q, u), (ahead - back) / (2 * h), DIFFERENCE)


@every_type
def test_the_engines_agree_on_a_joint_between_moving_bodies(kind):
    """Accelerations, their derivatives, and energies."""
    rng = np.random.default_rng(7)
    joints = [joint(k, rng, placed=True) for k in (JOINTS["free"], kind, JOINTS["revolute"])]
    bodies = tuple(body(f"b{k}", k - 1 if k else GROUND, on, rng) for k, on in enumerate(joints))
    model = Model("m", None, (), (), bodies)
    with mpmath.workdps(DIGITS):
        q, u = extended(coordinates(model, rng)), extended(rng.normal(size=model.nu))
        dense, recursive = (engine(model, "mpmath") for engine in (DenseEngine, RecursiveEngine))
        assert_close(dense.accelerations(q, u), recursive.accelerations(q, u), EXACT * 1e3)
        seeds = {"dq": rng.normal(size=(2, model.nq)), "du": rng.normal(size=(2, model.nu))}
        one, other = (engine.sensitivities(q, u, **seeds)[1] for engine in (dense, recursive))
        assert_close(one, other, EXACT * 1e5)
        assert_close(dense.energies(q, u), recursive.energies(q, u), EXACT * 1e3)
