"""Products with the Hessian of the inverse dynamics of models with loops: against differences in 40 digits.

The forces are those along independent speeds. The gradients in 40 digits follow from the kinetic energy and from forward
dynamics (`loop_forces`), so they share no sweep with the products.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled_coordinates import coupled_tree
from prescribed_models import with_prescribed_at
from random_models import EVERY, RandomState, random_seeds
from rotor_models import with_rotors_at
from second_derivatives import (
    EXAMPLES,
    differences,
    directions,
    every_output_of_a_mechanism,
    inverse_gradient,
    inverse_products,
    joined,
    kept_as_given,
    made,
)

import codegen
from codegen.model import Model

PRODUCTS = "inverse_dynamics_hessian_products"
REFERENCE = "accelerations,sensitivities,energies,energy_sensitivities,assemble_sensitivities"


def drawn(solver: codegen.Solver, state: Any) -> tuple[tuple[Any, ...], np.ndarray]:
    """The state with udot, and weights of the forces."""
    rng = np.random.default_rng(5)
    return (*state, rng.normal(size=solver.nu)), rng.normal(size=len(solver.independent_speed_names))


def agree(model: Any, folder: Path, limit: float, state: Any = None) -> None:
    """Check every entry relative to the largest, and the symmetry of entries that can be chosen independently."""
    solver = made(model, folder, functions=f"{PRODUCTS},{REFERENCE}")
    if state is None:
        q, u = solver.initial
        q, u = solver.assemble(q, u + 0.3)
        state = RandomState(q, u, np.asarray(solver.parameters), np.full(len(solver.input_names), 0.4), 0.0)
    state, weights = drawn(solver, state)
    H = joined(inverse_products(solver, state, weights, **directions(solver, state)))
    reference = differences(solver, state, weights, inverse_gradient)
    largest = np.abs(reference).max()
    assert largest > 0
    assert np.abs(H - reference).max() < limit * largest
    *_, dq, _ = solver.assemble_sensitivities(*state[:5], dq=np.eye(state[0].size))
    apart = kept_as_given(solver, dq) == [n in solver.independent_names for n in solver.coordinate_names]
    assert np.abs(H - H.T).max() < 1e-12 * largest or not apart


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "valve_train"])
def test_examples_agree_with_differences_in_40_digits(name: str, tmp_path: Path) -> None:
    agree(EXAMPLES / f"{name}.yaml", tmp_path, 1e-11)


@pytest.mark.parametrize(("scene", "seed"), [("spatial", 0), ("planar", 25), ("spherical", 50)])
def test_random_mechanisms_agree_with_differences_in_40_digits(scene: str, seed: int, tmp_path: Path) -> None:
    model, state = every_output_of_a_mechanism(seed, scene=scene, bodies=(2, 4), loops=(1, 2))
    agree(model, tmp_path, 1e-10, state)


@pytest.mark.parametrize("more", [with_prescribed_at, with_rotors_at])
def test_prescribed_motion_and_rotors_agree(more: Any, tmp_path: Path) -> None:
    model, state = every_output_of_a_mechanism(500, scene="spatial", bodies=(3, 4), loops=(1, 2), more=more)
    agree(model, tmp_path, 1e-10, state)


@pytest.mark.parametrize(("bodies", "couplings"), [(3, 1), pytest.param(4, 2, marks=pytest.mark.campaign)])
def test_couplings_agree(bodies: int, couplings: int, tmp_path: Path) -> None:
    found = coupled_tree(np.random.default_rng(2), bodies, EVERY, couplings)
    assert found is not None
    agree(found[0], tmp_path, 1e-11, found[1])


def mechanism() -> tuple[Model, RandomState]:
    return every_output_of_a_mechanism(0, scene="spatial", bodies=(2, 4), loops=(1, 2))


@pytest.mark.parametrize("more", ["", ",accelerations,hessian_products"], ids=["alone", "several"])
def test_both_targets_agree_in_any_number_of_directions_and_states(more: str, tmp_path: Path) -> None:
    """Alone, and with the products of the forward dynamics, which run the same sweeps."""
    model, state = mechanism()
    codegen.generate(model, tmp_path / "package", functions=PRODUCTS + more)
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    state, weights = drawn(in_c, state)
    rng = np.random.default_rng(3)
    seeds = random_seeds(rng, model, 11) | {"dudot": rng.normal(size=(11, model.nu))}
    expected = inverse_products(in_numpy, state, weights, **seeds)
    largest = max(np.abs(x).max(initial=0) for x in expected)
    for k in (1, 8, 11):
        found = inverse_products(in_c, state, weights, **{n: x[:k] for n, x in seeds.items()})
        for x, y in zip(found, expected, strict=True):
            assert np.abs(x - y[:k]).max(initial=0) < 1e-12 * largest
    by_state = tuple(np.stack([x] * 3) if np.ndim(x) else x for x in state)
    factors = np.array([1.0, -2.0, 0.0])
    batch = inverse_products(in_c, by_state, factors[:, None] * weights, **{n: x[:, None] for n, x in seeds.items()})
    for x, y in zip(batch, expected, strict=True):
        assert np.abs(x - y[:, None] * factors.reshape(3, *[1] * (y.ndim - 1))).max(initial=0) < 1e-12 * largest
    if more:
        given = {n: x for n, x in seeds.items() if n != "dudot"}
        forward = [s.hessian_products(*state[:5], weights=state[5], **given) for s in (in_c, in_numpy)]
        largest = max(np.abs(x).max(initial=0) for x in forward[1])
        for x, y in zip(*forward, strict=True):
            assert np.abs(x - y).max(initial=0) < 1e-12 * largest


def test_dependent_entries_are_ignored_and_their_results_are_zero(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "four_bar.yaml", tmp_path, functions=PRODUCTS)
    q, u = solver.initial
    along = np.array([[1.0, 0.0, 0.0], [1.0, 5.0, -3.0]])
    one = solver.inverse_dynamics_hessian_products(q, u, along[0], weights=[2.0], dq=along, dudot=along)
    other = solver.inverse_dynamics_hessian_products(q, u, along[1], weights={"crank": 2.0}, dq=along, dudot=along)
    for x, y in zip(one, other, strict=True):
        assert (x == y).all() and (x[0] == x[1]).all()
    assert not one.udot[:, 1:].any() and one.udot[:, 0].all()


def test_messages(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "four_bar.yaml", tmp_path, functions=PRODUCTS)
    q, u = solver.initial
    with pytest.raises(ValueError, match=r"weights has shape \(3,\), expected \(\.\.\., 1\): one for each independent"):
        solver.inverse_dynamics_hessian_products(q, u, 0 * u, weights=[1.0, 0.0, 0.0], dq=u)
    with pytest.raises(ValueError, match="weights: 'rocker' is a dependent speed"):
        solver.inverse_dynamics_hessian_products(q, u, 0 * u, weights={"rocker": 1.0}, dq=u)
