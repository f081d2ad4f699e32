"""Momentum of the system: the motion of the centre of mass, and the effects of external and internal forces."""

from __future__ import annotations

import numpy as np
import pytest
from measured import FLOATING, Seen, outputs_of, problems, some_axis
from random_models import random_state

from codegen.model import parse_model
from codegen.model.model import Model, Output
from codegen.reference import DenseEngine, RecursiveEngine

LINES = outputs_of("\n".join(
    [f"c_{i}: {{center_of_mass: system, axis: {i}}}" for i in "xyz"]
    + [f"P_{i}: {{momentum: linear, axis: {i}}}" for i in "xyz"]
    + [f"L_{i}: {{momentum: angular, axis: {i}}}" for i in "xyz"]
    + [f"S_{i}: {{momentum: angular, axis: {i}, about: center_of_mass}}" for i in "xyz"]
))  # fmt: skip
MASS = 2 + 0.8 + 0.7 + 0.5


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    choices = (("linear", "ground"), ("angular", "ground"), ("angular", "center_of_mass"))
    return [Output(f"momentum_{n}", "momentum", axis=some_axis(rng, model), choice=c) for n, c in enumerate(choices)]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.4, 0.0, -9.81)])
def test_only_what_is_outside_changes_it(engine: type, gravity: tuple[float, ...]) -> None:
    """``P = M c'``; ``P' = M g``, ``L' = c x M g`` about the ground's origin, and nothing about the centre of mass."""
    model = parse_model(FLOATING.replace("GRAVITY", str(list(gravity))) + LINES)
    seen = Seen(engine(model), *random_state(np.random.default_rng(8), model))
    weight = MASS * np.array(gravity)
    scale = max(1.0, float(np.abs(seen.vector("L")).max()), float(np.abs(weight).max()))
    assert np.abs(MASS * seen.rates("c") - seen.vector("P")).max() < 1e-13 * scale
    assert np.abs(seen.rates("P") - weight).max() < 1e-12 * scale
    assert np.abs(seen.rates("L") - np.cross(seen.vector("c"), weight)).max() < 1e-12 * scale
    assert np.abs(seen.rates("S")).max() < 1e-12 * scale
    about_origin = seen.vector("S") + np.cross(seen.vector("c"), seen.vector("P"))
    assert np.abs(about_origin - seen.vector("L")).max() < 1e-13 * scale


def test_it_is_what_the_mass_matrix_says() -> None:
    """Of a free body: its rows of ``M u``, turned into the ground."""
    text = """
model: alone
bodies: {a: {parent: ground, joint: {type: free}, mass: 2, com: [0.1, 0.2, -0.3], inertia: {xx: 1, yy: 1.2, zz: 0.8}}}
outputs:
"""
    model = parse_model(text + outputs_of("\n".join(LINES.strip().splitlines())))
    engine = DenseEngine(model)
    rng = np.random.default_rng(1)
    q, u = np.array([0, 0, 0, 1, 0, 0, 0.0]), rng.normal(size=6)
    seen = Seen(engine, q, u, np.zeros(0), np.zeros(0), 0.0)
    rows = engine.mass_matrix(q) @ u
    names = [n.rpartition(".")[2] for n in model.speed_names]
    of = dict(zip(names, rows, strict=True))
    assert np.abs(seen.vector("P") - [of[f"v{i}"] for i in "xyz"]).max() < 1e-14
    assert np.abs(seen.vector("L") - [of[f"w{i}"] for i in "xyz"]).max() < 1e-14


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{momentum: spin, axis: x}", "momentum: 'spin'; linear or angular is allowed"),
        ("{momentum: linear}", "momentum needs axis; add axis"),
        (
            "{momentum: linear, axis: x, about: ground}",
            "about: linear momentum does not refer to a point, so about is not allowed; leave",
        ),
        ("{momentum: angular, axis: x, about: tip}", "about: 'tip'; ground or center_of_mass is allowed"),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert said in found
