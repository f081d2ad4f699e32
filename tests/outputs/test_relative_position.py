"""Position and velocity of a point relative to another."""

from __future__ import annotations

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_axis, some_point
from random_models import random_state

from codegen.model import parse_model
from codegen.model.model import Model, Output
from codegen.reference import DenseEngine, RecursiveEngine


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    points, axis = (some_point(rng, model), some_point(rng, model)), some_axis(rng, model)
    return [Output("way", "relative_position", points, axis), Output("rate_of_way", "relative_velocity", points, axis)]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
@pytest.mark.parametrize(("first", "second"), [("tip", "rim"), ("rim", "ground"), ("tip", "ring")])
def test_it_leads_from_the_first_point_to_the_second(engine: type, first: str, second: str) -> None:
    """Of points of one body, too."""
    lines = [
        f"{m}_{p}_{i}: {{{m}: {p}, axis: {i}}}"
        for m in ("position", "velocity")
        for p in (first, second)
        for i in "xyz"
    ]
    lines += [
        f"{m}_{i}: {{relative_{m}: [{first}, {second}], axis: {i}}}" for m in ("position", "velocity") for i in "xyz"
    ]
    model = parse_model(TREE + outputs_of("\n".join(lines)))
    seen = Seen(engine(model), *random_state(np.random.default_rng(9), model))
    for m in ("position", "velocity"):
        assert np.abs(seen.vector(m) - (seen.vector(f"{m}_{second}") - seen.vector(f"{m}_{first}"))).max() < 1e-14
    assert np.abs(seen.rates("position") - seen.vector("velocity")).max() < 1e-13


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{relative_position: [tip, rim]}", "relative_position needs axis; add axis"),
        ("{relative_velocity: tip, axis: x}", "'tip'; a list of two points is needed, such as [tip, ground]"),
        ("{relative_velocity: [tip, rmi], axis: x}", "relative_velocity[1]: unknown point 'rmi'"),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert said in found
