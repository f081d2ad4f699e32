"""Derivative primitives of the statements of whole models against `sympy.diff` of the statements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import coupled_models
import mpmath
import numpy as np
import point_condition_models as conditions
import pytest
import sympy as s
from force_elements import LOOP, TREE, with_elements
from ingredients import mixtures
from random_elements import with_random_elements
from random_models import random_tree

import codegen
from codegen.elementary import BY_SYMBOL
from codegen.model import Model, parse_model
from codegen.program import algebra, derivatives
from codegen.program.algebra import Expr, Number, Pow, Symbol
from codegen.program.block import Statement

DIGITS = 40


class Flat(s.Function):
    """A function whose derivative is taken as zero where it does not jump: sign, floor and comparisons."""

    nargs = (2, 3)

    def fdiff(self, argindex: int = 1) -> s.Expr:
        return s.Integer(0)


FUNCTIONS: dict[str, Callable[..., s.Expr]] = {
    "Sign": lambda x: Flat(0, x),
    "Floor": lambda x: Flat(1, x),
    "AtLeast": lambda a, b: Flat(2, a, b),
    "Turn": lambda x: x,
    "Angle": s.atan2,
    "Absolute": lambda x: x * Flat(0, x),
    "Maximum": lambda a, b: b + (a - b) * Flat(2, a, b),
    "Minimum": lambda a, b: b + (a - b) * Flat(2, b, a),
    "Choice": lambda c, x, y: s.Piecewise((x, s.Ne(c, 0)), (y, True), evaluate=False),
    "Vanishing": lambda a, b: a * b,
    "Along": lambda a, b: a * b,
    "Power": s.Pow,
}
"""Functions of statements that are no elementary ones; a held one has a mode as its last argument, which is left out."""


def theirs(e: Expr) -> s.Expr:
    """A statement's expression in sympy."""
    if isinstance(e, Symbol):
        return s.Symbol(e.name, real=True)
    if isinstance(e, Number):
        return s.Rational(Fraction(e.value))
    args = [theirs(a) for a in e.args]
    if isinstance(e, algebra.Function):
        held = e.name.startswith("Held")
        name, args = e.name.removeprefix("Held"), args[:-1] if held else args
        if name in FUNCTIONS:
            return FUNCTIONS[name](*args)
        return getattr(s, BY_SYMBOL[name].spelled("sympy"))(*args)
    return {algebra.Add: s.Add, algebra.Mul: s.Mul, Pow: s.Pow}[type(e)](*args)


def flat(kind: int, a: Any, b: Any = 0) -> Any:
    """The values of `Flat` functions: of a sign, of a floor, of a comparison."""
    if kind == 1:
        return mpmath.floor(a)
    return mpmath.sign(a) if kind == 0 else mpmath.mpf(a >= b)


class Case(NamedTuple):
    """An expression, and its derivatives with respect to some symbols according to the generator."""

    expression: Expr
    slopes: dict[Symbol, Expr]
    defined: dict[Symbol, Expr]


def error(case: Case, rng: np.random.Generator) -> float | None:
    """The largest relative difference of the primitives from sympy's derivatives at a random point; None without values."""
    defined = {k: v for k, v in case.defined.items() if k not in case.slopes}
    e, symbols = _put_in(theirs(case.expression), defined), list(case.slopes)
    expected = [s.diff(e, theirs(x)) for x in symbols]
    found = [_put_in(theirs(case.slopes[x]), defined) for x in symbols]
    free = sorted({x for part in (*expected, *found) for x in part.free_symbols}, key=str)
    values = s.lambdify(free, [expected, found], [{"Flat": flat}, "mpmath"])
    with mpmath.workdps(DIGITS):
        try:
            one, other = values(*(mpmath.mpf(float(x)) for x in rng.uniform(0.3, 0.9, len(free))))
        except (ZeroDivisionError, ValueError):
            return None
        differences = [abs(a - b) / (1 + abs(a)) for a, b in zip(one, other, strict=True)]
    return None if any(map(mpmath.isnan, differences)) else float(max(differences, default=0))


