"""Expressions of statements against sympy: the results of the same operations, with the same order of terms and factors."""

from __future__ import annotations

import gc
import random
import weakref
from collections.abc import Callable
from fractions import Fraction

import pytest
import sympy

from codegen.program import algebra
from codegen.program.algebra import Expr, Number, Pow, Symbol, expressions_kept
from codegen.program.operations import count_expression

NAMES = ("a", "b", "c", "d_1", "d_10", "W")


def theirs(e: Expr) -> sympy.Expr:
    """The same expression in sympy, without further simplification."""
    if isinstance(e, Symbol):
        return sympy.Symbol(e.name)
    if isinstance(e, Number):
        return sympy.Rational(e.value) if isinstance(e.value, (int, Fraction)) else sympy.Float(e.value)
    args = [theirs(a) for a in e.args]
    kind = {algebra.Add: sympy.Add, algebra.Mul: sympy.Mul, Pow: sympy.Pow}[type(e)]
    return kind(*args, evaluate=False)


OPERATIONS: list[Callable] = [
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x * y, lambda x, y: -x, lambda x, y: 2 * x,
    lambda x, y: x * 0, lambda x, y: 1 / x, lambda x, y: x**2, lambda x, y: x / y, lambda x, y: x + 1, lambda x, y: x - x + y,
]  # fmt: skip


@pytest.mark.parametrize("seed", range(40))
def test_the_same_operations_give_the_same_expressions(seed: int) -> None:
    rng = random.Random(seed)
    mine: list[Expr] = [Symbol(n) for n in NAMES]
    other: list[sympy.Expr] = [sympy.Symbol(n) for n in NAMES]
    for _ in range(60):
        i, j, operation = rng.randrange(len(mine)), rng.randrange(len(mine)), rng.choice(OPERATIONS)
        if mine[i] == 0 or mine[j] == 0:
            continue
        found, expected = operation(mine[i], mine[j]), operation(other[i], other[j])
        assert theirs(algebra.expression(found)) == expected
        if len(str(expected)) < 60:  # statements are short
            mine.append(found)
            other.append(expected)


@pytest.mark.parametrize("seed", range(3))
def test_operands_that_are_apart_need_no_collecting(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes the short way comes to the same expression as what is collected, signs, doubles and powers too."""
    rng = random.Random(seed)
    x, y, z = map(Symbol, "xyz")
    with expressions_kept():
        known: list[Expr] = [
            x,
            y,
            z,
            x + y,
            2 * x,
            -y,
            x * y,
            0.3 * z,
            z**2,
            1 / x,
            algebra.function("sin", x + z),
            Number(3),
        ]
        for _ in range(300):
            operands = tuple(rng.choice(known) for _ in range(rng.choice((2, 2, 3))))
            total, product = algebra._sum(operands), algebra._product(operands)
            with monkeypatch.context() as patched:
                patched.setattr(algebra, "_are_apart", lambda terms: False)
                assert algebra._sum(operands) is total
            assert algebra._product((algebra.ONE, *operands)) is product
            if len(str(total) + str(product)) < 120:
                known += [total, product]


def test_equal_expressions_are_the_same() -> None:
    a, b = Symbol("a"), Symbol("b")
    with expressions_kept():
        assert a + b is b + a
        assert (a * b) * b is a * (b * b)
        assert (a + b) - a is b
        assert {a * b: 1}[b * a] == 1
        kept = a * b + 1
    with expressions_kept():
        assert Symbol("a") is a
        assert kept.xreplace({a: algebra.ZERO}) == 1


def test_doubles_that_are_whole_are_whole_numbers() -> None:
    assert Number(2.0) is Number(2) and Number(-0.0) is algebra.ZERO
    assert Number(0.5) * Symbol("a") * 2 is Symbol("a")
    assert Number(0.5) != Number(Fraction(1, 3)) and Number(1e300).value == 1e300
    assert not Number(float("inf")).is_finite and not (1 / algebra.ZERO).is_finite  # type: ignore[attr-defined]


def test_roots_and_functions_of_numbers_have_values() -> None:
    assert algebra.sqrt(4) == 2 and algebra.sqrt(Fraction(1, 4)) == 0.5
    assert algebra.value_of_number(algebra.sqrt(2)) == 2**0.5
    assert algebra.sqrt(2) ** 2 == 2


def test_what_is_no_expression_is_refused() -> None:
    with pytest.raises(TypeError, match="is not an expression"):
        Symbol("a") + "b"
    with pytest.raises(TypeError, match="exponents are numbers"):
        Symbol("a") ** Symbol("b")


@pytest.mark.parametrize("value", [0, 1, -3, 2**60, 0.5, -1e300, Fraction(1, 3), Fraction(1, 2), float("inf")])
def test_equal_numbers_hash_alike(value: float | Fraction) -> None:
    number = Number(value)
    assert number == value and hash(number) == hash(value)
    assert {number: 1}[value] == 1 and {value: 1}[number] == 1  # type: ignore[index]
    others = [Number(v) for v in (0, 1, -3, 2**60, 0.5, -1e300, Fraction(1, 3), Fraction(1, 2), float("inf"))]
    assert all(hash(number) == hash(other) for other in others if number == other)


def test_nothing_is_kept_of_expressions_that_nobody_uses() -> None:
    gc.collect()
    before = set(algebra._symbols)
    with expressions_kept():
        e = Symbol("only_here") * 2 + Symbol("and_here") ** 3
        assert count_expression(e).multiplications == 3
        assert {"only_here", "and_here"} <= set(algebra._symbols)
        of_one = weakref.ref(Symbol("only_here"))
        del e
    gc.collect()
    assert of_one() is None and set(algebra._symbols) <= before and not algebra._made


def test_a_symbol_is_the_same_while_it_is_used() -> None:
    a = Symbol("used")
    gc.collect()
    assert Symbol("used") is a
