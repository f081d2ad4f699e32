"""Derivatives of random expressions in closed form, at ordinary points, against difference quotients in 60 digits."""

from __future__ import annotations

import random

import mpmath

from codegen.model.binding import bind
from codegen.model.expressions import Expression, functions_for
from codegen.model.parsing import parse
from codegen.model.slopes import regular, slope

LEAVES = ["x", "y", "0.3", "-1.7", "2", "0.1", "(x - 0.3*y)", "(y + 2.1)"]
FORMS = [
    "({a})*({b})", "({a})*({b})*0.7", "sqrt(({a})**2 + 1.3*({b})**2)", "abs({a})**0.3", "({a})/(({b})*({b}) + 0.1)",
    "0.9*(({a}) + ({b}))", "abs(0.3*({a}))**1.1*(-0.6)", "(({a})**2 + 0.2)**(x*0.3)", "max(0.2, {a})**1.4*({b})",
    "if({a} > {b}, ({a})**3, {b})", "atan2({a}, 1.5)*({a})", "6*({a})/3*2", "0.9*({a})/(-3)/({b} + 5)*0.5",
    "-0.7*({a})/7*({b})/0.1",
]  # fmt: skip


def drawn(rng: random.Random, depth: int) -> str:
    if not depth:
        return rng.choice(LEAVES)
    return rng.choice(FORMS).format(a=drawn(rng, depth - 1), b=drawn(rng, depth - 1))


def test_random_expressions() -> None:
    rng, functions = random.Random(5), functions_for(mpmath)
    with mpmath.workdps(60):
        at = {"x": mpmath.mpf("0.37"), "y": mpmath.mpf("-0.81")}
        h = mpmath.mpf(10) ** -25
        for _ in range(150):
            e = bind(parse(drawn(rng, 2)), {})
            tree = regular(e.tree)
            value = e.evaluate(at, functions)
            assert abs(Expression(tree).evaluate(at, functions) - value) < 1e-14 * (1 + abs(value)), e
            for name in at:
                up, down = (e.evaluate(at | {name: at[name] + s}, functions) for s in (h, -h))
                d = Expression(slope(tree, ("name", name))).evaluate(at, functions)
                assert abs(d - (up - down) / (2 * h)) < 1e-13 * (1 + abs(d)), (e, name)