def _put_in(e: s.Expr, defined: dict[Symbol, Expr]) -> s.Expr:
    """An expression into which the definitions of its symbols are substituted."""
    names = {theirs(k): v for k, v in defined.items()}
    while inner := [x for x in e.free_symbols if x in names]:
        e = e.xreplace({x: theirs(names[x]) for x in inner})
    return e


def cases(model: Model, folder: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> dict[Expr, Case]:
    """Everything that is differentiated while a solver of the model is generated."""
    recorded: dict[Expr, Case] = {}
    partials, statement = derivatives.partials, derivatives.Tangents.statement

    def recording(e: Expr) -> dict[Symbol, Expr]:
        found = partials(e)
        recorded.setdefault(e, Case(e, dict(found), {}))
        return found

    def with_known(self: derivatives.Tangents, of: Statement) -> None:
        known = self.known.get(of.target)
        if known is not None and all(isinstance(x, Symbol) for x, _ in known):
            defined = {x.target: x.expression for x in self.expansion.block.statements}
            slopes: dict[Symbol, Expr] = {}
            for x, d in known:
                slopes[x] = slopes[x] + d if x in slopes else d
            recorded.setdefault(of.target, Case(of.expression, slopes, defined))
        statement(self, of)

    monkeypatch.setattr(derivatives, "partials", recording)
    monkeypatch.setattr(derivatives.Tangents, "statement", with_known)
    codegen.generate(model, folder, target="numpy", **options)
    monkeypatch.undo()
    return recorded


def wrong(found: dict[Expr, Case], rng: np.random.Generator, most: int | None = None) -> Iterator[tuple[str, float]]:
    """Statements of a draw whose primitives are not sympy's; at least nine in ten have values."""
    drawn = list(found.values())
    if most is not None:
        drawn = [drawn[i] for i in rng.permutation(len(drawn))[:most]]
    errors = [(str(c.expression), error(c, rng)) for c in drawn]
    assert sum(e is not None for _, e in errors) > 0.9 * len(errors)
    yield from ((text, e) for text, e in errors if e is not None and e > 10.0 ** (10 - DIGITS))


SPRING = "first: {type: spring, from: {body: a, at: [0, 0.2, l]}, to: tip, stiffness: 0.3*k, damping: pull**2, free_length: l}"


@pytest.mark.parametrize("text", [TREE, LOOP], ids=["tree", "loop"])
def test_drawn_primitives_are_those_of_sympy(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = cases(with_elements(text, SPRING), tmp_path / "m", monkeypatch)
    assert len(found) > 100
    assert list(wrong(found, np.random.default_rng(0), 30)) == []


@pytest.mark.campaign
@pytest.mark.parametrize("mixture", mixtures(every=True), ids=lambda m: m.name)
def test_primitives_of_mixtures_are_those_of_sympy(
    mixture: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = cases(parse_model(mixture.text), tmp_path / "m", monkeypatch, **mixture.options)
    assert list(wrong(found, np.random.default_rng(1))) == []


OTHERS = {
    **{f"condition {name}": text for name, text in conditions.MODELS.items()},
    **{f"coupling {name}": text for name, text in coupled_models.MODELS.items()},
}


@pytest.mark.campaign
@pytest.mark.parametrize("name", OTHERS)
def test_primitives_of_conditions_and_couplings_are_those_of_sympy(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = cases(parse_model(OTHERS[name]), tmp_path / "m", monkeypatch)
    assert list(wrong(found, np.random.default_rng(2))) == []


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(10))
def test_primitives_of_random_trees_with_elements_are_those_of_sympy(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    found = cases(with_random_elements(rng, random_tree(rng, 5)), tmp_path / "m", monkeypatch)
    assert list(wrong(found, rng)) == []
