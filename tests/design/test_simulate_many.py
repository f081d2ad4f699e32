"""Batches of motions against closed forms and single motions; failures, progress, Ctrl-C."""

import numpy as np
import pytest
from oscillator import oscillator, swing

import codegen
from codegen.design.failures import FAILURES
from codegen.runtime import AssemblyError, SimulationError


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return oscillator(tmp_path_factory.mktemp("many"))


def test_motions_come_in_the_order_of_their_rows(solver):
    t, stiffness = np.linspace(0, 2, 21), np.linspace(2, 12, 40)
    seen = []
    motions = codegen.simulate_many(
        solver, t, p={"stiffness": stiffness}, sensitivities="stiffness", threads=3, progress=lambda *x: seen.append(x)
    )
    exact = [swing(t, stiffness=k) for k in stiffness]
    assert motions["x"] == pytest.approx(np.array([x for x, _ in exact]), abs=1e-8)
    assert motions.derivative("x", "stiffness") == pytest.approx(np.array([d["stiffness"] for _, d in exact]), abs=1e-8)
    assert seen == [(i, 40) for i in range(1, 41)]
    assert len(motions) == 40 and not motions.failures and motions.succeeded.all()
    assert all(x.p[1] == k for x, k in zip(motions, stiffness, strict=True))
    alone = solver.simulate(t, p={"stiffness": stiffness[7]}, sensitivities="stiffness")
    assert np.array_equal(motions[7].q, alone.q) and np.array_equal(motions[7].dq, alone.dq)


def test_states_and_inputs_may_have_rows_too(solver):
    t = np.linspace(0, 1, 5)
    q, u = np.array([[0.1], [0.2], [0.3]]), np.array([[1.0], [0.0], [-1.0]])
    motions = codegen.simulate_many(solver, t, q, u)
    expected = q * np.cos(2 * t) + u / 2 * np.sin(2 * t)
    assert motions["x"] == pytest.approx(expected, abs=1e-8)
    inputs = [[4.0], (t, np.full(5, 8.0)), {"force": 0.0}]
    motions = codegen.simulate_many(solver, t, q, inputs=inputs, u=[0.0])
    rest = np.array([[0.5], [1.0], [0.0]])
    assert motions["x"] == pytest.approx(rest + (q - rest) * np.cos(2 * t), abs=1e-8)
    motions = codegen.simulate_many(solver, t, p=np.array([solver.parameters] * 2), inputs=np.array([[0.0], [4.0]]))
    assert motions["x"][1] == pytest.approx(np.full(5, 0.5), abs=1e-9), "at rest where the force holds the spring"


def test_failures_are_recorded_and_the_others_go_on(solver):
    t = np.linspace(0, 3, 31)
    motions = codegen.simulate_many(solver, t, p={"cubic": [400.0, 0.0, 400.0, 1.0]}, most_steps=2000)
    assert list(motions.failures) == [0, 2] and list(motions.succeeded) == [False, True, False, True]
    assert all(isinstance(e, SimulationError) for e in motions.failures.values())
    x = motions["x"]
    assert x.shape == (4, 31) and np.isfinite(x[[1, 3]]).all() and np.isnan(x[[0, 2], -1]).all()
    assert len(motions[0]) > 0 and np.isfinite(x[0, 0]), "what there is until then is kept"
    assert "4 motions, 2 failed" in repr(motions) and "t = " in repr(motions)
    assert issubclass(AssemblyError, FAILURES)


@pytest.mark.parametrize("last", [1, 3])
def test_ctrl_c_leaves_what_was_computed(solver, last):
    def progress(done, n):
        if done == last:
            raise KeyboardInterrupt

    motions = codegen.simulate_many(solver, 1.0, p={"stiffness": np.linspace(1, 9, 2000)}, threads=1, progress=progress)
    done = sum(x is not None for x in motions)
    assert last <= done < 2000 and motions.succeeded.sum() >= last


def test_what_is_wrong_is_told(solver):
    with pytest.raises(ValueError, match="progress is 3, expected a function"):
        codegen.simulate_many(solver, 1.0, p={"stiffness": [1.0, 2.0]}, progress=3)
    with pytest.raises(ValueError, match="no argument has rows"):
        codegen.simulate_many(solver, 1.0, p=solver.parameters)
    with pytest.raises(ValueError, match="different numbers of motions: q 2, p 3"):
        codegen.simulate_many(solver, 1.0, q=np.zeros((2, 1)), p=np.ones((3, 5)))
    with pytest.raises(ValueError, match=r"expected \(5,\) or \(n, 5\)"):
        codegen.simulate_many(solver, 1.0, p=np.ones(4))
    with pytest.raises(ValueError, match="did you mean 'mass'"):
        codegen.simulate_many(solver, 1.0, p={"masss": np.ones(3)})
    with pytest.raises(ValueError, match="threads is 0"):
        codegen.simulate_many(solver, 1.0, p=np.ones((3, 5)), threads=0)
    with pytest.raises(ValueError, match="does not take on_failure"):
        codegen.simulate_many(solver, 1.0, p=np.ones((3, 5)), on_failure="return")
    motions = codegen.simulate_many(solver, 1.0, p={"stiffness": [1.0, 900.0]})
    with pytest.raises(ValueError, match="simulate them at given times"):
        motions["x"]
