"""Singular functions: functions at whose zeros an expression may have no value or derivative, although no branch
changes.

Examples are a quotient at a zero of its denominator, a root or power at a zero of its base, and `atan2` with both arguments zero.
Along a motion the value may be finite there, and yet jump, have a kink, or change without bounds nearby. The *singular
function* of such an expression is zero at these places: the denominator, the base, `x**2 + y**2`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from .expressions import Expression, combine
from .grammar import Tree
from .products import ONE, TWO, is_positive
from .trees import parts


def singular_functions(
    tree: Tree, varies: Callable[[str], bool], known: Callable[[Tree, Tree], bool] = lambda part, of: False
) -> list[Tree]:
    """The singular functions of a bound expression that contain a varying name, each once.

    Parameters
    ----------
    tree : tuple
        Tree of the bound expression.
    varies : callable (str) -> bool
        Whether a name changes during a motion.
    known : callable (tuple, tuple) -> bool, optional
        Whether a part of the expression is left out, given the part and its singular function.

    Returns
    -------
    list of tuple
        Singular functions that are not known to be positive.
    """
    found: dict[Tree, None] = {}
    seen: set[Tree] = set()
    stack = [tree]
    while stack:
        part = stack.pop()
        if part in seen:
            continue
        seen.add(part)
        stack += parts(part)
        for of in singular_in(part):
            if known(part, of):
                continue
            while (
                of[0] == "neg"
                or of[:2] in (("call", "abs"), ("call", "sqrt"))
                or (of[0] == "**" and of[2][0] == "number")
            ):
                of = of[2] if of[0] == "call" else of[1]
            if not is_positive(of) and any(map(varies, Expression(of).names)):
                found[of] = None
    return list(found)


def singular_in(tree: Tree) -> Iterator[Tree]:
    """Functions whose zeros are the singular points of the outermost operation of a tree."""
    match tree:
        case ("/", _, below):
            yield below
        case ("**", base, exponent):
            if not (exponent[0] == "number" and isinstance(exponent[1], int) and exponent[1] >= 0):
                yield base
        case ("call", "sqrt" | "log", x):
            yield x
        case ("call", "acosh", x):
            yield combine("-", x, ONE)
        case ("call", "asin" | "acos" | "atanh", x):
            yield combine("*", combine("-", ONE, x), combine("+", ONE, x))
        case ("call", "tan", x):
            yield ("call", "cos", x)
        case ("call", "atan2", y, x) if not is_positive(x):
            yield combine("+", combine("**", x, TWO), combine("**", y, TWO))


__all__ = ["singular_functions", "singular_in"]
