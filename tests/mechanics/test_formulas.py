"""Formulas: those without a value are refused, and those that only look undefined are accepted."""

from __future__ import annotations

import pytest

from codegen.model import Model, ModelError, parse_model
from codegen.pipeline import write_solver


def driven(value: str) -> Model:
    return parse_model(f"""
model: driven
bodies:
  arm: {{parent: ground, joint: {{type: revolute, axis: x}}, mass: 1, com: [0, 0, -1]}}
forces:
  f: {{type: joint, joint: arm, value: "{value}"}}
""")


@pytest.mark.parametrize(
    "value",
    [
        "q.arm/(3.5 - q.arm + q.arm - 3.5)",
        "log(q.arm - q.arm - 3.5)",
        "(-3.5)**q.arm",
        "1e200*q.arm*1e200",
        "(1e200*q.arm)*(u.arm*1e200)",
    ],
)
def test_no_value_is_an_error_of_the_model(value: str) -> None:
    with pytest.raises(ModelError, match="has no value or no derivative"):
        write_solver(driven(value))


@pytest.mark.parametrize(
    ("value", "text"),
    [("q.arm*acos(u.arm - u.arm)", "1.5707963267948966"), ("exp(1 + t - t)*q.arm", "2.718281828459045")],
)
def test_functions_of_numbers_are_numbers(value: str, text: str) -> None:
    files = write_solver(driven(value)).files
    assert text in files["driven.c"] and text in files["driven_numpy.py"]
