"""Products with the Hessian of weighted outputs and energies: against differences of gradients in 40 digits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prescribed_models import with_prescribed_at
from random_models import RandomState, random_seeds
from rotor_models import with_rotors_at
from second_derivatives import (
    EXAMPLES,
    agree_with_differences,
    made,
    observed_mechanism,
    observed_tree,
)

import codegen
from codegen.model import Model

OUTPUTS, ENERGIES = "output_hessian_products", "energy_hessian_products"
FUNCTIONS = {
    OUTPUTS: f"output_gradients,{OUTPUTS}",
    ENERGIES: f"energy_gradients,{ENERGIES}",
}


def weights_of(model: Model, products: str, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=2 if products == ENERGIES else len(model.outputs))


def agree(model: Any, state: Any, products: str, folder: Path, limit: float) -> None:
    agree_with_differences(model, state, weights_of(model, products), folder, products, limit)


@pytest.mark.parametrize("products", [OUTPUTS, ENERGIES])
@pytest.mark.parametrize("seed", range(4))
def test_random_trees_agree_with_differences_in_40_digits(seed: int, products: str, tmp_path: Path) -> None:
    model, state = observed_tree(seed)
    agree(model, state, products, tmp_path, 1e-12)


@pytest.mark.parametrize("products", [OUTPUTS, ENERGIES])
@pytest.mark.parametrize("scene", ["spatial", "planar"])
def test_random_mechanisms_agree_with_differences_in_40_digits(scene: str, products: str, tmp_path: Path) -> None:
    model, state = observed_mechanism(25, scene=scene, bodies=(2, 4), loops=(1, 2))
    agree(model, state, products, tmp_path, 1e-10)


@pytest.mark.parametrize("more", [with_prescribed_at, with_rotors_at])
def test_prescribed_motion_and_rotors_in_loops_agree(more: Any, tmp_path: Path) -> None:
    model, state = observed_mechanism(500, scene="spatial", bodies=(3, 4), loops=(1, 2), more=more)
    agree(model, state, ENERGIES, tmp_path, 1e-10)


@pytest.mark.parametrize("name", ["arm", "four_bar"])
def test_both_targets_agree_in_any_number_of_directions_and_states(name: str, tmp_path: Path) -> None:
    """With other products in the same package, whose adjoints share memory."""
    functions = f"accelerations,hessian_products,{OUTPUTS},{ENERGIES}"
    codegen.generate(EXAMPLES / f"{name}.yaml", tmp_path / "package", functions=functions)
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    model = codegen.load_model(EXAMPLES / f"{name}.yaml")
    rng = np.random.default_rng(3)
    q, u = in_c.assemble(*in_c.initial) if in_c.closure_names else in_c.initial
    state = RandomState(q, u + 0.3, np.asarray(in_c.parameters), rng.normal(size=len(in_c.input_names)), 0.0)
    seeds = {n: x for n, x in random_seeds(rng, model, 11).items() if n != "dt"}
    factors = np.array([1.0, -2.0, 0.0])
    for products in (OUTPUTS, ENERGIES, "hessian_products"):
        weights = rng.normal(size=model.nu) if products == "hessian_products" else weights_of(model, products)
        expected = getattr(in_numpy, products)(*state, weights=weights, **seeds)
        largest = max(np.abs(x).max(initial=0) for x in expected)
        for k in (1, 8, 11):
            found = getattr(in_c, products)(*state, weights=weights, **{n: x[:k] for n, x in seeds.items()})
            for x, y in zip(found, expected, strict=True):
                assert np.abs(x - y[:k]).max(initial=0) < 1e-12 * largest
        states = [np.stack([x] * 3) for x in state[:4]]
        batch = {n: x[:, None] for n, x in seeds.items()}
        found = getattr(in_c, products)(*states, state.t, weights=factors[:, None] * weights, **batch)
        for x, y in zip(found, expected, strict=True):
            assert np.abs(x - y[:, None] * factors.reshape(3, *[1] * (y.ndim - 1))).max(initial=0) < 1e-12 * largest


def test_the_kinetic_energy_has_the_mass_matrix(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "double_pendulum.yaml", tmp_path, functions=f"{ENERGIES},mass_matrix")
    q, u = solver.initial
    H = solver.hessians(q, u, weights=[1.0, 0.0], wrt="u", of="energies")
    assert np.abs(H - solver.mass_matrix(q)).max() < 1e-14
    H = solver.hessians(q, u, weights={"potential": 2.0}, wrt="u", of="energies")
    assert not H.any()


def test_messages(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "pendulum.yaml", tmp_path, functions=ENERGIES)
    with pytest.raises(ValueError, match=r"weights has shape \(3,\), expected \(\.\.\., 2\)"):
        solver.energy_hessian_products([0.5], [0.0], weights=[1.0, 2.0, 3.0], dq=[1.0])
    with pytest.raises(ValueError, match="of is 'energy', expected one of accelerations, outputs, energies"):
        solver.hessians([0.5], [0.0], weights=[1.0, 2.0], of="energy")
    with pytest.raises(AttributeError, match="generated without output_hessian_products: add it to --functions"):
        solver.output_hessian_products([0.5], [0.0], weights=[1.0], dq=[1.0])
