"""Generated solvers of mechanisms with closed loops: properties other than agreement with the engines."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import compare
from random_models import expression, random_tree, vector

import codegen
from codegen.model import load_model, parse_model
from codegen.model.errors import ModelError
from codegen.model.forces import Spring
from codegen.model.model import GROUND, Model, Point
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine
from codegen.runtime import AssemblyError, SingularForceError, SingularLoopError

EXAMPLES = Path(__file__).parents[2] / "examples"


def example(name: str, **constants: int) -> Model:
    """The text of an example file, with another number for its first constant."""
    text = (EXAMPLES / f"{name}.yaml").read_text()
    for key, value in constants.items():
        assert f"{{{key}: 3," in text
        text = text.replace(f"{{{key}: 3,", f"{{{key}: {value},")
    return parse_model(text)


@cache
def source(name: str, loops: int) -> Any:
    return write_solver(example(name, L=loops), "kinds")


def flops(source: Any, function: str, per: str = "per_call") -> int:
    """All operations of a function; sines and divisions count as one each."""
    operations = source.manifest["operations"]
    return sum(sum(operations[s][per].values()) for s in source.manifest["functions"][function]["sweeps"])


@pytest.mark.parametrize(("name", "most", "direction"), [("ladder", 125, 1.2), ("hooke_ladder", 700, None)])
def test_operations_of_ladders(name: str, most: int, direction: float | None) -> None:
    """Per body, in the limit of many loops: what one loop more costs, of two bodies."""
    short, long = source(name, 6), source(name, 12)
    more = (flops(long, "accelerations") - flops(short, "accelerations")) / 12
    assert more <= most
    assert flops(long, "accelerations") / 25 <= most
    if direction is not None:
        each = (flops(long, "sensitivities", "per_direction") - flops(short, "sensitivities", "per_direction")) / 12
        assert each <= direction * more


def test_a_long_ladder_has_the_kinds_of_a_short_one() -> None:
    short, long = source("ladder", 6), source("ladder", 12)
    assert len(short.system.unit_kinds) == len(long.system.unit_kinds) <= 6
    assert short.files["ladder.c"].count("\nstatic void") == long.files["ladder.c"].count("\nstatic void")


def test_a_tree_has_nothing_of_loops() -> None:
    text = write_solver(load_model(EXAMPLES / "double_pendulum.yaml")).files["double_pendulum.c"]
    for word in ("closure", "complete", "region", "ears", "given_u", "spring", "reaction"):
        assert word not in text


def test_andrews_starts_as_published(tmp_path: Path) -> None:
    """IVP Test Set, andrews: initial accelerations with all digits printed there; recomputed values beside them agree."""
    codegen.generate(EXAMPLES / "andrews.yaml", tmp_path / "andrews", functions=("accelerations",))
    solver = codegen.load(tmp_path / "andrews")
    udot = solver.accelerations(*solver.initial)
    assert abs(udot[0] - 14222.4439199541138705911625887) < 2e-9
    assert abs(udot[1] + 10666.8329399655854029433719415) < 2e-9
    assert np.abs(udot[2:]).max() < 1e-10


@pytest.mark.parametrize("seed", range(2))
def test_springs_on_trees(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng([17, seed])
    model = random_tree(rng, 4)
    ends = [GROUND, *range(4)]
    springs = []
    for n in range(2):
        a, b = (int(i) for i in rng.choice(ends, 2, replace=False))
        name = model.parameters[0].name
        points = [Point("", i, vector(*(f"{float(x)!r}*{name}" for x in rng.normal(size=3)))) for i in (a, b)]
        values = [f"{float(k)!r}*(1 + {name})" for k in rng.uniform(0.5, 2, 3)]
        springs.append(Spring(f"s{n}", *points, *map(expression, values)))
    model = dataclasses.replace(model, loads=tuple(springs))
    codegen.generate(model, tmp_path / "tree", target="both", compile="all")
    found = compare(model, codegen.load(tmp_path / "tree"), DenseEngine(model), rng)
    assert max(found.values()) < 1e-10, found


def test_a_lost_rank_is_an_error_that_names_the_loop(tmp_path: Path) -> None:
    model = example("ladder", L=1)
    codegen.generate(model, tmp_path / "ladder", functions=("accelerations", "sensitivities", "energies"))
    flat = np.array([np.pi / 2, -np.pi / 2, -np.pi / 2])
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "ladder", target=target)
        for call in (
            lambda s=solver: s.accelerations(flat, np.ones(3)),
            lambda s=solver: s.sensitivities(flat, np.ones(3), dp=[1.0]),
            lambda s=solver: s.accelerations(np.stack([flat + 0.1, flat]), np.ones(3)),
            lambda s=solver: s.energies(flat, np.ones(3)),
        ):
            with pytest.raises(SingularLoopError, match="loop foot_1 has lost rank"):
                call()
        assert solver.condition(flat) == np.inf


def test_springs_of_one_kind_anywhere(tmp_path: Path) -> None:
    """Neither of the links that springs of one kind join goes up in equal steps: both stand in the table, each for itself."""
    bodies = "".join(
        f"  b{k}: {{parent: {f'b{k - 1}' if k else 'ground'}, joint: {{type: spherical, at: [0, 0, 1]}}, mass: 1, "
        "com: [0.1, 0, 0.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}\n"
        for k in range(7)
    )
    springs = "".join(
        f"  s{i}: {{type: spring, from: {{body: b{a}, at: [0.1, 0.2, 0.3]}}, to: {{body: b{b}, at: [0.4, 0.2, 0.3]}}, "
        f"stiffness: {3 + i}, damping: 1, free_length: 0.2}}\n"
        for i, (a, b) in enumerate(((2, 5), (1, 4), (3, 5), (1, 5), (4, 2)))
    )
    model = parse_model(f"model: m\nbodies:\n{bodies}forces:\n{springs}")
    package = codegen.generate(
        model, tmp_path / "m", layout="kinds", compile=False, functions=("accelerations",)
    ).folder
    rng = np.random.default_rng(1)
    q, u = rng.normal(size=model.nq), rng.normal(size=model.nu)
    udot = codegen.load(package, "numpy").accelerations(q, u)
    np.testing.assert_allclose(udot, DenseEngine(model).accelerations(q, u), rtol=1e-10)


def test_a_spring_without_length_is_an_error_that_names_it(tmp_path: Path) -> None:
    model = parse_model("""
