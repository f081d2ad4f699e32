"""Expressions of a model file: a small grammar, parsed once per text, never evaluated as Python.

A parsed expression is a tree of tuples, so that engines and generator walk it with their own numbers:

``("number", value)``, ``("name", name)``, ``("neg", a)``, ``("+", a, b)``, ``("-", a, b)``, ``("*", a, b)``,
``("/", a, b)``, ``("**", a, b)`` and ``("call", function, a, ...)``.

Names are those of parameters and inputs, ``t``, ``q.NAME`` and ``u.NAME``, and, of forces on bodies, ``position.POINT.x`` and
``velocity.POINT.x``; constants and repeat indices have become
numbers, ``pi`` too. Whole numbers below 2**53 are Python ints (exact in every arithmetic), all others are floats.

Four more nodes exist between `parse` and `bind` only, because they are settled while a model is loaded:
``("indexed", name, indices, suffix)`` for a name with repeat indices such as ``q.link(k-1)``, ``("%", a, b)``,
``("quantity", value, dimension, text)`` for a number with a unit, and ``("component", a, k, wanted)`` for one of the three of an
expression that stands in the place of a vector.

Expressions are interned: equal trees are one object, so structure repeated in a model is recognised by identity.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import lru_cache
from types import ModuleType
from typing import Any, Final, NoReturn, Protocol
from weakref import WeakValueDictionary

from ..elementary import ON_ARRAYS, TABLE, TreeFunctions
from ..elementary import Tree as Tree
from .errors import nearest
from .units import UnitError, unit_at

Number = int | float

FUNCTIONS: Final[dict[str, int]] = {name: e.arity for name, e in TABLE.items()}
"""Functions of the grammar and how many arguments they take (``min`` and ``max``: at least so many)."""

AT_LEAST: Final = "at_least"
"""Of trees alone: 1 where the first argument is at least the second, else 0. Comparisons are made of it."""

CHOICE: Final = "choice"
"""Of trees alone: the second argument where the first is 1, the third where it is 0. The other one does not contribute, whatever
its value. ``if`` is made of it."""

VANISHING: Final = "vanishing"
"""Of trees alone: a product that is 0 where its first factor is, even where the second is infinite or has no value there; see
`regular`."""

WRAPPED: Final = "wrapped"
"""Of trees alone: ``mod`` in an expression that is smooth where the remainder jumps, such as a periodic cubic table."""

OF_TREES: Final = (AT_LEAST, CHOICE, VANISHING, WRAPPED)

JUMPS: Final = (AT_LEAST, "sign", "mod")
"""Functions whose value jumps."""

WRITTEN_OUT: Final = {"if": "if(condition, x, y)", "step": "step(x, from, to)", "distance": "distance(POINT, POINT)",
                      "rate": "rate(POINT, POINT)"}  # fmt: skip
"""What is written as a function and becomes an expression of others, and how."""

_OTHER_LANGUAGES: Final = {other: name for name, e in TABLE.items() for other in e.elsewhere}


def functions(name: str) -> str:
    """``functions are sin, cos, ...; did you mean 'log'?`` for a name that is none."""
    other = {
        "heaviside": "; a step is if(x > 0, 1, 0), a smooth one step(x, from, to)", "pow": "; a power is written a**b",
        "log10": "; write log(x)/log(10)", "log2": "; write log(x)/log(2)", "cbrt": "; write x**(1/3)",
    }.get(name.lower())  # fmt: skip
    if other is None and name.lower() in _OTHER_LANGUAGES:
        other = f"; did you mean {_OTHER_LANGUAGES[name.lower()]!r}?"
    every = [*FUNCTIONS, *WRITTEN_OUT]
    return f"functions are {', '.join(every)}{other or nearest(name, every)}"


MEASURED: Final = ("position", "velocity")
"""What is known of points, by components in the ground frame: ``position.tip.x``."""

MAX_LENGTH: Final = 10_000
MAX_NESTING: Final = 100
MAX_DEPTH: Final = 200

_EXACT = 2**53
_ZERO: Tree = ("number", 0)
_ONE: Tree = ("number", 1)


class ExpressionError(ValueError):
    """A text that is no expression, or one whose value does not exist.

    Attributes
    ----------
    message : str
        What was seen and what is allowed.
    column : int or None
        Where in the text, counted from 1; None if it concerns the expression as a whole.
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message if column is None else f"column {column}: {message}")
        self.message = message
        self.column = column


