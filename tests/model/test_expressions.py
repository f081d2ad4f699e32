"""The expression grammar against Python's own arithmetic: exactness, folding of constants, and malicious texts."""

import contextlib
import copy
import math
import pickle

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from codegen.model import ModelError, parse_model
from codegen.model.binding import Binder, Scope, bind
from codegen.model.expressions import Expression, functions_for
from codegen.model.grammar import FUNCTIONS, ExpressionError
from codegen.model.parsing import parse

VALUES = {"x": 0.7, "y": -1.3, "L": 2.5, "q.a.1": 0.4, "u.ball.wx": 1.7}


def _texts():
    """Random texts of the grammar, with Python's values."""
    leaves = st.one_of(
        st.integers(0, 20).map(lambda n: (str(n), f"{n}.0")),  # Python's int -0 has no sign
        st.floats(0.01, 9, allow_nan=False).map(lambda v: (repr(v), repr(v))),
        st.sampled_from([("x", "x"), ("y", "y"), ("L", "L"), ("pi", "pi"), ("q.a.1", "q1"), ("u.ball.wx", "u1")]),
    )

    def more(inner):
        return st.one_of(
            st.tuples(inner, st.sampled_from([" + ", "-", "*", " / "]), inner).map(
                lambda v: (v[0][0] + v[1] + v[2][0], v[0][1] + v[1] + v[2][1])
            ),
            inner.map(lambda v: (f"({v[0]})", f"({v[1]})")),
            inner.map(lambda v: (f"-{v[0]}", f"-{v[1]}")),
            st.tuples(inner, st.integers(0, 3)).map(lambda v: (f"({v[0][0]})**{v[1]}", f"({v[0][1]})**{v[1]}")),
            st.tuples(inner, st.sampled_from(["sin", "cos", "atan", "tanh", "abs"])).map(
                lambda v: (f"{v[1]}({v[0][0]})", f"{v[1]}({v[0][1]})")
            ),
            st.tuples(inner, inner, st.sampled_from(["min", "max"])).map(
                lambda v: (f"{v[2]}({v[0][0]}, {v[1][0]})", f"{v[2]}({v[0][1]}, {v[1][1]})")
            ),
            # the sign of a zero, which folding drops, decides atan2 on its cut: stay off it
            st.tuples(inner, inner).map(
                lambda v: (f"atan2({v[0][0]} + 0.7, {v[1][0]} + 0.3)", f"atan2({v[0][1]} + 0.7, {v[1][1]} + 0.3)")
            ),
        )

    return st.recursive(leaves, more, max_leaves=12)


_PYTHON = {
    **{n: getattr(math, n) for n in ("sin", "cos", "atan", "tanh", "atan2", "pi")},
    **{"abs": abs, "min": min, "max": max, "__builtins__": {}, "q1": VALUES["q.a.1"], "u1": VALUES["u.ball.wx"]},
    **{n: VALUES[n] for n in ("x", "y", "L")},
}


@given(_texts())
def test_agrees_with_python_before_and_after_binding_and_printing(pair):
    text, python = pair
    try:
        expected = float(eval(python, _PYTHON))  # the independent evaluation of a text made by this test
    except ArithmeticError:
        return
    expression = parse(text)
    assert expression.evaluate(VALUES) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    try:
        bound = bind(expression, {})
    except ExpressionError:
        return  # divides by a zero that x*0 hides from Python's evaluation order
    assert bound.evaluate(VALUES) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert bind(parse(str(bound)), {}) is bound
    assert parse(str(expression)).evaluate(VALUES) == expression.evaluate(VALUES)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-2**2", -4), ("2**-1", 0.5), ("2**3**2", 512), ("0.1 + -0.2*3", 0.1 - 0.2 * 3), ("7 - 2 - 1", 4),
        ("8/2/2", 2), ("-(-3)", 3), ("+4", 4), ("2 * +3", 6), ("1e-4", 1e-4), (".5", 0.5), ("5.", 5), ("1E3", 1000),
        ("min(3, 1, 2)", 1), ("max(3, 1, 2)", 3), ("sign(-3)", -1), ("sqrt(4)", 2), ("2*pi", 2 * math.pi),
        ("7 % 3", 1), ("-1 % 3", 2),
    ],
)  # fmt: skip
def test_values(text, value):
    result = bind(parse(text), {})
    assert result.is_number
    assert result.value == value


