"""Objectives of motions against closed forms, and optimisations with them."""

import numpy as np
import pytest
from oscillator import FREE, oscillator, swing
from scipy.optimize import NonlinearConstraint, check_grad, minimize

import codegen
from codegen.runtime import At, AtEvent, Event, Final, Integral, LeastSquares, SimulationError


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return oscillator(tmp_path_factory.mktemp("objective"))


@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_value_and_gradient_are_those_of_the_closed_form(solver, method):
    variables = {"stiffness": (1.0, 20.0), "mass": None, "start": codegen.Variable(scale=0.1)}
    f = codegen.objective(solver, 3.0, [Final("x"), At("x", 1.25)], variables, weights=[2.0, -1.0], method=method)
    x = f.variables.x({"stiffness": 5.0, "mass": 1.5, "start": 0.7})
    (end, by_end), (early, by_early) = (swing(t, 1.5, 5.0, 0.7) for t in (3.0, 1.25))
    value, gradient = f.value_and_gradient(x)
    assert value == pytest.approx(2 * end - early, abs=1e-8)
    expected = np.array([2 * by_end[n] - by_early[n] for n in f.variables.names])
    assert f.variables.scale == pytest.approx([9.5, 2.0, 0.1])
    assert gradient == pytest.approx(expected * f.variables.scale, abs=1e-7)
    assert f(x) == value and np.array_equal(f.gradient(x), gradient)
    assert f.motions == 1, "value and gradient at one x are one motion"
    assert check_grad(f, f.gradient, x) < 1e-5
    assert f.result(x)["mass"] == pytest.approx(1.5) and f.result(x).gradient == pytest.approx(expected, abs=1e-7)
    assert "stiffness" in repr(f.result(x)) and "N/m" in repr(f.result(x)) and "x at 1.25 s" in repr(f.result(x))


def test_forward_and_adjoint_agree_for_initial_values_and_inputs(solver):
    times = np.linspace(0, 2, 5)
    for between, values in (
        ("hold", [1.0, -1, 2, 0, 0]),
        ("linear", [1.0, -1, 2, 0, 1]),
        ("spline", [1.0, 0, -1, 2, 0, 1, 3]),
    ):
        inputs = (times, np.array(values), between)
        variables = ["q0.block", "u0.block", "inputs.force", "damping"]
        found = {}
        for method in ("forward", "adjoint"):
            f = codegen.objective(
                solver,
                2.0,
                [Final("v"), Integral("effort")],
                variables,
                inputs=inputs,
                method=method,
                rtol=1e-11,
                atol=1e-11,
            )
            found[method] = f.gradient(f.x0)
            assert len(f.variables) == 3 + len(values)
        assert found["forward"] == pytest.approx(found["adjoint"], abs=1e-11)
        assert check_grad(f, f.gradient, f.x0) < 1e-5


def test_initial_values_that_depend_on_parameters_do_so_unless_they_are_given(solver):
    f = codegen.objective(solver, 1.0, Final("x"), ["start", "stiffness"])
    g = codegen.objective(solver, 1.0, Final("x"), ["start", "stiffness"], q={"block": 0.5})
    h = codegen.objective(solver, 1.0, Final("x"), ["start", "u0.block"])
    x, by = swing(1.0)
    assert f.result(f.x0).gradient == pytest.approx([by["start"], by["stiffness"]], abs=1e-8)
    assert g.result(g.x0).gradient == pytest.approx([0.0, by["stiffness"]], abs=1e-8)
    assert h.result(h.x0).gradient == pytest.approx([by["start"], np.sin(2.0) / 2], abs=1e-8)
    assert f(f.x0) == pytest.approx(x, abs=1e-8)


def test_a_period_is_found_by_its_event(solver):
    """Rising through zero comes after three quarters of a period: t = 3 pi/(2 w)."""

    def miss(values):
        error = values[0] - 2.0
        return 0.5 * error**2, [error]

    rises = Event("x", direction="up")
    f = codegen.objective(solver, 10.0, AtEvent("t", rises), {"stiffness": (1.0, 20.0)}, combine=miss)
    best = codegen.optimize(f, tol=1e-14)
    assert best.outcome["stiffness"] == pytest.approx(2 * (3 * np.pi / 4) ** 2, rel=1e-6)
    assert best.fun < 1e-12 and best.outcome.functional_values == pytest.approx([2.0], abs=1e-6)


