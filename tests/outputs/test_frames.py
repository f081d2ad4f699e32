"""Frames of bodies and points in them at run time: against outputs of a second model and the dense engine in many digits.

`declared` makes an output of every number that `frames` and `points` give; the engine's derivatives of angular velocities
along the motion are angular accelerations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import seeds_of
from measured import TREE
from random_mechanisms import Mechanism, random_mechanism
from random_models import random_seeds, random_state, random_tree, vector

import codegen
from codegen.loops.partition import partition
from codegen.mechanics.structure.world import common_rotation
from codegen.model import parse_model
from codegen.model.model import GROUND, Model, Output, Point
from codegen.reference import DenseEngine

EPS = np.finfo(float).eps
AXES = [vector(*e) for e in np.eye(3).astype(int)]
VECTORS = ("position", "velocity", "acceleration")
TREES = (11, 12)
MECHANISMS = ((5, "spatial"), (1, "planar"))
COMPILED = ((TREES[0], ""), MECHANISMS[1])
"""Those whose C is looked at too."""
PLACE = (0.3, -0.2, 0.15)
"""Of a point in every body."""

SKEW = """
model: askew
gravity: [0, 0, -9.81]
parameters: {a: 0.5, b: 0.9}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: z, ROTATE}, mass: 1, com: [a/2, 0, 0],
          inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  rod: {parent: crank, joint: {type: revolute, axis: z, at: [a, 0, 0]}, mass: 1, com: [b/2, 0, 0],
        inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  rocker: {parent: rod, joint: {type: revolute, axis: z, at: [b, 0, 0]}, mass: 1, com: [0.4, 0, 0],
           inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  block: {parent: ground, joint: {type: fixed, at: [a, 1, 2]}}
loops:
  close: {joint: {type: revolute, axis: z}, from: {body: rocker, at: [0.8, 0, 0]}, to: {body: ground, at: AT, ROTATE}}
points:
  pin: {body: rod, at: [b/2, 0, 0.1]}
  mark: {body: ground, at: [a, 2, 3]}
initial:
  q: {crank: 0.9, rod: -0.6, rocker: -1.8}
"""
"""A four-bar whose bearings stand askew in the world: what is computed has other axes than the ground."""


def askew() -> Model:
    text = SKEW.replace("ROTATE", "rotate: [{axis: x, angle: 0.4}, {axis: y, angle: -0.3}]")
    turned = _rotation(0.4, -0.3) @ [1.0, 0, 0]
    model = parse_model(text.replace("AT", str([float(x) for x in turned])))
    assert common_rotation(model)
    return model


def _rotation(a: float, b: float) -> Any:
    X = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    Y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return X @ Y


def tree(seed: int) -> tuple[Model, tuple[Any, ...]]:
    rng = np.random.default_rng(seed)
    model = with_points(random_tree(rng, 4))
    return model, tuple(random_state(rng, model))


def mechanism(seed: int, scene: str) -> tuple[Model, tuple[Any, ...]]:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, scene, bodies=(3, 4), loops=(1, 2))
    if not isinstance(drawn, Mechanism):
        pytest.skip(f"no mechanism is drawn: {drawn.reason}")
    return with_points(drawn.model), tuple(drawn[1:6])


def with_points(model: Model) -> Model:
    """The model without outputs; one of its named points moves in its body with a parameter."""
    of = model.parameters[0].name if model.parameters else "0.4"
    last = len(model.bodies) - 1
    points = (Point("tip", last, vector("0.1", f"0.3*{of}", f"{of}**2")), Point("stone", GROUND, vector(of, "1", "2")))
    return replace(model, outputs=(), points=points)


def declared(model: Model) -> Model:
    """The same model with an output for every number: of each body frame and an unnamed point, then of the named points."""
    found: list[Output] = []

    def vectors(point: Point) -> None:
        for measure in VECTORS:
            found.extend(Output(f"o{len(found) + i}", measure, (point,), a) for i, a in enumerate(AXES))

    for k in range(len(model.bodies)):
        for entry in (f"{i}{j}" for i in "xyz" for j in "xyz"):
            found.append(Output(f"o{len(found)}", "rotation", bodies=(k, GROUND), choice=(entry,)))
        for a in AXES:
            found.append(Output(f"o{len(found)}", "angular_velocity", axis=a, bodies=(k,), choice=("ground",)))
        vectors(Point("", k, vector(0, 0, 0)))
        vectors(Point("", k, vector(*PLACE)))
    for point in model.points:
        vectors(point)
    return replace(model, outputs=tuple(found))


def numbers(solver: codegen.Solver, state: tuple[Any, ...], **seeds: Any) -> tuple[Any, Any, Any]:
    """The values of the outputs of `declared`, from `frames` and `points`, with derivatives, and angular accelerations."""
    names = list(solver._manifest["bodies"])
    frames = solver.frame_sensitivities(*state, accelerations=True, **seeds)
    placed = [(n, PLACE) for n in names]
    named = [point["name"] for point in solver._manifest.get("points", [])]
    points = solver.point_sensitivities(*state, points=[*placed, *named], accelerations=True, **seeds)
    found = []
    for frame, point in zip(frames, points, strict=True):
        lead = frame.position.shape[:-2]
        three = [getattr(point, v) for v in VECTORS]
        parts = []
        for k in range(len(names)):
            parts += [frame.rotation[..., k, :, :].reshape(*lead, 9), frame.angular_velocity[..., k, :]]
            parts += [getattr(frame, v)[..., k, :] for v in VECTORS]
            parts += [x[..., k, :] for x in three]
        parts += [x[..., len(names) + k, :] for k in range(len(named)) for x in three]
        found.append(np.concatenate(parts, axis=-1))
    return found[0], found[1], frames[0].angular_acceleration


def error(found: Any, expected: Any) -> float:
    """Largest difference of vectors and rows of matrices, relative to the largest vector or to one."""
    a, b = (np.asarray(x, float).reshape(-1, 3) for x in (found, expected))
    return float(np.max(np.linalg.norm(a - b, axis=1)) / max(1.0, float(np.max(np.linalg.norm(b, axis=1)))))


FAST = [*((seed, "") for seed in TREES), *MECHANISMS, (0, "askew")]
LONG = [*((seed, "") for seed in range(20, 40)), *((seed, s) for seed in range(20, 40) for s in ("spatial", "planar"))]


@pytest.fixture(
    params=[*FAST, *(pytest.param(x, marks=pytest.mark.campaign) for x in LONG)],
    ids=lambda x: f"{x[1] or 'tree'}-{x[0]}",
)
def drawn(request: pytest.FixtureRequest) -> Iterator[tuple[Model, tuple[Any, ...]]]:
    seed, scene = request.param
    if scene == "askew":
        yield askew(), ()
    else:
        yield mechanism(seed, scene) if scene else tree(seed)


def test_against_outputs_of_a_second_model_and_the_dense_engine_in_many_digits(
    drawn: tuple[Model, tuple[Any, ...]], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    model, state = drawn
    compiled = request.node.callspec.params["drawn"] in COMPILED
    codegen.generate(
        model, tmp_path / "m", "both" if compiled else "numpy", "kinds", functions=("frames",), compile=False
    )
    for target in ("numpy", "c")[: 1 + compiled]:
        solver = codegen.load(tmp_path / "m", target)
        if not state:
            q, u = solver.assemble({"crank": 0.8}, {"crank": 1.3})
            state = q, u, solver.parameters, np.zeros(0), 0.0
        check(declared(model), state, solver)


def check(model: Model, state: tuple[Any, ...], solver: codegen.Solver) -> None:
    """Check values and derivatives, up to rounding times the loops' condition number."""
    cond = max((ear.condition for ear in partition(model).ears), default=1.0) if model.loops else 1.0
    exact = DenseEngine(model, numbers="mpmath")
    seeds = seeds_of(DenseEngine(model), state, np.random.default_rng(3))
    expected, along = (np.asarray(x) for x in exact.output_sensitivities(*state, **seeds))
    value, tangent, angular = numbers(solver, state, **seeds)
    still = [i for i, o in enumerate(model.outputs) if o.measure != "acceleration"]
    moving = [i for i, o in enumerate(model.outputs) if o.measure == "acceleration"]
    for which, limit in ((still, 1e-13 * cond), (moving, 1e-12 * cond**2)):
        assert error(value[which], expected[which]) < limit
        for d in range(3):
            assert error(tangent[d, which], along[d, which]) < limit
    # what no output gives: the rate of the angular velocity along the motion
    qdot, udot = exact.coordinate_rates(*state), exact.accelerations(*state)
    _, rates = exact.output_sensitivities(*state, dq=[qdot], du=[udot], dt=[1.0])
    turning = [i for i, o in enumerate(model.outputs) if o.measure == "angular_velocity"]
    assert error(angular, np.asarray(rates)[0, turning]) < 1e-12 * cond**2
    single = solver.frames(*state, accelerations=True)
    again = numbers(solver, state, **seeds)[0]
    assert np.array_equal(value, again) and single.acceleration is not None
    assert np.array_equal(single.rotation[0].ravel(), value[:9])


def test_against_generated_outputs(tmp_path: Path) -> None:
    """The same numbers, from the same sweeps, of the same model with outputs; a few roundings apart."""
    model, state = tree(TREES[1])
    made = codegen.generate(
        declared(model), tmp_path / "m", "numpy", "kinds", frames=True, functions=("outputs", "output_sensitivities")
    )
    solver = codegen.load(made.folder, "numpy")
    seeds = random_seeds(np.random.default_rng(1), model, 2)
    values, tangents, _ = numbers(solver, state, **seeds)
    expected, along = solver.output_sensitivities(*state, **seeds)
    assert error(values, expected) < 1e-14
    assert error(tangents, along) < 1e-14


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    """The solver of the tree in which bodies lie in their links in every possible way, with points."""
    return codegen.load(
        codegen.generate(parse_model(WITH_POINTS), tmp_path_factory.mktemp("tree"), "numpy", frames=True).folder
    )


EXAMPLES = Path(__file__).parents[2] / "examples"
WITH_POINTS = TREE.replace("outputs:\n", "")


def state_of(solver: codegen.Solver, seed: int = 1, batch: tuple[int, ...] = ()) -> tuple[Any, ...]:
    rng = np.random.default_rng(seed)
    sizes = solver.nq, solver.nu, solver.np, solver.ninputs
    q, u, p, inputs = (rng.uniform(-1, 1, (*batch, n)) for n in sizes)
    return q, u, solver.parameters * (1 + 0.1 * p), inputs, 0.3


def test_geometric_jacobians_times_speeds_are_velocities(solver: codegen.Solver) -> None:
    q, u, p, inputs, t = state_of(solver, batch=(2, 3))
    frames, J = solver.frames(q, u, p, inputs, t), solver.frame_jacobians(q, u, p)
    assert J.shape == (2, 3, 6, 6, solver.nu)
    found = np.einsum("...nij,...j->...ni", J, u)
    assert error(found, np.concatenate([frames.angular_velocity, frames.velocity], axis=-1)) < 1e-14
    asked = ["tip", "rim", ("hand", PLACE), "hull", ("ground", PLACE)]
    points, J = solver.points(q, u, p, points=asked), solver.point_jacobians(q, u, p, points=asked)
    found = np.einsum("...nij,...j->...ni", J, u)
    assert error(found[..., 3:], points.velocity) < 1e-14
    assert error(found[..., 0, :3], solver.frames(q, u, p, bodies="ring").angular_velocity) < 1e-14
    assert not np.any(points.velocity[..., 4, :]) and np.array_equal(points.position[0, 0, 4], PLACE)


def test_jacobians_of_loops_are_by_the_independent_speeds(tmp_path: Path) -> None:
    found = codegen.load(codegen.generate(askew(), tmp_path / "m", "numpy", functions=("frames",)).folder)
    q, u = found.assemble({"crank": 0.8}, {"crank": 1.3})
    J = found.frame_jacobians(q)
    frames = found.frames(q, {"crank": 1.3})  # dependent speeds follow
    assert error(J @ u, np.concatenate([frames.angular_velocity, frames.velocity], axis=-1)) < 1e-14
    dependent = [n not in found.independent_speed_names for n in found.speed_names]
    assert sum(dependent) == 2 and not J[..., dependent].any()
    assert error(found.point_jacobians(q, points="pin")[3:] @ u, found.points(q, u, points="pin").velocity) < 1e-14


def test_frames_alone_several_and_in_batches(solver: codegen.Solver) -> None:
    """Shapes, the order that was asked for, and directions first."""
    q, u, p, inputs, t = state_of(solver, batch=(4,))
    every = solver.frames(q, u, p, inputs, t, accelerations=True)
    assert every.names == ("stand", "arm", "hand", "ring", "hull", "wheel")
    some = solver.frames(q, u, p, inputs, t, bodies=["wheel", "arm"])
    one = solver.frames(q[1], u[1], p[1], inputs[1], t, bodies="wheel", accelerations=True)
    assert some.rotation.shape == (4, 2, 3, 3) and one.rotation.shape == (3, 3) and some.acceleration is None
    for of in fields(every)[1:]:
        x = getattr(every, of.name)
        assert np.array_equal(x[1, 5], getattr(one, of.name)), of.name
        if (y := getattr(some, of.name)) is not None:
            assert np.array_equal(x[:, [5, 1]], y)
    dp = np.eye(solver.np)[:, None]
    values, along = solver.frame_sensitivities(q, u, p, inputs, t, dp=dp, bodies=["wheel", "arm"])
    assert np.array_equal(values.position, some.position) and along.rotation.shape == (3, 4, 2, 3, 3)
    points, moved = solver.point_sensitivities(q[0], p=p[0], dp={"length": 1.0}, points="tip")
    assert points.position.shape == (3,) and moved.position.shape == (1, 3) and points.velocity.any() == 0
    assert (
        error(solver.frames(q[0]).position, solver.frames(q[0], np.zeros(solver.nu), solver.parameters).position) == 0
    )
    model = solver.points(q[0])
    assert model.names == ("tip", "rim")
    assert solver.frames(q, bodies=[]).rotation.shape == (4, 0, 3, 3) and solver.points(
        q, points=[]
    ).velocity.shape == (4, 0, 3)
    ground = solver.points(q, points="ground", accelerations=True)
    assert ground.position.shape == (4, 3) and not ground.position.any() and not ground.acceleration.any()
    driven = solver.frame_sensitivities(q, u, p, inputs, t, dinputs=np.ones(1), bodies="arm", accelerations=True)[1]
    assert not driven.velocity.any() and driven.angular_acceleration.any(axis=-1).all()


@pytest.mark.parametrize("batch", [(), (3,), (200,)])
def test_points_in_c_are_those_from_frames(solver: codegen.Solver, batch: tuple[int, ...]) -> None:
    """Without accelerations the C gives points of one state and of a few; with them they are made of frames, in NumPy."""
    q, u, p, inputs, t = state_of(solver, batch=batch)
    rng = np.random.default_rng(5)
    for count, chosen in (
        (1, ["tip", "ground", ("ring", [0.1, -0.2, 0.3]), "rim", ("ground", np.ones(3))]),
        (3, "tip"),
        (9, "hand"),
    ):
        seeds = {
            f"d{n}": rng.normal(size=(count, *(1,) * len(batch), k))
            for n, k in (("q", solver.nq), ("u", solver.nu), ("p", solver.np))
        }
        for given in (seeds, {"dp": seeds["dp"]}, {"du": seeds["du"]}):
            found = solver.point_sensitivities(q, u, p, inputs, t, points=chosen, **given)
            made = solver.point_sensitivities(q, u, p, inputs, t, points=chosen, accelerations=True, **given)
            alone = solver.points(q, u, p, inputs, t, points=chosen)
            for a, b in zip((*found, alone), (*made, made[0]), strict=True):
                assert (
                    a.names == b.names and a.position.shape == b.position.shape and a.velocity.shape == b.velocity.shape
                )
                np.testing.assert_allclose(a.position, b.position, rtol=1e-13, atol=1e-13)
                np.testing.assert_allclose(a.velocity, b.velocity, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("states", [1, 2, 3])
def test_directions_that_all_states_share(tmp_path: Path, states: int) -> None:
    """As many directions as states, and one point that parameters move: NumPy has no axes to tell these apart by size."""
    of = codegen.load(
        codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "m", "numpy", functions=("frames",)).folder
    )
    rng = np.random.default_rng(states)
    q, u = of.assemble(of.initial[0] + 0.02 * rng.normal(size=(states, of.nq)), rng.normal(size=(states, of.nu)))
    for count in (1, 2, 3):
        seeds = {"dq": rng.normal(size=(count, of.nq)), "dp": rng.normal(size=(count, of.np))}
        for along in (seeds, {"dp": seeds["dp"]}):
            _, found = of.point_sensitivities(q, u, **along)
            _, apart = of.point_sensitivities(q, u, **{n: d[:, None] for n, d in along.items()})
            assert found.position.shape == apart.position.shape == (count, states, 1, 3)
            for i in range(states):
                _, alone = of.point_sensitivities(q[i], u[i], **along)
                for x in (found, apart):
                    np.testing.assert_allclose(x.position[:, i], alone.position, rtol=1e-14, atol=1e-14)
                    np.testing.assert_allclose(x.velocity[:, i], alone.velocity, rtol=1e-14, atol=1e-14)


def test_a_place_that_depends_on_parameters_counts(solver: codegen.Solver) -> None:
    """The tip is at ``[0.1, length/4, 0.3]``: beside the ring it moves with length, a place that is given does not."""
    q, u, p, _, _ = state_of(solver)
    at = [0.1, p[0] / 4, 0.3]
    tip, along = solver.point_sensitivities(
        q, u, p, points=["tip", ("ring", at)], accelerations=True, dp={"length": 1.0}
    )
    R = solver.frames(q, u, p, bodies="ring").rotation
    assert error(tip.position[0], tip.position[1]) < 1e-15 and error(tip.acceleration[0], tip.acceleration[1]) < 1e-14
    assert error(along.position[0, 0] - along.position[0, 1], R @ [0, 0.25, 0]) < 1e-14


def test_rotations_stay_rotations_along_directions(solver: codegen.Solver) -> None:
    q, u, p, inputs, t = state_of(solver)
    seeds = random_seeds(np.random.default_rng(4), parse_model(WITH_POINTS), 3)
    frames, along = solver.frame_sensitivities(q, u, p, inputs, t, **seeds)
    R, dR = frames.rotation, along.rotation
    assert error(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape)) < 1e-15
    turned = dR @ np.swapaxes(R, -1, -2)
    assert error(turned, -np.swapaxes(turned, -1, -2)) < 1e-14


def test_more_digits(solver: codegen.Solver) -> None:
    q, u, p, inputs, t = state_of(solver)
    exact = solver.in_precision(30)
    for member, asked in (("frames", {}), ("points", {"points": ["tip", ("hand", PLACE), ("ground", PLACE)]})):
        a, b = (getattr(s, member)(q, u, p, inputs, t, accelerations=True, **asked) for s in (solver, exact))
        for of in fields(a)[1:]:
            x, y = getattr(a, of.name), getattr(b, of.name)
            assert y.dtype == object and error(x, y.astype(float)) < 1e-13, of.name
    R = exact.frames(q, u, p, bodies="wheel").rotation
    off = [[sum(a * b for a, b in zip(x, y, strict=True)) - (i == j) for j, y in enumerate(R)] for i, x in enumerate(R)]
    assert max(abs(e) for row in off for e in row) < 1e-28
    assert exact.frame_jacobians(q).dtype == object
    longer = solver.in_precision(30, parse_model(WITH_POINTS)).frames(q, u, p, inputs, t)
    assert error(longer.velocity.astype(float), solver.frames(q, u, p, inputs, t).velocity) < 1e-13


@pytest.mark.parametrize(
    ("member", "asked", "said"),
    [
        ("frames", {"bodies": "rng"}, "bodies: 'rng' is not known.*did you mean 'ring'"),
        ("frames", {"bodies": ["arm", 3]}, "bodies: 3 is not known; expected one of stand, arm"),
        ("points", {"points": "tp"}, "points: 'tp' is not known.*did you mean 'tip'"),
        ("points", {"points": [("rnig", PLACE)]}, "points: 'rnig' is not known.*did you mean 'ring'"),
        ("points", {"points": ("ring", [1, 2])}, r"place in 'ring' has shape \(2,\), expected \(3,\)"),
        ("points", {"points": ("ring", [1, 2, np.nan])}, "expected finite numbers"),
        ("points", {"points": [3.0]}, "3.0 is not a point; expected the name of a point"),
        ("frame_sensitivities", {}, "no seed given"),
        ("frames", {"bodies": 3}, "bodies is 3, expected a name or a list"),
        ("points", {"points": 3}, "points is 3, expected a name or a list"),
    ],
)
def test_errors_teach(solver: codegen.Solver, member: str, asked: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        getattr(solver, member)(solver.initial[0], **asked)


def test_they_are_there_where_they_are_asked_for(tmp_path: Path) -> None:
    """Nothing of them is in a package without; one that has them imports by itself."""
    model = parse_model(WITH_POINTS)
    plain = codegen.generate(model, tmp_path / "plain", "numpy", functions=("accelerations",)).folder
    assert not any("frame" in name for name in (p.name for p in (plain / "_runtime").rglob("*.py")))
    assert "frames" not in (plain / f"{model.name}.c").read_text() + (plain / "model.json").read_text()
    with pytest.raises(AttributeError, match="generated without frames: generate it with --frames"):
        codegen.load(plain).frames(np.zeros(14))
    with pytest.raises(AttributeError, match="--frames"):
        codegen.load(plain).points(np.zeros(14))
    whole = codegen.generate(model, tmp_path / "whole", "numpy", functions="frames", compile=False).folder
    assert {"frames.py", "frame_motion.py"} <= {p.name for p in (whole / "_runtime" / "state").iterdir()}
    monkey = pytest.MonkeyPatch()
    with monkey.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        from whole import Solver  # type: ignore[import-not-found]

        q = Solver().initial[0]
        assert Solver().points(q, points="tip").position.shape == (3,)


def test_code_does_not_grow_with_a_chain(tmp_path: Path) -> None:
    """Equal bodies on links of one kind share the functions of frames; only tables grow."""
    text = """
model: chain
gravity: [0, 0, -9.81]
bodies:
  repeat k in 1..COUNT:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -1]}
      shape: {type: cylinder, axis: z, length: 1, radius: 0.05, mass: 1, center: [0, 0, -0.5]}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
"""
    counts = []
    for n in (40, 80):
        made = codegen.generate(
            parse_model(text.replace("COUNT", str(n))), tmp_path / f"{n}", "numpy", "kinds", functions=("frames",)
        )
        code = (made.folder / "chain.c").read_text()
        functions = code[code.index("frames_of_link_0") :]
        counts.append(
            (code.count("frames_of_link_"), code.count("frame_accelerations_of_link_"), functions.count("\n"))
        )
        assert made.operations["body_frames"]["per_call"]["multiplications"] % n == 0
    assert counts[0][:2] == counts[1][:2] and counts[1][2] - counts[0][2] < 20


def test_against_pinocchio(tmp_path: Path) -> None:
    """Placements, velocities, accelerations and joint Jacobians of a floating tree."""
    pin: Any = pytest.importorskip("pinocchio", reason="Pinocchio is not installed: pip install pin")
    from codegen.measure.pinocchio_models import ours, usual_state

    theirs = pin.Model()
    joints = (pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
              pin.JointModelPY(), pin.JointModelRZ())  # fmt: skip
    for i, (joint, parent) in enumerate(zip(joints, (0, 1, 2, 3, 1), strict=True)):
        turn = pin.rpy.rpyToMatrix(0.3 * i, -0.2 * i, 0.1 * i)
        j = theirs.addJoint(parent, joint, pin.SE3(turn, np.array([0.1 * i, 0.2, -0.3])), f"b{i + 1}")
        inertia = pin.Inertia(1.0 + i, np.array([0.1, -0.05 * i, 0.2]), np.diag([0.1, 0.2, 0.15]))
        theirs.appendBodyToJoint(j, inertia, pin.SE3.Identity())
    model = ours(theirs, "compared")
    made = codegen.generate(model, tmp_path / "m", "numpy", functions=("frames", "accelerations")).folder
    solver, state, data = codegen.load(made), usual_state(theirs), theirs.createData()
    q, u = state.theirs
    a = pin.aba(theirs, data, q, u, np.zeros(theirs.nv))
    pin.forwardKinematics(theirs, data, q, u, a)
    pin.computeJointJacobians(theirs, data, q)
    frames, J = solver.frames(*state.ours, accelerations=True), solver.frame_jacobians(*state.ours)
    place = (0.1, 0.2, -0.3)
    points = solver.points(*state.ours, points=[(n, place) for n in frames.names], accelerations=True)
    J_points = solver.point_jacobians(*state.ours, points=[(n, place) for n in frames.names])
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for k in range(len(frames.names)):
        pose = data.oMi[k + 1]
        v, dv = (f(theirs, data, k + 1, world) for f in (pin.getVelocity, pin.getClassicalAcceleration))
        assert error(frames.rotation[k], pose.rotation) < 1e-14 and error(frames.position[k], pose.translation) < 1e-14
        assert error(frames.angular_velocity[k], v.angular) < 1e-14 and error(frames.velocity[k], v.linear) < 1e-14
        assert error(frames.acceleration[k], dv.linear) < 1e-12
        assert error(frames.angular_acceleration[k], dv.angular) < 1e-12
        jacobian = pin.getJointJacobian(theirs, data, k + 1, world)
        expected = np.zeros_like(J[k])
        expected[:, state.order] = np.concatenate([jacobian[3:], jacobian[:3]])
        assert np.abs(J[k] - expected).max() < 1e-14
        assert error(points.position[k], pose.act(np.array(place))) < 1e-14
        s = pose.rotation @ np.array(place)
        moved = expected[3:] + np.cross(expected[:3], s, axisa=0, axisc=0)
        assert np.abs(J_points[k] - np.concatenate([expected[:3], moved])).max() < 1e-14


def test_prescribed_motion_moves_frames_along_time(tmp_path: Path) -> None:
    """A base that is moved: its place, its velocity and acceleration in closed form, and their derivatives by t and p."""
    model = parse_model("""
model: driven
gravity: [0, 0, -9.81]
parameters: {a: 0.7}
bodies:
  base: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  arm: {parent: base, joint: {type: revolute, axis: y, at: [0, 0, a]}, mass: 1, com: [0, 0, -0.5],
        inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
motion:
  base: 0.3*a*sin(2*t)
""")
    found = codegen.load(codegen.generate(model, tmp_path / "m", "numpy", functions=("frames",)).folder)
    seeds = {"dt": [1.0, 0.0], "dp": [[0.0], [1.0]]}
    base, along = found.frame_sensitivities([0.2], [0.5], t=0.4, bodies="base", accelerations=True, **seeds)
    size, s, c = 0.3 * 0.7, np.sin(0.8), np.cos(0.8)
    x = size * np.array([s, 2 * c, -4 * s, -8 * c])
    for i, name in enumerate(VECTORS):
        assert error(getattr(base, name), [x[i], 0, 0]) < 1e-15
        assert error(getattr(along, name), [[x[i + 1], 0, 0], [x[i] / 0.7, 0, 0]]) < 1e-15