def test_whole_numbers_are_ints_and_fractions_exact_in_every_arithmetic():
    third = parse("x/3 + 1/12")
    with mpmath.workdps(50):
        result = third.evaluate({"x": mpmath.mpf(1)}, functions_for(mpmath))
        assert abs(result - mpmath.mpf(5) / 12) < mpmath.mpf(10) ** -49
    assert third.evaluate({"x": sympy.Integer(1)}, functions_for(sympy)) == sympy.Rational(5, 12)
    np.testing.assert_allclose(third.evaluate({"x": np.array([1.0, 2.0])}, functions_for(np)), [5 / 12, 9 / 12])
    assert third.evaluate({"x": 1}, functions_for(math)) == pytest.approx(5 / 12)


@pytest.mark.parametrize("module", [np, mpmath, mpmath.mp, sympy, math])
def test_every_function_in_every_arithmetic(module):
    functions = functions_for(module)
    for name, count in FUNCTIONS.items():
        expression = parse(f"{name}({', '.join(['1 + x' if name == 'acosh' else 'x', 'y'][:count])})")
        expected = expression.evaluate({"x": 0.3, "y": 0.4})
        number = functions["number"]
        result = expression.evaluate({"x": number(0.3), "y": number(0.4)}, functions)
        assert float(result) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0*x", "0"), ("x*0", "0"), ("1*x", "x"), ("x*1.0", "x"), ("x + 0", "x"), ("0.0 + x", "x"), ("x - 0", "x"),
        ("0 - x", "-x"), ("0/x", "0"), ("x/1", "x"), ("x**1", "x"), ("-(-x)", "x"), ("-0.0", "0"), ("n*x", "4*x"),
        ("(n - 4)*x + y", "y"), ("2*3*x", "6*x"), ("x*2*3", "x*2*3"), ("x - x", "x - x"), ("sin(0)", "0"),
    ],
)  # fmt: skip
def test_binding_folds_numbers_zeros_and_ones_and_nothing_else(text, expected):
    assert str(bind(parse(text), {"n": 4})) == expected


def test_zero_and_one_have_one_representation():
    for text in ("0", "0.0", "-0.0", "1 - 1", "0*x"):
        assert bind(parse(text), {}).tree == ("number", 0)
        assert type(bind(parse(text), {}).value) is int
    assert Expression.number(1.0) is Expression.number(1)
    assert type(Expression.number(2.0**53).value) is float


def test_indexed_names():
    expression = parse("q.link(k-1).qw + sx(leg) + a(i)(2*k)")
    numbers = {"k": 3, "i": 0, "leg": "left", "sx_left": -1}
    assert str(bind(expression, numbers)) == "q.link_2.qw + (-1) + a_0_6"
    for text in ("link(j)", "link(k/2)", "link(k - 4)", "leg + 1"):
        with pytest.raises(ExpressionError):
            bind(parse(text), numbers)


def test_equal_trees_are_one_object_also_after_pickling_and_copying():
    a = bind(parse("rho*L/2"), {"rho": 3})
    assert a is bind(parse(" 3 * L / 2 "), {})
    assert pickle.loads(pickle.dumps(a)) is a
    assert copy.deepcopy(a) is a
    with pytest.raises(AttributeError):
        a.tree = ()
    binder = Binder({"rho": 3})
    assert binder(parse("rho*L/2"), {"k": 1}) is binder(parse("rho*L/2"), {"k": 2}) is a
    assert binder(parse("k*L"), {"k": 1}) is not binder(parse("k*L"), {"k": 2})


