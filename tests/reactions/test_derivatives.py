"""Derivatives of reactions: against Newton's and Euler's laws in the dense engine's derivative algebra, and closed forms.

The engine keeps everything in the ground frame, sums over all bodies that a joint carries, and solves for multipliers of all
loops at once: nothing of the sweeps is in it.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import made_once
import mpmath
import numpy as np
import pytest
from comparison import error, seeds_of, worst
from coupled_mechanisms import by_hand
from coupled_models import MODELS
from prescribed_models import bars, with_prescribed_at
from random_mechanisms import Discarded, assemble, random_mechanism
from random_models import random_seeds, random_state, random_tree
from rotor_models import with_rotors

import codegen
from codegen.model import Model, load_model, parse_model
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine
from codegen.runtime import Event

EXAMPLES = Path(__file__).parents[2] / "examples"
CHOSEN = ("reactions", "reaction_sensitivities")


made = partial(made_once.made, target="numpy", functions=CHOSEN, compile="all")


def errors(solver: codegen.Solver, model: Model, state: tuple[Any, ...], seeds: dict[str, Any]) -> dict[str, float]:
    """Errors of values and derivatives, and whether the values equal those of `reactions`."""
    engine = DenseEngine(model)
    joints, loops, djoints, dloops = solver.reaction_sensitivities(*state, **seeds)
    for found, expected in zip((joints, loops), solver.reactions(*state), strict=True):
        np.testing.assert_array_equal(found, expected)
    of_joints, of_joints_along = engine.joint_reaction_sensitivities(*state, **seeds)
    moving = [b.joint.type != "fixed" for b in model.bodies]
    assert np.isnan(djoints[:, np.logical_not(moving)]).all() and np.isfinite(djoints[:, moving]).all()
    found = {
        "joints": error(joints[moving], of_joints[moving]),
        "djoints": worst(djoints[:, moving], of_joints_along[:, moving]),
    }
    if model.loops:
        of_loops, of_loops_along = engine.reaction_sensitivities(*state, **seeds)
        found |= {"loops": error(loops, of_loops), "dloops": worst(dloops, of_loops_along)}
    return found


@pytest.mark.parametrize(
    ("seed", "target", "layout"), [(5, "numpy", "kinds"), (8, "both", "kinds"), (4, "numpy", "unrolled")]
)
def test_those_of_random_trees(tmp_path: Path, seed: int, target: str, layout: str) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 7)
    state = tuple(random_state(rng, model))
    solver = made(model, tmp_path / "tree", target=target, layout=layout)
    found = errors(solver, model, state, random_seeds(rng, model, 9))
    assert max(found.values()) < 1e-11, found


@pytest.mark.parametrize(
    ("seed", "scene", "target"),
    [
        (0, "spatial", "numpy"),
        (6, "spatial", "both"),
        (6, "planar", "numpy"),
        (9, "planar", "numpy"),
        (3, "spherical", "numpy"),
    ],
)
def test_those_of_random_mechanisms(tmp_path: Path, seed: int, scene: str, target: str) -> None:
    """Planar and spherical ones have redundant conditions: the shortest multipliers, on either way."""
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, scene=scene)
    assert not isinstance(drawn, Discarded)
    model, state = drawn.model, tuple(drawn[1:])
    solver = made(model, tmp_path / "mechanism", target=target)
    found = errors(solver, model, state, seeds_of(DenseEngine(model), state, rng))
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize(
    ("seed", "scene", "target"), [(0, "spatial", "numpy"), (6, "spatial", "both"), (6, "planar", "numpy")]
)
def test_those_of_mechanisms_with_rotors(tmp_path: Path, seed: int, scene: str, target: str) -> None:
    """A joint transmits less by what the rotor that turns with it takes, and that changes with all of udot."""
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, scene=scene)
    assert not isinstance(drawn, Discarded)
    model, state = with_rotors(rng, drawn.model), tuple(drawn[1:])
    solver = made(model, tmp_path / "mechanism", target=target)
    found = errors(solver, model, state, seeds_of(DenseEngine(model), state, rng))
    assert max(found.values()) < 1e-10, found


def test_those_of_trees_with_rotors(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    model = with_rotors(rng, random_tree(rng, 7))
    state = tuple(random_state(rng, model))
    found = errors(made(model, tmp_path / "tree", target="both"), model, state, random_seeds(rng, model, 9))
    assert max(found.values()) < 1e-11, found


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(100, 160))
def test_those_of_many_mechanisms(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng)
    if isinstance(drawn, Discarded):
        pytest.skip(drawn.reason)
    model, state = drawn.model, tuple(drawn[1:])
    solver = made(model, tmp_path / "mechanism", layout=("kinds", "unrolled")[seed % 2])
    found = errors(solver, model, state, seeds_of(DenseEngine(model), state, rng))
    assert max(found.values()) < 1e-8, found


@pytest.mark.parametrize("name", ["differential", "geared five-bar on a cart"])
def test_those_of_couplings(tmp_path: Path, name: str) -> None:
    model = parse_model(MODELS[name])
    solver, rng = made(model, tmp_path / "train"), np.random.default_rng(4)
    q, u = solver.initial
    q, u = solver.assemble(q + 0.1 * rng.normal(size=solver.nq), rng.normal(size=solver.nu), t=0.6)
    state = (q, u, None, rng.normal(size=solver.ninputs), 0.6)
    found = errors(solver, model, state, random_seeds(rng, model, 3))
    assert max(found.values()) < 1e-11, found


@pytest.mark.parametrize("name", ["chain_on_four_bar", "platform", "tip_slides_on_own_link", "sprung_tips"])
def test_those_of_loops_that_hang_together(tmp_path: Path, name: str) -> None:
    """Ears that start from several links and from each other, joints that slide."""
    drawn, rng = by_hand(name), np.random.default_rng(1)
    model, state = drawn.model, tuple(drawn[1:])
    solver = made(model, tmp_path / "mechanism")
    found = errors(solver, model, state, seeds_of(DenseEngine(model), state, rng))
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize("frame", ["cart", "ground"])
def test_those_of_a_driven_crank(tmp_path: Path, frame: str) -> None:
    """What drives it is in the reaction of its joint, with its derivatives by time; on the ground all motion is prescribed."""
    model = bars(frame, frame == "cart")
    solver, rng = made(model, tmp_path / "driven"), np.random.default_rng(2)
    p, t = [1.1, 1.7, 0.4], 0.35
    q, u = solver.assemble(p=p, t=t)
    found = errors(solver, model, (q, u, p, None, t), random_seeds(rng, model, 3))
    assert max(found.values()) < 1e-11, found


def test_those_of_a_mechanism_with_prescribed_coordinates(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    drawn = random_mechanism(np.random.default_rng(4), bodies=(3, 5), loops=(1, 2))
    assert not isinstance(drawn, Discarded)
    drawn = with_prescribed_at(rng, drawn)
    solver = made(drawn.model, tmp_path / "mechanism")
    found = errors(solver, drawn.model, tuple(drawn[1:]), random_seeds(rng, drawn.model, 2))
    assert max(found.values()) < 1e-10, found


PENDULUM = """
model: pendulum
gravity: [0, 0, -9.81]
parameters: {m: 2.0, L: 1.5}
bodies:
  bob: {parent: ground, joint: {type: revolute, axis: y}, mass: m, com: [0, 0, -L],
        inertia: {xx: 0, yy: 0, zz: 0}}
