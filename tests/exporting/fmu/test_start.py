"""Initialisation of FMUs: initial values that follow parameters, their derivatives, tolerance and stop time."""

from ctypes import c_double

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

from fmpy.fmi1 import FMICallException
from fmu_units import Unit, solver_of

VERSIONS = pytest.mark.parametrize("version", ["3.0", "2.0"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Units of the model ``closing`` by version, and its solver."""
    folder, known = tmp_path_factory.mktemp("closing"), {}

    def of(version):
        if version not in known:
            known[version] = Unit("closing", folder, version)
        return known[version]

    return of, solver_of("closing", folder, "simulate,outputs,initial_sensitivities,output_sensitivities")


def said(unit, capfd):
    """The messages of an FMU: fmpy prints those of FMI 2.0."""
    return capfd.readouterr().out + "".join(text for _, text in unit.messages)


@VERSIONS
def test_initial_values_that_close_no_loop_follow_parameters_as_in_simulate(made, version):
    unit, solver = made[0](version), made[1]
    names = [f"{kind}.{n}" for kind in "qu" for n in solver.coordinate_names]
    for p in ({}, {"angle": 0.52}, {"angle": 0.47, "rocker_length": 0.93}):
        q, u = solver.initial_state(p)
        of = unit.started(**p)
        assert np.abs(unit.get(of, names) - np.concatenate([q, u])).max() <= 1e-12, p
        of.freeInstance()


@VERSIONS
def test_derivatives_before_initialisation_ends_follow_the_initial_values(made, version):
    """By parameters: in total. Once the importer has set a state, it no longer follows them."""
    unit, solver = made[0](version), made[1]
    of = unit.initializing()
    unknowns = [f"{kind}.{n}" for kind in "qu" for n in solver.coordinate_names]
    parameters = list(solver.parameter_names)
    q, u, dq, du = solver.initial_sensitivities(dp=np.eye(len(parameters)))
    found = np.array([unit.along(of, unknowns, [n], [1.0]) for n in parameters])
    assert np.abs(found - np.hstack([dq, du])).max() <= 1e-11 * np.abs(found).max()
    assert np.abs(found[parameters.index("angle")]).min() > 0.1
    if version == "3.0":
        weights = np.linspace(1.0, 2.0, len(unknowns))
        back = unit.adjoint(of, unknowns, parameters, list(weights))
        assert np.abs(back - found @ weights).max() <= 1e-12 * np.abs(found).sum()
    rates = ["der(u.crank)", "swing"]
    total = unit.along(of, rates, ["angle"], [1.0])
    parts = unit.along(of, rates, ["q.crank", "u.crank"], [4.0, 2.0])
    assert total == pytest.approx(parts, rel=1e-12) and np.abs(total).min() > 0.1
    unit.set(of, {"q.crank": q[0], "u.crank": u[0]})
    assert (unit.along(of, rates, ["angle"], [1.0]) == 0.0).all()
    of.exitInitializationMode()
    assert (unit.along(of, rates, ["angle"], [1.0]) == 0.0).all()
    of.freeInstance()


@VERSIONS
@pytest.mark.parametrize(("tolerance", "used"), [(-1.0, 1e-9), (0.0, 1e-9), (float("nan"), 1e-9), (1e-20, 1e-14)])
def test_a_wrong_tolerance_is_replaced_with_a_warning(made, version, tolerance, used, capfd):
    unit = made[0](version)
    unit.messages.clear()
    of = unit.started(True, times={"tolerance": tolerance})
    assert f"the tolerance is {tolerance:g}, expected 1e-14 or more; {used:g} is used instead" in said(unit, capfd)
    of.doStep(0.0, 0.1)
    other = unit.started(True, times={"tolerance": used})
    other.doStep(0.0, 0.1)
    names = list(unit.exported.variables)
    assert (unit.get(of, names) == unit.get(other, names)).all()
    of.freeInstance()
    other.freeInstance()


@VERSIONS
def test_no_step_passes_the_stop_time(made, version, capfd):
    unit = made[0](version)
    unit.messages.clear()
    of = unit.started(True, times={"stopTime": 0.3})
    for n in range(3):
        of.doStep(0.1 * n, 0.1)  # 0.1 + 0.2 is above 0.3
    with pytest.raises(FMICallException):
        of.doStep(0.3, 0.1)
    assert "the step ends at 0.4 s, after the stop time 0.3 s" in said(unit, capfd)
    of.freeInstance()
    with pytest.raises(FMICallException):
        unit.initializing(t=1.0, times={"stopTime": 0.5})
    assert "the stop time is 0.5 s, expected a time after the start at 1 s" in said(unit, capfd)


HANGING = """
model: hanging
gravity: [0, 0, -9.81]
parameters: {k: 20.0}
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: y}, mass: 1.0, com: [0, 0, -1.0]}
forces:
  spring: {type: joint, joint: rod, value: "k*(0.5 - q.rod)"}
initial: {equilibrium: true}
"""


@VERSIONS
def test_an_equilibrium_that_does_not_follow_parameters_is_a_warning(version, tmp_path, capfd):
    (tmp_path / "hanging.yaml").write_text(HANGING)
    unit = Unit("hanging", tmp_path, version)
    of = unit.started()
    assert abs(unit.get(of, ["der(u.rod)"])[0]) <= 1e-9
    assert "equilibrium" not in said(unit, capfd)
    unit.started(k=30.0)
    assert "the motion starts in the equilibrium of the default parameters" in said(unit, capfd)
    unit.messages.clear()
    unit.started(k=30.0, **{"q.rod": 0.4})
    assert "equilibrium" not in said(unit, capfd)
    of.freeInstance()


@VERSIONS
def test_an_integrator_may_try_states_that_cannot_be_reached(made, version):
    """Their status is "discard", and the unit goes on from the last state."""
    unit = made[0](version)
    of = unit.started()
    (of.newDiscreteStates if version == "2.0" else of.updateDiscreteStates)()
    of.enterContinuousTimeMode()
    names = list(unit.exported.variables)
    before, states = unit.get(of, names), (c_double * 2)()
    of.getContinuousStates(states, 2)
    of.setContinuousStates((c_double * 2)(2.0, 1.0), 2)
    rates = of.getDerivatives if version == "2.0" else of.getContinuousStateDerivatives
    with pytest.raises(FMICallException) as found:
        rates((c_double * 2)(), 2)
    assert found.value.status == 2
    of.setContinuousStates(states, 2)
    assert unit.get(of, names) == pytest.approx(before, rel=1e-12, abs=1e-12)
    of.enterEventMode()
    unit.set(of, {"rocker_length": 0.1})
    with pytest.raises(FMICallException) as found:
        unit.get(of, names)
    assert found.value.status == 3
    of.freeInstance()
