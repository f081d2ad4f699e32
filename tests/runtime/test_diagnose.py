"""`diagnose`: estimated and actual errors, condition numbers against dense matrices, closed forms, messages."""

from __future__ import annotations

import ctypes
import html
import math
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_once import solvers
from random_mechanisms import Poses, random_mechanism
from random_models import ALL, random_state, random_tree
from rounding_errors import CAMPAIGNS, UNIT, chain, judged

import codegen
from codegen.loops.partition import partition
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import Diagnosis
from codegen.runtime.standalone.trust import rounding
from codegen.runtime.standalone.trust.rounding import can_round, spread

FOUR_BAR = """
model: four_bar
gravity: [0, 0, -9.81]
parameters: {crank: 1.0, coupler: 2.0, rocker: 1.0, base: 2.2}
inputs: [motor]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: -y},
      shape: {type: rod, axis: x, length: crank, density: 2.4, center: [crank/2, 0, 0]}}
  b: {parent: a, joint: {type: revolute, axis: -y, at: [crank, 0, 0]},
      shape: {type: rod, axis: x, length: coupler, density: 2.4, center: [coupler/2, 0, 0]}}
  c: {parent: b, joint: {type: revolute, axis: -y, at: [coupler, 0, 0]},
      shape: {type: rod, axis: x, length: rocker, density: 2.4, center: [rocker/2, 0, 0]}}
loops:
  bearing: {joint: {type: revolute, axis: -y}, from: {body: c, at: [rocker, 0, 0]}, to: {body: ground, at: [base, 0, 0]}}
forces:
  drive: {type: joint, joint: a, value: motor}
initial:
  q: {a: 1.0, b: -0.4, c: -1.9}
independent: [a]
"""

DEAD = math.acos((1.0 + 2.2**2 - 3.0**2) / (2.0 * 2.2))
"""The crank's angle at which coupler and rocker are in one line, where the crank cannot be turned further."""


@pytest.fixture(scope="module")
def solver_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., codegen.Solver]:
    return solvers(tmp_path_factory, ("dynamics", "energy_gradients"))


@pytest.fixture(scope="module")
def four_bar(solver_of: Callable[..., codegen.Solver]) -> codegen.Solver:
    return solver_of(FOUR_BAR)


def at_crank(solver: codegen.Solver, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """An assembled state with a given crank angle, followed from the initial state."""
    q, _ = solver.initial
    for part in np.linspace(q[0], angle, 8):
        q, u = solver.assemble([part, q[1], q[2]], [1.0, 0.0, 0.0])
    return q, u


# --- rounding errors --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_errors_of_a_closed_loop_near_a_dead_point(
    solver_of: Callable[..., codegen.Solver], monkeypatch: pytest.MonkeyPatch, target: str
) -> None:
    """One unit of rounding to a few digits gone; estimates of largest entries within a factor of 30, most single ones too."""
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0 -march=native")
    solver, model = solver_of(FOUR_BAR, target), codegen.parse_model(FOUR_BAR)
    rng = np.random.default_rng(1)
    seeds = {n: rng.uniform(-1, 1, (3, k)) for n, k in (("dq", 3), ("du", 3), ("dp", 4))}
    seeds["dp"][:, 1:] = 0.0  # at fixed lengths: of these the dead point depends on too
    largest, entries = 0.0, []
    for off in (1.0, 1e-5, 1e-11):
        state = (*at_crank(solver, DEAD - off), solver.parameters, [0.3], 0.0)
        for result in judged(f"{off} off", solver, model, state, seeds):
            assert result.right or result.what == "entry", result
            entries += [result.right] * (result.what == "entry")
            largest = max(largest, result.actual)
    assert largest > 1e-12
    assert np.mean(entries) > 0.9  # both roundings may agree by chance: 1 in 90 of the campaign's


def test_errors_of_a_tree(tmp_path: Path) -> None:
    found = list(CAMPAIGNS["trees"](3, tmp_path / "tree", "numpy"))
    assert len(found) >= 12
    wrong = [x for x in found if not x.right]
    assert all(x.what == "entry" and x.actual < x.estimated for x in wrong), wrong
    assert np.mean([x.right for x in found if x.what == "entry"]) > 0.9  # agreement by chance, as above


