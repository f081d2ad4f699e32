"""Coupled coordinates in trees and loops: both engines, reduced dynamics, equivalent joints and loops, and forces."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from comparison import closed_state, completion_errors, error, function_errors, transposes, worst
from coupled_coordinates import coupled_tree, with_couplings
from coupled_models import HEAD, MODELS, chain
from made_once import solvers
from random_mechanisms import Discarded, random_mechanism
from random_models import EVERY, random_seeds

import codegen
from codegen.loops.errors import AssemblyError, PartitionError
from codegen.loops.partition import partition
from codegen.model import parse_model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import AssemblyError as OpenError
from codegen.runtime import SingularLoopError

SPREAD, T = 0.1, 0.6


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return solvers(tmp_path_factory)


def errors(solver: codegen.Solver, engine, state, seeds) -> dict[str, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of parameters that open redundant conditions of a planar loop
        return function_errors(solver, engine, state, seeds) | completion_errors(solver, engine, state, seeds)


@pytest.mark.parametrize("name", MODELS)
def test_every_function_is_that_of_both_engines(made, name: str) -> None:
    model, solver = parse_model(MODELS[name]), made(MODELS[name])
    state = closed_state(solver, 3, SPREAD, T)
    seeds = random_seeds(np.random.default_rng(5), model, 3)
    if "free" in MODELS[name]:  # assembly makes quaternions unit, and their seeds tangent to that
        seeds["dq"][:, :7] = 0
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = errors(solver, engine, state, seeds)
        assert max(found.values()) < 2e-12, (type(engine).__name__, found)
    assert max(transposes(solver, state, np.random.default_rng(7)).values()) < 1e-12
    position, velocity = solver.closure(*state)
    assert max(np.abs(position).max(), np.abs(velocity).max()) < 1e-13


@pytest.mark.parametrize("name", ["geared five-bar on a cart"])
def test_compiled_code_has_the_same_and_more_digits_agree(made, name: str) -> None:
    compiled, solver = made(MODELS[name], "c"), made(MODELS[name])
    state = closed_state(solver, 3, SPREAD, T)
    seeds = random_seeds(np.random.default_rng(5), parse_model(MODELS[name]), 9)
    for x, y in zip(compiled.sensitivities(*state, **seeds), solver.sensitivities(*state, **seeds), strict=True):
        assert error(x, y) < 1e-13
    more = solver.in_precision(30)
    assert error(solver.accelerations(*state), more.accelerations(*state)) < 1e-13


@pytest.mark.parametrize("seed", [3, 4])
def test_random_trees_with_random_couplings_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    check_tree(seed, tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(20, 120))
def test_more_random_trees(tmp_path: Path, seed: int) -> None:
    check_tree(seed, tmp_path)


def check_tree(seed: int, folder: Path) -> None:
    rng = np.random.default_rng(seed)
    joints = EVERY if seed % 2 else ("revolute", "prismatic", "universal")
    drawn = coupled_tree(rng, int(rng.integers(2, 8)), joints, int(rng.integers(1, 4)))
    if drawn is None:
        pytest.skip("nothing to couple, or nothing left to move")
    model, state = drawn
    codegen.generate(model, folder / "tree", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    solver = codegen.load(folder / "tree")
    seeds = random_seeds(rng, model, 3)
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = function_errors(solver, engine, tuple(state), seeds)
        assert max(found.values()) < 1e-11, (type(engine).__name__, found)
    assert max(transposes(solver, tuple(state), rng).values()) < 1e-12


@pytest.mark.parametrize("seed", [1, 6])
def test_random_mechanisms_with_random_couplings_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    check_mechanism(seed, tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(20, 80))
def test_more_random_mechanisms(tmp_path: Path, seed: int) -> None:
    check_mechanism(seed, tmp_path)


def check_mechanism(seed: int, folder: Path) -> None:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(np.random.default_rng(seed), bodies=(4, 6), loops=(1, 2))
    if isinstance(drawn, Discarded):
        pytest.skip(drawn.reason)
    model = with_couplings(rng, drawn.model, drawn.q, drawn.p, int(rng.integers(1, 3)))
    try:
        cond = max(ear.condition for ear in partition(model).ears)
    except (PartitionError, AssemblyError) as why:
        pytest.skip(str(why))
    codegen.generate(model, folder / "mechanism", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    solver = codegen.load(folder / "mechanism")
    seeds = random_seeds(rng, model, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all have the same definition of derivatives that open redundant conditions
        for engine in (DenseEngine(model), RecursiveEngine(model)):
            (x, dx), (y, dy) = (of.sensitivities(*drawn[1:], **seeds) for of in (solver, engine))
            assert max(error(x, y), worst(dx, dy)) < max(1e-9, 50 * np.finfo(float).eps * cond**2)
        assert max(transposes(solver, drawn[1:], rng).values()) < 1e-9


@pytest.mark.parametrize("seed", [43, *(pytest.param(n, marks=pytest.mark.campaign) for n in (20, 23))])
def test_derivatives_by_parameters_that_open_conditions_are_those_of_what_is_computed(
    tmp_path: Path, seed: int
) -> None:
    """Couplings share ears with loops here: what a parameter opens is left by all of them together, in every engine."""
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(np.random.default_rng(seed), bodies=(4, 6), loops=(1, 2))
    assert not isinstance(drawn, Discarded)
    model = with_couplings(rng, drawn.model, drawn.q, drawn.p, int(rng.integers(1, 3)))
    assert any(len(ear.loops) > 1 and ear.redundant for ear in partition(model).ears)
    codegen.generate(model, tmp_path / "mechanism", target="numpy")
    solver = codegen.load(tmp_path / "mechanism")
    engines, h = (DenseEngine(model), RecursiveEngine(model)), 1e-5
    p, rest = np.array(drawn.p, dtype=float), drawn[4:]
    q, u = solver.assemble(*drawn[1:])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for dp in np.eye(len(p)):
            ends = []
            for step in (h, -h):
                state = (*solver.assemble(q, u, p + step * dp, *rest), p + step * dp, *rest)
                ends.append(solver.accelerations(*state))
                assert max(error(ends[-1], engine.accelerations(*state)) for engine in engines) < 1e-12
            found = [of.sensitivities(q, u, p, *rest, dp=dp[None])[1][0] for of in (solver, *engines)]
            assert error((ends[0] - ends[1]) / (2 * h), found[0]) < 1e-6
            assert max(error(x, found[0]) for x in found[1:]) < 1e-10


PARALLELOGRAM = """
model: parallelogram
gravity: [0.3, 0, -9.81]
parameters: {l: 0.5, w: 1.0, r: 1.0, c: 0.0}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.1, 0, l/2], inertia: {yy: 0.1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, l]}, mass: 1.2, com: [w/2, 0, 0.1], inertia: {yy: 0.1}}
  c: {parent: ground, joint: {type: revolute, axis: y, at: [w, 0, 0]}, mass: 1.4, com: [0, 0, l/2], inertia: {yy: 0.1}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: b, at: [w, 0, 0]}, to: {body: c, at: [0, 0, l]}}