model: pulled
bodies:
  slide: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  band: {type: spring, from: slide, to: ground, stiffness: 10, free_length: 1}
""")
    codegen.generate(model, tmp_path / "pulled", target="both", functions=("accelerations",))
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "pulled", target=target)
        assert abs(solver.accelerations([0.5], [0.0])[0] - 5.0) < 1e-14
        with pytest.raises(SingularForceError, match="spring band: its ends coincide"):
            solver.accelerations([0.0], [0.0])


def test_a_direction_that_opens_a_redundant_condition_is_told(tmp_path: Path) -> None:
    """A foot that moves out of the plane of a planar loop."""
    text = (EXAMPLES / "four_bar.yaml").read_text().replace("at: [base, 0, 0]", "at: [base, off, 0]")
    text = text.replace("parameters:\n", "parameters:\n  off: 0.0\n", 1)
    codegen.generate(parse_model(text), tmp_path / "bent", target="both", compile="all")
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "bent", target=target)
        q, u = solver.initial
        _, opened = solver.closure_sensitivities(q, u, dp=np.eye(solver.np))
        at = solver.parameter_names.index("off")
        assert np.abs(np.delete(opened, at, axis=0)).max() < 1e-14
        assert abs(np.abs(opened[at]).max() - 1.0) < 1e-14  # per characteristic length, 1 m
        with pytest.warns(RuntimeWarning, match="opens the redundant condition bearing.l"):
            solver.assemble_sensitivities(q, u, dp={"off": 1.0})


def test_a_loop_out_of_reach_is_named_with_what_is_left(tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "four_bar", functions=("accelerations",))
    solver = codegen.load(tmp_path / "four_bar")
    p = solver.parameters
    p[list(solver.parameter_names).index("rocker_length")] = 0.05
    with pytest.raises(AssemblyError, match="loop bearing cannot be closed") as caught:
        solver.assemble(p=p)
    assert caught.value.loop == "bearing"
    assert caught.value.residual > 1e-3


def test_assembly_moves_dependents_only(tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "four_bar", functions=("accelerations",))
    solver = codegen.load(tmp_path / "four_bar")
    q0, u0 = solver.initial
    q, u = solver.assemble(q0 + [[0.2], [-0.3]], u0 + [1.0, 5.0, 7.0])
    free = [solver.coordinate_names.index(n) for n in solver.independent_names]
    assert np.array_equal(q[:, free], (q0 + [[0.2], [-0.3]])[:, free])
    assert np.array_equal(u[:, free], np.broadcast_to((u0 + 1.0)[free], (2, 1)))
    assert max(np.abs(x).max() for x in solver.closure(q, u)) < 1e-14
    # given dependent speeds do not matter
    assert np.array_equal(solver.accelerations(q, u), solver.accelerations(q, u + [0.0, 3.0, -4.0]))


def test_dependent_columns_are_exactly_zero(tmp_path: Path) -> None:
    codegen.generate(example("ladder", L=2), tmp_path / "ladder", functions=("jacobians",))
    solver = codegen.load(tmp_path / "ladder")
    J = solver.jacobians(*solver.initial)
    assert not J.q[:, 1:].any() and not J.u[:, 1:].any()
    assert J.q[:, 0].all()


def test_a_solver_changes_its_independents_and_the_state_keeps_its_meaning(tmp_path: Path) -> None:
    """Bricard's mechanism with its second angle independent meets a dead point in every swing: change and go on."""
    model = dataclasses.replace(load_model(EXAMPLES / "bricard.yaml"), independent=("rod_2",))
    functions = ("accelerations", "coordinate_rates", "energies")
    codegen.generate(model, tmp_path / "bricard", partitions=2, functions=functions)
    solver = codegen.load(tmp_path / "bricard")
    assert solver.partitions[0] == ("rod_2",) and len(solver.partitions) == 2
    q, u = solver.initial
    first = solver.accelerations(q, u)
    solver.use_partition(1)
    assert np.abs(solver.accelerations(q, u) - first).max() < 1e-12
    solver.use_partition(0)
    start = float(np.sum(solver.energies(q, u)))
    h, worst, changes, drift = 2e-3, 0.0, 0, 0.0

    def rates(q: Any, u: Any) -> tuple[Any, Any]:
        return solver.coordinate_rates(q, u), solver.accelerations(q, u)

    for _ in range(1000):
        condition = solver.condition(q)
        worst = max(worst, float(condition[0]))
        if condition[solver.partition] > 3 * condition[1 - solver.partition]:
            solver.use_partition(1 - solver.partition)
            changes += 1
        a = rates(q, u)
        b = rates(q + h / 2 * a[0], u + h / 2 * a[1])
        c = rates(q + h / 2 * b[0], u + h / 2 * b[1])
        d = rates(q + h * c[0], u + h * c[1])
        q, u = (x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) for x, k1, k2, k3, k4 in zip((q, u), a, b, c, d, strict=True))
        q, u = solver.assemble(q, u)
        drift = max(drift, abs(float(np.sum(solver.energies(q, u))) - start))
    assert changes > 0 and worst > 50
    assert drift < 1e-7


