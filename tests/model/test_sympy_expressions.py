"""sympy expressions in models, and model expressions in sympy."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy as s
from random_formulas import NAMES, random_formula
from sympy.physics.mechanics import dynamicsymbols

from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.binding import bind
from codegen.model.expressions import Expression
from codegen.model.grammar import ExpressionError
from codegen.model.parsing import parse
from codegen.model.sympy_output import to_sympy
from codegen.model.sympy_trees import from_sympy_expression, is_sympy

X, Y, T = s.symbols("x y t", real=True)


def read(e: s.Expr) -> Expression:
    """A formula whose names are those of its symbols."""
    return from_sympy_expression(s.sympify(e), lambda leaf: ("name", str(leaf)))


def arm(**keys: object) -> ModelBuilder:
    """Two links, the second on a universal joint, with a length, a mass and an input."""
    b = ModelBuilder("arm", gravity=[0, 0, -9.81])
    b.parameter("L", 0.5)
    b.parameter("m", 2.0)
    b.input("pull")
    b.body("upper", axis="y", **{"mass": 1, "com": [0, 0, -0.2], **keys})
    b.body(
        "hand",
        "upper",
        "universal",
        axes=["x", "y"],
        at=[0, 0, "-L"],
        mass="m",
        inertia=dict.fromkeys(("xx", "yy", "zz"), 1),
    )
    b.output("used", value="L + m + pull")
    return b


def message(b: ModelBuilder) -> str:
    with pytest.raises(ModelError) as caught:
        b.build()
    return str(caught.value)


@pytest.mark.parametrize(("formula", "text"), [
    (X / 3 - s.pi * s.sqrt(Y) / X**2, "x/3 - 3.141592653589793*sqrt(y)/x**2"),
    (-X - Y, "-x - y"),
    (s.Rational(2, 3) * X / Y, "2*x/(3*y)"),
    (X ** s.Rational(-3, 2), "1/x**(3/2)"),
    (s.exp(2) * X, "x*exp(2)"),
    (s.Max(X, Y, 3), "max(max(3, x), y)"),
    (s.Mod(X, 3), "mod(x, 3)"),
    (s.floor(X), "x - mod(x, 1)"),
    (s.cot(X), "cos(x)/sin(x)"),
    (s.log(X, 2), "log(x)/log(2)"),
    (s.Piecewise((X, X > 0), (Y, s.And(Y < 2, X <= -1)), (0, True)), "if(0 < x, x, if((-1 >= x and y < 2), y, 0))"),
    (s.Abs(s.Symbol("z")).diff(s.Symbol("z")), "sign(z)"),
])  # fmt: skip
def test_formulas_are_written_in_the_grammar(formula: s.Expr, text: str) -> None:
    assert str(read(formula)) == text


def test_numbers_stay_exact() -> None:
    assert read(s.Rational(1, 3)).tree == ("/", ("number", 1), ("number", 3))
    assert read(s.Float(0.1 + 0.2)).tree == ("number", 0.1 + 0.2)
    assert read(s.pi).tree == ("number", math.pi)
    large = s.Rational(10**40 + 1, 3 * 10**20)
    assert read(large).value == float(Fraction(10**40 + 1, 3 * 10**20))
    for text in ("1/3", "pi/2", "0.1", "2**0.5", "7"):
        assert read(to_sympy(text)).value == bind(parse(text), {}).value


@pytest.mark.parametrize("formula", [
    s.sec(X), s.csc(X), s.coth(X), s.sech(X), s.csch(X), s.acot(X), s.asec(2 + X), s.acsc(2 + X),
    s.sinc(X), s.ceiling(3 * X), s.frac(7 * X), s.Heaviside(X), s.Heaviside(-X, 1), s.Heaviside(X - X, 0.25),
    s.Piecewise((1, s.Eq(X, Y)), (2, s.Ne(X, Y) & (X > Y)), (3, s.Not(X < 5) | (Y > 9)), (4, True)),
    s.Min(X, Y, 0.3), s.erf(X) + s.erfc(Y), s.atan2(X, Y), s.sign(X - Y),
    s.Subs(s.Derivative(s.sin(T) ** 2, T), T, X), s.Integral(T * Y, (T, 0, X)), s.Sum(X**T, (T, 0, 3)),
])  # fmt: skip
def test_functions_that_the_grammar_lacks_have_their_values(formula: s.Expr) -> None:
    found = read(formula)
    for x, y in ((0.7, -0.3), (-0.6, 1.4), (0.25, 0.25)):
        expected = float(formula.doit().subs({X: s.Float(x), Y: s.Float(y)}).evalf(20))
        assert found.evaluate({"x": x, "y": y}) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("formula", "part"), [
    (s.gamma(X), "gamma(x): gamma is not a function of a model; functions are sin, cos"),
    (s.I * X, "the constant I is not real"),
    (s.acos(2) * X, "the constant acos(2) is not real"),
    (s.oo, "oo is not a finite number"),
    (s.zoo * X, "is not a finite number"),
    (s.nan, "nan is not a finite number"),
    (s.Integer(10) ** 400, "is too large"),
    (s.Piecewise((X, X > 0)), "let it end with (value, True)"),
    (s.true, "True is a BooleanTrue; an expression"),
    (s.Symbol("A", commutative=False) * X, "does not commute"),
    (s.DiracDelta(X), "DiracDelta is not a function of a model"),
])  # fmt: skip
def test_what_no_model_can_say_is_refused(formula: s.Expr, part: str) -> None:
    with pytest.raises(ExpressionError, match=part.replace("(", r"\(").replace(")", r"\)")):
        read(formula)


def test_large_and_deep_expressions() -> None:
    long = s.Add(*[s.Symbol(f"x{k}") for k in range(2000)])
    values = {f"x{k}": k + 1 for k in range(2000)}
    assert read(long).evaluate(values) == sum(values.values())
    deep = X
    for _ in range(200):
        deep = s.sin(deep)
    with pytest.raises(ExpressionError, match="operations nested too deeply"):
        read(deep)
    shared = X + 1
    for _ in range(40):
        shared = s.sin(shared) * (shared + 1)
    with pytest.raises(ExpressionError, match="more than 100000 operations"):
        read(shared)


def test_a_model_of_sympy_is_the_model_of_texts() -> None:
    L, m, pull, upper = s.Symbol("L"), s.Symbol("m", positive=True), dynamicsymbols("pull"), dynamicsymbols("upper")
    theta = dynamicsymbols("theta")
    one = arm(mass=m * L, com=s.Matrix([0, 0, -L / 2]), inertia=s.diag(m, m, 0) * L**2 / 12)
    one.symbols({theta: "q.hand.1"})
    one.joint_force("drive", "upper", pull - upper.diff() / 10 - 3 * s.sin(upper))
    one.joint_force("wrist", "hand", [-s.tanh(theta.diff()), s.Abs(theta) * s.Function("u.hand.2")(s.Symbol("t"))])
    one.spring("spring", "upper", {"body": "ground", "at": s.Matrix([[1, 0, L]])}, stiffness=100 * m, free_length=L / 3)
    one.initial(q={upper: s.Rational(1, 3), theta: s.pi / 4})
    height = s.Function("position.hand.z")(s.Symbol("t"))
    one.force(
        "floor",
        "force",
        on="hand",
        value=[0, 0, s.Piecewise((-9 * height + height.diff(), height < 0), (0, True))],
    )
    one.output("height", value=s.Piecewise((upper, upper > 0), (0, True)))
    text = parse_model("""