couplings:
  same: {joint: c, follows: {a: r}, offset: c}
initial: {q: {a: 0.3, b: -0.3, c: 0.3}, u: {a: 2}}
"""
"""Its cranks turn alike whether they are coupled or not."""


def test_a_coupling_that_says_what_loops_say_changes_nothing(made) -> None:
    """Motion and derivatives are those without it, along what keeps it true; what does not is told."""
    model, solver = parse_model(PARALLELOGRAM), made(PARALLELOGRAM)
    without = made(PARALLELOGRAM.replace("couplings:\n  same: {joint: c, follows: {a: r}, offset: c}\n", ""))
    assert solver.independent_names == without.independent_names == ("a",)
    rng = np.random.default_rng(2)
    q, u = solver.assemble([0.7, 0, 0], [1.3, 0, 0])
    seeds = {"dq": rng.normal(size=(3, 3)), "du": rng.normal(size=(3, 3)), "dp": rng.normal(size=(3, 4)) * [1, 1, 0, 0]}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solver.sensitivities(q, u, **seeds)
        for other in (without, DenseEngine(model), RecursiveEngine(model)):
            expected = other.sensitivities(q, u, **seeds)
            assert max(error(found[0], expected[0]), worst(found[1], expected[1])) < 1e-12
    assert np.abs(solver.closure(q, u)[0]).max() < 1e-14
    with pytest.warns(RuntimeWarning, match=r"parameter r opens the redundant condition pin\.l1 by .* per unit"):
        solver.sensitivities(q, u, dp=[0.0, 0.0, 1.0, 0.0])
    with pytest.raises(OpenError, match=r"loop pin cannot be closed: its residual is 0\.00\d+ "):
        solver.assemble(q, u, {"c": 0.01})


@pytest.mark.parametrize("change", ["r: 0.9", "c: 0.1"])
def test_a_coupling_that_contradicts_loops_leaves_no_freedom(change: str) -> None:
    text = PARALLELOGRAM.replace("r: 1.0" if change[0] == "r" else "c: 0.0", change)
    with pytest.raises(PartitionError, match="no freedom left: closing pin, same takes all 3 speeds"):
        partition(parse_model(text))


def test_what_is_wrong_with_a_coupling_is_told_of_a_coupling(made) -> None:
    geared = MODELS["neighbours"] + "independent: [b2]\n"
    for solver in (made(geared), made(geared, "c")):
        q, u, p, inputs, t = closed_state(solver, 3, SPREAD, T)
        with pytest.raises(
            SingularLoopError, match="coupling g has lost rank: its dependent coordinate is multiplied by zero"
        ) as raised:
            solver.accelerations(q, u, {"r": 0.0}, inputs, t)
        assert raised.value.link == "g"
        with pytest.raises(SingularLoopError, match="coupling g has lost rank"):
            solver.assemble(q, u, {"r": 0.0})
        assert "closure of coupling g: condition 1, " in str(solver.diagnose(q, u, p, inputs, t))
    both = made(MODELS["inside a loop, with a hint"])
    assert "closure of loop pin and coupling gear" in str(both.diagnose(*both.initial))
    with pytest.raises(OpenError, match="loop pin cannot be closed"):
        both.assemble(both.initial[0], p={"d": 9.0})
    assert "coupling g cannot be satisfied: its residual is 0.5" in str(OpenError("g", 0.5, coupled=True))


# ---- against something known -----------------------------------------------------------------------------------------


def reduced(tree: codegen.Solver, S: np.ndarray, q, u, p, inputs, t) -> np.ndarray:
    """Accelerations of a tree with speeds u = S s: ``S (S^T M S)^-1 S^T (tau - bias)``."""
    M, bias = tree.mass_matrix(q, p), tree.inverse_dynamics(q, u, np.zeros(tree.nu), p, inputs, t)
    return S @ np.linalg.solve(S.T @ M @ S, -S.T @ bias)


@pytest.mark.parametrize("name", ["neighbours", "over two", "inward", "racks", "far", "differential", "sharing"])
def test_accelerations_are_those_of_the_tree_reduced_by_the_couplings(made, name: str) -> None:
    """The mass matrix and the bias are the tree's own, generated without couplings; the rows of S are the ratios."""
    text = MODELS[name]
    model, solver, tree = parse_model(text), made(text), made(text[: text.index("couplings:")])
    p = np.array([1.3, 0.4, -0.2, 0.7, 0.9])
    q, u = solver.assemble(*closed_state(solver, 11, SPREAD, T)[:2], p)
    at = dict(zip(model.parameter_names, p, strict=True))
    first = [u.start for _, u in model.coordinate_slices]
    rows = np.zeros((len(model.loops), model.nu))
    for row, loop in zip(rows, model.loops, strict=True):
        for term in loop.terms:
            row[first[term.body] + term.index] = term.factor.evaluate(at)
    S = np.linalg.svd(rows)[2][len(rows) :].T
    udot = solver.accelerations(q, u, p)
    assert error(udot, reduced(tree, S, q, u, p, None, 0.0)) < 1e-12
    assert np.abs(rows @ udot).max() < 1e-11
    Y = S @ np.linalg.inv(S[list(partition(model).independent)])
    assert error(solver.mass_matrix(q, p), Y.T @ tree.mass_matrix(q, p) @ Y) < 1e-12


