"""Random mechanisms: the recursive engine against the dense method, and identities of closed loops."""

import dataclasses

import mpmath
import numpy as np
import pytest
from loop_closure import closure
from random_mechanisms import (
    DRAWN,
    LOOP_JOINTS,
    Discarded,
    assemble,
    condition,
    random_mechanism,
    random_mechanisms,
    random_partition,
)
from random_models import expression, random_seeds, relative_error

from codegen.loops import PartitionError, partition
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def case(seed, mechanism, k=3):
    """Engines with a partition that is not the best, seeds, and the condition number of the closure."""
    rng = np.random.default_rng([seed, 7])
    chosen = random_partition(rng, mechanism.model, mechanism.q, mechanism.p)
    engines = [engine(mechanism.model, partition=chosen) for engine in ENGINES]
    seeds = random_seeds(rng, mechanism.model, k)
    return engines, seeds, condition(chosen, mechanism.model, mechanism.q, mechanism.p)


def check(name, a, b, tolerance):
    error = relative_error(np.asarray(a).reshape(len(a), -1), np.asarray(b).reshape(len(b), -1))
    assert error < tolerance, f"{name}: {error:.2e}"


@pytest.mark.parametrize("first", [*range(2), *(pytest.param(i, marks=pytest.mark.campaign) for i in range(2, 6))])
def test_the_engines_agree(first):
    for seed, m in random_mechanisms(5, 1000 * first):
        (one, two), seeds, cond = case(seed, m)
        tolerance = max(1e-9, 50 * np.finfo(float).eps * cond**2)
        (udot, dudot), (udot_d, dudot_d) = (e.sensitivities(*m[1:], **seeds) for e in (one, two))
        check("udot", [udot], [udot_d], 1e-10)
        check("dudot", dudot, dudot_d, tolerance)
        of_motion = {name: seeds[name] for name in ("dq", "du", "dp")}
        for i, (a, b) in enumerate(zip(*(e.complete(m.q, m.u, m.p, **of_motion) for e in (one, two)), strict=True)):
            check(("u", "dq", "du")[i], np.atleast_2d(a), np.atleast_2d(b), 1e-10)
        for (a, da), (b, db) in (
            [e.output_sensitivities(*m[1:], **seeds) for e in (one, two)],
            [e.coordinate_rate_sensitivities(*m[1:], **of_motion) for e in (one, two)],
            [e.energy_sensitivities(*m[1:], **of_motion) for e in (one, two)],
            [e.mass_matrix_sensitivities(m.q, m.p, dq=seeds["dq"], dp=seeds["dp"]) for e in (one, two)],
        ):
            check("value", [a], [b], 1e-11)
            check("derivatives", np.array(da), np.array(db), tolerance)


@pytest.mark.parametrize("first", [0, *(pytest.param(i, marks=pytest.mark.campaign) for i in (1, 2))])
def test_with_the_partition_of_the_generator(first):
    for seed, m in random_mechanisms(4, 500 + 1000 * first):
        try:
            chosen = partition(m.model)
        except PartitionError:
            continue
        seeds = random_seeds(np.random.default_rng(seed), m.model, 2)
        (a, da), (b, db) = (e(m.model).sensitivities(*m[1:], **seeds) for e in ENGINES)
        check("udot", [a], [b], 1e-10)
        check("dudot", da, db, max(1e-9, 50 * np.finfo(float).eps * condition(chosen, m.model, m.q, m.p) ** 2))


