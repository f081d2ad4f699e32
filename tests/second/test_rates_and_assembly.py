"""Products with the Hessians of coordinate rates and of assembled states: against differences of gradients in 40 digits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled_mechanisms import tips_joined
from random_mechanisms import random_mechanisms
from random_models import RandomState, random_seeds
from second_derivatives import DIGITS, EXAMPLES, STEP, differences, directions, hessian, joined, made

import codegen

RATES, ASSEMBLY = "coordinate_rate_hessian_products", "assemble_hessian_products"
OF_TREES = f"coordinate_rate_sensitivities,coordinate_rate_gradients,{RATES}"
OF_LOOPS = f"{OF_TREES},assemble_gradients,{ASSEMBLY},assemble_sensitivities"


def opened(name: str, folder: Path, target: str = "numpy") -> codegen.Solver:
    loops = bool(codegen.load_model(EXAMPLES / f"{name}.yaml").closure_names)
    return made(EXAMPLES / f"{name}.yaml", folder, target, OF_LOOPS if loops else OF_TREES)


def state_of(solver: codegen.Solver, longer: float = 1.0) -> RandomState:
    """A consistent state; quaternions are multiplied by `longer`."""
    rng = np.random.default_rng(4)
    q, u = solver.initial
    q, u = solver.assemble(q, u + 0.7 * rng.normal(size=u.shape))
    for i, name in enumerate(solver.coordinate_names):
        if name.endswith(".qw"):
            q[i : i + 4] *= longer
    return RandomState(q, u, np.asarray(solver.parameters), rng.normal(size=len(solver.input_names)), 0.0)


def assembled(solver: Any, state: Any, weights: np.ndarray) -> np.ndarray:
    """Gradient of a weighted sum of assembled coordinates and speeds."""
    parts = weights[None, : solver.nq], weights[None, solver.nq :]
    return joined(solver.assemble_gradients(*state, weights_q=parts[0], weights_u=parts[1]))[0]


def assembled_differences(solver: codegen.Solver, state: Any, weights: np.ndarray) -> np.ndarray:
    """The Hessian of assembly by the guess, which need not close the loops: directions are not completed."""
    exact = solver.in_precision(DIGITS)
    mp = __import__("mpmath").mp.clone()
    mp.dps = DIGITS
    number = np.frompyfunc(mp.mpf, 1, 1)
    found = []
    for sign in (1, -1):
        seeds = directions(solver, state).values()
        moved = [number(x) + sign * number(STEP) * number(d) for x, d in zip(state, seeds, strict=True)]
        found.append(assembled(exact, moved, number(weights)))
    return ((found[0] - found[1]) / (2 * number(STEP))).astype(float)


def assembly_hessian(solver: codegen.Solver, state: Any, weights: np.ndarray) -> np.ndarray:
    parts = {"weights_q": weights[: solver.nq], "weights_u": weights[solver.nq :]}
    return joined(solver.assemble_hessian_products(*state, **parts, **directions(solver, state)))


def close(H: np.ndarray, reference: np.ndarray, limit: float) -> None:
    """Check every entry relative to the largest one."""
    largest = np.abs(reference).max()
    assert largest > 0
    assert np.abs(H - reference).max() < limit * largest


@pytest.mark.parametrize("name", ["four_bar", "double_wishbone", "quadrotor"])
def test_coordinate_rates_agree_with_differences_in_40_digits(name: str, tmp_path: Path) -> None:
    """Dependent rates; rates of a quaternion and of a position."""
    solver = opened(name, tmp_path)
    state = state_of(solver)
    weights = np.random.default_rng(1).normal(size=solver.nq)
    H = hessian(solver, state, weights, RATES)
    close(H, differences(solver, state, weights, "coordinate_rate_gradients"), 1e-12)
    assert np.array_equal(solver.hessians(*state, weights=weights, wrt=None, of="coordinate_rates"), H.T)


@pytest.mark.parametrize("name", ["four_bar", "double_wishbone", "valve_train"])
def test_assembled_states_agree_with_differences_in_40_digits(name: str, tmp_path: Path) -> None:
    solver = opened(name, tmp_path)
    state = state_of(solver)
    weights = np.random.default_rng(2).normal(size=solver.nq + solver.nu)
    H = assembly_hessian(solver, state, weights)
    close(H, assembled_differences(solver, state, weights), 1e-11)
    assert np.abs(H - H.T).max() < 1e-12 * np.abs(H).max()


def test_quaternions_of_any_length_agree(tmp_path: Path) -> None:
    """Assembly divides quaternions by their lengths, in trees and with loops."""
    joined_tips = tips_joined(2, base="free").model()
    trees = opened("quadrotor", tmp_path / "tree")
    for solver in (trees, made(joined_tips, tmp_path / "loops", functions=OF_LOOPS)):
        state = state_of(solver, 1.3)
        weights = np.random.default_rng(3).normal(size=solver.nq + solver.nu)
        close(assembly_hessian(solver, state, weights), assembled_differences(solver, state, weights), 1e-10)


def test_quaternions_that_loops_determine_in_part_agree(tmp_path: Path) -> None:
    """Along directions that keep the loops closed; others are refused."""
    _, (model, *state) = next(random_mechanisms(1, 25, scene="spatial", bodies=(2, 4), loops=(1, 2)))
    solver = made(model, tmp_path, functions=OF_LOOPS)
    q, u = solver.assemble(*state)
    state = RandomState(q, u, *state[2:])
    weights = np.random.default_rng(3).normal(size=solver.nq + solver.nu)
    seeds = {n: x for n, x in directions(solver, state).items() if x.size}
    *_, dq, _ = solver.assemble_sensitivities(*state, **seeds)
    parts = {"weights_q": weights[: solver.nq], "weights_u": weights[solver.nq :]}
    H = joined(solver.assemble_hessian_products(*state, **parts, **{**seeds, "dq": dq}))
    close(H, differences(solver, state, weights, assembled), 1e-10)
    with pytest.raises(
        ValueError, match=r"dq: loops determine a part of the rotation of .* assemble_sensitivities returns"
    ):
        solver.assemble_hessian_products(*state, **parts, **seeds)


@pytest.mark.parametrize("name", ["four_bar", "quadrotor"])
def test_both_targets_and_batches_agree(name: str, tmp_path: Path) -> None:
    solver = opened(name, tmp_path, "both")
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    state = state_of(solver)
    rng = np.random.default_rng(5)
    seeds = {n: x for n, x in random_seeds(rng, codegen.load_model(EXAMPLES / f"{name}.yaml"), 11).items() if n != "dt"}
    of_q, of_u = rng.normal(size=solver.nq), rng.normal(size=solver.nu)
    calls = [
        lambda s, x, f, d: s.coordinate_rate_hessian_products(*x, weights=f * of_q, **d),
        lambda s, x, f, d: s.assemble_hessian_products(*x, weights_q=f * of_q, weights_u=f * of_u, **d),
    ]
    factors = np.array([1.0, -2.0, 0.0])
    states = [*(np.stack([x, x, x]) for x in state[:4]), 0.0]
    along = in_numpy.coordinate_rate_sensitivities(*state, dq=seeds["dq"])
    for x, y in zip(along, in_c.coordinate_rate_sensitivities(*state, dq=seeds["dq"]), strict=True):
        assert np.abs(x - y).max() <= 1e-13 * np.abs(x).max()
    assert along[1].any()
    for call in calls:
        alone = call(in_numpy, state, 1.0, seeds)
        largest = max(np.abs(x).max(initial=0) for x in alone)
        for k in (1, 8, 11):
            found = call(in_c, state, 1.0, {n: x[:k] for n, x in seeds.items()})
            for x, y in zip(found, alone, strict=True):
                assert x.shape == y[:k].shape
                assert np.abs(x - y[:k]).max(initial=0) <= 1e-12 * largest
        batch = call(in_c, states, factors[:, None], {n: x[:, None] for n, x in seeds.items()})
        for x, y in zip(batch, alone, strict=True):
            scaled = factors.reshape(3, *[1] * (y.ndim - 1))
            assert np.abs(x - y[:, None] * scaled).max(initial=0) <= 1e-12 * largest


def test_trees_without_quaternions_have_zeros(tmp_path: Path) -> None:
    solver = opened("pendulum", tmp_path)
    q, u = solver.initial
    for found in (
        solver.coordinate_rate_hessian_products(q, u, weights=[1.0], du=np.ones((3, 1))),
        solver.assemble_hessian_products(q, u, weights_q=[1.0], dq=np.ones((3, 1))),
    ):
        assert found.q.shape == (3, 1) and found.t.shape == (3,)
        assert not any(x.any() for x in found)


def test_wrong_weights_are_named(tmp_path: Path) -> None:
    solver = opened("four_bar", tmp_path)
    q, u = solver.initial
    with pytest.raises(ValueError, match="weights_q has shape"):
        solver.assemble_hessian_products(q, u, weights_q=[1.0, 2.0], dq=[1.0, 0, 0])
    with pytest.raises(ValueError, match="weights has shape"):
        solver.coordinate_rate_hessian_products(q, u, weights=[1.0, 2.0], dq=[1.0, 0, 0])
