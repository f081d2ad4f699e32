"""Quarter turns of joints, faces and force elements are exact: they take no operations, and all engines use equal matrices."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from comparison import compare

import codegen
from codegen.model import Expression, Model, parse_model
from codegen.model.quarter_turns import cosine_and_sine, quarter_turns
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.engine import Engine

ARM = """
model: arm
gravity: [0.3, 0.2, -9.81]
parameters: {{L: 0.7}}
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: z, rpy: [{0}, 0, 0]}}, mass: 2, com: [0.1, 0.2, 0.3],
      inertia: {{xx: 0.2, yy: 0.3, zz: 0.25, xy: 0.01}}}}
  b: {{parent: a, joint: {{type: revolute, axis: z, at: [L, 0, 0.1], rpy: [0, -{0}, 0]}}, mass: 1, com: [0.1, -0.2, 0.1],
      inertia: {{xx: 0.1, yy: 0.2, zz: 0.15}}}}
  c: {{parent: b, joint: {{type: revolute, axis: y, at: [0.3, L, 0], rotate: [{{axis: [1, 1, 0], angle: {0}}}]}}, mass: 1,
      com: [0.2, 0, L/3], inertia: {{xx: 0.1, yy: 0.2, zz: 0.15, yz: 0.02}}}}
  d: {{parent: c, joint: {{type: revolute, axis: x, at: [0.3, 0, 0], rpy: [0, 2*{0}, 3*{0}]}}, mass: 1,
      com: [0.2, 0.1, L/3], inertia: {{xx: 0.1, yy: 0.2, zz: 0.15, yz: 0.02}}}}
outputs:
  turned: {{rotation: d, entry: xy}}
"""


def arm(angle: str) -> Model:
    return parse_model(ARM.format(angle))


@pytest.mark.parametrize(
    ("text", "quarters"),
    [("0", 0), ("pi/2", 1), ("-pi/2", 3), ("pi", 2), ("3*pi/2", 3), ("2*pi", 0), ("-5*pi/2", 3), ("90 deg", 1),
     ("-270 deg", 1), ("1.5707963267948966", 1), ("1.5707963267948963", None), ("1.5707963", None), ("1e-17", None),
     ("pi/4", None), ("1e9*pi", None), ("L*pi/2", None)],
)  # fmt: skip
def test_only_the_nearest_numbers_are_quarter_turns(text: str, quarters: int | None) -> None:
    model = parse_model(
        "model: m\nparameters: {L: 1}\nbodies:\n  a: {parent: ground, joint: {type: revolute, axis: z, "
        f"rpy: [{text}, 0, 0]}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}\n"
    )
    rotation = model.bodies[0].joint.rotation
    angle = rotation[0][1] if rotation else Expression.number(0)
    assert quarter_turns(angle) == quarters


def test_cosines_and_sines() -> None:
    for n in range(4):
        assert np.allclose(cosine_and_sine(n), (np.cos(n * np.pi / 2), np.sin(n * np.pi / 2)), atol=1e-15, rtol=0)


def additions_and_multiplications(model: Model) -> int:
    manifest = write_solver(model, "unrolled").manifest
    counts = [manifest["operations"][s]["per_call"] for s in manifest["functions"]["accelerations"]["sweeps"]]
    return sum(c["additions"] + c["multiplications"] for c in counts)


def test_they_cost_less_than_any_other_angle() -> None:
    assert additions_and_multiplications(arm("pi/2")) < 0.8 * additions_and_multiplications(arm("1.5"))


def test_engines_turn_by_the_same_matrix(tmp_path: Path) -> None:
    """30 digits: a cosine of 6e-17 on one side would show in the 17th."""
    model = arm("pi/2")
    codegen.generate(model, tmp_path / "package", target="numpy", functions=("accelerations", "outputs"))
    solver = codegen.load(tmp_path / "package").in_precision(30, model)
    q, u = np.array([0.3, -0.5, 0.7, 0.2]), np.array([0.5, 0.1, -0.2, 0.4])
    engine = DenseEngine(model, "mpmath")
    with mpmath.workdps(30):
        for name in ("accelerations", "outputs"):
            ours, theirs = (np.array(getattr(x, name)(q, u), object) for x in (solver, engine))
            assert abs(ours - theirs).max() < 1e-28 * abs(theirs).max(), name


@pytest.mark.parametrize("reference", [DenseEngine, RecursiveEngine])
def test_against_the_engines(tmp_path: Path, reference: type[Engine]) -> None:
    model = arm("pi/2")
    codegen.generate(model, tmp_path / "package", target="numpy")
    found = compare(model, codegen.load(tmp_path / "package"), reference(model), np.random.default_rng(5))
    assert max(found.values()) < 1e-11, found
