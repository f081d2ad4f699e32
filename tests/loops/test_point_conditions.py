"""Loops with conditions on points (distances, surfaces, curves): engines, equivalent models, motions, reactions."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest
from comparison import closed_state, completion_errors, error, function_errors, transposes, worst
from made_once import solvers
from point_condition_models import MODELS, PLANAR
from random_mechanisms import Discarded, Mechanism, Poses, _closed_speeds, random_mechanism
from random_models import expression, random_seeds, vector

import codegen
from codegen.loops.errors import AssemblyError, PartitionError
from codegen.loops.partition import Ear, partition
from codegen.model import parse_model
from codegen.model.binding import bind
from codegen.model.expressions import Expression, combine
from codegen.model.model import GROUND, Face, PointCondition
from codegen.model.parsing import parse
from codegen.model.surfaces import COORDINATES, sphere, with_coordinates
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.ground_frame import placement
from codegen.runtime import Final, SingularLoopError

SLIDER = """
model: slider
gravity: [0, 0, -9.81]
parameters: {m: 1.5, r: 0.4, h: 0.3}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}}
  y: {parent: x, joint: {type: prismatic, axis: y}}
  bead: {parent: y, joint: {type: prismatic, axis: z}, mass: m}
loops:
  wire: LOOP
outputs: {kinetic: kinetic_energy, potential: potential_energy}
initial: {q: {x: 0.4}}
"""
HELIX = SLIDER.replace(
    "LOOP", '{joint: {type: curve, equations: ["x - r*cos(z/h)", "y - r*sin(z/h)"]}, from: ground, to: bead}'
)
SPREAD = 0.03


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return solvers(tmp_path_factory)


@pytest.mark.parametrize("name", MODELS)
def test_every_function_is_that_of_both_engines(made, name: str) -> None:
    model, solver = parse_model(MODELS[name]), made(MODELS[name])
    state = closed_state(solver, 3, SPREAD)
    seeds = random_seeds(np.random.default_rng(5), model, 3)
    if "free" in name:  # assembly makes quaternions unit, and their seeds tangent to that
        seeds["dq"][:, :7] = 0
    if name != "planar rod":  # of the ball
        seeds["dq"][:, -6:-2] = 0
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = function_errors(solver, engine, state, seeds) | completion_errors(solver, engine, state, seeds)
        assert max(found.values()) < 2e-12, (type(engine).__name__, found)
    assert max(transposes(solver, state, np.random.default_rng(7)).values()) < 1e-12
    position, velocity = solver.closure(*state)
    assert max(np.abs(position).max(), np.abs(velocity).max()) < 1e-13


def test_compiled_code_has_the_same_and_more_digits_agree(made) -> None:
    text = MODELS["in space"]
    compiled, solver = made(text, "c"), made(text)
    state = closed_state(solver, 3, SPREAD)
    seeds = random_seeds(np.random.default_rng(5), parse_model(text), 9)
    found, more = solver.sensitivities(*state, **seeds), solver.in_precision(30).sensitivities(*state, **seeds)
    for x, y, z in zip(compiled.sensitivities(*state, **seeds), found, more, strict=True):
        assert error(x, y) < 1e-13
        assert error(y, z) < 1e-12


EQUATIONS = (
    "z - 0.4*x**2 + 0.3*sin(y + a) + 0.2*x*y*z - b*z**3", "x*exp(0.3*y) + a*z**2 - cos(x*z)", "x + 2*y - b*sqrt(4 + z**2)",
    "x**2 + a*y**2 + 2*z**2 + b*x*y",
)  # fmt: skip


def with_point_conditions(rng: np.random.Generator, drawn: Mechanism, count: int) -> Mechanism:
    """A mechanism with distances, surfaces and curves more, which its coordinates meet."""
    model, q, u, p = drawn[:4]
    poses = Poses(model, q, p)
    values = {x.name: float(x.value) for x in model.parameters}
    loops = []
    for i in range(count):
        start, end = (int(x) for x in rng.choice(np.arange(GROUND, len(model.bodies)), 2, replace=False))
        at = [vector(*map(float, x)) for x in rng.uniform(-0.6, 0.6, (2, 3))]
        turn = ((vector(*map(float, rng.normal(size=3))), expression(float(rng.uniform(-2, 2)))),)
        faces = Face(start, at[0], turn), Face(end, at[1], ())
        x_s, x_e = (poses.frames[f.body].point(poses.pairs.vector(f.at))[0].value[0] for f in faces)
        place = (poses.frames[start].R.value @ placement(poses.pairs, turn).value).T @ (x_e - x_s)
        type = str(rng.choice(["distance", "surface", "curve"]))
        if type == "distance":
            name = str(rng.choice(list(values)))
            length = expression(f"{float(np.linalg.norm(place))!r} + 0.3*({name} - {values[name]!r})")
            loops.append(PointCondition(f"c{i}", type, (), *faces, (sphere(length),), length))
            continue
        equations = []
        for text in rng.choice(EQUATIONS, 1 if type == "surface" else 2, replace=False):
            a, b = rng.choice(list(values), 2)
            tree = with_coordinates(parse(str(text).replace("a", a).replace("b", b)).tree)
            equation = bind(Expression(tree), {})
            there = float(equation.evaluate(values | dict(zip(COORDINATES, map(float, place), strict=True))))
            equations.append(Expression(combine("-", equation.tree, expression(there).tree)))
        loops.append(PointCondition(f"c{i}", type, (), *faces, tuple(equations)))
    model = dataclasses.replace(model, loops=(*model.loops, *loops))
    u = _closed_speeds(poses.jacobian(model.loops), u)
    closed = dataclasses.replace(
        model, initial_u=dict(zip(model.speed_names, map(expression, u.tolist()), strict=True))
    )
    return Mechanism(closed, q, u, *drawn[3:])


def mechanism(seed: int) -> tuple[np.random.Generator, Mechanism, tuple[Ear, ...]]:
    """The first draw of a seed that can be closed and moved."""
    for attempt in range(50):
        rng = np.random.default_rng([seed, attempt])
        drawn = random_mechanism(rng, scene="spatial", bodies=(4, 6), loops=(1, 1))
        if isinstance(drawn, Discarded):
            continue
        more = with_point_conditions(rng, drawn, int(rng.integers(1, 4)))
        try:
            ears = partition(more.model).ears
        except (PartitionError, AssemblyError):
            continue
        if sum(ear.rank for ear in ears) < more.model.nu:
            return rng, more, ears
    raise AssertionError(f"seed {seed} draws no mechanism")


def check_mechanism(seed: int, folder: Path) -> None:
    rng, (model, *state), ears = mechanism(seed)
    codegen.generate(
        model, folder / "mechanism", target="numpy", layout=["kinds", "unrolled"][seed % 2], reactions=True
    )
    solver = codegen.load(folder / "mechanism")
    seeds = random_seeds(rng, model, 2)
    bound = max(1e-11, 50 * np.finfo(float).eps * max(ear.condition for ear in ears) ** 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all have the same definition of derivatives that open redundant conditions
        for engine in (DenseEngine(model), RecursiveEngine(model)):
            (x, dx), (y, dy) = (of.sensitivities(*state, **seeds) for of in (solver, engine))
            assert max(error(x, y), worst(dx, dy)) < bound, type(engine).__name__
        assert max(transposes(solver, tuple(state), rng).values()) < 1e-9
        if all(ear.rank == ear.rows for ear in ears):  # else reactions are not unique
            _, forces, _, d_forces = solver.reaction_sensitivities(*state, **seeds)
            of_loops, of_loops_along = DenseEngine(model).reaction_sensitivities(*state, **seeds)
            assert max(error(forces, of_loops), worst(d_forces, of_loops_along)) < bound


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_random_mechanisms_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    check_mechanism(seed, tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(20, 100))
def test_more_random_mechanisms(tmp_path: Path, seed: int) -> None:
    check_mechanism(seed, tmp_path)


def test_a_bead_on_a_helix_falls_evenly(made) -> None:
    """z'' = - g h^2/(r^2 + h^2) on x = r cos(z/h), y = r sin(z/h); and its derivatives after a while."""
    solver, g, r, h, T = made(HELIX, "c"), 9.81, 0.4, 0.3, 0.5
    assert solver.accelerations(*solver.initial)[2] == pytest.approx(-g * h**2 / (r**2 + h**2), rel=1e-14)
    run = solver.simulate([0.0, T], sensitivities=solver.parameter_names, rtol=1e-12, atol=1e-12)
    z = -g * h**2 / (r**2 + h**2) * T**2 / 2
    assert run.q[-1] == pytest.approx([r * np.cos(z / h), r * np.sin(z / h), z], rel=1e-10)
    by = [0.0, -z * 2 * r / (r**2 + h**2), 2 * z / h - z * 2 * h / (r**2 + h**2)]
    assert run.dq[:, -1, 2] == pytest.approx(by, rel=1e-9, abs=1e-11)


SAME = {
    "a distance is a sphere": (
        "{joint: {type: distance, length: r}, from: ground, to: bead}",
        "{joint: {type: surface, equation: 'x**2 + y**2 + z**2 - r**2'}, from: ground, to: bead}",
    ),
    "two planes are a line": (
        "{joint: {type: inline, axis: x}, from: {body: ground, at: [0, 0, h], rpy: [0.1, 0.2, 0.3*h]}, to: bead}",
        "{joint: {type: curve, equations: [y, z]}, from: {body: ground, at: [0, 0, h], rpy: [0.1, 0.2, 0.3*h]}, to: bead}",
    ),
}


@pytest.mark.parametrize("name", SAME)
def test_the_same_condition_said_otherwise(made, name: str) -> None:
    one, other = (made(SLIDER.replace("LOOP", loop)) for loop in SAME[name])
    q, u = one.assemble(one.initial[0] + [0, 0.1, -0.2], [0.3, 0.5, 0.7])
    eye = {"dq": np.eye(3), "du": np.zeros((3, 3)), "dp": np.eye(3)}
    for x, y in zip(one.sensitivities(q, u, **eye), other.sensitivities(q, u, **eye), strict=True):
        assert error(x, y) < 1e-13
    assert error(one.assemble(q + 0.1, u), other.assemble(q + 0.1, u)) < 1e-12


def test_a_distance_is_a_coupler_without_mass(made) -> None:
    """The four-bar with a massless link closed by a hinge."""
    coupler = PLANAR.replace(
        "loops:", "  bar: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, r]}}\nloops:"
    )
    start = coupler.index("  rod: ")
    coupler = coupler[:start] + (
        "  pin: {joint: {type: inline, axis: y}, from: {body: bar, at: [l, 0, 0]}, to: {body: rocker, at: [0, 0, 0.6]}}"
        + coupler[coupler.index("\n", start) :]
    )
    one, other = made(PLANAR), made(coupler)
    q, u = one.assemble(one.initial[0], [1.3, 0.0])
    hinge, end = ([a * np.sin(x), a * np.cos(x)] for a, x in zip((0.4, 0.6), q, strict=True))
    way = np.array([0.6 + end[0] - hinge[0], end[1] - hinge[1]])
    again, v = other.assemble([*q, np.arctan2(-way[1], way[0]) - q[0]], [*u, 0.0])
    assert again[:2] == pytest.approx(q, rel=1e-12)
    eye = np.eye(2)
    (x, dx), (y, dy) = one.sensitivities(q, u, dp=eye), other.sensitivities(again, v, dp=eye)
    assert max(error(x, y[:2]), worst(dx, dy[:, :2])) < 1e-12


@pytest.mark.parametrize(("method", "options"), [
    ("dop853", {"rtol": 1e-11, "atol": 1e-11}), ("radau", {"rtol": 1e-10, "atol": 1e-10}),
])  # fmt: skip
def test_energy_is_kept_and_loops_stay_closed(made, method: str, options: dict) -> None:
    for text in (PLANAR, MODELS["in space"]):
        solver = made(text, "c")
        q, u = solver.assemble(solver.initial[0], 0.5 * np.ones(solver.nu))
        run = solver.simulate(0.3, q=q, u=u, method=method, **options)
        energy = run.outputs[:, 0] + run.outputs[:, 1]
        assert np.ptp(energy) < 1e-8 * np.abs(run.outputs).max()
        closure = [np.abs(np.concatenate(solver.closure(a, b))).max() for a, b in zip(run.q, run.u, strict=True)]
        assert max(closure) < 1e-10


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_gradients_of_a_motion_are_the_same_forward_and_backward(made, integrator: str) -> None:
    solver = made(MODELS["in space"], "c")
    forward, back = (
        solver.judge(
            0.3, Final("kinetic"), wrt=solver.parameter_names, method=way, integrator=integrator, rtol=1e-8, atol=1e-8
        )
        for way in ("forward", "adjoint")
    )
    assert back.values == pytest.approx(forward.values, rel=1e-13)
    assert back.gradients == pytest.approx(forward.gradients, rel=1e-9, abs=1e-9)


def test_reactions_and_their_derivatives(tmp_path: Path) -> None:
    """Along the rod, and along the gradients of the surfaces, as the dense engine's multipliers say; of no power."""
    model = parse_model(MODELS["in space"])
    codegen.generate(model, tmp_path / "out", target="numpy", reactions=True)
    solver, engine = codegen.load(tmp_path / "out"), DenseEngine(model)
    state = closed_state(solver, 4, SPREAD)
    seeds = random_seeds(np.random.default_rng(5), model, 3)
    _, forces, _, d_forces = solver.reaction_sensitivities(*state, **seeds)
    expected, along = engine.reaction_sensitivities(*state, **seeds)
    assert max(error(forces, expected), worst(d_forces, along)) < 1e-12
    assert np.abs(forces[:, :3]).max() < 1e-12 * np.abs(forces).max()  # no torques about the point


