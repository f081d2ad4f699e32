"""Products with the Hessian of weighted accelerations: against closed forms, and differences of gradients in 40 digits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import EVERY, RandomState, random_seeds, random_state, random_tree
from rotor_models import with_rotors
from second_derivatives import EXAMPLES, FUNCTIONS, differences, hessian, made

import codegen
from codegen.model import Model, parse_model


def test_a_result_that_is_not_finite_has_the_name_of_the_method(tmp_path: Path) -> None:
    rod = {"joint": {"type": "revolute", "axis": "y"}, "parent": "ground",
           "shape": {"type": "rod", "axis": "z", "length": 1, "mass": 1}}  # fmt: skip
    odd = {
        "model": "odd",
        "bodies": {"rod": rod},
        "forces": {"drive": {"type": "joint", "joint": "rod", "value": "-sqrt(q.rod)"}},
    }
    model = parse_model(json.dumps(odd), "odd.yaml")
    with pytest.warns(RuntimeWarning, match="odd: q of hessian_products is not finite"):
        made(model, tmp_path).hessian_products([0.0], [0.0], weights=[1.0], dq=[1.0])


def drawn(seed: int) -> tuple[Model, Any, np.ndarray]:
    """A random tree with every ingredient, a state and weights."""
    rng = np.random.default_rng([34, seed])
    model = random_tree(rng, int(rng.integers(1, 5)), EVERY)
    for more in (with_random_elements, with_prescribed, with_rotors):
        if rng.random() < 0.6:
            model = more(rng, model)
    return model, random_state(rng, model), rng.normal(size=model.nu)


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return made(EXAMPLES / "pendulum.yaml", tmp_path_factory.mktemp("pendulum"))


def test_a_pendulum_has_the_hessian_of_its_closed_form(pendulum: codegen.Solver) -> None:
    """udot = -(g / length) sin q, with weight w."""
    assert pendulum.parameter_names == ("g", "length", "mass")
    q, g, length, w = 0.7, 9.7, 1.3, 1.9
    s, c = np.sin(q), np.cos(q)
    by_q = [g / length * s, 0, -c / length, g * c / length**2, 0]
    by_g = [-c / length, 0, 0, s / length**2, 0]
    by_length = [g * c / length**2, 0, s / length**2, -2 * g * s / length**3, 0]
    expected = w * np.array([by_q, [0] * 5, by_g, by_length, [0] * 5])
    units = np.split(np.eye(5), (1, 2), axis=1)
    found = pendulum.hessian_products([q], [0.4], [g, length, 2.0], weights=[w], dq=units[0], du=units[1], dp=units[2])
    H = np.concatenate([found.q, found.u, found.p], axis=1)
    assert np.abs(H - expected).max() < 1e-14 * np.abs(expected).max()
    assert found.inputs.shape == (5, 0) and not found.t.any()
    given = {"q": [[q], [q]], "u": [[0.4], [0.1]], "p": [g, length, 2.0], "weights": [w]}
    whole = pendulum.hessians(**given)
    assert whole.shape == (2, 5, 5) and (whole == H.T).all()
    by_p_and_t = pendulum.hessians(**given, wrt="t, p")
    assert (by_p_and_t[0, :3, :3] == H.T[2:, 2:]).all() and not by_p_and_t[:, 3].any()
    with pytest.raises(ValueError, match="wrt: the model has no inputs; choose others of q, u, p, inputs, t"):
        pendulum.hessians(**given, wrt="inputs")


def test_a_solver_without_the_function_tells_how_to_get_it(tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / "pendulum.yaml", tmp_path / "x", target="numpy")
    with pytest.raises(AttributeError, match="generated without hessian_products: add it to --functions"):
        codegen.load(tmp_path / "x").hessian_products([0.5], [0.0], weights=[1.0], dq=[1.0])
    files = [f for f in (tmp_path / "x").iterdir() if f.suffix in (".c", ".h", ".py")]
    assert files and not any("hessian" in f.read_text() or "_adjoint" in f.read_text() for f in files)
    assert "def hessian_products" not in (tmp_path / "x" / "_runtime" / "solver.py").read_text()


def test_messages_name_the_weights(pendulum: codegen.Solver) -> None:
    q, u = pendulum.initial
    with pytest.raises(ValueError, match=r"weights has shape \(2,\), expected \(\.\.\., 1\)"):
        pendulum.hessian_products(q, u, weights=[1.0, 2.0], dq=[1.0])
    with pytest.raises(ValueError, match="no seed given"):
        pendulum.hessian_products(q, u, weights=[1.0])


def test_powers_with_varying_exponents_in_formulas(tmp_path: Path) -> None:
    """Their tangents guard against infinite factors, which have tangents, too."""
    text = """