class Expression:
    """An immutable expression of a model; equal trees are the same object.

    Parameters
    ----------
    tree : tuple
        As described at the top of this module.

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

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"an Expression cannot be changed: {name}")

    def __reduce__(self) -> tuple[type[Expression], tuple[Tree]]:
        return Expression, (self.tree,)

    @staticmethod
    def number(value: Number) -> Expression:
        """The expression of one finite number."""
        return Expression(("number", _canonical(value)))

    @property
    def names(self) -> frozenset[str]:
        if self._names is None:
            found: set[str] = set()
            _collect(self.tree, found)
            object.__setattr__(self, "_names", frozenset(found))
        assert self._names is not None
        return self._names

    @property
    def has_units(self) -> bool:
        """Whether a number in it, as it is written, has a unit."""
        if self._has_units is None:
            object.__setattr__(self, "_has_units", has_units(self.tree))
        return bool(self._has_units)

    @property
    def is_number(self) -> bool:
        return bool(self.tree[0] == "number")

    @property
    def value(self) -> Number:
        """The number, if `is_number`.

        Raises
        ------
        ValueError
            If the expression has names.
        """
        if self.tree[0] != "number":
            raise ValueError(f"{self} is no number; evaluate it with values for {', '.join(sorted(self.names))}")
        number: Number = self.tree[1]
        return number

    def evaluate(self, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] | None = None) -> Any:
        """Value of the expression in any arithmetic.

        Parameters
        ----------
        values : mapping of str to number
            A value for every name in `names`.
        functions : mapping of str to callable, optional
            The functions of the grammar, ``"**"``, and ``"number"``, which turns an int or float of the tree into
            a number of the arithmetic before anything is computed with it. See `functions_for`; floats by default.

        Raises
        ------
        ArithmeticError or ValueError
            As the functions raise it: division by zero, overflow, a function outside its domain.
        KeyError
            A name without a value.
        """
        return _evaluate(self.tree, values, FLOAT_FUNCTIONS if functions is None else functions)

    def __str__(self) -> str:
        return _print(self.tree, 0)

    def __repr__(self) -> str:
        return f"Expression({str(self)!r})"


_interned: WeakValueDictionary[Tree, Expression] = WeakValueDictionary()


def _collect(tree: Tree, found: set[str]) -> None:
    kind = tree[0]
    if kind == "name":
        found.add(tree[1])
    elif kind == "call":
        for argument in tree[2:]:
            _collect(argument, found)
    elif kind == "indexed":
        for index in tree[2]:
            _collect(index, found)
    elif kind == "component":
        _collect(tree[1], found)
    elif kind not in ("number", "quantity"):
        for argument in tree[1:]:
            _collect(argument, found)


def has_units(tree: Tree) -> bool:
    """Whether a number of a parsed tree has a unit."""
    kind = tree[0]
    if kind == "component":
        return has_units(tree[1])
    if kind in ("number", "name", "indexed", "quantity"):
        return bool(kind == "quantity")
    return any(has_units(a) for a in tree[2 if kind == "call" else 1 :])


def has_factors(tree: Tree) -> bool:
    """Whether a plain number multiplies something in a parsed tree, or is divided by it."""
    kind = tree[0]
    if kind in ("number", "name", "indexed", "quantity"):
        return False
    inner = tree[1:2] if kind == "component" else tree[2 if kind == "call" else 1 :]
    return (kind in ("*", "/") and any(a[0] == "number" for a in inner)) or any(has_factors(a) for a in inner)


def compares(tree: Tree) -> bool:
    """Whether a bound tree compares numbers that move, or time, or has their `sign` or `mod`: it jumps or has a kink."""
    kind = tree[0]
    if kind in ("number", "name"):
        return False
    if kind == "call" and tree[1] in JUMPS:
        found: set[str] = set()
        _collect(tree, found)
        return any(n == "t" or n.startswith(("q.", "u.", "position.", "velocity.")) for n in found)
    return any(compares(a) for a in tree[2 if kind == "call" else 1 :])


# --- values -----------------------------------------------------------------------------------------------------


def _float_power(a: float, b: float) -> float:
    return math.pow(a, b)


def _float_sign(a: float) -> float:
    return float((a > 0) - (a < 0))


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
    "**": _float_power,
}
"""The functions of the grammar for Python floats."""

_OPERATIONS = {
    "numpy": {"**": "power"},
    "mpmath": {"**": "power", "number": "mpf"},
    "sympy": {"**": "Pow", "number": "sympify"},
}


def functions_for(module: ModuleType | Any) -> dict[str, Callable[..., Any]]:
    """The functions of the grammar taken from a module, for `Expression.evaluate`.

    Parameters
    ----------
    module : module
        ``numpy``, ``mpmath`` (or a context such as ``mpmath.mp``), ``sympy``, or any module that calls its functions as
        Python's ``math`` does.
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
    where = getattr(module, "where", None)  # of arrays; of single numbers one branch alone is evaluated
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
        if not getattr(first, "ndim", 0):  # what does not contribute may have no value
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
        return a ** tree[2][1]  # an int exponent is exact and allows a negative base in every arithmetic
    b = _evaluate(tree[2], values, functions)
    if kind == "+":
        return a + b
    if kind == "-":
        return a - b
    if kind == "*":
        return a * b
    if kind == "/":
        return a / b
    if kind == "**":
        return functions["**"](a, b)
    raise ValueError(f"{_print(tree, 0)} is settled by bind only")


