"""Products with the Hessian of weighted joint forces of the inverse dynamics: against differences in 40 digits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import EVERY, random_seeds, random_state, random_tree
from rotor_models import with_rotors
from second_derivatives import EXAMPLES, differences, directions, inverse_gradient, inverse_products, joined, made

import codegen
from codegen.model import Model

FUNCTIONS = "inverse_dynamics,inverse_dynamics_sensitivities,inverse_dynamics_hessian_products"


def drawn(seed: int) -> tuple[Model, tuple[Any, ...], np.ndarray]:
    """A random tree with every ingredient, a state with udot, and weights."""
    rng = np.random.default_rng([35, seed])
    model = random_tree(rng, int(rng.integers(1, 5)), EVERY)
    for more in (with_random_elements, with_prescribed, with_rotors):
        if rng.random() < 0.6:
            model = more(rng, model)
    return model, (*random_state(rng, model), rng.normal(size=model.nu)), rng.normal(size=model.nu)


@pytest.mark.parametrize("seed", (1, 4, 5, 6))
def test_every_entry_agrees_with_differences_in_40_digits(seed: int, tmp_path: Path) -> None:
    """Relative to the largest entry, and the matrix is symmetrical to rounding."""
    model, state, weights = drawn(seed)
    solver = made(model, tmp_path, functions=FUNCTIONS)
    H = joined(inverse_products(solver, state, weights, **directions(solver, state)))
    reference = differences(solver, state, weights, inverse_gradient)
    largest = np.abs(reference).max()
    assert largest > 0
    assert np.abs(H - reference).max() < 1e-12 * largest
    assert np.abs(H - H.T).max() < 1e-13 * largest


def test_the_product_with_udot_is_that_of_the_mass_matrix(tmp_path: Path) -> None:
    """``weights . force = weights . (M udot - K)``: its gradient by udot is ``M weights``."""
    solver = made(EXAMPLES / "double_pendulum.yaml", tmp_path, functions=f"{FUNCTIONS},mass_matrix_sensitivities")
    q, u = solver.initial
    weights, dq = np.array([0.7, -0.4]), np.array([[0.3, 1.1]])
    found = solver.inverse_dynamics_hessian_products(q, u, 0 * u, weights=weights, dq=dq)
    _, dM = solver.mass_matrix_sensitivities(q, dq=dq)
    assert np.abs(found.udot - dM @ weights).max() < 1e-14


@pytest.mark.parametrize("seed", (1, 6))
def test_both_targets_agree_in_any_number_of_directions_and_states(seed: int, tmp_path: Path) -> None:
    """With the products of the forward dynamics in the same package, whose adjoints share memory."""
    model, state, weights = drawn(seed)
    several = f"{FUNCTIONS},accelerations,hessian_products"
    codegen.generate(model, tmp_path / "package", functions=several)
    codegen.generate(model, tmp_path / "alone", functions=FUNCTIONS)
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    alone = codegen.load(tmp_path / "alone")
    rng = np.random.default_rng(seed)
    seeds = random_seeds(rng, model, 11) | {"dudot": rng.normal(size=(11, model.nu))}
    expected = inverse_products(in_numpy, state, weights, **seeds)
    largest = max(np.abs(x).max(initial=0) for x in expected)
    for k in (1, 8, 11):
        given = {n: x[:k] for n, x in seeds.items()}
        for solver in (in_c, alone):
            for x, y in zip(inverse_products(solver, state, weights, **given), expected, strict=True):
                assert np.abs(x - y[:k]).max(initial=0) < 1e-13 * largest
    by_state = tuple(np.stack([x] * 3) if np.ndim(x) else x for x in state)
    factors = np.array([1.0, -2.0, 0.0])
    batch = inverse_products(in_c, by_state, factors[:, None] * weights, **{n: x[:, None] for n, x in seeds.items()})
    for x, y in zip(batch, expected, strict=True):
        assert np.abs(x - y[:, None] * factors.reshape(3, *[1] * (y.ndim - 1))).max(initial=0) < 1e-13 * largest
    given = {n: x for n, x in seeds.items() if n not in ("dudot",)}
    forward = [s.hessian_products(*state[:5], weights=weights, **given) for s in (in_c, in_numpy)]
    largest = max(np.abs(x).max(initial=0) for x in forward[1])
    for x, y in zip(*forward, strict=True):
        assert np.abs(x - y).max(initial=0) < 1e-12 * largest


def test_messages(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "pendulum.yaml", tmp_path, functions=FUNCTIONS)
    with pytest.raises(ValueError, match=r"weights has shape \(2,\), expected \(\.\.\., 1\)"):
        solver.inverse_dynamics_hessian_products([0.5], [0.0], [0.0], weights=[1.0, 2.0], dq=[1.0])
    with pytest.raises(AttributeError, match="generated without hessian_products: add it to --functions"):
        solver.hessian_products([0.5], [0.0], weights=[1.0], dq=[1.0])
