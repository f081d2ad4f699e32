"""Other axes for the ground where loops that close on it are simpler in these: the same system, with the statements of one that
stands along the world's axes."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from outputs.test_generated import check

import codegen
from codegen.mechanics.structure.world import common_rotation, tidied, turned_ground
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

ANGLES = (0.0709297482015403, 2.702782177955612, -2.135042323682198)
ROTATE = (
    f"rotate: [{{axis: z, angle: {ANGLES[0]!r}}}, {{axis: x, angle: {ANGLES[1]!r}}}, {{axis: z, angle: {ANGLES[2]!r}}}]"
)


def axes(angles: tuple[float, ...] = ANGLES) -> np.ndarray:
    """The matrix of rotations about z, x and z."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(angles), np.sin(angles)
    about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]])
    return about_z @ about_x @ np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])


def text(v: np.ndarray, factor: str = "") -> str:
    return f"[{', '.join(repr(float(e)) + factor for e in v)}]"


R = axes()

FOUR_BAR = """
model: askew
parameters: {L: 0.7, g: 9.81}
gravity: GRAVITY
bodies:
  a: {parent: ground, joint: {type: revolute, axis: z, ROTATE},
      shape: {type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}
  b: {parent: a, joint: {type: revolute, axis: z, at: [L, 0, 0]},
      shape: {type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}
  c: {parent: b, joint: {type: revolute, axis: z, at: [L, 0, 0]},
      shape: {type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}
loops:
  pin: {joint: {type: revolute, axis: z}, from: {body: c, at: [L, 0, 0]}, to: {body: ground, at: PLACE, ROTATE}}
initial: {q: {a: 1.2, b: -1.2, c: -1.9}, u: {a: 1.0}}
independent: [a]
"""
"""The last bearing is at 1.3 L along x of the first one."""


def four_bar(askew: bool) -> Model:
    found = FOUR_BAR.replace("GRAVITY", text(-R[:, 1], "*g") if askew else "[0, -g, 0]")
    found = found.replace("PLACE", text(1.3 * R[:, 0], "*L") if askew else "[1.3*L, 0, 0]")
    return parse_model(found.replace(", ROTATE", f", {ROTATE}" if askew else ""))


EVERYTHING = f"""
model: everything
parameters: {{L: 0.7, g: 9.81, k: 3, alpha: 0.2}}
inputs: [pull]
gravity: [0.1*g, -0.2*g, -g]
points:
  tip: {{body: b, at: [L, 0.1, 0.2]}}
  hook: {{body: ground, at: [0.3, L, 1.5]}}
bodies:
  base: {{parent: ground, joint: {{type: fixed, at: [0.3, 0.1, L], {ROTATE}}}, mass: 2, com: [0.1, 0.2, 0.3],
         inertia: {{xx: 0.1, yy: 0.1, zz: 0.14}}}}
  a: {{parent: base, joint: {{type: revolute, axis: z}}, shape: {{type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}}}
  b: {{parent: a, joint: {{type: revolute, axis: z, at: [L, 0, 0]}},
      shape: {{type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}}}
  c: {{parent: b, joint: {{type: revolute, axis: z, at: [L, 0, 0]}},
      shape: {{type: rod, axis: x, length: L, mass: 1, center: [L/2, 0, 0]}}}}
  ball: {{parent: ground, joint: {{type: spherical, at: [0, L, 0.2], rpy: [0.1, alpha, 0.3]}}, mass: 1, com: [0.1, 0, -0.4],
         inertia: {{xx: 0.1, yy: 0.12, zz: 0.1}}}}
loops:
  pin: {{joint: {{type: revolute, axis: z}}, from: {{body: c, at: [L, 0, 0]}}, to: {{body: ground, at: PLACE, {ROTATE}}}}}
forces:
  up: {{type: force, on: tip, value: [pull, 1 + 0.3*q.a, k]}}
  own: {{type: torque, on: ball, value: [pull, 0.2, k], axes: body}}
  around: {{type: torque, on: ball, value: [0, k*t, pull]}}
  spring: {{type: spring, from: hook, to: tip, stiffness: k, free_length: 0.3}}
  wring: {{type: torsion, from: ground, to: ball, axis: z, stiffness: k}}
outputs:
  x: {{position: tip, axis: [1, 0.2, L]}}
  v: {{velocity: tip, axis: y}}
  acc: {{acceleration: tip, axis: z}}
  far: {{distance: [hook, tip]}}
  way: {{relative_position: [hook, tip], axis: y}}
  there: {{position: hook, axis: x}}
  w: {{angular_velocity: ball, axis: [0.2, 1, 0]}}
  own_w: {{angular_velocity: ball, axis: y, frame: body}}
  entry: {{rotation: ball, entry: xy}}
  back: {{rotation: ground, relative_to: b, entry: qz}}
  between: {{rotation: a, relative_to: ball, entry: qx}}
  com: {{center_of_mass: system, axis: x}}
  fixed_com: {{center_of_mass: [base, a], axis: z}}
  momentum: {{momentum: angular, axis: y, about: ground}}
  stored: potential_energy
  moving: kinetic_energy
initial: {{q: {{a: 1.2, b: -1.2, c: -1.9}}, u: {{a: 1.0}}}}
independent: [a]
"""
"""A four-bar on a frame that is fixed to the ground, its last bearing on the ground itself; all that is along its axes."""

