"""Dual numbers: every rule against mpmath, and broadcast shapes."""

import mpmath
import numpy as np
import pytest

from codegen.emit.numpy import NUMPY
from codegen.runtime.standalone.statics.jets import RULES, Jet

ONE = {
    "sin": 0.7, "cos": 0.7, "tan": 0.7, "arcsin": 0.3, "arccos": 0.3, "arctan": 1.3, "sinh": 0.7, "cosh": 0.7, "tanh": 0.7,
    "arcsinh": 0.7, "arccosh": 1.7, "arctanh": 0.3, "exp": 0.7, "log": 0.7, "sqrt": 0.7, "absolute": -0.7, "sign": -0.7,
}  # fmt: skip
MPMATH = {
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arcsinh": "asinh",
    "arccosh": "acosh",
    "arctanh": "atanh",
    "absolute": "fabs",
}
TWO = {
    "add": lambda x, y: x + y, "subtract": lambda x, y: x - y, "multiply": lambda x, y: x * y, "divide": lambda x, y: x / y,
    "power": lambda x, y: x**y, "arctan2": mpmath.atan2, "maximum": max, "minimum": min,
}  # fmt: skip


@pytest.mark.parametrize("name", ONE)
def test_functions_of_one_number(name):
    x = ONE[name]
    found = getattr(np, name)(Jet(x, np.array([1.0, -2.0])))
    with mpmath.workdps(40):
        function = getattr(mpmath, MPMATH.get(name, name))
        value, slope = float(function(mpmath.mpf(x))), float(mpmath.diff(function, mpmath.mpf(x)))
    assert abs(found.value - value) <= 2e-16 * max(1.0, abs(value))
    assert np.abs(found.slope - slope * np.array([1.0, -2.0])).max() <= 1e-15 * max(1.0, abs(slope))


@pytest.mark.parametrize("name", TWO)
@pytest.mark.parametrize(("x", "y"), [(0.7, 1.3), (1.3, 0.7)])
def test_functions_of_two_numbers(name, x, y):
    by_x, by_y = np.array([1.0, 0.0, 0.5]), np.array([0.0, 1.0, -0.3])
    ufunc, function = getattr(np, name), TWO[name]
    with mpmath.workdps(40):
        value = float(function(mpmath.mpf(x), mpmath.mpf(y)))
        slopes = [float(mpmath.diff(function, (mpmath.mpf(x), mpmath.mpf(y)), n)) for n in ((1, 0), (0, 1))]
    expected = slopes[0] * by_x, slopes[1] * by_y
    pairs = [
        (Jet(x, by_x), Jet(y, by_y), sum(expected)),
        (Jet(x, by_x), y, expected[0]),
        (x, Jet(y, by_y), expected[1]),
    ]
    for a, b, slope in pairs:
        for found in (ufunc(a, b), ufunc(a, np.float64(b) if isinstance(b, float) else b)):
            assert abs(found.value - value) <= 1e-15
            assert np.abs(found.slope - slope).max() <= 1e-15


def test_operators_are_the_functions_and_numbers_of_numpy_give_way():
    x, one = Jet([0.7, 0.2], np.array([[1.0], [2.0]])), np.float64(2.0)
    for found, slope in (
        (one * x, 2.0), (x * one, 2.0), (one + x, 1.0), (one - x, -1.0), (-x, -1.0), (x - one, 1.0), (x / one, 0.5),
        (np.array([3.0, 3.0]) * x, 3.0),
    ):  # fmt: skip
        assert isinstance(found, Jet)
        assert np.array_equal(found.slope, slope * x.slope)
    assert np.allclose((one / x).slope[:, 0], [-2 / 0.49, -4 / 0.04], rtol=1e-15)
    assert (x > 0.5).tolist() == np.less(0.5, x).tolist() == [True, False]
    assert np.where(x >= 0.2, 1.0, 0.0).tolist() == [1.0, 1.0]
    assert [float(row.value) for row in x] == [0.7, 0.2]


def test_values_of_few_axes_meet_values_of_more():
    few, more = Jet(2.0, np.array([1.0, 0.0])), Jet([3.0, 4.0, 5.0], np.zeros((3, 2)))
    found = few * more
    assert found.value.tolist() == [6.0, 8.0, 10.0]
    assert found.slope.tolist() == [[3.0, 0.0], [4.0, 0.0], [5.0, 0.0]]


def test_powers_at_zero_have_the_derivatives_that_they_have():
    assert np.power(Jet(0.0, np.ones(1)), 2.0).slope[0] == 0.0
    assert np.power(Jet(0.0, np.ones(1)), 1.0).slope[0] == 1.0
    assert np.power(Jet(0.0, np.ones(1)), Jet(2.0, np.ones(1))).slope[0] == 0.0


def test_every_function_that_is_printed_has_a_rule():
    of_numpy = [name.removeprefix("np.") for name in NUMPY.functions.values() if name.startswith("np.")]
    printed = {getattr(np, name).__name__ for name in of_numpy}  # the others stand in the module, made of these
    assert printed <= RULES.keys()


def test_what_has_no_rule_is_refused():
    with pytest.raises(TypeError):
        np.ceil(Jet(1.0, np.ones(1)))
