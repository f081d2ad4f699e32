# ruff: noqa: E501  (tables)
"""Conditions, smooth steps, distances of points and named expressions: their values in all engines, and errors."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.binding import bind
from codegen.model.expressions import functions_for
from codegen.model.grammar import ExpressionError
from codegen.model.parsing import parse
from codegen.reference import DenseEngine, RecursiveEngine

CONDITIONS = {
    "a < b": lambda a, b, c: a < b,
    "a <= b": lambda a, b, c: a <= b,
    "a > b": lambda a, b, c: a > b,
    "a >= b": lambda a, b, c: a >= b,
    "not a < b": lambda a, b, c: not a < b,
    "not (a < b or c > b)": lambda a, b, c: not (a < b or c > b),
    "a < b and c < b or a > c": lambda a, b, c: (a < b and c < b) or a > c,
    "a < b and (c < b or a > c)": lambda a, b, c: a < b and (c < b or a > c),
    "(a + b)*2 < 3*c and not ((a > 1))": lambda a, b, c: (a + b) * 2 < 3 * c and not a > 1,
    "((a) < (b))": lambda a, b, c: a < b,
    "a < b or b < c or c < a": lambda a, b, c: a < b or b < c or c < a,
}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_conditions_mean_what_python_means(condition: str) -> None:
    expression = parse(f"if({condition}, 10 + a, -20*b)")
    for a, b, c in itertools.product((0.0, 1.0, 2.5), repeat=3):
        values = {"a": a, "b": b, "c": c}
        expected = 10 + a if CONDITIONS[condition](a, b, c) else -20 * b
        assert expression.evaluate(values) == expected
        assert bind(expression, values).value == expected
        assert expression.evaluate({k: mpmath.mpf(v) for k, v in values.items()}, functions_for(mpmath)) == expected


def test_a_step_is_smooth() -> None:
    step = parse("step(x, a, b)")
    at = lambda x, a=1.0, b=3.0: step.evaluate({"x": x, "a": a, "b": b})  # noqa: E731
    assert (at(0.0), at(1.0), at(2.0), at(3.0), at(9.0)) == (0, 0, 0.5, 1, 1)
    assert at(2.0, 3.0, 1.0) == 0.5 and at(0.0, 3.0, 1.0) == 1
    with mpmath.workdps(30):
        f = lambda x: step.evaluate({"x": x, "a": mpmath.mpf(1), "b": mpmath.mpf(3)}, functions_for(mpmath))  # noqa: E731
        for edge in (1, 3):
            for order in (1, 2):
                assert abs(mpmath.diff(f, edge, order, h=mpmath.mpf("1e-8"))) < 1e-6


MODEL = """\
model: words
gravity: [0, 0, -9.81]
parameters: {k: 40.0, mu: 0.4, edge: 0.1}
expressions:
  depth: max(0, 0.8 + position.tip.z)
  normal: 2*k*depth
  slip: velocity.tip.x
  shove: if(q.leg > edge and (u.leg > 0 or q.leg >= 2*edge), -k*(q.leg - edge), -20*q.leg)
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.1, 0, -0.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  leg: {parent: arm, joint: {type: prismatic, axis: z, at: [0, 0, -0.6]}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
points:
  tip: {body: leg, at: [0, 0, -0.3]}
  eye: {body: ground, at: [0.1, 0, 0.3]}
forces:
  contact: {type: force, on: tip, value: [-mu*normal*tanh(slip/0.5), 0, normal]}
  stop: {type: joint, joint: leg, value: shove}
  pull: {type: torque, on: arm, value: [0, "step(t, 0, 1)*distance(tip, eye) - 0.1*rate(tip, eye) + distance(tip, ground)", 0]}
outputs:
  reach: {value: "q.leg + step(q.arm, -1, 1)"}
"""
SAME = (
    MODEL.partition("expressions:")[0]
    + "bodies:"
    + MODEL.partition("bodies:")[2]
    .replace("normal", "(2*k*max(0, 0.8 + position.tip.z))")
    .replace("slip", "velocity.tip.x")
    .replace("value: shove", 'value: "if(q.leg > edge and (u.leg > 0 or q.leg >= 2*edge), -k*(q.leg - edge), -20*q.leg)"')
    .replace("value: [-mu", 'value: ["-mu').replace("/0.5), 0, (2*k*max(0, 0.8 + position.tip.z))]", '/0.5)", 0, "2*k*max(0, 0.8 + position.tip.z)"]')
)  # fmt: skip
STATES = (
    ([0.3, 0.15], [0.2, -0.3], 0.4), ([0.3, 0.15], [0.2, 0.3], 1.4), ([0.3, 0.25], [0.2, -0.3], 0.9), ([2.0, 0.05], [1.0, -0.3], 0.5),
)  # fmt: skip


def test_names_stand_for_their_expressions() -> None:
    one, two = parse_model(MODEL), parse_model(SAME)
    assert [str(e) for f in one.elements for e in f.expressions()] == [
        str(e) for f in two.elements for e in f.expressions()
    ]


def test_switching_functions_are_found() -> None:
    model = parse_model(MODEL)
    assert model.warnings == ()  # a motion finds where forces jump
    assert {"forces.stop.value"} <= {place for s in model.switches.found for place in s.places}
    assert {s.words for s in model.switches.found} >= {"edge >= q.leg", "0 >= u.leg", "q.leg >= 2*edge"}
    fixed = MODEL.replace("q.leg > edge and (u.leg > 0 or q.leg >= 2*edge)", "k > edge")
    assert "forces.stop.value" not in {place for s in parse_model(fixed).switches.found for place in s.places}


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_generated_code_agrees_with_both_engines(tmp_path: Path, target: str) -> None:
    model = parse_model(MODEL)
    functions = ("accelerations", "sensitivities", "jacobians", "output_sensitivities")
    codegen.generate(model, tmp_path / "words", target=target, functions=functions)
    solver = codegen.load(tmp_path / "words")
    with mpmath.workdps(40):
        engines = [DenseEngine(model, numbers="mpmath"), RecursiveEngine(model, numbers="mpmath")]
        for q, u, t in STATES:
            found = solver.jacobians(q, u, None, None, t)
            for engine in engines:
                wanted = engine.jacobians(q, u, None, None, t)
                for name in ("q", "u", "p", "t"):
                    a, b = np.atleast_2d(getattr(found, name).T), np.atleast_2d(getattr(wanted, name).T).astype(float)
                    scale = np.abs(b).max(axis=1, keepdims=True)
                    assert (np.abs(a - b) <= 1e-13 * scale).all(), (name, q, u)


def test_slopes_keep_their_digits_where_functions_are_flat(tmp_path: Path) -> None:
    """Those of tanh at 12 and of asin beside 1: 1 - tanh**2 and 1 - x**2 have lost them."""
    b = ModelBuilder("flat")
    inertia = {"xx": 1, "yy": 1, "zz": 1}
    b.body("a", axis="y", mass=1, inertia=inertia)
    b.body("c", axis="y", mass=1, inertia=inertia)
    b.joint_force("friction", "a", "-tanh(u.a)")
    b.joint_force("bent", "c", "asin(q.c)")
    for target in ("c", "numpy"):
        codegen.generate(b.build(), tmp_path / target, target=target, functions=("accelerations", "jacobians"))
        x, q = 12.0, 1 - 2.0**-40
        found = codegen.load(tmp_path / target).jacobians([0, q], [x, 0])
        assert found.u[0, 0] == pytest.approx(-1 / math.cosh(x) ** 2, rel=1e-14)
        with mpmath.workdps(40):
            assert found.q[1, 1] == pytest.approx(float(1 / mpmath.sqrt(1 - mpmath.mpf(q) ** 2)), rel=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("if(a, 1, 2)", "',' where one of < <= > >= is needed"),
        ("if(a < b, 1)", "write if(condition, x, y)"),
        ("if(a < b)", "write if(condition, x, y)"),
        ("if(a < b < c, 1, 2)", "where a comma is needed"),
        ("if(a = b, 1, 2)", "an expression has no equals sign"),
        ("if((a < b) + 1 > 2, 1, 2)", "'<' found, but a closing parenthesis"),
        ("a < b", "'<' follows a complete expression"),
        ("step(x, 1)", "step with 2 arguments; write step(x, from, to)"),
        ("distance(tip)", "distance with only one point; write distance(POINT, POINT)"),
        ("distance(2, tip)", "a point is needed, by its name or that of a body"),
        ("rate(q.a, tip)", "a point is needed"),
        ("iff(a, 1, 2)", "did you mean 'if'?"),
        ("if(" * 120 + "a < b" + ", 1, 2) < 1, 1, 2)" * 120, "levels of parentheses"),
    ],
)
def test_mistakes_in_expressions(text: str, message: str) -> None:
    with pytest.raises(ExpressionError) as info:
        parse(text)
    assert message in str(info.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("slip: velocity.tip.x", "slip: velocity.tp.x", "m.yaml:7:9: expressions.slip: unknown point 'tp'"),
        ("slip: velocity.tip.x", "slip: q.lag", "expressions.slip: unknown coordinate 'q.lag'"),
        ("normal: 2*k*depth", "normal: 2*k*dept", "expressions.normal: unknown name 'dept';*did you mean 'depth'?"),
        ("normal: 2*k*depth", "normal: 2*k*depth\n  spare: mu*2", "warning: expressions.spare: expression 'spare' is not used"),
        ("  slip: velocity.tip.x", "  k: t\n  slip: velocity.tip.x", "name 'k' is already taken by a parameter"),
        ("mass: 1, com: [0.1", "mass: depth, com: [0.1", "bodies.arm.mass: 'position.tip.z', which changes with the motion, is not allowed here"),
    ],
)  # fmt: skip
def test_mistakes_in_named_expressions(old: str, new: str, expected: str) -> None:
    assert old in MODEL
    try:
        found = list(parse_model(MODEL.replace(old, new, 1), "m.yaml").warnings)
    except ModelError as error:
        found = str(error).splitlines()
    matching = [line for line in found if all(part in line for part in expected.split("*"))]
    assert len(matching) == 1, "\n".join(found)
    assert sum("warning" not in line for line in found) <= 1, "\n".join(found)


def test_names_of_names_do_not_grow_beyond_measure() -> None:
    lines = "\n".join(f"  e{k}: e{k - 1}*e{k - 1} + 1" for k in range(1, 40))
    text = MODEL.replace("expressions:\n", f"expressions:\n  e0: t\n{lines}\n")
    with pytest.raises(ModelError, match=r"expressions.e1\d: with the named expressions inserted"):
        parse_model(text)


def test_the_builder_names_expressions() -> None:
    b = ModelBuilder("m")
    b.body("a", axis="y", mass=1, inertia={"xx": 1, "yy": 1, "zz": 1})
    drag = b.expression("drag", "2*u.a")
    b.joint_force("f", "a", -drag * 3)
    assert str(b.build().forces[0].values[0]) == "-(2*u.a)*3"


def test_a_number_whose_branch_that_is_not_taken_has_no_value() -> None:
    """Neither the value nor a derivative of the other branch matters, in constants of links either."""
    model = parse_model(
        "model: m\ngravity: [0, 0, -9.81]\nparameters: {n: 0.0, h: 0.0}\nbodies:\n"
        "  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 'if(n > 0, 1 + sqrt(n), 1)', "
        "com: ['if(n > 1, log(n - 1), 1)', 0, h**2*log(abs(h))], inertia: {xx: 1, yy: 1, zz: 1}}\n"
    )
    J = DenseEngine(model).jacobians([0.3], [0.1])
    assert not J.p.any() and np.isfinite(J.q).all()
