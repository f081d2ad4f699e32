"""Inputs of FMUs: prescribed motion, jumps, and the values at the end of a step."""

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

from fmu_units import Unit, solver_of
from scipy.interpolate import CubicSpline

TIMES = np.linspace(0.0, 1.0, 11)
RATES = ("way.rate", "way.acceleration")


def way(t):
    """A parabola over time, with its rate and acceleration."""
    return {"way": 0.3 + 2.0 * t + 1.5 * t * t, RATES[0]: 2.0 + 3.0 * t, RATES[1]: 3.0}


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return solver_of("driven", tmp_path_factory.mktemp("driven"), "simulate,outputs,accelerations")


@pytest.fixture(scope="module")
def motion(solver):
    ends = (1, way(0.0)[RATES[0]]), (1, way(1.0)[RATES[0]])
    signal = CubicSpline(TIMES, [way(t)["way"] for t in TIMES], bc_type=ends)
    return solver.simulate(TIMES, inputs={"way": signal, "load": 3.0}, rtol=1e-12, atol=1e-12)


def columns(solver):
    return [f"q.{n}" for n in solver.coordinate_names] + [f"u.{n}" for n in solver.speed_names] + list(
        solver.output_names
    )  # fmt: skip


@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize("again", [True, False])
def test_prescribed_inputs_continue_to_the_end_of_a_step(solver, motion, version, method, again, tmp_path):
    """`again`: the importer sets the inputs before each step, as for fmpy; otherwise the parabola continues."""
    unit = Unit("driven", tmp_path, version, method=method, energies=True)
    of = unit.started(True, load=3.0, **way(0.0))
    for n, t in enumerate(TIMES[:-1]):
        if again:
            unit.set(of, way(t))
        of.doStep(t, TIMES[1])
        wanted = np.concatenate([motion.q[n + 1], motion.u[n + 1], motion.outputs[n + 1]])
        assert np.abs(unit.get(of, columns(solver)) - wanted).max() <= 1e-8 * (1.0 + np.abs(wanted).max())
        assert unit.get(of, list(RATES[:1])) == pytest.approx(way(TIMES[n + 1])[RATES[0]], rel=1e-14)
    of.freeInstance()


def test_model_exchange_uses_inputs_with_their_rates(solver, motion, tmp_path):
    unit = Unit("driven", tmp_path, "3.0")
    of = unit.started(load=3.0, **way(0.0))
    of.updateDiscreteStates()
    of.enterContinuousTimeMode()
    for n, t in enumerate(TIMES[:4]):  # up to the event
        unit.set(of, way(t))
        of.setTime(t)
        state = np.array([motion.q[n, 2], motion.u[n, 2]])
        of.setContinuousStates(np.ctypeslib.as_ctypes(state), 2)
        inputs = {**way(t), "load": 3.0}
        rates = solver.accelerations(motion.q[n], motion.u[n], inputs=[inputs[i] for i in solver.input_names], t=t)
        assert unit.get(of, ["der(u.bob)"])[0] == pytest.approx(rates[2], rel=1e-9)
        wanted = np.concatenate([motion.q[n], motion.u[n], motion.outputs[n]])
        assert unit.get(of, columns(solver)) == pytest.approx(wanted, rel=1e-8, abs=1e-8)
    of.freeInstance()


def test_a_mechanism_stays_on_its_branch_when_a_prescribed_input_jumps(solver, tmp_path):
    unit = Unit("driven", tmp_path, "3.0")
    names = columns(solver)[:3]
    for to in (-7.0, 4.0, 6.0, 20.0):
        wanted, u = solver.initial
        for at in np.linspace(0.0, to, 400):
            wanted, u = solver.assemble(wanted, u, inputs=[at, 0.0, 0.0, 0.0])
        early, late = unit.started(True, way=to), unit.started(True)
        unit.set(late, {"way": to})
        for of in (early, late):
            assert np.abs(unit.get(of, names) - wanted).max() <= 1e-12
            of.freeInstance()


def test_a_mechanism_is_followed_to_a_start_later_than_zero(tmp_path):
    solver, unit = solver_of("late", tmp_path, "simulate,outputs"), Unit("late", tmp_path, "2.0")
    for start in (0.9, 1.2, 2.0, 2.3, 3.0):
        times = start + np.array([0.0, 0.1, 0.2])
        motion = solver.simulate(times, rtol=1e-11, atol=1e-11)
        of = unit.started(True, t=start)
        for n, t in enumerate(times):
            wanted = np.concatenate([motion.q[n], motion.u[n], motion.outputs[n]])
            assert unit.get(of, columns(solver)) == pytest.approx(wanted, rel=1e-7, abs=1e-7), (start, n)
            if n < 2:
                of.doStep(t, times[n + 1] - t)
        of.freeInstance()