model: arm
gravity: [0, 0, -9.81]
parameters: {L: 0.5, m: 2}
inputs: [pull]
bodies:
  upper: {parent: ground, joint: {type: revolute, axis: y}, mass: L*m, com: [0, 0, -L/2],
          inertia: {xx: m*L**2/12, yy: m*L**2/12}}
  hand: {parent: upper, joint: {type: universal, axes: [x, y], at: [0, 0, -L]}, mass: m, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  drive: {type: joint, joint: upper, value: pull - 3*sin(q.upper) - u.upper/10}
  wrist: {type: joint, joint: hand, value: [-tanh(u.hand.1), u.hand.2*abs(q.hand.1)]}
  spring: {type: spring, from: upper, to: {body: ground, at: [1, 0, L]}, stiffness: 100*m, free_length: L/3}
  floor: {type: force, on: hand, value: [0, 0, "if(position.hand.z < 0, velocity.hand.z - 9*position.hand.z, 0)"]}
initial: {q: {upper: 1/3, hand.1: pi/4}}
outputs:
  used: {value: L + m + pull}
  height: {value: "if(0 < q.upper, q.upper, 0)"}
""")
    built = one.build()
    for name in ("bodies", "loads", "outputs", "initial_q"):
        assert repr(getattr(built, name)) == repr(getattr(text, name)), name
    rng = np.random.default_rng(1)
    for force, same in zip(built.forces, text.forces, strict=True):
        for value, other in zip(force.values, same.values, strict=True):
            at = {n: rng.normal() for n in value.names | other.names}
            assert value.evaluate(at) == pytest.approx(other.evaluate(at), rel=1e-14)


def test_names_of_a_builder_compute_with_sympy() -> None:
    b = ModelBuilder("one")
    L, m = b.parameter("L", 1.0), s.Symbol("m")
    assert str(L * m) == str(m * L) == "L*m" and str((L / 3) * s.sin(m)) == "L*sin(m)/3"
    assert str(s.cos(L)) == "cos(L)" and str(L - m) == "L - m" and str(m**2 / L) == "m**2/L"
    assert is_sympy(L * m) and not is_sympy(L) and not is_sympy(0.5)


def test_symbols_of_the_model_alone_are_known() -> None:
    b = arm()
    wrong, other = s.Symbol("LL"), dynamicsymbols("uper")
    b.output("a", value=wrong * 2)
    b.output("b", value=other)
    b.output("c", value=dynamicsymbols("hand"))
    b.output("d", value=dynamicsymbols("upper").diff().diff())
    b.output("e", value=dynamicsymbols("pull").diff())
    b.output("f", value=s.Function("f")(s.Symbol("L")))
    b.output("g", value=s.Dummy("L"))
    b.output("h", position="hand", axis=s.Matrix([[1, 2], [3, 4]]))
    said = message(b)
    for part in (
        "outputs.a.value: unknown name 'LL'; known here: L, m, pull, t; did you mean 'L'?",
        "outputs.b.value: uper(t) is not a coordinate, speed or input of this model; functions of time here are pull, upper; did",
        "outputs.c.value: hand(t): the joint of 'hand' has the coordinates q.hand.1, q.hand.2; ModelBuilder.symbols(",
        "outputs.d.value: Derivative(upper(t), (t, 2)) is an acceleration; only coordinates and speeds are allowed",
        "outputs.e.value: Derivative(pull(t), t) is the derivative of input 'pull'; only those of coordinates are allowed",
        "outputs.f.value: f(L): unknown function 'f' of L",
        "outputs.g.value: the dummy symbol _L has no name of its own",
        "outputs.h.axis: a matrix has the shape (2, 2); a row or a column is allowed",
    ):
        assert part in said, said


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (s.IndexedBase("x")[0], "x[0]"),
        (s.IndexedBase("x"), "x"),
        (s.Lambda(s.Symbol("L"), s.Symbol("L")), "is a Lambda; an expression with a real value is needed"),
        (s.Array([[[1, 2]]]), "an array has the shape (1, 1, 2); a row or a column is allowed"),
        (s.MatrixSymbol("A", 2, 2)[0, 0], "A[0, 0]"),
    ],
)  # fmt: skip
def test_objects_that_are_no_numbers_are_named(value: s.Basic, said: str) -> None:
    b = arm()
    b.output("a", value=value)
    assert f"outputs.a.value: {said}" in message(b) or said in message(b)


def test_a_motion_may_not_stand_where_parameters_are_needed() -> None:
    assert "bodies.upper.mass: 'q.upper', which changes with the motion, is not allowed here" in message(
        arm(mass=dynamicsymbols("upper"))
    )


def test_quaternion_rates_are_no_speeds() -> None:
    b = ModelBuilder("ball")
    b.body("ball", joint="spherical", mass=1, inertia=s.eye(3))
    b.output("rate", value=s.Function("q.ball.qw")(s.Symbol("t")).diff())
    assert "not speeds; use u.ball.wx, u.ball.wy, u.ball.wz" in message(b)


def test_wrong_matrices_and_names() -> None:
    assert "the inertia matrix is not symmetric" in message(arm(inertia=s.Matrix(3, 3, range(9))))
    with pytest.raises(TypeError, match="symbols takes a mapping from sympy's symbols"):
        arm().symbols({"theta": "q.upper"})
    twice = arm()
    twice.initial(q={dynamicsymbols("upper"): 1, "upper": 2})
    assert "name 'upper' is given twice" in message(twice)


def test_tables_are_functions() -> None:
    b = arm()
    b.table("curve", x=[0, 1, s.Rational(5, 2)], y=[0, s.Symbol("L"), 1], outside="constant")
    b.output("at", value=s.Function("curve")(2 * s.Symbol("L")))
    assert b.build().outputs[-1].expression.evaluate({"L": 0.25}) == 0.125


def test_formulas_of_models_in_sympy() -> None:
    import codegen.symbolic

    q = dynamicsymbols("q")
    names = {"q.arm": q}
    assert codegen.symbolic.to_sympy("sin(q.arm)/3 + pi*max(q.arm, 2)", names) == s.sin(q) / 3 + s.pi * s.Max(
        2, q, evaluate=False
    )
    assert codegen.symbolic.to_sympy("x", lambda name: s.Symbol(name.upper())) == s.Symbol("X")
    found = to_sympy("if(x - x <= 5 and x > 1, 2*mod(x, 3), 0)")
    deep = "((if(b - pi > pi - a, b - pi, 2*(pi - a)) * if(a/3 > acos(sin(pi)) and a/3 > -1, a/3, 2))**2)"
    assert set(to_sympy(deep).free_symbols) == set(s.symbols("a b", real=True))
    assert str(found) == "Piecewise((2*x - 6*floor(x/3), 1 < x), (0, True))"
    assert to_sympy(0.5) == s.Float(0.5) and to_sympy("30 mm") == s.Float(0.03)


def test_random_formulas_have_equal_values_in_both_algebras() -> None:
    compared = sum(compare(np.random.default_rng(seed)) for seed in range(30))
    assert compared > 75


@pytest.mark.campaign
def test_ten_thousand_random_formulas_have_equal_values_in_both_algebras() -> None:
    compared = sum(compare(np.random.default_rng(seed)) for seed in range(1000, 11_000))
    assert compared > 25_000


def compare(rng: np.random.Generator) -> int:
    """Compare text and sympy in both directions; returns at how many points values were finite, real and equal."""
    text = random_formula(rng)
    own = bind(parse(text), {})
    theirs = to_sympy(own)
    back = read(theirs)
    values = s.lambdify(s.symbols(NAMES, real=True), theirs, ["mpmath"])
    compared = 0
    for _ in range(4):
        at = {name: round(rng.uniform(-2, 2), 3) for name in NAMES}
        try:
            value = own.evaluate(at)
        except (ArithmeticError, ValueError):
            continue
        with mpmath.workdps(30):
            expected = values(*map(mpmath.mpf, at.values()))
        scale = max(1.0, abs(value))
        if not math.isfinite(value) or scale > 1e6:
            continue
        assert mpmath.im(expected) == 0, (text, at)
        assert float(mpmath.re(expected)) == pytest.approx(value, abs=1e-8 * scale), (text, at)
        assert back.evaluate(at) == pytest.approx(value, abs=1e-8 * scale), (text, at)
        compared += 1
    return compared


def test_a_model_without_sympy_is_generated_without_it(tmp_path: Path) -> None:
    code = f"""
import sys
import codegen
from codegen.model import ModelBuilder
b = ModelBuilder("one", gravity=[0, 0, -9.81])
L = b.parameter("L", 1.0)
b.body("arm", axis="y", mass=1, com=[0, 0, -L / 2], inertia={{"yy": 1}})
b.joint_force("drive", "arm", "-q.arm")
b.force("band", "hardening_spring", start="ground", end={{"body": "arm", "at": [1, 0, 0]}}, stiffness=3, hardening=2)
codegen.generate(b.build(), {str(tmp_path / "one")!r}, target="numpy")
print("sympy" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("False\n")
