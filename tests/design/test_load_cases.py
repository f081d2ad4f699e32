"""One design for several motions: sums of objectives against closed forms."""

import numpy as np
import pytest
from oscillator import oscillator, swing
from scipy.optimize import check_grad

import codegen
from codegen.runtime import At, AtEvent, Event, Final, SimulationError

VARIABLES = {"stiffness": codegen.Variable(2.0, 20.0, start=8.0), "start": codegen.Variable(start=0.5, scale=0.1)}
MASSES = 2.0, 1.0


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return oscillator(tmp_path_factory.mktemp("cases"))


def cases(solver, **options):
    return [codegen.objective(solver, 3.0, Final("x"), VARIABLES, p={"mass": m}, **options) for m in MASSES]


@pytest.mark.parametrize("method", ["forward", "adjoint"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_sum_is_that_of_closed_forms(solver, method, threads):
    f = codegen.load_cases(cases(solver, method=method), weights=[2.0, -0.5], threads=threads)
    x = f.variables.x({"stiffness": 5.0, "start": 0.7})
    value, gradient = f.value_and_gradient(x)
    (one, by_one), (other, by_other) = (swing(3.0, m, 5.0, 0.7) for m in MASSES)
    assert value == pytest.approx(2 * one - other / 2, abs=1e-8)
    expected = np.array([2 * by_one[n] - by_other[n] / 2 for n in VARIABLES])
    assert gradient == pytest.approx(expected * f.variables.scale, abs=1e-7)
    assert f(x) == value and np.array_equal(f.gradient(x), gradient)
    assert f.motions == 2, "value and gradient at one x are one motion of each case"
    result = f.result(x)
    assert result.value == value and result.gradient == pytest.approx(expected, abs=1e-7)
    assert result.functional_values == pytest.approx([one, other], abs=1e-8) and result.motions == 2
    assert check_grad(f, f.gradient, x) < 1e-5
    assert repr(f).startswith("2 load cases\n  2 times: Objective of oscillator")


def test_a_compromise_is_found_under_a_constraint_of_one_case(solver):
    """The start that brings both masses nearest to given places: least squares of two cosines, by hand."""
    goals = 0.3, -0.1
    several = [
        codegen.objective(
            solver, 1.0, Final("x"), {"start": codegen.Variable(start=0.5, scale=1.0)}, p={"mass": m},
            combine=lambda v, goal=goal: ((v[0] - goal) ** 2, [2 * (v[0] - goal)]),
        )
        for m, goal in zip(MASSES, goals, strict=True)
    ]  # fmt: skip
    f = codegen.load_cases(several, weights=[1.0, 3.0], threads=2)
    factors = np.array([swing(1.0, m, start=1.0)[0] for m in MASSES])
    best = np.sum([1.0, 3.0] * factors * goals) / np.sum([1.0, 3.0] * factors**2)
    assert codegen.optimize(f, tol=1e-12).outcome["start"] == pytest.approx(best, abs=1e-5)
    ran = f.motions
    early = swing(0.5, MASSES[0], start=1.0)[0]
    bound = several[0].constraint(At("x", 0.5), upper=early * best / 2)
    assert codegen.optimize(f, constraints=bound, tol=1e-12).outcome["start"] == pytest.approx(best / 2, abs=1e-6)
    assert f.motions > ran


def test_a_case_that_fails_fails_all(solver):
    fails = codegen.objective(solver, 3.0, AtEvent("t", Event("x", 2.0)), VARIABLES)
    f = codegen.load_cases([*cases(solver), fails])
    value, gradient = f.value_and_gradient(f.x0)
    assert value == np.inf and np.isnan(gradient).all()
    assert isinstance(f.error(f.x0), SimulationError) and "did not occur" in str(f.error(f.x0))
    with pytest.raises(SimulationError, match="did not occur"):
        codegen.optimize(f)
    with pytest.raises(ValueError, match="no motion at this x fails"):
        codegen.load_cases(cases(solver)).error(f.x0)


def test_what_is_wrong_is_told(solver):
    one, other = cases(solver)
    more = codegen.objective(solver, 3.0, Final("x"), ["stiffness"])
    wider = codegen.objective(
        solver, 3.0, Final("x"), VARIABLES | {"stiffness": codegen.Variable(1.0, 20.0, start=8.0)}
    )
    for arguments, message in (
        (([],), "list of objectives is empty"),
        (([one, Final("x")],), "case 1 is Final.*, expected the result of ordernm.objective"),
        (([one, more],), "variables of case 1 have other names than those of case 0"),
        (([one, wider],), "variables of case 1 have other lower bounds"),
        (([one, one],), "given twice; give it once, with a weight"),
    ):
        with pytest.raises(ValueError, match=message):
            codegen.load_cases(*arguments)
    for options, message in (
        ({"weights": [1.0]}, r"weights are \[1.0\], expected 2 numbers"),
        ({"weights": [1.0, np.nan]}, "expected 2 numbers"),
        ({"threads": 0}, "threads is 0, expected a number of threads"),
    ):
        with pytest.raises(ValueError, match=message):
            codegen.load_cases([one, other], **options)
