"""Loops whose redundant conditions hold only nearly, or are opened by parameters: generated code, both engines, messages."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, worst
from random_mechanisms import Discarded, Mechanism, random_mechanism
from random_models import expression, random_seeds, vector

import codegen
from codegen.loops import PartitionError
from codegen.model import Model, ModelError, parse_model
from codegen.model.model import Joint, Parameter
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import SingularLoopError

CRANK = """
model: crank_rocker
gravity: [0, 0, -9.81]
parameters: {{crank: 0.4, coupler: 1.2, off: 0.0}}
inputs: [motor]
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, com: [0.2, 0, 0], inertia: {{xx: 0.001, yy: 0.02, zz: 0.02}}}}
  b: {{parent: a, joint: {{type: revolute, axis: y, at: [crank, {off}, 0], rpy: [{tilt}, 0, 0]}},
      mass: 2, com: [0.6, 0, 0], inertia: {{xx: 0.001, yy: 0.2, zz: 0.2}}}}
  c: {{parent: b, joint: {{type: revolute, axis: y, at: [coupler, 0, 0]}},
      mass: 1.5, com: [0.45, 0, 0], inertia: {{xx: 0.001, yy: 0.1, zz: 0.1}}}}
loops:
  bearing: {{joint: {{{joint}}}, from: {{body: c, at: [0.9, 0, 0]}}, to: {{body: ground, at: [1.1, 0, 0]}}}}
forces:
  drive: {{type: joint, joint: a, value: motor - 0.1*u.b}}
initial:
  q: {{a: -0.8, b: 0.4, c: 1.9}}
  u: {{a: 1.0}}
independent: [a]
"""
SEEDS = {"dq": np.eye(3)[[0, 0, 0, 0]] * [[1], [0], [0], [0]], "du": np.eye(3)[[0, 0, 0, 0]] * [[0], [1], [0], [0]],
         "dp": np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])}  # fmt: skip


def crank(tilt: Any, joint: str = "type: revolute, axis: y", off: str = "0") -> Model:
    return parse_model(CRANK.format(tilt=tilt, joint=joint, off=off))


def built(
    model: Model, folder: Path, target: str = "numpy", functions: tuple[str, ...] | None = None
) -> codegen.Solver:
    codegen.generate(model, folder, target=target, functions=functions)
    return codegen.load(folder, target)


def differences(solver: codegen.Solver, engines: list[Any], state: tuple[Any, ...], seeds: dict[str, Any]) -> float:
    """The largest relative difference of udot, or of its derivatives per direction, to any of the engines."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        udot, dudot = solver.sensitivities(*state, **seeds)
        found = [engine.sensitivities(*state, **seeds) for engine in engines]
    return max(max(error(udot, a), worst(dudot, da)) for a, da in found)


@pytest.mark.parametrize("joint", ["type: revolute, axis: y", "type: point"])
def test_a_nearly_planar_loop_turns_all_the_way_round_and_is_exact_for_what_it_is_taken_for(
    joint: str, tmp_path: Path
) -> None:
    tilt = 1e-5
    asked = ("accelerations", "sensitivities")
    planar, tilted = (
        built(crank(angle, joint), tmp_path / name, functions=asked)
        for name, angle in (("planar", 0), ("tilted", tilt))
    )
    engines = [RecursiveEngine(crank(tilt, joint)), DenseEngine(crank(tilt, joint))]
    q, u = tilted.initial
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for i, angle in enumerate(np.linspace(-0.8, -0.8 + 2 * np.pi, 41)[1:]):
            q, u = tilted.assemble([angle, *q[1:]], u)
            other = planar.assemble(q, u)
            position, velocity = tilted.closure(q, u)
            dropped = np.abs(position) > 1e-13
            assert 0 < dropped.sum() <= len(position) - 2
            assert np.abs(position).max() < 5 * tilt
            assert np.abs(velocity[~dropped]).max() < 1e-14
            udot = tilted.accelerations(q, u, inputs=[0.5])
            assert error(udot, planar.accelerations(*other, inputs=[0.5])) < tilt
            if i % 10 == 0:
                assert differences(tilted, engines, (q, u, None, [0.5]), SEEDS) < 1e-12