# --- text of a tree ---------------------------------------------------------------------------------------------

_PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "neg": 3, "**": 4}


def _print(tree: Tree, around: int) -> str:
    """Text of a tree, in parentheses if its operator binds weaker than `around`."""
    kind = tree[0]
    if kind == "number":
        text = repr(tree[1])
        return f"({text})" if text.startswith("-") and around > 1 else text
    if kind == "name":
        return str(tree[1])
    if kind == "call" and tree[1] == AT_LEAST:
        return f"({_print(tree[2], 0)} >= {_print(tree[3], 0)})"
    if kind == "call" and tree[1] == CHOICE:
        return f"if({_condition(tree[2])}, {_print(tree[3], 0)}, {_print(tree[4], 0)})"
    if kind == "call" and tree[1] == VANISHING:
        return _print(("*", *tree[2:]), around)
    if kind == "call" and tree[1] == WRAPPED:
        return _print(("call", "mod", *tree[2:]), around)
    if kind == "call":
        return f"{tree[1]}({', '.join(_print(a, 0) for a in tree[2:])})"
    if kind == "indexed":
        return str(tree[1]) + "".join(f"({_print(i, 0)})" for i in tree[2]) + str(tree[3])
    if kind == "quantity":
        return str(tree[3])
    if kind == "component":
        return _print(tree[1], around)
    own = _PRECEDENCE[kind]
    if kind == "neg":
        text = "-" + _print(tree[1], own)
    elif kind == "**":
        text = f"{_print(tree[1], own + 1)}**{_print(tree[2], own)}"
    else:
        space = " " if own == 1 else ""
        text = f"{_print(tree[1], own)}{space}{kind}{space}{_print(tree[2], own + 1)}"
    return f"({text})" if own < around else text


def _condition(tree: Tree) -> str:
    """Text of a condition: a tree of comparisons that is 1 where it holds, else 0."""
    match tree:
        case ("call", "at_least", a, b):
            return f"{_print(a, 0)} >= {_print(b, 0)}"
        case ("-", ("number", 1), ("call", "at_least", a, b)):
            return f"{_print(a, 0)} < {_print(b, 0)}"
        case ("*", a, b):
            return f"({_condition(a)} and {_condition(b)})"
        case ("call", "max", a, b):
            return f"({_condition(a)} or {_condition(b)})"
    return _print(tree, 0)


# --- numbers ----------------------------------------------------------------------------------------------------


def _canonical(value: Number) -> Number:
    """The one representation of a number: whole numbers below 2**53 are ints, all others floats; no -0.0."""
    if isinstance(value, int) and -_EXACT < value < _EXACT:
        return int(value)
    value = float(value)
    if not math.isfinite(value):
        raise OverflowError("the number is not finite")
    return int(value) if value == math.floor(value) and abs(value) < _EXACT else value


def _compute(kind: str, a: Number, b: Number) -> Number:
    """One operation on numbers: sums and products of ints stay exact, division is the float one."""
    if kind == "+":
        return a + b
    if kind == "-":
        return a - b
    if kind == "*":
        return a * b
    if kind == "/":
        return a / b
    if kind == "%":
        return a % b
    # The float power first: it overflows at once where the exact one of two ints would run for hours.
    power = math.pow(a, b)
    if isinstance(a, int) and isinstance(b, int) and b >= 0 and abs(power) < _EXACT:
        return int(a**b)
    return power