@pytest.mark.parametrize("type", LOOP_JOINTS)
def test_every_loop_joint(type):
    for seed, m in random_mechanisms(2, 17, scene="spatial", loop_joints=(type,), loops=(1, 1)):
        (one, two), seeds, cond = case(seed, m)
        opened = m.q + 0.3 * np.sin(np.arange(m.model.nq))
        lengths = [ear.length for ear in one.partition.ears]
        residuals = [e.closure(opened, m.u, m.p)[0] for e in (one, two)]
        residuals.append(closure(m.model, opened, m.u, m.p, lengths)[0])  # a third witness
        for a in residuals[1:]:
            assert a.shape == (len(m.model.closure_names),)
            check("residual", [a], [residuals[0]], 1e-13)
        (a, da), (b, db) = (e.sensitivities(*m[1:], **seeds) for e in (one, two))
        check("udot", [a], [b], 1e-10)
        tolerance = max(1e-9, 50 * np.finfo(float).eps * cond**2)
        if relative_error(da, db) > tolerance:
            # of these random dependents one moves 36 times as fast as an independent: the mass matrix of the independents has
            # condition 3e4, the whole one 56. The recursion forms the former and its derivative and loses that, once in udot
            # (2e-11), squared in the derivative (7e-9); the dense method does not, nor does the recursion in 40 digits
            check("dudot in doubles", da, db, 1e-7)
            with mpmath.workdps(40):
                exact = RecursiveEngine(m.model, partition=one.partition, numbers="mpmath")
                da = np.array(exact.sensitivities(*m[1:], **seeds)[1], float)
        check("dudot", da, db, tolerance)


@pytest.mark.parametrize("type", LOOP_JOINTS)
def test_the_accelerations_keep_the_loops_closed(type):
    """Along q + h q' + h^2 q''/2 a closed position stays closed to the third order, in numbers of 60 digits."""
    ((seed, m),) = random_mechanisms(1, 40, scene="spatial", loop_joints=(type,), loops=(1, 1), bodies=(3, 4))
    chosen = random_partition(np.random.default_rng(seed), m.model, m.q, m.p)
    with mpmath.workdps(60):
        for engine in ENGINES:
            e = engine(m.model, "mpmath", chosen)
            q = assemble(DenseEngine(m.model, "mpmath", chosen), m.q, m.p)
            u, _, _ = e.complete(q, m.u, m.p)
            udot = e.accelerations(q, u, *m[3:])
            qdot = e.coordinate_rates(q, u, m.p)
            _, qddot = e.coordinate_rate_sensitivities(q, u, m.p, dq=qdot, du=udot)
            h = mpmath.mpf(10) ** -12
            position, velocity = e.closure(q + h * qdot + h**2 / 2 * qddot[0], u + h * udot, m.p)
            assert abs(e.closure(q, u, m.p)[0]).max() < 1e-55
            assert abs(e.closure(q, u, m.p)[1]).max() < 1e-55
            assert abs(position).max() < 1e3 * h**3
            assert abs(velocity).max() < 1e3 * h**2


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scene", ["spatial", "planar", "spherical"])
def test_derivatives_are_those_of_differences_of_assembled_systems(engine, scene):
    """Every perturbed system is assembled anew, to 50 digits; a central difference with steps of 1e-18 has 35 of them."""
    ((seed, m),) = random_mechanisms(1, 60, scene=scene, bodies=(3, 4), loops=(1, 2))
    rng = np.random.default_rng(seed)
    chosen, seeds = random_partition(rng, m.model, m.q, m.p), random_seeds(rng, m.model, 1)
    with mpmath.workdps(50):
        e, assembling = engine(m.model, "mpmath", chosen), DenseEngine(m.model, "mpmath", chosen)
        d = {name: e.arithmetic.array(seed)[0] for name, seed in seeds.items()}
        q, *others = (e.arithmetic.array(x) for x in (assemble(assembling, m.q, m.p), m.u, m.p, m.inputs))
        _, dudot = e.sensitivities(q, *others, m.t, **seeds)
        h, both = mpmath.mpf(10) ** -18, []
        for step in (h, -h):
            u, p, inputs = (x + step * d[name] for x, name in zip(others, ("du", "dp", "dinputs"), strict=True))
            moved = assemble(assembling, q + step * d["dq"], p)
            both.append(e.accelerations(moved, u, p, inputs, mpmath.mpf(m.t) + step * d["dt"]))
        assert relative_error(dudot, ((both[0] - both[1]) / (2 * h))[None]) < 1e-29


