"""The recursive engine against the dense method: two formulations that share only the model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_elements import with_random_elements
from random_models import ALL, random_seeds, random_state, random_tree, relative_error

from codegen.reference import DenseEngine, RecursiveEngine

TOLERANCE = 1e-11

trees = {
    "seed": st.integers(0, 2**32 - 1),
    "n": st.integers(1, 10),
    "joints": st.sets(st.sampled_from(ALL[1:]), min_size=1).map(lambda x: tuple(sorted(x)) + ("fixed",)),
}


def case(seed, n, joints):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n, joints)
    if seed % 2:
        model = with_random_elements(rng, model)
    return model, random_state(rng, model), random_seeds(rng, model, 3), rng


def check(name, a, b, tolerance=TOLERANCE):
    error = relative_error(a, b)
    assert error < tolerance, f"{name}: {error:.2e}"


@settings(max_examples=30, derandomize=True, deadline=None)
@given(**trees)
def test_accelerations_and_total_derivatives(seed, n, joints):
    model, state, seeds, _ = case(seed, n, joints)
    (udot, dudot), (udot_d, dudot_d) = (e(model).sensitivities(*state, **seeds) for e in (RecursiveEngine, DenseEngine))
    check("udot", udot, udot_d)
    check("dudot", dudot, dudot_d)
    check("udot alone", RecursiveEngine(model).accelerations(*state), udot, 1e-15)


@settings(max_examples=40, derandomize=True, deadline=None)
@given(**trees)
def test_every_column_of_the_jacobians(seed, n, joints):
    model, state, _, _ = case(seed, min(n, 6), joints)
    a, b = (engine(model).jacobians(*state) for engine in (RecursiveEngine, DenseEngine))
    nu = model.nu
    assert a.q.shape == (nu, model.nq) and a.u.shape == (nu, nu) and a.t.shape == (nu,)
    assert a.p.shape == (nu, len(model.parameters)) and a.inputs.shape == (nu, len(model.inputs))
    for name in ("q", "u", "p", "inputs", "t"):
        # A column that is zero (the rotation of a lone body does not matter) is rounding of what the others are made of.
        reference = getattr(b, name).T
        floor = 0.01 * np.abs(reference).max(initial=0.1)
        assert relative_error(getattr(a, name).T, reference, floor) < TOLERANCE, name


@settings(max_examples=20, derandomize=True, deadline=None)
@given(**trees)
def test_everything_else_and_its_derivatives(seed, n, joints):
    model, (q, u, p, inputs, t), seeds, rng = case(seed, n, joints)
    one, two = RecursiveEngine(model), DenseEngine(model)
    udot, dudot = rng.uniform(-1, 1, model.nu), rng.uniform(-1, 1, (3, model.nu))
    of_q = {name: seeds[name] for name in ("dq", "dp")}
    calls = {
        "solve_mass_sensitivities": ((q, udot, p), of_q | {"db": dudot}),
        "mass_matrix_sensitivities": ((q, p), of_q),
        "inverse_dynamics_sensitivities": ((q, u, udot, p, inputs, t), seeds | {"dudot": dudot}),
        "coordinate_rate_sensitivities": ((q, u, p, inputs, t), seeds),
        "output_sensitivities": ((q, u, p, inputs, t), seeds),
    }
    for name, (arguments, directions) in calls.items():
        (a, da), (b, db) = (getattr(e, name)(*arguments, **directions) for e in (one, two))
        check(name, a.reshape(1, -1), b.reshape(1, -1))
        check(name, da.reshape(3, -1), db.reshape(3, -1))
    (a, da), (b, db) = (e.energy_sensitivities(q, u, p, inputs, t, **seeds) for e in (one, two))
    check("energies", np.array(a)[:, None], np.array(b)[:, None])
    check("energies", np.concatenate(da)[:, None], np.concatenate(db)[:, None], 1e-10)
    # The methods without derivatives are the same numbers.
    np.testing.assert_array_equal(one.mass_matrix(q, p), one.mass_matrix_sensitivities(q, p, **of_q)[0])
    np.testing.assert_array_equal(one.energies(q, u, p, inputs, t), a)
    np.testing.assert_array_equal(
        one.outputs(q, u, p, inputs, t), one.output_sensitivities(q, u, p, inputs, t, **seeds)[0]
    )


@pytest.mark.parametrize("joint", ALL[1:])
@pytest.mark.parametrize("parameters", [False, True])
def test_each_joint_alone(joint, parameters):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        model = random_tree(rng, 3, (joint,), parameters=parameters, forces=bool(seed % 2))
        state, seeds = random_state(rng, model), random_seeds(rng, model, 2)
        (a, da), (b, db) = (e(model).sensitivities(*state, **seeds) for e in (RecursiveEngine, DenseEngine))
        check(joint, a, b)
        check(joint, da, db)


@pytest.mark.campaign
@pytest.mark.parametrize("test", [test_accelerations_and_total_derivatives, test_everything_else_and_its_derivatives])
def test_more_trees(test):
    settings(max_examples=60, derandomize=True, deadline=None)(given(**trees)(test.hypothesis.inner_test))()
