"""Optimal control by collocation: known optima, their derivatives with respect to design parameters, design variables."""

import math
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.casadi.bridged import BridgeError
from codegen.casadi.optimal_control import NotSolvedError, collocation

pytest.importorskip("casadi", reason="CasADi is not installed: pip install -e '.[casadi]'")

EXAMPLES = Path(__file__).parents[2] / "examples"
CART_POLE = EXAMPLES / "casadi" / "cart_pole.yaml"
FUNCTIONS = "accelerations,sensitivities,gradients,hessian_products"

SWING_UP = {
    "cost": lambda x: x["inputs.push"] ** 2,
    "start": {"q.cart": 0.0, "q.pole": 0.0, "u.cart": 0.0, "u.pole": 0.0},
    "end": {"q.cart": 1.0, "q.pole": math.pi, "u.cart": 0.0, "u.pole": 0.0},
    "bounds": {"q.cart": (-2.0, 2.0), "inputs.push": (-20.0, 20.0)},
}
OPTIMUM = 58.8076674587
"""Least integral of the squared force over 2 s, and its derivatives below: from collocation with a finer and finer grid,
checked by differences of optima."""
DERIVATIVES = {"cart_mass": 97.147906, "pole_mass": 68.224763, "length": 72.99954, "g": 8.637566}


@pytest.fixture(scope="module")
def cart_pole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solver") / "cart_pole"
    codegen.generate(CART_POLE, folder, compile=False, functions=FUNCTIONS)
    return codegen.load(folder)


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solver") / "four_bar"
    codegen.generate(EXAMPLES / "four_bar.yaml", folder, compile=False, functions=FUNCTIONS)
    return codegen.load(folder)


def test_the_swing_up_of_a_cart_pole_and_its_design_derivatives_are_known(cart_pole):
    found = collocation(cart_pole, 2.0, 30, degree=7, **SWING_UP).solve()
    assert abs(found.value - OPTIMUM) <= 1e-7 * OPTIMUM
    for name, wanted in DERIVATIVES.items():
        assert abs(found.gradients[name] - wanted) <= 1e-7 * abs(wanted), name
    assert found.y[0].tolist() == [0.0, 0.0, 0.0, 0.0] and np.allclose(found.y[-1], [1.0, math.pi, 0.0, 0.0], atol=1e-8)


def test_both_hessians_lead_to_the_same_optimum(cart_pole):
    problem = collocation(cart_pole, 2.0, 10, degree=4, **SWING_UP)
    exact, approximate = problem.solve(), problem.solve(hessian="limited-memory", tolerance=1e-7)
    assert abs(exact.value - approximate.value) <= 1e-6 * exact.value
    assert exact.iterations < 30 and exact.iterations < approximate.iterations


def test_a_parameter_as_a_variable_balances_its_derivative_and_its_price(cart_pole):
    chosen = collocation(
        cart_pole, 2.0, 10, degree=4, design={"length": (0.3, 0.7)},
        end_cost=lambda x: 500.0 * (x["p.length"] - 0.5) ** 2, **SWING_UP,
    ).solve()  # fmt: skip
    at = chosen.design["length"]
    fixed = collocation(cart_pole, 2.0, 10, degree=4, p={"length": at}, **SWING_UP).solve(guess=chosen)
    price = 500.0 * (at - 0.5) ** 2
    assert 0.31 < at < 0.49 and chosen.p[2] == at and "length" not in chosen.gradients
    assert abs(chosen.value - fixed.value - price) <= 1e-8 * fixed.value
    assert abs(fixed.gradients["length"] + 1000.0 * (at - 0.5)) <= 1e-6 * fixed.gradients["length"]


def test_derivatives_of_an_optimum_are_those_of_optima_nearby(four_bar):
    def solved(length: float):
        return collocation(
            four_bar, 0.6, 6, degree=4, cost=lambda x: x["inputs.motor"] ** 2, p={"coupler_length": length},
            start={"q.crank": 0.8, "u.crank": 0.0}, end={"q.crank": 2.0, "u.crank": 0.0},
        ).solve()  # fmt: skip

    step = 1e-4
    middle = solved(1.2)
    difference = (solved(1.2 + step).value - solved(1.2 - step).value) / (2 * step)
    assert abs(middle.gradients["coupler_length"] - difference) <= 1e-5 * abs(difference)