def test_a_coupled_cylindrical_joint_is_a_screw(made) -> None:
    """With everything that follows from the pitch: derivatives too."""
    coupled = chain("type: revolute, axis: x", "type: cylindrical, axis: [1, 2, 0.5]", "type: revolute, axis: y")
    coupled += "couplings:\n  thread: {joint: b2.1, follows: {b2.2: s*L}}\n"
    screw = coupled[: coupled.index("couplings:")].replace(
        "type: cylindrical, axis: [1, 2, 0.5]", "type: screw, axis: [1, 2, 0.5], pitch: s*L"
    )
    one, other = made(coupled), made(screw)
    rng = np.random.default_rng(2)
    q, u, k = rng.normal(size=3), rng.normal(size=3), 4
    seeds = {n: rng.normal(size=(k, 3)) for n in ("dq", "du")}
    dp = rng.normal(size=(k, other.np))
    at = [0, 2, 3]  # a cylindrical joint slides before it turns

    def spread(x):
        whole = np.zeros((*x.shape[:-1], 4))
        whole[..., at] = x
        return whole

    q4, u4 = one.assemble(spread(q), spread(u))
    udot, dudot = one.sensitivities(q4, u4, dp=dp, **{n: spread(x) for n, x in seeds.items()})
    expected, derivatives = other.sensitivities(q, u, dp=dp, **seeds)
    assert error(udot[at], expected) < 1e-13
    assert worst(dudot[:, at], derivatives) < 1e-13
    assert error(one.jacobians(q4, u4).p[at], other.jacobians(q, u).p) < 1e-13


