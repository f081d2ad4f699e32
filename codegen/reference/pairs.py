"""Forward pairs: a value with its derivatives along k directions, for expressions and joint geometry.

A pair's value is a number or a matrix; its tangent has the k directions as first axis, followed by the value's shape. This is Eq.
10 applied to each operation: the derivative of a result along direction j is the sum, over the operands, of partial derivative
times operand derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..elementary import TABLE
from ..model.expressions import Expression
from ..model.grammar import FUNCTIONS, OF_TREES, Tree
from ..model.slopes import is_singular, leaves, slope
from .arithmetic import Arithmetic, Array


class Pair:
    """A number or a matrix, and its derivatives along k directions.

    Attributes
    ----------
    value : number or (r, c) array
    tangent : (k,) or (k, r, c) array
    """

    __slots__ = ("tangent", "value")

    def __init__(self, value: Any, tangent: Array) -> None:
        self.value = value
        self.tangent = tangent

    def __add__(self, other: Pair) -> Pair:
        return Pair(self.value + other.value, self.tangent + other.tangent)

    def __sub__(self, other: Pair) -> Pair:
        return Pair(self.value - other.value, self.tangent - other.tangent)

    def __neg__(self) -> Pair:
        return Pair(-self.value, -self.tangent)

    def __mul__(self, other: Pair) -> Pair:
        """Product of numbers, number times matrix, or matrix times number."""
        da = self.tangent[:, None, None] if np.ndim(other.value) > np.ndim(self.value) else self.tangent
        db = other.tangent[:, None, None] if np.ndim(self.value) > np.ndim(other.value) else other.tangent
        return Pair(self.value * other.value, da * other.value + self.value * db)

    def __truediv__(self, other: Pair) -> Pair:
        """Quotient of two numbers."""
        value = self.value / other.value
        return Pair(value, (self.tangent - value * other.tangent) / other.value)

    def __pow__(self, exponent: int) -> Pair:
        """Power of a number; the exponents 0 and 1 avoid 0**-1 for a base of zero."""
        if exponent == 0:
            return Pair(self.value**0, 0 * self.tangent)
        return Pair(self.value**exponent, exponent * self.value ** (exponent - 1) * self.tangent)

    def __bool__(self) -> bool:
        """Whether all numbers of the value are nonzero."""
        return bool(self.value)

    def __matmul__(self, other: Pair) -> Pair:
        return Pair(self.value @ other.value, self.tangent @ other.value + self.value @ other.tangent)

    def __getitem__(self, index: Any) -> Pair:
        index = index if isinstance(index, tuple) else (index,)
        return Pair(self.value[index], self.tangent[(slice(None), *index)])

    def __setitem__(self, index: Any, part: Pair) -> None:
        index = index if isinstance(index, tuple) else (index,)
        self.value[index], self.tangent[(slice(None), *index)] = part.value, part.tangent

    @property
    def mT(self) -> Pair:
        """The transpose of a matrix."""
        return Pair(self.value.mT, self.tangent.mT)


def skew(v: Array) -> Array:
    """The matrix of the cross product, v x: (..., 3, 1) to (..., 3, 3)."""
    result = 0 * (v + v.mT)  # zeros of the number type of v
    x, y, z = v[..., 0, 0], v[..., 1, 0], v[..., 2, 0]
    result[..., 0, 1], result[..., 0, 2] = -z, y
    result[..., 1, 0], result[..., 1, 2] = z, -x
    result[..., 2, 0], result[..., 2, 1] = -y, x
    return result


class Pairs:
    """Creates pairs: numbers, matrices, elementary functions and expressions, all with k directions.

    Parameters
    ----------
    arithmetic : Arithmetic
    k : int
        Number of directions; 0 without derivatives.
    environment : mapping of str to Pair
        Parameters, inputs, ``t``, ``q.NAME`` and ``u.NAME``.
    """

    def __init__(self, arithmetic: Arithmetic, k: int, environment: Mapping[str, Pair]) -> None:
        self.arithmetic = arithmetic
        self.k = k
        self.environment = environment
        self._zero = arithmetic.zeros(k)
        # Bodies of a repeat share their Expression objects. Each is evaluated once per call, and kept so that its id
        # is not reused.
        self._known: dict[int, tuple[Expression, Pair]] = {}
        self._functions: dict[str, Callable[..., Pair]] = {"number": self.number, "**": self.power}
        self._functions |= {name: partial(self.call, name) for name in (*FUNCTIONS, *OF_TREES)}

    # --- numbers and matrices -------------------------------------------------------------------------------------

    def number(self, x: Any) -> Pair:
        """A number with zero derivatives."""
        return Pair(self.arithmetic.number(x), self._zero)

    def constant(self, x: Any) -> Pair:
        """A matrix with zero derivatives, (r, c)."""
        value = self.arithmetic.array(x)
        return Pair(value, self.arithmetic.zeros(self.k, *value.shape))

    def zeros(self, *shape: int) -> Pair:
        """A matrix of zeros, (r, c)."""
        return self.constant(np.zeros(shape, dtype=int))

    def eye(self, n: int) -> Pair:
        """The identity matrix, (n, n)."""
        return self.constant(np.eye(n, dtype=int))

    def matrix(self, rows: Sequence[Sequence[Pair]]) -> Pair:
        """A matrix made of number pairs, (r, c)."""
        value = np.empty((len(rows), len(rows[0])), self.arithmetic.dtype)
        tangent = np.empty((self.k, *value.shape), self.arithmetic.dtype)
        for i, row in enumerate(rows):
            for j, x in enumerate(row):
                value[i, j], tangent[:, i, j] = x.value, x.tangent
        return Pair(value, tangent)

    def column(self, entries: Sequence[Pair]) -> Pair:
        """A column made of number pairs, (r, 1)."""
        return self.matrix([[x] for x in entries]) if entries else self.constant(np.zeros((0, 1), int))

    def block(self, rows: Sequence[Sequence[Pair]]) -> Pair:
        """A matrix made of blocks."""
        return Pair(np.block([[x.value for x in r] for r in rows]), np.block([[x.tangent for x in r] for r in rows]))

    def diagonal(self, column: Pair) -> Pair:
        """The diagonal matrix with the entries of a column, (r, r)."""
        unit = self.arithmetic.array(np.eye(len(column.value), dtype=int))
        return Pair(unit * column.value, unit * column.tangent)

    @staticmethod
    def skew(v: Pair) -> Pair:
        """The cross product matrix of a column, (3, 3)."""
        return Pair(skew(v.value), skew(v.tangent))

    def dot(self, a: Pair, b: Pair) -> Pair:
        """The scalar product of two columns, a number."""
        return (a.mT @ b)[0, 0]

    def unit(self, v: Pair) -> Pair:
        """The unit vector along a column."""
        return v * (self.number(1) / self.call("sqrt", self.dot(v, v)))

    # --- functions ------------------------------------------------------------------------------------------------

    def call(self, name: str, *arguments: Pair) -> Pair:
        """An elementary function of numbers, by its name in the expression grammar."""
        if name in ("min", "max"):
            result = arguments[0]
            for x in arguments[1:]:  # if numbers are equal, value and derivative are those of the first
                result = x if (x.value < result.value if name == "min" else x.value > result.value) else result
            return result
        if name == "at_least":
            return self.number(1 if arguments[0].value >= arguments[1].value else 0)
        if name in ("mod", "wrapped"):
            x, m = arguments
            return x - self.number(self.arithmetic.function("floor")(x.value / m.value)) * m
        of = [a.value for a in arguments]
        value, tangent = self.arithmetic.function(name)(*of), self._zero
        if self.k:  # a value at the edge of a function's domain must not fail because of an unneeded derivative
            for slope_, a in zip(TABLE[name].slopes, arguments, strict=True):
                tangent = tangent + slope_(self.arithmetic.functions, value, *of) * a.tangent
        return Pair(value, tangent)

    def where_zero(self, x: Pair, value: Callable[[], Pair], otherwise: Callable[[], Pair]) -> Pair:
        """`value()` if x is zero, else `otherwise()`; for symbols, a piecewise expression with both values."""
        if self.arithmetic.symbolic:
            return Pair(self.arithmetic.where_zero(x.value, value().value, otherwise().value), self._zero)
        return value() if x.value == 0 else otherwise()

    def where_negative(self, x: Pair, value: Callable[[], Pair], otherwise: Callable[[], Pair]) -> Pair:
        """`value()` if x is negative, else `otherwise()`; for symbols, a piecewise expression with both values."""
        if self.arithmetic.symbolic:
            return Pair(self.arithmetic.where_negative(x.value, value().value, otherwise().value), self._zero)
        return value() if x.value < 0 else otherwise()

    def of_largest(self, numbers: Sequence[Pair], value: Callable[[int], Pair]) -> Pair:
        """`value(i)` for the index i of the first of the largest numbers; for symbols, a piecewise expression."""
        if self.arithmetic.symbolic:
            values = [value(i).value for i in range(len(numbers))]
            return Pair(self.arithmetic.of_largest([x.value for x in numbers], values), self._zero)
        return value(max(range(len(numbers)), key=lambda i: numbers[i].value))

    def power(self, x: Pair, y: Pair) -> Pair:
        """x**y for numbers; an exponent without derivative needs no logarithm of the base."""
        power = self.arithmetic.power
        value = power(x.value, y.value)
        if not self.k:
            return Pair(value, self._zero)
        # The exponents 0, 1 and 2 avoid 0**-1 and similar for a base of zero.
        tangent = y.value * power(x.value, y.value - 1) * x.tangent if y.value != 0 else self._zero
        if np.any(y.tangent != 0):
            tangent = tangent + value * self.arithmetic.function("log")(x.value) * y.tangent
        return Pair(value, tangent)

    # --- expressions of the model ---------------------------------------------------------------------------------

    def expression(self, expression: Expression) -> Pair:
        """Value and derivatives of a model expression, a number."""
        key = id(expression)
        if key not in self._known:
            tree = expression.tree
            if self.arithmetic.symbolic:
                known = {name: self.environment[name].value for name in expression.names}
                found = self.number(self.arithmetic.value_of(expression, known))
            elif self.k and is_singular(tree):
                found = self._with_limits(tree)
            else:
                found = expression.evaluate(self.environment, self._functions)
            self._known[key] = expression, found
        return self._known[key][1]

    def _with_limits(self, tree: Tree) -> Pair:
        """The value of a tree whose derivatives may be infinite; such a derivative counts only along directions that
        change its operand."""
        tangent = self._zero
        for leaf in leaves(tree):
            along = self.environment[leaf[1]].tangent
            if any(along != 0):
                d = self._value(slope(tree, leaf))
                tangent = tangent + self.arithmetic.array([d * x if x != 0 else 0 for x in along])
        return Pair(self._value(tree), tangent)

    def _value(self, tree: Tree) -> Any:
        names = {leaf[1]: Pair(self.environment[leaf[1]].value, self.arithmetic.zeros(0)) for leaf in leaves(tree)}
        return Pairs(self.arithmetic, 0, names).expression(Expression(tree)).value

    def vector(self, expressions: Sequence[Expression]) -> Pair:
        """A column whose entries are model expressions."""
        return self.column([self.expression(e) for e in expressions])
