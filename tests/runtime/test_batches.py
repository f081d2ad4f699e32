"""Batches: several states at once, on threads, with singular states, and assembled together."""

import os
import pickle
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from random_mechanisms import random_mechanisms
from random_models import random_seeds, random_state, random_tree

import codegen
from codegen.runtime import CompileError
from codegen.runtime.standalone.arrays import LONG, all_finite
from codegen.runtime.standalone.calls import batches, single_calls
from codegen.runtime.standalone.errors import SingularForceError, SingularJointError

EXAMPLES = Path(__file__).parents[2] / "examples"
SAME_ROUNDING = "-O1 -march=native -ffp-contract=off"
"""Where products are not rounded together with sums, which compilers may do otherwise in vectors."""

ROPE = """
model: rope
parameters: {m: 2.0, k: 10.0}
inputs: [push]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: m}
  bob: {parent: cart, joint: {type: prismatic, axis: z}, mass: 1}
forces:
  rope: {type: spring, from: bob, to: ground, stiffness: k, damping: 0.1, free_length: 0.5}
  held: {type: joint, joint: cart, value: "push + 0.1*abs(q.cart) + sqrt(1 + q.cart**2) + atan2(q.cart, 2) - max(u.cart, 0)**1.5"}
initial: {q: {cart: 1.0, bob: 1.0}}
"""

FUNCTIONS = ["accelerations", "sensitivities", "gradients", "energies"]


class WithoutProducts(np.ndarray):
    """An array that uses no BLAS, since its threads keep other threads waiting on a busy machine."""

    def dot(self, other):
        raise AssertionError("a product")

    def __array_ufunc__(self, ufunc, method, *given, **how):
        assert ufunc is not np.matmul
        return getattr(ufunc, method)(*(np.asarray(x) for x in given), **how)


@pytest.mark.parametrize("count", [1, LONG, LONG + 1, 3 * LONG])
def test_whether_all_numbers_are_finite(count):
    x = np.full((count, 2), 1e200)  # their squares are not
    assert all_finite(x) and all_finite(x[::2])
    for number in (np.nan, np.inf, -np.inf):
        for at in (0, count - 1):
            x[at, 1] = number
            assert not all_finite(x)
            x[at, 1] = 1.0
    assert all_finite(np.ones((LONG + 1, 1)).view(WithoutProducts))


def model_of(name):
    rng = np.random.default_rng(3)
    if name == "rope":
        return codegen.parse_model(ROPE)
    if name == "tree":
        return random_tree(rng, 6)
    if name == "mechanism":
        return next(random_mechanisms(1))[1].model
    return codegen.load_model(EXAMPLES / f"{name}.yaml")


