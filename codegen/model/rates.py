"""Derivatives of expressions by one name, as expressions: what the rate of a prescribed coordinate is.

They are exact: rules of differentiation, operation by operation, with what is zero left out. At the kinks of `abs`, `sign`,
`min`, `max` and where comparisons change, where there is no derivative, the expression has the value that these rules give there.
"""

from __future__ import annotations

from functools import lru_cache

from .expressions import AT_LEAST, Expression, Tree, combine
from .slopes import is_singular, slope

ZERO: Tree = ("number", 0)
ONE: Tree = ("number", 1)
TWO: Tree = ("number", 2)


def rate(expression: Expression, name: str = "t") -> Expression:
    """The derivative of an expression by a name that stands in it.

    Raises
    ------
    ExpressionError
        A number of the derivative is not finite.
    """
    tree = expression.tree
    return Expression(slope(tree, ("name", name)) if is_singular(tree) else derivative(tree, name))


@lru_cache(maxsize=4096)
def derivative(tree: Tree, name: str) -> Tree:
    """The same of a tree."""
    kind = tree[0]
    if kind == "number":
        return ZERO
    if kind == "name":
        return ONE if tree[1] == name else ZERO
    if kind == "call":
        return _of_call(tree[1], tree[2:], tuple(derivative(a, name) for a in tree[2:]))
    if kind == "neg":
        return combine("neg", derivative(tree[1], name))
    a, b = tree[1:]
    da, db = derivative(a, name), derivative(b, name)
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
    if function == "atan2":
        (y, x), (dy, dx) = of, d
        above = combine("-", combine("*", x, dy), combine("*", y, dx))
        return combine("/", above, combine("+", combine("*", x, x), combine("*", y, y)))
    (x,), (dx,) = of, d
    whole: Tree = ("call", function, x)
    if function in ("tan", "sqrt", "exp", "sin", "cos", "sinh", "cosh", "tanh", "abs", "sign"):
        by: Tree = {
            "sin": lambda: combine("cos", x),
            "cos": lambda: combine("neg", combine("sin", x)),
            "tan": lambda: combine("+", ONE, combine("*", whole, whole)),
            "sinh": lambda: combine("cosh", x),
            "cosh": lambda: combine("sinh", x),
            "tanh": lambda: combine("-", ONE, combine("*", whole, whole)),
            "exp": lambda: whole,
            "sqrt": lambda: combine("/", ONE, combine("*", TWO, whole)),
            "abs": lambda: combine("sign", x),
            "sign": lambda: ZERO,
        }[function]()
        return combine("*", by, dx)
    square = combine("*", x, x)
    below: Tree = {
        "log": lambda: x,
        "atan": lambda: combine("+", ONE, square),
        "asin": lambda: combine("sqrt", combine("-", ONE, square)),
        "acos": lambda: combine("neg", combine("sqrt", combine("-", ONE, square))),
    }[function]()
    return combine("/", dx, below)


def with_names_replaced(expression: Expression, by: dict[str, Tree]) -> Expression:
    """The expression with trees in the place of some of its names."""
    return expression if by.keys().isdisjoint(expression.names) else Expression(_replaced(expression.tree, by))


def _replaced(tree: Tree, by: dict[str, Tree]) -> Tree:
    kind = tree[0]
    if kind == "number":
        return tree
    if kind == "name":
        return by.get(tree[1], tree)
    if kind == "call":
        return combine(tree[1], *(_replaced(a, by) for a in tree[2:]))
    return combine(kind, *(_replaced(a, by) for a in tree[1:]))


__all__ = ["rate", "with_names_replaced"]
