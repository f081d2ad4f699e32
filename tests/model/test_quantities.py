# ruff: noqa: E501  (tables)
"""Numbers with units, and vectors: their SI values, where they are allowed, and errors about wrong units."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.binding import bind
from codegen.model.parsing import parse
from codegen.model.units import PI, UNITS, Dimension, in_units, unit_of
from codegen.reference import DenseEngine

MODEL = """\
model: units
gravity: [0, 0, -9.81 m/s**2]
constants: {rho: 7850 kg/m**3, up: [0, 0, 1], tilt: [0, 0.1, 1]}
parameters:
  hard_point: {value: [10 mm, 0, -200 mm], min: -1 m, max: [1, 1, 2]}
  hinge: [0.1, 1, 0]
  length: 30 cm
  k: {value: 2 kN/m, unit: N/m}
inputs: [pull]
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: hinge, at: hard_point}
    shape: {type: cylinder, axis: z, length: length, radius: 12 mm, density: rho, center: -length/2*up}
  slide:
    parent: arm
    joint: {type: prismatic, axis: -tilt, at: 2*hard_point/3 + length*up, rpy: [0, 90 deg, 0]}
    mass: 250 g
    inertia: {xx: 100 g*cm**2, yy: 1e-5, zz: 1e-5}
points:
  eye: {body: slide, at: hard_point - 5 mm*up}
forces:
  s: {type: spring, from: eye, to: ground, stiffness: k, free_length: length/2, damping: 3 N*s/m}
  d: {type: joint, joint: slide, value: 20 N - 300*q.slide + pull}
  e: {type: joint, joint: arm, value: 2 Nm*sin(3*t)}
  f: {type: force, on: eye, value: 3 N*hinge}
initial:
  q: {arm: 30 deg, slide: 5 mm}
  u: {arm: 10 rpm}
outputs:
  z: {position: eye, axis: up + hinge}
"""

SI = """\
model: units
gravity: [0, 0, -9.81]
parameters: {hx: 0.01, hy: 0, hz: -0.2, ax: 0.1, ay: 1, az: 0, length: 0.3, k: 2000}
inputs: [pull]
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: [ax, ay, az], at: [hx, hy, hz]}
    shape: {type: cylinder, axis: z, length: length, radius: 0.012, density: 7850, center: [0, 0, -length/2]}
  slide:
    parent: arm
    joint: {type: prismatic, axis: [0, -0.1, -1], at: [2*hx/3, 2*hy/3, 2*hz/3 + length], rpy: [0, pi/2, 0]}
    mass: 0.25
    inertia: {xx: 1e-5, yy: 1e-5, zz: 1e-5}
points:
  eye: {body: slide, at: [hx, hy, hz - 0.005]}
forces:
  s: {type: spring, from: eye, to: ground, stiffness: k, free_length: length/2, damping: 3}
  d: {type: joint, joint: slide, value: 20 - 300*q.slide + pull}
  e: {type: joint, joint: arm, value: 2*sin(3*t)}
  f: {type: force, on: eye, value: [3*ax, 3*ay, 3*az]}
outputs:
  z: {position: eye, axis: [ax, ay, 1 + az]}