def test_angles_of_five_digits_keep_a_loop_planar(tmp_path: Path) -> None:
    """Every hinge stands by 1.5708 or 3.1416, as in models that were exported."""
    text = CRANK.format(tilt="0", joint="type: revolute, axis: z", off="0")
    text = text.replace("joint: {type: revolute, axis: y}", "joint: {type: revolute, axis: z, rpy: [-1.5708, 0, 0]}")
    text = text.replace("axis: y, at: [crank, 0, 0], rpy: [0, 0, 0]", "axis: z, at: [crank, 0, 0], rpy: [3.1416, 0, 0]")
    text = text.replace(
        "type: revolute, axis: y, at: [coupler", "type: revolute, axis: z, rpy: [3.1416, 0, 0], at: [coupler"
    )
    text = text.replace("to: {body: ground, at", "to: {body: ground, rpy: [-1.5708, 0, 0], at")
    text = text.replace("{a: -0.8, b: 0.4, c: 1.9}", "{a: -0.8, b: -0.4, c: -1.9}")
    for a, b in (("inertia: {xx: 0.001, yy: 0.02, zz: 0.02}", "inertia: {zz: 0.02}"),):
        text = text.replace(a, b)
    model = parse_model(text)
    report = codegen.generate(model, tmp_path / "m", target="numpy", check=True)
    assert any("taken as planar: axes agree to" in line for line in report.loops)
    assert max(report.errors.values()) < 1e-11
    solver = codegen.load(tmp_path / "m")
    q, u = solver.initial
    for angle in np.linspace(-0.8, -0.8 + 2 * np.pi, 41)[1:]:
        q, u = solver.assemble([angle, *q[1:]], u)


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_a_parameter_that_opens_a_loop_is_told_alike_everywhere(target: str, tmp_path: Path) -> None:
    model = crank(0, off="off")
    solver = built(model, tmp_path / "m", target)
    q, u = solver.initial
    given = {"dp": np.eye(3)}
    calls = [
        lambda: solver.sensitivities(q, u, **given),
        lambda: solver.jacobians(q, u),
        lambda: solver.assemble_sensitivities(q, u, **given),
        lambda: solver.energy_sensitivities(q, u, **given),
        lambda: solver.coordinate_rate_sensitivities(q, u, **given),
    ]
    for call in calls:
        with pytest.warns(RuntimeWarning) as told:
            call()
        (one,) = told
        assert "parameter off opens the redundant condition bearing.l2 by 1 per unit" in str(one.message)
        assert one.filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solver.sensitivities(q, u, dp={"crank": 1.0})
        solver.sensitivities(q, u, dq=np.eye(3))
        solver.accelerations(q, u)


def test_what_opens_nothing_leaves_no_word_in_the_package(tmp_path: Path) -> None:
    report = codegen.generate(crank(0), tmp_path / "m", target="numpy", compile=False)
    manifest = (report.folder / "model.json").read_text()
    assert not any(word in manifest for word in ("opening", "dropped", "tolerance"))


def opened(mechanism: Mechanism, by: float, rng: np.random.Generator) -> Model:
    """The mechanism with all its joints shifted and tilted in proportion to a new parameter, whose value is `by`."""
    model = mechanism.model
    w = f"({by!r} + w)" if by else "w"

    def part() -> str:
        return f"{w}*{float(rng.uniform(-1, 1))!r}"

    def moved(joint: Joint) -> Joint:
        at = tuple(expression(f"({a}) + {part()}") for a in joint.at)
        tilt = (vector(*map(float, rng.normal(size=3))), expression(part()))
        return dataclasses.replace(joint, at=at, rotation=(tilt, *joint.rotation))

    bodies = tuple(dataclasses.replace(b, joint=moved(b.joint)) for b in model.bodies)
    return dataclasses.replace(model, bodies=bodies, parameters=(*model.parameters, Parameter("w", 0.0)))