"""


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_a_pendulum_has_its_closed_form(tmp_path: Path, target: str) -> None:
    """The hinge bears the tension ``m (L u^2 + g cos q)`` along the rod, and across it nothing but what gravity leaves."""
    solver = made(parse_model(PENDULUM), tmp_path / "pendulum", target=target)
    m, L, g, q, u = 2.0, 1.5, 9.81, 0.8, 1.3
    joints, loops, djoints, dloops = solver.reaction_sensitivities(
        [q], [u], dp=np.vstack([np.eye(2), np.zeros((2, 2))]), dq=[[0], [0], [1], [0]], du=[[0], [0], [0], [1]]
    )
    assert loops.shape == (0, 6) and dloops.shape == (4, 0, 6)
    along = np.array([np.sin(q), 0, np.cos(q)])  # from the bob to the hinge; a turn about y takes -z to -x
    turned = np.array([np.cos(q), 0, -np.sin(q)])
    tension = m * (L * u**2 + g * np.cos(q))
    np.testing.assert_allclose(joints[0, 3:], tension * along, rtol=1e-14, atol=1e-13)
    expected = [
        tension / m * along,
        m * u**2 * along,
        -m * g * np.sin(q) * along + tension * turned,
        2 * m * L * u * along,
    ]
    np.testing.assert_allclose(djoints[:, 0, 3:], expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(djoints[:, 0, :3], 0, atol=1e-13)


def test_a_bearing_force_along_a_motion_has_a_gradient(tmp_path: Path) -> None:
    """Released at rest the rod pulls ``m g (3 cos q - 2 cos q0)``: at every time, at its peak, in a sum of squares.

    Directions of a motion are seeds of the reactions in its states; those of a crossing are total, its time's change in them.
    """
    text = PENDULUM + "outputs: {angle: {value: q.bob}}\ninitial: {q: {bob: 1.1}}\n"
    folder, chosen = tmp_path / "swing", ("simulate", "reaction_sensitivities")
    codegen.generate(parse_model(text), folder, target="c", functions=chosen)
    solver = codegen.load(folder)
    m, g, start = 2.0, 9.81, 1.1
    times = np.linspace(0, 1.5, 31)
    directions = ("m", "L", "q0.bob")
    run = solver.simulate(times, sensitivities=directions, rtol=1e-12, atol=1e-13, events=Event("angle", stop=False))
    dp = np.eye(3, 2)
    joints, _, djoints, _ = solver.reaction_sensitivities(run.q, run.u, dq=run.dq, du=run.du, dp=dp[:, None])
    q, dq, of_mass, of_start = run.q[:, 0], run.dq[..., 0], np.eye(3)[0], np.eye(3)[2]
    pull = m * g * (3 * np.cos(q) - 2 * np.cos(start))
    dpull = (
        np.outer(of_mass, pull / m) - 3 * m * g * np.sin(q) * dq + np.outer(of_start, 2 * m * g * np.sin(start) + 0 * q)
    )
    force, dforce = joints[:, 0, 3:], djoints[:, :, 0, 3:]
    size = np.linalg.norm(force, axis=-1)
    dsize = np.sum(force * dforce, axis=-1) / size
    np.testing.assert_allclose(size, pull, rtol=1e-9)
    np.testing.assert_allclose(dsize, dpull, rtol=1e-8, atol=1e-8)
    squares = 2 * np.sum((size - 20) * dsize, axis=-1)
    np.testing.assert_allclose(squares, 2 * np.sum((pull - 20) * dpull, axis=-1), rtol=1e-8)

    at = run.events[0]
    joints, _, djoints, _ = solver.reaction_sensitivities(at.q, at.u, dq=at.dq, du=at.du, dp=dp)
    peak, dpeak = joints[0, 5], djoints[:, 0, 5]
    np.testing.assert_allclose(peak, m * g * (3 - 2 * np.cos(start)), rtol=1e-9)
    np.testing.assert_allclose(dpeak, [g * (3 - 2 * np.cos(start)), 0, 2 * m * g * np.sin(start)], rtol=1e-8, atol=1e-8)


def test_bearing_forces_of_a_four_bar_have_fifty_digits_to_agree_with(tmp_path: Path) -> None:
    """By length, mass, coordinate and speed; its conditions are redundant."""
    model = load_model(EXAMPLES / "four_bar.yaml")
    solver = made(model, tmp_path / "bars")
    q, u = solver.assemble(solver.initial[0], solver.initial[1] + 0.7)
    with mpmath.workdps(50):
        engine = DenseEngine(model, numbers="mpmath")
        q = assemble(engine, q, None)
        u = engine.complete(q, u)[0]
        seeds = {"dp": np.vstack([np.eye(solver.np), np.zeros((2, solver.np))])}
        seeds["dq"], seeds["du"] = np.zeros((solver.np + 2, solver.nq)), np.zeros((solver.np + 2, solver.nu))
        seeds["dq"][-2, 0] = seeds["du"][-1, 0] = 1
        _, of_joints = engine.joint_reaction_sensitivities(q, u, **seeds)
        _, of_loops = engine.reaction_sensitivities(q, u, **seeds)
        expected = [np.array(x, dtype=float) for x in (of_joints, of_loops)]
    state = np.array(q, dtype=float), np.array(u, dtype=float)
    _, _, djoints, dloops = solver.reaction_sensitivities(*state, **seeds)
    assert worst(djoints, expected[0]) < 1e-13
    assert worst(dloops, expected[1]) < 1e-13


def test_more_digits_agree_where_a_loop_is_about_to_lose_rank(tmp_path: Path) -> None:
    """A row of parallelograms a thousandth of a radian from lying flat; the joints' reactions have all digits there too."""
    model = load_model(EXAMPLES / "n_four_bar.yaml")
    solver = made(model, tmp_path / "flat")
    lean = np.pi / 2 - 1e-3
    q, u = solver.assemble([(-1) ** i * lean for i in range(solver.nq)], solver.initial[1])
    assert solver.condition(q).max() > 400
    seeds = {"dp": np.eye(solver.np)}
    with mpmath.workdps(40):
        exact = solver.in_precision(40).reaction_sensitivities(q, u, **seeds)
    assert all(x.dtype == object for x in exact)
    for found, digits in zip(solver.reaction_sensitivities(q, u, **seeds), exact, strict=True):
        expected = np.array(digits, dtype=float)
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_parameter_that_opens_a_redundant_condition_is_told(tmp_path: Path) -> None:
    """As it is with accelerations: one pin of a planar loop leaves the plane, the reactions do not know how."""
    text = (EXAMPLES / "four_bar.yaml").read_text(encoding="utf-8")
    place = "to: {body: ground, at: [base, 0, 0]}"
    assert text.count(place) == 1 and text.count("parameters:\n") == 1
    text = text.replace(place, place.replace("0, 0]", "off, 0]")).replace("parameters:\n", "parameters:\n  off: 0\n")
    solver = made(parse_model(text), tmp_path / "bars")
    along = np.eye(solver.np)[[solver.parameter_names.index("off")]]
    with pytest.warns(RuntimeWarning, match="redundant condition"):
        solver.reaction_sensitivities(*solver.initial, dp=along)


