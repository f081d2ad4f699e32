"""Values and derivatives of expressions that are finite where plain rules give 0/0 or 0 times infinity.

A product is written as powers of bases, and powers of the same base are combined before anything is computed: the
derivative of ``x*x**n`` contains ``x**n``, not ``x*x**(n - 1)``. A component of a vector divided by the vector's length
is bounded, and a logarithm grows more slowly than any power. A product with such a factor is therefore zero where its
other factors are zero (`VANISHING`). So the values and derivatives of ``x*log(x)``, of ``k*d**n`` with respect to n, and
of ``c*sqrt(v.v)*v`` are exact where x, d or v is zero. Branches that are not taken do not contribute (`CHOICE`).
In all other cases, the result is infinite or nan where the derivative itself is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

from ..elementary import TABLE, TreeFunctions, tree_of
from .expressions import combine_exactly as combine
from .grammar import AT_LEAST, CHOICE, VANISHING, Tree
from .products import (
    HALF,
    HELD,
    MINUS_ONE,
    NORM,
    ONE,
    SIZE,
    TWO,
    ZERO,
    Factors,
    Product,
    is_positive,
    plus,
    power_of,
    product,
)
from .trees import LEAVES, mapped, parts


def slope(tree: Tree, by: Tree) -> Tree:
    """The derivative of a tree with respect to one of its leaves.

    At a kink of ``min`` and ``max`` it is the derivative of the first argument; at the kink of ``abs`` it is zero. Where
    ``sign``, comparisons and ``mod`` jump, it is the derivative beside the jump.

    Raises
    ------
    ExpressionError
        If a number in the derivative is not finite.
    """
    return _slope(tree, by)


@lru_cache(maxsize=1 << 14)
def _slope(tree: Tree, by: Tree) -> Tree:
    if tree == by:
        return ONE
    kind = tree[0]
    if kind in LEAVES:
        return ZERO
    if kind == "neg":
        return combine("neg", _slope(tree[1], by))
    if kind in ("+", "-"):
        return combine(kind, _slope(tree[1], by), _slope(tree[2], by))
    if kind == "call" and tree[1] not in ("sqrt", "abs", VANISHING):
        return _of_call(tree[1], tree[2:], tuple(_slope(a, by) for a in tree[2:]))
    return _of_product(Product().times(tree), by)


def _of_call(function: str, of: tuple[Tree, ...], d: tuple[Tree, ...]) -> Tree:
    """The derivative of a function's value from the derivatives of its arguments."""
    if all(x == ZERO for x in d) or function.removeprefix(HELD) in (AT_LEAST, "sign"):
        return ZERO
    x, dx = of[0], d[0]
    match function:
        case "held_max":
            return combine(CHOICE, ("call", "held_at_least", *of), *d[:2])
        case "held_min":
            return combine(CHOICE, ("call", "held_at_least", of[1], x, ("neg", of[2])), *d[:2])
        case "held_abs":
            return product((("call", "held_sign", *of), ONE), (dx, ONE))
        case "held_mod":
            return combine("-", dx, combine("*", combine("/", combine("-", x, ("call", function, *of)), of[1]), d[1]))
        case "choice":
            return combine(CHOICE, x, d[1], d[2])
        case "min" | "max":
            return combine(CHOICE, combine(AT_LEAST, *(of if function == "max" else of[::-1])), *d)
        case "mod" | "wrapped":
            whole = combine("/", combine("-", x, combine(function, *of)), of[1])
            return combine("-", dx, combine("*", whole, d[1]))
    e, value = TABLE[function.removeprefix(HELD)], ("call", function, *of)
    total = ZERO
    for slope_, d_of in zip(e.slopes, d, strict=False):  # a mode has no derivative
        if d_of != ZERO:
            total = combine(
                "+", total, product((tree_of(slope_, (value, *of[: e.arity]), ROOTS_APART), ONE), (d_of, ONE))
            )
    return total


def _with_roots_apart(kind: str, *trees: Tree) -> Tree:
    """The tree of an operation or function, with the root of a product written as a product of roots."""
    if kind == "sqrt" and trees[0][0] == "*":
        return product((trees[0][1], HALF), (trees[0][2], HALF))
    return combine(kind, *trees)


ROOTS_APART = TreeFunctions(_with_roots_apart)


def _of_product(of: Product, by: Tree) -> Tree:
    """The derivative of a product: the sum of the derivatives of its powers, each times the other powers."""
    total = ZERO
    for key, exponent in of.powers.items():
        rest = of.without(key)
        for factors in _of_power(key, exponent, by):
            total = combine("+", total, _finished(rest.copy().with_all(factors), rest, by))
        if key[0] in ("*", "/") and exponent[0] == "number":
            total = combine("+", total, _of_power_of_product(rest, key, exponent, by))
    for i, choice in enumerate(of.choices):
        d = _slope(choice, by)
        if d != ZERO:
            term = of.copy()
            del term.choices[i]
            total = combine("+", total, term.times(d).tree())
    return total


