"""The table of elementary functions against mpmath's and sympy's: values, derivatives, symmetry, domains and signs."""

import math
import random

import mpmath
import numpy as np
import pytest
import sympy

import codegen
from codegen.elementary import ALWAYS, EVEN, LIKE_ITS_ARGUMENT, ODD, ON_ARRAYS, TABLE, tree_of
from codegen.model.binding import bind
from codegen.model.expressions import COMBINED, Expression, functions_for
from codegen.model.grammar import FUNCTIONS, ExpressionError
from codegen.model.parsing import parse
from codegen.program.algebra import Number, Symbol, derivative
from codegen.program.functions import SYMBOLIC
from codegen.reference import RecursiveEngine
from codegen.runtime.standalone.statics.jets import ELEMENTARY, Jet

EVERY = pytest.mark.parametrize("e", TABLE.values(), ids=TABLE.keys())
SMOOTH = pytest.mark.parametrize("e", [e for e in TABLE.values() if e.rounds or e.name == "sqrt"], ids=lambda e: e.name)


def points(e, seed, count=5):
    """Arguments within the domain, away from kinks and jumps."""
    rng = random.Random(f"{e.name} {seed}")
    low, high = e.domain or (-2.5, 2.5)
    return [[rng.uniform(max(low, -2.5) + 1e-3, min(high, 2.5) - 1e-3) for _ in e.slopes] for _ in range(count)]


def by_mpmath(e, *x):
    return functions_for(mpmath)[e.name](*x)


@EVERY
def test_values_and_derivatives_are_those_of_mpmath_in_many_digits(e):
    with mpmath.workdps(40):
        for x in points(e, 0):
            x = [mpmath.mpf(a) for a in x]
            value = by_mpmath(e, *x)
            for place, slope in enumerate(e.slopes):
                order = tuple(int(i == place) for i in range(e.arity))
                expected = mpmath.diff(lambda *y: by_mpmath(e, *y), tuple(x), order)
                assert mpmath.almosteq(slope(functions_like(mpmath), value, *x), expected, 1e-15, 1e-15), (x, place)


def functions_like(module):
    """The functions of a module as attributes."""
    return type("Functions", (), {name: staticmethod(f) for name, f in functions_for(module).items()})


@SMOOTH
def test_derivatives_are_those_of_sympy(e):
    symbols = sympy.symbols("x y")[: e.arity]
    value = functions_for(sympy)[e.name](*symbols)
    for place, (x, slope) in enumerate(zip(symbols, e.slopes, strict=True)):
        difference = sympy.lambdify(
            symbols, sympy.diff(value, x) - slope(functions_like(sympy), value, *symbols), "mpmath"
        )
        for at in points(e, 1):
            with mpmath.workdps(30):
                assert abs(difference(*map(mpmath.mpf, at))) < 1e-25, (at, place)


@SMOOTH
def test_every_kind_of_number_computes_the_same(e):
    for x in points(e, 2):
        expected, slopes = float(by_mpmath(e, *x)), []
        of = [Symbol(n) for n in ("x", "y")[: e.arity]]
        values = dict(zip(of, map(Number, x), strict=True))
        assert float(SYMBOLIC[e.name](*of).xreplace(values)) == pytest.approx(expected, rel=1e-14)
        for place, slope in enumerate(e.slopes):
            slopes.append(float(slope(ON_ARRAYS, expected, *x)))
            tree = Expression(tree_of(slope, [("call", e.name, *names(e)), *names(e)], COMBINED))
            assert tree.evaluate(dict(zip("xy", x, strict=False))) == pytest.approx(slopes[-1], rel=1e-13)
            by_symbols = derivative(SYMBOLIC[e.name](*of), of[place]).xreplace(values)
            assert float(by_symbols) == pytest.approx(slopes[-1], rel=1e-13)
        jets = [Jet(a, np.eye(e.arity)[i]) for i, a in enumerate(x)]
        found = ELEMENTARY[e.spelled("numpy") or e.name](*jets)
        assert found.value == pytest.approx(expected, rel=1e-14)
        assert found.slope == pytest.approx(np.array(slopes), rel=1e-13)


