"""Rotations and positions with both dependent and independent speeds: the engines against each other and differences.

What of a seed counts is its rotation vector, or displacement, in child axes: components along independent speeds are kept, the
others follow from closure.
"""

import dataclasses

import mpmath
import numpy as np
import pytest
from loop_closure import independent_coordinates
from random_mechanisms import assemble, condition, random_mechanisms
from random_models import random_seeds, relative_error
from split_mechanisms import BY_HAND, by_hand

from codegen.loops import partition
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def split_random(count, first):
    """Random mechanisms with spherical and free joints, whose partition splits some of them."""
    for seed, m in random_mechanisms(20 * count, first, joints=("revolute", "spherical", "free"), scene="spatial"):
        if count and partition(m.model).split(m.model):
            yield seed, m
            count -= 1


def agree(m, seed):
    one, two = (e(m.model) for e in ENGINES)
    seeds = random_seeds(np.random.default_rng(seed), m.model, 3)
    tolerance = max(1e-9, 50 * np.finfo(float).eps * condition(one.partition, m.model, m.q, m.p) ** 2)
    (a, da), (b, db) = (e.sensitivities(*m[1:], **seeds) for e in (one, two))
    assert relative_error(a, b) < 1e-10
    assert relative_error(da, db) < tolerance
    of_motion = {name: seeds[name] for name in ("dq", "du", "dp")}
    for x, y in zip(*(e.complete(m.q, m.u, m.p, **of_motion) for e in (one, two)), strict=True):
        assert relative_error(x, y) < 1e-10
    for x, y in zip(*(dataclasses.astuple(e.jacobians(*m[1:])) for e in (one, two)), strict=True):
        assert relative_error(x.T, y.T) < tolerance


@pytest.mark.parametrize("name", BY_HAND)
def test_the_engines_agree(name):
    agree(by_hand(name), 1)


@pytest.mark.parametrize(
    ("count", "first"), [(1, 0), *(pytest.param(3, 1000 * i, marks=pytest.mark.campaign) for i in range(4))]
)
def test_the_engines_agree_on_random_mechanisms(count, first):
    for seed, m in split_random(count, first):
        agree(m, seed)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", BY_HAND)
def test_derivatives_are_those_of_differences_of_assembled_systems(engine, name):
    """A seed moves the guess, assembly moves it back along the dependent components: what is left is the completed seed."""
    m = by_hand(name)
    chosen, seeds = partition(m.model), random_seeds(np.random.default_rng(3), m.model, 1)
    with mpmath.workdps(50):
        e, assembling = engine(m.model, "mpmath", chosen), DenseEngine(m.model, "mpmath", chosen)
        d = {x: e.arithmetic.array(seed)[0] for x, seed in seeds.items()}
        q, u = assemble(assembling, m.q, m.p), e.arithmetic.array(m.u)
        _, dudot = e.sensitivities(q, u, **{x: seeds[x] for x in ("dq", "du")})
        h, both = mpmath.mpf(10) ** -18, []
        for step in (h, -h):
            both.append(e.accelerations(assemble(assembling, q + step * d["dq"], m.p), u + step * d["du"]))
        assert relative_error(dudot, ((both[0] - both[1]) / (2 * h))[None]) < 1e-29


@pytest.mark.parametrize("engine", ENGINES)
def test_components_along_independent_speeds_are_kept_and_the_others_are_not_read(engine):
    for name in BY_HAND:
        m = by_hand(name)
        e, rng = engine(m.model), np.random.default_rng(5)
        tree = engine(dataclasses.replace(m.model, loops=()))  # speeds there are as given
        dq = random_seeds(rng, m.model, 2)["dq"]
        _, full, _ = e.complete(m.q, m.u, m.p, dq=dq)
        other = dq.copy()
        for group in e.split:
            columns = {s: tree.coordinate_rates(m.q, np.eye(m.model.nu)[s])[group.coordinates] for s in group.speeds}
            size = {s: c @ c for s, c in columns.items()}
            given, found = dq[:, group.coordinates], full[:, group.coordinates]
            for s in set(group.speeds) - set(e.dependent):
                assert np.abs((found - given) @ columns[s] / size[s]).max() < 1e-13
            for s in set(group.speeds) & set(e.dependent):
                other[:, group.coordinates] += rng.normal(size=(2, 1)) * columns[s]
            if len(given[0]) == 4:  # a quaternion's length
                other[:, group.coordinates] += m.q[group.coordinates]
        assert np.abs(e.complete(m.q, m.u, m.p, dq=other)[1] - full).max() < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
def test_columns_of_jacobians_are_derivatives_along_unit_seeds(engine):
    for name in BY_HAND:
        m = by_hand(name)
        e = engine(m.model)
        J = e.jacobians(*m[1:])
        _, along = e.sensitivities(*m[1:], dq=np.eye(m.model.nq))
        assert relative_error(J.q.T, along) < 1e-13  # in other company a product's last columns round differently
        split = [i for group in e.split for i in range(m.model.nq)[group.coordinates]]
        assert set(split) <= set(independent_coordinates(m.model, e.partition))
        assert np.abs(J.q[:, split]).max() > 0.01
        assert not J.q[:, e.dependent_coordinates].any()
