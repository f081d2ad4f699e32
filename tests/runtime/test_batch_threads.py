"""The default number of threads for a batch, and that results do not depend on it."""

import dataclasses
import math
import multiprocessing
import os
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime import CompileError
from codegen.runtime.standalone.calls import batches, single_calls, threads
from codegen.runtime.standalone.calls.threads import LIMIT, WORTH_A_THREAD, batch_threads, one_thread, processors

MODEL = Path(__file__).parents[2] / "examples" / "double_pendulum.yaml"
LARGE = 100 * WORTH_A_THREAD


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A package with a function over several states at once and one without."""
    path = tmp_path_factory.mktemp("threads") / "model"
    codegen.generate(MODEL, path, functions=["accelerations", "sensitivities", "energy_sensitivities"], check=False)
    return path


@pytest.fixture
def many(monkeypatch):
    """Four processors, with no other limit on the number of threads."""
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda process: {0, 1, 2, 3}, raising=False)
    monkeypatch.setattr(threads, "_quota", lambda: math.inf)
    monkeypatch.delenv(LIMIT, raising=False)


@pytest.fixture
def solver(folder, many, monkeypatch):
    """A solver that shares large batches among threads even if they are small."""
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    monkeypatch.setattr(threads, "WORTH_A_THREAD", 1)
    return codegen.load(folder)


def arguments(count=1000):
    rng = np.random.default_rng(0)
    q, u = (rng.normal(size=(count, 2)) for _ in range(2))
    return (q, u), {n: rng.normal(size=(3, count, 2)) for n in ("dq", "du")}


def results(solver):
    state, seeds = arguments()
    return *solver.sensitivities(*state, **seeds), *solver.energy_sensitivities(*state, **seeds)


def same(found, expected):
    for x, y in zip(found, expected, strict=True):
        np.testing.assert_array_equal(x, y)


def test_a_batch_has_a_thread_for_each_tenth_of_a_millisecond_and_each_processor(many):
    counts = [batch_threads(x * WORTH_A_THREAD) for x in (0.0, 0.5, 1.9, 2.0, 3.5, 100.0, math.inf)]
    assert counts == [1, 1, 1, 2, 3, 4, 4]


@pytest.mark.parametrize(("text", "count"), [("1", 1), ("2", 2), (" 3,1", 3), ("64", 4), ("", 4)])
def test_the_limit_of_numerical_libraries_holds(many, monkeypatch, text, count):
    monkeypatch.setenv(LIMIT, text)
    assert batch_threads(LARGE) == count


@pytest.mark.parametrize("text", ["0", "-2", "two", "1.5"])
def test_a_limit_that_is_no_number_is_reported(many, monkeypatch, text):
    monkeypatch.setenv(LIMIT, text)
    with pytest.warns(RuntimeWarning, match=f"{LIMIT} is '{text}', expected an integer"):
        assert batch_threads(LARGE) == 4


def write(root, files):
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("0::/\n", {"cpu.max": "max 100000\n"}, 8),
        ("0::/\n", {"cpu.max": "250000 100000\n"}, 2),
        ("0::/\n", {"cpu.max": "50000 100000\n"}, 1),
        ("0::/user/job\n", {"user/cpu.max": "300000 100000\n", "user/job/cpu.max": "max 100000\n"}, 3),
        ("0::/outside/of/this/container\n", {"cpu.max": "400000 100000\n"}, 4),
        ("4:memory:/\n3:cpu,cpuacct:/a\n", {"cpu/a/cpu.cfs_quota_us": "500000\n", "cpu/a/cpu.cfs_period_us": "100000\n"}, 5),
        ("1:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 8),
        ("1:cpuset:/\n", {}, 8),
        ("", {}, 8),
    ],
)  # fmt: skip
def test_quotas_of_control_groups_limit_the_processors(tmp_path, monkeypatch, groups, files, expected):
    write(tmp_path, {"of_process": groups, **files})
    monkeypatch.setattr(threads, "CONTROL_GROUPS", tmp_path)
    monkeypatch.setattr(threads, "OF_PROCESS", tmp_path / "of_process")
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda process: set(range(8)), raising=False)
    threads._quota.cache_clear()
    try:
        assert processors() == expected
    finally:
        threads._quota.cache_clear()


def test_workers_of_pools_have_one_thread_each(many):
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(batch_threads, [LARGE] * 4)) == [4] * 4
        assert list(pool.map(one_thread()(batch_threads), [LARGE] * 4)) == [1] * 4
        assert list(pool.map(batch_threads, [LARGE] * 4)) == [4] * 4
    for method in ("fork", "spawn"):
        with multiprocessing.get_context(method).Pool(1) as processes:
            assert processes.apply(batch_threads, (LARGE,)) == 1


def test_workers_of_sweeps_have_one_thread_each(solver, many):
    seen = codegen.sweep(solver, {"mass_1": [1.0, 2.0, 3.0]}, lambda solver, case: {"threads": batch_threads(LARGE)})
    assert seen["threads"].tolist() == [1.0, 1.0, 1.0]


def test_small_batches_start_no_thread_and_compile_nothing(folder, many, monkeypatch):
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    solver = codegen.load(folder)
    before = threading.active_count()
    results(solver)  # 70 and 240 microseconds of one thread, about
    assert "threads" not in solver._target.batches._libraries and threading.active_count() == before


def test_results_do_not_depend_on_the_number_of_threads(solver, monkeypatch):
    found = {None: results(solver)}
    assert solver._target.batches._libraries["threads"]
    for number in (1, 2, 3, 7):
        solver.batch_threads = number
        found[number] = results(solver)
    solver.batch_threads = None
    monkeypatch.setenv(LIMIT, "1")
    found["limit"] = results(solver)
    for x in found.values():
        same(x, found[1])


def test_children_that_were_forked_after_threads_began_compute_the_same(solver):
    one = results(solver)
    child = os.fork()
    if not child:
        code = 1
        try:
            for _ in range(5):
                same(results(solver), one)
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    with multiprocessing.get_context("fork").Pool(2) as pool:
        for found in pool.map(results, [solver] * 4):
            same(found, one)
    same(results(solver), one)


def test_a_library_that_cannot_be_had_is_reported_only_if_threads_were_asked_for(solver, monkeypatch):
    build = batches.build_apart

    def refuses(folder, name, part, *more):
        if part == "threads":
            raise CompileError("no threads")
        return build(folder, name, part, *more)

    monkeypatch.setattr(batches, "build_apart", refuses)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        one = results(solver)
    solver.batch_threads = 2
    with pytest.warns(RuntimeWarning, match="one thread: no threads"):
        same(results(solver), one)


@pytest.fixture(scope="module")
def framed(tmp_path_factory):
    """A package with several libraries of functions along directions; some functions are composed of others."""
    path = tmp_path_factory.mktemp("framed") / "model"
    codegen.generate(MODEL, path, functions=["energy_sensitivities", "frame_sensitivities"], frames=True, check=False)
    return path


def flat(results):
    """The arrays of results, which may be tuples or motions of frames and points."""
    if isinstance(results, np.ndarray):
        return [results]
    parts = results if isinstance(results, tuple) else [getattr(results, f.name) for f in dataclasses.fields(results)]
    return [x for part in parts if not isinstance(part, str) and part is not None for x in flat(part)]


POINTS = {"points": [("lower", (0.1, 0.2, -0.3)), ("upper", (0.0, 0.0, 0.4))]}


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("k", [1, 2, 8, 11])
@pytest.mark.parametrize("moving", ["dq du", "dq dp", "dp", ""])
def test_directions_of_all_states_and_of_each_state(framed, number, k, moving):
    """Large batches, state after state, give what single states do, whichever seeds are the same for all states."""
    solver, count = codegen.load(framed), 150
    solver.batch_threads = number
    rng = np.random.default_rng(k)
    q, u = rng.normal(size=(2, count, 2))
    sizes = {"dq": 2, "du": 2, "dp": solver.np}
    seeds = {n: rng.normal(size=(k, *((count,) if n in moving else ()), size)) for n, size in sizes.items()}

    def of(i):
        return {n: np.ascontiguousarray(x[:, i]) if x.ndim == 3 else x for n, x in seeds.items()}

    for function, more in (("energy_sensitivities", {}), ("frame_sensitivities", {}), ("point_sensitivities", POINTS)):
        call = getattr(solver, function)
        whole = call(q, u, **seeds, **more)
        for i in (0, 1, count - 1):
            alone = call(q[i], u[i], **of(i), **more)
            for found, expected in zip(flat(whole), flat(alone), strict=True):
                at = found[:, i] if found.shape[:2] == (k, count) else found[i]
                np.testing.assert_allclose(at, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("name", ["q", "u", "p", "dq", "dp"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_of_large_batches_that_are_not_finite_are_refused(solver, number, name, bad):
    """The C looks at these while it reads them, whichever state, direction and part of a vector they are in."""
    solver.batch_threads = number
    rng = np.random.default_rng(0)
    (q, u), seeds = arguments()
    p = solver.parameters * rng.uniform(1.0, 1.1, size=(1000, solver.np))
    given = {"q": q, "u": u, "p": p, **seeds, "dp": rng.normal(size=(3, 1000, solver.np))}
    udot, dudot = solver.sensitivities(**given)
    assert np.isfinite(udot).all() and np.isfinite(dudot).all()
    for state in (0, 511, 998, 999):
        spoilt = {**given, name: given[name].copy()}
        place = (2, state, 1) if name[0] == "d" else (state, 1)
        spoilt[name][place] = bad
        with pytest.raises(ValueError, match=rf"{name}\[{', '.join(map(str, place))}\].* is {bad}, expected finite"):
            solver.sensitivities(**spoilt)


def test_results_of_large_batches_that_are_not_finite_are_reported(solver):
    """Arguments are finite, and accelerations are beyond the largest number."""
    (q, u), _ = arguments()
    u[700] = 1e200
    with pytest.warns(RuntimeWarning, match=r"udot of accelerations is not finite in state \[700\] of the batch"):
        assert np.argwhere(~np.isfinite(solver.accelerations(q, u)).all(axis=1)).ravel().tolist() == [700]
    u[701] = np.nan
    solver.bad_states = "nan"
    with pytest.warns(RuntimeWarning, match=r"1 of 1000 states are NaN: state \[701\]"):
        solver.accelerations(q, u)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A package whose accelerations depend on inputs and time."""
    path = tmp_path_factory.mktemp("driven") / "model"
    codegen.generate(codegen.parse_model(DRIVEN), path, functions=["accelerations", "sensitivities"], check=False)
    return path


