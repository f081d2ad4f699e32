"""Equations of random models in sympy, in every form, against their solvers; seeds are the parameters of the tests."""

import contextlib
from pathlib import Path
from typing import Any

import coupled_models
import numpy as np
import point_condition_models as conditions
import pytest
from coupled_coordinates import coupled_tree
from equation_agreement import Agreement
from ingredients import mixtures
from prescribed_models import with_prescribed, with_prescribed_at
from random_elements import with_random_elements
from random_mechanisms import Discarded, random_mechanism
from random_models import random_state, random_tree
from rotor_models import with_rotors, with_rotors_at

import codegen
from codegen.model import Model, parse_model
from codegen.runtime.standalone.errors import AssemblyError
from codegen.symbolic import TooLargeError, equations
from codegen.symbolic.writing import as_sympy

pytestmark = pytest.mark.campaign

STATES = 3
"""At most, beside a given one."""

TOLERANCE = 1e-12

SMALL = 500
"""Terms with intermediate variables up to which equations are multiplied out too."""


def check(model: Model, folder: Path, given: Any, rng: np.random.Generator) -> None:
    """Check all forms with intermediate variables, and those of small models multiplied out, at random states."""
    codegen.generate(model, folder / "made", target="numpy", compile=False, check=False)
    solver = codegen.load(folder / "made")
    states = [] if given is None else [(*solver.assemble(*given), *given[2:])]
    for _ in range(STATES):
        q, u = solver.initial if given is None else given[:2]
        p = solver.parameters if given is None else given[2]
        inputs, t = rng.normal(size=len(model.inputs)), float(rng.uniform())
        q, u = q + 0.03 * rng.normal(size=len(q)), rng.normal(size=len(u))
        try:
            states.append((*solver.assemble(q, u, p, inputs, t), p, inputs, t))
        except AssemblyError:
            continue
    assert states
    for form in ("multipliers", "embedded") if model.loops else ("tree",):
        every = [equations(model, form=form, intermediates=True)]
        if every[0].terms <= SMALL:
            with contextlib.suppress(TooLargeError):
                every.append(equations(model, form=form))
        for found in every:
            agreement = Agreement(model, solver, found)
            errors = [agreement.errors(state) for state in states]
            worst = max((e, name) for of in errors for name, e in of.items())
            assert worst[0] < TOLERANCE, (form, len(found.intermediates), worst)
            assert not found.outputs.refused
            made: dict[str, Any] = {}
            exec(as_sympy(found), made)
            assert all(is_equal(made[name], matrix, rng) for name, matrix in found.matrices.items())


def is_equal(one: Any, other: Any, rng: np.random.Generator) -> bool:
    """Whether two matrices of sympy have equal values at a random point; sympy may order equal products in two ways."""
    symbols = sorted(one.free_symbols | other.free_symbols, key=str)
    at = dict(zip(symbols, rng.uniform(0.3, 0.9, len(symbols)), strict=True))
    pairs = [(a, b) for a, b in zip(one, other, strict=True) if a != b]
    return all(abs((a - b).evalf(30, subs=at)) <= 1e-20 * abs(a.evalf(30, subs=at)) for a, b in pairs)


@pytest.mark.parametrize("seed", range(20))
def test_random_trees_with_elements_rotors_and_motion(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    model = with_rotors(rng, random_tree(rng, int(rng.integers(1, 6))))
    if seed % 2:
        model = with_random_elements(rng, model)
    if seed % 3 == 0:
        model = with_prescribed(rng, model)
    if model.nu:
        check(model, tmp_path, random_state(rng, model), rng)


@pytest.mark.parametrize("seed", range(100, 130))
def test_random_mechanisms(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, bodies=(3, 5), loops=(1, 2))
    if isinstance(drawn, Discarded):
        return
    drawn = with_rotors_at(rng, drawn)
    if seed % 3 == 0:
        drawn = drawn._replace(model=with_random_elements(rng, drawn.model))
    if seed % 3 == 1:
        drawn = with_prescribed_at(rng, drawn) or drawn
    if drawn.model.nu:
        check(drawn.model, tmp_path, drawn[1:], rng)


@pytest.mark.parametrize("seed", range(200, 212))
def test_random_trees_with_couplings(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    drawn = coupled_tree(rng, 5, ("revolute", "prismatic", "universal", "spherical"), 2)
    if drawn is not None:
        check(drawn[0], tmp_path, tuple(drawn[1]), rng)


@pytest.mark.parametrize("mixture", mixtures(every=True), ids=lambda m: m.name)
def test_mixtures(mixture: Any, tmp_path: Path) -> None:
    check(parse_model(mixture.text), tmp_path, None, np.random.default_rng(1))


OTHERS = {
    **{f"condition {name}": text for name, text in conditions.MODELS.items()},
    **{f"coupling {name}": text for name, text in coupled_models.MODELS.items()},
}


@pytest.mark.parametrize("name", OTHERS)
def test_conditions_on_points_and_couplings(name: str, tmp_path: Path) -> None:
    check(parse_model(OTHERS[name]), tmp_path, None, np.random.default_rng(2))
