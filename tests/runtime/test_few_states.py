"""Small batches give the bits of single calls and the errors of large batches."""

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime.standalone.calls import batches
from codegen.runtime.standalone.calls.single_calls import NoCalls

EXAMPLES = Path(__file__).parents[2] / "examples"
N = 9


@pytest.fixture(scope="module", params=["arm", "four_bar", "satellite"])
def solver(request, tmp_path_factory):
    model = codegen.load_model(EXAMPLES / f"{request.param}.yaml")
    folder = tmp_path_factory.mktemp("few") / request.param
    codegen.generate(model, folder, check=False, compile="all")
    return codegen.load(folder)


@pytest.fixture
def states(solver):
    rng = np.random.default_rng(1)
    q0, u0 = solver.initial
    q, u = q0 + 0.05 * rng.normal(size=(N, solver.nq)), u0 + 0.3 * rng.normal(size=(N, solver.nu))
    return solver.assemble(q, u)


@pytest.fixture
def counted(solver, monkeypatch):
    """A list of the small batches passed to direct calls, and whether the direct calls computed them."""
    found = []
    calls = solver._calls

    class Counted(dict):
        def __missing__(self, wanted):
            def counted(given, seeds, out):
                results = calls[wanted](given, seeds, out)
                if any(np.ndim(x) == 2 for x in given):
                    found.append((getattr(wanted, "name", wanted), results is not None))
                return results

            return counted

    monkeypatch.setattr(solver, "_calls", Counted())
    return found


def rows(call, *arrays):
    """Stacked results of single calls; functions with several results give one stack for each."""
    return [call(*(a[i] for a in arrays)) for i in range(N)]


def test_values_are_those_of_single_calls(solver, states, counted):
    q, u = states
    inputs = np.linspace(0, 1, N)[:, None] * np.ones(solver.ninputs)
    t = np.linspace(0.0, 1.0, N)
    together = solver.accelerations(q, u, None, inputs, t)
    single = [solver.accelerations(q[i], u[i], None, inputs[i], float(t[i])) for i in range(N)]
    np.testing.assert_array_equal(together, single)
    np.testing.assert_array_equal(solver.mass_matrix(q), rows(solver.mass_matrix, q))
    np.testing.assert_array_equal(solver.coordinate_rates(q, u), rows(solver.coordinate_rates, q, u))
    out = np.empty((N, solver.nu))
    assert solver.accelerations(q, u, out=out) is out
    np.testing.assert_array_equal(out, rows(solver.accelerations, q, u))
    np.testing.assert_array_equal(solver.accelerations(q, u[0]), [solver.accelerations(x, u[0]) for x in q])
    np.testing.assert_array_equal(solver.accelerations(q[::-1], u[::-1]), out[::-1])
    assert [small for name, small in counted if name == "accelerations"] == [True] * 4


def test_derivatives_are_those_of_single_calls(solver, states, counted):
    q, u = states
    rng = np.random.default_rng(2)
    shared, own = rng.normal(size=(3, solver.nu)), rng.normal(size=(3, N, solver.nu))
    for du in (shared, shared[:, None], own):
        found = solver.sensitivities(q, u, du=du)
        for i in range(N):
            single = solver.sensitivities(q[i], u[i], du=own[:, i] if du is own else shared)
            np.testing.assert_array_equal(found[0][i], single[0])
            np.testing.assert_array_equal(found[1][:, i], single[1])
    weights = rng.normal(size=(2, N, solver.nu))
    gradients = solver.gradients(q, u, weights=weights)
    J = solver.jacobians(q, u)
    for i in range(N):
        for together, single in zip(gradients, solver.gradients(q[i], u[i], weights=weights[:, i]), strict=True):
            np.testing.assert_array_equal(together[:, i], single)
        single = solver.jacobians(q[i], u[i])
        for name in ("q", "u", "p", "inputs", "t"):
            np.testing.assert_array_equal(getattr(J, name)[i], getattr(single, name))
    assert ("sensitivities", False) not in counted and ("jacobians", False) not in counted


def test_bad_batches_have_the_errors_of_large_ones(solver, states, monkeypatch):
    q, u = states
    spoilt = u.copy()
    spoilt[4, 0] = np.nan
    q_short = q.copy()
    cases = [(q, spoilt), (q, u[:-1]), (q[:, :-1], u), (q.astype(object), u), (q_short, u.astype(np.float32))]
    messages = []
    for calls in (solver._calls, NoCalls()):
        monkeypatch.setattr(solver, "_calls", calls)
        for given in cases:
            try:
                messages.append(np.asarray(solver.accelerations(*given)).tobytes())
            except ValueError as error:
                messages.append(str(error))
    assert messages[: len(cases)] == messages[len(cases) :]
    assert "u[4, 0]" in messages[0] or "nan" in messages[0]


def test_results_over_arguments(solver, states):
    q, u = states
    expected = solver.accelerations(q, u)
    place = u.copy()
    solver.accelerations(q, place, out=place)
    np.testing.assert_array_equal(place, expected)


def test_bad_states_may_be_nan(solver, states):
    q, u = states
    u[2, 0] = np.inf
    solver.bad_states = "nan"
    try:
        with pytest.warns(RuntimeWarning, match="1 of 9 states"):
            udot = solver.accelerations(q, u)
    finally:
        solver.bad_states = "error"
    assert np.isnan(udot[2]).all() and np.isfinite(np.delete(udot, 2, axis=0)).all()


@pytest.mark.parametrize("count", [97, 400])
def test_larger_batches_without_lanes_are_called_directly_on_one_thread(solver, states, counted, monkeypatch, count):
    rng = np.random.default_rng(count)
    chosen = rng.integers(0, N, count)
    q, u = (x[chosen] for x in states)
    dq, dp = rng.normal(size=(2, count, solver.nq)), rng.normal(size=(2, solver.np))
    calls = {
        "energies": lambda: solver.energies(q, u),
        "coordinate_rates": lambda: [solver.coordinate_rates(q, u)],
        "mass_matrix": lambda: [solver.mass_matrix(q)],
        "energy_sensitivities": lambda: solver.energy_sensitivities(q, u, dq=dq, dp=dp),
        "coordinate_rate_sensitivities": lambda: solver.coordinate_rate_sensitivities(q, u, dq=dq, dp=dp),
    }
    for name, call in calls.items():
        counted.clear()
        found = call()
        if name != "mass_matrix":  # with loops, other functions compose it
            assert counted == [(name, True)]
        counted.clear()
        with monkeypatch.context() as patched:
            patched.setattr(batches, "MOST_COPIED", 0)
            expected = call()
        assert name == "mass_matrix" or counted == [(name, False)]
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_array_equal(x, y)


def test_batches_that_have_several_threads_take_the_general_path(solver, states, counted):
    q, u = (np.tile(x, (30, 1)) for x in states)
    try:
        solver.batch_threads = 3
        solver.coordinate_rates(q, u)
    finally:
        solver.batch_threads = None
    assert counted == [("coordinate_rates", False)]
