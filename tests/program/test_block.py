"""Expansion, passes and derivative primitives: properties on random programs, not printed text."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from codegen.program import algebra
from codegen.program.algebra import Expr, Symbol, derivative, expression
from codegen.program.block import ANY, Block, Expansion, Statement, StructuralExpansion
from codegen.program.derivatives import Tangents, partials
from codegen.program.digits import number
from codegen.program.functions import SYMBOLIC, Absolute, AtLeast, Maximum, Minimum
from codegen.program.operations import count, count_expression
from codegen.program.passes import PASSES, share_factors, share_products, simplify
from codegen.program.store import Memory, Owner, Store

MODEL, ARGUMENT = Owner("model"), Memory("argument")
IN, OUT = Store("in", MODEL, ARGUMENT), Store("out", MODEL, ARGUMENT)


def evaluated(e: Expr, values: dict[Symbol, float]) -> float:
    """The value of an expression."""
    return algebra.value_of_number(e.xreplace({s: number(v) for s, v in values.items()}))


def random_block(rng: np.random.Generator, statements: int = 30) -> Block:
    """A block of random sums of products, with copies, negatives, repeated values and dead statements."""
    x = Expansion("random", "random", lambda array, name: True)
    values = [x.component(IN, str(i)) for i in range(4)]
    for k in range(statements):
        a, b, c = (values[int(i)] for i in rng.integers(0, len(values), 3))
        form = int(rng.integers(0, 7))
        e = [a * b + c, a * b - c * a, a, -b, a * b, a * b + a * c, (a + 2) * c][form]
        symbol = Symbol(f"s{k}")
        x.block.statements.append(Statement(symbol, expression(e), "tag"))
        values.append(symbol)
    for i in range(3):
        x.set_component(OUT, str(i), values[-1 - 2 * i] * int(rng.integers(-1, 2)))
    return x.finish()


def test_products_that_are_shared_later_get_names_of_their_own() -> None:
    """The passes run again on blocks that were put together of simplified ones."""
    c, d, e, f, x, y = map(Symbol, "cdefxy")
    symbols = list(map(Symbol, "TUV"))

    def block(*expressions: Expr) -> Block:
        statements = [Statement(s, e) for s, e in zip(symbols, expressions, strict=False)]
        return Block("shared", "shared", {}, statements, [(OUT, str(i), s.target) for i, s in enumerate(statements)])

    once = share_products(block(c * d + x * y, x * y + e))
    once.statements.append(Statement(symbols[2], c * d + f))
    twice = share_products(once)
    names = [s.target for s in twice.statements]
    assert len(set(names)) == len(names) == 5
    values = {s: i + 2.0 for i, s in enumerate((c, d, e, f, x, y))}
    for s in twice.statements:
        values[s.target] = evaluated(s.expression, values)
    assert values[symbols[0]] == 2 * 3 + 6 * 7


def test_a_named_part_of_a_product_is_used() -> None:
    """Its name is computed earlier then; quotients come first."""
    a, b, c, d, e, f = map(Symbol, "abcdef")
    statements = [Statement(d, a * b / c + 2 * a * b), Statement(e, a / c), Statement(f, 2 * b)]
    shared = share_factors(Block("parts", "parts", {}, statements, [(OUT, str(s), s) for s in (d, e, f)]))
    assert {s.target for s in shared.statements[:2]} == {e, f}
    assert shared.statements[-1].expression == e * b + f * a


def test_a_second_form_of_a_value_is_kept_until_one_is_chosen() -> None:
    x = Expansion("two", "two", lambda store, name: True)
    a, b = x.component(IN, "0"), x.component(IN, "1")
    either = x.either("s", a * b + 1, a, "tag")
    assert x.block.statements[-1].target is either and x.finish().otherwise == {either: a}
    pattern = StructuralExpansion("two", lambda store, name: True)
    assert pattern.either("s", 0, ANY) is ANY and pattern.either("s", 0, 0) == 0


def run(block: Block, inputs: dict[str, float]) -> list[float]:
    values = {s: inputs[name] for s, (_, name) in block.loads.items()}
    for s in block.statements:
        values[s.target] = evaluated(s.expression, values)
    return [evaluated(e, values) for _, _, e in block.stores]


@pytest.mark.parametrize("seed", range(12))
def test_passes_keep_the_numbers_and_never_add_operations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    block = random_block(rng)
    inputs = {str(i): float(v) for i, v in enumerate(rng.uniform(0.5, 1.5, 4))}
    expected = run(block, inputs)
    flops = count(block)[0].flops
    for name, function in PASSES:
        block = function(block)
        assert run(block, inputs) == pytest.approx(expected, rel=1e-9, abs=1e-9), name
        now = count(block)[0].flops
        assert now <= flops, name
        flops = now
    assert run(simplify(block), inputs) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_dead_statements_and_loads_go() -> None:
    x = Expansion("b", "", lambda a, n: True)
    a, b = x.component(IN, "a"), x.component(IN, "b")
    x.let("dead", a * b)
    x.set_component(OUT, "0", x.let("alive", a * a))
    block = simplify(x.finish())
    assert [str(s.target) for s in block.statements] == ["alive"]
    assert list(block.loads.values()) == [(IN, "a")]


def test_equal_values_get_one_name_up_to_sign() -> None:
    x = Expansion("b", "", lambda a, n: True)
    a, b = x.component(IN, "a"), x.component(IN, "b")
    first = x.let("p", a * b - b)
    assert x.let("q", a * b - b) is first
    assert x.let("r", b - a * b) == -first
    assert len(x.block.statements) == 1


def test_zeros_and_ones_fold() -> None:
    x = Expansion(
        "b", "", lambda array, name: name != "zero", lambda array, name: algebra.ONE if name == "one" else None
    )
    assert x.component(IN, "zero") == 0
    a = x.component(IN, "a")
    assert x.let("p", x.component(IN, "zero") * a + x.component(IN, "one") * a) == a
    assert x.block.statements == []


def test_names_are_unique_and_none_is_a_word_of_the_target() -> None:
    x = Expansion("b", "", lambda a, n: True)
    a = x.component(IN, "a")
    names = [str(x.let(n, a**k + k)) for k, n in enumerate(["d_1", "d", "d", "d", "cos", "a"], start=2)]
    assert len(set(names)) == len(names)
    assert not {"cos", "a"} & set(names)


def test_structural_values_follow_zeros() -> None:
    x = StructuralExpansion("", lambda store, name: name == "a")
    a, zero = x.component(IN, "a"), x.component(IN, "b")
    assert a is ANY and zero == 0
    for value in (a * 0, 0 * a, zero * a, zero / a, -zero):
        assert isinstance(value, int) and value == 0
    for value in (a + 0, 0 + a, a - a, a * a, 1 / a, -a, a**2, 2 * a):
        assert value is ANY


@pytest.mark.parametrize("text", ["a*b + c", "a**2*b - c/b", "sin(a)*b", "a", "2*a*b*c", "sqrt(a*b)*c + exp(c)/a"])
def test_partials_are_those_of_sympy(text: str) -> None:
    e = eval(text, {**SYMBOLIC, **{name: Symbol(name) for name in "abc"}})
    found = partials(e)
    assert set(found) == e.free_symbols
    for s, d in found.items():
        assert sympy.simplify(sympy.sympify(str(d)) - sympy.diff(sympy.sympify(text), sympy.Symbol(s.name))) == 0


@pytest.mark.parametrize("seed", range(8))
def test_tangent_is_the_derivative(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    block = random_block(rng, 12)
    x = Expansion("t", "", lambda a, n: True)
    symbols = {s: x.component(IN, n) for s, (_, n) in block.loads.items()}
    seeds = {s: number(v) for s, v in zip(symbols, rng.normal(size=len(symbols)), strict=True)}
    statements = list(block.statements)
    for s in statements:
        x.block.statements.append(s)
    d = Tangents(x, seeds, {})
    for s in statements:
        d.statement(s)
    for i, (_, _, e) in enumerate(block.stores):
        x.set_component(OUT, f"d{i}", d.value(expression(e)))
    inputs = {n: float(v) for (_, n), v in zip(block.loads.values(), rng.uniform(0.5, 1.5, 9), strict=False)}
    inputs |= {str(i): inputs.get(str(i), 1.0) for i in range(4)}
    h = 1e-6
    ends = []
    for sign in (1, -1):
        moved = {n: inputs[n] + sign * h * float(seeds[s]) for s, (_, n) in block.loads.items()}
        ends.append(run(block, inputs | moved))
    weak = [(a - b) / (2 * h) for a, b in zip(*ends, strict=True)]  # finite differences: a weak witness, 1e-6
    assert run(x.finish(), inputs) == pytest.approx(weak, rel=1e-5, abs=1e-5)


def test_transparent_operands_are_looked_through() -> None:
    """d(c x + s y) along the angle is c y - s x, which has a name already."""
    x = Expansion("r", "", lambda a, n: True)
    c, s, q, a, b = (x.component(IN, n) for n in ("c", "s", "q", "a", "b"))
    first = x.let("first", c * a + s * b)
    second = x.let("second", c * b - s * a)
    d = Tangents(x, {q: Symbol("dq")}, {c: {q: -s}, s: {q: c}})
    assert d.expression(c * a + s * b) == second * Symbol("dq")
    assert d.expression(c * b - s * a) == -first * Symbol("dq")


def test_derivatives_of_functions_with_corners() -> None:
    a, b = Symbol("a"), Symbol("b")
    assert derivative(Maximum(a, b), a) == AtLeast(a, b)
    assert derivative(Maximum(a, b), b) == 1 - AtLeast(a, b)
    assert derivative(Minimum(a, b), a) == AtLeast(b, a)
    assert derivative(Minimum(a, b), b) == 1 - AtLeast(b, a)
    assert str(derivative(Absolute(a), a)) == "Sign(a)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a + b - c", (2, 0, 0)), ("a*b*c", (0, 2, 0)), ("-a*b", (0, 1, 0)), ("a/b", (0, 0, 1)), ("a**3", (0, 2, 0)),
     ("a*b + c/d", (1, 1, 1)), ("1/(a*b)", (0, 1, 1))],
)  # fmt: skip
def test_operation_counts(text: str, expected: tuple[int, int, int]) -> None:
    o = count_expression(eval(text, {name: Symbol(name) for name in "abcd"}))
    assert (o.additions, o.multiplications, o.divisions) == expected


def test_what_is_zero_on_patterns_is_zero_in_statements() -> None:
    """`half`, `number`, `sqrt` and `let_vector` of a scope: a pattern may say too much, never too little."""
    x = Expansion("block", "block", lambda store, name: name != "0")
    pattern = StructuralExpansion("block", lambda store, name: name != "0")
    for scope in (x, pattern):
        nothing, something = scope.component(IN, "0"), scope.component(IN, "1")
        v = scope.let_vector("v", [scope.half * nothing, scope.number(2e-15) * something, scope.sqrt(something)], "tag")
        for i, value in enumerate(v):
            scope.set_entry(OUT, i, value)
    written = [value for _, _, value in x.finish().stores]
    assert (
        [value == 0 for value in written]
        == [pattern.stored[OUT, str(i)] == 0 for i in range(3)]
        == [True, False, False]
    )
    assert [s.target.name for s in x.block.statements] == ["v_y", "v_z"]
    assert run(x.finish(), {"1": 4.0}) == [0.0, 8e-15, 2.0]
