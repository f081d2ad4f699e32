"""Warnings about states that do not close the loops, given by name or as an array."""

import warnings
from types import MappingProxyType

import numpy as np
import pytest
from loops.test_following import FOUR_BAR

import codegen

OPEN = "does not close the loops"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("open") / "four_bar"
    functions = "accelerations,sensitivities,energies,energy_sensitivities"
    return codegen.generate(codegen.parse_model(FOUR_BAR), folder, functions=functions).folder


@pytest.fixture(params=["c", "numpy"])
def four_bar(folder, request):
    return codegen.load(folder, target=request.param)


def silently(call, *given, **named):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return call(*given, **named)


def test_coordinates_by_name_or_as_a_list_and_parameters_by_name(four_bar):
    q, u = four_bar.initial
    told = r"does not close the loops: condition pin\.l\d is open by [\d.]+ rad or char.*; call assemble first"
    with pytest.warns(RuntimeWarning, match=told):
        four_bar.accelerations({"driver": 1.0}, u)
    with pytest.warns(RuntimeWarning, match=told):
        four_bar.accelerations([1.0, *q[1:]], u)
    with pytest.warns(RuntimeWarning, match=told):
        four_bar.sensitivities(q, u, {"b": 0.12}, dp={"b": 1.0})
    with pytest.warns(RuntimeWarning, match=told):
        four_bar.mass_matrix(q, {"b": 0.12})
    with pytest.warns(RuntimeWarning, match=r"loops \(state \[1\] of the batch\): condition pin"):
        four_bar.energies({"driver": [0.6, 1.0, 0.6]}, u)


def test_closed_states_and_arrays_are_not_reported(four_bar):
    """Arrays may come from assembly, and a test of each would take longer than the function itself."""
    q, u = four_bar.initial
    silently(four_bar.accelerations, list(q), u)
    silently(four_bar.accelerations, {"driver": q[0]}, u)
    silently(four_bar.accelerations, q + 1e-5, u, {"b": 0.11})
    silently(four_bar.accelerations, [1.0, *q[1:]] + 0 * q, u)
    p = {"b": 0.12}
    silently(four_bar.accelerations, *four_bar.assemble({"driver": 1.0}, p=p), p)
    silently(four_bar.assemble, {"driver": 1.0})
    silently(four_bar.closure, {"driver": 1.0}, u)


def test_dependent_coordinates_alone_are_guesses(four_bar):
    q, _ = four_bar.initial
    with pytest.warns(
        RuntimeWarning, match=r"rocker is a dependent coordinate, so -1\.2 is a guess, and it becomes .*\(driver\)"
    ):
        assert four_bar.assemble({"rocker": -1.2})[0][0] == q[0]
    silently(four_bar.assemble, {"rocker": q[2]})
    silently(four_bar.assemble, {"driver": 0.7, "rocker": -1.2})


def test_bad_numbers_are_still_errors(four_bar):
    with pytest.raises(ValueError, match="'drivr' is not known"):
        four_bar.accelerations({"drivr": 1.0}, np.zeros(3))
    with pytest.raises(ValueError, match=r"q has shape \(2,\)"):
        four_bar.accelerations([1.0, 2.0], np.zeros(3))


@pytest.mark.parametrize("mapping", [dict, MappingProxyType])
def test_every_call_is_tested(four_bar, mapping):
    q, u = four_bar.initial
    for _ in range(200):
        four_bar.accelerations(q, u)
    for _ in range(2):
        with pytest.warns(RuntimeWarning, match=OPEN):
            four_bar.accelerations(mapping({"driver": 1.0}), u)
        with pytest.warns(RuntimeWarning, match=OPEN):
            four_bar.accelerations(q, u, mapping({"b": 0.12}))
        with pytest.warns(RuntimeWarning, match=OPEN):
            four_bar.accelerations([1.0, *q[1:]], u)


def test_a_condition_that_no_joint_can_meet_is_left_to_assembly(tmp_path):
    """A hinge that is shifted along its axis opens a redundant condition: assembly cannot help."""
    text = FOUR_BAR.replace("d: 0.10}", "d: 0.10, off: 0}").replace("at: [d, 0, 0]", "at: [d, 0, off]")
    codegen.generate(codegen.parse_model(text), tmp_path / "four_bar", target="numpy", functions="accelerations")
    solver = codegen.load(tmp_path / "four_bar")
    q, u = solver.initial
    silently(solver.accelerations, q, u, {"off": 0.01})
    with pytest.warns(RuntimeWarning, match=OPEN):
        solver.accelerations({"driver": 1.0}, u, {"off": 0.01})
