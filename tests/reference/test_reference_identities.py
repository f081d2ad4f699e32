"""Identities that hold for any tree and formulation: balance, symmetry, power, quaternions, linearity."""

import numpy as np
import pytest
from random_models import ALL, random_seeds, random_state, random_tree, relative_error

from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)


def cases(count, **options):
    for seed in range(count):
        rng = np.random.default_rng(1000 + seed)
        model = random_tree(rng, int(rng.integers(1, 9)), **options)
        yield model, random_state(rng, model), rng


@pytest.mark.parametrize("engine", ENGINES)
def test_inverse_dynamics_of_the_accelerations_is_zero(engine):
    for model, (q, u, p, inputs, t), rng in cases(12):
        e, seeds = engine(model), random_seeds(rng, model, 3)
        udot, dudot = e.sensitivities(q, u, p, inputs, t, **seeds)
        tau, dtau = e.inverse_dynamics_sensitivities(q, u, udot, p, inputs, t, **seeds, dudot=dudot)
        scale = np.abs(e.mass_matrix(q, p)).sum(axis=1).max() * np.abs(udot).max()
        assert np.abs(tau).max() <= 1e-13 * scale
        dscale = np.abs(e.mass_matrix(q, p)).sum(axis=1).max() * (np.abs(dudot).max() + np.abs(udot).max())
        assert np.abs(dtau).max() <= 1e-12 * dscale


@pytest.mark.parametrize("engine", ENGINES)
def test_mass_matrix(engine):
    for model, (q, u, p, inputs, t), _ in cases(12):
        e = engine(model)
        M = e.mass_matrix(q, p)
        assert relative_error(M.ravel(), M.T.ravel()) < 1e-14
        assert np.linalg.eigvalsh(M).min() > 0
        # Its columns are differences of the inverse dynamics.
        still = e.inverse_dynamics(q, u, np.zeros(model.nu), p, inputs, t)
        columns = np.array([e.inverse_dynamics(q, u, x, p, inputs, t) - still for x in np.eye(model.nu)])
        assert relative_error(columns.ravel(), M.ravel()) < 1e-11
        assert relative_error(e.solve_mass(q, M @ u, p), u) < 1e-11
        # Kinetic energy is the quadratic form.
        assert np.isclose(e.energies(q, u, p)[0], u @ M @ u / 2, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_power_balance(engine):
    """The energy changes by the power of the joint forces, and is kept without them."""
    for with_forces in (False, True):
        for model, (q, u, p, inputs, t), _ in cases(12, forces=with_forces):
            e = engine(model)
            udot, qdot = e.accelerations(q, u, p, inputs, t), e.coordinate_rates(q, u, p, inputs, t)
            _, (dT, dV) = e.energy_sensitivities(q, u, p, inputs, t, dq=qdot, du=udot)
            assert dT.shape == dV.shape == (1,)
            names = {f"q.{n}": float(q[i]) for i, n in enumerate(model.coordinate_names)}
            names |= {f"u.{n}": float(u[i]) for i, n in enumerate(model.speed_names)}
            names |= dict(zip(model.parameter_names, p.tolist(), strict=True))
            names |= dict(zip(model.inputs, inputs.tolist(), strict=True))
            tau = np.zeros(model.nu)
            for force in model.forces:
                tau[model.coordinate_slices[force.body][1]] += [x.evaluate(names | {"t": t}) for x in force.values]
            assert abs(dT[0] + dV[0] - tau @ u) < 1e-12 * (abs(dT[0]) + np.abs(tau * u).sum() + 1)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_quaternion_may_have_any_length(engine):
    for model, (q, u, p, inputs, t), _ in cases(6, joints=("spherical", "free"), forces=False):
        e = engine(model)
        longer, radial = q.copy(), np.zeros_like(q)
        for rows, _ in model.coordinate_slices:
            longer[rows.stop - 4 : rows.stop] *= 3.7
            radial[rows.stop - 4 : rows.stop] = q[rows.stop - 4 : rows.stop]
        assert relative_error(e.accelerations(longer, u, p, inputs, t), e.accelerations(q, u, p, inputs, t)) < 1e-13
        udot, dudot = e.sensitivities(q, u, p, inputs, t, dq=radial)
        assert np.abs(dudot).max() <= 1e-12 * np.abs(udot).max()


@pytest.mark.parametrize("engine", ENGINES)
def test_sensitivities_are_linear_in_the_seeds_and_made_of_the_jacobians(engine):
    for model, state, rng in cases(8):
        e, seeds = engine(model), random_seeds(rng, model, 4)
        _, dudot = e.sensitivities(*state, **seeds)
        J = e.jacobians(*state)
        expected = seeds["dq"] @ J.q.T + seeds["du"] @ J.u.T + seeds["dp"] @ J.p.T + seeds["dinputs"] @ J.inputs.T
        assert relative_error(dudot, expected + np.outer(seeds["dt"], J.t)) < 1e-12


def test_generated_models_hold_what_they_promise():
    """The random models reach every joint, branching, massless bodies, children before parents, no gravity."""
    seen = set()
    for seed in range(80):
        model = random_tree(np.random.default_rng(seed), 8)
        seen |= {b.joint.type for b in model.bodies}
        parents = [b.parent for b in model.bodies]
        seen |= {"branching"} if len(set(parents)) < len(parents) else set()
        seen |= {"child first"} if any(p > k for k, p in enumerate(parents)) else set()
        seen |= {"massless"} if any(b.mass.is_number and b.mass.value == 0 for b in model.bodies) else set()
        seen |= {"no gravity" if model.gravity is None else "gravity"}
    assert seen == {*ALL, "branching", "child first", "massless", "no gravity", "gravity"}
