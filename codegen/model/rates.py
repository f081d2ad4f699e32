"""Derivatives of expressions by one name, as expressions: what the rate of a prescribed coordinate is.

By time, inputs that prescribed motion reads have derivatives too, which are inputs themselves: see `rates_of`.

They are exact: rules of differentiation, operation by operation, with what is zero left out. At the kinks of `abs`, `sign`,
`min`, `max` and where comparisons change, where there is no derivative, the expression has the value that these rules give there.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from ..elementary import TABLE, tree_of
from .expressions import COMBINED, Expression, combine
from .grammar import AT_LEAST, Tree
from .slopes import is_singular, slope
from .switches import has_modes
from .trees import parts

ZERO: Tree = ("number", 0)
ONE: Tree = ("number", 1)
TWO: Tree = ("number", 2)


ORDERS: Final = ("rate", "acceleration")
"""What an input over time brings beside its value where prescribed motion reads it, as ``way.rate`` and ``way.acceleration``."""


def rates_of(name: str) -> tuple[str, str]:
    """The names of an input's first and second time derivative."""
    return f"{name}.{ORDERS[0]}", f"{name}.{ORDERS[1]}"


def rate(expression: Expression, name: str = "t", moving: frozenset[str] = frozenset()) -> Expression:
    """The derivative of an expression by a name that stands in it.

    Parameters
    ----------
    moving : frozenset of str
        Inputs that change with it: the derivative of ``way`` is ``way.rate``, that of ``way.rate`` is ``way.acceleration``, and
        that of this is zero, for more is not known.

    Raises
    ------
    ExpressionError
        A number of the derivative is not finite.
    """
    by = {name: ONE}
    for n in moving:
        first, second = rates_of(n)
        by |= {n: ("name", first), first: ("name", second)}
    tree = expression.tree
    if not (is_singular(tree) or has_modes(expression)):
        return Expression(derivative(tree, frozenset(by.items())))
    found = ZERO
    for n in sorted(expression.names & by.keys()):
        found = combine("+", found, combine("*", slope(tree, ("name", n)), by[n]))
    return Expression(found)


@lru_cache(maxsize=4096)
def derivative(tree: Tree, by: frozenset[tuple[str, Tree]]) -> Tree:
    """The same of a tree; `by` has the derivatives of names, those of others are zero."""
    kind = tree[0]
    if kind == "number":
        return ZERO
    if kind == "name":
        return next((d for n, d in by if n == tree[1]), ZERO)
    if kind == "call":
        return _of_call(tree[1], tree[2:], tuple(derivative(a, by) for a in tree[2:]))
    if kind == "neg":
        return combine("neg", derivative(tree[1], by))
    a, b = tree[1:]
    da, db = derivative(a, by), derivative(b, by)
    if kind in ("+", "-"):
        return combine(kind, da, db)
    if kind == "*":
        return combine("+", combine("*", da, b), combine("*", a, db))
    if kind == "/":
        return combine("/", combine("-", da, combine("*", tree, db)), b)
    assert kind == "**", kind
    by_base = ZERO if da == ZERO else combine("*", combine("*", b, combine("**", a, combine("-", b, ONE))), da)
    if db == ZERO:
        return by_base
    return combine("+", by_base, combine("*", combine("*", tree, combine("log", a)), db))


def _of_call(function: str, of: tuple[Tree, ...], d: tuple[Tree, ...]) -> Tree:
    """The derivative of a function's value from those of its arguments."""
    if function == AT_LEAST or all(x == ZERO for x in d):
        return ZERO
    if function in ("min", "max"):  # (a + b -+ |a - b|)/2
        (a, b), (da, db) = of, d
        less = combine("*", combine("sign", combine("-", a, b)), combine("-", da, db))
        return combine("/", combine("-" if function == "min" else "+", combine("+", da, db), less), TWO)
    if function in ("mod", "wrapped"):
        (x, m), (dx, dm) = of, d
        turns = combine("/", combine("-", x, combine(function, x, m)), m)
        return combine("-", dx, combine("*", turns, dm))
    value: Tree = ("call", function, *of)
    total = ZERO
    for slope_, d_of in zip(TABLE[function].slopes, d, strict=True):
        if d_of != ZERO:
            total = combine("+", total, _times(tree_of(slope_, (value, *of), COMBINED), d_of))
    return total


def _times(factor: Tree, d: Tree) -> Tree:
    """A product, with a division instead of one by a reciprocal."""
    return combine("/", combine("*", factor[1], d), factor[2]) if factor[0] == "/" else combine("*", factor, d)


def with_names_replaced(expression: Expression, by: dict[str, Tree]) -> Expression:
    """The expression with trees in the place of some of its names."""
    return expression if by.keys().isdisjoint(expression.names) else Expression(_replaced(expression.tree, by))


def _replaced(tree: Tree, by: dict[str, Tree]) -> Tree:
    if tree[0] == "name":
        return by.get(tree[1], tree)
    inner = [_replaced(a, by) for a in parts(tree)]
    unchanged = all(a is b for a, b in zip(inner, parts(tree), strict=True))
    return tree if unchanged else combine(tree[-len(inner) - 1], *inner)


__all__ = ["rate", "rates_of", "with_names_replaced"]
