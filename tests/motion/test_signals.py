"""Inputs over time in every form that `simulate` takes, also beyond their times; derivatives with respect to their values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from comparison import error
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator, make_interp_spline

import codegen
from codegen.model import parse_model
from codegen.runtime.standalone.motion.functionals import Integral
from codegen.runtime.standalone.motion.inputs import Inputs
from codegen.runtime.standalone.motion.signals import take_inputs
from codegen.runtime.standalone.motion.splines import (
    Rewritten,
    Through,
    common_knots,
    knots_through,
    pieces,
    spline_weights,
)

NAMES = ("a", "b", "c")
RNG = np.random.default_rng(11)
T = np.array([0.0, 0.3, 0.4, 0.9, 1.3, 2.0])
X = RNG.normal(size=(6, 3))
AT = np.linspace(-0.5, 2.5, 61)


def over(given: Any, times: np.ndarray = AT, names: tuple[str, ...] = NAMES) -> np.ndarray:
    inputs = take_inputs(names, given, interval=(-0.5, 2.5))
    return np.array([inputs.at(t) for t in times])


def held(x: Callable[[np.ndarray], np.ndarray], start: float = 0.0, end: float = 2.0) -> np.ndarray:
    return x(np.clip(AT, start, end))


@pytest.mark.parametrize("degree", range(10))
@pytest.mark.parametrize("order", range(4))
def test_b_splines_and_their_derivatives_are_those_of_scipy(degree: int, order: int) -> None:
    inner = np.sort(RNG.uniform(0.1, 1.9, 4))
    knots = np.concatenate([[0.0] * (degree + 1), inner, [2.0] * (degree + 1)])
    c = RNG.normal(size=len(knots) - degree - 1)
    spline = BSpline(knots, c, degree)
    for t in np.linspace(0.0, 1.99, 23):
        first, weights = spline_weights(knots, degree, len(c), float(t), order)
        expected = spline(t, order) if order <= degree else 0.0
        assert abs(weights @ c[first : first + degree + 1] - expected) < 1e-11 * max(1.0, abs(expected)) * 10.0**order


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 9])
def test_interpolation_is_that_of_scipy(degree: int) -> None:
    t = np.sort(RNG.uniform(0.0, 2.0, 14))
    x = RNG.normal(size=(14, 2))
    found, knots = knots_through(t, degree)
    assert found == degree
    expected = make_interp_spline(t, x, k=degree, t=knots)
    assert error(Through(knots, degree, t)(x), expected.c) < 1e-9


def test_values_between_and_outside_of_their_times() -> None:
    step = np.array([X[max(int(np.searchsorted(T, t, "right")) - 1, 0)] for t in AT])
    assert error(over((T, X, "hold")), step) < 1e-14
    line = np.stack([np.interp(AT, T, X[:, i]) for i in range(3)], axis=1)
    assert error(over((T, X)), line) < 1e-14 and error(over((T, X, "linear")), line) < 1e-14
    assert error(over((T, X, "cubic")), held(CubicSpline(T, X))) < 1e-13
    assert error(over((T, X, "quintic")), held(make_interp_spline(T, X, k=5))) < 1e-12
    points = RNG.normal(size=(8, 3))
    knots = np.concatenate([[0.0] * 3, T, [2.0] * 3])
    assert error(over((T, points, "spline")), held(BSpline(knots, points, 3))) < 1e-14


def test_signals_by_name_may_each_be_of_another_kind() -> None:
    other = np.array([-0.2, 0.4, 1.0, 2.2])
    values = RNG.normal(size=4)
    bspline = make_interp_spline(T, X[:, 0], k=5)
    step = np.array([values[max(int(np.searchsorted(other, t, "right")) - 1, 0)] for t in AT])
    kinds = {
        "constant": (0.7, np.full(len(AT), 0.7)), "hold": ((other, values, "hold"), step),
        "linear": ((other, values), np.interp(AT, other, values)),
        "cubic": ((T, X[:, 1], "cubic"), held(CubicSpline(T, X[:, 1]))), "b-spline": (bspline, held(bspline)),
        "pieces": (PchipInterpolator(T, X[:, 2]), held(PchipInterpolator(T, X[:, 2]))), "function": (np.cos, np.cos(AT)),
    }  # fmt: skip
    names = list(kinds)
    for _ in range(12):
        chosen = RNG.choice(names, 3, replace=False)
        found = over({n: kinds[k][0] for n, k in zip(NAMES, chosen, strict=True)})
        assert error(found, np.stack([kinds[k][1] for k in chosen], axis=1)) < 1e-10, chosen


@pytest.mark.parametrize("names", [(), NAMES])
def test_inputs_of_another_version_say_so(names: tuple[str, ...]) -> None:
    later = type("Inputs", (), {})()
    with pytest.raises(ValueError, match="this Inputs belongs to another version of ordernm than the solver's package"):
        take_inputs(names, later)


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("degree", range(6))
def test_inputs_at_many_times_are_those_of_single_times(degree: int, before: bool) -> None:
    """At knots, between them, outside, with repeated knots at the ends and several signals; bit for bit."""
    rng = np.random.default_rng(degree)
    inner = np.sort(rng.uniform(0.5, 2.5, 4))
    knots = np.concatenate([[0.0] * (degree + 2), inner, [3.0] * (degree + 2)])
    inputs = Inputs(degree, knots, rng.normal(size=(len(knots) - degree - 1, 3)), moving=(2, 0))
    t = np.concatenate([knots, rng.uniform(-1.0, 4.0, 30)]).reshape(2, -1)
    for order in range(3):
        found = inputs.derivative(t, order, before)
        alone = [[inputs.derivative(x, order, before) for x in row] for row in t.tolist()]
        np.testing.assert_array_equal(found, alone)
    np.testing.assert_array_equal(inputs.at(t), [[inputs.at(x) for x in row] for row in t.tolist()])
    assert inputs.rate(t).shape == (*t.shape, 7)


def test_a_spline_is_the_same_on_more_knots_and_of_a_higher_degree() -> None:
    for degree, onto in ((0, 2), (1, 1), (1, 3), (2, 3), (3, 3), (3, 5), (5, 9)):
        knots = np.concatenate([[0.0] * (degree + 1), [0.5, 0.8, 0.8][: degree + 1], [2.0] * (degree + 1)])
        c = RNG.normal(size=len(knots) - degree - 1)
        more = (onto, np.concatenate([[-0.3] * (onto + 1), [0.7, 1.1], [2.4] * (onto + 1)]))
        common = common_knots([(degree, knots), more])
        new = Rewritten(knots, degree, common[1], common[0])(c)
        for t in np.linspace(-0.25, 2.35, 40):
            at, weights = spline_weights(common[1], common[0], len(new), float(t))
            x = float(np.clip(t, 0.0, 2.0))
            before, own = spline_weights(knots, degree, len(c), x, before=t >= 2.0)
            assert abs(weights @ new[at : at + len(weights)] - own @ c[before : before + len(own)]) < 1e-12


def test_functions_by_pieces() -> None:
    spline = CubicSpline(T, X)
    degree, knots, values = pieces(spline.x, spline.c)
    for t in np.linspace(0.0, 2.0, 33):
        at, weights = spline_weights(knots, degree, len(values), float(t))
        assert error(weights @ values[at : at + 4], spline(t)) < 1e-13


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"d": 1.0}, "inputs: 'd' is not known; expected one of a, b, c"),
        ([1.0, 2.0], r"inputs have shape \(2,\), expected \(3,\)"),
        ({"a": [1.0, 2.0]}, r"inputs\['a'\] has shape \(2,\), expected \(\)"), ({"a": (T, X)}, r"expected \(6, 1\)"),
        ({"a": (T[::-1], X[:, 0])}, r"times of inputs\['a'\]: they must increase"), ({"a": "x"}, r"inputs\['a'\]"),
        ({"a": lambda t: np.nan}, "s is nan, expected finite"), ({"a": lambda t: "x"}, "the function at t ="),
        (lambda t: [t], r"shape \(1,\), expected \(3,\)"), ({"a": lambda t: float(t > 0.7)}, "not smooth.* t = 0.69"),
        ({"a": (T, X[:, 0], "wave")}, "joined by 'wave'"), ({"a": BSpline(np.arange(24.0), np.arange(12.0), 11)}, "at most 9"),
        (CubicSpline(T, X[:, :2]), "the spline has 2 values at a time, expected 3"),
        (make_interp_spline(T, np.array([*X[:5], X[0]]), k=3, bc_type="periodic"), "periodic"),
    ],
)  # fmt: skip
def test_what_is_no_signal_is_refused(given: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        take_inputs(NAMES, given, interval=(0.0, 2.0))


def test_a_function_needs_a_time() -> None:
    with pytest.raises(ValueError, match="not allowed here"):
        take_inputs(NAMES, {"a": np.sin})


MODEL = """
model: pushed
inputs: [a, b]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
forces:
  motor: {type: joint, joint: cart, value: a + b*q.cart - 0.3*u.cart}
