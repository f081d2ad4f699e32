"""Derivatives of FMUs after each kind of change, and the dependencies that the model description lists."""

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

from fmu_units import Unit, solver_of

VERSIONS = pytest.mark.parametrize("version", ["3.0", "2.0"])
INPUTS = {"way": 0.1, "way.rate": 1.0, "load": 1.0}
CHANGED = {"crank_length": 0.5, "base": 0.9}


def errors(unit, of, solver, p, t):
    """Largest relative errors of rates, outputs and their derivatives with respect to all knowns, at an instance's state."""
    q = unit.get(of, [f"q.{n}" for n in solver.coordinate_names])
    u = unit.get(of, [f"u.{n}" for n in solver.speed_names])
    inputs = list(solver.input_names)
    at = {"p": p, "inputs": unit.get(of, inputs), "t": t}
    rate, entry = "der(u.bob)", list(solver.speed_names).index("bob")
    unknowns = [rate, *solver.output_names]
    found, wanted = [unit.get(of, unknowns)], [[solver.accelerations(q, u, **at)[entry], *solver.outputs(q, u, **at)]]
    kinds = {
        "dp": list(solver.parameter_names),
        "dinputs": inputs,
        "dq": [f"q.{n}" for n in solver.coordinate_names],
        "du": [f"u.{n}" for n in solver.speed_names],
        "dt": ["time"],
    }
    for seed, names in kinds.items():
        for i, name in enumerate(names):
            if seed in ("dq", "du") and name not in unit.exported.states:
                continue
            along = {seed: [1.0] if seed == "dt" else np.eye(len(names))[[i]]}
            found.append(unit.along(of, unknowns, [name], [1.0]))
            rates = solver.sensitivities(q, u, **at, **along)[1][0, entry]
            wanted.append([rates, *solver.output_sensitivities(q, u, **at, **along)[1][0]])
    scale = 1.0 + np.abs(wanted).max(axis=1, keepdims=True)
    return (np.abs(np.array(found) - wanted) / scale).max()


@VERSIONS
@pytest.mark.parametrize("integrates", [True, False])
def test_derivatives_follow_every_change(version, integrates, tmp_path):
    unit = Unit("driven", tmp_path, version, method="radau", energies=True)
    solver = solver_of("driven", tmp_path, "outputs,output_sensitivities,sensitivities,accelerations")
    of, t = unit.started(integrates, **INPUTS), 0.0
    assert errors(unit, of, solver, None, t) <= 1e-9
    if integrates:
        t = 0.3
        of.doStep(0.0, t)
        assert errors(unit, of, solver, None, t) <= 1e-9
    saved = of.getFMUState()
    unit.set(of, CHANGED)
    assert errors(unit, of, solver, CHANGED, t) <= 1e-9
    unit.set(of, {"way": 2.0})
    assert errors(unit, of, solver, CHANGED, t) <= 1e-9
    of.setFMUState(saved)
    assert errors(unit, of, solver, None, t) <= 1e-9
    of.reset()
    of.setFMUState(saved)
    assert errors(unit, of, solver, None, t) <= 1e-9
    of.freeFMUState(saved)
    of.freeInstance()


@VERSIONS
@pytest.mark.parametrize("name", ["driven", "timed"])
def test_what_the_description_does_not_list_has_no_influence(name, version, tmp_path):
    unit = Unit(name, tmp_path, version, energies=True)
    inputs = [v.name for v in unit.description.modelVariables if v.causality == "input"]
    of = unit.started(**dict.fromkeys(inputs, 0.1))
    knowns = [*inputs, "time", *unit.exported.states]
    left_out = 0
    for kind in ("outputs", "derivatives", "eventIndicators"):
        for unknown in getattr(unit.description, kind) or []:
            listed = {v.name for v in unknown.dependencies}
            rest = [n for n in knowns if n not in listed]
            left_out += len(rest)
            for n in rest:
                assert unit.along(of, [unknown.variable.name], [n], [1.0])[0] == 0.0, (unknown.variable.name, n)
    assert left_out > 0
    of.freeInstance()