@pytest.fixture(scope="module", params=["rope", "tree", "mechanism", "four_bar"])
def package(request, tmp_path_factory):
    """A package with few functions, and its model; its code rounds every operation."""
    model = model_of(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ORDERNM_CFLAGS", SAME_ROUNDING)
        folder = tmp_path_factory.mktemp("batches") / request.param
        codegen.generate(model, folder, functions=FUNCTIONS, check=False, compile="all")
        yield folder, model


@pytest.fixture
def at_once(monkeypatch):
    """Compiles functions over several states at the first batch, and uses them for small batches too."""
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    monkeypatch.setattr(single_calls, "FEW", 0)
    monkeypatch.setattr(single_calls, "FEW_ALONG", 0)


def load(folder, **options):
    """A solver with the run time of this checkout, which tests can patch."""
    return codegen.load(folder, **options)


def draw(solver, model, n):
    """n states and three directions, one of each for every state."""
    rng = np.random.default_rng(n)
    drawn = [random_state(rng, model) for _ in range(n)]
    q, u, p, inputs, t = (np.array([getattr(s, name) for s in drawn]) for name in ("q", "u", "p", "inputs", "t"))
    if solver.closure_names:
        q0, u0 = solver.initial
        q, p = q0 + 0.01 * rng.normal(size=q.shape), np.tile(solver.parameters, (n, 1))
        q, u = solver.assemble(q, u0 + rng.normal(size=u.shape))
    seeds = [random_seeds(rng, model, 3) for _ in range(n)]
    return (q, u, p, inputs, t), {s: np.stack([x[s] for x in seeds], axis=1) for s in seeds[0]}


def same(a, b):
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("n", [8, 13, 32])
def test_several_states_at_once_give_the_bits_of_one(package, at_once, n):
    folder, model = package
    solver = load(folder)
    state, seeds = draw(solver, model, n)
    udot = solver.accelerations(*state)
    both = solver.sensitivities(*state, **seeds)
    weights = np.random.default_rng(n).normal(size=(3, n, model.nu))
    gradients = solver.gradients(*state, weights=weights)
    assert all(solver._target.batches._libraries[key] for key in ("states", "states 7"))
    one = load(folder)
    singles = [[x[i] if np.ndim(x) > 1 else float(x[i]) for x in state] for i in range(n)]
    np.testing.assert_array_equal(udot, [one.accelerations(*s) for s in singles])
    for i, s in enumerate(singles):
        found = one.sensitivities(*s, **{name: x[:, i] for name, x in seeds.items()})
        same((both[0][i], both[1][:, i]), found)
        same([x[:, i] for x in gradients], one.gradients(*s, weights=weights[:, i]))


@pytest.mark.parametrize("k", [1, 8, 11])
def test_directions_and_what_states_share(package, at_once, monkeypatch, k):
    folder, model = package
    solver = load(folder)
    (q, u, p, _, _), _ = draw(solver, model, 21)
    rng = np.random.default_rng(k)
    given = {"dp": rng.normal(size=(k, solver.np)), "dq": rng.normal(size=(k, 21, solver.nq))}
    weights = rng.normal(size=(k, 21, solver.nu))
    found = *solver.sensitivities(q, u, p[0], t=0.5, **given), *solver.gradients(q, u, p[0], t=0.5, weights=weights)
    only = *solver.sensitivities(q[0], u, p[0], dp=given["dp"]), *solver.gradients(q[0], u, weights=weights[:, 0])
    grid = solver.accelerations(q[:, None], u[None, :4])
    monkeypatch.setattr(batches, "WORTH_COMPILING", np.inf)
    other = load(folder)
    same(
        found, (*other.sensitivities(q, u, p[0], t=0.5, **given), *other.gradients(q, u, p[0], t=0.5, weights=weights))
    )
    alone = *other.sensitivities(q[0], u, p[0], dp=given["dp"]), *other.gradients(q[0], u, weights=weights[:, 0])
    same(only, alone)
    same([grid], [other.accelerations(q[:, None], u[None, :4])])
    assert "states" not in other._target.batches._libraries


@pytest.mark.parametrize("package", ["tree"], indirect=True)
def test_one_angle_beyond_the_reduction_changes_no_other_state(package, at_once):
    folder, model = package
    solver = load(folder)
    (q, u, p, inputs, t), _ = draw(solver, model, 16)
    before = solver.accelerations(q, u, p, inputs, t)
    turns = [i for i, unit in enumerate(model.coordinate_units) if unit == "rad"]
    assert turns
    q[5, turns] += 3e6
    after = solver.accelerations(q, u, p, inputs, t)
    others = np.arange(16) != 5
    same([after[others]], [before[others]])
    same([after[5]], [solver.accelerations(q[5], u[5], p[5], inputs[5], float(t[5]))])


@pytest.mark.parametrize("package", ["rope"], indirect=True)
@pytest.mark.parametrize("worth", [0, np.inf])
@pytest.mark.parametrize("target", ["c", "numpy"])
def test_a_bad_state_is_an_error_or_nan(package, monkeypatch, worth, target):
    monkeypatch.setattr(batches, "WORTH_COMPILING", worth)
    folder, model = package
    solver = load(folder, target=target)
    (q, u, p, inputs, t), seeds = draw(solver, model, 12)
    good = solver.sensitivities(q, u, p, inputs, t, **seeds)
    weights = np.ones((2, 12, 2))
    gradients = solver.gradients(q, u, p, inputs, t, weights=weights)
    q[3], u[7, 1], p[9, 0] = 0.0, np.nan, np.inf
    with pytest.raises(ValueError, match=r"u\[7, 1\] \(bob\) is nan"):
        solver.accelerations(q, u, p, inputs, t)
    finite = np.where(np.isfinite(u), u, 0.0), np.where(np.isfinite(p), p, 1.0)
    with pytest.raises(SingularForceError, match=r"rope" if target == "numpy" else r"state \[3\] of the batch"):
        solver.accelerations(q, *finite, inputs, t)
    solver.bad_states = "nan"
    with pytest.warns(RuntimeWarning) as told:
        found = solver.sensitivities(q, u, p, inputs, t, **seeds)
    (message,) = (str(w.message) for w in told)
    assert "3 of 12 states are NaN: state [3]: " in message and "rope" in message
    assert "state [7]: u[1] (bob) is nan; state [9]: p[0] (m) is inf" in message
    bad, left = [3, 7, 9], [i for i in range(12) if i not in (3, 7, 9)]
    assert np.isnan(found[0][bad]).all() and np.isnan(found[1][:, bad]).all()
    same((found[0][left], found[1][:, left]), (good[0][left], good[1][:, left]))
    with pytest.warns(RuntimeWarning, match="3 of 12 states are NaN"):
        found = solver.gradients(q, u, p, inputs, t, weights=weights)
    for x, y in zip(found, gradients, strict=True):
        assert np.isnan(x[:, bad]).all()
        np.testing.assert_array_equal(x[:, left], y[:, left])
    with pytest.warns(RuntimeWarning, match="3 of 12 states"):
        udot = solver.accelerations(
            q.reshape(3, 4, 2), u.reshape(3, 4, 2), p.reshape(3, 4, 2), inputs.reshape(3, 4, 1), 0.0
        )
    assert np.argwhere(np.isnan(udot).all(axis=-1)).tolist() == [[0, 3], [1, 3], [2, 1]]
    with pytest.warns(RuntimeWarning, match=r"2 of 12 states are NaN: state \[3\].*state \[7\]|1 of 12"):
        solver.energies(q, u, finite[1])
    with pytest.raises(ValueError, match="is nan"):  # what all states share
        solver.accelerations(q, np.full(2, np.nan))
    with pytest.raises(SingularJointError):  # one state alone
        solver.accelerations(np.zeros(2), np.zeros(2))


def test_options_say_what_is_allowed(package):
    solver = load(package[0])
    for wrong in (0, -1, 1.5, "two", True):
        with pytest.raises(ValueError, match="at least 1, or None"):
            solver.batch_threads = wrong
    with pytest.raises(ValueError, match="'error' and 'nan'"):
        solver.bad_states = "skip"
    assert (solver.batch_threads, solver.bad_states) == (None, "error")
    solver.batch_threads = np.int64(3)
    assert pickle.loads(pickle.dumps(solver)).batch_threads == 3
    solver.batch_threads = None
    assert pickle.loads(pickle.dumps(solver)).batch_threads is None


@pytest.mark.parametrize("package", ["rope"], indirect=True)
@pytest.mark.parametrize("worth", [0, np.inf])
def test_threads_give_the_same(package, monkeypatch, worth):
    monkeypatch.setattr(batches, "WORTH_COMPILING", worth)
    folder, _ = package
    solver = load(folder)
    rng = np.random.default_rng(0)
    q, u = 1.0 + rng.uniform(size=(1001, 2)), rng.normal(size=(1001, 2))
    dq = rng.normal(size=(3, 1001, 2))
    solver.batch_threads = 1
    one = solver.accelerations(q, u), *solver.sensitivities(q, u, dq=dq), *solver.energies(q, u)
    solver.batch_threads = 3
    energies = solver._functions["energies"]
    assert [solver._target.batches.threads(energies, n, 0, False) for n in (1001, 130, 100)] == [3, 2, 1]
    same(one, (solver.accelerations(q, u), *solver.sensitivities(q, u, dq=dq), *solver.energies(q, u)))
    q[[700, 900]] = 0.0
    with pytest.raises(SingularForceError, match=r"state \[700\] of the batch"):
        solver.accelerations(q, u)
    solver.bad_states = "nan"
    with pytest.warns(RuntimeWarning, match=r"2 of 1001 states are NaN: state \[700\].*state \[900\]"):
        assert np.argwhere(np.isnan(solver.accelerations(q, u)).any(axis=1)).ravel().tolist() == [700, 900]


@pytest.mark.parametrize("package", ["rope"], indirect=True)
def test_callers_of_several_threads_and_forked_ones_share_the_threads_of_c(package, at_once):
    solver = load(package[0])
    rng = np.random.default_rng(3)
    q, u = 1.0 + rng.uniform(size=(4001, 2)), rng.normal(size=(4001, 2))
    dq = rng.normal(size=(5, 4001, 2))
    solver.batch_threads = 1
    one = solver.accelerations(q, u), *solver.sensitivities(q, u, dq=dq)
    solver.batch_threads = 4
    with ThreadPoolExecutor(3) as pool:
        for found in pool.map(lambda _: (solver.accelerations(q, u), *solver.sensitivities(q, u, dq=dq)), range(60)):
            same(one, found)
    assert solver._target.batches._libraries["threads"]
    child = os.fork()
    if not child:  # it has none of the threads
        code = 1
        try:
            for _ in range(20):
                same(one, (solver.accelerations(q, u), *solver.sensitivities(q, u, dq=dq)))
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    same(one[:1], [solver.accelerations(q, u)])


@pytest.mark.parametrize("package", ["rope"], indirect=True)
def test_a_batch_that_no_thread_can_be_had_for_is_computed(package, at_once, monkeypatch):
    folder, model = package
    solver = load(folder)
    (q, u, *_), _ = draw(solver, model, 400)
    one = solver.accelerations(q, u)
    build = batches.build_apart

    def refuses(folder, name, part, *more):
        if part == "threads":
            raise CompileError("no threads")
        return build(folder, name, part, *more)

    monkeypatch.setattr(batches, "build_apart", refuses)
    solver.batch_threads = 2
    with pytest.warns(RuntimeWarning, match="one thread: no threads"):
        same([one], [solver.accelerations(q, u)])


@pytest.mark.parametrize("package", ["rope"], indirect=True)
def test_without_a_library_states_come_one_after_the_other(package, at_once, monkeypatch):
    folder, model = package

    def refuses(*arguments):
        raise CompileError("no room")

    monkeypatch.setattr(batches, "build_apart", refuses)
    solver = load(folder)
    (q, u, *_), _ = draw(solver, model, 16)
    with pytest.warns(RuntimeWarning, match="one after another: no room"):
        found = solver.accelerations(q, u)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same([found], [solver.accelerations(q, u)])


@pytest.mark.parametrize("package", ["mechanism", "four_bar"], indirect=True)
def test_states_that_are_assembled_together_are_those_of_one(package, monkeypatch):
    solver = load(package[0])
    q0, u0 = solver.initial
    rng = np.random.default_rng(5)
    q, u = q0 + 0.05 * rng.normal(size=(40, solver.nq)), u0 + rng.normal(size=(40, solver.nu))
    called = []
    values = solver._target.compute
    monkeypatch.setattr(solver._target, "compute", lambda f, *a, **k: called.append(f.name) or values(f, *a, **k))
    found = solver.assemble(q, u)
    assert called.count("closing_step") < 20 and np.abs(solver.closure(*found)[0]).max() < 1e-10
    monkeypatch.undo()
    alone = [solver.assemble(*state) for state in zip(q, u, strict=True)]
    for x, y in zip(found, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-11)


def test_who_asks_for_neither_gets_no_functions_over_states(tmp_path):
    codegen.generate(codegen.parse_model(ROPE), tmp_path / "rope", functions=["energies"], compile=False)
    assert not (tmp_path / "rope" / "rope_states.c").exists()
    assert "_states" not in (tmp_path / "rope" / "rope.h").read_text()


def test_large_models_are_worked_on_state_by_state(package, at_once, monkeypatch):
    """Where lanes would need much memory, or leave the caches: the same numbers, and nothing is compiled for them."""
    folder, model = package
    monkeypatch.setattr(batches, "MOST_SWEPT", 0)
    solver = load(folder)
    state, seeds = draw(solver, model, 16)
    together = solver.sensitivities(*state, **seeds)
    assert "states" not in solver._target.batches._libraries
    solver.accelerations(*state)
    assert solver._target.batches._libraries["states"]
    monkeypatch.setattr(batches, "MOST_IN_LANES", 0)
    one = load(folder)
    one.accelerations(*state)
    assert "states" not in one._target.batches._libraries
    monkeypatch.undo()
    same(together, load(folder).sensitivities(*state, **seeds))


def test_quaternions_of_a_large_batch_are_checked_in_c(tmp_path, monkeypatch):
    scalar = "float32"  # the C code reads both types, and this one is rounded near the limit
    monkeypatch.setattr(batches, "WORTH_COMPILING", 1)
    codegen.generate(EXAMPLES / "quadrotor.yaml", tmp_path, functions=["accelerations"], scalar=scalar)
    solver = codegen.load(tmp_path)
    if solver._target.mode != "api":
        pytest.skip("needs Python.h")
    solver.prepare("accelerations", "batches")
    q, u = (np.tile(np.asarray(x, scalar), (200, 1)) for x in solver.initial)
    first = next(i for i, name in enumerate(solver.coordinate_names) if name.endswith("qw"))
    q[:, first : first + 4] = np.random.default_rng(0).normal(size=(200, 4))
    u += 0.1
    expected = solver.accelerations(q, u)  # looks up the function for several states
    direct = solver._calls["accelerations"]
    given = (q, u, None, None, 0.0)
    np.testing.assert_array_equal(direct(given, None, None)[0], expected)
    for length, accepted in ((2e-6, True), (0.5e-6, False), (0.0, False), (np.nan, False)):
        q[117, first : first + 4] = [0.0, 0.0, length, 0.0]
        assert (direct(given, None, None) is not None) == accepted
    with pytest.raises(ValueError, match=r"quaternion .* has length 0, expected at least 1e-06"):
        q[117, first : first + 4] = 0.0
        solver.accelerations(q, u)


BRANCHES = """
model: branches
parameters: {s: 0.2, c: 3.0, k: 40.0}
inputs: [push]
bodies:
  slide: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  arm: {parent: slide, joint: {type: revolute, axis: y}, mass: 2, com: [0, 0, -0.4], inertia: {yy: 0.1}}
forces:
  stop: {type: joint, joint: slide, value: "if(q.slide > s, -k*(q.slide - s), c*push) - c*sign(u.slide)*abs(q.arm)"}
  swing: {type: joint, joint: arm, value: "k*max(0, q.arm - s)*u.arm"}
"""


def test_states_on_both_sides_of_branches_have_the_gradients_of_single_calls(tmp_path, monkeypatch):
    """With motions in the package, functions have variants that hold branches; those over several states have none."""
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    functions = "accelerations,sensitivities,gradients,motion"
    codegen.generate(codegen.parse_model(BRANCHES), tmp_path / "branches", functions=functions)
    solver, draw, n = codegen.load(tmp_path / "branches"), np.random.default_rng(3), 203
    (q, u), inputs, weights = draw.normal(size=(2, n, 2)), draw.normal(size=(n, 1)), draw.normal(size=(3, n, 2))
    found = solver.gradients(q, u, None, inputs, weights=weights)
    assert any(key.startswith("states") for key in solver._target.batches._libraries)
    for i in range(n):
        one = solver.gradients(q[i], u[i], None, inputs[i], weights=weights[:, i])
        for a, b in zip(found, one, strict=True):
            np.testing.assert_allclose(a[:, i], b, rtol=0, atol=1e-14 * max(1.0, np.abs(b).max(initial=0.0)))