def test_names():
    assert parse("L*sin(q.a.1) + t - pi*u.ball.wx").names == {"L", "q.a.1", "t", "u.ball.wx"}


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("", 1, "the expression is empty"),
        ("1 +", 4, "ends here"),
        ("1 2", 3, "operator"),
        ("2 kN/mm2", 8, "a power is written **, as in m**2"),
        ("30 RPM", 4, "did you mean 'rpm'?"),
        ("2x", 2, "operator"),
        ("__import__('os')", 12, "quotes"),
        ("a^2", 2, "**"),
        ("link[k]", 5, "link(k)"),
        ("(1 + 2", 1, "not closed"),
        ("1)", 2, "without an opening one"),
        ("sine(x, y)", 1, "did you mean 'sin'"),
        ("sin", 1, "without its argument"),
        ("sin(1, 2)", 1, "it takes 1"),
        ("max(1)", 1, "at least 2"),
        ("a.b", 1, "q.NAME"),
        ("q", 1, "q.NAME"),
        ("1e999", 1, "too large"),
        ("x = 1", 3, "equals"),
        ("1, 2", 2, "parentheses; remove it"),
        ("0,6", 2, "parentheses; a decimal point is written ., as in 0.6"),
        ("sin(0,6)", 1, "it takes 1; a decimal point is written ."),
        ("008", 1, "number 008 begins with 0; write 8, or 0.08 with a decimal point"),
        ("1 + 00.50", 5, "number 00.50 begins with 0; write 0.50"),
        ("06 mm", 1, "write 6, or 0.6 with a decimal point"),
        ("00", 1, "number 00 begins with 0; write 0"),
        ("0" * 400 + "1", 1, "remove the leading zeros"),
        ("if(x > 0 then 3 else 4)", 10, "a choice is written if(condition, x, y)"),
        ("if(x > a then 3 else 4)", 1, "write if(condition, x, y)"),
        ("if x > 0 then 3 else 4", 4, "a choice is written if(condition, x, y)"),
        ("a if x > 0 else 4", 3, "a choice is written if(condition, x, y)"),
        ("x > 0 ? 3 : 4", 3, "a choice is written if(condition, x, y)"),
        ("a ? 3 : 4", 3, "a choice is written if(condition, x, y)"),
        ("é", 1, "character"),
    ],
)
def test_errors_teach_and_say_where(text, column, words):
    with pytest.raises(ExpressionError) as info:
        parse(text)
    assert info.value.column == column
    assert words in info.value.message


@pytest.mark.parametrize(
    "text", ["10**400", "9**9**9**9", "1/0", "x/0", "sqrt(-1)", "log(0)", "exp(1000)", "0**-1", "5 % 0"]
)
def test_numbers_that_do_not_exist_are_errors(text):
    with pytest.raises(ExpressionError):
        bind(parse(text), {})


@pytest.mark.parametrize("text", ["(" * 5000, "-" * 5000 + "x", "+".join("x" * 5000), "x**" * 3000 + "x", "a(" * 3000])
def test_hostile_nesting_is_an_error(text):
    with pytest.raises(ExpressionError):
        parse(text)


@given(st.one_of(st.text(), st.text("0123456789.+-*/%() xyqu,esinpi^[]e_")))
def test_random_texts_are_expressions_or_expression_errors(text):
    with contextlib.suppress(ExpressionError):
        bind(parse(text), {"x": 2})


COMPUTED = [
    "0.3*sin(k)", "1 - k % 2", "k/3", "-k**2", "2**k", "n*k - j", "max(k, j)*pi", "sqrt(k - 3)", "1/(k - 2)", "log(k - 1)",
    "exp(400*k)", "k % (j - 2)", "(k - 2)**-1", "1e200*k*1e200", "0*(1/(k - 2))", "abs(-k)", "atan2(k, j)", "k*L",
    "if(k < 2, 1, 2)", "side + k", "k + m",
]  # fmt: skip


@pytest.mark.parametrize("text", COMPUTED)
def test_what_is_computed_of_indices_is_what_binding_gives(text):
    """The short way of many repetitions: the same objects, and the same words where there is no number."""
    constants = {"n": 12, "pi": math.pi, "m": 0.1}
    binder, expression = Binder(constants), parse(text)
    for k in range(5):
        for j in (0, 2):
            for side in ("left", 3):
                indices = {"k": k, "j": j, "side": side}
                found = []
                for bound in (binder, lambda e, i: bind(e, Scope(i, constants))):
                    try:
                        found.append(bound(expression, indices))
                    except ExpressionError as error:
                        found.append(error.message)
                assert found[0] == found[1] and (isinstance(found[0], str) or found[0] is found[1])


def test_a_large_model_with_a_wrong_parent_is_refused_before_its_numbers_are_read(monkeypatch):
    from codegen.model.sections import bodies

    text = "model: c\nbodies:\n  repeat k in 1..6000:\n    b(k): {parent: b(k-2), joint: {type: revolute, axis: y}, mass: k}\n"
    monkeypatch.setattr(bodies._PartsReader, "of", lambda *_: pytest.fail("no numbers are to be read"))
    with pytest.raises(ModelError, match=r"unknown body 'b_0'|is -1") as caught:
        parse_model(text)
    assert len(caught.value.problems) == 1
