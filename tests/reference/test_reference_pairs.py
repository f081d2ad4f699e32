"""Expressions with derivatives, the linear algebra of small matrices, and errors of the engines."""

import decimal

import mpmath
import numpy as np
import pytest
from random_models import expression, random_state, random_tree, vector

from codegen.model.model import Body, Joint, Model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.arithmetic import Arithmetic, SingularMatrixError
from codegen.reference.pairs import Pair, Pairs

TEXTS = [
    "sin(x)", "cos(x*y)", "tan(x)", "asin(x)", "acos(x/2)", "atan(x)", "atan2(x, y)", "atan2(-y, -x)", "sinh(x)",
    "cosh(x)", "tanh(x)", "sqrt(x + y)", "exp(-x)", "log(x)", "abs(-x*y)", "sign(x)*x", "min(x, y)", "max(x, y, 1)",
    "x**y", "x**3", "(-x)**3", "x**-2", "x**0", "2**y", "x/y", "1/3*x", "-x**2 + y", "0.1 + -0.2*x", "x*pi",
]  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("numbers", ["float64", "mpmath", "decimal"])
def test_expressions_and_their_derivatives(text, numbers):
    from codegen.model.expressions import functions_for

    with mpmath.workdps(60), decimal.localcontext(prec=60):
        arithmetic, tree = Arithmetic(numbers), expression(text)
        x, y, h = mpmath.mpf(0.4), mpmath.mpf(1.7), mpmath.mpf(10) ** -20
        environment = {
            "x": Pair(arithmetic.number(0.4), arithmetic.array([1, 0, 0.5])),
            "y": Pair(arithmetic.number(1.7), arithmetic.array([0, 1, -2])),
        }
        result = Pairs(arithmetic, 3, environment).expression(tree)
        functions = functions_for(mpmath)
        tolerance = 1e-14 if numbers == "float64" else 1e-35
        exactly = mpmath.mp.convert
        assert abs(exactly(result.value) - tree.evaluate({"x": x, "y": y}, functions)) < tolerance
        for tangent, (dx, dy) in zip(result.tangent, [(1, 0), (0, 1), (0.5, -2)], strict=True):
            up = tree.evaluate({"x": x + h * dx, "y": y + h * dy}, functions)
            down = tree.evaluate({"x": x - h * dx, "y": y - h * dy}, functions)
            assert abs(exactly(tangent) - (up - down) / (2 * h)) < 20 * tolerance


def test_powers_at_zero():
    arithmetic = Arithmetic()
    pairs = Pairs(arithmetic, 1, {"x": Pair(np.float64(0), np.ones(1))})
    for text, value, derivative in (("x**2", 0, 0), ("x**1", 0, 1), ("x**0", 1, 0), ("abs(x)", 0, 0)):
        result = pairs.expression(expression(text))
        assert (result.value, result.tangent[0]) == (value, derivative), text


@pytest.mark.parametrize("numbers", ["float64", "mpmath", "decimal"])
def test_linear_algebra(numbers):
    arithmetic = Arithmetic(numbers)
    rng = np.random.default_rng(3)
    for n in range(7):
        X = rng.normal(size=(n, n))
        A = arithmetic.array(X @ X.T + np.eye(n))
        assert np.abs(A @ arithmetic.inverse(A) - arithmetic.eye(n)).sum() < 1e-12
        B, Y = arithmetic.array(X + 3 * np.eye(n)[::-1]), arithmetic.array(rng.normal(size=(n, 2)))
        assert np.abs(B @ arithmetic.solve(B, Y) - Y).sum() < 1e-12
    with pytest.raises(SingularMatrixError):
        arithmetic.inverse(arithmetic.array([[1, 1], [1, 1]]))
    with pytest.raises(SingularMatrixError):
        arithmetic.solve(arithmetic.array([[1, 1], [1, 1]]), arithmetic.array([[1], [2]]))


def test_a_massless_outboard_body_is_named():
    zero, none = expression(0), vector(0, 0, 0)
    heavy = Body("arm", -1, Joint("revolute", (vector(0, 1, 0),), none), expression(1), vector(0, 0, 1), (zero,) * 6)
    light = Body("finger", 0, Joint("revolute", (vector(0, 1, 0),), none), zero, none, (zero,) * 6)
    model = Model("m", vector(0, 0, -9.81), (), (), (heavy, light))
    with pytest.raises(SingularMatrixError, match="finger"):
        RecursiveEngine(model).accelerations([0.1, 0.2], [0, 0])
    with pytest.raises(SingularMatrixError):
        DenseEngine(model).accelerations([0.1, 0.2], [0, 0])


@pytest.mark.parametrize("numbers", ["float64", "mpmath", "decimal"])
def test_a_joint_that_moves_nothing_of_its_own_is_named(numbers):
    """Two hinges on one line with a massless body between: the pivot is rounding, not zero."""
    zero, none, axis = expression(0), vector(0, 0, 0), vector(0.3, 1.1, 0.7)
    inertia = tuple(expression(x) for x in (0.4, 0.7, 0.9, 0.05, -0.02, 0.03))
    bodies = (
        Body("between", -1, Joint("revolute", (axis,), vector(0.1, 0.2, 0.3)), zero, none, (zero,) * 6),
        Body("arm", 0, Joint("revolute", (axis,), none), expression(1.7), vector(0.3, 0.1, 0.9), inertia),
    )
    with pytest.raises(SingularMatrixError, match="between"):
        RecursiveEngine(Model("m", None, (), (), bodies), numbers).accelerations([0.1, 0.2], [0, 0])


@pytest.mark.parametrize("engine", [RecursiveEngine, DenseEngine])
def test_arguments_are_checked(engine):
    rng = np.random.default_rng(5)
    model = random_tree(rng, 4, ("free", "revolute"))
    q, u, p, inputs, t = random_state(rng, model)
    e = engine(model)
    for wrong, name in (((q[1:], u), "q"), ((q, u[1:]), "u"), ((q, u, [1.0] * 9), "p"), ((q * np.nan, u), "q")):
        with pytest.raises(ValueError, match=f"^{name} "):
            e.accelerations(*wrong)
    with pytest.raises(ValueError, match="no seed"):
        e.sensitivities(q, u, p, inputs, t)
    with pytest.raises(ValueError, match="du"):
        e.sensitivities(q, u, p, inputs, t, dq=np.zeros((2, model.nq)), du=np.zeros((3, model.nu)))
    with pytest.raises(ValueError, match="quaternion"):
        e.accelerations(0 * q, u, p, inputs, t)
    with pytest.raises(ValueError, match="numbers"):
        engine(model, numbers="float32")
    # A seed without k counts as one direction; None are the defaults; dt may be a number.
    udot, dudot = e.sensitivities(q, u, dq=np.ones(model.nq), dt=1.0)
    assert udot.shape == (model.nu,) and dudot.shape == (1, model.nu)
