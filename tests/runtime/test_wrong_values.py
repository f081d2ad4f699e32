"""Wrong values at run time: negative masses, lengths out of reach, and arguments of a wrong kind."""

import contextlib
import warnings

import numpy as np
import pytest

import codegen
from codegen.runtime import Final

MODEL = """
model: crane
gravity: [0, 0, -9.81]
parameters:
  m: 2
  full: 5
  water: 1
  J: 0.1
  rotor: 1e-3
  radii: [0.3, 0.2, 0.1]
  length: 0.5
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: y, armature: rotor}
    mass: m
    com: [0, 0, -length]
    inertia: {xx: J, yy: J, zz: 0.1, xz: 0.01}
  tank: {parent: arm, joint: {type: revolute, axis: y, at: [0, 0, -length]}, mass: full - water, com: [0, 0, -0.3]}
  ball:
    parent: tank
    joint: {type: revolute, axis: y, at: [0, 0, -0.6]}
    shape: {type: box, size: radii, density: 500, center: [0, 0, -length]}
outputs: {angle: {value: q.arm}}
"""


@pytest.fixture(scope="module")
def crane(tmp_path_factory):
    folder = tmp_path_factory.mktemp("crane") / "crane"
    codegen.generate(codegen.parse_model(MODEL), folder, check=False)
    return codegen.load(folder)


BAD = [
    ({"m": -0.5}, r"the mass of 'arm' is -0\.5, and must be at least 0; .* check m$"),
    ({"water": 5.5}, r"the mass of 'tank' is -0\.5, .* check full, water$"),
    ({"J": 0.0001}, r"the smallest principal moment of 'arm' is -0\.00089.*, .* check J$"),
    ({"rotor": -1e-4}, r"the armature of 'arm' is -0\.0001, .* check rotor$"),
    ({"radii": [0.3, -0.2, 0.1]}, r"the mass of 'ball' is -3, .* check radii\.x, radii\.y, radii\.z$"),
]


@pytest.mark.parametrize(("p", "message"), BAD)
def test_a_negative_mass_by_name_gives_a_warning(crane, p, message):
    q, u = crane.initial
    with pytest.warns(RuntimeWarning, match=rf"^p: {message}") as caught:
        crane.energies(q, u, p)
    assert caught[0].filename == __file__


@pytest.mark.parametrize(("p", "message"), BAD)
def test_motions_warn_of_arrays_too(crane, p, message):
    array = crane._arguments.array("p", p, "p", crane.parameters)
    for given in (p, array):
        for motion, arguments in ((crane.simulate, ([0.0, 1e-3],)), (crane.judge, (1e-3, Final("angle")))):
            with pytest.warns(RuntimeWarning, match=message), contextlib.suppress(codegen.runtime.SimulationError):
                motion(*arguments, p=given)


def test_the_entry_of_a_batch_is_named(crane):
    q, u = crane.initial
    with pytest.warns(RuntimeWarning, match=r"is -2 \(entry \[1\] of the batch\), and must"):
        crane.energies(q, u, {"m": [1.0, -2.0, 3.0]})


@pytest.mark.parametrize(
    "p",
    [{"m": 3.0}, {"m": 0}, {"water": 4.9}, {"length": -0.5}, {"radii": [-0.3, -0.2, 0.1]}, {"m": np.array([1.0, 2.0])}],
)
def test_possible_masses_give_no_warning(crane, p):
    q, u = crane.initial
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crane.energies(q, u, p)
        if np.ndim(p.get("m", 0.0)) == 0:
            crane.simulate([0.0, 1e-3], p=p)


def test_a_tolerated_inertia_gives_no_warning_at_other_parameters(tmp_path):
    text = MODEL.replace("zz: 0.1, xz: 0.01}", "zz: -0.1, check: warn}")
    codegen.generate(codegen.parse_model(text), tmp_path / "crane", check=False)
    crane = codegen.load(tmp_path / "crane")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crane.energies(*crane.initial, {"J": 0.2})


def test_a_joint_with_negative_inertia_is_not_said_to_have_none(crane):
    q, u = crane.initial
    with pytest.raises(codegen.runtime.SingularJointError, match="has positive inertia about it"):
        crane.accelerations(q, u, crane._arguments.array("p", {"m": -50.0}, "p", crane.parameters))


SLIDER = """
model: press
parameters: {r: 0.05, l: 0.18}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, mass: 1, com: [r, 0, 0]}
  rod:
    parent: crank
    joint: {type: revolute, axis: -y, at: [r, 0, 0]}
    shape: {type: rod, axis: x, length: l, mass: 0.8, center: [l/2, 0, 0]}
  slider: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1.5}
loops:
  pin: {joint: {type: revolute, axis: -y}, from: {body: rod, at: [l, 0, 0]}, to: slider}
motion: {crank: 60*t}
initial: {q: {rod: 0, slider: 0.23}}
"""


def test_the_check_of_generate_does_not_warn_of_its_own_random_states(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = codegen.generate(codegen.parse_model(SLIDER), tmp_path / "press", check=True)
    assert report.errors["udot"] < 1e-12


def test_a_prescribed_motion_beyond_its_reach_is_not_sent_to_other_independents(tmp_path):
    codegen.generate(codegen.parse_model(SLIDER), tmp_path / "press", check=False)
    press = codegen.load(tmp_path / "press")
    with pytest.raises(codegen.runtime.SimulationError, match="the end of their reach; check the lengths") as caught:
        press.simulate(0.1, p={"l": 0.03})
    assert "partition" not in str(caught.value)


def test_a_name_is_no_functional(crane):
    with pytest.raises(ValueError, match=r"^'angle' is not a functional; .* such as Final\('angle'\)"):
        crane.judge(1.0, "angle", wrt="m")


def test_another_file_is_no_trajectory(tmp_path):
    (tmp_path / "run.npz").write_text("not a motion")
    with pytest.raises(ValueError, match=r"it does not begin like a file \.npz"):
        codegen.load_trajectory(tmp_path / "run.npz")
