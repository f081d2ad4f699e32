"""Hessian products along every direction, and references for their tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import with_outputs
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_mechanisms import random_mechanisms
from random_models import EVERY, RandomState, random_state, random_tree
from rotor_models import with_rotors

import codegen
from codegen.model import Model

EXAMPLES = Path(__file__).parents[1] / "examples"
FUNCTIONS = "accelerations,gradients,hessian_products"
DIGITS, STEP = 40, 1e-12
"""Central differences with this step have an error of about 1e-24, plus 1e-28 of rounding."""


def made(model: Any, folder: Path, target: str = "numpy", functions: str = FUNCTIONS) -> codegen.Solver:
    codegen.generate(model, folder / "package", functions=functions, target=target)
    return codegen.load(folder / "package")


def directions(solver: codegen.Solver, state: Any) -> dict[str, np.ndarray]:
    """One direction for every entry of q, u, p, inputs, t and, if `state` has six parts, udot."""
    parts = [*state[:4], [state[4]], *state[5:]]
    units = np.split(np.eye(sum(map(len, parts))), np.cumsum([len(x) for x in parts[:-1]]), axis=1)
    seeds = dict(zip(("dq", "du", "dp", "dinputs", "dt", "dudot"), units, strict=False))
    return seeds | {"dt": seeds["dt"][:, 0]}


def joined(found: Any) -> np.ndarray:
    """All entries by direction (k, n)."""
    further = [found.udot] if hasattr(found, "udot") else []
    return np.concatenate([found.q, found.u, found.p, found.inputs, found.t[..., None], *further], axis=-1)


def hessian(solver: codegen.Solver, state: Any, weights: np.ndarray, products: str = "hessian_products") -> np.ndarray:
    return joined(getattr(solver, products)(*state, weights=weights, **directions(solver, state)))


def kept_as_given(solver: codegen.Solver, dq: np.ndarray) -> list[bool]:
    """Whether each coordinate is independent; of rotations or positions of one joint, whether loops determine none of them.

    The complete seeds `dq` do not change a quaternion's length, but a given seed may.
    """
    names = solver.coordinate_names
    kept = [n in solver.independent_names for n in names]
    for i, name in enumerate(names):
        for first, count in ((".qw", 4), (".px", 3)):
            if name.endswith(first):
                freedoms = np.linalg.matrix_rank(dq[i : i + count, i : i + count], 1e-9)
                kept[i : i + count] = [kept[i] and freedoms == 3] * count
    return kept


def differences(solver: codegen.Solver, state: Any, weights: np.ndarray, gradients: Any = "gradients") -> np.ndarray:
    """The Hessian from central differences of gradients in 40 digits; with loops, along complete seeds.

    The loops open by the square of the step, on both sides alike, so the difference does not contain this. `gradients` is a
    method of the solver, or a function of the solver in 40 digits, the state and the weights.
    """
    exact = solver.in_precision(DIGITS)
    mp = __import__("mpmath").mp.clone()
    mp.dps = DIGITS
    number = np.frompyfunc(mp.mpf, 1, 1)
    seeds = directions(solver, state)
    if solver.closure_names:
        *_, dq, du = solver.assemble_sensitivities(
            *state[:5], **{n: x for n, x in seeds.items() if x.size and n != "dudot"}
        )
        seeds |= {"dq": np.where(kept_as_given(solver, dq), seeds["dq"], dq), "du": du}
    found = []
    for sign in (1, -1):
        moved = [number(x) + sign * number(STEP) * number(d) for x, d in zip(state, seeds.values(), strict=True)]
        if isinstance(gradients, str):
            found.append(joined(getattr(exact, gradients)(*moved, weights=number(weights)))[0])
        else:
            found.append(gradients(exact, moved, number(weights)))
    return ((found[0] - found[1]) / (2 * number(STEP))).astype(float)


ACCELERATED = ("acceleration", "driving_force")


def without_accelerations(model: Model) -> Model:
    """The model without outputs that read accelerations or forces of prescribed motion."""
    return replace(model, outputs=tuple(o for o in model.outputs if o.measure not in ACCELERATED))


def every_output_of_a_tree(seed: int) -> tuple[Model, RandomState]:
    """A random tree with every ingredient and outputs of every measure, and a state."""
    rng = np.random.default_rng([36, seed])
    model = random_tree(rng, int(rng.integers(2, 5)), EVERY)
    for more in (with_random_elements, with_prescribed, with_rotors):
        if rng.random() < 0.6:
            model = more(rng, model)
    model = with_outputs(rng, model)
    return model, random_state(rng, model)


def every_output_of_a_mechanism(
    seed: int, more: Any = lambda rng, drawn: drawn, **options: Any
) -> tuple[Model, RandomState]:
    """A random mechanism with outputs of every measure, and a state with quaternions of unit length."""
    _, drawn = next(random_mechanisms(1, seed, **options))
    rng = np.random.default_rng([37, seed])
    model, q, u, p, inputs, t = more(rng, drawn)
    q = q.copy()
    for body, (rows, _) in zip(model.bodies, model.coordinate_slices, strict=True):
        for place in body.joint.kind.quaternions:
            q[rows][place] /= np.linalg.norm(q[rows][place])
    return with_outputs(rng, model), RandomState(q, u, p, inputs, t)


def observed_tree(seed: int) -> tuple[Model, RandomState]:
    """A tree whose outputs read no accelerations."""
    model, state = every_output_of_a_tree(seed)
    return without_accelerations(model), state


def observed_mechanism(seed: int, **options: Any) -> tuple[Model, RandomState]:
    """A mechanism whose outputs read no accelerations."""
    model, state = every_output_of_a_mechanism(seed, **options)
    return without_accelerations(model), state


def inverse_products(solver: codegen.Solver, state: tuple[Any, ...], weights: Any, **seeds: np.ndarray) -> Any:
    """Products of the inverse dynamics; the state's last entry is udot."""
    q, u, p, inputs, t, udot = state
    return solver.inverse_dynamics_hessian_products(q, u, udot, p, inputs, t, weights=weights, **seeds)


def inverse_gradient(exact: Any, state: Any, weights: Any) -> Any:
    """The gradient of weighted forces of the inverse dynamics at each row's state, from derivatives along all units."""
    q, u, p, inputs, t, udot = state
    seeds = {n: x[:, None] for n, x in directions(exact, [x[0] for x in state]).items() if x.size}
    _, dforce = exact.inverse_dynamics_sensitivities(q, u, udot, p, inputs, t, **seeds)
    return (dforce @ weights).T


def agree_with_differences(
    model: Model, state: Any, weights: np.ndarray, folder: Path, products: str, limit: float
) -> None:
    """Check every entry relative to the largest, and the symmetry of entries that can be chosen independently."""
    gradients = products.replace("hessian_products", "gradients")
    closed = ",assemble_sensitivities" if model.closure_names else ""
    solver = made(model, folder, functions=f"{gradients},{products}{closed}")
    H, reference = hessian(solver, state, weights, products), differences(solver, state, weights, gradients)
    largest = np.abs(reference).max()
    assert largest > 0
    assert np.abs(H - reference).max() < limit * largest
    apart = True
    if closed:
        *_, dq, _ = solver.assemble_sensitivities(*state, dq=np.eye(state.q.size))
        apart = kept_as_given(solver, dq) == [n in solver.independent_names for n in solver.coordinate_names]
    assert np.abs(H - H.T).max() < 1e-13 * largest or not apart
