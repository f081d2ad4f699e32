"""The elementary functions of the expression grammar, with one entry each that all other modules use.

The parser, both targets, both reference engines, extended precision, sympy, all kinds of derivatives, the switching functions and
the unit checks use these entries. A new smooth function of one number needs one more line of `TABLE`, and a line in
docs/model_format.md.

A derivative is a Python function ``(f, y, x)`` or ``(f, y, a, b)`` of a namespace, the value and the arguments. The
derivative uses operators and functions of the namespace, such as ``f.cos(x)``, so it works for floats, arrays, decimal
numbers, symbols and trees. Constants are formulas that are exact in every namespace: pi is ``4*f.atan(1)``. Where a
derivative contains the root of a product, no factor of the product is negative within the domain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

Tree = tuple[Any, ...]
"""An expression of a model file, see `codegen.model.expressions`."""

Slope = Callable[..., Any]
"""``(functions, value, *arguments)``: the derivative of a function with respect to one of its arguments."""


ODD, EVEN = -1, 1
ALWAYS, LIKE_ITS_ARGUMENT = "always", "like its argument"


@dataclass(frozen=True, slots=True)
class Elementary:
    """An elementary function.

    Attributes
    ----------
    name : str
        Name in the grammar of model files.
    slopes : tuple of callable
        The derivatives with respect to the arguments. At kinks they are one-sided or zero, at jumps zero.
    domain : (float, float), optional
        The smallest and largest allowed argument, if not all are allowed.
    switching : callable, optional
        ``(functions, *arguments)``: zero where the function is not smooth.
    branches : bool
        Whether the function has different formulas for the two signs of `switching`.
    jumps : bool
        Whether the value jumps where `switching` is zero.
    parity : int
        `EVEN`, `ODD` or 0.
    positive : {"", ALWAYS, LIKE_ITS_ARGUMENT}
        Where values are positive. Values of the last kind are never negative.
    pure : bool
        Whether the argument and the value have no unit.
    many : bool
        Whether more than two arguments are allowed.
    symbol, c, numpy, mpmath, sympy : str, optional
        The name in statements, in C, and in three libraries, if it differs; empty if there is none. Modules for NumPy then
        apply Python's math function element by element. mpmath and sympy must have the function.
    elsewhere : tuple of str
        Names in other languages, for messages.
    """

    name: str
    slopes: tuple[Slope, ...]
    domain: tuple[float, float] | None = None
    switching: Slope | None = None
    branches: bool = False
    jumps: bool = False
    parity: int = 0
    positive: str = ""
    pure: bool = False
    many: bool = False
    symbol: str | None = None
    c: str | None = None
    numpy: str | None = None
    mpmath: str | None = None
    sympy: str | None = None
    elsewhere: tuple[str, ...] = ()

    @property
    def arity(self) -> int:
        """Number of arguments of the function."""
        return len(self.slopes)

    @property
    def rounds(self) -> bool:
        """Whether libraries compute the function by several operations, so that the result has more than one rounding error."""
        return self.pure or self.name == "atan2"

    @property
    def takes(self) -> str:
        """Description of the domain; empty if every number is allowed."""
        if self.domain is None:
            return ""
        low, high = self.domain
        if high < math.inf:
            return f"numbers from {low:g} to {high:g}"
        return "numbers above 0" if low == math.ulp(0.0) else f"numbers from {low:g}"

    def spelled(self, where: str) -> str:
        """The name of the function as a ``"symbol"``, in ``"c"``, ``"numpy"``, ``"mpmath"`` or ``"sympy"``; empty without one."""
        other: str | None = getattr(self, where)
        return self.name if other is None else other


def _difference(f: Any, a: Any, b: Any) -> Any:
    return a - b


def _first(f: Any, *arguments: Any) -> Any:
    return arguments[0]


def _bounds(f: Any, x: Any) -> Any:
    return 1 - x * x


def _smooth(name: str, slope: Slope, **more: Any) -> Elementary:
    return Elementary(name, (slope,), pure=True, **more)


WITHIN = (math.nextafter(-1.0, 0.0), math.nextafter(1.0, 0.0))
BETWEEN, FROM_ZERO, ABOVE_ZERO = (-1.0, 1.0), (0.0, math.inf), (math.ulp(0.0), math.inf)

TABLE: Final = {e.name: e for e in (
    _smooth("sin", lambda f, y, x: f.cos(x), parity=ODD),
    _smooth("cos", lambda f, y, x: -f.sin(x), parity=EVEN),
    _smooth("tan", lambda f, y, x: y**2 + 1, parity=ODD),
    # two factors: 1 - x**2 loses digits near x = 1
    _smooth("asin", lambda f, y, x: 1/f.sqrt((1 - x)*(1 + x)), parity=ODD, domain=BETWEEN, switching=_bounds,
            numpy="arcsin", elsewhere=("arcsin",)),
    _smooth("acos", lambda f, y, x: -1/f.sqrt((1 - x)*(1 + x)), domain=BETWEEN, switching=_bounds,
            numpy="arccos", elsewhere=("arccos",)),
    _smooth("atan", lambda f, y, x: 1/(x**2 + 1), parity=ODD, numpy="arctan", elsewhere=("arctan",)),
    Elementary("atan2", (lambda f, z, y, x: x/(x**2 + y**2), lambda f, z, y, x: -y/(x**2 + y**2)), switching=_first,
               branches=True, jumps=True, numpy="arctan2", elsewhere=("arctan2",)),
    _smooth("sinh", lambda f, y, x: f.cosh(x), parity=ODD),
    # derivatives of powers of cosh contain the power times tanh: with sinh, those of 1/cosh would overflow far from zero
    _smooth("cosh", lambda f, y, x: y*f.tanh(x), parity=EVEN, positive=ALWAYS),
    _smooth("tanh", lambda f, y, x: 1/f.cosh(x)**2, parity=ODD),  # 1 - y**2 loses all digits near y = 1
    _smooth("asinh", lambda f, y, x: 1/f.sqrt(x**2 + 1), parity=ODD, numpy="arcsinh", elsewhere=("arcsinh",)),
    _smooth("acosh", lambda f, y, x: 1/f.sqrt((x - 1)*(x + 1)), domain=(1.0, math.inf), switching=lambda f, x: x - 1,
            numpy="arccosh", elsewhere=("arccosh",)),
    _smooth("atanh", lambda f, y, x: 1/((1 - x)*(1 + x)), parity=ODD, domain=WITHIN, switching=_bounds,
            numpy="arctanh", elsewhere=("arctanh",)),
    _smooth("exp", lambda f, y, x: y, positive=ALWAYS),
    _smooth("log", lambda f, y, x: 1/x, domain=ABOVE_ZERO, elsewhere=("ln",)),
    _smooth("erf", lambda f, y, x: f.exp(-x*x)/f.sqrt(f.atan(1)), parity=ODD, numpy=""),
    _smooth("erfc", lambda f, y, x: -f.exp(-x*x)/f.sqrt(f.atan(1)), positive=ALWAYS, numpy=""),
    Elementary("sqrt", (lambda f, y, x: 1/(2*y),), domain=FROM_ZERO, switching=_first,
               positive=LIKE_ITS_ARGUMENT, elsewhere=("sqr",)),
    Elementary("abs", (lambda f, y, x: f.sign(x),), switching=_first, branches=True, positive=LIKE_ITS_ARGUMENT,
               symbol="Absolute", c="fabs", mpmath="fabs", sympy="Abs", elsewhere=("fabs",)),
    Elementary("sign", (lambda f, y, x: 0*y,), switching=_first, branches=True, jumps=True, symbol="Sign", c="",
               elsewhere=("sgn", "signum")),
    Elementary("max", (lambda f, y, a, b: f.at_least(a, b), lambda f, y, a, b: 1 - f.at_least(a, b)), switching=_difference,
               branches=True, many=True, symbol="Maximum", c="fmax", numpy="maximum", sympy="Max",
               elsewhere=("fmax", "maximum")),
    Elementary("min", (lambda f, y, a, b: f.at_least(b, a), lambda f, y, a, b: 1 - f.at_least(b, a)), switching=_difference,
               branches=True, many=True, symbol="Minimum", c="fmin", numpy="minimum", sympy="Min",
               elsewhere=("fmin", "minimum")),
    # the switching function is positive where floor(x/m) is even, negative where floor(x/m) is odd
    Elementary("mod", (lambda f, y, x, m: 1, lambda f, y, x, m: (y - x)/m), switching=lambda f, x, m: f.sin(4*f.atan(1)*x/m),
               branches=True, jumps=True, symbol="", c="", sympy="Mod"),
)}  # fmt: skip
"""Elementary functions by their names in the grammar."""

BY_SYMBOL: Final = {e.spelled("symbol"): e for e in TABLE.values()}
"""Elementary functions by their names in statements."""


def _on_arrays(e: Elementary) -> Callable[..., Any]:
    if name := e.spelled("numpy"):
        found: Callable[..., Any] = getattr(np, name)
        return found
    each = np.vectorize(getattr(math, e.name), otypes=[float])
    return lambda x: each(x)[()]


ON_ARRAYS: Final = SimpleNamespace(
    at_least=lambda a, b: np.where(np.greater_equal(a, b), 1.0, 0.0), **{e.name: _on_arrays(e) for e in TABLE.values()}
)
"""Functions for floats and for arrays, as attributes; used as the first argument of `Slope`."""


ELEMENTWISE: Final = tuple(e.name for e in TABLE.values() if not e.spelled("numpy"))
"""Functions that NumPy lacks; generated modules define them element by element."""


def named(where: str, wanted: Callable[[Elementary], bool] = lambda e: True) -> tuple[str, ...]:
    """Names in a language (see `Elementary.spelled`) of all functions that the language has, or of selected
    functions."""
    return tuple(e.spelled(where) for e in TABLE.values() if e.spelled(where) and wanted(e))


# --- formulas as trees ------------------------------------------------------------------------------------------


class TreeNumber:
    """A tree with the operators of numbers."""

    __slots__ = ("functions", "tree")

    def __init__(self, tree: Tree, functions: TreeFunctions) -> None:
        self.tree, self.functions = tree, functions

    def __add__(self, other: TreeNumber | int) -> TreeNumber:
        return self.functions.node("+", self, other)

    def __radd__(self, other: int) -> TreeNumber:
        return self.functions.node("+", other, self)

    def __sub__(self, other: TreeNumber | int) -> TreeNumber:
        return self.functions.node("-", self, other)

    def __rsub__(self, other: int) -> TreeNumber:
        return self.functions.node("-", other, self)

    def __mul__(self, other: TreeNumber | int) -> TreeNumber:
        return self.functions.node("*", self, other)

    def __rmul__(self, other: int) -> TreeNumber:
        return self.functions.node("*", other, self)

    def __truediv__(self, other: TreeNumber | int) -> TreeNumber:
        return self.functions.node("/", self, other)

    def __rtruediv__(self, other: int) -> TreeNumber:
        return self.functions.node("/", other, self)

    def __pow__(self, other: int) -> TreeNumber:
        return self.functions.node("**", self, other)

    def __neg__(self) -> TreeNumber:
        return self.functions.node("neg", self)


class TreeFunctions:
    """A namespace whose attributes are functions on trees.

    Parameters
    ----------
    make : callable (kind, *trees) -> Tree
        An operation, or a function of the grammar, of trees.
    """

    def __init__(self, make: Callable[..., Tree]) -> None:
        self._make = make

    def node(self, kind: str, *operands: TreeNumber | int) -> TreeNumber:
        """An operation or a function. Operations on numbers alone are not evaluated, so that they can be computed with
        any number of digits."""
        trees = [x.tree if isinstance(x, TreeNumber) else ("number", x) for x in operands]
        are_numbers = kind in TABLE and all(t[0] == "number" for t in trees)
        return TreeNumber(("call", kind, *trees) if are_numbers else self._make(kind, *trees), self)

    def __getattr__(self, name: str) -> Callable[..., TreeNumber]:
        return partial(self.node, name)


def _written(kind: str, *trees: Tree) -> Tree:
    return ("call", kind, *trees) if kind in TABLE else (kind, *trees)


WRITTEN: Final = TreeFunctions(_written)
"""A namespace that builds trees without simplification."""


def tree_of(formula: Slope, arguments: Sequence[Tree], functions: TreeFunctions = WRITTEN) -> Tree:
    """The tree of a switching function of the arguments, or of a derivative as a function of the value and the arguments."""
    found: Any = formula(functions, *(TreeNumber(a, functions) for a in arguments))
    return found.tree if isinstance(found, TreeNumber) else ("number", found)
