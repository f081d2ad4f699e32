"""Hessians of motions of models with ball and free joints: against differences of gradients, symmetry, and the adjoint method."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import seen
from random_mechanisms import random_mechanisms
from random_models import random_state, random_tree

import codegen
from codegen.runtime import At, Final, Integral, LeastSquares

FUNCTIONS = "motion,hessian_products,coordinate_rate_hessian_products"


def drawn(kind: str, seed: int) -> tuple[Any, ...]:
    """A model with a state, parameters and inputs."""
    if kind == "loops":
        size: dict[str, Any] = {"bodies": (2, 4), "loops": (1, 1), "joints": ("spherical", "revolute")}
        _, found = next(random_mechanisms(1, seed, scene="spatial", **size))
        return seen(found.model), found.q, found.u, found.p, found.inputs
    rng = np.random.default_rng([34, 7, seed])
    model = seen(random_tree(rng, 2, ("free", "spherical", "revolute") if kind == "free" else ("spherical",)))
    return model, *random_state(rng, model)[:4]


@pytest.mark.parametrize(("kind", "seed"), [("balls", 1), ("free", 2), ("loops", 0)])
def test_hessians_equal_differences(kind: str, seed: int, tmp_path: Path) -> None:
    """Along parameters, speeds, and changes of coordinates that keep the lengths of quaternions."""
    model, q, u, p, inputs = drawn(kind, seed)
    codegen.generate(model, tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    names = solver.coordinate_names
    turns = [i for i, n in enumerate(names) if n.endswith(".qw")]
    assert turns
    for i in turns:
        q[i : i + 4] /= np.linalg.norm(q[i : i + 4])
    along = np.eye(q.size)
    for i in turns:
        along[:, i : i + 4] -= np.outer(along[:, i : i + 4] @ q[i : i + 4], q[i : i + 4])
    parts = (np.eye(p.size), along, np.eye(u.size))
    factors = np.block(
        [[x if i == j else np.zeros((len(x), y.shape[1])) for j, y in enumerate(parts)] for i, x in enumerate(parts)]
    )
    free_q = [n in solver.independent_names for n in names]
    free_u = [n in solver.independent_speed_names for n in solver.speed_names]
    free = np.array([*(True for _ in p), *free_q, *free_u])
    wrt = [*solver.parameter_names, *(f"q0.{n}" for n in names), *(f"u0.{n}" for n in solver.speed_names)]
    wrt, factors = [n for n, kept in zip(wrt, free, strict=True) if kept], factors[np.ix_(free, free)]
    samples = LeastSquares([0.01, 0.027], {"speed": [0.5, 0.2]}, sigma=0.3)
    wanted = [Final("height"), Final("kinetic"), Integral("kinetic"), At("speed", 0.014), samples]

    def judge(x: np.ndarray, **given: Any) -> Any:
        moved = np.concatenate([p, q, u])
        moved[free] += x
        new_p, new_q, new_u = np.split(moved, np.cumsum([p.size, q.size]))
        if kind == "loops":
            new_q, new_u = solver.assemble(new_q, new_u, new_p)
        given |= {"inputs": inputs[: len(solver.signal_names)], "wrt": wrt, "integrator": "rk4", "step": 0.01}
        return solver.judge(0.03, wanted, new_q, new_u, new_p, **given)

    found, plain = judge(np.zeros(len(wrt)), hessian=factors), judge(np.zeros(len(wrt)), method="adjoint")
    hessians = found.hessian_products @ factors.T
    scale, of_gradient = np.abs(hessians).max(axis=(1, 2)), np.abs(plain.gradients).max(axis=1, keepdims=True)
    assert (scale > 1e-6).all()
    assert (np.abs(found.gradients - plain.gradients) < 1e-12 * of_gradient).all()
    assert (np.abs(hessians - hessians.transpose(0, 2, 1)).max(axis=(1, 2)) < 1e-12 * scale).all()
    for i, direction in enumerate(factors):
        h = 2e-4 if kind == "loops" else 1e-3
        sides = [
            judge(n * h * direction, method="adjoint").gradients - judge(-n * h * direction, method="adjoint").gradients
            for n in (1, 2, 3)
        ]
        differences = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h) @ factors.T
        assert (np.abs(hessians[:, i] - differences).max(axis=1) < 1e-7 * scale).all(), wrt[i]


def test_a_package_without_the_function_says_which(tmp_path: Path) -> None:
    model, *_ = drawn("balls", 1)
    codegen.generate(model, tmp_path / "package", functions="motion,hessian_products")
    solver = codegen.load(tmp_path / "package")
    message = "without coordinate_rate_hessian_products; .* --functions 'motion, hessian_products, coordinate_rate"
    with pytest.raises(codegen.runtime.PackageError, match=message):
        solver.judge(0.1, Final("height"), wrt=solver.parameter_names[:1], hessian=True)
