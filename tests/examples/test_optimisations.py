"""Example scripts that optimise and identify: their results, with equal gradients forward and by the adjoint."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import codegen

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def script():
    """An example script, imported as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLES))
        known = set(sys.modules)
        yield importlib.import_module
        for name in set(sys.modules) - known:
            if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == EXAMPLES:
                del sys.modules[name]


def solver_of(name, folder):
    """The solver of an example, with the functions that an optimisation calls."""
    functions = ("dynamics", "motion", "energies")
    return codegen.load(
        codegen.generate(EXAMPLES / f"{name}.yaml", folder / name, functions=functions, compile="all").folder
    )


def same_gradients(make, jacobian=False):
    """Check that gradients forward and by the adjoint agree at the start, also those of constraints."""
    found = []
    for method in ("forward", "adjoint"):
        f, several = make(method) if jacobian else (make(method), [])
        found.append([f.gradient(f.x0), *(c.jac(f.x0) for c in several)])
    for forward, adjoint in zip(*found, strict=True):
        assert forward == pytest.approx(adjoint, abs=1e-9 * np.abs(forward).max())


def is_written(draw, folder):
    """A figure is written, the same bytes twice."""
    first = draw(folder).read_bytes()
    assert first.startswith(b"<?xml") and len(first) > 10_000
    assert draw(folder).read_bytes() == first


def test_a_four_bar_learns_a_path(script, tmp_path):
    example = script("path_synthesis")
    solver = solver_of("coupler", tmp_path)
    same_gradients(lambda method: example.path_objective(solver, method))
    f, best = example.synthesise(solver, starts=1, maxiter=40)
    steps = [(f(f.x0 + h) - f(f.x0 - h)) / 2e-5 for h in 1e-5 * np.eye(10)]
    assert f.gradient(f.x0) == pytest.approx(steps, abs=1e-6), "with loops, and an initial value that closes them"
    assert best.fun < 0.02 * f(f.x0)
    after = f.simulate(best.x, example.TIMES)
    distances = np.hypot(after["x"] - example.X, after["y"] - example.Y)
    assert 0.5 * np.sum(distances**2) == pytest.approx(best.fun, rel=1e-6)
    is_written(lambda folder: example.draw(f, best, folder), tmp_path)


def test_a_double_pendulum_is_identified(script, tmp_path):
    example = script("identification")
    solver = solver_of("double_pendulum", tmp_path)
    experiments = example.measure(solver, seconds=2.0)
    fit = example.identify(solver, experiments)
    true = example.truth(solver)
    assert fit.success and len(fit.names) == 9
    assert all(abs(fit[name] - true[name]) < 3 * fit.deviation(name) for name in fit.names)
    assert 0.8 < fit.variance < 1.2
    masses = codegen.fit(
        solver,
        variables={**example.VARIABLES, "mass_1": None},
        p=example.GUESS,
        experiments=experiments,
        sigma=example.SIGMA,
    )
    (direction,) = masses.undetermined
    assert set(direction) == {"mass_1", "mass_2", "stiffness", "damping"}
    is_written(lambda folder: example.draw(solver, experiments, fit, folder), tmp_path)


def test_a_pole_is_swung_up(script, tmp_path):
    example = script("swing_up")
    solver = solver_of("swing_up", tmp_path)
    same_gradients(lambda method: (lambda f, c: (f, [c]))(*example.swing_up_problem(solver, method)), jacobian=True)
    f, best = example.swing_up(solver)
    end = f.simulate(best.x, [0, example.SECONDS])
    assert best.success
    assert [end[name][-1] for name in example.AIM] == pytest.approx(list(example.AIM.values()), abs=1e-5)
    assert best.outcome.functional_values[0] < 51 and np.abs(best.outcome.values).max() <= example.MOST
    is_written(lambda folder: example.draw(f, best, folder), tmp_path)


def test_andrews_mechanism_has_the_same_gradient_twice(script, tmp_path):
    example = script("andrews_gradients")
    solver = solver_of("andrews", tmp_path)
    assert solver.np == 42
    assert max(example.difference(solver, output) for output in ("E_x", "E_y")) < 1e-10
    assert example.seconds(solver, "adjoint", 8, repeat=1) > 0
    is_written(lambda folder: example.draw(solver, folder), tmp_path)


def test_a_suspension_gets_its_camber(script, tmp_path):
    example = script("suspension")
    solver = solver_of("double_wishbone", tmp_path)
    forward, adjoint = (example.camber_gradient(solver, method) for method in ("forward", "adjoint"))
    assert len(forward.names) == 33 and forward.method == "forward" and adjoint.method == "adjoint"
    assert forward.gradients == pytest.approx(adjoint.gradients, abs=1e-10 * np.abs(forward.gradients).max())
    same_gradients(lambda method: example.camber_objective(solver, method))
    f, best = example.design(solver, maxiter=5)
    assert best.fun < 0.1 * f(f.x0)
    is_written(lambda folder: example.draw(solver, f, best, folder), tmp_path)


def test_an_excavator_lifts_its_load(script, tmp_path):
    example = script("excavator_lift")
    solver = solver_of("excavator", tmp_path)
    same_gradients(lambda method: example.lift_problem(solver, method), jacobian=True)
    f, best = example.lift(solver)
    end = f.simulate(best.x, [0, example.SECONDS])
    assert [end[name][-1] for name in example.PLACE] == pytest.approx(list(example.PLACE.values()), abs=1e-4)
    assert end["kinetic"][-1] < example.REST + 1
    gain = float(np.diff(end.energy.sum(axis=1))[0])
    assert gain < best.outcome.functional_values[0] < 1.5 * gain, "little is lost beside the lift"
    is_written(lambda folder: example.draw(f, best, folder), tmp_path)
