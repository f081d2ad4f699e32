"""Units of coordinates, speeds and outputs: one for each name, in SI."""

import pytest

import codegen
from codegen.model.joints import JOINTS
from codegen.model.motions import Slide, Turn, units
from codegen.model.outputs import MEASURES

UNITS = {
    "fixed": ("", ""),
    "revolute": ("rad", "rad/s"),
    "prismatic": ("m", "m/s"),
    "screw": ("rad", "rad/s"),
    "cylindrical": ("m rad", "m/s rad/s"),
    "planar": ("m m rad", "m/s m/s rad/s"),
    "universal": ("rad rad", "rad/s rad/s"),
    "spherical": ("- - - -", "rad/s rad/s rad/s"),
    "free": ("m m m - - - -", "rad/s rad/s rad/s m/s m/s m/s"),
}
"""Of the coordinates and speeds of joints of bodies; - for none."""

OUTPUTS = {
    "x: {position: b, axis: x}": "m",
    "x: {velocity: b, axis: x}": "m/s",
    "x: {acceleration: b, axis: x}": "m/s^2",
    "x: {angular_velocity: b, axis: x}": "rad/s",
    "x: {rotation: b, entry: qw}": "",
    "x: {center_of_mass: system, axis: x}": "m",
    "x: {momentum: linear, axis: x}": "kg m/s",
    "x: {momentum: angular, axis: x}": "kg m^2/s",
    "x: {distance: [b, far]}": "m",
    "x: {relative_position: [b, far], axis: x}": "m",
    "x: {relative_velocity: [b, far], axis: x}": "m/s",
    "x: {value: u.b}": "",
    "x: {driving_force: moved}": "N",
    "x: kinetic_energy": "J",
    "x: potential_energy": "J",
}


@pytest.mark.parametrize("name", JOINTS)
def test_units_of_joints(name):
    kind = JOINTS[name]
    if not kind.carries:
        return
    q, u = (tuple(x.replace("-", "") for x in text.split()) for text in UNITS[name])
    assert (kind.coordinate_units, kind.speed_units) == (q, u)
    assert (len(q), len(u)) == (len(kind.coordinates), len(kind.speeds))


def test_what_turns_and_slides_is_an_angle():
    turn, slide = Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0)
    assert units((turn, slide)) == units((slide, turn)) == (("rad",), ("rad/s",))
    assert units((slide,)) == (("",), ("",))


@pytest.mark.parametrize("text", OUTPUTS)
def test_units_of_outputs(text):
    motion = "  moved: {parent: far, joint: {type: prismatic, axis: x}, mass: 1}\nmotion: {moved: t}\n" * (
        "driving" in text
    )
    model = codegen.parse_model(
        "model: m\nbodies:\n  b: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}\n"
        "  far: {parent: b, joint: {type: prismatic, axis: y, at: [1, 0, 0]}, mass: 1}\n"
        + motion
        + "outputs:\n  "
        + text
        + "\n"
    )
    assert model.output_units == (OUTPUTS[text],)
    assert model.coordinate_units == ("m", "m") and model.speed_units == ("m/s", "m/s")


def test_every_measure_is_looked_at():
    named = {word for text in OUTPUTS for word in MEASURES if word in text}
    assert named == set(MEASURES)


FREQUENCIES = """
model: turning
parameters: {f: 2 Hz, g: {value: 2, unit: Hz}}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces: {drive: {type: joint, joint: arm, value: "sin(2*pi*f*t)*(2 Nm) + sin(2*pi*g*t)*(1 Nm)"}}
initial: {u: {arm: SPEED}}
"""


@pytest.mark.parametrize("speed", ["50 Hz", "-50 Hz", "f", "f + 1 Hz", "g"])
def test_hertz_are_no_angular_rate(speed):
    with pytest.raises(codegen.ModelError, match=r"is a frequency \(Hz\); a rate \(rad/s\) is needed; write rev/s"):
        codegen.parse_model(FREQUENCIES.replace("SPEED", speed))


@pytest.mark.parametrize("speed", ["2*pi*f", "2*pi*g", "3000 rpm", "50 rev/s", "2*pi*(50 Hz)", "7"])
def test_angular_rates_and_frequencies_with_a_factor_are_read(speed):
    model = codegen.parse_model(FREQUENCIES.replace("SPEED", speed))
    assert model.parameters[0].unit == "Hz" and not model.warnings
