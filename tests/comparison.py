"""Comparison of a generated solver with a reference engine, function by function."""

from __future__ import annotations

from typing import Any

import numpy as np
from random_models import random_seeds, random_state

import codegen
from codegen.model import Model


def error(x: Any, reference: Any, floor: float = 1e-3) -> float:
    """max |x - ref| / max |ref|; the floor is for results that are zero up to rounding."""
    x, reference = (np.asarray(v, dtype=float).ravel() for v in (x, reference))
    assert x.shape == reference.shape
    if not x.size:
        return 0.0
    return float(np.max(np.abs(x - reference)) / max(np.max(np.abs(reference)), floor))


def worst(rows: Any, references: Any) -> float:
    """Largest error over directions.

    A direction whose derivative is zero (turning a whole mechanism about the vertical, say) has nothing but rounding to
    compare; it is measured against a thousandth of the largest derivative.
    """
    references = [np.asarray(r, dtype=float) for r in references]
    floor = 1e-3 * max([1.0, *(float(np.max(np.abs(r), initial=0.0)) for r in references)])
    return max((error(x, y, floor) for x, y in zip(rows, references, strict=True)), default=0.0)


def compare(
    model: Model, solver: codegen.Solver, engine: Any, rng: np.random.Generator, k: int = 3
) -> dict[str, float]:
    """Relative errors of every function of a solver against an engine at a random state."""
    q, u, p, inputs, t = random_state(rng, model)
    seeds = random_seeds(rng, model, k)
    seeds = dict(seeds) if isinstance(seeds, dict) else seeds._asdict()
    dq, du, dp = seeds["dq"], seeds["du"], seeds["dp"]
    found: dict[str, float] = {}

    def both(name: str, arguments: tuple[Any, ...], **directions: Any) -> None:
        a, da = getattr(solver, name)(*arguments, **directions)
        b, db = getattr(engine, name)(*arguments, **directions)
        if name == "energy_sensitivities":
            a, b, da, db = np.array(a), np.array(b), np.array(da).T, np.array(db).T
        found[name] = max(error(a, b), worst(da, db))

    found["accelerations"] = error(solver.accelerations(q, u, p, inputs, t), engine.accelerations(q, u, p, inputs, t))
    both("sensitivities", (q, u, p, inputs, t), **seeds)
    both("coordinate_rate_sensitivities", (q, u, p, inputs, t), dq=dq, du=du)
    both("mass_matrix_sensitivities", (q, p), dq=dq, dp=dp)
    b, db = rng.normal(size=model.nu), rng.normal(size=(k, model.nu))
    both("solve_mass_sensitivities", (q, b, p), dq=dq, dp=dp, db=db)
    udot, dudot = rng.normal(size=model.nu), rng.normal(size=(k, model.nu))
    both("inverse_dynamics_sensitivities", (q, u, udot, p, inputs, t), dudot=dudot, **seeds)
    both("energy_sensitivities", (q, u, p, inputs, t), dq=dq, du=du, dp=dp)
    both("output_sensitivities", (q, u, p, inputs, t), **seeds)
    found["mass_matrix"] = error(solver.mass_matrix(q, p), engine.mass_matrix(q, p))
    ours, theirs = solver.jacobians(q, u, p, inputs, t), engine.jacobians(q, u, p, inputs, t)
    for name in ("q", "u", "p", "inputs"):
        found[f"J.{name}"] = worst(getattr(ours, name).T, np.asarray(getattr(theirs, name), dtype=float).T)
    found["J.t"] = error(ours.t, theirs.t)
    return found
