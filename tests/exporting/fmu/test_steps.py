"""Steps of Co-Simulation of any size, several instances at once, and saved states of other instances and FMUs."""

from ctypes import c_double, c_uint

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

from fmpy.fmi1 import FMICallException
from fmu_units import Unit, model_file, solver_of

VERSIONS = pytest.mark.parametrize("version", ["3.0", "2.0"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Units of the model ``driven`` by version."""
    folder, known = tmp_path_factory.mktemp("driven"), {}

    def of(version):
        if version not in known:
            known[version] = Unit("driven", folder, version)
        return known[version]

    return of


INPUTS = {"way": 0.3, "way.rate": 3.0, "load": 1.0}


@VERSIONS
@pytest.mark.parametrize("h", [0.5, 2.0, 5.0])
def test_one_large_step_turns_a_prescribed_input_far(made, version, h, tmp_path):
    unit, solver = made(version), solver_of("driven", tmp_path, "simulate,outputs")
    ends = np.array([0.0, h])
    motion = solver.simulate(ends, inputs={"way": lambda t: 0.3 + 3.0 * t, "load": 1.0}, rtol=1e-11, atol=1e-11)
    of = unit.started(True, **INPUTS)
    of.doStep(0.0, h)
    assert unit.get(of, [f"q.{n}" for n in solver.coordinate_names]) == pytest.approx(motion.q[-1], abs=1e-7)
    assert unit.get(of, list(solver.output_names)) == pytest.approx(motion.outputs[-1], abs=1e-5)
    of.freeInstance()


@VERSIONS
def test_steps_below_the_rounding_of_time_change_nothing(made, version):
    unit = made(version)
    names = list(unit.exported.variables)
    of = unit.started(True, **INPUTS)
    of.doStep(0.0, 1.0)
    before = unit.get(of, names)
    for t, h in ((1.0, 1e-20), (1.0 - 1e-10, 5e-11), (1.0, 1e-17)):
        of.doStep(t, h)
        assert (unit.get(of, names) == before).all()
    rates = [names.index(f"der({kind}.bob)") for kind in "qu"]
    states = [names.index(f"{kind}.bob") for kind in "qu"]
    for h in (2.3e-16, 1e-15, 1e-12, 3e-12, 1e-11, 1e-8):
        t, start = unit.get(of, ["time"])[0], unit.get(of, names)
        of.doStep(t, h)
        assert unit.get(of, ["time"])[0] == t + h
        end = unit.get(of, names)
        assert np.abs(end - start)[states] == pytest.approx(np.abs(h * start[rates]), rel=1e-5, abs=1e-15)
        assert np.abs(end - before).max() <= 1e-5
    of.freeInstance()


@VERSIONS
def test_instances_do_not_disturb_each_other(made, version):
    unit = made(version)
    names = list(unit.exported.variables)
    alone = []
    for load in (1.0, -2.0):
        of = unit.started(True, **INPUTS | {"load": load})
        for n in range(4):
            of.doStep(0.1 * n, 0.1)
        alone.append(unit.get(of, names))
        of.freeInstance()
    both = [unit.started(True, **INPUTS | {"load": load}) for load in (1.0, -2.0)]
    exchange = unit.started(**INPUTS)
    for n in range(4):
        for of in both:
            of.doStep(0.1 * n, 0.1)
        unit.set(exchange, {"way": 0.1 * n})
        unit.get(exchange, names)
    for of, wanted in zip(both, alone, strict=True):
        assert (unit.get(of, names) == wanted).all()
        of.freeInstance()
    exchange.freeInstance()


@VERSIONS
def test_saved_states_of_others_are_refused(made, version, tmp_path, capfd):
    unit = made(version)
    (tmp_path / "driven.yaml").write_text(model_file("driven").read_text().replace("base: 1.1", "base: 1.12"))
    other = Unit("driven", tmp_path, version)

    def said():
        return capfd.readouterr().out + "".join(text for _, text in unit.messages + other.messages)

    of, exchange = unit.started(True, **INPUTS), unit.started(**INPUTS)
    state = of.getFMUState()
    with pytest.raises(FMICallException):
        exchange.setFMUState(state)
    assert "the saved state is that of an instance for Co-Simulation, but this instance is for Model Exchange" in said()
    text = bytes(of.serializeFMUState(state))
    changed = text[:-3] + bytes([text[-3] ^ 1]) + text[-2:]
    for at, wrong in ((unit.started(True), changed), (other.started(True), text)):
        with pytest.raises(FMICallException):
            getattr(at, "deserializeFMUState" if version == "3.0" else "deSerializeFMUstate")(wrong)
        assert "not a state that this FMU has serialized" in said()
    of.reset()
    of.setFMUState(state)  # a saved state outlives a reset
    assert unit.get(of, ["time", "load", "way"]) == pytest.approx([0.0, 1.0, 0.3])


@VERSIONS
@pytest.mark.parametrize("name", ["unit", "fmi3", "fmi2", "unit_state"])
def test_a_model_may_have_the_name_of_a_file_of_the_unit(version, name, tmp_path):
    text = "model: {}\nbodies:\n  rod: {{parent: ground, joint: {{type: prismatic, axis: z}}, mass: 2}}\n"
    (tmp_path / f"{name}.yaml").write_text(text.format(name) + "gravity: [0, 0, -2.0]\n")
    unit = Unit(name, tmp_path, version, energies=True)
    of = unit.started(True, **{"u.rod": 1.0})
    of.doStep(0.0, 1.0)
    found = unit.get(of, ["q.rod", "u.rod", "energy.kinetic", "energy.potential"])
    assert found == pytest.approx([0.0, -1.0, 1.0, 0.0], abs=1e-12)
    of.freeInstance()


@VERSIONS
def test_null_pointers_are_errors(made, version):
    unit = made(version)
    of = unit.started(**INPUTS)
    get, put = ("GetReal", "SetReal") if version == "2.0" else ("GetFloat64", "SetFloat64")
    sizes = () if version == "2.0" else (2,)
    state = "FMUstate" if version == "2.0" else "FMUState"
    references, values = (c_uint * 2)(1, 2), (c_double * 2)()

    def call(name, *arguments):
        with pytest.raises(FMICallException):
            getattr(of, f"fmi{version[0]}{name}")(of.component, *arguments)

    for name in (get, put):
        call(name, None, 2, values, *sizes)
        call(name, references, 2, None, *sizes)
    call("GetContinuousStates", None, 2)
    call("GetNominalsOfContinuousStates", None, 2)
    call("GetDirectionalDerivative", None, 2, references, 2, values, *sizes, values, *sizes)
    call("GetDirectionalDerivative", references, 2, references, 2, None, *sizes, values, *sizes)
    call(f"Get{state}", None)
    call(f"Set{state}", None)
    if version == "3.0":
        call("GetAdjointDerivative", references, 2, references, 2, values, 2, None, 2)
        assert {text for _, text in unit.messages} >= {"an array of 2 entries is a null pointer"}
    of.freeInstance()


def test_a_dead_point_ends_the_motion_with_a_message(tmp_path):
    """The FMU has one choice of independent coordinates: no call returns a state behind the dead point, at 0.15 s."""
    text = model_file("slider_crank").read_text().replace("independent: [wheel]", "independent: [piston]")
    (tmp_path / "stuck.yaml").write_text(text.replace("u: {wheel: 20.0}", "u: {piston: -2.0}"))
    unit = Unit("stuck", tmp_path, "3.0")
    of = unit.started(True, load=0.5)
    of.doStep(0.0, 0.14)
    t, stroke = unit.get(of, ["time", "q.piston"])
    assert t == 0.14
    with pytest.raises(FMICallException):
        of.doStep(0.14, 0.02)
    assert "at t = 0.153" in unit.messages[-1][1]
    assert "at a dead point; choose other independent coordinates" in unit.messages[-1][1]
    of = unit.started(load=0.5)  # Model Exchange: a piston farther out than the dead point is refused, not reflected
    of.enterContinuousTimeMode()
    of.setContinuousStates((c_double * 2)(stroke, -2.0), 2)
    unit.get(of, ["q.wheel"])
    with pytest.raises(FMICallException):
        of.setContinuousStates((c_double * 2)(stroke - 0.1, -2.0), 2)
        unit.get(of, ["q.wheel"])
    assert "the loops cannot be closed" in unit.messages[-1][1]
