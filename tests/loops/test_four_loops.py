"""Accelerations and derivatives of four loops, exact to rounding with dependents that are chosen together."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
from loop_closure import assemble

import codegen
from codegen.loops import AssemblyError, partition
from codegen.reference import RecursiveEngine


@pytest.fixture(scope="module")
def model():
    return codegen.load_model(Path(__file__).parent / "four_loops.yaml")


def states(model, count):
    """Assembled states around the initial one, with seeds of two directions."""
    rng, found = np.random.default_rng(11), partition(model)
    made = []
    while len(made) < count:
        try:
            q = assemble(model, found, np.array(found.q) + 0.15 * rng.normal(size=model.nq))
        except AssemblyError:
            continue
        seeds = {name: rng.normal(size=(2, n)) for name, n in (("dq", model.nq), ("du", model.nu), ("dp", 7))}
        made.append((q, rng.normal(size=model.nu), seeds))
    return made


def errors(given, exact):
    """Largest error over the directions, each relative to its largest entry."""
    return max(
        float(max(abs(x - y) for x, y in zip(a, b, strict=True)) / max(abs(y) for y in b))
        for a, b in zip(np.atleast_2d(given), np.atleast_2d(exact), strict=True)
    )


def compared(solve, model, count):
    exact = RecursiveEngine(model, numbers="mpmath")
    for q, u, seeds in states(model, count):
        with mpmath.workdps(34):
            udot, dudot = exact.sensitivities(q, u, None, None, 0.3, **seeds)
        found, dfound = solve(q, u, None, None, 0.3, **seeds)
        yield errors(found, udot), errors(dfound, dudot)


def test_the_recursion_is_exact_to_rounding(model):
    for udot, dudot in compared(RecursiveEngine(model).sensitivities, model, 1):
        assert udot < 1e-12
        assert dudot < 1e-11


@pytest.fixture(scope="module")
def generated(model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("four_loops") / "four_loops"
    codegen.generate(model, folder)
    return folder


@pytest.mark.campaign
@pytest.mark.parametrize("target", ["c", "numpy"])
def test_the_generated_solvers_are_exact_to_rounding_at_twenty_states(model, generated, target):
    solver = codegen.load(generated, target)
    for udot, dudot in compared(solver.sensitivities, model, 20):
        assert udot < 1e-12
        assert dudot < 1e-11