def test_cranks_geared_one_to_one_are_a_parallelogram(made) -> None:
    """A rod without mass between two equal cranks does what a coupling with ratio 1 does."""
    bodies = HEAD.replace("[0.3, 0, -9.81]", "[0, 0, -9.81]")
    crank = "mass: m, com: [0.3*L, 0, 0.1], inertia: {xx: 0.2, yy: 0.25, zz: 0.3}}\n"
    bodies += "  a: {parent: ground, joint: {type: revolute, axis: y}, " + crank
    bodies += "  b: {parent: ground, joint: {type: revolute, axis: y, at: [1, 0, 0]}, " + crank.replace("m,", "2*m,", 1)
    geared = bodies + "couplings:\n  belt: {joint: b, follows: a}\n"
    rod = bodies + "  rod: {parent: a, joint: {type: revolute, axis: y, at: [L, 0, 0]}}\n"
    rod += "loops:\n  pin: {joint: {type: revolute, axis: y}, from: {body: rod, at: [1, 0, 0]}, to: {body: b, at: [L, 0, 0]}}\n"
    rod += "initial: {q: {a: 0.7, b: 0.7, rod: -0.7}}\nindependent: [a]\n"
    one, other = made(geared), made(rod)
    seeds = {"dp": np.eye(one.np)}
    udot, dudot = one.sensitivities([0.7, 0.7], [1.3, 1.3], **seeds)
    expected, derivatives = other.sensitivities([0.7, 0.7, -0.7], [1.3, 1.3, -1.3], **seeds)
    assert error(udot, expected[:2]) < 1e-13
    assert worst(dudot, derivatives[:, :2]) < 1e-12


def test_the_force_of_a_coupling_is_the_multiplier_of_its_condition(tmp_path: Path) -> None:
    """Given to the tree as joint forces in proportion to the factors it makes the tree move as the coupled one does."""
    for n, name in enumerate(("differential", "geared five-bar on a cart", "over two")):
        model = parse_model(MODELS[name])
        codegen.generate(model, tmp_path / f"train{n}", target="numpy", reactions=True)
        solver = codegen.load(tmp_path / f"train{n}")
        state = closed_state(solver, 3, SPREAD, T)
        _, loops = solver.reactions(*state)
        dense = DenseEngine(model)
        assert error(loops, dense.reactions(*state)) < 1e-12
        place = [x.name for x in model.loops].index("gear" if "five" in name else "g")
        force, coupling = loops[place], model.loops[place]
        assert force[0] != 0 and not force[1:].any()
        if "five" in name:
            continue
        tree = DenseEngine(parse_model(MODELS[name][: MODELS[name].index("couplings:")]))
        udot = solver.accelerations(*state)
        needed = tree.inverse_dynamics(state[0], state[1], udot, *state[2:])
        first = [u.start for _, u in model.coordinate_slices]
        expected = np.zeros(model.nu)
        for term in coupling.terms:
            expected[first[term.body] + term.index] = term.factor.evaluate(model.defaults) * force[0]
        assert error(needed, expected) < 1e-12


def test_models_without_couplings_have_no_trace_of_them(tmp_path: Path) -> None:
    text = MODELS["geared five-bar"]
    plain = text.replace(text[text.index("couplings:") : text.index("forces:")], "")
    codegen.generate(parse_model(plain), tmp_path / "five")
    folder = tmp_path / "five"
    written = "".join(f.read_text() for f in folder.glob("five*.[chp]*")) + (folder / "model.json").read_text()
    assert "coupled" not in written and "gear" not in written
    codegen.generate(parse_model(text), tmp_path / "geared")
    more = "".join(f.read_text() for f in (tmp_path / "geared").glob("five*.[chp]*"))
    assert "coupled" in more
