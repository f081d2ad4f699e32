"""The number types of the reference engines, and the linear algebra that works with all of them.

``float64`` arrays are ordinary NumPy arrays. ``mpmath`` arrays have dtype object and hold `mpmath.mpf`; their precision
is the caller's ``mpmath.mp.dps`` at the time of the call. ``decimal`` arrays hold `decimal.Decimal`, which is written
in C and takes a fifth of the time. The precision of ``decimal`` arrays is that of the caller's decimal context, and
elementary functions come from mpmath. All three kinds of arrays multiply with ``@``, so the engines are written once.
"""

from __future__ import annotations

import decimal
import math
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any

import mpmath
import numpy as np

from ..elementary import ON_ARRAYS, TABLE
from ..model.expressions import Expression

Array = np.ndarray[Any, Any]


NUMBERS = ("float64", "mpmath", "decimal")

GUARD_BITS = 10
"""Number of additional bits with which mpmath computes functions of decimal numbers."""


class SingularMatrixError(ArithmeticError):
    """Raised for a mass matrix, or a block of one, that cannot be inverted."""


class Arithmetic:
    """Conversion, constants and functions of one number type.

    Parameters
    ----------
    numbers : {"float64", "mpmath", "decimal"}

    Attributes
    ----------
    symbolic : bool
        Whether numbers may contain symbols, whose values are not known; see `codegen.symbolic`.
    """

    symbolic = False

    def __init__(self, numbers: str = "float64") -> None:
        if numbers not in NUMBERS:
            raise ValueError(f"numbers: {numbers!r} is not known; allowed are {', '.join(map(repr, NUMBERS))}")
        self.numbers = numbers
        self.extended = numbers != "float64"
        self.dtype: Any = object if self.extended else np.float64
        self.functions = Functions(self)

    def number(self, x: Any) -> Any:
        """One number with exactly the value of ``x`` (an int, a float or an mpmath number), if the type can represent it."""
        if not self.extended:
            return np.float64(x)
        if self.numbers == "decimal":
            return _decimal(x)
        if hasattr(x, "_mpf_"):  # numbers of other mpmath contexts also have this attribute
            return mpmath.mp.make_mpf(x._mpf_)
        return mpmath.mpf(int(x)) if isinstance(x, (int, np.integer)) else mpmath.mpf(float(x))

    def array(self, x: Any) -> Array:
        """An array of numbers of this type with the shape of ``x``."""
        if not self.extended:
            return np.array(x, dtype=np.float64)
        source = np.asarray(x, dtype=object)
        result = np.empty(source.shape, dtype=object)
        for index in np.ndindex(source.shape):
            result[index] = self.number(source[index])
        return result

    def zeros(self, *shape: int) -> Array:
        return self.array(np.zeros(shape, dtype=int))

    def eye(self, n: int) -> Array:
        return self.array(np.eye(n, dtype=int))

    @property
    def epsilon(self) -> Any:
        """Spacing of the numbers at one."""
        if self.numbers == "decimal":
            return Decimal(10) ** (1 - decimal.getcontext().prec)
        return mpmath.mp.eps if self.extended else np.finfo(np.float64).eps

    def function(self, name: str) -> Callable[..., Any]:
        """The elementary function with the given name, of single numbers."""
        if self.numbers == "decimal":
            return _DECIMAL.get(name) or _by_mpmath(name)
        if self.extended:
            return _of_mpmath(name)
        found: Callable[..., Any] = getattr(np if name == "floor" else ON_ARRAYS, name)
        return found

    def power(self, x: Any, y: Any) -> Any:
        """x**y for numbers; NaN if there is no real value."""
        return _real(x**y)

    def is_nan(self, x: Any) -> bool:
        """Whether a number is not a number."""
        return bool(mpmath.isnan(x))

    def held(self, x: Array) -> Array:
        """The same numbers as constants; overridden by `DualArithmetic`, whose numbers have derivatives."""
        return x

    def value_of(self, expression: Expression, values: Mapping[str, Any]) -> Any:
        """Value of a model's expression without derivatives; `codegen.symbolic` overrides it, and `Pairs` evaluates numbers."""
        raise NotImplementedError(f"arithmetic {self.numbers} cannot evaluate expressions; use a subclass, or Pairs")

    def where_zero(self, x: Any, value: Any, otherwise: Any) -> Any:
        """`value` where x is zero, otherwise `otherwise`; overridden by `codegen.symbolic`, and by `Pairs` for
        numbers."""
        raise NotImplementedError(f"arithmetic {self.numbers} cannot compare numbers; use a subclass, or Pairs")

    def where_negative(self, x: Any, value: Any, otherwise: Any) -> Any:
        """`value` where x is negative, else `otherwise`; as `where_zero`."""
        raise NotImplementedError(f"arithmetic {self.numbers} cannot compare numbers; use a subclass, or Pairs")

    def of_largest(self, numbers: Sequence[Any], values: Sequence[Any]) -> Any:
        """The value with the index of the first of the largest numbers; overridden like `where_zero`."""
        raise NotImplementedError(f"arithmetic {self.numbers} cannot compare numbers; use a subclass, or Pairs")

    def ldl(self, A: Array, scale: Sequence[Any] | None = None) -> tuple[Array, Array]:
        """Factor a small symmetric positive definite A = L diag(d) L^T.

        Parameters
        ----------
        A : (n, n)
        scale : sequence of n numbers, optional
            Size of the terms from which each diagonal entry was computed, where they are larger than the entry.

        Returns
        -------
        L : (n, n)
            Unit lower triangular.
        d : (n,)

        Raises
        ------
        SingularMatrixError
            If a pivot is not positive beyond the rounding of these terms.
        """
        n = len(A)
        L, d = self.eye(n), self.zeros(n)
        for j in range(n):
            d[j] = A[j, j] - sum(L[j, i] * L[j, i] * d[i] for i in range(j))
            if not d[j] > 64 * self.epsilon * (A[j, j] if scale is None else scale[j]):
                raise SingularMatrixError(f"pivot {j + 1} of {n} is {d[j]}")
            for r in range(j + 1, n):
                L[r, j] = (A[r, j] - sum(L[r, i] * L[j, i] * d[i] for i in range(j))) / d[j]
        return L, d

    def inverse(self, A: Array, scale: Sequence[Any] | None = None) -> Array:
        """The inverse of a small symmetric positive definite matrix, (n, n), by `ldl` with its ``scale``."""
        n = len(A)
        L, d = self.ldl(A, scale)
        X = self.eye(n)
        for i in range(n):  # solves L Y = U
            for j in range(i):
                X[i] = X[i] - L[i, j] * X[j]
        for i in range(n):  # solves D Z = Y
            X[i] = X[i] / d[i]
        for i in reversed(range(n)):  # solves L^T X = Z
            for j in range(i + 1, n):
                X[i] = X[i] - L[j, i] * X[j]
        return X

    def solve(self, A: Array, B: Array) -> Array:
        """Solve A X = B by elimination with partial pivoting.

        Parameters
        ----------
        A : (n, n)
            Any regular matrix, for example an indefinite one of closed loops.
        B : (n, m)

        Returns
        -------
        (n, m)

        Raises
        ------
        SingularMatrixError
        """
        n = len(A)
        if n == 0:
            return B
        if not self.extended:
            try:
                return np.linalg.solve(A, B)
            except np.linalg.LinAlgError as error:
                raise SingularMatrixError(str(error)) from None
        A, B = A.copy(), B.copy()
        for j in range(n):
            pivot = max(range(j, n), key=lambda i: abs(A[i, j]))
            if A[pivot, j] == 0:
                raise SingularMatrixError(f"no pivot in column {j + 1} of {n}")
            A[[j, pivot]], B[[j, pivot]] = A[[pivot, j]], B[[pivot, j]]
            for i in range(j + 1, n):
                factor = A[i, j] / A[j, j]
                A[i, j:] = A[i, j:] - factor * A[j, j:]
                B[i] = B[i] - factor * B[j]
        for j in reversed(range(n)):
            B[j] = (B[j] - A[j, j + 1 :] @ B[j + 1 :]) / A[j, j]
        return B

    def independent_rows(self, A: Array) -> tuple[Array, int]:
        """Independent rows of A that span all other rows, by elimination with complete pivoting.

        Parameters
        ----------
        A : (m, n)

        Returns
        -------
        rows : (rank,)
            Indices of the rows, the best pivot first.
        rank : int
            Numerical rank: the remaining entries are rounding errors.
        """
        A, (m, n), rows = A.copy(), A.shape, []
        tolerance = 8 * max(m, n) * self.epsilon * np.abs(A).max(initial=0)
        for _ in range(min(m, n)):
            i, j = np.unravel_index(int(np.argmax(np.abs(A))), A.shape)
            if not abs(A[i, j]) > tolerance:
                break
            rows.append(int(i))
            A = A - np.outer(A[:, j] / A[i, j], A[i])
            A[rows] = 0 * A[rows]
        return np.array(rows, dtype=int), len(rows)