LAST_BEARING = [f"{a} + {1.3 * float(e)!r}*L" for a, e in zip(("0.3", "0.1", "L"), R[:, 0], strict=True)]
EVERYTHING = EVERYTHING.replace("PLACE", f"[{', '.join(LAST_BEARING)}]")


def test_statements_are_those_of_a_mechanism_that_stands_straight(tmp_path: Path) -> None:
    """The same operations, and the same motion in every bit; lengths that are 0.7 and 1.3 times it again."""
    a, b = (
        codegen.generate(four_bar(askew), tmp_path / f"{askew}", "numpy", functions=("accelerations",)).folder
        for askew in (False, True)
    )
    straight, askew = codegen.load(a, "numpy"), codegen.load(b, "numpy")
    assert (b / "askew_numpy.py").read_text(encoding="utf-8") == (a / "askew_numpy.py").read_text(encoding="utf-8")
    q, u = straight.initial
    np.testing.assert_array_equal(askew.accelerations(q, u), straight.accelerations(q, u))


def test_gravity_places_and_axes_become_what_they_were() -> None:
    model, way = turned_ground(four_bar(True))
    assert model.gravity is not None
    assert [str(g) for g in model.gravity] == ["0", "-g", "0"]
    assert model.bodies[0].joint.rotation == model.loops[0].end.rotation == ()
    assert [str(x) for x in model.loops[0].end.at] == ["1.3*L", "0", "0"]
    assert len(way) == 1


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> tuple[Model, Path]:
    """The model of everything, and its package, of what the tests call."""
    model = parse_model(EVERYTHING)
    functions = (
        "accelerations", "sensitivities", "energies", "energy_sensitivities", "outputs", "output_sensitivities",
        "output_gradients",
    )  # fmt: skip
    return model, codegen.generate(
        model, tmp_path_factory.mktemp("turned") / "out", "c", functions=functions, compile="all"
    ).folder


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_all_along_the_axes_of_the_ground_stays_what_it_is(everything: tuple[Model, Path], target: str) -> None:
    """Values and derivatives of accelerations, energies and outputs are those of both engines, which turn nothing."""
    model, package = everything
    assert len(common_rotation(model)) == 3
    solver = codegen.load(package, target)
    rng = np.random.default_rng(5)
    q, u = solver.assemble(*solver.initial)
    u = solver.assemble(q, rng.normal(size=solver.nu))[1]
    q[model.coordinate_slices[4][0]] = np.array([0.5, -0.1, 0.7, 0.5])
    state = (q, u, np.array(list(model.defaults.values())), np.array([0.7]), 0.3)
    check(model, state, solver)
    seeds = {
        "dq": rng.normal(size=(3, solver.nq)),
        "du": rng.normal(size=(3, solver.nu)),
        "dp": rng.normal(size=(3, solver.np)),
    }
    seeds["dinputs"], seeds["dt"] = rng.normal(size=(3, 1)), rng.normal(size=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for engine in (DenseEngine(model), RecursiveEngine(model)):
            for name in ("sensitivities", "energy_sensitivities"):
                given = {n: s for n, s in seeds.items() if name == "sensitivities" or n in ("dq", "du", "dp")}
                for ours, theirs in zip(
                    getattr(solver, name)(*state, **given), getattr(engine, name)(*state, **given), strict=True
                ):
                    np.testing.assert_allclose(np.array(ours), np.array(theirs, float), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (repr(ANGLES[0]), "2*alpha"),  # a parameter turns it
        ("1 + 0.3*q.a", "position.hook.x"),  # a law reads a position
        (f", {ROTATE}}}, mass", "}, mass"),  # only one of three is turned
        (
            "{body: c, at: [L, 0, 0]}, to: {body: ground,",
            "{body: c, at: [L, 0, 0]}, to: {body: ball,",
        ),  # nothing closes on it
    ],
)
def test_when_the_ground_keeps_its_axes(old: str, new: str) -> None:
    """Most of what stands on the ground has to be turned alike, by numbers, and something has to close on it."""
    assert common_rotation(parse_model(EVERYTHING))
    assert EVERYTHING.count(old) >= 1
    assert common_rotation(parse_model(EVERYTHING.replace(old, new))) == ()
    assert common_rotation(four_bar(False)) == ()


def test_reactions_stay_along_the_axes_of_the_model(tmp_path: Path) -> None:
    """They are given in the ground frame, which keeps its axes for them."""
    found = []
    for askew in (False, True):
        package = codegen.generate(four_bar(askew), tmp_path / f"{askew}", "numpy", reactions=True).folder
        solver = codegen.load(package, "numpy")
        joints, loops = solver.reactions(*solver.initial)
        found.append(np.concatenate([np.reshape(joints, (-1, 3)), np.reshape(loops, (-1, 3))]))
    np.testing.assert_allclose(found[1], found[0] @ R.T, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1e-16, 0.0),
        (1.0000000000000002, 1.0),
        (-0.7000000000000001, -0.7),
        (1 / 3, 1 / 3),
        (0.1234567890123, 0.1234567890123),
    ],
)
def test_rounding_is_taken_away_from_decimals_alone(value: float, expected: float) -> None:
    assert tidied(value, 8 * 2.0**-52 * max(abs(value), 0.1)) == expected


def test_lengths_of_bodies_are_known() -> None:
    """Of sides that are no decimals the bearing on the ground has the one of the bodies."""
    third = 0.7071067811865476
    assert tidied(np.nextafter(third, 1), 1e-15, [0.3, third]) == third
    assert tidied(-np.nextafter(third, 1), 1e-15, [0.3, third]) == -third
