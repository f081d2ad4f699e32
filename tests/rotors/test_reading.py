"""The key `armature` of joints: allowed values, errors, and its use in other parts of the model."""

from __future__ import annotations

import pytest

import codegen
from codegen.listing import list_model
from codegen.model import ModelError, parse_model
from codegen.reference import DenseEngine

TEXT = """
model: geared
parameters: {J: 0.1}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [1, 0, 0]}
  hand: {parent: arm, joint: {JOINT}, mass: 1, com: [1, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
"""
HINGE = "type: revolute, axis: x, armature: "


def read(joint: str) -> codegen.Model:
    return parse_model(TEXT.replace("JOINT", joint))


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (HINGE + "-2", "-2 is negative; the reflected inertia of a rotor is its inertia times the square of the gear ratio, at "
         "least 0 kg m^2"),
        (HINGE + "J - 1", "J - 1 = -0.9 is negative; the reflected inertia"),
        ("type: prismatic, axis: x, armature: -1", "at least 0 kg"),
        (HINGE + "[1, 2]", "2 values for a revolute joint; one is needed, for turning (kg m^2)"),
        (HINGE, "there is nothing after the colon; write a value, or leave the key out"),
        (HINGE + "q.arm", "'q.arm', which changes with the motion, is not allowed here"),
        (HINGE + "3 kg", "3 kg is a mass (kg); a moment of inertia (kg*m**2) is needed"),
        ("type: cylindrical, axis: z, armature: [1 kg*m^2, 0]", "1 kg*m^2 is a moment of inertia (kg*m**2); a mass (kg) is"),
        ("type: cylindrical, axis: z, armature: 1", "1 value for a cylindrical joint; 2 are needed, for sliding (kg), turning "
         "(kg m^2); 0 where there is no rotor"),
        ("type: cylindrical, axis: z, armature: [1, -J]", "bodies.hand.joint.armature[1]: -J = -0.1 is negative"),
        ("type: spherical, armature: [1, 2, 3]", "3 values for a spherical joint; one is needed, for turning (kg m^2), the same "
         "about every axis"),
        ("type: free, armature: 1", "a free joint has no motor, so armature is not allowed; leave it out, or add it to "
         "the mass and inertia of the body"),
        ("type: fixed, armature: 1", "a fixed joint has no motor, so armature"),
        ("type: revolute, axis: x, armatur: 1", "did you mean 'armature'?"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(joint: str, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(joint)
    assert message in str(caught.value)


def test_a_loop_joint_has_none() -> None:
    loop = "loops:\n  pin: {joint: {type: point, armature: 1}, from: hand, to: ground}\n"
    with pytest.raises(ModelError, match="unknown key 'armature'"):
        parse_model(TEXT.replace("JOINT", "type: revolute, axis: x") + loop)


@pytest.mark.parametrize(
    ("joint", "value"),
    [
        (HINGE + "0", ()), (HINGE + "0.0", ()), (HINGE + "0 kg*m^2", ()), (HINGE + "J*3**2", ("J*9",)),
        (HINGE + "[J]", ("J",)), (HINGE + "300 g*cm^2", ("3e-05",)), ("type: spherical, armature: J", ("J",) * 3),
        ("type: universal, axes: [x, y], armature: [0, 0]", ()),
        ("type: universal, axes: [x, y], armature: [0, J]", ("0", "J")),
        ("type: screw, axis: x, pitch: 0.1, armature: J", ("J",)),
    ],
)  # fmt: skip
def test_what_is_read(joint: str, value: tuple[str, ...]) -> None:
    armature = read(joint).bodies[1].joint.armature
    assert tuple(str(e) if not e.is_number else f"{e.value:g}" for e in armature) == value


def test_it_is_shown_and_built_in_python() -> None:
    assert "body hand: revolute x, armature J*9;" in "\n".join(list_model(read(HINGE + "J*9")))
    b = codegen.ModelBuilder("built")
    J = b.parameter("J", 0.1, unit="kg m^2")
    b.body("arm", joint="cylindrical", axis="z", armature=[0, J * 9], mass=1, com=[1, 0, 0], inertia={"zz": 1})
    assert DenseEngine(b.build()).mass_matrix([0.0, 0.0])[1, 1] == pytest.approx(1 + 1 + 0.9, rel=1e-15)


MASSLESS = """
model: light
parameters: {J: 0.1}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y ARM}}
  hand: {parent: arm, joint: {type: cylindrical, axis: z HAND}}
"""


@pytest.mark.parametrize(
    ("arm", "hand", "message"),
    [
        ("", "", "the revolute joint of 'arm' moves no mass"),
        ("", ", armature: [1, J]", "the revolute joint of 'arm' moves no mass"),
        (", armature: J", ", armature: [1, 0]", "the cylindrical joint of 'hand' moves no mass"),
        (", armature: J", ", armature: [1, J]", ""),
    ],
)
def test_a_joint_that_moves_no_mass_needs_a_rotor_for_each_freedom(arm: str, hand: str, message: str) -> None:
    text = MASSLESS.replace(" ARM", arm).replace(" HAND", hand)
    if message:
        with pytest.raises(ModelError) as caught:
            parse_model(text)
        assert message in str(caught.value)
        assert "give it mass, the joint an armature, or fix the joint" in str(caught.value)
    else:
        assert parse_model(text).nu == 3


def test_a_point_mass_in_its_own_joint_may_have_a_rotor() -> None:
    body = "model: point\nbodies:\n  b: {parent: ground, joint: {type: revolute, axis: y ROTOR}, mass: 1}\n"
    with pytest.raises(ModelError, match="rotates a point mass about its centre"):
        parse_model(body.replace(" ROTOR", ""))
    assert DenseEngine(parse_model(body.replace(" ROTOR", ", armature: 0.5"))).mass_matrix([0.0])[0, 0] == 0.5
