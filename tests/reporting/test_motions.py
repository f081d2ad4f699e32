"""Motions of a report that end early or cannot begin."""

import numpy as np
import pytest

import codegen
from codegen.measure.core import Core
from codegen.reporting import motions

pytest.importorskip("matplotlib", reason="reports draw figures; the extra plot installs matplotlib")

BLOWING_UP = """\
model: blow
parameters: {gain: 1.0}
bodies: {cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1.0}}
forces: {push: {type: joint, joint: cart, value: gain*(1 + u.cart**2)}}
initial: {u: {cart: 1.0}}
"""


def test_a_motion_that_ends_early_is_shorter_and_one_that_cannot_begin_says_why(tmp_path):
    """u' = 1 + u^2 from 1 ends at pi/4; the motion of the report goes on as far as it is known."""
    model = codegen.parse_model(BLOWING_UP)
    blow = codegen.load(codegen.generate(model, tmp_path / "blow").folder)
    core, skipped = Core.compiled(tmp_path), []
    found = motions.motions(model, blow, 3.0, skipped, lambda partitions: blow, core)
    assert found["end"] == pytest.approx(0.8 * np.pi / 4, abs=0.01) and "t = 0.785" in found["ended"]
    assert found["methods"]["dop853"] and not skipped
    model = codegen.parse_model(BLOWING_UP.replace("1 + u.cart**2", "log(q.cart)").replace("blow", "nowhere"))
    nowhere = codegen.load(codegen.generate(model, tmp_path / "nowhere").folder)
    assert motions.motions(model, nowhere, 3.0, skipped, lambda partitions: nowhere, core) is None
    assert "the time derivative of u.cart is not finite" in skipped[0].why
    with pytest.warns(RuntimeWarning, match="is not finite"):
        x = nowhere.simulate([0.0, 1.0], sensitivities="gain", on_failure="return")
    assert len(x) == 0 and x.dq.shape == (1, 0, 1)
