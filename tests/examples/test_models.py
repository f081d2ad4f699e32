"""Every shipped model loads without a warning, and its compiled solver agrees with the generic recursive engine."""

from pathlib import Path

import numpy as np
import pytest
from random_models import random_seeds, random_state, relative_error

import codegen
from codegen.reference import RecursiveEngine

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = sorted(EXAMPLES.glob("*.yaml"))
TOLERANCE = 1e-10


def test_the_examples_are_there():
    assert {m.stem for m in MODELS} >= {"double_pendulum", "chain", "arm", "satellite", "tree"}


@pytest.mark.parametrize("path", MODELS, ids=lambda p: p.stem)
def test_a_model_loads_without_warnings_and_is_named_after_its_file(path):
    model = codegen.load_model(path)
    assert model.warnings == ()
    assert model.name == path.stem
    assert model.outputs and model.parameters


@pytest.fixture(scope="module", params=MODELS, ids=lambda p: p.stem)
def generated(request, tmp_path_factory):
    model = codegen.load_model(request.param)
    folder = tmp_path_factory.mktemp("generated") / model.name
    codegen.generate(model, folder)
    return model, codegen.load(folder)


def test_a_solver_agrees_with_the_generic_engine(generated):
    model, solver = generated
    engine, rng = RecursiveEngine(model), np.random.default_rng(7)
    for _ in range(4):
        state, seeds = random_state(rng, model), random_seeds(rng, model, 3)
        for method in ("sensitivities", "output_sensitivities"):
            values, tangents = getattr(solver, method)(*state, **seeds)
            expected, dexpected = getattr(engine, method)(*state, **seeds)
            assert relative_error(values, expected) < TOLERANCE, method
            assert relative_error(tangents, dexpected) < TOLERANCE, method


def test_a_solver_starts_at_the_initial_state_of_the_file(generated):
    model, solver = generated
    q, u = solver.initial
    engine = RecursiveEngine(model)
    assert relative_error(solver.accelerations(q, u), engine.accelerations(q, u)) < TOLERANCE
