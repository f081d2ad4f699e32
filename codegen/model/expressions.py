"""Expressions of a model file: a small grammar, parsed once per text, never evaluated as Python.

A parsed expression is a tree of tuples, which engines and generator evaluate with their own numbers:

``("number", value)``, ``("name", name)``, ``("neg", a)``, ``("+", a, b)``, ``("-", a, b)``, ``("*", a, b)``,
``("/", a, b)``, ``("**", a, b)`` and ``("call", function, a, ...)``.

Names are those of parameters and inputs, ``t``, ``q.NAME`` and ``u.NAME``, and, in forces on bodies, ``position.POINT.x`` and
``velocity.POINT.x``. Constants, repeat indices and ``pi`` have become numbers. Integers below 2**53 are Python ints (exact in
every arithmetic); all other numbers are floats.

Four more nodes exist between `parse` and `bind` only, because they are resolved while a model is loaded:
``("indexed", name, indices, suffix)`` for a name with repeat indices such as ``q.link(k-1)``; ``("%", a, b)``;
``("quantity", value, dimension, text)`` for a number with a unit; and ``("component", a, k, wanted)`` for a component of an
expression given in place of a vector.

Expressions are interned: equal trees are one object, so repeated structure in a model is recognised by identity.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from types import ModuleType
from typing import Any, Final
from weakref import WeakValueDictionary

from ..elementary import ON_ARRAYS, TABLE, TreeFunctions
from .grammar import (
    AT_LEAST,
    CHOICE,
    EXACT,
    FUNCTIONS,
    JUMPS,
    OF_TREES,
    ONE,
    VANISHING,
    WRAPPED,
    ZERO,
    ExpressionError,
    Number,
    Tree,
)
from .tree_text import PRECEDENCE, print_tree
from .trees import nodes, parts


def _operators(kind: str) -> tuple[Callable[..., Expression], Callable[..., Expression]]:
    """The two methods of an operator, with the expression on the left and on the right; the other operand may be a
    number."""

    def left(one: Expression, other: Expression | Number) -> Expression:
        return made(kind, one, other)

    def right(one: Expression, other: Expression | Number) -> Expression:
        return made(kind, other, one)

    return left, right


class Expression:
    """An immutable expression of a model; equal trees are the same object.

    Parameters
    ----------
    tree : tuple
        See the top of this module.

    Attributes
    ----------
    tree : tuple
    names : frozenset of str
        Free names, such as ``L``, ``t``, ``q.crank`` or ``u.ball.wx``.
    """

    __slots__ = ("__weakref__", "_has_units", "_names", "tree")

    tree: Tree
    _names: frozenset[str] | None
    _has_units: bool | None

    def __new__(cls, tree: Tree) -> Expression:
        known = _interned.get(tree)
        if known is not None:
            return known
        self = super().__new__(cls)
        object.__setattr__(self, "tree", tree)
        object.__setattr__(self, "_names", None)
        object.__setattr__(self, "_has_units", None)
        return _interned.setdefault(tree, self)

    __add__, __radd__ = _operators("+")
    __sub__, __rsub__ = _operators("-")
    __mul__, __rmul__ = _operators("*")
    __truediv__, __rtruediv__ = _operators("/")
    __pow__, _ = _operators("**")

    def __neg__(self) -> Expression:
        return made("neg", self)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"an Expression cannot be changed: {name}")

    def __reduce__(self) -> tuple[type[Expression], tuple[Tree]]:
        return Expression, (self.tree,)

    @staticmethod
    def number(value: Number) -> Expression:
        """Return a finite number as an expression."""
        return Expression(("number", canonical(value)))

    @property
    def names(self) -> frozenset[str]:
        if self._names is None:
            object.__setattr__(self, "_names", frozenset(n[1] for n in nodes(self.tree) if n[0] == "name"))
        assert self._names is not None
        return self._names

    @property
    def has_units(self) -> bool:
        """Whether a number in the expression is written with a unit."""
        if self._has_units is None:
            object.__setattr__(self, "_has_units", has_units(self.tree))
        return bool(self._has_units)

    @property
    def is_number(self) -> bool:
        return bool(self.tree[0] == "number")

    @property
    def value(self) -> Number:
        """The number, if `is_number`, or the result of numbers that have not been combined.

        Raises
        ------
        ValueError
            If the expression has names.
        """
        if self.names:
            raise ValueError(f"{self} is not a number; evaluate it with values for {', '.join(sorted(self.names))}")
        return canonical(self.tree[1] if self.is_number else self.evaluate({}))

    def evaluate(self, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] | None = None) -> Any:
        """Value of the expression in any arithmetic.

        Parameters
        ----------
        values : mapping of str to number
            A value for every name in `names`.
        functions : mapping of str to callable, optional
            The functions of the grammar, ``"**"``, and ``"number"``, which converts each int or float of the tree to
            a number of the arithmetic. See `functions_for`; floats by default.

        Raises
        ------
        ArithmeticError or ValueError
            Raised by the functions: division by zero, overflow, a function outside its domain.
        KeyError
            If a name has no value.
        """
        return _evaluate(self.tree, values, FLOAT_FUNCTIONS if functions is None else functions)

    def __str__(self) -> str:
        return print_tree(self.tree, 0)

    def __repr__(self) -> str:
        return f"Expression({str(self)!r})"


_interned: WeakValueDictionary[Tree, Expression] = WeakValueDictionary()


def has_units(tree: Tree) -> bool:
    """Whether a number in a parsed tree has a unit."""
    return tree[0] == "quantity" or (tree[0] != "indexed" and any(map(has_units, parts(tree))))


def has_factors(tree: Tree) -> bool:
    """Whether a plain number multiplies or divides something in a parsed tree."""
    if tree[0] == "indexed":
        return False
    return (tree[0] in ("*", "/") and any(a[0] == "number" for a in tree[1:])) or any(map(has_factors, parts(tree)))


def compares(tree: Tree) -> bool:
    """Whether a bound tree may jump or have a kink: it compares moving numbers or time, or takes their `sign` or `mod`."""
    if tree[0] != "call" or tree[1] not in JUMPS:
        return any(map(compares, parts(tree)))
    names = (n[1] for n in nodes(tree) if n[0] == "name")
    return any(n == "t" or n.startswith(("q.", "u.", "position.", "velocity.")) for n in names)


def _float_sign(a: float) -> float:
    return float((a > 0) - (a < 0))


ARITHMETIC: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
}  # fmt: skip

FLOAT_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    **{name: getattr(math, name) for name in TABLE if hasattr(math, name)},
    "abs": abs,
    "sign": _float_sign,
    "min": min,
    "max": max,
    "mod": operator.mod,
    AT_LEAST: lambda a, b: float(a >= b),
    CHOICE: lambda c, a, b: a if c else b,
    VANISHING: lambda a, b: a * b if a else a,
    WRAPPED: operator.mod,
    "number": float,
    "**": math.pow,
}
"""The functions of the grammar for Python floats."""

_OPERATIONS = {
    "numpy": {"**": "power"},
    "mpmath": {"**": "power", "number": "mpf"},
    "sympy": {"**": "Pow", "number": "sympify"},
}


def functions_for(module: ModuleType | Any) -> dict[str, Callable[..., Any]]:
    """The functions of the grammar from a module, for `Expression.evaluate`.

    Parameters
    ----------
    module : module
        ``numpy``, ``mpmath`` (or a context such as ``mpmath.mp``), ``sympy``, or any module with the functions of
        Python's ``math``.
    """
    root = getattr(module, "__name__", None) or type(module).__module__
    library = root.split(".")[0]
    own = (
        vars(ON_ARRAYS)
        if library == "numpy"
        else {name: FLOAT_FUNCTIONS[name] for name in ("abs", "sign", "min", "max", "mod")}
    )
    own = {"number": float, "**": operator.pow, **own}
    functions: dict[str, Callable[..., Any]] = {}
    for name in [*FUNCTIONS, "number", "**"]:
        its_name = _OPERATIONS.get(library, {}).get(name, name if name != "number" else "")
        if library in _OPERATIONS and name in TABLE:
            its_name = TABLE[name].spelled(library)
        found: Callable[..., Any] | None = getattr(module, its_name, None) or own.get(name)
        if found is None:
            raise TypeError(f"{root} has no function for {name!r}; numpy, mpmath, sympy and math do")
        functions[name] = found
    number = functions["number"]
    functions[AT_LEAST] = own.get(AT_LEAST) or (lambda a, b: number(1 if a >= b else 0))
    where = getattr(module, "where", None)  # for arrays; for single numbers only one branch is evaluated
    functions[CHOICE] = where or FLOAT_FUNCTIONS[CHOICE]
    functions[VANISHING] = (lambda a, b: where(a == 0, 0 * a, a * b)) if where else FLOAT_FUNCTIONS[VANISHING]
    functions[WRAPPED] = functions["mod"]
    return functions


def _evaluate(tree: Tree, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    kind = tree[0]
    if kind == "number":
        return functions["number"](tree[1])
    if kind == "name":
        return values[tree[1]]
    if kind == "call" and tree[1] in (CHOICE, VANISHING):
        first = _evaluate(tree[2], values, functions)
        if not getattr(first, "ndim", 0):  # the argument that does not contribute may have no value
            if tree[1] == CHOICE:
                return _evaluate(tree[3] if first else tree[4], values, functions)
            return first * _evaluate(tree[3], values, functions) if first else first
        return functions[tree[1]](first, *[_evaluate(a, values, functions) for a in tree[3:]])
    if kind == "call":
        return functions[tree[1]](*[_evaluate(a, values, functions) for a in tree[2:]])
    a = _evaluate(tree[1], values, functions)
    if kind == "neg":
        return -a
    if kind == "**" and tree[2][0] == "number" and isinstance(tree[2][1], int):
        return a ** tree[2][1]  # an int exponent is exact and permits a negative base in every arithmetic
    b = _evaluate(tree[2], values, functions)
    if kind == "**":
        return functions["**"](a, b)
    if kind in ARITHMETIC:
        return ARITHMETIC[kind](a, b)
    raise ValueError(f"{print_tree(tree, 0)} must be resolved by bind first")


def canonical(value: Number) -> Number:
    """The unique form of a number: integers below 2**53 are ints, all others floats; no -0.0."""
    if isinstance(value, int) and -EXACT < value < EXACT:
        return int(value)
    value = float(value)
    if not math.isfinite(value):
        raise OverflowError("the number is not finite")
    return int(value) if value == math.floor(value) and abs(value) < EXACT else value


def compute(kind: str, a: Number, b: Number) -> Number:
    """One operation on numbers; sums and products of ints are exact, division is in floats."""
    if kind == "%":
        return a % b
    if kind in ARITHMETIC:
        result: Number = ARITHMETIC[kind](a, b)
        return result
    # the float power comes first: it overflows at once, while the exact power of two ints could take hours
    power = math.pow(a, b)
    if isinstance(a, int) and isinstance(b, int) and b >= 0 and abs(power) < EXACT:
        return int(a**b)
    return power


def combine(kind: str, *arguments: Tree) -> Tree:
    """A node of the tree with its numerical parts computed, without multiplications by 0 and 1 and additions of 0.

    Parameters
    ----------
    kind : str
        An operator, ``neg``, or the name of a function.
    *arguments : tuple
        Trees.

    Raises
    ------
    ExpressionError
        If the result of the numbers is not finite.
    """
    if kind == CHOICE:
        condition, x, y = arguments
        if condition[0] == "number":
            return x if condition[1] else y
        return x if x == y else ("call", kind, *arguments)
    if arguments[0][0] == "number" and (len(arguments) == 1 or arguments[1][0] == "number"):
        return _of_numbers(kind, arguments)
    if kind == "neg":
        return arguments[0][1] if arguments[0][0] == "neg" else ("neg", arguments[0])
    if kind == VANISHING and (arguments[0][0] == "number" or arguments[1][0] == "number"):
        kind = "*"  # no factor is infinite, or the first one is never 0
    if kind in ("mod", WRAPPED) and arguments[1] == ZERO:
        raise ExpressionError(f"{print_tree(_node(kind, arguments), 0)} divides by zero")
    if kind in FUNCTIONS or kind in OF_TREES:
        return ("call", kind, *arguments)
    a, b = arguments
    if kind == "*":
        if ZERO in (a, b):
            return ZERO
        if ONE in (a, b):
            return b if a == ONE else a
    elif kind == "+":
        if ZERO in (a, b):
            return b if a == ZERO else a
    elif kind == "-":
        if b == ZERO:
            return a
        if a == ZERO:
            return combine("neg", b)
    elif kind == "/":
        if b == ZERO:
            raise ExpressionError(f"{print_tree((kind, a, b), 0)} divides by zero")
        if a == ZERO or b == ONE:
            return a
    elif kind == "**":
        if b == ONE:
            return a
    elif kind == "%":
        raise ExpressionError(
            f"{print_tree((kind, a, b), 0)}: the remainder % is allowed between numbers, constants and repeat indices only"
        )
    return (kind, a, b)


def _of_numbers(kind: str, arguments: tuple[Tree, ...]) -> Tree:
    """The number that results from an operation or a function of numbers."""
    a, b = arguments[0][1], arguments[-1][1]
    try:
        if kind == "neg":
            value = -a
        elif kind in PRECEDENCE:
            value = compute(kind, a, b)
        else:
            value = FLOAT_FUNCTIONS[kind](*(x[1] for x in arguments))
        return ("number", canonical(value))
    except ZeroDivisionError:
        why = " divides by zero"
    except OverflowError:
        why = " is too large; numbers up to 1.8e308 are allowed"
    except ValueError:
        takes = f"; {kind} takes {TABLE[kind].takes}" if kind in TABLE and TABLE[kind].takes else ""
        why = f" has no real value{takes}"
    raise ExpressionError(print_tree(_node(kind, arguments), 0) + why)


def made(kind: str, *operands: Expression | Number) -> Expression:
    """An operation or function of expressions and numbers, with numerical parts computed; see `combine`."""
    return Expression(
        combine(kind, *[x.tree if isinstance(x, Expression) else ("number", canonical(x)) for x in operands])
    )


def combine_exactly(kind: str, *arguments: Tree) -> Tree:
    """Like `combine`, but operations that a double would round are not evaluated, so that any number of digits can be
    computed."""
    found = combine(kind, *arguments)
    if found[0] != "number" or any(a[0] != "number" for a in arguments):
        return found
    numbers = [a[1] for a in arguments]
    if kind in _EXACTLY:
        kept = _EXACTLY[kind](*map(Fraction, numbers)) == found[1]
    elif kind == "**" and isinstance(numbers[1], int) and abs(numbers[1]) <= _MOST_EXACT:
        kept = Fraction(numbers[0]) ** numbers[1] == found[1]
    else:
        kept = isinstance(found[1], int) or not (kind == "**" or (kind in TABLE and TABLE[kind].rounds))
    return found if kept else _node(kind, arguments)


_EXACTLY: Final = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
_MOST_EXACT: Final = 64


COMBINED: Final = TreeFunctions(combine)
"""Operations that make trees and compute their numerical parts, see `combine`."""


def _node(kind: str, arguments: tuple[Tree, ...]) -> Tree:
    return ("call", kind, *arguments) if kind in FUNCTIONS or kind in OF_TREES else (kind, *arguments)
