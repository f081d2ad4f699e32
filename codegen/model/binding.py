"""Replaces constants and repeat indices in parsed expressions by numbers."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from .expressions import FLOAT_FUNCTIONS, Expression, canonical, combine, compute
from .grammar import AT_LEAST, CHOICE, EXACT, ExpressionError, Number, Tree, functions
from .tree_text import PRECEDENCE, print_tree


class Numbers(Protocol):
    """Values of names for `bind`: a mapping, or a `Scope`."""

    def get(self, name: str, /) -> Number | str | None:
        """Number or label of a name; None if it has none."""


class Scope:
    """Looks up repeat indices before constants, without copying either."""

    __slots__ = ("constants", "indices")

    def __init__(self, indices: Mapping[str, Number | str], constants: Mapping[str, Number | str]) -> None:
        self.indices = indices
        self.constants = constants

    def get(self, name: str, /) -> Number | str | None:
        """Number or label of a name; None if it has none."""
        value = self.indices.get(name)
        return self.constants.get(name) if value is None else value


def bind(expression: Expression, numbers: Numbers) -> Expression:
    """Replace constants and repeat indices by numbers, resolve indexed names, and compute numerical parts.

    Parameters
    ----------
    expression : Expression
    numbers : mapping of str to int, float or str, or Scope
        Constants and indices. A str is a label of a repetition and can only be an index.

    Raises
    ------
    ExpressionError
        If a number is not finite, an index is not an integer, or a remainder or an index contains unknown names.
    """
    tree = _bind(expression.tree, numbers)
    return expression if tree is expression.tree else Expression(tree)


def label_key(label: str) -> str:
    """Key in `numbers` that declares a label of a repetition, which may then be an index: ``foot(left)``."""
    return f"'{label}'"  # no name contains a quote


def index_text(tree: Tree, numbers: Numbers) -> str:
    """Text of a repeat index in a generated name, such as ``3`` or ``left``.

    Raises
    ------
    ExpressionError
        If it is neither a label nor a non-negative integer.
    """
    if tree[0] == "name":
        value = numbers.get(tree[1])
        if value is None:
            value = numbers.get(label_key(tree[1]))
        if isinstance(value, str):
            return value
        if type(value) is int and value >= 0:
            return str(value)
    elif (
        tree[0] in ("+", "-") and tree[1][0] == "name" and tree[2][0] == "number"
    ):  # a neighbour such as k-1 is by far the most frequent index
        value, step = numbers.get(tree[1][1]), tree[2][1]
        if type(value) is int and type(step) is int:
            value = value + step if tree[0] == "+" else value - step
            if 0 <= value < EXACT:
                return str(value)
    bound = _bind(tree, numbers)
    if bound[0] == "number" and isinstance(bound[1], int) and bound[1] >= 0:
        return str(bound[1])
    if bound[0] != "number":
        raise ExpressionError(f"index ({print_tree(tree, 0)}) has no value; constants and repeat indices are allowed")
    raise ExpressionError(
        f"index ({print_tree(tree, 0)}) is {bound[1]!r}; an index is a non-negative integer, or a label"
    )


def _bind(tree: Tree, numbers: Numbers) -> Tree:
    kind = tree[0]
    if kind == "number":
        return tree
    if kind == "quantity":
        return ("number", tree[1])
    if kind == "component":
        found, is_vector = _component(tree[1], tree[2], numbers)
        if not is_vector:
            raise ExpressionError(f"{print_tree(tree[1], 0)!r} is not {tree[3]}")
        return found
    if kind == "name":
        value = numbers.get(tree[1])
        if value is None:
            return tree
        if isinstance(value, str):
            raise ExpressionError(f"{tree[1]} is the label {value!r}, not a number; a label can only be an index")
        return ("number", canonical(value))
    if kind == "call" and tree[1] == CHOICE:
        condition = _bind(tree[2], numbers)
        if condition[0] == "number":  # the branch that is not taken need not have a value
            return _bind(tree[3] if condition[1] else tree[4], numbers)
        return combine(CHOICE, condition, *[_bind(a, numbers) for a in tree[3:]])
    if kind == "call":
        return _piecewise(combine(tree[1], *[_bind(a, numbers) for a in tree[2:]]))
    if kind == "indexed":
        try:
            name = "_".join([tree[1], *[index_text(i, numbers) for i in tree[2]]]) + tree[3]
        except ExpressionError as error:
            raise ExpressionError(
                f"{tree[1]}(...) is neither a function nor a name with a repeat index: {error.message}; {functions(tree[1])}"
            ) from None
        return _bind(("name", name), numbers)
    found = combine(kind, *[_bind(a, numbers) for a in tree[1:]])
    return _one_sided(found) if kind in ("+", "-") else found


_HALF_TURN: Tree = ("number", math.pi)
_QUARTER_TURN: Tree = ("number", math.pi / 2)
_TURN: Tree = ("number", 2 * math.pi)


def _piecewise(tree: Tree) -> Tree:
    """Write ``acos(cos(x))``, ``asin(sin(x))``, ``atan(tan(x))`` and ``atan2(0, x)`` as pieces, which have derivatives also
    where a slope inside these functions is infinite."""
    match tree:
        case ("call", "atan2", ("number", 0), x) if x[0] != "number":
            return combine(CHOICE, combine(AT_LEAST, x, ("number", 0)), ("number", 0), _HALF_TURN)
        case ("call", "acos", ("call", "cos", x)):
            return _distance_to_turns(x)
        case ("call", "asin", ("call", "sin", x)):
            return combine("-", _QUARTER_TURN, _distance_to_turns(combine("-", x, _QUARTER_TURN)))
        case ("call", "atan", ("call", "tan", x)):
            return combine("-", combine("mod", combine("+", x, _QUARTER_TURN), _HALF_TURN), _QUARTER_TURN)
    return tree


def _distance_to_turns(x: Tree) -> Tree:
    """The distance of an angle from the nearest whole number of turns."""
    return combine("abs", combine("-", combine("mod", combine("+", x, _HALF_TURN), _TURN), _HALF_TURN))


_MOST_TERMS = 6
"""Sums with more terms are not searched for an absolute value and its argument."""


def _one_sided(tree: Tree) -> Tree:
    """Write ``c*abs(x) + c*x`` as ``2*c*max(0, x)``: for x < 0 its terms cancel, and rounding could give a negative value."""
    terms: dict[Tree, Number] = {}
    if tree[0] not in ("+", "-") or not _gather_terms(tree, 1, terms):
        return tree
    for size, factor in terms.items():
        inner = _absolute_of(size)
        if inner is None:
            continue
        inside: dict[Tree, Number] = {}
        others = {t: f for t, f in terms.items() if t is not size}
        if not _gather_terms(inner, 1, inside) or inside.keys() != others.keys():
            continue
        for sign in (1, -1):
            if all(f == sign * factor * inside[t] for t, f in others.items()):
                x = inner if sign > 0 else _minus(inner)
                return combine("*", ("number", canonical(2 * factor)), ("call", "max", ("number", 0), x))
    return tree


def _gather_terms(tree: Tree, factor: Number, terms: dict[Tree, Number]) -> bool:
    """Add the terms of a sum, with their factors, to `terms`; False if there are too many, or one occurs twice."""
    match tree:
        case ("+" | "-", a, b):
            return _gather_terms(a, factor, terms) and _gather_terms(b, factor if tree[0] == "+" else -factor, terms)
        case ("neg", a):
            return _gather_terms(a, -factor, terms)
        case ("*", ("number", value), a) | ("*", a, ("number", value)):
            return _gather_terms(a, factor * value, terms)
        case ("/", a, ("number", value)):
            return _gather_terms(a, factor / value, terms)
        case ("number", value):
            tree, factor = ("number", 1), factor * value
    if tree in terms or len(terms) == _MOST_TERMS:
        return False
    terms[tree] = factor
    return True


def _absolute_of(tree: Tree) -> Tree | None:
    match tree:
        case ("call", "abs", x) | ("call", "sqrt", ("**", x, ("number", 2))):
            return x
    return None


def _minus(tree: Tree) -> Tree:
    return combine("-", tree[2], tree[1]) if tree[0] == "-" else combine("neg", tree)


def vector_key(name: str) -> str:
    """Key in `numbers` that declares a name as a vector with ``NAME.x``, ``NAME.y``, ``NAME.z``."""
    return f"'{name}.'"  # no name contains a quote


def component_of(tree: Tree, k: int, wanted: str) -> Tree:
    """Component k of an expression given in place of a vector."""
    return ("component", tree, k, wanted)


def _component(tree: Tree, k: int, numbers: Numbers) -> tuple[Tree, bool]:
    """The bound component k of a vector expression, and True; for a number, the bound number and False."""
    kind = tree[0]
    if kind == "indexed" and not tree[3]:
        tree = ("name", "_".join([tree[1], *[index_text(i, numbers) for i in tree[2]]]))
        kind = "name"
    if kind == "name" and numbers.get(vector_key(tree[1])) is not None:
        return _bind(("name", f"{tree[1]}.{'xyz'[k]}"), numbers), True
    if kind == "neg":
        inner, is_vector = _component(tree[1], k, numbers)
        return combine("neg", inner), is_vector
    if kind not in ("+", "-", "*", "/"):
        return _bind(tree, numbers), False
    (a, left), (b, right) = (_component(x, k, numbers) for x in tree[1:])
    if kind in ("+", "-") and left != right:
        raise ExpressionError(f"{print_tree(tree, 0)} adds a number and a vector; both must be vectors")
    if (kind == "*" and left and right) or (kind == "/" and right):
        raise ExpressionError(
            f"{print_tree(tree, 0)} multiplies or divides by a vector; a vector can only be multiplied by numbers"
        )
    return combine(kind, a, b), left or right


class Binder:
    """Binds many expressions to the same constants, and stores results that do not depend on an index.

    Parameters
    ----------
    constants : mapping of str to number
        Labels too, see `label_key`. Read at every binding; constants that have been used must not change afterwards.
    """

    def __init__(self, constants: Mapping[str, Number | str]) -> None:
        self.constants = constants
        self._results: dict[Expression, Expression] = {}
        self._computed: dict[tuple[Expression, tuple[str, ...]], Computed | None] = {}

    def __call__(self, expression: Expression, indices: Mapping[str, int | str]) -> Expression:
        """The result of `bind` with the constants and with these repeat indices."""
        names = expression.names
        if not names.isdisjoint(indices):
            key = expression, tuple(indices)
            if key in self._computed:
                compute = self._computed[key]
            else:
                compute = self._computed[key] = _computed(expression.tree, indices, self.constants)
            if compute is not None:
                try:
                    return Expression(("number", compute(indices)))
                except (ArithmeticError, ValueError, TypeError):
                    pass  # a label, or a value that is not finite: `bind` reports it
            return bind(expression, Scope(indices, self.constants))
        result = self._results.get(expression)
        if result is None:
            result = self._results[expression] = bind(expression, self.constants)
        return result


Computed = Callable[[Mapping[str, Any]], Number]
"""A function that returns the value of an expression for given values of indices."""


def _computed(
    tree: Tree, indices: Mapping[str, Number | str], constants: Mapping[str, Number | str]
) -> Computed | None:
    """A function that computes an expression of indices and numerical constants only; None for other expressions.

    It computes the same as `bind`, operation by operation, in a third of the time if it is called for many indices.
    """
    kind = tree[0]
    if kind in ("number", "quantity"):
        number = tree[1]
        return lambda _: number
    if kind == "name":
        name = tree[1]
        if name in indices:
            return operator.itemgetter(name) if type(indices[name]) is int else None
        value = constants.get(name)
        if value is None or isinstance(value, str):
            return None
        constant = canonical(value)
        return lambda _: constant
    arguments = tree[2:] if kind == "call" else tree[1:]
    function = FLOAT_FUNCTIONS.get(tree[1]) if kind == "call" and tree[1] != AT_LEAST else None
    if (function is None and kind not in PRECEDENCE) or len(arguments) > 2:
        return None
    inner = [_computed(a, indices, constants) for a in arguments]
    first, second = inner[0], inner[-1]
    if first is None or second is None:
        return None
    if len(inner) == 1:
        one = function or operator.neg
        return lambda at: canonical(one(first(at)))
    if function is not None:
        two = function
        return lambda at: canonical(two(first(at), second(at)))
    return lambda at: canonical(compute(kind, first(at), second(at)))
