"""Every shipped model loads without a warning, and its compiled solver agrees with a reference engine."""

from pathlib import Path

import numpy as np
import pytest
from loop_closure import assemble
from random_models import RandomState, random_seeds, random_state, relative_error

import codegen
from codegen.loops import AssemblyError, initial_configuration, partition
from codegen.reference import DenseEngine, RecursiveEngine

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = sorted(EXAMPLES.glob("*.yaml"))
TOLERANCE = 1e-10


def test_the_examples_are_there():
    trees = {"double_pendulum", "chain", "arm", "satellite", "tree"}
    assert {m.stem for m in MODELS} > trees, "mechanisms have a table in test_mechanisms.py"


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
    codegen.generate(model, folder, functions=("accelerations", "sensitivities", "output_sensitivities"), compile="all")
    return model, codegen.load(folder)


def engine_of(model):
    """The reference engine: the dense one for mechanisms, since it formulates closure differently."""
    return DenseEngine(model) if model.loops else RecursiveEngine(model)


def closed_state(rng, model):
    """A random state of a mechanism near its initial one: other independent coordinates, other parameters, assembled."""
    chosen, (guess, _) = partition(model), initial_configuration(model)
    for _ in range(20):
        _, u, p, inputs, t = random_state(rng, model)
        p = np.array([x.value for x in model.parameters]) * rng.uniform(0.99, 1.01, len(p))
        q = guess + rng.uniform(-0.05, 0.05, model.nq)
        try:
            return RandomState(assemble(model, chosen, q, p), u, p, inputs, t)
        except AssemblyError:
            continue
    raise AssertionError(f"{model.name} could not be assembled anywhere near its initial state")


def test_a_solver_agrees_with_a_reference_engine(generated):
    model, solver = generated
    engine, rng = engine_of(model), np.random.default_rng(7)
    for _ in range(4):
        state = closed_state(rng, model) if model.loops else random_state(rng, model)
        seeds = random_seeds(rng, model, 3)
        for method in ("sensitivities", "output_sensitivities"):
            values, tangents = getattr(solver, method)(*state, **seeds)
            expected, dexpected = getattr(engine, method)(*state, **seeds)
            assert relative_error(values, expected) < TOLERANCE, method
            assert relative_error(tangents, dexpected) < (10 if model.loops else 1) * TOLERANCE, method


def test_a_solver_starts_at_the_initial_state_of_the_file(generated):
    model, solver = generated
    q, u = solver.initial
    assert relative_error(solver.accelerations(q, u), engine_of(model).accelerations(q, u)) < TOLERANCE