@pytest.mark.parametrize("name", ["four_bar", "bricard"])
def test_reactions_are_those_of_the_dense_method(tmp_path: Path, name: str) -> None:
    model = load_model(EXAMPLES / f"{name}.yaml")
    codegen.generate(model, tmp_path / name, target="both", reactions=True, functions=("reactions",))
    solver, engine = codegen.load(tmp_path / name), DenseEngine(model)
    q, u = solver.initial
    q, u = solver.assemble(q, u + 0.7)
    joints, loops = solver.reactions(q, u)
    expected = np.asarray(engine.reactions(q, u), dtype=float)
    assert np.abs(loops - expected).max() < 1e-11 * np.abs(expected).max()
    assert joints.shape == (len(model.bodies), 6) and np.isfinite(joints).all()


def test_reactions_of_a_pendulum(tmp_path: Path) -> None:
    """At the lowest point the hinge carries m g + m L w^2."""
    model = parse_model("""
model: pendulum
gravity: [0, 0, -9.81]
bodies:
  bob: {parent: ground, joint: {type: revolute, axis: y}, mass: 2, com: [0, 0, -1.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
""")
    codegen.generate(model, tmp_path / "pendulum", target="both", reactions=True, functions=("reactions",))
    joints, loops = codegen.load(tmp_path / "pendulum").reactions([0.0], [3.0])
    assert loops.shape == (0, 6)
    for target in ("c", "numpy"):
        none = codegen.load(tmp_path / "pendulum", target).reactions(np.zeros((2, 0, 1)), [3.0])
        assert [x.shape for x in none] == [(2, 0, 1, 6), (2, 0, 0, 6)]
    assert np.abs(joints[0] - [0, 0, 0, 0, 0, 2 * 9.81 + 2 * 1.5 * 9.0]).max() < 1e-12