@pytest.mark.parametrize("method", ["SLSQP", "trust-constr"])
def test_the_least_effort_from_rest_to_rest_is_the_straight_line(solver, method):
    """A free block of 1 kg, moved by 1 m in 1 s: the force is 6 - 12 t, its squares have the integral 12."""
    f = codegen.objective(
        solver, 1.0, Integral("effort"), {"inputs.force": (-20, 20)}, p=FREE, inputs=(np.linspace(0, 1, 5), np.zeros(5))
    )
    there = f.constraint([Final("x"), Final("v")], [1, 0], [1, 0])
    assert isinstance(there, NonlinearConstraint)
    best = codegen.optimize(f, method, constraints=there, tol=1e-9)
    assert best.fun == pytest.approx(12, rel=1e-6)
    assert best.outcome.values == pytest.approx([6, 3, 0, -3, -6], abs=1e-3)
    assert best.outcome.functional_values[1:] == pytest.approx([1, 0], abs=1e-7)
    assert f.motions <= best.nfev + 3, "constraints are judged in the motions of the objective"


def test_constraints_are_dictionaries_of_slsqp_too(solver):
    f = codegen.objective(
        solver, 1.0, Integral("effort"), {"inputs.force": (-20, 20)}, p=FREE, inputs=(np.linspace(0, 1, 5), np.zeros(5))
    )
    several = f.constraint_dicts([Final("x"), Final("v"), At("x", 0.5)], [1, 0, -np.inf], [1, 0, 0.4])
    assert [c["type"] for c in several] == ["eq", "ineq"]
    for c in several:
        jac = np.atleast_2d(c["jac"](f.x0))
        steps = [(c["fun"](f.x0 + h) - c["fun"](f.x0 - h)) / 2e-4 for h in 1e-4 * np.eye(5)]
        assert jac == pytest.approx(np.array(steps).T, abs=1e-7)
    best = minimize(f.value_and_gradient, f.x0, jac=True, method="SLSQP", bounds=f.bounds, constraints=several)
    assert best.success and best.fun > 12
    assert f.result(best.x).functional_values[1:] == pytest.approx([1, 0, 0.4], abs=1e-6)


@pytest.mark.parametrize("method", ["L-BFGS-B", "SLSQP", "trust-constr"])
def test_a_search_may_begin_at_a_bound(solver, method):
    f = codegen.objective(solver, 1.0, Final("x"), {"start": codegen.Variable(0.2, 2.0, start=0.2)})
    assert codegen.optimize(f, method).outcome["start"] == pytest.approx(2.0, abs=1e-3)


def test_a_bound_is_told(solver):
    f = codegen.objective(solver, 1.0, Final("x"), {"start": (0.2, 2.0)})
    best = codegen.optimize(f)  # cos(2) < 0: the further, the less
    assert best.outcome["start"] == pytest.approx(2.0) and "at its upper bound" in repr(best.outcome)


def test_motions_that_fail_are_infinite_counted_and_stepped_back_from(solver):
    """With a cubic force beyond some strength the block flies off within the time."""
    variables = {"cubic": (0.0, 500.0)}
    f = codegen.objective(solver, 3.0, Final("x"), variables, most_steps=2000)
    far = f.variables.x({"cubic": 400.0})
    assert f(far) == np.inf and np.isnan(f.gradient(far)).all() and np.isfinite(f(f.x0))
    assert len(f.failures) == 1 and "t = " in f.failures[0].failure and "1 failed" in repr(f)
    assert isinstance(f.error(far), SimulationError)
    g = codegen.objective(solver, 3.0, Final("x"), variables, most_steps=2000, on_failure="raise")
    with pytest.raises(SimulationError, match=r"t = "):
        g(far)
    assert len(g.failures) == 1
    with pytest.raises(SimulationError):
        codegen.optimize(f, x0=far)

    samples = LeastSquares([1.0, 2.0], {"x": solver.simulate([0, 1, 2], p={"cubic": 20.0})["x"][1:]})
    h = codegen.objective(solver, 2.0, samples, {"cubic": codegen.Variable(0.0, 500.0)}, most_steps=2000)
    best = codegen.optimize(h, tol=1e-13)
    assert best.outcome["cubic"] == pytest.approx(20.0, rel=1e-3)