def _decimal(x: Any) -> Decimal:
    """A decimal number: exact from an int or a float, rounded from an mpmath number."""
    if isinstance(x, Decimal):
        return x
    if not hasattr(x, "_mpf_"):
        return Decimal(int(x) if isinstance(x, (int, np.integer)) else float(x))
    sign, mantissa, exponent, _ = x._mpf_
    if not mantissa:
        return Decimal(float(x))  # x is zero, NaN or infinite
    return (-1) ** sign * Decimal(int(mantissa)) * Decimal(2) ** exponent


_DECIMAL: dict[str, Callable[..., Any]] = {
    "floor": lambda x: x.to_integral_value(decimal.ROUND_FLOOR), "abs": abs, "sqrt": Decimal.sqrt,
    "exp": Decimal.exp, "log": Decimal.ln, "sign": lambda x: Decimal((x > 0) - (x < 0)),
}  # fmt: skip
"""Functions of decimal numbers that do not need mpmath."""


def _of_mpmath(name: str) -> Callable[..., Any]:
    complex_ = getattr(mpmath, TABLE[name].spelled("mpmath") if name in TABLE else name)
    return lambda *x: _real(complex_(*x))


def _real(x: Any) -> Any:
    """An mpmath result as a decimal; NaN if it is not real, as in double precision."""
    return mpmath.nan if isinstance(x, mpmath.mpc) else x


