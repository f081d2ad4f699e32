"""Hessian products of the generic engines, whose numbers are duals: against generated solvers, and in 40 digits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from random_models import random_seeds
from second_derivatives import EXAMPLES, made, observed_mechanism, observed_tree

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (DenseEngine, RecursiveEngine)
OF = {
    "hessian_products": ("gradients", lambda m: m.nu),
    "output_hessian_products": ("output_gradients", lambda m: len(m.outputs)),
    "energy_hessian_products": ("energy_gradients", lambda m: 2),
}


def gap(found: Any, expected: Any) -> float:
    """The largest difference relative to the largest entry or to 1, since only rounding is left where all entries vanish."""
    found, expected = (np.concatenate([np.ravel(np.asarray(x, float)) for x in of]) for of in (found, expected))
    assert np.abs(expected).max() > 0
    return float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))


def agree(model: Model, state: Any, folder: Path, limit: float) -> None:
    """Check both engines and the generated solver for accelerations, outputs and energies."""
    wanted = {n: of for n, of in OF.items() if model.outputs or "output" not in n}
    solver = made(model, folder, functions=",".join([*wanted, *(of for of, _ in wanted.values())]))
    rng = np.random.default_rng(7)
    seeds = random_seeds(rng, model, 2)
    for name, (_, size) in wanted.items():
        weights = rng.normal(size=size(model))
        found = getattr(solver, name)(*state, weights=weights, **seeds)
        for engine in ENGINES:
            assert gap(getattr(engine(model), name)(*state, weights=weights, **seeds), found) < limit


def test_a_random_tree(tmp_path: Path) -> None:
    """Force elements, rotors, prescribed motion, outputs."""
    agree(*observed_tree(1), tmp_path, 1e-11)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [seed for seed in range(2, 22) if seed != 11])  # in 11 all motion is prescribed
def test_more_random_trees(seed: int, tmp_path: Path) -> None:
    agree(*observed_tree(seed), tmp_path, 1e-10)


def test_a_random_mechanism(tmp_path: Path) -> None:
    agree(*observed_mechanism(25, scene="planar", bodies=(2, 3), loops=(1, 1)), tmp_path, 1e-10)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scene", ["spatial", "planar"])
def test_more_random_mechanisms(scene: str, seed: int, tmp_path: Path) -> None:
    agree(*observed_mechanism(seed, scene=scene, bodies=(2, 4), loops=(1, 2)), tmp_path, 1e-9)


@pytest.mark.campaign
def test_redundant_conditions(tmp_path: Path) -> None:
    model = codegen.load_model(EXAMPLES / "bricard.yaml")
    solver = made(model, tmp_path, functions="hessian_products,gradients")
    q, u = solver.initial
    q, u = solver.assemble(q, u + 0.3)
    rng = np.random.default_rng(3)
    seeds, weights = {n: x for n, x in random_seeds(rng, model, 2).items() if n != "dp"}, rng.normal(size=model.nu)
    found = solver.hessian_products(q, u, weights=weights, **seeds)
    for engine in ENGINES:
        assert gap(engine(model).hessian_products(q, u, weights=weights, **seeds), found) < 1e-11


def test_inverse_dynamics(tmp_path: Path) -> None:
    model, state = observed_tree(1)
    solver = made(model, tmp_path, functions="inverse_dynamics_hessian_products")
    rng = np.random.default_rng(5)
    q, u, *rest = state
    udot, weights = rng.normal(size=(2, model.nu))
    seeds = random_seeds(rng, model, 2) | {"dudot": rng.normal(size=(2, model.nu))}
    found = solver.inverse_dynamics_hessian_products(q, u, udot, *rest, weights=weights, **seeds)
    for engine in ENGINES:
        products = engine(model).inverse_dynamics_hessian_products(q, u, udot, *rest, weights=weights, **seeds)
        assert gap(products, found) < 1e-11


@pytest.mark.parametrize("numbers", ["mpmath", "decimal"])
def test_a_pendulum_in_40_digits(numbers: str) -> None:
    """``udot = -g sin(q)/l``: the product by q along q is ``g sin(q)/l``."""
    model = codegen.load_model(EXAMPLES / "double_pendulum.yaml")
    q, weights = [1.2, -0.4], [0.7, -0.3]
    with mpmath.workdps(40), __import__("decimal").localcontext(prec=40):
        engine = DenseEngine(model, numbers)
        H = engine.hessian_products(q, [0, 0], weights=weights, dq=np.eye(2, dtype=int))[0]
        assert abs(H[0, 1] - H[1, 0]) < 1e-37
        ordinary = DenseEngine(model).hessian_products(q, [0, 0], weights=weights, dq=np.eye(2, dtype=int))[0]
    assert np.abs(H.astype(float) - ordinary).max() < 1e-13 * np.abs(ordinary).max()


SPRING = """
model: spring
parameters: {m: 2, k: 30, c: 0.5, n: 3}
bodies:
  block:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: m
forces:
  spring: {type: joint, joint: block, value: "-k*abs(q.block)**n*sign(q.block) - c*u.block*max(u.block, 0)"}
"""


def test_powers_roots_and_branches() -> None:
    """``udot = -(k |q|^n sign(q) + c u max(u, 0))/m`` on both sides of both branches."""
    engine = DenseEngine(parse_model(SPRING))
    m, k, c, n = 2.0, 30.0, 0.5, 3.0
    for q, u in ((0.7, 1.1), (-0.7, -1.1)):
        found = engine.hessian_products([q], [u], weights=[1], dq=[1], du=[1])
        by_q, by_u, by_p = (np.asarray(x, float)[0] for x in found[:3])
        side, x = np.sign(q), abs(q)
        assert by_q[0] == pytest.approx(-k * n * (n - 1) * x ** (n - 2) * side / m, rel=1e-14)
        assert by_u[0] == pytest.approx(-2 * c * (u > 0) / m, rel=1e-14)
        first = -k * n * x ** (n - 1) / m, -2 * c * max(u, 0) / m  # of udot by q and by u
        by_n = -k * x ** (n - 1) * (1 + n * np.log(x)) / m
        expected = [-sum(first) / m, first[0] / k, first[1] / c, by_n]
        assert by_p == pytest.approx(expected, rel=1e-13)
