"""Exact Hessian products of objectives, and the optimisers that use them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ordernm
from ordernm.runtime import AtEvent, Event, Final, Integral, LeastSquares

EXAMPLES = Path(__file__).parents[2] / "examples"
TIMES = np.linspace(0.0, 1.0, 5)


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("swing") / "package"
    ordernm.generate(EXAMPLES / "swing_up.yaml", folder, functions="motion,hessian_products")
    return ordernm.load(folder)


def made(solver: Any, bounds: Any = None, **more: Any) -> ordernm.Objective:
    """Effort, and half the squared distance from a final state."""
    aim = LeastSquares([1.0], {"angle": [1.0], "spin": [0.0], "place": [0.2]}, sigma=0.1)
    return ordernm.objective(
        solver, 1.0, [Integral("effort"), aim], {"inputs.push": bounds, "pole_length": ordernm.Variable(0.3, 1.2)}
        if bounds else {"inputs.push": None}, inputs=(TIMES, np.sin(5 * TIMES), "linear"),
        integrator="rk4", step=0.02, **({"weights": [0.02, 1.0]} | more),
    )  # fmt: skip


def test_products_equal_differences_of_gradients(solver: Any) -> None:
    f = made(solver, (-20.0, 20.0))
    v, h = np.random.default_rng(5).normal(size=len(f.x0)), 1e-3
    sides = [f.gradient(f.x0 + n * h * v) - f.gradient(f.x0 - n * h * v) for n in (1, 2, 3)]
    wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h)
    np.testing.assert_allclose(f.hessp(f.x0, v), wanted, rtol=1e-7, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("method", ["trust-krylov", "trust-ncg"])
def test_newton_finds_the_minimum_of_quasi_newton_with_fewer_motions(solver: Any, method: str) -> None:
    newton, other = made(solver), made(solver)
    found = ordernm.optimize(newton, method, gtol=1e-8)
    wanted = ordernm.optimize(other, "L-BFGS-B", ftol=1e-15, gtol=1e-8)
    assert found.success
    assert found.fun == pytest.approx(wanted.fun, rel=1e-8)
    assert np.abs(newton.gradient(found.x)).max() < 1e-8
    assert newton.motions < other.motions


def test_trust_constr_takes_hessians_of_the_objective_and_of_constraints(solver: Any) -> None:
    f = ordernm.objective(
        solver, 1.0, Integral("effort"), {"inputs.push": (-20.0, 20.0)}, weights=[0.02],
        inputs=(TIMES, np.sin(5 * TIMES), "linear"), integrator="rk4", step=0.02,
    )  # fmt: skip
    there = f.constraint([Final("angle"), Final("spin")], [0.5, 0.0], [0.5, 0.0])
    found = ordernm.optimize(f, "trust-constr", constraints=there, hessian=True, maxiter=100)
    plain = ordernm.optimize(f, "SLSQP", constraints=there)
    assert found.fun == pytest.approx(plain.fun, rel=1e-5)
    np.testing.assert_allclose(there.fun(found.x), [0.5, 0.0], atol=1e-7)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_the_time_of_an_event_beside_a_constraint(solver: Any, integrator: str) -> None:
    """The objective is the time at which the pole passes an angle; constraints share its motion."""
    passes = AtEvent("t", Event("angle", 0.3, stop=False))
    f = ordernm.objective(
        solver, 1.0, passes, {"inputs.push": None, "pole_length": None}, inputs=(TIMES, np.sin(5 * TIMES), "cubic"),
        q=[0.1, 0.7], u=[0.3, -0.4], integrator=integrator, rtol=1e-11, atol=1e-11,
    )  # fmt: skip
    f.constraint(Final("place"), 0.0, 1.0)
    v, h = np.random.default_rng(6).normal(size=len(f.x0)), 1e-3
    sides = [f.gradient(f.x0 + n * h * v) - f.gradient(f.x0 - n * h * v) for n in (1, 2, 3)]
    wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h)
    assert np.abs(wanted).max() > 1e-3
    np.testing.assert_allclose(f.hessp(f.x0, v), wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


def test_load_cases_add_products(solver: Any) -> None:
    one, two = made(solver), made(solver, weights=[0.1, 0.5])
    f = ordernm.load_cases([one, two], weights=[2.0, 3.0])
    v = np.arange(5.0)
    np.testing.assert_allclose(f.hessp(f.x0, v), 2 * one.hessp(f.x0, v) + 3 * two.hessp(f.x0, v), rtol=1e-12)


@pytest.mark.parametrize("bounds", [None, (-20.0, 20.0)])
def test_products_are_not_numbers_where_a_motion_fails(solver: Any, bounds: Any) -> None:
    f = made(solver, bounds, most_steps=3)
    other = made(solver, bounds)
    v = np.ones(len(f.x0))
    assert np.isnan(f.hessp(f.x0, v)).all()
    assert np.isnan(ordernm.load_cases([other, f], weights=[1.0, 0.0]).hessp(f.x0, v)).all()
    assert np.isfinite(other.hessp(f.x0, v)).all()
    with pytest.raises(ordernm.runtime.SimulationError):
        made(solver, bounds, most_steps=3, on_failure="raise").hessp(f.x0, v)
    there = f.constraint(Final("angle"), 0.0)
    assert (there.curvature(f.x0, v) == 0.0).all()


@pytest.mark.parametrize("method", ["trust-krylov", "trust-ncg"])
def test_searches_step_back_from_motions_that_fail(solver: Any, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's first step would pass the minimum at 0.50 m; motions fail beyond 0.53 m."""
    judge, failed = solver.judge, []

    def judged(*given: Any, p: Any, **more: Any) -> Any:
        if p[solver.parameter_names.index("pole_length")] > 0.53:
            failed.append(p)
            raise ordernm.runtime.SimulationError("too long", None)
        return judge(*given, p=p, **more)

    monkeypatch.setattr(solver, "judge", judged)
    f = ordernm.objective(
        solver, 1.0, LeastSquares([1.0], {"tip_z": [-0.5]}), {"pole_length": None}, p={"pole_length": 0.7},
        inputs=(TIMES, np.sin(5 * TIMES), "linear"), integrator="rk4", step=0.02,
    )  # fmt: skip
    found = ordernm.optimize(f, method, x0=[0.3], gtol=1e-9)
    assert np.isfinite(found.fun)
    assert np.abs(f.gradient(found.x)).max() < 1e-8
    assert failed