DRIVEN = """
model: driven
parameters: {m: 2.0, k: 10.0}
inputs: [push]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: m}
  bob: {parent: cart, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -0.5]}
forces:
  held: {type: joint, joint: cart, value: "push*sin(3*t) - k*q.cart"}
"""


def both_ways(solver, name, *given, **named):
    """The results of the compiled call for a large batch, and of the general path."""
    call = getattr(solver, name)
    kept = dict(solver._calls)
    found = call(*given, **named)
    try:
        for key in kept:
            solver._calls[key] = single_calls.general
        return found, call(*given, **named)
    finally:
        solver._calls.update(kept)


@pytest.mark.parametrize("number", [1, 3, None])
def test_large_batches_are_those_of_the_general_path(driven, many, monkeypatch, number):
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    monkeypatch.setattr(threads, "WORTH_A_THREAD", 1)
    solver, count, k = codegen.load(driven), 501, 5
    solver.batch_threads = number
    rng = np.random.default_rng(1)

    def draw(*shape):
        return rng.normal(size=shape)

    q, u, p, f = draw(count, 2), draw(count, 2), 2.0 + rng.uniform(size=(count, 2)), draw(count, 1)
    solver.accelerations(q, u), solver.sensitivities(q, u, dq=q[None])  # compiled now
    arguments = [
        {}, {"p": p[0]}, {"p": p}, {"p": {"m": 3.0}}, {"inputs": f[0], "t": 0.3}, {"inputs": f, "t": np.float64(0.3)},
        {"inputs": f, "t": rng.uniform(size=count)}, {"q": q[0]}, {"u": u[::-1]}, {"q": np.asfortranarray(q)},
        {"q": q[:, None].repeat(2, 1).reshape(-1, 2)[::2]}, {"u": u[0].tolist()}, {"u": u.astype(np.float32)},
    ]  # fmt: skip
    seeds = [
        {"dq": draw(k, count, 2)}, {"dq": draw(k, 2)}, {"dq": draw(2)}, {"du": draw(k, count, 2), "dp": draw(k, 2)},
        {"dq": draw(k, 1, 2)}, {"dt": draw(k)}, {"dt": draw(k, count), "dinputs": draw(k, 1)}, {"dp": {"m": 1.0}},
        {"dq": draw(11, count, 2)}, {"dinputs": draw(k, count, 1)}, {"dt": 1.0}, {"dq": draw(count, k, 2).swapaxes(0, 1)},
    ]  # fmt: skip
    for named in arguments:
        same(*([x] for x in both_ways(solver, "accelerations", **{"q": q, "u": u, **named})))
        for along in seeds:
            same(*both_ways(solver, "sensitivities", **{"q": q, "u": u, **named, **along}))
    out = np.empty((count, 2)), np.empty((k, count, 2))
    for named in ({"dq": seeds[0]["dq"]}, {"dq": out[1]}):  # the latter is overwritten
        out[1][...] = seeds[0]["dq"]
        expected = solver.sensitivities(q, u, dq=seeds[0]["dq"])
        assert solver.sensitivities(q, u, **named, out=out)[1] is out[1]
        same(out, expected)


def test_large_batches_of_the_compiled_call_are_refused_like_others(driven, many, monkeypatch):
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)
    solver = codegen.load(driven)
    q, u = np.ones((2, 300, 2))
    solver.accelerations(q, u)
    for t in (np.nan, np.inf):
        with pytest.raises(ValueError, match=f"t is {t}, expected finite numbers"):
            solver.accelerations(q, u, t=t)
    with pytest.raises(ValueError, match=r"p has shape \(300, 3\)"):
        solver.accelerations(q, u, np.ones((300, 3)))
    with pytest.raises(ValueError, match="do not broadcast"):
        solver.accelerations(q, u[:299])
    monkeypatch.setattr(type(solver._target.batches), "threads", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):  # what the run time raises meanwhile, such as KeyboardInterrupt, is not lost
        solver.accelerations(q, u)
