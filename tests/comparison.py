"""Comparison of a generated solver with a reference engine, function by function."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from random_models import random_seeds, random_state

import codegen
from codegen.model import Model


def error(x: Any, reference: Any, floor: float = 1e-3) -> float:
    """max |x - ref| / max |ref|, or the absolute error divided by `floor` for results that are zero up to rounding."""
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


FUNCTIONS = ("sensitivities", "output_sensitivities", "energy_sensitivities", "coordinate_rate_sensitivities")
"""Functions of every model along seeds."""


def function_errors(
    solver: codegen.Solver, engine: Any, state: tuple[Any, ...], seeds: dict[str, Any]
) -> dict[str, float]:
    """Errors of values and derivatives of `FUNCTIONS`, and of the forces that drive prescribed coordinates."""
    found = {}
    for name in (*FUNCTIONS, *(["driving_force_sensitivities"] if solver.prescribed_names else [])):
        (x, dx), (y, dy) = (getattr(of, name)(*state, **seeds) for of in (solver, engine))
        if name.startswith("energy"):
            x, y, dx, dy = np.array(x), np.array(y), np.array(dx).T, np.array(dy).T
        found[name] = max(error(x, y), worst(dx, dy))
    return found


def completion_errors(
    solver: codegen.Solver, engine: Any, state: tuple[Any, ...], seeds: dict[str, Any]
) -> dict[str, float]:
    """Errors of quantities that follow from independent speeds and seeds."""
    _, u, dq, du = solver.assemble_sensitivities(*state, **seeds)
    expected = engine.complete(*state, **seeds)
    return {"u": error(u, expected[0]), "dq": worst(dq, expected[1]), "du": worst(du, expected[2])}


def closed_state(solver: codegen.Solver, seed: int, spread: float, t: float = 0.0) -> tuple[Any, ...]:
    """A random state near the initial one with closed loops: the arguments of `accelerations`."""
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    q, u = solver.assemble(q + spread * rng.normal(size=solver.nq), rng.normal(size=solver.nu), t=t)
    return q, u, None, rng.normal(size=solver.ninputs), t


def seeds_of(engine: Any, state: tuple[Any, ...], rng: np.random.Generator, k: int = 3) -> dict[str, Any]:
    """k random seeds. Parameters that would open redundant conditions have the seed zero."""
    seeds = random_seeds(rng, engine.model, k)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        engine.sensitivities(*state, **seeds)
    if any("redundant condition" in str(w.message) for w in caught):
        seeds["dp"] = 0 * seeds["dp"]
    return seeds


TRANSPOSES = {
    "sensitivities": "gradients", "output_sensitivities": "output_gradients", "energy_sensitivities": "energy_gradients",
    "coordinate_rate_sensitivities": "coordinate_rate_gradients", "assemble_sensitivities": "assemble_gradients",
}  # fmt: skip
"""Functions along seeds, and their transposes."""


def transposes(
    solver: codegen.Solver, state: tuple[Any, ...], rng: np.random.Generator, k: int = 2
) -> dict[str, float]:
    """The difference between ``lambda . (J v)`` and ``(J^T lambda) . v``, by function, relative to the sum of the sizes of the
    products."""
    model_sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
    v = {n: rng.uniform(-1, 1, (1, size)) for n, size in model_sizes.items()} | {"dt": rng.uniform(-1, 1, 1)}
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for along, back in TRANSPOSES.items():
            values = getattr(solver, along)(*state, **v)
            if along == "energy_sensitivities":
                Jv = np.stack(values[1], axis=-1)
            elif along == "assemble_sensitivities":
                Jv = np.concatenate(values[2:], axis=-1)
            else:
                Jv = values[1]
            weights = rng.uniform(-1, 1, (k, Jv.shape[-1]))
            given = {"weights": weights}
            if along == "assemble_sensitivities":
                given = {"weights_q": weights[:, : solver.nq], "weights_u": weights[:, solver.nq :]}
            gradients = getattr(solver, back)(*state, **given)
            products = [
                weights * Jv,
                *(np.reshape(g, (k, -1)) * np.reshape(s, -1) for g, s in zip(gradients, v.values(), strict=True)),
            ]
            difference = products[0].sum(axis=-1) - sum(x.sum(axis=-1) for x in products[1:])
            scale = sum(np.abs(x).sum(axis=-1) for x in products)
            found[f"{back}, transposed"] = float(np.max(np.abs(difference) / np.maximum(scale, 1e-3), initial=0.0))
    return found


def compare(
    model: Model, solver: codegen.Solver, engine: Any, rng: np.random.Generator, k: int = 3, transposed: bool = True
) -> dict[str, float]:
    """Relative errors of every function of a solver against an engine at a random state.

    What is `transposed` is compared with the solver itself: for one of several engines that is enough.
    """
    q, u, p, inputs, t = random_state(rng, model)
    seeds = random_seeds(rng, model, k)
    seeds = dict(seeds) if isinstance(seeds, dict) else seeds._asdict()
    dq, du = seeds["dq"], seeds["du"]
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
    still = {name: seed for name, seed in seeds.items() if name != "du"}
    both("mass_matrix_sensitivities", (q, p, inputs, t), **still)
    b, db = rng.normal(size=model.nu), rng.normal(size=(k, model.nu))
    both("solve_mass_sensitivities", (q, b, p, inputs, t), db=db, **still)
    udot, dudot = rng.normal(size=model.nu), rng.normal(size=(k, model.nu))
    both("inverse_dynamics_sensitivities", (q, u, udot, p, inputs, t), dudot=dudot, **seeds)
    both("energy_sensitivities", (q, u, p, inputs, t), **seeds)
    both("output_sensitivities", (q, u, p, inputs, t), **seeds)
    found["mass_matrix"] = error(solver.mass_matrix(q, p, inputs, t), engine.mass_matrix(q, p, inputs, t))
    if model.motion:
        both("driving_force_sensitivities", (q, u, p, inputs, t), **seeds)
    ours, theirs = solver.jacobians(q, u, p, inputs, t), engine.jacobians(q, u, p, inputs, t)
    for name in ("q", "u", "p", "inputs"):
        found[f"J.{name}"] = worst(getattr(ours, name).T, np.asarray(getattr(theirs, name), dtype=float).T)
    found["J.t"] = error(ours.t, theirs.t)
    sizes = {"gradients": model.nu, "output_gradients": len(model.outputs), "energy_gradients": 2,
             "coordinate_rate_gradients": model.nq}  # fmt: skip
    for name, size in sizes.items():
        weights = rng.normal(size=(2, size))
        both_of = (getattr(of, name)(q, u, p, inputs, t, weights=weights) for of in (solver, engine))
        found[name] = max(worst(ours, theirs) for ours, theirs in zip(*both_of, strict=True))
    return found | (transposes(solver, (q, u, p, inputs, t), rng) if transposed else {})
