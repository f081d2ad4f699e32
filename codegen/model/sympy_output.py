"""Model expressions as sympy expressions."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from ..elementary import TABLE
from .expressions import Expression
from .grammar import AT_LEAST, CHOICE, VANISHING, WRAPPED, Tree
from .parsing import parse
from .tree_text import print_tree

Symbols = Mapping[str, Any] | Callable[[str], Any]
"""sympy symbols by names in the model: a mapping, or a function."""


def to_sympy(
    expression: Expression | str | float, symbols: Symbols | None = None, *, number: Callable[[Any], Any] | None = None
) -> Any:
    """Return the expression of sympy that equals an expression of a model.

    Integers and their quotients are exact, and the double nearest to pi is pi. The model takes some products as zero if one
    factor is zero, even if the other has no value; sympy gets a plain product. ``mod`` is written with a floor.

    Parameters
    ----------
    expression : Expression, str or float
        The expression. A text is parsed.
    symbols : mapping or callable (str) -> sympy.Expr, optional
        Symbols of names such as ``L``, ``t``, ``q.arm``. A name that is left out is a real symbol of that name.
    number : callable, optional
        Makes a number of sympy from an int or a float of the expression. Default: doubles stay doubles.

    Returns
    -------
    sympy.Expr
        The expression.

    Raises
    ------
    ExpressionError
        If the text is not a valid expression.

    Examples
    --------
    >>> to_sympy("if(x > 1/3, sin(x)**2, abs(x))")
    Piecewise((sin(x)**2, 1/3 < x), (Abs(x), True))
    """
    import sympy

    if isinstance(expression, str):
        expression = parse(expression)
    if not isinstance(expression, Expression):
        return sympy.sympify(expression)
    try:
        return _Output(symbols or {}, number or _number).value(expression.tree)
    except RecursionError:  # sympy itself recurses too deeply in powers of products of conditions
        with sympy.evaluate(False):
            return _Output(symbols or {}, number or _number).value(expression.tree)


class _Output:
    """Makes sympy expressions from trees, each part once."""

    def __init__(self, symbols: Symbols, number: Callable[[Any], Any]) -> None:
        self.symbols, self.number = symbols, number
        self.known: dict[Tree, Any] = {}

    def value(self, tree: Tree) -> Any:
        """The sympy value of a tree."""
        found = self.known.get(tree)
        if found is None:
            found = self.known[tree] = self.made(tree)
        return found

    def name(self, name: str) -> Any:
        """The sympy symbol of a name."""
        import sympy

        given = self.symbols(name) if callable(self.symbols) else self.symbols.get(name)
        return sympy.Symbol(name, real=True) if given is None else given

    def made(self, tree: Tree) -> Any:
        """The sympy value of a tree that has not occurred before."""
        import sympy

        kind = tree[0]
        if kind == "number":
            return self.number(tree[1])
        if kind == "quantity":
            return self.number(tree[1])
        if kind == "name":
            return self.name(tree[1])
        if kind == "call":
            return self.call(tree[1], tree[2:])
        if kind == "indexed" and not tree[3]:
            return sympy.Function(tree[1])(*map(self.value, tree[2]))
        if kind not in _OPERATIONS:
            raise ValueError(f"{print_tree(tree, 0)} is not resolved; take the expression from a loaded model")
        return _OPERATIONS[kind](*map(self.value, tree[1:]))

    def call(self, name: str, arguments: tuple[Tree, ...]) -> Any:
        """The sympy value of a function call."""
        import sympy

        if name == CHOICE:
            condition, x, y = arguments
            return sympy.Piecewise((self.value(x), self.condition(condition)), (self.value(y), True), evaluate=False)
        if name == AT_LEAST:
            return sympy.Piecewise((1, self.condition(("call", name, *arguments))), (0, True), evaluate=False)
        values = [self.value(a) for a in arguments]
        if name == VANISHING:
            return values[0] * values[1]
        if name in ("mod", WRAPPED):  # sympy would print a product with its Mod as a remainder of the product
            return values[0] - values[1] * sympy.floor(values[0] / values[1])
        function = getattr(sympy, TABLE[name].spelled("sympy"))
        # comparing these arguments may take sympy minutes
        return function(*values, evaluate=False) if name in ("max", "min") else function(*values)

    def condition(self, tree: Tree) -> Any:
        """The condition for a tree of comparisons that is 1 if it holds and 0 otherwise."""
        import sympy

        match tree:
            case ("number", n):
                return sympy.true if n else sympy.false
            case ("call", "at_least", a, b):
                return self.compared(sympy.Ge, a, b)
            case ("-", ("number", 1), ("call", "at_least", a, b)):
                return self.compared(sympy.Lt, a, b)
            case ("*", a, b):
                return sympy.And(self.condition(a), self.condition(b), evaluate=False)
            case ("call", "max", a, b):
                return sympy.Or(self.condition(a), self.condition(b), evaluate=False)
        return sympy.Ne(self.value(tree), 0)

    def compared(self, relation: Callable[..., Any], a: Tree, b: Tree) -> Any:
        """A comparison of two values; of two numbers, the truth value."""
        one, other = self.value(a), self.value(b)
        return relation(one, other, evaluate=bool(one.is_number and other.is_number))


def _number(value: Any) -> Any:
    """A sympy number; the double nearest to pi becomes pi."""
    import sympy

    return sympy.pi if value == math.pi else sympy.sympify(value)


_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "neg": operator.neg, "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "**": operator.pow, "%": operator.mod,
}  # fmt: skip
