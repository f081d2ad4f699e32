"""Angles and axes that are exact values rounded to a few digits."""

import math

import pytest

from codegen.model import load_model, parse_model

TEXT = """
model: turned
bodies:
  a:
    parent: ground
    joint: {{type: revolute, axis: {axis}, {turn}}}
    mass: 1
    com: [1, 2, 3]
"""


def warnings_of(turn="at: [0, 0, 0]", axis="y"):
    return parse_model(TEXT.format(turn=turn, axis=axis), "m.yaml").warnings


@pytest.mark.parametrize(
    ("number", "exact"),
    [
        ("1.5708", "pi/2"), ("-1.5708", "-pi/2"), ("1.57", "pi/2"), ("1.570796", "pi/2"), ("1.57079632", "pi/2"),
        ("0.7854", "pi/4"), ("0.785", "pi/4"), ("3.1416", "pi"), ("3.14", "pi"), ("-3.14159", "-pi"), ("2.618", "5*pi/6"),
        ("0.2618", "pi/12"), ("1.0472", "pi/3"), ("6.2832", "2*pi"), ("4.712", "3*pi/2"), ("0.5235", "pi/6"),
    ],
)  # fmt: skip
def test_angles_that_miss_digits_are_told_with_what_is_exact(number, exact):
    for turn, where in (
        (f"rotate: [{{axis: x, angle: {number}}}]", "bodies.a.joint.rotate[0].angle"),
        (f"rpy: [0, {number}, 0]", "bodies.a.joint.rpy[1]"),
    ):
        (told,) = warnings_of(turn)
        assert where in told
        assert told.startswith("m.yaml:6:")
        assert f"{float(number)!r} is {exact} up to" in told and f"write {exact}," in told


@pytest.mark.parametrize(
    "number",
    [
        "0", "0.5", "1.5", "2.6", "0.3", "1.0", "3", "0.1", "0.26", "0.52", "0.79", "1.05", "2.09", "1.571e-3", "0.7", "1.2345",
        "pi/2", "1.5707963267948966", "3.141592653589793", "-0.7853981633974483", "pi/7", "1.58", "0.786", "1000.5", "157.08",
        "152.4", "1.7e308", "-1.7e308",
    ],
)  # fmt: skip
def test_other_angles_are_not(number):
    assert not warnings_of(f"rotate: [{{axis: x, angle: {number}}}]")
    assert not warnings_of(f"rpy: [{number}, 0, {number}]")


@pytest.mark.parametrize(("number", "turns"), [("90", "14.3"), ("-45", "-7.16"), ("7", "1.11")])
def test_whole_numbers_beyond_a_turn_seem_to_be_degrees(number, turns):
    expected = f"{number} rad is {turns} turns; if it is in degrees, write {number} deg"
    (told,) = warnings_of(f"rpy: [0, {number}, 0]")
    assert told == f"m.yaml:6:47: warning: bodies.a.joint.rpy[1]: {expected}"
    start = TEXT.format(turn="at: [0, 0, 0]", axis="y") + f"initial: {{q: {{a: {number}}}}}\n"
    (told,) = parse_model(start, "m.yaml").warnings
    assert told == f"m.yaml:9:18: warning: initial.q.a: {expected}"
    assert not parse_model(start.replace(f"a: {number}", f"a: {number} deg")).warnings
    assert not parse_model(start.replace("revolute", "prismatic")).warnings


def test_visuals_need_no_exact_angles():
    visuals = "    visuals: [{type: sphere, radius: 0.1, rpy: [1.5708, 0, 0]}]\n"
    assert not parse_model(TEXT.format(turn="at: [0, 0, 0]", axis="y") + visuals).warnings


def test_numbers_that_orient_nothing_are_not():
    assert not warnings_of("at: [1.5708, 0, 0]")


def test_constants_count_as_the_numbers_that_they_are():
    text = TEXT.format(turn="rpy: [right, 0, 0]", axis="y").replace("bodies:", "constants: {right: 1.5708}\nbodies:")
    assert any("is pi/2 up to" in told for told in parse_model(text).warnings)


@pytest.mark.parametrize(
    ("axis", "exact"),
    [
        ("[0.866, 0, 0.5]", "[cos(pi/6), 0, sin(pi/6)]"), ("[0, -0.5, 0.8660]", "[0, cos(2*pi/3), sin(2*pi/3)]"),
        ("[0.259, 0.966, 0]", "[cos(5*pi/12), sin(5*pi/12), 0]"), ("[0.7071, 0, 0.7072]", "[cos(pi/4), 0, sin(pi/4)]"),
    ],
)  # fmt: skip
def test_axes_that_miss_digits_are_told(axis, exact):
    (told,) = warnings_of(axis=axis)
    assert "bodies.a.joint.axis" in told and f"the axis is {exact} up to" in told


@pytest.mark.parametrize(
    "axis",
    ["[0.7071, 0, 0.7071]", "[-0.707, 0.707, 0]", "[1, 1, 0]", "[3, 0, 4]", "[0.6, 0, 0.8]", "x", "[0, 0, 0.5]", "[0.5, 0, 0.8]",
     f"[{math.cos(math.pi / 6)}, 0, 0.5]", "[0.123, 0.456, 0.789]", "[sqrt(3)/2, 0, 0.5]"],
)  # fmt: skip
def test_axes_whose_direction_is_exact_or_meant_are_not(axis):
    assert not warnings_of(axis=axis)


def test_faces_of_loops_are_looked_at():
    text = """
model: door
bodies:
  leaf: {parent: ground, joint: {type: revolute, axis: z}, mass: 1, com: [0.5, 0, 0]}
  arm: {parent: leaf, joint: {type: revolute, axis: z, at: [1, 0, 0]}, mass: 1}
loops:
  pin:
    joint: {type: inline, axis: [0.5, 0.866, 0]}
    from: {body: arm, rpy: [3.1416, 0, 0]}
    to: {body: ground, rotate: [{axis: x, angle: 0.7854}]}
"""
    told = parse_model(text).warnings
    assert len(told) == 3
    for part in ("loops.pin.from.rpy[0]", "loops.pin.to.rotate[0].angle", "loops.pin.joint.axis"):
        assert any(part in one for one in told)


def test_the_examples_have_all_digits(request):
    for file in sorted((request.config.rootpath / "examples").glob("*.yaml")):
        assert not [one for one in load_model(file).warnings if "rad; write" in one], file
