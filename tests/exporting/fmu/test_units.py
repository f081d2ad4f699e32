"""Exported FMUs in fmpy are valid, simulate like the solver, and have the solver's derivatives bit for bit."""

import re
import zipfile
from ctypes import c_double, c_uint

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from fmu_units import Unit, model_file, solver_of

import codegen
from codegen.exporting.fmu.description import _base_unit

FUNCTIONS = "accelerations,sensitivities,gradients,outputs,output_sensitivities,coordinate_rate_sensitivities,simulate"
MODELS = ("four_bar", "bouncer", "satellite")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Units and solvers by model and version, made once."""
    folder, known = tmp_path_factory.mktemp("fmu"), {}

    def of(name, version=None):
        if (name, version) not in known:
            known[name, version] = Unit(name, folder, version) if version else solver_of(name, folder, FUNCTIONS)
        return known[name, version]

    return of


def columns(solver, trajectory):
    """A motion as a mapping from the names of variables to columns."""
    found = {f"q.{n}": trajectory.q[:, i] for i, n in enumerate(solver.coordinate_names)}
    found |= {f"u.{n}": trajectory.u[:, i] for i, n in enumerate(solver.speed_names)}
    return found | {n: trajectory.outputs[:, i] for i, n in enumerate(solver.output_names)}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_an_fmu_is_valid_and_moves_as_simulate_does(made, name, version):
    unit, solver = made(name, version), made(name)
    assert validate_fmu(str(unit.file)) == []
    times = np.linspace(0.0, 1.0, 11)
    wanted = columns(solver, solver.simulate(times))
    for kind, tolerance, bound in (("CoSimulation", 1e-9, 1e-8), ("ModelExchange", 1e-10, 1e-6)):
        found = fmpy.simulate_fmu(
            str(unit.file),
            fmi_type=kind,
            stop_time=1.0,
            output_interval=0.1,
            relative_tolerance=tolerance,
            output=list(wanted),
        )
        rows = [np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[-1] for t in times]
        for column, values in wanted.items():
            assert np.abs(found[column][rows] - values).max() <= bound * (1.0 + np.abs(values).max()), (kind, column)


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("N*m/rad**2", {"kg": "1", "m": "2", "s": "-2", "rad": "-2"}), ("rad^2", {"rad": "2"}),
        ("kg  m^2", {}), ("mm", {}), ("apples & <pears>", {}), ("m/s", {"m": "1", "s": "-1"}),
    ],
)  # fmt: skip
def test_units_have_the_exponents_of_their_si_units(unit, exponents):
    assert _base_unit(unit) == exponents


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_are_those_of_the_solver_bit_for_bit(made, name):
    unit, solver = made(name, "3.0"), made(name)
    of = unit.started()
    q = unit.get(of, [f"q.{n}" for n in solver.coordinate_names])
    u = unit.get(of, [f"u.{n}" for n in solver.speed_names])
    rates = [n for n in unit.exported.variables if n.startswith("der(u.")]
    entries = [solver.speed_names.index(n[6:-1]) for n in rates]
    assert (unit.get(of, rates) == solver.accelerations(q, u)[entries]).all()
    own = {
        "dq": [f"q.{n}" for n in solver.independent_names], "du": [f"u.{n}" for n in solver.independent_speed_names],
        "dp": list(solver.parameter_names), "dinputs": list(solver.input_names),
    }  # fmt: skip
    sizes = {
        "dq": solver.coordinate_names,
        "du": solver.speed_names,
        "dp": solver.parameter_names,
        "dinputs": solver.input_names,
    }
    weights = np.linspace(1.0, 2.0, len(rates))
    whole = np.zeros(solver.nu)
    whole[entries] = weights
    gradients = solver.gradients(q, u, weights=whole)
    for seed, names in own.items():
        places = [list(sizes[seed]).index(n[2:] if seed in ("dq", "du") else n) for n in names]
        for n, place in zip(names, places, strict=True):
            direction = np.zeros((1, len(sizes[seed])))
            direction[0, place] = 1.0
            wanted = solver.sensitivities(q, u, **{seed: direction})[1][0, entries]
            assert (unit.along(of, rates, [n], [1.0]) == wanted).all(), n
            if solver.output_names:
                wanted = solver.output_sensitivities(q, u, **{seed: direction})[1][0]
                assert (unit.along(of, list(solver.output_names), [n], [1.0]) == wanted).all(), n
        if names:
            wanted = np.asarray(getattr(gradients, seed[1:]))[0, places]
            assert (unit.adjoint(of, rates, names, list(weights)) == wanted).all(), seed
    of.freeInstance()


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_directional_and_adjoint_derivatives_of_all_variables_agree(made, version):
    """Dependent coordinates, speeds, rates, outputs and event indicators, by states, parameters, inputs and time."""
    for name in ("four_bar", "bouncer"):
        unit = made(name, version)
        of = unit.started(**{unit.exported.states[-1]: 1.7})
        causality = {v.name: v.causality for v in unit.description.modelVariables}
        unknowns = [n for n, c in causality.items() if c in ("local", "output")]
        knowns = [n for n, c in causality.items() if c in ("parameter", "input", "independent")] + list(
            unit.exported.states
        )
        random = np.random.default_rng(3)
        v, w = random.normal(size=len(knowns)), random.normal(size=len(unknowns))
        along = unit.along(of, unknowns, knowns, list(v))
        each = np.array([unit.along(of, unknowns, [n], [1.0]) for n in knowns]).T
        assert np.abs(each @ v - along).max() <= 1e-13 * np.abs(each).max() * np.abs(v).sum()
        assert np.abs(each).max(axis=1).min() > 0.0  # every unknown depends on something
        if version == "3.0":
            back = unit.adjoint(of, unknowns, knowns, list(w))
            assert np.abs(each.T @ w - back).max() <= 1e-13 * np.abs(each).max() * np.abs(w).sum()
        of.freeInstance()


def test_parameters_change_closure_before_and_after_initialisation(made):
    unit, solver = made("four_bar", "3.0"), made("four_bar")
    p = {"coupler_length": 1.3, "crank_length": 0.3}
    of = unit.started(**p, **{"q.crank": 2.9})
    names = [f"q.{n}" for n in solver.coordinate_names]
    start = np.array(solver.initial[0])
    for crank in np.linspace(start[0], 2.9, 40)[1:]:  # small steps stay on the branch
        start[0] = crank
        start, u = solver.assemble(start, solver.initial[1])
    wanted, _ = solver.assemble(start, u, p=p)
    assert np.abs(unit.get(of, names) - wanted).max() <= 1e-12
    unit.set(of, {"coupler_length": 1.25})  # tunable, in Event Mode
    wanted, _ = solver.assemble(wanted, u, p=p | {"coupler_length": 1.25})
    assert np.abs(unit.get(of, names) - wanted).max() <= 1e-12
    of.freeInstance()


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_states_are_saved_and_restored_with_their_bytes(made, version):
    unit = made("four_bar", version)
    of, other = unit.started(integrates=True), unit.instance(integrates=True)
    names = list(unit.exported.variables)
    for n in range(3):
        of.doStep(0.1 * n, 0.1)
    state = of.getFMUState()
    text = of.serializeFMUState(state)
    of.doStep(0.3, 0.1)
    end = unit.get(of, names)
    of.setFMUState(state)
    of.doStep(0.3, 0.1)
    assert (unit.get(of, names) == end).all()
    found = getattr(other, "deserializeFMUState" if version == "3.0" else "deSerializeFMUstate")(text)
    other.setFMUState(found)
    other.doStep(0.3, 0.1)
    assert (unit.get(other, names) == end).all()
    for x, s in ((of, state), (other, found)):
        x.freeFMUState(s)
        x.freeInstance()


def refused(unit, words, call, *arguments):
    """Check that a call ends with an error and a message."""
    unit.messages.clear()
    with pytest.raises(FMICallException):
        call(*arguments)
    assert unit.version == "2.0" or any(words in text for _, text in unit.messages), unit.messages


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_wrong_calls_are_errors_with_a_message(made, version, capfd):
    unit = made("four_bar", version)
    of = unit.started()
    refused(unit, "is computed and cannot be set", unit.set, of, {"q.coupler": 1.0})
    refused(unit, "can be set before initialisation ends", unit.set, of, {"q.crank": 1.0})
    refused(unit, "the value of motor is not finite", unit.set, of, {"motor": float("nan")})
    refused(unit, "expected 2, one for each continuous state", of.getContinuousStates, (c_double * 3)(), 3)
    refused(unit, "no derivatives with respect to q.coupler", unit.along, of, ["trace_x"], ["q.coupler"], [1.0])
    refused(unit, "motor has no derivatives", unit.along, of, ["motor"], ["q.crank"], [1.0])
    unit.numbers["nothing"] = 1000
    refused(unit, "no variable with the value reference 1000", unit.get, of, ["nothing"])
    early = (of.setContinuousStates, (c_double * 2)(), 2) if version == "3.0" else (of.enterInitializationMode,)
    refused(unit, "must not be called in the state Event Mode", *early)
    of.enterContinuousTimeMode()
    refused(unit, "but not in Continuous-Time Mode", unit.set, of, {"base": 1.2})
    of.setContinuousStates((c_double * 2)(0.8, 3.0), 2)
    refused(unit, "the time is not finite", of.setTime, float("inf"))
    of.freeInstance()
    of = unit.started(integrates=True)
    refused(unit, "expected a positive number", of.doStep, 0.0, 0.0)
    refused(unit, "but the instance is at", of.doStep, 0.5, 0.1)
    of.doStep(0.0, 0.1)
    of.freeInstance()
    of = unit.instance()
    unit.set(of, {"rocker_length": 0.1})  # too short to close
    (of.setupExperiment if version == "2.0" else lambda: None)()
    of.enterInitializationMode()
    refused(unit, "the loops cannot be closed", of.exitInitializationMode)
    of.freeInstance()


def test_capabilities_that_are_lacking_are_reported(made):
    unit = made("four_bar", "3.0")
    of = unit.started()
    refused(unit, "variables of type Boolean: this FMU has no such capability", of.getBoolean, [1])
    refused(unit, "fmi3EnterConfigurationMode", of.enterConfigurationMode)
    refused(
        unit,
        "1 values for 2 scalar variables",
        of.fmi3GetFloat64,
        of.component,
        (c_uint * 2)(1, 2),
        2,
        (c_double * 1)(),
        1,
    )
    of.freeInstance()
    unit.description.guid = "another"
    with pytest.raises(Exception, match=r"[Ii]nstantiate"):
        unit.instance()
    assert "the instantiation token is another, expected {" in unit.messages[-1][1]


def test_equal_models_give_equal_bytes_and_names_of_files_are_those_of_the_standard(made, tmp_path):
    one, two = (
        codegen.export_fmu(model_file("bouncer"), tmp_path / f"{n}.fmu", platforms="none").file.read_bytes()
        for n in "ab"
    )
    assert one == two
    with zipfile.ZipFile(made("bouncer", "3.0").file) as archive:
        listed = archive.namelist()
    assert {"modelDescription.xml", "sources/buildDescription.xml", "sources/bouncer.c"} < set(listed)
    assert [n for n in listed if re.fullmatch(r"binaries/\w+-\w+/bouncer\.\w+", n)]
