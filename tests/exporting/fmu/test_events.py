"""Events of Model Exchange at times that are known in advance."""

import itertools
from ctypes import c_double

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

import fmpy
from fmu_units import Unit, solver_of

VERSIONS = pytest.mark.parametrize("version", ["3.0", "2.0"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, known = tmp_path_factory.mktemp("timed"), {}

    def of(version):
        if version not in known:
            known[version] = Unit("timed", folder, version)
        return known[version]

    return of


def next_event(unit, of):
    """The time of the next event that an instance reports, or None."""
    found = of.newDiscreteStates() if unit.version == "2.0" else of.updateDiscreteStates()
    return found[5] if found[4] else None


def enter(unit, of, t):
    of.enterContinuousTimeMode()
    of.setTime(t)
    of.enterEventMode()


@VERSIONS
def test_times_of_events_are_announced_one_after_the_other(made, version):
    """Pieces of motion, tables, and expressions of parameters; a time that an input or a sine determines is not known."""
    unit = made(version)
    assert unit.exported.indicators == 3  # place, late, sin(9*t)
    for w, start in ((2.0, 0.4), (4.0, 3.0)):
        of = unit.started(w=w, start=start, late=0.7)
        times, found = sorted([start / w, 0.3, 0.5, 0.6, 0.9]), []
        for _ in range(10):
            found.append(next_event(unit, of))
            if found[-1] is None:
                break
            enter(unit, of, found[-1])
        assert found[:-1] == pytest.approx(times, rel=1e-15)
        assert found[-1] is None
        of.freeInstance()


@VERSIONS
def test_forces_change_at_the_announced_time_and_not_before(made, version):
    unit = made(version)
    of = unit.started(late=5.0)
    assert next_event(unit, of) == 0.2
    of.enterContinuousTimeMode()
    rates = []
    for t in (0.2 - 1e-13, 0.2, 0.2 + 1e-13):  # the branch is held also behind the event
        of.setTime(t)
        rates.append(unit.get(of, ["der(u.rod)"])[0])
    assert np.ptp(rates) <= 1e-10
    of.setTime(0.2)
    of.enterEventMode()
    assert next_event(unit, of) == 0.3
    jump = unit.get(of, ["der(u.rod)"])[0] - rates[1]
    assert jump == pytest.approx(2.0 / 1.1, rel=1e-12)
    unit.set(of, {"start": 0.8})  # a parameter shifts the event
    assert next_event(unit, of) == 0.3
    assert unit.get(of, ["der(u.rod)"])[0] == pytest.approx(rates[1], rel=1e-12)
    of.freeInstance()


@VERSIONS
@pytest.mark.parametrize("t", [1e3, 123456.789, 1e7])
def test_late_events_are_reached_once(version, t, tmp_path):
    """Rounding errors of a large time neither repeat an event nor leave it out."""
    text = "model: late_jumps\nparameters: {start: 1.0, w: 0.1}\nbodies:\n"
    text += "  ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}\n"
    text += 'forces:\n  push: {type: joint, joint: ball, value: "sign(w*(t - start))"}\n'
    (tmp_path / "late_jumps.yaml").write_text(text)
    unit = Unit("late_jumps", tmp_path, version)
    for shift, w in itertools.product((0.0, 1.0 / 3.0, 0.7), (0.1, 3.3, 1e-3)):
        of = unit.started(start=t + shift, w=w, t=t - 1.0)
        at = next_event(unit, of)
        assert at == pytest.approx(t + shift, rel=1e-15)
        assert unit.get(of, ["der(u.ball)"]) == [-1.0]
        enter(unit, of, at)
        assert next_event(unit, of) is None
        assert unit.get(of, ["der(u.ball)"]) == [1.0]
        of.freeInstance()


@VERSIONS
def test_model_exchange_and_co_simulation_move_as_simulate_does(made, version, tmp_path):
    solver = solver_of("timed", tmp_path, "simulate,outputs")
    times = np.linspace(0.0, 1.2, 7)
    motion = solver.simulate(times, inputs=[0.7], rtol=1e-12, atol=1e-12)
    for kind, bound in (("ModelExchange", 1e-7), ("CoSimulation", 1e-9)):
        found = fmpy.simulate_fmu(
            str(made(version).file),
            fmi_type=kind,
            stop_time=1.2,
            output_interval=0.2,
            relative_tolerance=1e-11,
            start_values={"late": 0.7},
            output=["q.rod", "u.rod"],
        )
        rows = [np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[-1] for t in times]
        assert np.abs(found["q.rod"][rows] - motion.q[:, -1]).max() <= bound, kind
        assert np.abs(found["u.rod"][rows] - motion.u[:, -1]).max() <= bound, kind


TURNING = """
model: turning
parameters: {k: 3.0}
bodies:
  wheel: {parent: ground, joint: {type: revolute, axis: z}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  spring: {type: torsion, from: ground, to: wheel, axis: z, stiffness: k, damping: 0.1}
initial: {q: {wheel: 1.0}, u: {wheel: 8.0}}
"""


@VERSIONS
def test_the_indicator_of_a_turning_spring_and_its_derivative(version, tmp_path):
    """The angle of a spring jumps at half a turn, where the indicator pi^2 - angle^2 changes its sign."""
    (tmp_path / "turning.yaml").write_text(TURNING)
    unit = Unit("turning", tmp_path, version)
    name = "event_indicator[1]"
    for integrates in (True, False):
        for angle in (1.0, 3.1, -2.0):
            of = unit.started(integrates, **{"q.wheel": angle})
            if not integrates:
                next_event(unit, of)
                found = (c_double * 1)()
                of.getEventIndicators(found, 1)
                assert found[0] == unit.get(of, [name])[0]
            assert unit.get(of, [name]) == pytest.approx(np.pi**2 - angle**2, rel=1e-14)
            assert unit.along(of, [name], ["q.wheel"], [1.0]) == pytest.approx(-2.0 * angle, rel=1e-14)
            if version == "3.0":
                assert unit.adjoint(of, [name], ["q.wheel"], [3.0]) == pytest.approx(-6.0 * angle, rel=1e-14)
            of.freeInstance()
    solver = solver_of("turning", tmp_path, "simulate")
    times = np.linspace(0.0, 1.0, 6)
    motion = solver.simulate(times, rtol=1e-12, atol=1e-12)
    assert np.ptp(motion.q) > 5.0
    for kind in ("ModelExchange", "CoSimulation"):
        found = fmpy.simulate_fmu(
            str(unit.file),
            fmi_type=kind,
            stop_time=1.0,
            output_interval=0.2,
            relative_tolerance=1e-11,
            output=["q.wheel"],
        )
        rows = [np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[-1] for t in times]
        assert np.abs(found["q.wheel"][rows] - motion.q[:, 0]).max() <= 1e-7
