"""Forces along the line between two points: `type: actuator`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from force_elements import TREE, loop_errors, power, problems, tree_errors, with_elements
from random_models import random_state

import codegen
from codegen.model import parse_model
from codegen.reference import DenseEngine
from codegen.runtime import SingularForceError

RAM = (
    "ram: {type: actuator, from: tip, to: {body: d, at: [0, l, 0]}, "
    "force: k*pull*sin(t) - (position.tip.x - position.d.x)**3 + velocity.tip.z - u.a}"
)
WIRE = "wire: {type: actuator, from: top, to: c, force: -k}"


def test_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(f"{RAM}\n{WIRE}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(f"{RAM}\n{WIRE}", tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_positive_drives_the_ends_apart_as_in_a_sliding_joint() -> None:
    slide = """
model: ram
parameters: {k: 3}
bodies:
  rod: {parent: ground, joint: {type: prismatic, axis: [1, 2, 2]}, mass: 2}
forces:
  f: FORCE
"""
    forces = ("{type: actuator, from: ground, to: rod, force: k}", "{type: joint, joint: rod, value: k}")
    one, other = (DenseEngine(parse_model(slide.replace("FORCE", f))).accelerations([0.7], [0.1]) for f in forces)
    np.testing.assert_allclose(one, other, rtol=1e-14)
    np.testing.assert_allclose(one, [1.5], rtol=1e-14)


def test_momentum_is_left_and_a_spring_is_one_with_its_law() -> None:
    """With the tension of a spring for its force, by positions and velocities of its ends, it is the spring."""
    spring = "s: {type: spring, from: tip, to: d, stiffness: k, damping: 0.4, free_length: l}"
    d = "sqrt((position.tip.x - position.d.x)**2 + (position.tip.y - position.d.y)**2 + (position.tip.z - position.d.z)**2)"
    rate = " + ".join(f"(position.tip.{c} - position.d.{c})*(velocity.tip.{c} - velocity.d.{c})" for c in "xyz")
    ram = f's: {{type: actuator, from: tip, to: d, force: "-k*({d} - l) - 0.4*({rate})/{d}"}}'
    models = [with_elements(TREE, e) for e in (spring, ram)]
    state = random_state(np.random.default_rng(5), models[0])
    found = [power(m, state) for m in models]
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-12)
    assert found[1][1] == 0 and max(f[2] for f in found) < 1e-13
    one, other = (DenseEngine(m).accelerations(*state) for m in models)
    np.testing.assert_allclose(one, other, rtol=1e-12)


def test_virtual_work() -> None:
    """The power is the force times the rate of the distance."""
    model = with_elements(TREE, WIRE)
    q, u, p, inputs, t = state = random_state(np.random.default_rng(7), model)
    engine = DenseEngine(model)
    seen = engine._state(q, u, p, inputs, t)
    motion = engine._motion(seen)
    x, v = (y.value[:, 0] for y in engine._point(motion, 2, seen.pairs.constant(np.zeros((3, 1)))))
    r = x - [0.3, 0.2, 1]
    np.testing.assert_allclose(power(model, state)[0], -p[0] * (r @ v) / np.sqrt(r @ r), rtol=1e-12)


def test_without_length_it_is_an_error_that_names_it(tmp_path: Path) -> None:
    model = parse_model("""
model: m
bodies:
  slide: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  ram: {type: actuator, from: ground, to: slide, force: 2}
""")
    package = codegen.generate(model, tmp_path / "m", compile=False).folder
    with pytest.raises(SingularForceError, match="actuator ram: its ends coincide, so its force has no direction"):
        codegen.load(package, "numpy").accelerations([0.0], [1.0])
    with pytest.raises(ValueError, match="actuator ram: its two points coincide"):
        DenseEngine(model).accelerations([0.0], [1.0])


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        ("{type: actuator, from: tip, to: dd, force: 1}", "to", "unknown point 'dd'; a point or a body*'d'?"),
        (
            "{type: actuator, from: tip, to: b, force: 1}",
            "to",
            "actuator 's' joins 'b' to itself, so it moves nothing; *",
        ),
        (
            "{type: actuator, from: b, to: c, force: 1}",
            "to",
            "actuator 's' joins 'b' to 'c', which the fixed joint of c*",
        ),
        (
            "{type: actuator, from: a, to: tip, force: [1, 2]}",
            "force",
            "a list of 2; a number or an expression is needed",
        ),
        ("{type: actuator, from: a, to: tip, force: position.tip}", "force", "*write position.POINT.x, .y or .z*"),
        ("{type: actuator, from: a, to: tip, force: log(0*position.tip.x)}", "force", "*has no real value"),
        ("{type: actuator, from: a, to: tip, value: 1}", "value", "*did you mean 'force'?"),
        ("{type: actuator, to: tip, force: 1}", "", "key 'from' is missing*"),
    ],
)
def test_what_is_wrong_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"s: {entry}")
    assert found.startswith(f"forces.s{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found
