"""Hessians of motions of random trees: their symmetry, and their gradients against the adjoint method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import random_seeds, random_state, random_tree
from rotor_models import with_rotors

import codegen
from codegen.model.joints import JOINTS
from codegen.runtime import Final, Integral

PLAIN = tuple(name for name, kind in JOINTS.items() if kind.carries and not kind.quaternions)
"""Joints whose speeds are the rates of their coordinates."""


def same_as_adjoint(solver: codegen.Solver, state: tuple[np.ndarray, ...], seconds: float) -> None:
    """Check equal gradients and symmetric Hessians with respect to all parameters, inputs and initial values."""
    q, u, p, inputs = state[:4]
    inputs = inputs[: len(solver.signal_names)]
    wanted = [f(n) for n in solver.output_names[:4] for f in (Final, Integral)]
    wrt = [
        *solver.parameter_names, *(f"inputs.{n}" for n in solver.signal_names), *(f"q0.{n}" for n in solver.independent_names),
        *(f"u0.{n}" for n in solver.independent_names),
    ]  # fmt: skip
    given = {
        "q": q,
        "u": u,
        "p": p,
        "inputs": inputs if len(inputs) else None,
        "wrt": wrt,
        "integrator": "rk4",
        "step": seconds / 3,
    }
    found = solver.judge(seconds, wanted, **given, hessian=True)
    plain = solver.judge(seconds, wanted, **given, method="adjoint")
    scale = np.abs(plain.gradients).max(axis=1, keepdims=True)
    assert (np.abs(found.gradients - plain.gradients) <= 1e-12 * scale).all()
    of_hessian = np.abs(found.hessian_products).max(axis=(1, 2))
    assert of_hessian.max() > 0.0
    skew = np.abs(found.hessian_products - found.hessian_products.transpose(0, 2, 1)).max(axis=(1, 2))
    assert (skew <= 1e-12 * (of_hessian + scale[:, 0])).all()


@pytest.mark.parametrize("seed", (0, 3))
def test_random_trees(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([34, 2, seed])
    model = random_tree(rng, 2 + seed, PLAIN)
    for more in (with_random_elements, with_prescribed, with_rotors)[seed % 2 :]:
        model = more(rng, model)
    codegen.generate(model, tmp_path / "package", functions="motion,hessian_products")
    solver = codegen.load(tmp_path / "package")
    same_as_adjoint(solver, random_state(rng, model), 0.03)


def test_products_at_states_are_the_same_with_and_without_motions(tmp_path: Path) -> None:
    """With motions, the sweeps of all products store the gradient too."""
    names = ("hessian_products", "energy_hessian_products", "inverse_dynamics_hessian_products")
    rng = np.random.default_rng([34, 3])
    model = random_tree(rng, 3, PLAIN)
    state, seeds = random_state(rng, model), random_seeds(rng, model, 2)
    found = []
    for more in ((), ("motion",)):
        folder = tmp_path / f"package{len(more)}"
        codegen.generate(model, folder, functions=[*more, *names])
        solver = codegen.load(folder)
        q, u, *rest = state
        udot = np.linspace(-1, 1, model.nu)
        products, energies, forces = (getattr(solver, name) for name in names)
        found.append(
            [
                products(*state, weights=udot, **seeds),
                energies(*state, weights=[1.0, 0.5], **seeds),
                forces(q, u, udot, *rest, weights=udot, **seeds),
            ]
        )
    for one, other in zip(*found, strict=True):
        for key in ("q", "u", "p", "inputs", "t"):
            a, b = getattr(one, key), getattr(other, key)
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * max(1.0, np.abs(a).max(initial=0.0)))