def test_errors_of_a_coiled_chain_do_not_follow_its_condition(solver_of: Callable[..., codegen.Solver]) -> None:
    model = chain(40, np.full(40, 1 / 40), planar=True, length=1 / 40)
    solver = solver_of(model)
    q, u = np.full(40, np.pi / 8), np.linspace(-1, 1, 40)
    found = solver.diagnose(q, u, derivatives=False)
    assert found.mass is not None
    assert found.mass.condition > 1e5
    assert max(found.udot_error / np.abs(found.udot).max()) < 1e-13
    assert found.dudot.shape == (0, 40)
    assert found.direction_names == ()
    results = judged("coiled", solver, model, (q, u, solver.parameters, [], 0.0), {"dq": np.eye(40)[:1]})
    assert all(x.right for x in results if x.what != "entry")
    assert np.mean([x.right for x in results]) > 0.95


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "count"), [("trees", 100), ("mechanisms", 120), ("chains", 40)])
def test_campaign(tmp_path: Path, capsys: Any, name: str, count: int) -> None:
    """Of random models 95 of 100 estimates are within a factor of 30; how many are is printed."""
    found = [x for seed in range(count) for x in CAMPAIGNS[name](seed, tmp_path / f"m{seed}")]
    with capsys.disabled():
        for case in dict.fromkeys(x.case for x in found):
            for what in ("udot", "derivative"):
                of = [x for x in found if (x.case, x.what) == (case, what)]
                ratios = [x.ratio for x in of]
                print(
                    f"\n{case}, {what}: {sum(x.right for x in of)} of {len(of)} right; estimate over error {min(ratios):.2g} to "
                    f"{max(ratios):.2g}, median {np.median(ratios):.2g}; largest error {max(x.actual for x in of):.1g}",
                    end="",
                )
    assert sum(x.right for x in found) >= 0.95 * len(found)


# --- the mode of rounding ---------------------------------------------------------------------------------------------


def rounding_mode() -> int:
    return int(ctypes.CDLL(None).fegetround())


def test_the_mode_of_rounding_is_as_it_was_whatever_happens(four_bar: codegen.Solver) -> None:
    q, u = four_bar.initial
    four_bar.diagnose(q, u)
    assert rounding_mode() == 0

    def interrupted() -> list[np.ndarray]:
        assert rounding_mode() != 0
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        spread(interrupted, [np.ones(1)])
    assert rounding_mode() == 0
    third = np.float64(1.0) / np.float64(3.0)
    with rounding.rounding("up"):
        mode, above = rounding_mode(), np.float64(1.0) / np.float64(3.0)
        four_bar.diagnose(q, u)
        assert rounding_mode() == mode
    assert above > third
    modes, go = [], threading.Event()

    def other_thread() -> None:
        go.wait()
        modes.append(rounding_mode())

    thread = threading.Thread(target=other_thread)
    thread.start()
    with rounding.rounding("down"):  # which other threads do not
        go.set()
        thread.join()
    assert modes == [0]


def test_an_estimate_is_at_least_a_unit_of_rounding_and_infinite_where_there_is_no_number() -> None:
    (errors,) = spread(lambda: [np.array([1.0, 2.0, np.nan])], [np.array([1.0, 2.0 + 3e-9, 1.0])])
    assert errors[0] == UNIT
    assert errors[1] == pytest.approx(1e-9, rel=1e-6)
    assert errors[2] == np.inf

    def singular() -> list[np.ndarray]:
        raise codegen.runtime.SingularLoopError("bearing")

    assert np.isinf(spread(singular, [np.ones(2)])[0]).all()


