"""Derivatives of expressions with respect to one name, as expressions; used for rates of prescribed coordinates.

Inputs in prescribed motion have time derivatives too, which are themselves inputs: see `rates_of`.

The derivatives are exact: rules of differentiation, without terms that are zero. At the kinks of `abs`, `sign`, `min` and `max`,
and where comparisons change, there is no derivative; the expression then has the value that these rules give.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from ..elementary import TABLE, tree_of
from .entries import ONE, ZERO
from .expressions import COMBINED, Expression, combine, made
from .grammar import AT_LEAST, Tree
from .slopes import is_singular, slope
from .switches import has_modes
from .trees import parts

ORDERS: Final = ("rate", "acceleration")
"""Suffixes of the additional inputs for an input in prescribed motion: ``way.rate`` and ``way.acceleration``."""


def rates_of(name: str) -> tuple[str, str]:
    """The names of an input's first and second time derivative."""
    return f"{name}.{ORDERS[0]}", f"{name}.{ORDERS[1]}"


def rate(expression: Expression, name: str = "t", moving: frozenset[str] = frozenset()) -> Expression:
    """The derivative of an expression with respect to one of its names.

    Parameters
    ----------
    moving : frozenset of str
        Inputs that depend on this name: the derivative of ``way`` is ``way.rate``, that of ``way.rate`` is
        ``way.acceleration``, and that of ``way.acceleration`` counts as zero, because it is not known.

    Raises
    ------
    ExpressionError
        If a number in the derivative is not finite.
    """
    by = {name: Expression.number(1)}
    for n in moving:
        first, second = rates_of(n)
        by |= {n: Expression(("name", first)), first: Expression(("name", second))}
    if not (is_singular(expression.tree) or has_modes(expression)):
        return derivative(expression, frozenset(by.items()))
    found = ZERO
    for n in sorted(expression.names & by.keys()):
        found += Expression(slope(expression.tree, ("name", n))) * by[n]
    return found


@lru_cache(maxsize=4096)
def derivative(of: Expression, by: frozenset[tuple[str, Expression]]) -> Expression:
    """The derivative of an expression; `by` has the derivatives of some names, and the other names are constant.

    It is made by the rules of differentiation alone, without the finite limits of `slopes`.
    """
    kind = of.tree[0]
    if kind == "number":
        return ZERO
    if kind == "name":
        return next((d for n, d in by if n == of.tree[1]), ZERO)
    operands = [Expression(part) for part in parts(of.tree)]
    d = [derivative(a, by) for a in operands]
    if kind == "call":
        return _of_call(of, operands, d)
    if kind == "neg":
        return -d[0]
    (a, b), (da, db) = operands, d
    if kind in ("+", "-"):
        return da + db if kind == "+" else da - db
    if kind == "*":
        return da * b + a * db
    if kind == "/":
        base, n = (b.tree[1], Expression(b.tree[2])) if b.tree[0] == "**" else (b.tree, ONE)
        if base[:2] == ("call", "cosh") and n.is_number:  # the general rule gives infinity over infinity far from zero
            return da / b - n * of * made("tanh", Expression(base[2])) * derivative(Expression(base[2]), by)
        return (da - of * db) / b
    assert kind == "**", kind
    by_base = ZERO if da is ZERO else b * a ** (b - 1) * da
    return by_base if db is ZERO else by_base + of * made("log", a) * db


def _of_call(value: Expression, of: list[Expression], d: list[Expression]) -> Expression:
    """The derivative of a function's value from the derivatives of its arguments."""
    function = value.tree[1]
    if function == AT_LEAST or all(x is ZERO for x in d):
        return ZERO
    if function in ("min", "max"):  # where both arguments are equal: the derivative of the first
        (a, b), (da, db) = of, d
        first = made(AT_LEAST, a, b) if function == "max" else made(AT_LEAST, b, a)
        return first * da + (1 - first) * db
    if function in ("mod", "wrapped"):
        (x, m), (dx, dm) = of, d
        return dx - (x - value) / m * dm
    if function == "tanh":  # derivatives of the tabulated slope 1/cosh(x)**2 have no value where cosh overflows
        return (1 - value**2) * d[0]
    total = ZERO
    for slope_, d_of in zip(TABLE[function].slopes, d, strict=True):
        if d_of is not ZERO:
            total += _times(tree_of(slope_, (value.tree, *(x.tree for x in of)), COMBINED), d_of)
    return total


def _times(factor: Tree, d: Expression) -> Expression:
    """A product of two trees; a factor that is a reciprocal becomes a division."""
    return Expression(factor[1]) * d / Expression(factor[2]) if factor[0] == "/" else Expression(factor) * d


def with_names_replaced(expression: Expression, by: dict[str, Tree]) -> Expression:
    """The expression with some of its names replaced by trees."""
    return expression if by.keys().isdisjoint(expression.names) else Expression(_replaced(expression.tree, by))


def _replaced(tree: Tree, by: dict[str, Tree]) -> Tree:
    if tree[0] == "name":
        return by.get(tree[1], tree)
    inner = [_replaced(a, by) for a in parts(tree)]
    unchanged = all(a is b for a, b in zip(inner, parts(tree), strict=True))
    return tree if unchanged else combine(tree[-len(inner) - 1], *inner)


__all__ = ["rate", "rates_of", "with_names_replaced"]