def _by_mpmath(name: str) -> Callable[..., Decimal]:
    """A function of decimal numbers, computed by mpmath with the same number of digits."""

    def of(*x: Decimal) -> Decimal:
        with mpmath.workprec(math.ceil(decimal.getcontext().prec * math.log2(10)) + GUARD_BITS):
            return _decimal(_of_mpmath(name)(*x))

    return of


class Functions:
    """The elementary functions of one number type as attributes, for the formulas of `codegen.elementary`."""

    def __init__(self, arithmetic: Arithmetic) -> None:
        self._arithmetic = arithmetic

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return self._arithmetic.function(name)


class LeftInverse:
    """Left inverse E^+ of a tall matrix by Gram-Schmidt orthogonalisation, the longest column first, each orthogonalised twice.

    Parameters
    ----------
    arithmetic : Arithmetic
    E : (m, n)

    Attributes
    ----------
    Q : (m, n)
        Orthonormal columns that span those of E.

    Raises
    ------
    SingularMatrixError
        If the columns are linearly dependent within rounding.
    """

    def __init__(self, arithmetic: Arithmetic, E: Array) -> None:
        m, n = E.shape
        self._zeros = arithmetic.zeros
        self._order = list(range(n))
        self.Q, self._R = arithmetic.zeros(m, n), arithmetic.zeros(n, n)
        Q, R, order, left, root = self.Q, self._R, self._order, E.copy(), arithmetic.function("sqrt")
        tolerance = 8 * max(m, n) * arithmetic.epsilon
        longest = 0
        for j in range(n):
            squares = (left[:, j:] * left[:, j:]).sum(axis=0)
            pivot = j + max(range(n - j), key=lambda i: squares[i])
            for rows in (left.T, R.T):
                rows[[j, pivot]] = rows[[pivot, j]]
            order[j], order[pivot] = order[pivot], order[j]
            a = left[:, j]
            again = Q[:, :j].T @ a  # components along earlier columns that rounding has left
            a, R[:j, j] = a - Q[:, :j] @ again, R[:j, j] + again
            R[j, j] = root(a @ a)
            longest = max(longest, R[j, j])
            if not R[j, j] > tolerance * longest:
                raise SingularMatrixError(f"rank {j} of {n}")
            Q[:, j] = a / R[j, j]
            R[j, j + 1 :] = Q[:, j] @ left[:, j + 1 :]
            left[:, j + 1 :] = left[:, j + 1 :] - np.outer(Q[:, j], R[j, j + 1 :])

    def __call__(self, b: Array) -> Array:
        """E^+ b for b (..., m, c), (..., n, c)."""
        y = self.Q.T @ b
        n = len(self._order)
        x = self._zeros(*b.shape[:-2], n, b.shape[-1])
        for j in reversed(range(n)):
            rest = y[..., j, :]
            for i in range(j + 1, n):
                rest = rest - self._R[j, i] * x[..., self._order[i], :]
            x[..., self._order[j], :] = rest / self._R[j, j]
        return x