def test_states_and_directions_of_a_batch(tmp_path: Path) -> None:
    model = load_model(EXAMPLES / "four_bar.yaml")
    solver = made(model, tmp_path / "bars", target="both")
    q, u = solver.initial
    states = [solver.assemble([angle, *q[1:]], u) for angle in (q[0], q[0] + 0.1, q[0] + 0.2)]
    Q, U = (np.array(x) for x in zip(*states, strict=True))
    seeds = np.eye(solver.np)
    together = solver.reaction_sensitivities(Q, U, dp=seeds[:, None])
    for i, state in enumerate(states):
        alone = solver.reaction_sensitivities(*state, dp=seeds)
        for whole, part in zip(together[:2], alone[:2], strict=True):
            np.testing.assert_allclose(whole[i], part, rtol=1e-12, atol=1e-12)
        for whole, part in zip(together[2:], alone[2:], strict=True):
            np.testing.assert_allclose(whole[:, i], part, rtol=1e-12, atol=1e-12)


def operations(text: str, sizes: tuple[int, ...]) -> list[int]:
    """Operations of `reaction_sensitivities` with one direction, for examples of growing size."""
    found = []
    for n in sizes:
        manifest = write_solver(parse_model(text.format(n)), "kinds", functions=CHOSEN).manifest
        total = 0
        for sweep in manifest["functions"]["reaction_sensitivities"]["sweeps"]:
            total += sum(v for part in manifest["operations"][sweep].values() for v in part.values())
        found.append(total)
    return found