@pytest.mark.parametrize("engine", ENGINES)
def test_constraints_hold_in_velocity_and_acceleration(engine):
    for seed, m in random_mechanisms(5, 300):
        engines, _, _ = case(seed, m)
        e, dense = engines[ENGINES.index(engine)], engines[1]
        state = dense._state(*m[1:])
        known, udot = dense._conditions(state), e.accelerations(*m[1:])
        J, B = known.jacobian.value, known.remainder.value[:, 0]
        assert np.abs(J @ udot + B).max() <= 1e-12 * (np.abs(J).sum(axis=1).max() * np.abs(udot).max() + 1)
        u, _, _ = e.complete(m.q, m.u, m.p)
        assert np.abs(e.closure(m.q, u, m.p)[1]).max() <= 1e-12 * np.abs(J).sum(axis=1).max() * np.abs(u).max()


@pytest.mark.parametrize("engine", ENGINES)
def test_power_balance(engine):
    """The energy, the springs' included, changes by the power of the joint forces; without them it is kept."""
    for seed, m in random_mechanisms(5, 400, forces=False):
        undamped = tuple(dataclasses.replace(s, damping=expression(0)) for s in m.model.loads)
        m = m._replace(model=dataclasses.replace(m.model, loads=undamped))
        e = case(seed, m)[0][ENGINES.index(engine)]
        u, _, _ = e.complete(m.q, m.u, m.p)
        udot, qdot = e.accelerations(m.q, u, *m[3:]), e.coordinate_rates(m.q, u, m.p)
        _, (dT, dV) = e.energy_sensitivities(m.q, u, *m[3:], dq=qdot, du=udot)
        assert abs(dT[0] + dV[0]) < 1e-11 * (abs(dT[0]) + 1)


@pytest.mark.parametrize("engine", ENGINES)
def test_what_dependent_entries_are_does_not_matter(engine):
    for seed, m in random_mechanisms(4, 500):
        engines, seeds, _ = case(seed, m)
        e = engines[ENGINES.index(engine)]
        other = {name: x.copy() for name, x in seeds.items()}
        other["dq"][:, e.dependent_coordinates] += 3.0
        other["du"][:, e.dependent] -= 2.0
        u = m.u.copy()
        u[e.dependent] = 17.0
        a, da = e.sensitivities(m.q, m.u, *m[3:], **seeds)
        b, db = e.sensitivities(m.q, u, *m[3:], **other)
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(da, db)
        J = e.jacobians(*m[1:])
        assert not J.q[:, e.dependent_coordinates].any() and not J.u[:, e.dependent].any()
        expected = seeds["dq"] @ J.q.T + seeds["du"] @ J.u.T + seeds["dp"] @ J.p.T + seeds["dinputs"] @ J.inputs.T
        assert relative_error(da, expected + np.outer(seeds["dt"], J.t)) < 1e-11


def test_the_generator_discards_little_and_reaches_everything():
    drawn = [random_mechanism(np.random.default_rng(seed)) for seed in range(45)]
    discarded = [x for x in drawn if isinstance(x, Discarded)]
    assert len(discarded) < 0.05 * len(drawn), [x.reason for x in discarded]
    models = [x.model for x in drawn if not isinstance(x, Discarded)]
    assert {loop.type for model in models for loop in model.loops} == set(DRAWN)
    assert {len(model.loops) for model in models} == {1, 2, 3}
    assert any(model.loads for model in models) and any(model.gravity is None for model in models)
    for m in drawn[:20]:
        if not isinstance(m, Discarded):
            position, velocity = DenseEngine(
                m.model, partition=random_partition(np.random.default_rng(1), m.model, m.q, m.p)
            ).closure(*m[1:4])
            assert np.abs(position).max() < 1e-13 and np.abs(velocity).max() < 1e-13