def test_generate_says_what_it_chose(tmp_path: Path) -> None:
    report = codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "four_bar", compile=False)
    text = "\n".join(report.loops)
    for words in (
        "1 loop",
        "2 of 3 speeds are dependent",
        "1 degree of freedom: crank",
        "rank 2 of 5 conditions",
        "redundant",
    ):
        assert words in text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("at: [base, 0, 0]", "at: [9*base, 0, 0]"), "bearing.*cannot be closed"),
        (("independent: [crank]", "independent: [crank, coupler]"), "cannot all be independent"),
    ],
)
def test_mechanisms_that_cannot_be(change: tuple[str, str], words: str) -> None:
    text = (EXAMPLES / "four_bar.yaml").read_text()
    assert change[0] in text
    with pytest.raises(ModelError, match=words):
        write_solver(parse_model(text.replace(*change)))


def test_no_freedom_left() -> None:
    with pytest.raises(ModelError, match="no freedom left"):
        write_solver(
            parse_model("""
model: truss
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, 0.5], inertia: {yy: 1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, 1]}, mass: 1, com: [0, 0, 0.5], inertia: {yy: 1}}
loops:
  foot: {joint: {type: revolute, axis: y}, from: {body: b, at: [0, 0, 1]}, to: {body: ground, at: [1, 0, 0]}}
initial: {q: {a: 0.5, b: 2}}
""")
        )


@pytest.mark.parametrize("name", ["closed_chain", "planar_3rrr", "slider_crank", "stewart"])
def test_examples_agree_with_the_dense_method(tmp_path: Path, name: str) -> None:
    """Among them a cluster of two loops with linear and angular conditions, and characteristic lengths other than one."""
    model = load_model(EXAMPLES / f"{name}.yaml")
    codegen.generate(model, tmp_path / name, target="numpy", functions=("sensitivities",))
    solver, engine = codegen.load(tmp_path / name, target="numpy"), DenseEngine(model)
    rng = np.random.default_rng(3)
    q, u = solver.initial
    q, u = solver.assemble(q, u + 0.5 * rng.normal(size=solver.nu))
    sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
    seeds = {n: rng.uniform(-1, 1, (3, size)) for n, size in sizes.items()}
    inputs = rng.normal(size=solver.ninputs)
    udot, dudot = solver.sensitivities(q, u, None, inputs, **seeds)
    expected, dexpected = engine.sensitivities(q, u, None, inputs, **seeds)
    assert np.abs(udot - expected).max() < 1e-12 * np.abs(expected).max()
    for x, y in zip(dudot, dexpected, strict=True):
        assert np.abs(x - y).max() < 1e-11 * np.abs(y).max()
