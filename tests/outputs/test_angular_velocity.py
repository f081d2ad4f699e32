"""Angular velocity of bodies, in ground axes and in body axes."""

from __future__ import annotations

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_axis, some_body
from random_models import random_state

from codegen.model import parse_model
from codegen.model.model import Model, Output
from codegen.reference import DenseEngine, RecursiveEngine


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    axis = some_axis(rng, model)
    return [
        Output(f"turning_in_{frame}", "angular_velocity", axis=axis, bodies=(some_body(rng, model),), choice=(frame,))
        for frame in ("ground", "body")
    ]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
def test_axes_of_the_body_are_turned_with_it(engine: type) -> None:
    lines = [f"{f}_{i}: {{angular_velocity: ring, axis: {i}, frame: {f}}}" for f in ("ground", "body") for i in "xyz"]
    lines += [f"{i}{j}: {{rotation: ring, entry: {i}{j}}}" for i in "xyz" for j in "xyz"]
    lines += [f"hull_{i}: {{angular_velocity: hull, axis: {i}, frame: body}}" for i in "xyz"]
    model = parse_model(TREE + outputs_of("\n".join(lines)))
    state = random_state(np.random.default_rng(2), model)
    seen = Seen(engine(model), *state)
    R, dR = (np.array([[of[i + j] for j in "xyz"] for i in "xyz"]) for of in (seen.value, seen.rate))
    assert np.abs(R @ seen.vector("body") - seen.vector("ground")).max() < 1e-14
    w = seen.vector("ground")
    assert np.abs(dR - np.cross(w, R.T).T).max() < 1e-13
    # speeds of a free joint are components in the body
    speeds = [state.u[model.speed_names.index(f"hull.w{i}")] for i in "xyz"]
    assert np.abs(seen.vector("hull") - speeds).max() < 1e-15


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (
            "{angular_velocity: arm}",
            "angular_velocity needs axis; add axis: x, y, z or a vector, in the ground frame or in",
        ),
        ("{angular_velocity: arm, axis: x, frame: hand}", "frame: 'hand'; ground or body is allowed"),
        ("{angular_velocity: tip, axis: x}", "unknown body 'tip'"),
        (
            "{angular_velocity: arm, axis: x, entry: qw}",
            "an entry is given with angular_velocity; entry belongs to rotation",
        ),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert said in found
