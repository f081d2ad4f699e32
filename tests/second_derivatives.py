"""Hessian products along every direction, and what tests compare them with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import codegen

EXAMPLES = Path(__file__).parents[1] / "examples"
FUNCTIONS = "accelerations,gradients,hessian_products"
DIGITS, STEP = 40, 1e-12
"""Central differences with this step have an error of about 1e-24, plus 1e-28 of rounding."""


def made(model: Any, folder: Path, target: str = "numpy", functions: str = FUNCTIONS) -> codegen.Solver:
    codegen.generate(model, folder / "package", functions=functions, target=target)
    return codegen.load(folder / "package")


def directions(solver: codegen.Solver, state: Any) -> dict[str, np.ndarray]:
    """One direction for every entry of q, u, p, inputs and t."""
    parts = [*state[:4], [state.t]]
    units = np.split(np.eye(sum(map(len, parts))), np.cumsum([len(x) for x in parts[:-1]]), axis=1)
    seeds = dict(zip(("dq", "du", "dp", "dinputs", "dt"), units, strict=True))
    return seeds | {"dt": seeds["dt"][:, 0]}


def joined(found: Any) -> np.ndarray:
    """All entries by direction (k, n)."""
    return np.concatenate([*found[:4], found.t[..., None]], axis=-1)


def hessian(solver: codegen.Solver, state: Any, weights: np.ndarray) -> np.ndarray:
    return joined(solver.hessian_products(*state, weights=weights, **directions(solver, state)))