def names(e):
    return [("name", n) for n in "xy"[: e.arity]]


@EVERY
def test_symmetry_sign_and_domain_are_those_of_the_values(e):
    f = functions_for(math)[e.name]
    for x in points(e, 3, 40):
        if e.parity in (EVEN, ODD):
            assert f(-x[0]) == e.parity * f(x[0])
        if e.positive:
            assert f(*x) > 0 or (e.positive == LIKE_ITS_ARGUMENT and x[0] <= 0 <= f(*x))
    if e.domain is not None:
        low, high = e.domain
        f(low), f(min(high, 1e300))
        for outside in (low - 1e-9, *([high + 1e-9] if high < math.inf else [])):
            with pytest.raises(ValueError):
                f(outside)
    assert e.positive in ("", ALWAYS, LIKE_ITS_ARGUMENT)


@EVERY
def test_a_value_outside_of_the_domain_is_an_error_that_says_what_is_allowed(e):
    assert e.name in FUNCTIONS
    if e.domain is not None:
        outside = repr(e.domain[0] - 0.5)
        with pytest.raises(ExpressionError) as error:
            bind(parse(f"{e.name}({outside})"), {})
        assert str(error.value) == f"{e.name}({outside}) has no real value; {e.name} takes {e.takes}"


def test_a_remainder_of_division_by_zero_is_refused():
    with pytest.raises(ExpressionError, match=r"mod\(x, 0\) divides by zero"):
        bind(parse("mod(x, n - 1)"), {"n": 1})


def model_of_every_function():
    """A pendulum with every function in its force and in an output."""
    first = {
        name: "1.875 + w*q.bar" if e.domain and e.domain[0] == 1 else "0.375 + w*q.bar" for name, e in TABLE.items()
    }
    calls = [f"{name}({', '.join([first[name], '0.25 + w*u.bar'][: e.arity])})" for name, e in TABLE.items()]
    outputs = "".join(f"  of_{name}: {{value: '{call}'}}\n" for name, call in zip(TABLE, calls, strict=True))
    return codegen.parse_model(
        "model: every_function\nparameters: {w: 0.3125}\ngravity: [0, -9.81, 0]\n"
        "bodies:\n  bar: {parent: ground, joint: {type: revolute, axis: z}, mass: 1, com: [0, -1, 0]}\n"
        f"forces:\n  push: {{type: joint, joint: bar, value: '0.1*({' + '.join(calls)})'}}\noutputs:\n{outputs}"
    )


@pytest.fixture(scope="module")
def every_function():
    return model_of_every_function()


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_every_function_is_generated_with_its_derivatives(target, every_function, tmp_path):
    functions = ("sensitivities", "output_sensitivities", "gradients")
    codegen.generate(every_function, tmp_path, target=target, functions=functions, compile="all")
    solver = codegen.load(tmp_path)
    q, u = np.linspace(-0.5, 0.8, 9)[:, None], np.linspace(0.9, -0.4, 9)[:, None]
    seeds = {"dq": [[1.0], [0.0], [0.0]], "du": [[0.0], [1.0], [0.0]], "dp": [[0.0], [0.0], [1.0]]}
    with mpmath.workdps(30):
        engine, exact = RecursiveEngine(every_function, numbers="mpmath"), solver.in_precision(30, every_function)
        for member in ("sensitivities", "output_sensitivities"):
            batch, alone = getattr(solver, member)(q, u, **seeds), getattr(solver, member)(q[2], u[2], **seeds)
            more, reference = (getattr(x, member)(q[2], u[2], **seeds) for x in (exact, engine))
            for of_batch, of_one, digits, expected in zip(batch, alone, more, reference, strict=True):
                at = (2,) if of_batch.ndim == of_one.ndim + 1 and len(of_batch) == 9 else (slice(None), 2)
                assert np.allclose(of_batch[at], of_one, rtol=1e-14, atol=1e-14)
                assert np.allclose(of_one, np.asarray(expected, float), rtol=1e-13, atol=1e-13)
                assert np.abs(digits - expected).max() < 1e-27
