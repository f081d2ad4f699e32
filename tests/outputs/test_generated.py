"""Outputs of every measure on random trees and mechanisms: generated NumPy and C, both engines, transposes, identities.

Each measure draws its outputs in the file of its own tests, see `measured.with_outputs`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, seeds_of, worst
from measured import with_outputs
from prescribed_models import with_prescribed
from random_mechanisms import Mechanism, random_mechanism
from random_models import random_state, random_tree

import codegen
from codegen.loops.partition import partition
from codegen.mechanics.outputs import MEASURES as WRITTEN
from codegen.mechanics.outputs import RecordMeasure
from codegen.mechanics.quantities import QUANTITIES
from codegen.model.model import Model
from codegen.model.outputs import MEASURES
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.outputs import VALUES

EPS = np.finfo(float).eps
TREES = (11, 12, 13)
MECHANISMS = ((5, "spatial"), (1, "planar"), (4, "spatial"))
"""Seeds, and scenes of the mechanisms."""
COMPILED = ((TREES[0], ""), MECHANISMS[1])
"""Those whose C is looked at too."""
CHECKED = ("outputs", "output_sensitivities", "output_gradients", "accelerations", "coordinate_rates")


def tree(seed: int) -> tuple[Model, tuple[Any, ...]]:
    rng = np.random.default_rng(seed)
    model = with_outputs(rng, random_tree(rng, 4))
    return model, tuple(random_state(rng, model))


def mechanism(seed: int, scene: str) -> tuple[Model, tuple[Any, ...]]:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, scene, bodies=(3, 4), loops=(1, 2))
    assert isinstance(drawn, Mechanism)
    return with_outputs(rng, drawn.model), tuple(drawn[1:6])


def check(model: Model, state: tuple[Any, ...], solver: codegen.Solver) -> None:
    """Check values and derivatives of each output, and the transpose of all outputs together."""
    rng = np.random.default_rng(3)
    cond = max((ear.condition for ear in partition(model).ears), default=1.0) if model.loops else 1.0
    limit = max(1e-10, 50 * EPS * cond**2)
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        seeds = seeds_of(engine, state, rng)
        values, along = solver.output_sensitivities(*state, **seeds)
        expected, derivatives = engine.output_sensitivities(*state, **seeds)
        assert np.array_equal(values, solver.outputs(*state))
        for i, output in enumerate(model.outputs):
            assert error(values[i], expected[i]) < limit, (output.name, values[i], expected[i])
            assert worst(along[:, [i]], derivatives[:, [i]]) < limit, (output.name, along[:, i], derivatives[:, i])
        weights = rng.normal(size=(2, len(model.outputs)))
        gradients = solver.output_gradients(*state, weights=weights)
        given = (seeds["dq"], seeds["du"], seeds["dp"], seeds["dinputs"], np.reshape(seeds["dt"], (-1, 1)))
        products = [
            np.reshape(g, (2, 1, -1)) * np.reshape(s, (1, len(along), -1))
            for g, s in zip(gradients, given, strict=True)
        ]
        left, right = weights @ along.T, sum(x.sum(axis=-1) for x in products)
        scale = np.abs(weights) @ np.abs(along).T + sum(np.abs(x).sum(axis=-1) for x in products)
        assert np.max(np.abs(left - right) / scale) < 1e-12


def along_motion(model: Model, state: tuple[Any, ...], solver: codegen.Solver) -> None:
    """Check outputs that are time derivatives of others by directional derivatives along the motion."""
    q, u, p, inputs, t = state
    if model.loops:
        u = solver.assemble(q, u, p)[1]
    qdot = solver.coordinate_rates(q, u, p) if model.loops else solver.coordinate_rates(q, u)
    udot = solver.accelerations(q, u, p, inputs, t)
    values, rates = solver.output_sensitivities(q, u, p, inputs, t, dq=qdot, du=udot, dt=1.0)
    names = {o.name: i for i, o in enumerate(model.outputs)}
    pairs = [(n, n.removeprefix("rate_of_")) for n in names if n.startswith("rate_of_")]
    for rate, of in pairs:
        # names end with their places in the list, one after the other
        stem, _, number = of.rpartition("_")
        expected, found = values[names[rate]], rates[0, names[f"{stem}_{int(number) - 1}"]]
        assert abs(expected - found) < 1e-9 * max(1.0, abs(expected), float(np.abs(udot).max())), (
            rate,
            expected,
            found,
        )
    assert pairs


@pytest.fixture(params=[*((seed, "") for seed in TREES), *MECHANISMS], ids=lambda x: f"{x[1] or 'tree'}-{x[0]}")
def drawn(request: pytest.FixtureRequest) -> Iterator[tuple[Model, tuple[Any, ...]]]:
    seed, scene = request.param
    yield mechanism(seed, scene) if scene else tree(seed)


def test_generated_and_both_engines_agree(
    drawn: tuple[Model, tuple[Any, ...]], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    model, state = drawn
    compiled = request.node.callspec.params["drawn"] in COMPILED
    codegen.generate(
        model, tmp_path / "measured", "both" if compiled else "numpy", "kinds", functions=CHECKED, compile="all"
    )
    for target in ("numpy", "c")[: 1 + compiled]:
        solver = codegen.load(tmp_path / "measured", target)
        check(model, state, solver)
        along_motion(model, state, solver)


def test_outputs_of_bodies_run_no_dynamics(tmp_path: Path) -> None:
    """Only accelerations need udot; what is not read is not in the package."""
    model, _ = tree(TREES[0])
    reading = {o.measure for o in model.outputs}
    assert {"position", "velocity"} <= reading
    for asked in (("position", "velocity"), tuple(reading)):
        kept = replace(model, outputs=tuple(o for o in model.outputs if o.measure in asked))
        codegen.generate(kept, tmp_path / "measured", target="numpy")
        text = (tmp_path / "measured" / f"{model.name}_numpy.py").read_text()
        body = text[text.index("def outputs(") :].partition("\n\n\n")[0]
        assert ("forward(a)" in body) == ("acceleration" in asked)
        assert ("link_accelerations" in text) == ("acceleration" in asked)
        assert ("momenta" in text) == ("momentum" in asked)


def test_every_measure_has_a_value_statements_and_something_drawn() -> None:
    """The registries name the same measures, and what these read there is."""
    assert VALUES.keys() == WRITTEN.keys() == MEASURES.keys()
    drawn = tree(TREES[0])[0]
    outputs = with_prescribed(np.random.default_rng(1), drawn).outputs
    assert {o.measure for o in drawn.outputs} == MEASURES.keys() - {"driving_force"}
    assert {o.measure for o in outputs} == MEASURES.keys()
    for o in outputs:
        measure = WRITTEN[o.measure]
        if isinstance(measure, RecordMeasure):
            assert {*measure.reads, *measure.also(o)} <= QUANTITIES.keys()
