"""Calls with several arguments in unquoted YAML braces and brackets: one error that shows the correct text."""

from __future__ import annotations

import pytest

from codegen.model import ModelError, parse_model

MODEL = """\
model: m
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  f: %s
"""


@pytest.mark.parametrize(
    ("force", "column", "quoted"),
    [
        ("{type: joint, joint: arm, value: max(0, q.arm)}", 39, 'value: "max(0, q.arm)"'),
        (
            "{type: joint, value: if(q.arm > 0, 1, atan2(2, t)), joint: arm}",
            27,
            'value: "if(q.arm > 0, 1, atan2(2, t))"',
        ),
        ("{type: joint, joint: arm, value: [min(1, max(0, q.arm))*k]}", 40, '"min(1, max(0, q.arm))*k"'),
        ("{type: limit, joint: arm, lower: 0, stiffness: step(t, 0, 1), width: 1}", 53, 'stiffness: "step(t, 0, 1)"'),
    ],
)
def test_one_error_says_to_put_quotes(force: str, column: int, quoted: str) -> None:
    text = MODEL.replace("bodies:", "parameters: {k: 1}\nbodies:") % force
    with pytest.raises(ModelError) as error:
        parse_model(text)
    (problem,) = [p for p in error.value.problems if p.severity == "error"]
    assert (problem.line, problem.column) == (6, column)
    assert problem.message.endswith(f"put quotes around it: {quoted}")


def test_what_is_quoted_or_balanced_is_left_alone() -> None:
    assert (
        str(parse_model(MODEL % '{type: joint, joint: arm, value: "max(0, q.arm)"}').forces[0].values[0])
        == "max(0, q.arm)"
    )
    assert parse_model(MODEL % "{type: joint, joint: arm, value: [(q.arm)*2]}").forces[0].values[0].names == {"q.arm"}


def test_a_parenthesis_that_is_never_closed_is_one_error_too() -> None:
    with pytest.raises(ModelError) as error:
        parse_model(MODEL % "{type: joint, joint: arm, value: max(0, q.arm}")
    assert len(error.value.problems) == 1
