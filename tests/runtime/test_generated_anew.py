"""A package that is generated again while its solvers are open: none of them computes with the C of another model."""

import pickle

import numpy as np
import pytest

import codegen
from codegen.runtime import PackageError

MODEL = """\
model: anew
parameters: {a: 1.0, b: 1.0, c: 1.0}
bodies:
  block:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: 2.0
    inertia: {xx: 1, yy: 1, zz: 1}
forces:
  pull: {type: joint, joint: block, value: STRENGTH*(a + b + c)}
"""


def made(folder, strength):
    codegen.generate(codegen.parse_model(MODEL.replace("STRENGTH", str(strength))), folder / "anew")
    return codegen.load(folder / "anew")


def ends(solver):
    """Derivatives of where the block is after a second, by three parameters: four directions at once."""
    motion = solver.simulate([0.0, 1.0], sensitivities=["a", "b", "c"])
    return motion.dq[:, -1, 0]


def test_motions_use_what_is_loaded(tmp_path):
    """What is compiled apart was found by folder and name: the second model had the derivatives of the first."""
    for strength in (4.0, 8.0, 4.0):
        assert ends(made(tmp_path, strength)) == pytest.approx(np.full(3, strength / 4), rel=1e-9)


def test_a_solver_of_before_is_told(tmp_path):
    before = made(tmp_path, 4.0)
    assert before.accelerations([0.0], [0.0]) == pytest.approx(6.0)
    packed = pickle.dumps(before)
    assert ends(made(tmp_path, 8.0)) == pytest.approx(np.full(3, 2.0))
    assert before.accelerations([0.0], [0.0]) == pytest.approx(6.0), "what it has opened stays"
    for call in (lambda: before.mass_matrix([0.0]), lambda: ends(before), lambda: pickle.loads(packed)):
        with pytest.raises(
            PackageError, match=r"was generated again, or removed, after this solver was opened; load it again"
        ):
            call()
    made(tmp_path, 4.0)
    assert before.mass_matrix([0.0]) == pytest.approx(2.0), "the same package again"