outputs: {x: {value: q.cart}, power: {value: a*u.cart}}
"""


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pushed") / "pushed"
    codegen.generate(parse_model(MODEL), folder, compile="all")
    return codegen.load(folder)


def test_derivatives_by_values_of_signals_of_different_kinds(pushed) -> None:
    t, x = np.array([0.0, 0.5, 1.2, 2.0]), np.array([0.3, -0.2, 0.5, 0.1])
    tight = {"rtol": 1e-12, "atol": 1e-12}
    for a, b in (("cubic", "hold"), ("linear", "cubic"), ("hold", "linear"), ("cubic", "cubic")):
        signals = {"a": (t, x, a), "b": (t[1:], x[1:], b)}
        names = ["inputs.a[1]", "inputs.b[2]", "inputs.b"]
        wanted = [Integral("power")]
        forward, adjoint = (
            pushed.judge(2.5, wanted, inputs=signals, wrt=names, method=m, **tight) for m in ("forward", "adjoint")
        )
        assert error(adjoint.gradients, forward.gradients) < 1e-11
        h = 1e-5
        for k, (name, i) in enumerate((("a", 1), ("b", 2))):
            ends = []
            for s in (h, -h):
                moved = {n: (y[0], y[1].copy(), y[2]) for n, y in signals.items()}
                moved[name][1][i] += s
                ends.append(pushed.judge(2.5, wanted, inputs=moved, **tight).values[0])
            assert abs(forward.gradients[0, k] - (ends[0] - ends[1]) / (2 * h)) < 1e-8
    with pytest.raises(ValueError, match="the input has 3 values, counted from 0"):
        pushed.simulate(1.0, inputs={"b": (t[1:], x[1:])}, sensitivities=["inputs.b[3]"])
    with pytest.raises(ValueError, match="function of time without single values"):
        pushed.simulate(1.0, inputs={"a": np.sin}, sensitivities=["inputs.a[0]"])


def test_a_motion_by_functions_is_that_of_the_equation(pushed) -> None:
    from scipy.integrate import solve_ivp

    run = pushed.simulate(
        np.linspace(0, 3, 13), inputs={"a": np.sin, "b": lambda t: -1 - 0.2 * t}, rtol=1e-11, atol=1e-11
    )
    whole = pushed.simulate(np.linspace(0, 3, 13), inputs=lambda t: [np.sin(t), -1 - 0.2 * t], rtol=1e-11, atol=1e-11)
    expected = solve_ivp(
        lambda t, z: [z[1], (np.sin(t) - (1 + 0.2 * t) * z[0] - 0.3 * z[1]) / 2], (0, 3), [0, 0], "DOP853", run.t,
        rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert error(run["x"], expected.y[0]) < 1e-9 and error(whole["x"], expected.y[0]) < 1e-9


def test_an_optimiser_varies_the_values_that_it_is_given(pushed) -> None:
    t, x = np.array([0.0, 0.5, 1.2, 2.0]), np.array([0.3, -0.2, 0.5, 0.1])
    signals = {"a": (t, x, "cubic"), "b": (t[1:], x[1:], "hold")}
    objective = codegen.objective(
        pushed, 2.0, [Integral("power")], variables=["inputs.a", "inputs.b[1]"], inputs=signals
    )
    assert objective.variables.names == (*(f"inputs.a[{i}]" for i in range(4)), "inputs.b[1]")
    assert objective.variables.start.tolist() == [*x.tolist(), x[2]]
    values = objective.variables.start + np.array([0.0, 0.1, 0.0, 0.0, -0.2])
    found = objective.variables.motion(objective.variables.x(values))["inputs"]
    moved = {"a": (t, values[:4], "cubic"), "b": (t[1:], [x[1], values[4], x[3]], "hold")}
    expected = take_inputs(("a", "b"), moved)
    assert error(found.values, expected.values) < 1e-13