def test_a_rod_without_length_and_equations_that_cannot_be_are_told() -> None:
    told = {
        PLANAR.replace("l: 0.7", "l: 0.0"): "no direction",
        HELIX.replace("x - r*cos(z/h)", "abs(x) - r"): "kink",
        HELIX.replace("x - r*cos(z/h)", "r - h"): "none of x, y and z",
        HELIX.replace("x - r*cos(z/h)", "y - r*sin(z/h)"): "both equations are the same",
        HELIX.replace("x - r*cos(z/h)", "x - q.x"): "q.x",
        HELIX.replace("{m: 1.5", "{x: 1, m: 1.5"): "x is a coordinate of the point",
        PLANAR.replace(", length: l", ""): "length",
    }
    for text, words in told.items():
        with pytest.raises(codegen.ModelError) as caught:
            parse_model(text)
        assert words in str(caught.value)


@pytest.mark.parametrize("length", ["1/(r - r)", "rr"])
def test_a_wrong_length_is_reported_once(length: str) -> None:
    text = SLIDER.replace("LOOP", f"{{joint: {{type: distance, length: {length}}}, from: ground, to: bead}}")
    with pytest.raises(codegen.ModelError) as caught:
        parse_model(text)
    assert [p.path for p in caught.value.problems if p.severity == "error"] == ["loops.wire.joint.length"]


def test_where_a_gradient_vanishes_the_loop_has_lost_rank(made) -> None:
    solver = made(SLIDER.replace("LOOP", SAME["a distance is a sphere"][1]))
    with pytest.raises(SingularLoopError, match="wire"):
        solver.accelerations(np.zeros(3), np.zeros(3))