"""


def test_units_are_si_rounded_once() -> None:
    for text, value in {
        "30 mm": 0.03, "7 mm": 0.007, "90 deg": math.pi / 2, "1 inch": 0.0254, "3 kN/mm": 3e6, "1e3 g": 1, "72 km/h": 20,
        "33 rpm": float(33 * PI / 30), "2 rev/s": 4 * math.pi, "5 N*mm": 0.005, "4 cm**2": 4e-4, "4 cm^2": 4e-4, "2 1/s": None,
    }.items():  # fmt: skip
        if value is None:
            with pytest.raises(ValueError, match="operator"):
                parse(text)
            continue
        assert bind(parse(text), {}).value == value, text
    with mpmath.workdps(60):
        assert abs(mpmath.pi - mpmath.mpf(PI.numerator) / PI.denominator) < 1e-55


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_is_of_its_dimension(name: str) -> None:
    size, dimension = UNITS[name]
    assert size > 0
    written = in_units(dimension)
    assert written == "" or unit_of(written) == (Fraction(1), dimension)


def test_a_unit_ends_where_no_unit_follows() -> None:
    assert str(parse("30 mm / s")) == "30 mm/s" and parse("30 mm / s").names == {"s"}
    assert parse("30 mm/s").names == frozenset() and parse("2 kg*L").names == {"L"}
    assert unit_of("turns") is None and unit_of("m") == (1, Dimension(1))


def test_a_model_with_units_and_vectors_is_the_same_in_si() -> None:
    one, two = parse_model(MODEL), parse_model(SI)
    assert one.warnings == two.warnings == ()
    names = ("hard_point.x", "hard_point.y", "hard_point.z", "hinge.x", "hinge.y", "hinge.z", "length", "k")
    assert one.parameter_names == names
    assert [p.value for p in one.parameters] == [p.value for p in two.parameters]
    assert [(p.unit, p.min, p.max) for p in one.parameters[:4]] == [
        ("m", -1, 1),
        ("m", -1, 1),
        ("m", -1, 2),
        ("", None, None),
    ]
    assert {k: e.value for k, e in (one.initial_q | one.initial_u).items()} == {"slide": 0.005, "arm": float(PI / 3)}
    assert one.initial_q["arm"].value == float(PI / 6)
    state = ([0.3, 0.02], [1.0, -0.4], None, [0.5], 0.2)
    mine, theirs = (DenseEngine(m).jacobians(*state) for m in (one, two))
    assert np.array_equal(mine.p, theirs.p) and np.array_equal(mine.q, theirs.q)


def test_vectors_in_generated_code(tmp_path) -> None:
    model = parse_model(MODEL)
    codegen.generate(
        model, tmp_path / "units", target="numpy", functions=("accelerations", "jacobians", "sensitivities")
    )
    solver = codegen.load(tmp_path / "units")
    q, u = [0.3, 0.02], [1.0, -0.4]
    assert np.abs(solver.jacobians(q, u).p - DenseEngine(model).jacobians(q, u).p).max() < 1e-9
    p = {"hard_point": [0.02, 0.01, -0.3], "length": 0.4}
    apart = {"hard_point.x": 0.02, "hard_point.y": 0.01, "hard_point.z": -0.3, "length": 0.4}
    assert np.array_equal(solver.accelerations(q, u, p), solver.accelerations(q, u, apart))
    along = solver.sensitivities(q, u, dp={"hard_point": np.eye(3)})[1]
    assert np.allclose(along, solver.jacobians(q, u).p[:, :3].T, rtol=1e-13)
    with pytest.raises(ValueError, match=r"p\['hard_point'\] has shape \(2,\), expected \(..., 3\): hard_point.x, "):
        solver.accelerations(q, u, {"hard_point": [1, 2]})


def test_the_builder_has_vectors() -> None:
    b = ModelBuilder("m", gravity="g")
    g, hp = b.parameter("g", [0, 0, -9.81]), b.parameter("hp", np.array([0.1, 0, 0.2]), unit="m", min=-1)
    b.body("arm", axis="y", at=2 * hp, mass=1, com=hp, inertia={"xx": 1, "yy": 1, "zz": 1})
    model = b.build()
    assert model.parameter_names == (f"{g}.x", "g.y", "g.z", "hp.x", "hp.y", "hp.z")
    assert str(model.bodies[0].joint.at[2]) == "2*hp.z" and model.gravity is not None


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("-9.81 m/s**2", "-9.81 m/s", "gravity[2]: -9.81 m/s is a velocity (m/s); an acceleration (m/s**2) is needed"),
        ("mass: 250 g", "mass: 250 mm", "bodies.slide.mass: 250 mm is a length (m); a mass (kg) is needed"),
        ("mass: 250 g", "mass: 2700*length**3", "bodies.slide.mass: 2700*length**3 is a quantity in m**3; a mass (kg) is needed; a number without a unit counts as a factor"),
        ("mass: 250 g", "mass: 250 gg", "'gg' is not a unit; units are m, mm"),
        ("mass: 250 g", "mass: 250 k", "'k' is not a unit"),
        ("xx: 100 g*cm**2", "xx: 30 mm", "inertia.xx: 30 mm is a length (m); a moment of inertia (kg*m**2) is needed"),
        ("[0, 90 deg, 0]", "[0, 90 mm, 0]", "rpy[1]: 90 mm is a length (m); a plain number or an angle (rad) is needed"),
        ("5 mm*up", "5 kg*hard_point", "points.eye.at: hard_point - 5 kg*hard_point: a quantity in kg*m is subtracted from a length (m)"),
        ("stiffness: k", "stiffness: k*length", "stiffness: k*length is a force (N); a stiffness (N/m) is needed"),
        ("3 N*s/m", "3 N/m", "damping: 3 N/m is a stiffness (N/m); a damping (N*s/m) is needed"),
        ("20 N -", "20 Nm -", "forces.d.value: 20 Nm - 300*q.slide + pull is a torque or an energy (N*m); a force (N) is needed"),
        ("2 Nm*sin(3*t)", "2 N", "forces.e.value: 2 N is a force (N); a torque or an energy (N*m) is needed"),
        ("2 Nm*sin(3*t)", "2 Nm*sin(length)", "sin of a length (m); it takes an angle or a plain number"),
        ("3 N*hinge", "3*hard_point", "forces.f.value: 3*hard_point is a length (m); a force (N) is needed"),
        ("slide: 5 mm", "slide: 5 deg", "initial.q.slide: 5 deg is an angle (rad); a length (m) is needed"),
        ("arm: 10 rpm", "arm: 10 m/s", "initial.u.arm: 10 m/s is a velocity (m/s); a rate (rad/s) is needed"),
        ("arm: 10 rpm", "arm: -5 deg", "initial.u.arm: -5 deg is an angle (rad); a rate (rad/s) is needed: write -5 deg/s"),
        ("-9.81 m/s**2", "-9.81 m", "gravity[2]: -9.81 m is a length (m); an acceleration (m/s**2) is needed: write -9.81 m/s**2"),
        ("mass: 250 g", "mass: 0,25 kg", "bodies.slide.mass: '0,25 kg': a comma outside a function's parentheses; a decimal point is written ., as in 0.6"),
        ("value: 2 kN/m, unit: N/m", "value: 2,5 kN/m", "parameters.k.5 kN/m: unknown key '5 kN/m'; keys here: value, unit, min, max; a decimal point is written ., as in 0.6"),
        ("unit: N/m}", "unit: mm}", "parameters.k.unit: unit mm is a length (m), the value a stiffness (N/m)"),
        ("value: 2 kN/m, unit: N/m", "value: 2, unit: kN/m", "warning: parameters.k.unit: unit kN/m"),
        ("length: 30 cm", "length: 30 cm**12", "powers of units go up to 9"),
        ("length: 30 cm", "length: 1e308 km", "is too large"),
        ("length: 30 cm", "length: 30 cm + 2 kg", "a mass (kg) is added to a length (m)"),
        ("length: 30 cm", "length: 2**(3 cm)", "an exponent is a length (m)"),
        ("hinge: [0.1, 1, 0]", "hinge: [0.1, 1]", "parameters.hinge: a list of 2; a number, or three for a vector, is needed"),
        ("[10 mm, 0, -200 mm]", "[10 mm, 0, -200 kg]", "components have different units"),
        ("max: [1, 1, 2]", "max: [1, 1]", "parameters.hard_point.max"),
        ("{value: 2 kN/m, unit: N/m}", "{value: 2, max: [1, 2, 3]}", "parameters.k.max: three bounds for one number"),
        ("at: hard_point}", "at: hard_pint}", "joint.at: 'hard_pint' is not a vector; three numbers [x, y, z] are needed"),
        ("at: hard_point}", "at: hard_point + length}", "joint.at: hard_point + length adds a number and a vector"),
        ("at: hard_point}", "at: hard_point*hinge}", "joint.at: hard_point*hinge multiplies or divides by a vector"),
        ("axis: hinge,", "axis: length,", "joint.axis: 'length' is not an axis"),
        ("length: 30 cm", "length: hinge.x", "parameters.length: unknown name 'hinge.x'"),
        ("free_length: length/2", "free_length: hard_point", "free_length: unknown name 'hard_point'"),
        ("free_length: length/2", "free_length: hard_point.w", "only coordinates q.NAME, speeds u.NAME"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_said_once(old: str, new: str, expected: str) -> None:
    assert old in MODEL
    text = MODEL.replace(old, new, 1)
    try:
        found = list(parse_model(text, "m.yaml").warnings)
    except ModelError as error:
        found = str(error).splitlines()
    matching = [line for line in found if expected in line]
    assert len(matching) == 1, "\n".join(found)
    line = next(i for i, (a, b) in enumerate(zip(MODEL.splitlines(), text.splitlines(), strict=True), 1) if a != b)
    assert matching[0].startswith(f"m.yaml:{line}:")