def combine(kind: str, *arguments: Tree) -> Tree:
    """A node of the tree with its numbers computed, and multiplications by 0 and 1 and additions of 0 removed.

    Parameters
    ----------
    kind : str
        An operator, ``neg``, or the name of a function.
    *arguments : tuple
        Trees.

    Raises
    ------
    ExpressionError
        If the numbers have no finite result.
    """
    if kind == CHOICE:
        condition, x, y = arguments
        if condition[0] == "number":
            return x if condition[1] else y
        return x if x == y else ("call", kind, *arguments)
    if arguments[0][0] == "number" and (len(arguments) == 1 or arguments[1][0] == "number"):
        try:
            if kind == "neg":
                value = -arguments[0][1]
            elif kind in _PRECEDENCE:
                value = _compute(kind, arguments[0][1], arguments[1][1])
            else:
                value = FLOAT_FUNCTIONS[kind](*[a[1] for a in arguments])
            return ("number", _canonical(value))
        except ZeroDivisionError:
            raise ExpressionError(f"{_print(_node(kind, arguments), 0)} divides by zero") from None
        except OverflowError:
            raise ExpressionError(
                f"{_print(_node(kind, arguments), 0)} is too large; numbers up to 1.8e308 are allowed"
            ) from None
        except ValueError:
            takes = f"; {kind} takes {TABLE[kind].takes}" if kind in TABLE and TABLE[kind].takes else ""
            raise ExpressionError(f"{_print(_node(kind, arguments), 0)} has no real value{takes}") from None
    if kind == "neg":
        return arguments[0][1] if arguments[0][0] == "neg" else ("neg", arguments[0])
    if kind == VANISHING and (arguments[0][0] == "number" or arguments[1][0] == "number"):
        kind = "*"  # nothing is infinite, or the first factor never 0
    if kind in ("mod", WRAPPED) and arguments[1] == _ZERO:
        raise ExpressionError(f"{_print(_node(kind, arguments), 0)} divides by zero")
    if kind in FUNCTIONS or kind in OF_TREES:
        return ("call", kind, *arguments)
    a, b = arguments
    if kind == "*":
        if a == _ZERO or b == _ZERO:
            return _ZERO
        if a == _ONE:
            return b
        if b == _ONE:
            return a
    elif kind == "+":
        if a == _ZERO:
            return b
        if b == _ZERO:
            return a
    elif kind == "-":
        if b == _ZERO:
            return a
        if a == _ZERO:
            return combine("neg", b)
    elif kind == "/":
        if b == _ZERO:
            raise ExpressionError(f"{_print((kind, a, b), 0)} divides by zero")
        if a == _ZERO or b == _ONE:
            return a
    elif kind == "**":
        if b == _ONE:
            return a
    elif kind == "%":
        raise ExpressionError(
            f"{_print((kind, a, b), 0)}: the remainder % takes numbers, constants and repeat indices only"
        )
    return (kind, a, b)


COMBINED: Final = TreeFunctions(combine)
"""Makes trees with their numbers computed, see `combine`."""


def _node(kind: str, arguments: tuple[Tree, ...]) -> Tree:
    return ("call", kind, *arguments) if kind in FUNCTIONS or kind in OF_TREES else (kind, *arguments)


# --- binding ----------------------------------------------------------------------------------------------------


class Numbers(Protocol):
    """What `bind` looks names up in: a mapping, or a `Scope`."""

    def get(self, name: str, /) -> Number | str | None:
        """Number or label of a name, or None."""


class Scope:
    """Repeat indices before constants, without a copy of either."""

    __slots__ = ("constants", "indices")

    def __init__(self, indices: Mapping[str, Number | str], constants: Mapping[str, Number | str]) -> None:
        self.indices = indices
        self.constants = constants

    def get(self, name: str, /) -> Number | str | None:
        """Number or label of a name, or None."""
        value = self.indices.get(name)
        return self.constants.get(name) if value is None else value


def bind(expression: Expression, numbers: Numbers) -> Expression:
    """Put numbers in the place of constants and repeat indices, settle indexed names, and compute what is numeric.

    Parameters
    ----------
    expression : Expression
    numbers : mapping of str to int, float or str, or Scope
        Constants and indices. A str is the label of a repetition and may be used as an index only.

    Raises
    ------
    ExpressionError
        A number without a finite value, an index that is no whole number, a remainder or an index of unknown names.
    """
    tree = _bind(expression.tree, numbers)
    return expression if tree is expression.tree else Expression(tree)


def label_key(label: str) -> str:
    """Key under which `numbers` says that a label of some repetition may be written as an index: ``foot(left)``."""
    return f"'{label}'"  # no name has a quote