def test_where_rounding_cannot_be_directed_no_error_is_made_up(
    four_bar: codegen.Solver, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert can_round()
    can_round.cache_clear()
    monkeypatch.setattr(rounding, "MODES", {})
    try:
        assert not can_round()
        found = four_bar.diagnose(*four_bar.initial)
    finally:
        monkeypatch.undo()
        can_round.cache_clear()
    assert np.isnan(found.udot_error).all()
    assert "rounding errors are not known" in repr(found)
    assert np.array_equal(found.udot, four_bar.diagnose(*four_bar.initial).udot)


# --- conditions -------------------------------------------------------------------------------------------------------


def test_the_condition_of_the_mass_matrix_is_that_of_the_dense_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever function of the package it comes from: its own, or derivatives of the kinetic energy."""
    model = random_tree(np.random.default_rng(5), 4, ALL)
    functions = ("accelerations", "mass_matrix", "energy_sensitivities", "energy_gradients")
    codegen.generate(model, tmp_path / "tree", target="numpy", functions=functions)
    solver, state = codegen.load(tmp_path / "tree"), random_state(np.random.default_rng(6), model)
    M = DenseEngine(model).mass_matrix(state.q, state.p)
    left = 1 / (np.diag(np.linalg.inv(M)) * np.diag(M))
    for way in ("mass_matrix", "energy_sensitivities_transposed", "energy_sensitivities"):
        found = solver.diagnose(*state, derivatives=False).mass
        assert found is not None
        assert found.condition == pytest.approx(np.linalg.cond(M), rel=1e-8)
        assert found.left == pytest.approx(left.min(), rel=1e-8)
        assert found.weakest == model.speed_names[int(np.argmin(left))]
        monkeypatch.delitem(solver._opened.functions, way)
    assert solver.diagnose(*state).mass is None


def test_a_light_link_before_heavy_ones_is_told(solver_of: Callable[..., codegen.Solver]) -> None:
    """Not so where they become lighter outward, though the mass matrix is as ill conditioned there."""
    n, q = 6, np.array([0.5, 0.7, -0.4, 0.9, 0.3, -0.8])
    found = {}
    for name, masses in (("growing", 1000.0 ** np.arange(n)), ("shrinking", 0.001 ** np.arange(n))):
        found[name] = solver_of(chain(n, masses, planar=True)).diagnose(q, np.ones(n))
        assert found[name].mass is not None
        assert found[name].mass.condition > 1e9
    assert found["growing"].mass.left < 1e-9 < found["shrinking"].mass.left
    assert "of its inertia if the other joints are free, and up to 1" in repr(found["growing"])
    assert found["growing"].derivative_digits.min() < 12
    assert found["shrinking"].mass.left > 0.1
    assert found["shrinking"].derivative_digits.min() > 13
    assert "of its inertia" not in repr(found["shrinking"])


@pytest.mark.parametrize("seed", [6])
def test_conditions_of_a_mechanism_are_those_of_dense_matrices(tmp_path: Path, seed: int) -> None:
    """Closures from the dense engine's conditions; the mass matrix of the independent speeds as N^T M N, N their null space."""
    model, q, u, p, inputs, t = random_mechanism(np.random.default_rng(seed), bodies=(3, 5), loops=(1, 2))
    chosen = partition(model)
    codegen.generate(model, tmp_path / "m", target="numpy")
    solver = codegen.load(tmp_path / "m")
    found = solver.diagnose(q, u, p, inputs, t)
    lengths = np.array(chosen.lengths)
    J = Poses(model, q, p).jacobian(model.loops, chosen.lengths)
    places = np.cumsum([0, *(len(rows) for rows in rows_of_loops(model))])
    slides = np.array(model.speed_units) == "m/s"
    for i, L in enumerate(lengths):
        J[places[i] : places[i + 1], slides] *= L
    for ear, of in zip(chosen.ears, found.closures, strict=True):
        rows = np.concatenate([np.arange(places[i], places[i + 1]) for i in ear.loops])
        A = J[np.ix_(rows, ear.dependent)]
        assert of.condition == pytest.approx(measure(A), rel=1e-6)
        sizes = np.linalg.svd(A, compute_uv=False)
        assert of.distance == pytest.approx(sizes[-1] / max(sizes[0], 1.0))
        assert of.loops == tuple(model.loops[i].name for i in ear.loops)
    dependent = [i for ear in chosen.ears for i in ear.dependent]
    independent = [model.speed_names.index(n) for n in solver.independent_speed_names]
    assert found.all_loops is not None
    assert found.all_loops.condition == pytest.approx(measure(J[:, dependent]), rel=1e-6)
    sizes = np.linalg.svd(J, compute_uv=False)
    assert found.distance == pytest.approx(sizes[len(dependent) - 1] / max(sizes[0], 1.0), rel=1e-6)
    N = np.zeros((model.nu, len(independent)))
    N[independent] = np.eye(len(independent))
    N[dependent] = -np.linalg.lstsq(J[:, dependent], J[:, independent], rcond=None)[0]
    M = N.T @ np.asarray(DenseEngine(model)._mass_matrix(DenseEngine(model)._arguments(q, u, p, inputs, t)).value) @ N
    assert found.mass is not None
    assert found.mass.condition == pytest.approx(np.linalg.cond(M), rel=1e-6)


def measure(A: np.ndarray) -> float:
    """The condition number of section 4.7 of the theory page."""
    n = A.shape[1]
    size = max(np.linalg.norm(A), np.sqrt(n)) / n if n > 1 else 1.0
    return max(1.0, float(np.linalg.norm(np.linalg.pinv(A)) * size))


def rows_of_loops(model: codegen.Model) -> list[list[str]]:
    return [[n for n in model.closure_names if n.rpartition(".")[0] == loop.name] for loop in model.loops]


def test_the_distance_to_a_dead_point_is_the_one_of_the_closed_form(four_bar: codegen.Solver) -> None:
    """E has the columns of two levers in a plane, so its singular values are those of a two by two matrix."""
    for off in (0.5, 1e-3, 1e-6):
        q, u = at_crank(four_bar, DEAD - off)
        (found,) = four_bar.diagnose(q, u, derivatives=False).closures
        b, c = q[0] + q[1], q[0] + q[1] + q[2]
        rocker = np.array([np.cos(c), np.sin(c)])
        E = np.stack([2.0 * np.array([np.cos(b), np.sin(b)]) + rocker, rocker], axis=1)
        sizes = np.linalg.svd(E, compute_uv=False)
        assert found.distance == pytest.approx(sizes[1] / sizes[0], rel=1e-6)
        assert found.dependents == ("b", "c")
    assert found.distance < 2e-3  # sin(c - b) goes with the root of what the crank is off
    assert found.weakest == "c"


def test_conditions_are_those_that_the_generated_code_finds(four_bar: codegen.Solver) -> None:
    for off in (0.5, 1e-4):
        q, u = at_crank(four_bar, DEAD - off)
        (found,) = four_bar.diagnose(q, u, derivatives=False).closures
        assert four_bar.condition(q)[0] == pytest.approx(found.condition, rel=1e-7)
        assert found == four_bar.diagnose(q, u).nearest


# --- states, seeds, words ---------------------------------------------------------------------------------------------


def test_what_it_says_near_a_dead_point(four_bar: codegen.Solver) -> None:
    found = four_bar.diagnose(*at_crank(four_bar, DEAD - 1e-10), inputs=[0.3])
    text = repr(found)
    assert text.startswith("Diagnosis: udot: about")
    digits = re.findall(r"(\d+) digits", text)
    assert int(digits[0]) == math.floor(found.digits.min()) < 14
    assert int(digits[1]) == math.floor(found.derivative_digits.min())
    assert re.search(r"closure of loop bearing: condition [\d.e+]+, \de-0[56] from rank loss; worst in c", text)
    assert "a dead point of the chosen independent coordinates; with others it is 0." in text
    assert "--partitions 2" in text
    assert found.distance > 0.05  # the rocker would do
    assert found.argument_error.max() > found.udot_error.max()


def test_what_it_says_of_an_ordinary_state(four_bar: codegen.Solver) -> None:
    found = four_bar.diagnose(*four_bar.initial)
    assert found.failure == ""
    assert found.gap < 1e-12
    assert found.digits.min() > 14
    assert found.nearest == found.closures[0]
    assert "dead point" not in repr(found)
    assert "open by" not in repr(found)
    page = found._repr_html_()
    for line in found.lines():
        assert html.escape(line) in page
    assert "udot.a" in page


def test_a_state_at_which_rank_is_lost_is_a_diagnosis(four_bar: codegen.Solver) -> None:
    """Folded flat: crank and base, coupler and rocker in a line, which closes at other lengths."""
    q, p = [0.0, 0.0, np.pi], {"base": 2.0}
    with pytest.raises(codegen.runtime.SingularLoopError):
        four_bar.accelerations(q, [1.0, 0.0, 0.0], p)
    found = four_bar.diagnose(q, [1.0, 0.0, 0.0], p)
    assert isinstance(found, Diagnosis)
    assert np.isnan(found.udot).all()
    assert np.isinf(found.udot_error).all()
    assert np.all(found.digits == 0.0)
    assert "loop bearing has lost rank" in found.failure
    assert found.closures[0].distance < 1e-15
    assert found.distance < 1e-15
    assert "the mechanism itself is near a singular pose" in repr(found)
    assert found.mass is None


def test_loops_that_are_open_are_told(four_bar: codegen.Solver) -> None:
    q, u = four_bar.initial
    found = four_bar.diagnose(q + [0.0, 0.01, 0.0], u)
    assert found.gap == pytest.approx(np.abs(four_bar.closure(q + [0.0, 0.01, 0.0], u)[0]).max())
    assert f"loops are open by {found.gap:.1g}" in repr(found)


def test_without_seeds_every_independent_entry_is_a_direction(four_bar: codegen.Solver) -> None:
    q, u = four_bar.initial
    found = four_bar.diagnose(q, u, inputs=[0.1])
    assert found.direction_names == ("q.a", "u.a", "p.crank", "p.coupler", "p.rocker", "p.base", "inputs.motor", "t")
    J = four_bar.jacobians(q, u, inputs=[0.1])
    expected = np.vstack([J.q[:, 0], J.u[:, 0], J.p.T, J.inputs.T, J.t])
    assert np.allclose(found.dudot, expected, rtol=1e-13, atol=1e-13)
    assert np.all(found.dudot_error >= UNIT * np.abs(found.dudot))
    along = four_bar.diagnose(q, u, inputs=[0.1], dp={"crank": 1.0}, dq=[1.0, 0.0, 0.0])
    assert along.direction_names == ("direction 1",)
    assert np.allclose(along.dudot[0], expected[0] + expected[2], rtol=1e-12)


def test_what_arguments_do_in_their_last_places(solver_of: Callable[..., codegen.Solver]) -> None:
    """At 1e6 rad an angle is known to 1e-10, the acceleration of that angle to rounding."""
    solver = solver_of(chain(2, [1.0, 0.5], planar=True))
    found = solver.diagnose([1e6, -3e6], [0.1, 0.2])
    assert 1e-11 < found.argument_error.max() / np.abs(found.udot).max() < 1e-7
    assert found.udot_error.max() / np.abs(found.udot).max() < 1e-14
    assert "with rounded arguments, about" in repr(found)
    exact = RecursiveEngine(chain(2, [1.0, 0.5], planar=True)).accelerations([1e6, -3e6], [0.1, 0.2])
    assert np.allclose(found.udot, exact, rtol=1e-13)
    assert np.all(solver.diagnose([0.0, 0.0], [0.0, 0.0]).argument_error < 1e-14)  # zero stays zero


def test_accelerations_beyond_floating_point_numbers_are_told(four_bar: codegen.Solver) -> None:
    q, u = four_bar.initial
    with pytest.warns(RuntimeWarning, match="udot of accelerations is not finite"):
        found = four_bar.diagnose(q, 1e200 * u + [1e200, 0.0, 0.0], derivatives=False)
    assert np.all(found.digits == 0.0)
    assert "udot is not finite" in repr(found)


def test_bad_input_is_refused_as_elsewhere(four_bar: codegen.Solver) -> None:
    q, u = four_bar.initial
    with pytest.raises(ValueError, match=r"a batch of shape \(2,\), expected one state"):
        four_bar.diagnose([q, q], u)
    with pytest.raises(ValueError, match=r"a batch of shape \(3,\), expected one state"):
        four_bar.diagnose(q, u, dp=np.ones((1, 3, 4)))
    with pytest.raises(ValueError, match=r"q has shape \(2,\)"):
        four_bar.diagnose(q[:2], u)
    with pytest.raises(ValueError, match=r"q\[1\] \(b\) is nan"):
        four_bar.diagnose([1.0, np.nan, 0.0], u)
    with pytest.raises(ValueError, match="'cranc' is not known"):
        four_bar.diagnose(q, u, dp={"cranc": 1.0})


def test_packages_of_few_functions(tmp_path: Path) -> None:
    """What a package lacks is left out of the diagnosis; a package without accelerations says how to have it."""
    codegen.generate(codegen.parse_model(FOUR_BAR), tmp_path / "few", target="numpy", functions=("accelerations",))
    few = codegen.load(tmp_path / "few")
    q, u = few.initial
    found = few.diagnose(q, u)
    assert found.mass is None
    assert found.dudot.shape == (0, 3)
    assert found.digits.min() > 14
    assert len(found.closures) == 1
    with pytest.raises(AttributeError, match="without sensitivities"):
        few.diagnose(q, u, dp={"crank": 1.0})
    codegen.generate(codegen.parse_model(FOUR_BAR), tmp_path / "none", target="numpy", functions=("energies",))
    with pytest.raises(AttributeError, match=r"without accelerations, which diagnose needs"):
        codegen.load(tmp_path / "none").diagnose(q, u)
    assert not (tmp_path / "none" / "_runtime" / "trust" / "diagnosis.py").exists()
    assert (tmp_path / "few" / "_runtime" / "trust" / "diagnosis.py").exists()


def test_another_partition_has_its_own_closures(tmp_path: Path) -> None:
    """At the dead point of the crank the second choice of independents is far from any."""
    text = FOUR_BAR.replace("independent: [a]\n", "")
    codegen.generate(codegen.parse_model(text), tmp_path / "two", target="numpy", partitions=2)
    solver = codegen.load(tmp_path / "two")
    distances = []
    q, u = solver.initial
    for k in range(2):
        solver.use_partition(k)
        (c,) = solver.diagnose(q, u, derivatives=False).closures
        assert set(c.dependents).isdisjoint(solver.independent_names)
        distances.append(c.distance)
    assert distances[0] != distances[1]