def test_lengths_of_a_four_bar_may_be_variables(four_bar):
    def stated(**more):
        return collocation(
            four_bar, 0.6, 6, degree=4, cost=lambda x: x["inputs.motor"] ** 2,
            start={"q.crank": 0.8, "u.crank": 0.0}, end={"q.crank": 2.0, "u.crank": 0.0}, **more,
        )  # fmt: skip

    fixed = stated().solve()
    chosen = stated(design={"coupler_length": (1.1, 1.3), "rocker_length": (0.85, 0.95)}).solve()
    assert chosen.value < fixed.value
    for name, (low, high) in {"coupler_length": (1.1, 1.3), "rocker_length": (0.85, 0.95)}.items():
        assert low - 1e-6 <= chosen.design[name] <= high + 1e-6


def test_a_free_duration_is_a_variable(cart_pole):
    found = collocation(
        cart_pole, (0.2, 3.0), 8, degree=3, cost=lambda x: 1.0 + 0.0 * x["inputs.push"],
        start={"q.cart": 0.0, "q.pole": 0.0, "u.cart": 0.0, "u.pole": 0.0},
        end={"q.cart": 0.5, "q.pole": 0.0, "u.cart": 0.0, "u.pole": 0.0}, bounds={"inputs.push": (-5.0, 5.0)},
    ).solve(tolerance=1e-8)  # fmt: skip
    assert 0.2 < found.duration < 3.0 and abs(found.value - found.duration) <= 1e-8
    assert found.t[-1] == pytest.approx(found.duration) and np.abs(found.inputs).max() <= 5.0 + 1e-6


def test_path_conditions_hold_at_all_points(cart_pole):
    found = collocation(cart_pole, 2.0, 10, degree=4, path=lambda x: [x["u.cart"] - 1.8], **SWING_UP).solve()
    free = collocation(cart_pole, 2.0, 10, degree=4, **SWING_UP).solve()
    assert found.y[:, 2].max() <= 2.0 and found.value > free.value


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"start": {"q.cat": 0.0}}, r"start has the unknown name 'q.cat'; allowed are q.cart, .*did you mean 'q.cart'"),
        ({"bounds": {"push": (0, 1)}}, r"bounds has the unknown name 'push'; allowed are .*inputs.push"),
        ({"bounds": {"inputs.push": (1, 0)}}, r"bounds\['inputs.push'\] is \(1, 0\), expected \(least, greatest\)"),
        ({"design": {"lenght": (0, 1)}}, r"design has the unknown name 'lenght'.*did you mean 'length'"),
        ({"duration": -1.0}, "duration is -1.0, expected seconds above 0"),
        ({"segments": 0}, "segments is 0, expected a whole number from 1"),
        ({"degree": 12}, "degree is 12, expected a whole number from 1 to 9"),
    ],
)
def test_wrong_arguments_are_refused(more, message, cart_pole):
    with pytest.raises(BridgeError, match=message):
        collocation(cart_pole, **{"duration": 1.0, "segments": 4, **more})


def test_a_solver_without_second_derivatives_says_so(tmp_path):
    codegen.generate(CART_POLE, tmp_path / "s", compile=False, functions="accelerations,sensitivities")
    problem = collocation(codegen.load(tmp_path / "s"), 2.0, 4, **SWING_UP)
    with pytest.raises(
        BridgeError, match=r"hessian='exact' needs second derivatives of accelerations.*'hessian_products'"
    ):
        problem.solve()
    with pytest.raises(BridgeError, match="hessian is 'exakt'; allowed are 'exact' and 'limited-memory'"):
        problem.solve(hessian="exakt")


def test_a_problem_without_a_solution_raises(cart_pole):
    problem = collocation(cart_pole, 0.1, 4, **SWING_UP)  # too short for the force
    with pytest.raises(NotSolvedError, match=r"IPOPT stopped with .*; give another guess") as caught:
        problem.solve(most_iterations=60)
    assert caught.value.last.iterations > 0


def test_quaternions_need_second_derivatives_of_their_rates(tmp_path):
    functions = f"{FUNCTIONS},coordinate_rates,coordinate_rate_sensitivities"
    codegen.generate(EXAMPLES / "quadrotor.yaml", tmp_path / "s", compile=False, functions=functions)
    problem = collocation(codegen.load(tmp_path / "s"), 1.0, 2)
    with pytest.raises(
        BridgeError,
        match=r"second derivatives of coordinate_rates.*functions that include 'coordinate_rate_hessian_products'",
    ):
        problem.solve()