@pytest.mark.parametrize(
    ("example", "size", "sizes"), [("chain", "n: 12", (16, 24, 40)), ("ladder", "L: 3", (8, 12, 20))]
)
def test_operations_grow_with_bodies_and_loops(example: str, size: str, sizes: tuple[int, ...]) -> None:
    """By the same number for as many more: O(n + m)."""
    text = (EXAMPLES / f"{example}.yaml").read_text(encoding="utf-8").replace("{", "{{").replace("}", "}}")
    name = size.partition(":")[0]
    assert text.count(size) == 1
    a, b, c = operations(text.replace(size, f"{name}: {{}}"), sizes)
    assert c - b == 2 * (b - a) > 0


def test_what_is_not_chosen_leaves_no_trace(tmp_path: Path) -> None:
    model = load_model(EXAMPLES / "four_bar.yaml")
    values = write_solver(model, functions=("reactions",))
    assert not any("reaction_in" in text or "reaction_sensitivities" in text for text in values.files.values())
    assert "reaction_sensitivities" not in values.manifest["functions"]
    along = write_solver(model, functions=("reaction_sensitivities",))
    assert "reactions" not in along.manifest["functions"]
    assert not any("reaction" in text for text in write_solver(model).files.values())
    both = write_solver(model, reactions=True).manifest["functions"]
    assert {"reactions", "reaction_sensitivities"} <= both.keys()
    codegen.generate(model, tmp_path / "bars", target="numpy", functions=("reactions",))
    with pytest.raises(
        AttributeError, match=r"without reaction_sensitivities: .*--reactions, or add it to --functions"
    ):
        codegen.load(tmp_path / "bars").reaction_sensitivities([0.0], [0.0])


