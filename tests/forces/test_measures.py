"""Positions and velocities of points in expressions: where they are allowed, and the errors elsewhere."""

from __future__ import annotations

import pytest

from codegen.model import parse_model
from codegen.model.errors import ModelError
from codegen.model.grammar import ExpressionError
from codegen.model.parsing import parse

MODEL = """
model: m
constants: {c: 2}
parameters: {L: 1.0}
inputs: [motor]
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 2, com: [0, 0, L], inertia: {yy: 0.1}}
points: {tip: {body: arm, at: [0, 0, L]}}
forces:
  drive: {type: joint, joint: arm, value: motor}
  band: {type: spring, from: tip, to: ground, stiffness: 3}
initial: {q: {arm: 0.1}}
outputs:
  twice: {value: 2*motor}
"""


@pytest.mark.parametrize(
    ("old", "new", "path", "allowed"),
    [
        ("c: 2", "c: position.tip.x", "constants.c", "only numbers and constants are"),
        ("L: 1.0", "L: position.tip.x", "parameters.L.value", "only numbers and constants are"),
        ("mass: 2", "mass: position.tip.x", "bodies.arm.mass", "only numbers, constants and parameters are"),
        (
            "at: [0, 0, L]",
            "at: [0, 0, position.tip.x]",
            "points.tip.at[2]",
            "only numbers, constants and parameters are",
        ),
        ("arm: 0.1", "arm: velocity.tip.x", "initial.q.arm", "only numbers, constants and parameters are"),
        ("stiffness: 3", "stiffness: position.tip.z", "forces.band.stiffness", "parameters, inputs and t are"),
        ("value: 2*motor", "value: position.tip.z", "outputs.twice.value", "inputs, t, q.NAME and u.NAME are"),
    ],
)
def test_where_they_are_not_allowed(old: str, new: str, path: str, allowed: str) -> None:
    assert old in MODEL
    with pytest.raises(ModelError) as raised:
        parse_model(MODEL.replace(old, new, 1))
    found = [p for p in raised.value.problems if "changes with the motion" in p.message]
    assert [p.path.removesuffix(".value") for p in found] == [path.removesuffix(".value")], str(raised.value)
    assert allowed in found[0].message and "are allowed in forces in joints" in found[0].message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("position.tip", "name position.tip; write position.POINT.x, .y or .z with the name of a point or a body"),
        ("velocity.tip.w", "name velocity.tip.w; write velocity.POINT.x, .y or .z"),
        ("position.2.x", "name position.2.x; write position.POINT.x, .y or .z"),
        ("position.tip(2)", "position.tip(...) without a component; write position.tip(...).x, .y or .z"),
        ("position.tip(2).w", "position.tip(...).w; a component is .x, .y or .z"),
        ("place.tip.x", "name place.tip.x; only coordinates q.NAME, speeds u.NAME, position.POINT.x"),
    ],
)
def test_how_they_are_written(text: str, message: str) -> None:
    with pytest.raises(ExpressionError) as raised:
        parse(text)
    assert message in str(raised.value)


def test_a_name_without_component_may_still_be_a_parameter() -> None:
    assert parse("position + velocity").names == {"position", "velocity"}
