"""Properties of force elements of every type: shared code of kinds, compiled functions, and messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from comparison import compare, error
from force_elements import TREE, loop_errors, tree_errors, with_elements
from random_models import random_state

import codegen
from codegen import ModelBuilder
from codegen.listing import list_model
from codegen.model import Model, parse_model
from codegen.model.errors import ModelError
from codegen.model.forces import ALONG_LINES, Force, Spring, Torque, Torsion
from codegen.pipeline import write_solver
from codegen.program.block import FieldError
from codegen.reference import DenseEngine

ALL = """
band: {type: spring, from: top, to: tip, stiffness: k, damping: 0.2, free_length: l}
push: {type: force, on: tip, value: [k*position.tip.z, pull*velocity.d.x, position.ground.x - 3*t]}
turn: {type: torque, on: d, value: [k, 0, -velocity.tip.y], axes: body}
coil: {type: torsion, from: ground, to: d, axis: [1, w, 0], stiffness: k, damping: 0.1, free_angle: 0.1*l}
ram: {type: actuator, from: c, to: d, force: pull - position.top.z*position.c.x}
bush: {type: bushing, from: c, to: {body: d, rpy: [0.1, l, 0]}, stiffness: [k, 2, 0], damping: [0.1, 0, l], \
rotational_stiffness: [1, w, 0], rotational_damping: [0, 0, 0.1], preload: [0, k, 0]}
"""
"""Points that an element looks at are on the link that it acts on, on others, and on the ground."""


def test_the_compiled_functions_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(ALL, tmp_path / "m", "c")
    assert max(errors.values()) < 1e-9, errors


def test_the_compiled_functions_on_a_loop(tmp_path: Path) -> None:
    errors = loop_errors(ALL, tmp_path / "m", "c")
    assert max(errors.values()) < 1e-9, errors


def chain(n: int) -> Model:
    """A chain of equal links with elements between any of them; no numbers of the elements increase in equal steps."""
    elements = "".join(
        f"  band_{i}: {{type: spring, from: b_{a}, to: {{body: b_{b}, at: [0.2, {0.1 * i}, 0]}}, stiffness: {3 + i * i}}}\n"
        f"  ram_{i}: {{type: actuator, from: b_{a}, to: b_{b}, "
        f"force: motor*position.b_{c}.x - {i % 3 + 0.5}*velocity.b_{c}.y**2}}\n"
        f"  push_{i}: {{type: force, on: b_{c}, value: [0, 0, {i * i + 0.3}*position.b_{a}.z], axes: body}}\n"
        for i, (a, b, c) in enumerate(((2, 5, 1), (1, 4, 6), (3, 5, 2), (1, 5, 5), (4, 2, 3)))
    )
    return parse_model(f"""
model: alike
gravity: [0, 0, -9.81]
inputs: [motor]
bodies:
  repeat k in 0..{n - 1}:
    b(k): {{parent: b(k-1), joint: {{type: spherical, at: [0, 0, 1]}}, mass: 1, com: [0.1, 0, 0.5],
      inertia: {{xx: 0.1, yy: 0.1, zz: 0.1}}, first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}}}
forces:
{elements}
""")


def test_elements_that_are_alike_share_a_block(tmp_path: Path) -> None:
    model = chain(8)
    source = write_solver(model, "kinds")
    kinds = source.system.element_kinds
    assert len(model.loads) == 15 and len(kinds) < 9
    assert max(len(k.members) for k in kinds) == 5
    package = codegen.generate(model, tmp_path / "m", layout="kinds", compile=False).folder
    found = compare(model, codegen.load(package, "numpy"), DenseEngine(model), np.random.default_rng(1), k=1)
    assert max(found.values()) < 1e-10, found


def test_points_of_repetitions() -> None:
    text = """
model: m
inputs: [motor]
bodies:
  repeat k in 1..3:
    b(k): {parent: b(k-1), joint: {type: revolute, axis: y, at: [0, 0, 1]}, mass: 1, com: [0, 0, 0.5],
      inertia: {xx: 0.1, yy: 0.1, zz: 0.1}, first: {parent: ground, joint: {at: [0, 0, 0]}}}
points:
  repeat k in 1..3:
    tip(k): {body: b(k), at: [0, 0, 1]}
forces:
  repeat k in 2..3:
    push(k): {type: force, on: tip(k), value: [motor*position.tip(k-1).x, 0, velocity.b(k).z]}
