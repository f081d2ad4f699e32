"""Acceleration of points: the time derivative of their velocity, with forces, inputs and loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_axis, some_point
from random_models import random_state

import codegen
from codegen.model import parse_model
from codegen.model.model import Model, Output
from codegen.reference import DenseEngine, RecursiveEngine


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    point, axis = some_point(rng, model), some_axis(rng, model)
    return [Output("speed", "velocity", (point,), axis), Output("rate_of_speed", "acceleration", (point,), axis)]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
def test_it_is_the_rate_of_the_velocity(engine: type) -> None:
    lines = [f"{m}_{p}_{i}: {{{m}: {p}, axis: {i}}}" for m in ("velocity", "acceleration") for p in ("tip", "rim")
             for i in "xyz"]  # fmt: skip
    model = parse_model(TREE + outputs_of("\n".join(lines)))
    seen = Seen(engine(model), *random_state(np.random.default_rng(3), model))
    for point in ("tip", "rim"):
        expected = seen.rates(f"velocity_{point}")
        assert np.abs(seen.vector(f"acceleration_{point}") - expected).max() < 1e-12 * np.abs(expected).max()


def test_what_falls_accelerates_with_gravity_and_the_ground_does_not() -> None:
    model = parse_model("""
model: alone
gravity: [0.3, 0, -9.81]
bodies: {a: {parent: ground, joint: {type: free}, mass: 2, inertia: {xx: 1, yy: 1, zz: 1}}}
outputs:
  x: {acceleration: a, axis: x}
  z: {acceleration: a, axis: z}
  still: {acceleration: {body: ground, at: [1, 2, 3]}, axis: z}
""")
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        assert np.abs(engine.outputs([1, 2, 3, 1, 0, 0, 0], [0.1] * 6) - [0.3, -9.81, 0]).max() < 1e-14


def test_it_depends_on_inputs_through_the_dynamics(tmp_path: Path) -> None:
    """An input drives the arm: the tip's acceleration changes with it, in value, derivative and gradient."""
    model = parse_model(TREE + outputs_of("a: {acceleration: tip, axis: x}"))
    codegen.generate(model, tmp_path / "driven", target="numpy")
    solver = codegen.load(tmp_path / "driven")
    q, u, p, inputs, t = random_state(np.random.default_rng(5), model)
    base, (slope,) = solver.output_sensitivities(q, u, p, inputs, t, dinputs=[[1.0]])
    more = solver.outputs(q, u, p, inputs + 0.5, t)  # the input enters linearly
    assert abs(slope[0]) > 1e-3
    assert abs(more[0] - base[0] - 0.5 * slope[0]) < 1e-12 * max(1.0, abs(base[0]))
    assert abs(solver.output_gradients(q, u, p, inputs, t, weights=[1.0]).inputs[0, 0] - slope[0]) < 1e-13


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{acceleration: tip}", "acceleration needs axis; add axis: x, y, z or a vector in the ground frame"),
        ("{acceleration: tpi, axis: x}", "unknown point 'tpi'; a point or a body is allowed: tip, rim, stand"),
        (
            "{acceleration: tip, axis: x, frame: body}",
            "a frame is given with acceleration; frame belongs to angular_velocity",
        ),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert said in found
