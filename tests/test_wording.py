"""Parts of messages: nouns with their numbers, and hints for misspelt names wherever names are given."""

import subprocess
import sys

import numpy as np
import pytest

import codegen
from codegen.runtime import Event, Final
from codegen.wording import counted, nearest, similar

PRESS = """\
model: press
gravity: [0, 0, -9.81]
parameters: {L: 0.9, r: 0.1}
inputs: [Torque]
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, inertia: {xx: 1, yy: 1, zz: 1}}
  rod: {parent: crank, joint: {type: revolute, axis: -y, at: [r, 0, 0]}, shape: {type: rod, axis: x, mass: 1, length: L}}
  ram: {parent: ground, joint: {type: prismatic, axis: x}, mass: 3}
loops:
  pin: {joint: {type: revolute, axis: -y}, from: {body: rod, at: [L, 0, 0]}, to: ram}
forces: {drive: {type: joint, joint: crank, value: Torque}}
initial: {q: {crank: 0.7, rod: -0.1, ram: 0.9}}
independent: [crank]
outputs: {A: {value: q.ram}}
"""


def test_nouns_follow_their_numbers():
    assert [counted(n, "variable") for n in (0, 1, 2)] == ["0 variables", "1 variable", "2 variables"]
    assert [counted(n, "body", "bodies") for n in (1, 2)] == ["1 body", "2 bodies"]


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("l", ["length", "L"], "L"),
        ("torq", ["torque", "L"], "torque"),
        ("TORQ", ["torque"], "torque"),
        ("Q.crank", ["u.crank", "q.crank"], "q.crank"),
        ("", ["a"], None),
        ("zebra", ["L"], None),
        (3, ["x3", "y"], "x3"),
        ("x" * 101, ["x" * 101], None),
        ("link_7", [f"link_{n}" for n in range(1100, 2200)], None),
        ("link_1500x", [f"link_{n}" for n in range(1100, 2200)], "link_1500"),
    ],
)
def test_the_most_similar_name_is_suggested(name, known, expected):
    assert similar(name, known) == expected
    assert nearest(name, known) == ("" if expected is None else f"; did you mean {expected!r}?")


@pytest.fixture(scope="module")
def press(tmp_path_factory):
    folder = tmp_path_factory.mktemp("press") / "press"
    codegen.generate(codegen.parse_model(PRESS), folder, functions="motion", compile=False)
    return codegen.load(folder)


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        (lambda s: s.simulate(0.1, p={"l": 0.3}), "L"),
        (lambda s: s.simulate(0.1, q={"Crank": 0.3}), "crank"),
        (lambda s: s.simulate(0.1, inputs={"torque": 1.0}), "Torque"),
        (lambda s: s.simulate(0.1, sensitivities="l"), "L"),
        (lambda s: s.simulate(0.1, sensitivities="Q0.crank"), "q0.crank"),
        (lambda s: s.simulate(0.1, events=Event("a")), "A"),
        (lambda s: s.judge(0.1, [Final("a")], "L"), "A"),
        (lambda s: codegen.objective(s, 0.1, Final("A"), "l"), "L"),
        (lambda s: codegen.fit(s, [0.1], {"A": [0.9]}, "l"), "L"),
        (lambda s: s.simulate(0.1, sensitivities="L").derivative("A", "l"), "L"),
        (lambda s: s.simulate(0.1)["a"], "A"),
        (lambda s: s.simulate(0.1)["Q.crank"], "q.crank"),
        (lambda s: s.simulate(0.1)["Crank"], "q.crank' or 'u.crank"),
    ],
)
def test_names_in_other_case_are_suggested_everywhere(press, call, hint):
    with pytest.raises((ValueError, KeyError)) as caught:
        call(press)
    assert str(caught.value).endswith(f"; did you mean {hint!r}?".replace('"', "'"))


@pytest.mark.parametrize(
    "call",
    [
        lambda s: codegen.objective(s, 0.1, Final("A"), "L"),
        lambda s: codegen.fit(s, [0.1], {"A": [0.9]}, "L"),
        lambda s: codegen.simulate_many(s, 0.1, p={"L": [0.8, 0.9]}),
        lambda s: codegen.sweep(s, {"L": [0.8, 0.9]}, lambda solver, case: {"x": 1.0}),
    ],
)
def test_objects_in_place_of_a_solver_are_refused(call):
    with pytest.raises(TypeError, match=r"^expected a solver, as ordernm\.load returns it, not a Model"):
        call(codegen.parse_model(PRESS))


def test_objectives_count_their_nouns(press):
    found = codegen.objective(press, 0.1, Final("A"), "L")
    assert "1 variable, 1 functional, " in repr(found) and "0 motions run" in repr(found)
    found(np.array([0.9]))
    assert "  1 motion run, " in repr(found)


def test_loading_a_solver_does_not_import_what_only_errors_need():
    program = "import sys, codegen.runtime.standalone.calls.arguments; print('difflib' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout == "False\n"