def index_text(tree: Tree, numbers: Numbers) -> str:
    """Text of a repeat index in a generated name, such as ``3`` or ``left``.

    Raises
    ------
    ExpressionError
        If it is neither a label nor a whole number from 0.
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
    ):  # the neighbour, by far the most frequent
        value, step = numbers.get(tree[1][1]), tree[2][1]
        if type(value) is int and type(step) is int:
            value = value + step if tree[0] == "+" else value - step
            if 0 <= value < _EXACT:
                return str(value)
    bound = _bind(tree, numbers)
    if bound[0] == "number" and isinstance(bound[1], int) and bound[1] >= 0:
        return str(bound[1])
    if bound[0] != "number":
        raise ExpressionError(f"index ({_print(tree, 0)}) has no value here; constants and repeat indices have one")
    raise ExpressionError(f"index ({_print(tree, 0)}) is {bound[1]!r}; an index is a whole number from 0, or a label")


def _bind(tree: Tree, numbers: Numbers) -> Tree:
    kind = tree[0]
    if kind == "number":
        return tree
    if kind == "quantity":
        return ("number", tree[1])
    if kind == "component":
        found, is_vector = _component(tree[1], tree[2], numbers)
        if not is_vector:
            raise ExpressionError(f"{_print(tree[1], 0)!r} is no {tree[3]}")
        return found
    if kind == "name":
        value = numbers.get(tree[1])
        if value is None:
            return tree
        if isinstance(value, str):
            raise ExpressionError(f"{tree[1]} is the label {value!r} here, not a number; a label can only be an index")
        return ("number", _canonical(value))
    if kind == "call" and tree[1] == CHOICE:
        condition = _bind(tree[2], numbers)
        if condition[0] == "number":  # what is never taken need not have a value
            return _bind(tree[3] if condition[1] else tree[4], numbers)
        return combine(CHOICE, condition, *[_bind(a, numbers) for a in tree[3:]])
    if kind == "call":
        return combine(tree[1], *[_bind(a, numbers) for a in tree[2:]])
    if kind == "indexed":
        try:
            name = "_".join([tree[1], *[index_text(i, numbers) for i in tree[2]]]) + tree[3]
        except ExpressionError as error:
            raise ExpressionError(
                f"{tree[1]}(...) is neither a function nor a name with a repeat index: {error.message}; {functions(tree[1])}"
            ) from None
        return _bind(("name", name), numbers)
    return combine(kind, *[_bind(a, numbers) for a in tree[1:]])


def vector_key(name: str) -> str:
    """Key under which `numbers` says that a name is a vector: ``NAME.x``, ``NAME.y``, ``NAME.z``."""
    return f"'{name}.'"  # no name has a quote


def component_of(tree: Tree, k: int, wanted: str) -> Tree:
    """One of the three components of an expression that stands where a vector is wanted."""
    return ("component", tree, k, wanted)


def _component(tree: Tree, k: int, numbers: Numbers) -> tuple[Tree, bool]:
    """A component of what is a vector, bound, and True; or what is a number, bound, and False."""
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
        raise ExpressionError(f"{_print(tree, 0)} adds a number and a vector; both are to be vectors")
    if (kind == "*" and left and right) or (kind == "/" and right):
        raise ExpressionError(f"{_print(tree, 0)} multiplies or divides by a vector; a vector takes numbers as factors")
    return combine(kind, a, b), left or right


class Binder:
    """Binds many expressions to the same constants and remembers the results that no index changes.

    Parameters
    ----------
    constants : mapping of str to number
        Labels too, see `label_key`. Read at every new binding; constants that were used must not change afterwards.
    """

    def __init__(self, constants: Mapping[str, Number | str]) -> None:
        self.constants = constants
        self._results: dict[Expression, Expression] = {}
        self._computed: dict[tuple[Expression, tuple[str, ...]], Computed | None] = {}

    def __call__(self, expression: Expression, indices: Mapping[str, int | str]) -> Expression:
        """`bind` to the constants and these repeat indices."""
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
                    pass  # a label, or no finite value: `bind` says so
            return bind(expression, Scope(indices, self.constants))
        result = self._results.get(expression)
        if result is None:
            result = self._results[expression] = bind(expression, self.constants)
        return result


Computed = Callable[[Mapping[str, Any]], Number]
"""The number of an expression for values of indices."""


def _computed(
    tree: Tree, indices: Mapping[str, Number | str], constants: Mapping[str, Number | str]
) -> Computed | None:
    """How to compute an expression that has no names but indices and constants that are numbers; None for any other.

    It computes the same as `bind`, operation by operation, in a third of the time where many indices follow.
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
        constant = _canonical(value)
        return lambda _: constant
    arguments = tree[2:] if kind == "call" else tree[1:]
    function = FLOAT_FUNCTIONS.get(tree[1]) if kind == "call" and tree[1] != AT_LEAST else None
    if (function is None and kind not in _PRECEDENCE) or len(arguments) > 2:
        return None
    inner = [_computed(a, indices, constants) for a in arguments]
    first, second = inner[0], inner[-1]
    if first is None or second is None:
        return None
    if len(inner) == 1:
        one = function or operator.neg
        return lambda at: _canonical(one(first(at)))
    if function is not None:
        two = function
        return lambda at: _canonical(two(first(at), second(at)))
    return lambda at: _canonical(_compute(kind, first(at), second(at)))


# --- parsing ----------------------------------------------------------------------------------------------------

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z0-9_]+)*)"
    r"|(?P<operator>\*\*|[<>]=?|[-+*/%(),])"
)
_SUFFIX = re.compile(r"(?:\.[A-Za-z0-9_]+)+")
_BINARY = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "**": 4}
_UNARY = 3
_COMPARED = ("<", "<=", ">", ">=")
_WORDS = ("and", "or", "not")


def _gap(what: str, start: Tree, end: Tree, c: str) -> Tree:
    """A component of the way from one point to another, or of its rate."""
    a, b = (
        ("name", f"{what}.{p[1]}.{c}") if p[0] == "name" else ("indexed", f"{what}.{p[1]}", p[2], f".{c}")
        for p in (start, end)
    )
    return ("-", b, a)