def compared(seed: int, scene: str, by: float, folder: Path, loop_joints: tuple[str, ...]) -> float | None:
    """The largest difference at a state of a random mechanism that is opened; None where none is made, or nothing accelerates."""
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, scene, (3, 4), (1, 2), loop_joints=loop_joints, springs=False)
    if isinstance(drawn, Discarded):
        return None
    model = opened(drawn, by, rng)
    try:
        solver = built(model, folder, functions=("sensitivities",))
    except ModelError:
        return None
    engines = [RecursiveEngine(model), DenseEngine(model)]
    seeds = random_seeds(rng, model, 2)
    seeds["dp"][0] *= 0
    seeds["dp"][0, -1] = 1.0
    try:
        q, u = solver.assemble(drawn.q, drawn.u)
        state = (q, u, None, drawn.inputs, drawn.t)
        if not any(np.any(x) for x in engines[0].sensitivities(*state, **seeds)):
            return None  # a wheel that turns on, say: zero but for rounding, of which there is no relative error
        return differences(solver, engines, state, seeds) / max(1.0, solver.condition(q)[0] ** 2 / 1e3)
    except (SingularLoopError, PartitionError):
        return None


PLANAR = ("fixed", "revolute", "prismatic", "universal", "spherical", "cylindrical", "inline")
SPHERICAL = ("fixed", "revolute", "universal", "cylindrical")


@pytest.mark.parametrize("by", [0.0, 1e-6], ids=["opened by a parameter", "open"])
@pytest.mark.parametrize(("scene", "loop_joints"), [("planar", PLANAR), ("spherical", SPHERICAL)])
def test_random_mechanisms_that_open_have_one_answer(
    scene: str, loop_joints: tuple[str, ...], by: float, tmp_path: Path
) -> None:
    found = compared(1, scene, by, tmp_path / "m", loop_joints)
    assert found is not None and found < 1e-12


@pytest.mark.campaign
@pytest.mark.parametrize("by", [0.0, 1e-6], ids=["opened by a parameter", "open"])
@pytest.mark.parametrize(("scene", "loop_joints"), [("planar", PLANAR), ("spherical", SPHERICAL)])
def test_many_random_mechanisms_that_open_have_one_answer(
    scene: str, loop_joints: tuple[str, ...], by: float, tmp_path: Path
) -> None:
    found = [compared(seed, scene, by, tmp_path / str(seed), loop_joints) for seed in range(30)]
    assert sum(x is None for x in found) < 10
    assert max(x for x in found if x is not None) < 1e-11


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_assembly_steps_off_a_guess_where_rank_is_lost(target: str, tmp_path: Path) -> None:
    """All bars in one line: exactly flat, the loop has no rank; with the crank off the line closed states exist."""
    text = CRANK.format(tilt=0, joint="type: revolute, axis: y", off="0").replace("at: [1.1, 0, 0]", "at: [0.7, 0, 0]")
    text = text.replace("{a: -0.8, b: 0.4, c: 1.9}", "{a: 0.5, b: -0.5, c: -2.5}")
    solver = built(parse_model(text), tmp_path / "m", target, ("accelerations",))
    flat = [0.0, 0.0, np.pi]  # 0.4 + 1.2 - 0.9 = 0.7
    assert np.abs(solver.closure(flat, np.zeros(3))[0]).max() < 1e-15
    for a in (0.1, -0.1, 0.02):
        q, u = solver.assemble([a, *flat[1:]], [1.0, 0, 0])
        assert q[0] == a
        assert max(np.abs(x).max() for x in solver.closure(q, u)) < 1e-13
        assert np.array_equal(q, solver.assemble([a, *flat[1:]], [1.0, 0, 0])[0])
    with pytest.raises(SingularLoopError, match="bearing has lost rank"):
        solver.assemble(flat, [1.0, 0, 0])