def test_motions_of_hessians_count(solver: Any) -> None:
    f = made(solver)
    f.gradient(f.x0)
    assert f.motions == 1
    for v in np.eye(len(f.x0)):
        f.hessp(f.x0, v)
    assert f.motions == 2


def test_objective_and_constraints_share_a_motion(solver: Any) -> None:
    f = made(solver)
    there = f.constraint([Final("angle"), Final("spin")], 0.0)
    v = np.ones(len(f.x0))
    product, curvatures = f.hessp(f.x0, v), there.curvature(f.x0, v)
    assert f.motions == 2  # the constraint first looks whether the motion fails
    alone = made(solver)
    np.testing.assert_allclose(product, alone.hessp(f.x0, v), rtol=1e-13)
    other = ordernm.objective(
        solver, 1.0, [Final("angle"), Final("spin")], {"inputs.push": None}, inputs=(TIMES, np.sin(5 * TIMES), "linear"),
        integrator="rk4", step=0.02, weights=[0.0, 1.0],
    )  # fmt: skip
    np.testing.assert_allclose(curvatures[1], other.hessp(f.x0, v), rtol=1e-13)


def test_products_that_do_not_exist_end_a_search_with_a_reason(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    f = made(solver)
    monkeypatch.setattr(f, "hessp", lambda x, v: np.full(len(x), np.nan))
    with pytest.raises(
        ValueError, match=r"no finite second derivatives at an x of the search; .* Use method 'L-BFGS-B'"
    ):
        ordernm.optimize(f, "trust-krylov")


def test_formulas_of_initial_values_beside_variables(tmp_path: Path) -> None:
    """Linear formulas need no second derivatives; others are refused by name."""
    text = (EXAMPLES / "swing_up.yaml").read_text()
    (tmp_path / "formulas.yaml").write_text(text + "\ninitial:\n  q: {pole: 0.5*pole_length, cart: sin(bob_mass)}\n")
    ordernm.generate(tmp_path / "formulas.yaml", tmp_path / "package", functions="motion,hessian_products")
    solver = ordernm.load(tmp_path / "package")

    def objective(*names: str) -> ordernm.Objective:
        variables = dict.fromkeys(names, ordernm.Variable(scale=1.0))
        return ordernm.objective(solver, 1.0, Final("tip_x"), variables, integrator="rk4", step=0.02)

    f, h = objective("pole_length", "u0.cart", "u0.pole"), 1e-3
    for i, e in enumerate(np.eye(3)):
        sides = [f.gradient(f.x0 + n * h * e) - f.gradient(f.x0 - n * h * e) for n in (1, 2, 3)]
        wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h)
        np.testing.assert_allclose(f.hessp(f.x0, e), wanted, rtol=1e-7, atol=1e-9, err_msg=f.variables.names[i])
    other = objective("bob_mass", "u0.cart")
    with pytest.raises(ValueError, match=r"hessp: the initial value of cart is a nonlinear formula .* Give cart in q"):
        other.hessp(other.x0, [1.0, 0.0])
    given = objective("bob_mass", "u0.cart", "q0.cart")
    assert np.isfinite(given.hessp(given.x0, [1.0, 0.0, 0.0])).all()


def test_refusals(solver: Any) -> None:
    f = made(solver, (-20.0, 20.0))
    with pytest.raises(ValueError, match=r"'trust-krylov' does not take bounds, and inputs.push"):
        ordernm.optimize(f, "trust-krylov")
    with pytest.raises(ValueError, match="'trust-ncg' does not take constraints; use 'trust-constr' with hessian=True"):
        ordernm.optimize(made(solver), "trust-ncg", constraints=f.constraint(Final("angle"), 0.0))
    with pytest.raises(ValueError, match="hessian is for method 'trust-constr', and method is 'L-BFGS-B'"):
        ordernm.optimize(f, hessian=True)
    with pytest.raises(ValueError, match=r"the direction is .*, expected 6 finite numbers"):
        f.hessp(f.x0, [1.0])
    combined = made(solver, weights=None, combine=lambda x: (x[0], [1.0, 0.0]))
    with pytest.raises(ValueError, match="combine has no second derivatives"):
        combined.hessp(combined.x0, np.ones(5))
