"""Reports and the manual's page about motions that ended early, derivatives that vanish, and exact motions."""

import numpy as np
import pytest

import codegen
from codegen.bench import lines, page
from codegen.reporting import integrating, motions
from codegen.reporting.differences import differences
from codegen.reporting.states import State

POINT = {
    "method": "radau", "rtol": 1e-11, "atol": 1e-11, "error": None, "evaluations": 9563, "steps": 1287, "rejected": 29,
    "seconds": 0.09755, "ended": "steps have become too small | at 11.07 s",
}  # fmt: skip


def test_the_page_says_which_motions_ended_early():
    motion = {"title": "Four-bars", "quantities": ["x"], "end": 20.0, "source": "a closed form", "operations": {"additions": 1},
              "points": [POINT, POINT | {"error": 1e-9, "ended": "finished"}]}  # fmt: skip
    text = "\n".join(page._motions({"four_bars": motion}))
    assert r"| radau 1e-11 | ended early: steps have become too small \| at 11.07 s | 9563 |" in text
    assert "| radau 1e-11 | 1.0e-09 | 9563 |" in text
    assert lines.point_table({"points": [POINT]})[1][0][1].startswith("ended early: steps")


BEAD = """\
model: bead
gravity: [0, 0, -9.81]
bodies:
  sledge: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1.0, inertia: {xx: 1, yy: 1, zz: 1}}
  rod:
    parent: sledge
    joint: {type: revolute, axis: y}
    mass: 1.0
    com: [0, 0, -0.5]
    inertia: {xx: 0.1, yy: 0.1, zz: 0.1}
"""
"""Nothing depends on where the sledge is, its first coordinate."""

FALL = """\
model: fall
gravity: [0, 0, -9.81]
bodies:
  stone: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1.0, inertia: {xx: 1, yy: 1, zz: 1}}
"""


def made(tmp_path, text):
    model = codegen.parse_model(text)
    codegen.generate(model, tmp_path / model.name, target="numpy")
    return model, codegen.load(tmp_path / model.name)


def test_differences_are_by_what_has_a_derivative(tmp_path):
    model, solver = made(tmp_path, BEAD)
    state = State("here", np.array([0.3, 0.7]), np.array([0.2, 1.1]), np.zeros(0), 0.0)
    skipped = []
    found = differences(model, solver, state, {}, skipped)
    assert not skipped and found["by"] == "rod"
    central = [e for e in found["central"] if e is not None]
    assert min(central) < 1e-8 and max(central) > 1e-3


def test_differences_of_a_constant_are_left_out_with_the_reason(tmp_path):
    model, solver = made(tmp_path, FALL)
    state = State("here", np.array([0.3]), np.array([0.2]), np.zeros(0), 0.0)
    skipped = []
    assert differences(model, solver, state, {}, skipped) is None
    (why,) = skipped
    assert "do not depend on any parameter, independent coordinate or speed" in str(why)


@pytest.mark.parametrize(("error", "derivative", "is_rounding"), [(1e-15, 1e-14, True), (1e-15, None, True), (1e-9, 1e-15, False),
                                                                  (1e-15, 1e-9, False)])  # fmt: skip
def test_errors_that_are_rounding_make_no_diagram(error, derivative, is_rounding):
    points = [{"error": 3e-16, "sensitivity_error": 1e-16}, {"error": error, "sensitivity_error": derivative}]
    assert motions._is_rounding({"dop853": points[:1], "radau": points}) is is_rounding
    assert not motions._is_rounding({"dop853": []})


def test_accelerations_without_operations_can_be_measured(tmp_path):
    """Those of a falling stone are a constant."""
    _, solver = made(tmp_path, FALL)
    assert integrating.evaluation(solver, []) == 1
    assert integrating._most_steps(solver, [], 1.0) > 1
