"""Distance of points: its rate, and its missing derivative at zero."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_body, some_point
from random_models import random_state

import codegen
from codegen.model import parse_model
from codegen.model.model import GROUND, Model, Output
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import SingularOutputError

SLIDES = """
model: slides
gravity: [0, 0, -9.81]
parameters: {off: 0.0}
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: ground, joint: {type: prismatic, axis: x, at: [0, off, 0]}, mass: 1}
outputs:
  place: {position: a, axis: x}
  apart: {distance: [a, b]}
  away: {distance: [ground, {body: a, at: [0, 0, 1]}]}
"""


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    body = some_body(rng, model)
    others = [k for k in range(GROUND, len(model.bodies)) if k != body]
    other = others[int(rng.integers(len(others)))]
    return [Output("apart", "distance", (some_point(rng, model, body), some_point(rng, model, other)))]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
def test_it_is_the_length_of_the_way_between_the_points(engine: type) -> None:
    lines = ["d: {distance: [tip, rim]}"]
    lines += [
        f"{m}_{p}_{i}: {{{m}: {p}, axis: {i}}}" for m in ("position", "velocity") for p in ("tip", "rim") for i in "xyz"
    ]
    model = parse_model(TREE + outputs_of("\n".join(lines)))
    seen = Seen(engine(model), *random_state(np.random.default_rng(7), model))
    line, rate = (seen.vector(f"{m}_rim") - seen.vector(f"{m}_tip") for m in ("position", "velocity"))
    assert abs(seen.value["d"] - np.linalg.norm(line)) < 1e-14
    assert abs(seen.rate["d"] - line @ rate / np.linalg.norm(line)) < 1e-13


def test_points_that_coincide_have_a_distance_and_no_derivative(tmp_path: Path) -> None:
    model = parse_model(SLIDES)
    codegen.generate(model, tmp_path / "slides", target="both", compile="all")
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "slides", target=target)
        q, u = np.array([0.3, 0.3]), np.zeros(2)
        assert solver.outputs(q, u)[:2].tolist() == [0.3, 0.0]
        with pytest.raises(
            SingularOutputError, match="the points of output apart coincide, so it has no derivative"
        ) as error:
            solver.output_sensitivities(q, u, dq=[1.0, 0.0])
        assert error.value.link == "apart"
        with pytest.raises(SingularOutputError, match="output apart"):
            solver.output_gradients(q, u, weights=np.eye(3))
        many = np.array([[0.1, 0.4], [0.3, 0.3]])
        with pytest.raises(SingularOutputError, match="output apart"):
            solver.output_sensitivities(many, np.zeros((2, 2)), dq=np.ones((1, 2, 2)))
        _, along = solver.output_sensitivities([0.3, 0.7], u, dq=[1.0, 0.0])
        assert np.abs(along[0, :2] - [1.0, -1.0]).max() < 1e-15
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        assert engine.outputs([0.3, 0.3], [0, 0])[1] == 0
        with pytest.raises(ValueError, match="output apart: its two points coincide"):
            engine.output_sensitivities([0.3, 0.3], [0, 0], dq=[1.0, 0.0])


def test_a_package_without_distances_has_no_such_error_in_its_module(tmp_path: Path) -> None:
    model = parse_model(SLIDES.partition("  apart:")[0])
    codegen.generate(model, tmp_path / "slides", target="numpy")
    assert "SingularOutputError" not in (tmp_path / "slides" / "slides_numpy.py").read_text()


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{distance: tip}", "distance: 'tip'; a list of two points is needed, such as [tip, ground]"),
        ("{distance: [tip, rim, arm]}", "distance: a list of 3; a list of two points is needed"),
        ("{distance: [tip, rmi]}", "distance[1]: unknown point 'rmi'"),
        ("{distance: [tip, {body: arm, at: [0, 1]}]}", "distance[1].at: too few numbers; three numbers are needed"),
        ("{distance: [tip, ring]}", "two points of one body have a constant distance; points of two bodies are"),
        (
            "{distance: [null, tip]}",
            "distance[0]: nothing; the name of a point or a mapping is needed with the keys body, at",
        ),
        (
            "{distance: [[tip], rim]}",
            "distance[0]: a list of 1; the name of a point or a mapping is needed with the keys body",
        ),
        ("{distance: [{at: [1, 2, 3]}, tip]}", "key 'body' is missing; keys here: body, at"),
        ("{distance: [tip, rim], axis: x}", "an axis is given with distance; axis belongs to"),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert said in found
