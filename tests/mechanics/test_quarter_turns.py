"""Frames turned by quarters in numbers of sixteen digits are changes of axes, without what rounding leaves in their matrices."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.emit.solver import write_solver
from codegen.mechanics.structure.folded import without_dust
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine

LINK = """  l{k}:
    parent: {parent}
    joint: {{type: revolute, axis: z, at: [0.1, 0.2, 0.3], rotate: [{{axis: x, angle: {first}}}, {{axis: y, angle: {second}}}]}}
    mass: 1.5
    com: [0.1, 0.05, -0.2]
    inertia: {{xx: 0.3, yy: 0.25, zz: 0.2, xy: 0.01, xz: 0.02, yz: -0.015}}
"""
QUARTER = repr(math.pi / 2)


def chain(first: str, second: str) -> Model:
    bodies = "".join(
        LINK.format(k=k, parent=f"l{k - 1}" if k else "ground", first=first, second=second) for k in range(4)
    )
    return parse_model(f"model: turned\ngravity: [0, 0, -9.81]\nbodies:\n{bodies}")


def operations(model: Model) -> int:
    of = write_solver(model).manifest["operations"]
    return sum(n[part][kind] for n in of.values() for part in n for kind in ("additions", "multiplications"))


def test_quarters_in_numbers_cost_what_exact_ones_do() -> None:
    exact = operations(chain("pi/2", "-pi/2"))
    assert operations(chain(QUARTER, f"-{QUARTER}")) == exact
    # a turn that somebody meant is kept
    assert operations(chain(repr(math.pi / 2 + 1e-14), f"-{QUARTER}")) > exact
    assert operations(chain("1.570796", "-1.570796")) > exact


def test_accelerations_of_quarter_turns(tmp_path: Path) -> None:
    model = chain(QUARTER, f"-{QUARTER}")
    codegen.generate(model, tmp_path / "turned", functions=("accelerations",))
    q, u = np.linspace(0.3, 1.1, 4), np.linspace(-1.0, 2.0, 4)
    found = codegen.load(tmp_path / "turned").accelerations(q, u)[1]
    expected = DenseEngine(model).accelerations(q, u)[1]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("entry", "expected"),
    [(6e-17, 0.0), (-1.7e-15, 0.0), (1 - 2.0**-53, 1.0), (-1 + 2.0**-52, -1.0), (1e-14, 1e-14), (0.5, 0.5)],
)
def test_entries_that_only_rounding_keeps_from_whole_numbers(entry: float, expected: float) -> None:
    assert without_dust(entry) == expected