def test_the_ground_keeps_its_axes_for_them_however_they_are_chosen(tmp_path: Path) -> None:
    """A mechanism askew in the world, chosen by name alone."""
    text = (EXAMPLES / "four_bar.yaml").read_text(encoding="utf-8")
    assert text
    model = parse_model(ASKEW)
    for n, chosen in enumerate((("reactions",), ("reaction_sensitivities",))):
        codegen.generate(model, tmp_path / f"askew{n}", target="numpy", functions=chosen)
        solver = codegen.load(tmp_path / f"askew{n}")
        q, u = solver.initial
        loops = solver.reactions(q, u)[1] if n == 0 else solver.reaction_sensitivities(q, u, dp=[[1.0, 0.0]])[1]
        assert error(loops, DenseEngine(model).reactions(q, u)) < 1e-12


ASKEW = """
model: askew
gravity: [0, 0, -9.81]
parameters: {a: 0.5, b: 0.9}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: z, rotate: [{axis: x, angle: 0.7}]}, mass: 1, com: [a/2, 0, 0],
          inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  rod: {parent: crank, joint: {type: revolute, axis: z, at: [a, 0, 0]}, mass: 1, com: [b/2, 0, 0],
        inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  rocker: {parent: rod, joint: {type: revolute, axis: z, at: [b, 0, 0]}, mass: 1, com: [0.4, 0, 0],
           inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
loops:
  close: {joint: {type: revolute, axis: z}, from: {body: rocker, at: [0.8, 0, 0]},
          to: {body: ground, at: [1, 0, 0], rotate: [{axis: x, angle: 0.7}]}}
initial:
  q: {crank: 0.9, rod: -0.6, rocker: -1.8}
"""