model: powers
parameters: {a: 0.7, b: 1.2}
bodies:
  bar: {parent: ground, joint: {type: revolute, axis: [0, 0, 1]}, mass: 1.0, inertia: {xx: 1, yy: 1, zz: a*b}}
forces:
  drive: {type: joint, joint: bar, value: -b*(1 + 0.3*a)**(t/2)*q.bar**3 + sqrt(2 + u.bar)**(a*t)}
"""
    solver = made(codegen.parse_model(text), tmp_path)
    state = RandomState(np.array([0.4]), np.array([0.2]), np.array([0.7, 1.2]), np.zeros(0), 0.9)
    H, reference = (f(solver, state, np.array([1.3])) for f in (hessian, differences))
    assert np.abs(H[-1]).min() > 0.01
    assert np.abs(H - reference).max() < 1e-14 * np.abs(reference).max()


def test_an_infinite_second_derivative_affects_only_directions_that_change_its_operand(tmp_path: Path) -> None:
    text = """
model: powers
parameters: {a: 0.7}
bodies:
  bar: {parent: ground, joint: {type: revolute, axis: [0, 0, 1]}, mass: 1.0, inertia: {xx: 1, yy: 1, zz: a}}
forces:
  drive: {type: joint, joint: bar, value: -abs(q.bar)**1.5*(1 + t**2) - a*u.bar**3}
"""
    solver = made(codegen.parse_model(text), tmp_path)
    state = RandomState(np.array([0.0]), np.array([0.2]), np.array([0.7]), np.zeros(0), 0.9)
    with pytest.warns(RuntimeWarning, match="hessian_products is not finite"):
        H = hessian(solver, state, np.array([1.3]))
    assert not np.isfinite(H[0, 0]) and np.isfinite(H.ravel()[1:]).all()
    beside = RandomState(np.array([1e-30]), *state[1:])
    reference = differences(solver, beside, np.array([1.3]))
    assert np.abs(H[1:, 1:] - reference[1:, 1:]).max() < 1e-12 * np.abs(reference[1:, 1:]).max()
    assert not H[1:, 0].any()
    moved = RandomState(np.array([0.4]), *state[1:])
    H, reference = (f(solver, moved, np.array([1.3])) for f in (hessian, differences))
    assert np.abs(H - reference).max() < 1e-14 * np.abs(reference).max()


@pytest.mark.parametrize("seed", range(4))
def test_every_entry_agrees_with_differences_in_40_digits(seed: int, tmp_path: Path) -> None:
    """Relative to the largest entry of a row, and the product is symmetrical to rounding."""
    model, state, weights = drawn(seed)
    if not model.nu:
        pytest.skip("no degrees of freedom")
    solver = made(model, tmp_path)
    H, reference = hessian(solver, state, weights), differences(solver, state, weights)
    largest = np.abs(reference).max()
    assert np.abs(H - reference).max() < 1e-12 * largest
    assert np.abs(H - H.T).max() < 1e-13 * largest


@pytest.mark.parametrize("seed", (0, 1))
def test_both_targets_agree_in_any_number_of_directions_and_states(seed: int, tmp_path: Path) -> None:
    model, state, weights = drawn(seed)
    codegen.generate(model, tmp_path / "package", functions=FUNCTIONS)
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    rng = np.random.default_rng(seed)
    seeds = random_seeds(rng, model, 11)
    alone = in_numpy.hessian_products(*state, weights=weights, **seeds)
    largest = max(np.abs(x).max(initial=0) for x in alone)
    for k in (1, 8, 11):
        found = in_c.hessian_products(*state, weights=weights, **{n: x[:k] for n, x in seeds.items()})
        for x, y in zip(found, alone, strict=True):
            assert np.abs(x - y[:k]).max(initial=0) < 1e-13 * largest
    states = [np.stack([x, x, x]) for x in state[:4]]
    scaled = np.array([1.0, -2.0, 0.0])[:, None] * weights
    out = tuple(np.empty((11, 3, *x.shape[1:])) for x in alone)
    batch = {n: x[:, None] for n, x in seeds.items()}
    found = in_c.hessian_products(*states, state.t, weights=scaled, **batch, out=out)
    assert all(x is y for x, y in zip(found, out, strict=True))
    for x, y in zip(found, alone, strict=True):
        assert np.abs(x - y[:, None] * np.array([1.0, -2.0, 0.0]).reshape(3, *[1] * (y.ndim - 1))).max(initial=0) < (
            1e-13 * largest
        )
