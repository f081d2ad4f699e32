"""Calls of C from Python: both interfaces of cffi, and results in `out=`; `test_single_calls` tests calls with one state."""

import sys
import sysconfig

import numpy as np
import pytest

import codegen
from codegen.runtime import CompileError, Jacobians
from codegen.runtime.standalone.calls import caller
from codegen.runtime.standalone.state.derivatives import JACOBIANS

SEEDS = ("dq", "du", "dp", "dinputs")


@pytest.fixture(params=["api", "abi"])
def satellite(request, packages, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFFI", request.param)
    solver = codegen.load(packages / "satellite")
    assert solver._target.mode == request.param
    return solver


def draw(solver, k=None):
    """A random state q, u, p, inputs, and k directions."""
    rng = np.random.default_rng(7)
    sizes = (solver.nq, solver.nu, solver.np, solver.ninputs)
    q, u, p, inputs = (rng.uniform(0.5, 1.5, size=n) for n in sizes)
    seeds = {s: rng.normal(size=n if k is None else (k, n)) for s, n in zip(SEEDS, sizes, strict=True)}
    return (q, u, p, inputs, 0.25), seeds


def same(a, b):
    if isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            same(x, y)
    elif isinstance(a, Jacobians):
        same(*(tuple(getattr(J, n) for n in JACOBIANS) for J in (a, b)))
    else:
        assert np.shape(a) == np.shape(b)
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("k", [None, 8])
def test_both_ways_of_cffi_give_the_same_bits(satellite, packages, monkeypatch, k):
    monkeypatch.setenv("ORDERNM_CFFI", "abi")
    other = codegen.load(packages / "satellite")
    state, seeds = draw(satellite, k)
    for name in ("accelerations", "jacobians", "mass_matrix"):
        given = state if name != "mass_matrix" else (state[0], *state[2:])
        same(getattr(satellite, name)(*given), getattr(other, name)(*given))
    same(satellite.sensitivities(*state, **seeds), other.sensitivities(*state, **seeds))


# ---- cffi ------------------------------------------------------------------------------------------------------------


def test_python_without_headers_is_served(pendulum, monkeypatch, tmp_path):
    monkeypatch.setattr(caller.sysconfig, "get_path", lambda name: str(tmp_path))
    solver = codegen.load(pendulum)
    assert solver._target.mode == "abi"
    assert solver.accelerations(np.array([0.3]), np.zeros(1)) == pytest.approx(-9.81 / 0.5 * np.sin(0.3))
    monkeypatch.setenv("ORDERNM_CFFI", "api")
    with pytest.raises(CompileError, match=r"ORDERNM_CFFI=api.*no Python\.h in"):
        codegen.load(pendulum)


def test_headers_that_do_not_compile_are_done_without(pendulum, monkeypatch, tmp_path):
    (tmp_path / "include").mkdir()
    for header in ("pyconfig.h", "Python.h"):
        (tmp_path / "include" / header).write_text("#error out of order\n")
    monkeypatch.setattr(caller.sysconfig, "get_path", lambda name: str(tmp_path / "include"))
    for _ in range(2):
        assert codegen.load(pendulum)._target.mode == "abi"
    assert sorted(f.name for f in pendulum.iterdir() if "call" in f.name) == ["pendulum_calls.c"]
    monkeypatch.setenv("ORDERNM_CFFI", "api")
    with pytest.raises(CompileError, match="out of order"):
        codegen.load(pendulum)


def test_the_caller_is_compiled_once_for_each_python(packages, pendulum, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "platform", "linux")

    def callers():
        return sorted((tmp_path / "cache" / "ordernm" / "ordernm_call").glob("*.so"))

    codegen.load(pendulum)
    (first,) = callers()
    before = first.stat().st_mtime_ns
    codegen.load(packages / "satellite")
    assert callers() == [first] and first.stat().st_mtime_ns == before
    real = sysconfig.get_config_var
    monkeypatch.setattr(caller.sysconfig, "get_config_var", lambda n: "another" if n == "SOABI" else real(n))
    codegen.load(pendulum)
    assert len(callers()) == 2


def test_an_unknown_way_is_refused(pendulum, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFFI", "ctypes")
    with pytest.raises(CompileError, match="ORDERNM_CFFI is 'ctypes'; allowed are 'api' and 'abi'"):
        codegen.load(pendulum)


# ---- out= ------------------------------------------------------------------------------------------------------------

ONE = ["accelerations", "coordinate_rates", "outputs", "bias_force"]
TWO = ["sensitivities", "coordinate_rate_sensitivities", "output_sensitivities"]


@pytest.fixture(params=["c", "numpy"])
def either(request, packages):
    return codegen.load(packages / "satellite", request.param)


@pytest.mark.parametrize("batch", [(), (3,)])
def test_results_go_where_they_are_wanted(either, batch):
    (q, u, p, inputs, t), seeds = draw(either, 2)
    state = (np.broadcast_to(q, (*batch, q.size)).copy(), u, p, inputs, t)
    seeds = {s: x.reshape(2, *(1,) * len(batch), -1) for s, x in seeds.items()}
    for name in ONE:
        expected = getattr(either, name)(*state)
        out = np.full_like(expected, np.nan)
        assert getattr(either, name)(*state, out=out) is out
        same(out, expected)
    for name in TWO:
        expected = getattr(either, name)(*state, **seeds)
        out = tuple(np.full_like(x, np.nan) for x in expected)
        found = getattr(either, name)(*state, **seeds, out=out)
        assert found[0] is out[0] and found[1] is out[1]
        same(out, expected)
    expected = either.jacobians(*state)
    out = Jacobians(*(np.full_like(getattr(expected, n), np.nan) for n in JACOBIANS))
    assert either.jacobians(*state, out=out) is out
    same(out, expected)
    M = np.full_like(either.mass_matrix(state[0], p), np.nan)
    assert either.mass_matrix(state[0], p, out=M) is M
    same(M, either.mass_matrix(state[0], p))


@pytest.mark.parametrize("batch", [(), (3,)])
def test_results_may_take_the_place_of_arguments(either, batch):
    (q, u, p, inputs, t), seeds = draw(either, 1)
    u = np.broadcast_to(u, (*batch, u.size)).copy()
    expected = either.accelerations(q, u, p, inputs, t)
    taken = u.copy()
    same(either.accelerations(q, taken, p, inputs, t, out=taken), expected)
    both = np.zeros((2, *batch, either.nu))
    value, derivative = either.sensitivities(q, u, p, inputs, t, du=seeds["du"].reshape(1, *(1,) * len(batch), -1))
    either.sensitivities(q, u, p, inputs, t, du=seeds["du"].reshape(1, *(1,) * len(batch), -1), out=(both[0], both[1:]))
    same(both[0], value)
    same(both[1:], derivative)


def test_wrong_places_are_told(either):
    (q, u, *rest), seeds = draw(either, 2)
    nu = either.nu
    frozen = np.zeros(nu)
    frozen.flags.writeable = False
    wrong = {
        "list": [0.0] * nu, "shape": np.zeros(nu + 1), "read-only": frozen, "float32": np.zeros(nu, np.float32),
        "contiguous": np.zeros(2 * nu)[::2], "MaskedArray": np.ma.zeros(nu),
    }  # fmt: skip
    for what, out in wrong.items():
        with pytest.raises(ValueError, match=rf"out \(udot\).*{what}.*expected a writeable C-contiguous array"):
            either.accelerations(q, u, *rest, out=out)
    with pytest.raises(ValueError, match=r"out is ndarray, expected a tuple of 2 arrays: udot, dudot"):
        either.sensitivities(q, u, *rest, **seeds, out=np.zeros(nu))
    with pytest.raises(ValueError, match=r"out \(dudot\).*\(3, 17\).*shape \(2, 17\)"):
        either.sensitivities(q, u, *rest, **seeds, out=(np.zeros(nu), np.zeros((3, nu))))
    with pytest.raises(ValueError, match=r"out is tuple, expected Jacobians"):
        either.jacobians(q, u, *rest, out=(np.zeros(nu),))
    J = either.jacobians(q, u, *rest)
    J.u = J.u.T
    with pytest.raises(ValueError, match=r"out \(J\.u\) is read-only, not contiguous"):
        either.jacobians(q, u, *rest, out=J)