"""
    model = parse_model(text)
    assert [tuple(p.name for p in e.measured) for e in model.loads] == [("tip_1", "b_2"), ("tip_2", "b_3")]
    with pytest.raises(ModelError, match=r"unknown point 'tip_0' in position\.tip_0\.x; a point or a body is allowed"):
        parse_model(text.replace("repeat k in 2..3", "repeat k in 1..3"))


def test_what_has_no_value_for_any_state_stops_generation() -> None:
    for force in ("1/position.ground.x", "log(velocity.top.z)", "position.tip.x/(0*t + velocity.ground.y)"):
        model = with_elements(TREE, f"push: {{type: force, on: tip, value: [1, 0, {force}]}}")
        with pytest.raises(ModelError, match=r"forces\.push: its force has no value or no derivative .* for any state"):
            write_solver(model)


def test_energies_ask_for_nothing_that_only_forces_without_energy_read() -> None:
    parts = ALL.strip().splitlines()
    manifest = write_solver(with_elements(TREE, "\n".join(parts))).manifest
    assert manifest["functions"]["energies"]["arguments"] == ["q", "u", "p"]
    assert manifest["elements"] == ["band", "push", "turn", "coil", "ram", "bush"]
    without = write_solver(with_elements(TREE, "\n".join((parts[1], parts[2], parts[4]))))
    assert "element_energy" not in without.program.blocks and "coefficient" not in without.files["pushed.c"]


def test_they_are_listed() -> None:
    lines = [line.strip() for line in list_model(with_elements(TREE, ALL))]
    for line in (
        "spring band: from ground [0.3, 0.2, 1] to b [0.1, l, -0.3]; stiffness k, damping 0.2, free length l",
        "force push: on b [0.1, l, -0.3]; value [k*position.tip.z, pull*velocity.d.x, position.ground.x - 3*t], "
        "in axes of the ground",
        "torque turn: on d; value [k, 0, -velocity.tip.y], in axes of the body",
        "torsion coil: from ground to d about [1, w, 0]; stiffness k, damping 0.1, free angle 0.1*l",
        "actuator ram: from c to d; force pull - position.top.z*position.c.x",
    ):
        assert line in lines, lines


def test_from_python() -> None:
    b = ModelBuilder("m")
    k = b.parameter("k", 2.0)
    b.body("a", parent="ground", joint="revolute", axis="y", mass=1, inertia={"xx": 1, "yy": 1, "zz": 1})
    b.point("tip", "a", (0, 0, 1))
    b.force("push", "force", on="tip", value=(k, "position.tip.x", 0))
    b.force("turn", "torque", on="a", value=(0, k, 0), axes="body")
    b.force("coil", "torsion", start="ground", end="a", axis="y", stiffness=k)
    b.force("ram", "actuator", start="ground", end="tip", force=k)
    b.spring("band", "ground", "tip", k)
    assert [type(e) for e in b.build().loads] == [Force, Torque, Torsion, ALONG_LINES["actuator"], Spring]


def test_what_is_not_finite_is_told_by_its_name(tmp_path: Path) -> None:
    model = with_elements(
        TREE,
        "band: {type: spring, from: top, to: d, stiffness: k}\npush: {type: force, on: tip, value: [1, 0, log(pull)]}",
    )
    solver = codegen.load(codegen.generate(model, tmp_path / "m", compile=False).folder, "numpy")
    q, u, p, _, t = random_state(np.random.default_rng(1), model)
    with pytest.warns(RuntimeWarning, match="the coefficients of force push are not"):
        solver.accelerations(q, u, p, [-1.0], t)
    assert error(solver.accelerations(q, u, p, [1.0], t), DenseEngine(model).accelerations(q, u, p, [1.0], t)) < 1e-12


def test_a_law_that_needs_a_direction_says_when_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    model = with_elements(TREE, "band: {type: spring, from: top, to: tip, stiffness: k, free_length: 1}")
    monkeypatch.setattr(Spring, "singular", "")
    with pytest.raises(FieldError, match=r"Spring\.singular has no message for states without one"):
        write_solver(model)


@pytest.mark.parametrize(
    ("value", "factor"),
    [
        ("2 - position.c.y", 1),
        ("position.c.y + 2", 3),
        ("2 + position.d.y", 1),
        ("1 - position.c.y", 0),
        ("3*position.d.y", -3),
    ],
)
def test_numbers_beside_places_that_are_known(tmp_path: Path, value: str, factor: float) -> None:
    """c and d stay at 1 and -1 across the plane, which the search for zeros knows."""
    model = parse_model(f"""
model: lever
parameters: {{k: 3.0}}
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, inertia: {{xx: 0.1, yy: 0.5, zz: 0.1}}}}
points:
  c: {{body: a, at: [0, 1, 0]}}
  d: {{body: a, at: [0, -1, 0]}}
forces:
  turn: {{type: torque, on: a, value: [0, "k*({value})", 0]}}
outputs: {{h: {{position: c, axis: z}}}}
""")
    codegen.generate(model, tmp_path / "lever", target="numpy")
    solver = codegen.load(tmp_path / "lever")
    udot, dudot = solver.sensitivities([0.3], [0.2], dp=[[1.0]])
    assert udot == pytest.approx([3.0 * factor / 0.5], abs=1e-15)
    assert dudot == pytest.approx(np.array([[factor / 0.5]]), abs=1e-15)