def test_the_motion_at_an_x_can_be_had(solver):
    f = codegen.objective(solver, 2.0, Final("x"), {"stiffness": (1, 20)})
    f(f.x0)
    trajectory = f.simulate()
    assert trajectory["x"][-1] == pytest.approx(f(f.x0), abs=1e-12) and len(trajectory) == 201


@pytest.mark.parametrize(
    ("variables", "more", "message"),
    [
        ({"stifness": None}, {}, "did you mean 'stiffness'"),
        ([], {}, "there are no variables"),
        ({"mass": (3.0, 4.0)}, {}, "mass starts at 2, outside of its bounds 3 and 4"),
        ({"mass": (4.0, 3.0)}, {}, "the first must be smaller"),
        ({"mass": 3.0}, {}, r"allowed are None, \(lower, upper\)"),
        ({"inputs.force": ([0, 0], 1)}, {}, r"allowed|expected a number"),
        (["mass", "mass"], {}, "twice"),
        (["mass"], {"weights": [1.0, 2.0]}, r"shape \(2,\), expected \(1,\)"),
        (["mass"], {"weights": [1.0], "combine": lambda v: (v[0], [1])}, "weights and combine are both given"),
        (["mass"], {"on_failure": "ignore"}, "allowed are 'inf' and 'raise'"),
    ],
)
def test_what_is_wrong_is_told(solver, variables, more, message):
    with pytest.raises(ValueError, match=message):
        codegen.objective(solver, 1.0, Final("x"), variables, **more)


def test_what_is_wrong_with_an_x_or_a_constraint_is_told(solver):
    f = codegen.objective(solver, 1.0, Final("x"), ["mass"])
    with pytest.raises(ValueError, match=r"x has shape \(2,\), expected \(1,\)"):
        f([1.0, 2.0])
    with pytest.raises(ValueError, match=r"x\[0\] \(mass\) is nan"):
        f([np.nan])
    with pytest.raises(ValueError, match="lower must not be above upper"):
        f.constraint(Final("v"), 1.0, 0.0)
    with pytest.raises(ValueError, match="does not take constraints"):
        codegen.optimize(f, "L-BFGS-B", constraints=f.constraint(Final("v"), 0.0))
    with pytest.raises(ValueError, match="combine gives derivatives"):
        codegen.objective(solver, 1.0, Final("x"), ["mass"], combine=lambda v: (v[0], [1, 2]))([1.0])


@pytest.mark.parametrize(
    ("t", "options", "message"),
    [
        ([0.0, 1.0, 2.0], {}, r"expected the motion's end, s, or \(start, end\)"),
        (None, {}, "the end must be finite, and after the start"),
        ((1.0, 0.5), {}, "the end must be finite, and after the start, 1 s"),
        (1.0, {"weights": [np.nan]}, "expected finite numbers"),
        (1.0, {"combine": 3}, "expected a function of the functionals' values"),
        (
            1.0,
            {"variables": {"mass": codegen.Variable(start=np.inf)}},
            "start of mass is inf, expected a finite number",
        ),
        (1.0, {"variables": {"mass": codegen.Variable(scale="large")}}, "expected a positive number"),
        (1.0, {"variables": None}, "expected names, or a mapping"),
    ],
)
def test_what_would_give_no_number_is_refused_before_a_motion(solver, t, options, message):
    with pytest.raises(ValueError, match=message):
        codegen.objective(solver, t, Final("x"), options.pop("variables", ["mass"]), **options)


def test_a_combination_that_is_no_number_is_an_error(solver):
    f = codegen.objective(solver, 1.0, Final("x"), ["mass"], combine=lambda values: (np.nan, [1.0]))
    with pytest.raises(ValueError, match="combine gives nan"):
        f(f.x0)


def test_a_search_begins_within_the_bounds(solver):
    f = codegen.objective(solver, 1.0, Final("x"), {"mass": (1.0, 3.0)})
    with pytest.raises(ValueError, match="x0 has mass = 7, outside of its bounds 1 and 3"):
        codegen.optimize(f, x0=[5.0])
    at_the_bound = f.variables.x([3.0]) * (1 + 1e-15)
    assert codegen.optimize(f, x0=at_the_bound, maxiter=1).outcome["mass"] <= 3.0
    with pytest.raises(ValueError, match="is not an objective"):
        codegen.optimize(lambda x: x)