def _of_power(key: Tree, exponent: Tree, by: Tree) -> Iterator[Factors]:
    """The terms of the derivative of a power; each term consists of factors with exponents."""
    less = plus(exponent, MINUS_ONE)
    if key[0] in (NORM, SIZE):
        for weight, x in key[1]:
            two_less = (key, plus(exponent, ("number", -2)))
            d, of_weight = _slope(x, by), _slope(weight, by)
            if d != ZERO:
                yield [(exponent, ONE), two_less, (weight, ONE), (x, ONE), (d, ONE)]
            if of_weight != ZERO:
                yield [(exponent, ONE), (HALF, ONE), two_less, (x, TWO), (of_weight, ONE)]
    elif key[0] not in ("*", "/") or exponent[0] != "number":
        d = _slope(key, by)
        if d != ZERO:
            yield [(exponent, ONE), (key, less), (d, ONE)]
    d = _slope(exponent, by)
    if d != ZERO:
        yield [(key, exponent), (combine("log", power_of(key, ONE)), ONE), (d, ONE)]


def _finished(term: Product, others: Product, by: Tree) -> Tree:
    """The tree of a term of a derivative; it is zero where a factor that does not depend on `by` is zero."""
    if not term.may_be_infinite:
        return term.tree()
    apart = Product()
    for key, e in others.powers.items():
        is_bounded = e[0] == "number" and e[1] > 0 and key[0] != "number" and key[:2] != ("call", "log")
        if is_bounded and key in term.powers and by not in leaves(power_of(key, e)):
            apart.times(key, e)
            term.times(key, plus(ZERO, e, -1))
    return combine(VANISHING, apart.tree(), term.tree()) if apart.powers else term.tree()


def _of_power_of_product(others: Product, key: Tree, exponent: Tree, by: Tree) -> Tree:
    """The derivative of a power of a product, times other factors. Since its factors may be negative, the power is not split.

    Where the varying factor is not zero, the derivative contains the power divided by this factor. Where another factor
    is zero, the derivative is zero. Otherwise the exponent is reduced by one.
    """
    total = ZERO
    inside = Product().times(key)
    for factor, e in inside.powers.items():
        d = _of_product(Product().times(factor, e), by)
        if d == ZERO:
            continue
        base = power_of(factor, e)
        rest = inside.without(factor)
        here = others.copy().with_all([(exponent, ONE), (d, ONE)])
        n = here.powers.get(factor, ZERO)
        less = plus(exponent, MINUS_ONE)
        at_zero = here.copy()
        if e == ONE and n[0] == "number" and n[1] > 0:  # the factor's power is the product divided by its other factors
            at_zero = here.without(factor).with_all([(rest.copy().tree(), combine("neg", n))])
            less = plus(less, n)
        at_zero.with_all([(key, less), (rest.tree(), ONE)])
        if not rest.powers:
            total = combine("+", total, _finished(at_zero, others, by))
            continue
        apart = here.with_all([(key, exponent), (base, MINUS_ONE)])
        none = combine(AT_LEAST, ZERO, combine("abs", base))
        total = combine("+", total, combine(CHOICE, none, *(_finished(of, others, by) for of in (at_zero, apart))))
    return total


# --- infinite values and derivatives ------------------------------------------------------------------------------------


def is_singular(tree: Tree) -> bool:
    """Whether a derivative of a tree, or a term of it, may be infinite: a root, a power below one, a branch, ..."""
    kind, found = tree[0], False
    if kind == "call":
        domain = TABLE[tree[1]].domain if tree[1] in TABLE else None
        found = tree[1] in ("atan2", "held_atan2", CHOICE, VANISHING) or (
            domain is not None and not (domain[0] < 1 and domain[1] == math.inf and is_positive(tree[2]))
        )
    elif kind == "**":
        base, e = tree[1:]
        found = not (e[0] == "number" and (e[1] >= 1 or e[1] == 0)) and not is_positive(base)
        found = found and not (e[0] == "number" and isinstance(e[1], int))  # such a power is a quotient
    return bool(found or any(map(is_singular, parts(tree))))


def has_quotient(tree: Tree, of: frozenset[Tree]) -> bool:
    """Whether some denominator contains one of the given leaves."""
    kind = tree[0]
    below = tree[2] if kind == "/" else tree[1] if kind == "**" and tree[2][0] == "number" and tree[2][1] < 0 else ONE
    return (not is_positive(below) and not of.isdisjoint(leaves(below))) or any(
        has_quotient(a, of) for a in parts(tree)
    )


def leaves(tree: Tree) -> list[Tree]:
    """The names of a tree, each once, in the order in which they occur."""
    if tree[0] in ("name", "parameter"):
        return [tree]
    return list(dict.fromkeys(leaf for part in parts(tree) for leaf in leaves(part)))


def regular(tree: Tree) -> Tree:
    """The same expression, with products written so that finite limits are computed.

    ``x*log(x)`` is 0 at 0, as is ``v*abs(v)**(n - 1)``, and ``x/x`` is 1. All other trees are unchanged.
    """
    tree = mapped(tree, regular)
    if tree[0] in ("*", "/") and _may_be_better(tree):
        found = Product().times(tree)
        if found.is_better:
            return found.tree()
    return tree


def _may_be_better(tree: Tree) -> bool:
    """Whether a factor of a product is a quotient, a power, a logarithm or similar."""
    kind = tree[0]
    if kind == "*":
        return _may_be_better(tree[1]) or _may_be_better(tree[2])
    if kind == "neg":
        return _may_be_better(tree[1])
    return kind in ("/", "**") or (kind == "call" and tree[1] in ("log", "sqrt", "abs", VANISHING, CHOICE))


__all__ = ["has_quotient", "is_singular", "leaves", "regular", "slope"]