def _length(start: Tree, end: Tree) -> Tree:
    """How far one point is from another."""
    x, y, z = (("**", _gap("position", start, end, c), ("number", 2)) for c in "xyz")
    return ("call", "sqrt", ("+", ("+", x, y), z))


@lru_cache(maxsize=4096)
def parse(text: str) -> Expression:
    """Parse a text of the expression grammar.

    Parameters
    ----------
    text : str

    Returns
    -------
    Expression
        As written; `bind` computes its numeric parts.

    Raises
    ------
    ExpressionError
        With the column, what was seen there and what is allowed.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"{len(text)} characters; an expression has up to {MAX_LENGTH}, name its parts")
    parser = _Parser(text)
    if parser.kind == "end":
        raise ExpressionError("nothing here; a number or an expression is needed", 1)
    tree, _ = parser.expression(1, 0)
    if parser.kind != "end":
        if parser.token == ")":
            parser.fail("a closing parenthesis that was never opened")
        if parser.token == ",":
            parser.fail("a comma outside a function's parentheses")
        parser.fail(f"{parser.token!r} follows a complete expression; an operator + - * / ** is missing before it")
    return Expression(tree)


class _Parser:
    """Precedence climbing over one text; `kind`, `token` and `start` describe the next token."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.end = 0
        self.advance()

    def advance(self) -> None:
        while True:
            self.start = self.end
            if self.start == len(self.text):
                self.kind, self.token = "end", ""
                return
            match = _TOKEN.match(self.text, self.start)
            if match is None:
                self.kind, self.token = "other", self.text[self.start]
                hint = {
                    ".": "; a number has digits, and is finite",
                    "^": "; a power is written **",
                    "[": "; an index is written in round parentheses: link(k)",
                    "=": "; an expression has no equals sign",
                    "'": "; an expression has no quotes",
                    '"': "; an expression has no quotes",
                }.get(self.token, "; an expression has numbers, names, + - * / ** ( ) and functions")
                self.fail(f"character {self.token!r}{hint}")
            self.end = match.end()
            self.kind, self.token = str(match.lastgroup), match.group()
            if self.kind != "space":
                return

    def fail(self, message: str, start: int | None = None) -> NoReturn:
        raise ExpressionError(message, (self.start if start is None else start) + 1)

    def node(self, tree: Tree, depth: int) -> tuple[Tree, int]:
        if depth > MAX_DEPTH:
            self.fail(
                f"more than {MAX_DEPTH} operations in a row or inside each other; "
                f"group the terms in parentheses or split the expression"
            )
        return tree, depth

    def expression(self, least: int, nesting: int) -> tuple[Tree, int]:
        """The expression here whose operators bind at least as strongly as `least`, and the depth of its tree."""
        if nesting > MAX_NESTING:
            self.fail(f"more than {MAX_NESTING} levels of parentheses or signs; split the expression")
        if self.token in ("+", "-"):
            sign = self.token
            self.advance()
            left, depth = self.expression(_UNARY, nesting + 1)
            if sign == "-":
                left, depth = self.node(("neg", left), depth + 1)
        else:
            left, depth = self.operand(nesting)
        while _BINARY.get(self.token, 0) >= least:
            kind = self.token
            strength = _BINARY[kind]
            self.advance()
            # ** groups to the right, the others to the left
            right, right_depth = self.expression(strength if kind == "**" else strength + 1, nesting + 1)
            left, depth = self.node((kind, left, right), max(depth, right_depth) + 1)
        return left, depth

    def operand(self, nesting: int) -> tuple[Tree, int]:
        start, token = self.start, self.token
        if self.kind == "number":
            self.advance()
            return (
                self.quantity(token, start)
                if self.kind == "name" and self.token not in _WORDS
                else self.number(token, start)
            ), 1
        if self.kind == "name":
            self.advance()
            if self.token == "(" and self.kind == "operator":
                return self.call(token, start, nesting)
            return self.name(token, start), 1
        if token == "(":
            self.advance()
            result = self.expression(1, nesting + 1)
            self.close(start)
            return result
        if self.kind == "end":
            self.fail("the expression ends here; a number, a name or ( is needed")
        self.fail(f"{token!r} where a number, a name or ( is needed")

    def close(self, opened: int) -> None:
        if self.token != ")":
            self.fail(
                "the parenthesis is not closed; inside [ ] or { } of YAML a comma ends the value, put quotes around it"
                if self.kind == "end"
                else f"{self.token!r} where a closing parenthesis or an operator is needed",
                opened if self.kind == "end" else None,
            )
        self.advance()

    def number(self, token: str, start: int) -> Tree:
        value = float(token)
        if math.isinf(value):
            self.fail(f"number {token if len(token) < 30 else token[:27] + '...'} is too large; up to 1.8e308", start)
        if value != 0 and abs(value) < _EXACT and token.isdigit():
            return ("number", int(value))  # exact, and int(token) refuses some thousands of leading zeros
        return ("number", _canonical(value))

    def quantity(self, token: str, start: int) -> Tree:
        """A number and the unit that follows it."""
        try:
            size, dimension, end = unit_at(self.text, self.start)
        except UnitError as error:
            self.fail(f"an operator + - * / ** is missing between the number and {self.token!r}; {error}")
        value = float(token)
        if 0 < value < math.inf:
            try:  # of more digits than floats have not all count, and they take time
                value = float((Fraction(token) if len(token) <= 60 else Fraction(value)) * size)
            except OverflowError:
                value = math.inf
        if math.isinf(value):
            self.fail(f"{self.text[start:end][:30]} is too large; numbers up to 1.8e308 are allowed", start)
        self.end = end
        self.advance()
        return ("quantity", _canonical(value), dimension, self.text[start:end])

    def name(self, name: str, start: int) -> Tree:
        if name == "pi":
            return ("number", math.pi)
        first, dot, rest = name.partition(".")
        if dot and first in MEASURED:
            if not re.fullmatch(r"[A-Za-z_]\w*\.[xyz]", rest):
                self.fail(f"name {name}; write {first}.POINT.x, .y or .z with the name of a point or a body", start)
        elif dot and rest not in ("x", "y", "z") and (first not in ("q", "u") or rest[0].isdigit()):
            self.fail(
                f"name {name}; only coordinates q.NAME, speeds u.NAME, position.POINT.x and velocity.POINT.x have a dot, "
                f"and components NAME.x, .y and .z of vectors",
                start,
            )
        if name in ("q", "u"):
            self.fail(f"{name} alone; write {name}.NAME with the name of a joint", start)
        if name in FUNCTIONS:
            self.fail(f"function {name} without its argument; write {name}(...)", start)
        return ("name", name)

    def call(self, name: str, start: int, nesting: int) -> tuple[Tree, int]:
        if name in WRITTEN_OUT:
            return getattr(self, f"_{name}")(start, nesting)
        if name not in FUNCTIONS:
            return self.indexed(name, start, nesting)
        opened = self.start
        self.advance()
        arguments = []
        if self.token == ")":
            self.fail(f"{name} without an argument; it takes {FUNCTIONS[name]}")
        while True:
            arguments.append(self.expression(1, nesting + 1))
            if self.token != ",":
                break
            self.advance()
        self.close(opened)
        needed, many = FUNCTIONS[name], TABLE[name].many
        if len(arguments) != needed and not (many and len(arguments) > needed):
            self.fail(
                f"{name} with {len(arguments)} argument{'s' * (len(arguments) > 1)}; "
                f"it takes {'at least ' * many}{needed}",
                start,
            )
        if not many:
            return self.node(("call", name, *[a for a, _ in arguments]), 1 + max(d for _, d in arguments))
        result = arguments[0]
        for tree, depth in arguments[1:]:  # min(a, b, c) is min(min(a, b), c): every walker then knows two arguments
            result = self.node(("call", name, result[0], tree), 1 + max(result[1], depth))
        return result

    def _if(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``if(a < b, x, y)``: x where the condition holds, else y."""
        opened = self.start
        self.advance()
        (holds, _), deep = self.condition(nesting + 1)
        others = []
        for _ in range(2):
            if self.token != ",":
                self.fail(f"{self.token or 'the end'!r} where a comma is needed; write {WRITTEN_OUT['if']}", start)
            self.advance()
            others.append(self.expression(1, nesting + 1))
        self.close(opened)
        (x, of_x), (y, of_y) = others
        return self.node(("call", CHOICE, holds, x, y), 1 + max(deep, of_x, of_y))

    def condition(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        """Two trees, of which one is 1 and the other 0: the first where the condition here holds. Comparisons with ``not``,
        ``and`` and ``or``."""
        (holds, fails), depth = self.conjunction(nesting)
        while self.token == "or":
            self.advance()
            (other, also), deep = self.conjunction(nesting)
            depth = 1 + max(depth, deep)
            holds, fails = ("call", "max", holds, other), self.node(("*", fails, also), depth)[0]
        return (holds, fails), depth

    def conjunction(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        (holds, fails), depth = self.comparison(nesting)
        while self.token == "and":
            self.advance()
            (other, also), deep = self.comparison(nesting)
            depth = 1 + max(depth, deep)
            holds, fails = self.node(("*", holds, other), depth)[0], ("call", "max", fails, also)
        return (holds, fails), depth

    def comparison(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        if nesting > MAX_NESTING:
            self.fail(f"more than {MAX_NESTING} levels of parentheses or signs; split the expression")
        if self.token == "not":
            self.advance()
            (holds, fails), depth = self.comparison(nesting + 1)
            return (fails, holds), depth
        inner = self.enclosed(nesting) if self.token == "(" else None
        if inner is not None:
            return inner
        left, depth = self.expression(1, nesting)
        sign = self.token
        if sign not in _COMPARED:
            self.fail(
                f"{sign or 'the end'!r} where one of {' '.join(_COMPARED)} is needed; a condition compares two numbers"
            )
        self.advance()
        right, deep = self.expression(1, nesting)
        a, b = (left, right) if sign in (">=", "<") else (right, left)
        tree: Tree = ("call", AT_LEAST, a, b)
        self.node(tree, depth := 2 + max(depth, deep))
        rest: Tree = ("-", _ONE, tree)
        return ((rest, tree) if sign in ("<", ">") else (tree, rest)), depth

    def enclosed(self, nesting: int) -> tuple[tuple[Tree, Tree], int] | None:
        """A condition in parentheses; None where these are part of a number, which is then read from where they begin."""
        here = self.end, self.start, self.kind, self.token
        self.advance()
        try:
            found = self.condition(nesting + 1)
            if self.token == ")":
                self.advance()
                if self.token in (",", ")", "and", "or"):
                    return found
        except ExpressionError:
            pass  # said again, from where a number is expected
        self.end, self.start, self.kind, self.token = here
        return None

    def _step(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``step(x, a, b)``: 0 below a, 1 above b, between them ``s^3 (10 - 15 s + 6 s^2)``, smooth to the second derivative."""
        (x, low, high), depth = self.arguments("step", 3, start, nesting)
        s = ("call", "min", ("call", "max", ("/", ("-", x, low), ("-", high, low)), _ZERO), _ONE)
        inner = ("+", ("-", ("number", 10), ("*", ("number", 15), s)), ("*", ("number", 6), ("**", s, ("number", 2))))
        return self.node(("*", ("**", s, ("number", 3)), inner), depth + 7)

    def _distance(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``distance(a, b)``: of two points, m."""
        del nesting
        one, other = self.points("distance", start)
        return _length(one, other), 6

    def _rate(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``rate(a, b)``: of the distance of two points by time, m/s."""
        del nesting
        one, other = self.points("rate", start)
        products = [("*", _gap("position", one, other, c), _gap("velocity", one, other, c)) for c in "xyz"]
        return ("/", ("+", ("+", products[0], products[1]), products[2]), _length(one, other)), 7

    def points(self, name: str, start: int) -> tuple[Tree, Tree]:
        """Two names in parentheses, each perhaps with repeat indices."""
        found = []
        opened = self.start
        for k in range(2):
            self.advance()
            at = self.start
            tree = self.operand(0) if self.kind == "name" else (_ZERO, 1)
            if tree[0][0] not in ("name", "indexed") or "." in tree[0][1]:
                self.fail(f"a point is needed, by its name or that of a body; write {WRITTEN_OUT[name]}", at)
            found.append(tree[0])
            if k == 0 and self.token != ",":
                self.fail(f"{name} of one point; write {WRITTEN_OUT[name]}", start)
        self.close(opened)
        return found[0], found[1]

    def arguments(self, name: str, count: int, start: int, nesting: int) -> tuple[list[Tree], int]:
        """So many expressions in parentheses, and the depth of the deepest."""
        opened = self.start
        found: list[tuple[Tree, int]] = []
        while not found or self.token == ",":
            self.advance()
            found.append(self.expression(1, nesting + 1))
        self.close(opened)
        if len(found) != count:
            self.fail(f"{name} with {len(found)} arguments; write {WRITTEN_OUT[name]}", start)
        return [tree for tree, _ in found], max(depth for _, depth in found)

    def indexed(self, name: str, start: int, nesting: int) -> tuple[Tree, int]:
        first, dot, rest = name.partition(".")
        measured = bool(dot) and first in MEASURED
        if (
            (dot and first not in ("q", "u", *MEASURED))
            or "." in rest
            or name in ("q", "u", "t", "pi")
            or rest[:1].isdigit()
        ):
            self.fail(f"{name}(...) is neither a function nor a name with a repeat index", start)
        indices: list[Tree] = []
        deepest = 0
        while self.token == "(":
            opened = self.start
            self.advance()
            tree, depth = self.expression(1, nesting + 1)
            if self.token == ",":
                self.fail(
                    f"{name} is no function; {functions(name)}; of a name, two indices are written {name}(i)(j)", start
                )
            if self.token == ")" and (match := _SUFFIX.match(self.text, self.end)):
                if measured and match.group() not in (".x", ".y", ".z"):
                    self.fail(f"{name}(...){match.group()}; a component is .x, .y or .z", start)
                self.end = match.end()
                self.advance()
                return ("indexed", name, (*indices, tree), match.group()), max(deepest, depth) + 1
            self.close(opened)
            indices.append(tree)
            deepest = max(deepest, depth)
        if measured:
            self.fail(f"{name}(...) without a component; write {name}(...).x, .y or .z", start)
        return self.node(("indexed", name, tuple(indices), ""), deepest + 1)
