# ruff: noqa: E501  (tables)
"""Mass properties: which are refused, which give a warning, and which are accepted."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.model import Model, ModelError, parse_model
from codegen.reference import DenseEngine

LINK = "mass: 3, com: [0, 0.1, -0.4], inertia: {xx: 0.1, yy: 0.1, zz: 0.02}"


def model(*bodies: str) -> Model:
    return parse_model("model: m\nbodies:\n" + "".join(f"  {b}\n" for b in bodies), "m.yaml")


def errors(*bodies: str) -> list[str]:
    with pytest.raises(ModelError) as info:
        model(*bodies)
    return [str(p) for p in info.value.problems if p.severity == "error"]


ROOT = f"root: {{parent: ground, joint: {{type: revolute, axis: y}}, {LINK}}}"


@pytest.mark.parametrize("inertia", ["{xz: 1.4e-20}", "{xx: -1e-20}", "{xx: 1e-20, yy: 1e-20, xy: 3e-20}"])
def test_dirt_is_no_error(inertia: str) -> None:
    # as converters write the frames of a robot: entries that rounding has left, beside kilograms and metres
    made = model(ROOT, f"tool: {{parent: root, joint: {{type: fixed, at: [0, 0, -0.8]}}, inertia: {inertia}}}")
    assert made.warnings == ()


def test_what_is_dirt_beside_a_robot_is_none_beside_a_gnat() -> None:
    gnat = "{parent: ground, joint: {type: revolute, axis: y}, mass: 1e-9, com: [1e-4, 0, 0], inertia: {xx: -1e-20, yy: 1e-19, zz: 1e-19}}"
    assert "negative principal moment -1e-20" in errors(f"gnat: {gnat}")[0]
    assert model(ROOT, f"gnat: {gnat}").nu == 2


def test_dirt_is_no_inertia_either() -> None:
    (line,) = errors(ROOT, "tool: {parent: root, joint: {type: revolute, axis: x}, inertia: {xz: 1.4e-20}}")
    assert "the revolute joint of 'tool' moves no mass" in line


IMPOSSIBLE = "mass: 1e-6, inertia: {xx: 1e-7, yy: 1e-7, zz: -3.5e-8}"


def test_the_inertia_of_what_fixed_joints_hold_together_counts() -> None:
    made = model(
        ROOT,
        "arm: {parent: root, joint: {type: fixed, at: [0, 0, -0.8], rpy: [0.3, 0.2, 0.1]}}",
        f"sensor: {{parent: arm, joint: {{type: fixed, at: [0.1, 0, 0]}}, {IMPOSSIBLE}}}",
    )
    (warning,) = [w for w in made.warnings if "sensor" in w]
    assert (
        "bodies.sensor.inertia: the inertia of 'sensor' has the negative principal moment -3.5e-08; with the bodies fixed to it"
        in warning
    )
    assert "('root', 'arm')" in warning
    grounded = model(ROOT, f"plate: {{parent: ground, joint: {{type: fixed}}, {IMPOSSIBLE}}}")
    assert "fixed to the ground" in grounded.warnings[0]


def test_merging_turns_the_inertia() -> None:
    # -1 about z of the sensor is -1 about x of the carrier, which has only 0.5 there, and 2 about z
    carrier = "carrier: {{parent: ground, joint: {{type: spherical}}, mass: 1, inertia: {{xx: 0.5, yy: 2, zz: 2}}}}"
    turned = (
        "sensor: {{parent: carrier, joint: {{type: fixed, rpy: [0, {angle}, 0]}}, inertia: {{xx: 1, yy: 1, zz: -1}}}}"
    )
    assert "with the bodies fixed to it" in model(carrier.format(), turned.format(angle=0)).warnings[0]
    assert "negative principal moment -1;" in errors(carrier.format(), turned.format(angle="pi/2"))[0]


def test_an_impossible_inertia_names_its_way_out() -> None:
    body = "{{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, inertia: {{xx: -1e-3, yy: 1, zz: 1{}}}}}"
    (line,) = errors("arm: " + body.format(""))
    assert "if it is intended, write check: warn beside xx, yy, ..." in line
    made = model("arm: " + body.format(", check: warn"))
    assert (
        "warning: bodies.arm.inertia: the inertia of 'arm' has the negative principal moment -0.001" in made.warnings[0]
    )
    (line,) = errors("arm: " + body.format(", check: no"))
    assert line.startswith("m.yaml:3:") and "bodies.arm.inertia.check: 'no'; error or warn is allowed" in line


@pytest.mark.parametrize(
    "joint", ["revolute, axis: [0, 0, 0]", "universal, axes: [x, [0, 0, 0]]", "prismatic, axis: [0, 0, 0]"]
)
def test_an_axis_of_zero_is_one_mistake(joint: str) -> None:
    (line,) = errors(f"arm: {{parent: ground, joint: {{type: {joint}}}, mass: 1}}")
    assert "the axis is zero at the default parameters" in line


SINGULAR = {
    "a massless free root": ["root: {parent: ground, joint: {type: free}}", f"arm: {{parent: root, joint: {{type: revolute, axis: x}}, {LINK}}}"],
    "a slide along a slide": ["a: {parent: ground, joint: {type: prismatic, axis: x}}", f"b: {{parent: a, joint: {{type: prismatic, axis: x}}, {LINK}}}"],
    "a hinge in a ball": [
        "a: {parent: ground, joint: {type: revolute, axis: x, rpy: [0.1, 0.2, 0.3]}}",
        "b: {parent: a, joint: {type: fixed, at: [1, 0, 0]}}",
        f"c: {{parent: b, joint: {{type: spherical, at: [1, 0, 0]}}, {LINK}}}",
    ],
    "a universal joint on its own axis": [
        "a: {parent: ground, joint: {type: revolute, axis: z}}",
        f"b: {{parent: a, joint: {{type: universal, axes: [z, x], at: [0, 0, 2]}}, {LINK}}}",
    ],
}  # fmt: skip
REGULAR = {
    "crossed axes": ["a: {parent: ground, joint: {type: revolute, axis: x}}", f"b: {{parent: a, joint: {{type: revolute, axis: y}}, {LINK}}}"],
    "a lever": ["a: {parent: ground, joint: {type: revolute, axis: y}}", f"b: {{parent: a, joint: {{type: revolute, axis: y, at: [1, 0, 0]}}, {LINK}}}"],
    "a free root with two arms": [
        "root: {parent: ground, joint: {type: free}}",
        f"a: {{parent: root, joint: {{type: revolute, axis: x}}, {LINK}}}",
        f"b: {{parent: root, joint: {{type: revolute, axis: y, at: [1, 0, 0]}}, {LINK}}}",
    ],
    "light on heavy": ["a: {parent: ground, joint: {type: prismatic, axis: x}}", f"b: {{parent: a, joint: {{type: prismatic, axis: y}}, {LINK}}}",
                       "c: {parent: b, joint: {type: revolute, axis: z}, mass: 1e-9, com: [1e-3, 0, 0]}"],
}  # fmt: skip


@pytest.mark.parametrize("bodies", SINGULAR.values(), ids=SINGULAR)
def test_a_joint_that_gives_way_in_every_configuration_is_told(bodies: list[str]) -> None:
    (line,) = errors(*bodies)
    assert "is free to move without moving any mass, in every configuration" in line


@pytest.mark.parametrize("bodies", REGULAR.values(), ids=REGULAR)
def test_massless_bodies_that_others_hold_are_fine(bodies: list[str]) -> None:
    made = model(*bodies)
    rng = np.random.default_rng(3)
    q = rng.normal(size=made.nq)
    udot = np.asarray(DenseEngine(made).accelerations(q, rng.normal(size=made.nu)))
    assert np.isfinite(udot).all()
