"""The error about a loop that cannot move names the only axis that is not parallel to the others."""

import pytest

from codegen.loops import AssemblyError, PartitionError, partition
from codegen.model import parse_model

MODEL = """
model: press
bodies:
  crank: {{parent: ground, joint: {{type: revolute, axis: {crank}}}, mass: 1}}
  rod: {{parent: crank, joint: {{type: revolute, axis: {rod}, at: [0.1, 0, 0]}}, mass: 1}}
  slider: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 2}}
loops:
  pin:
    joint: {{type: {type}, {axis}}}
    from: {{body: rod, at: [0.4, 0, 0]}}
    to: {{body: slider{turned}}}
initial: {{q: {{crank: 0, rod: 0, slider: 0.5}}}}
{independent}
"""


def message(crank="-y", rod="-y", axis="axis: -y", type="revolute", turned="", independent="independent: [crank]"):
    text = MODEL.format(crank=crank, rod=rod, axis=axis, type=type, turned=turned, independent=independent)
    with pytest.raises((AssemblyError, PartitionError)) as error:
        partition(parse_model(text))
    return str(error.value)


def test_the_axis_of_the_loop_is_named():
    text = message(axis="axis: z")
    assert "crank cannot be independent; remove it from `independent`, or check the axis of loop pin" in text
    assert "not parallel to those of joint crank, joint rod, which are parallel to each other" in text


def test_the_axis_of_a_joint_is_named():
    assert "check the axis of joint rod: it is not parallel to those of joint crank, loop pin," in message(rod="z")
    assert "check the axis of joint crank: it is not parallel to those of joint rod, loop pin," in message(crank="z")


def test_one_face_of_the_loop_is_named():
    assert "check the axis of loop pin in `to`" in message(turned=", rotate: [{axis: x, angle: 90 deg}]")


def test_the_axis_is_also_named_where_no_speed_is_left():
    text = message(axis="axis: z", independent="")
    assert "no freedom left" in text and "or check the axis of loop pin" in text


def test_the_axis_is_also_named_where_the_loop_does_not_close():
    text = message(axis="axis: z", turned=", at: [0, 0, 3]")
    assert "cannot be closed" in text and "and check the axis of loop pin" in text


def test_no_axis_is_named_where_none_stands_out():
    text = message(axis="axes: [x, z]", type="universal")
    assert "`independent`, or check the axes and the places of the joints" in text
    text = message(turned=", at: [0, 0, 3]")  # out of reach, all axes parallel
    assert "and check the axes and the places of the joints" in text
