"""A solver in more digits: the statements of a package's NumPy module on decimal numbers, for results as mpmath's.

The module works element by element, so that arrays of objects go through it. What it computes with are the numbers of
Python's ``decimal``, which are written in C; mpmath makes sines and the like, and is what a user sees.
"""

from __future__ import annotations

import decimal
import functools
import importlib.abc
import importlib.machinery
import importlib.util
import io
import math
import threading
import tokenize
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from ....elementary import ELEMENTWISE, TABLE, Elementary
from ..arrays import Array
from ..assembly.states import States
from ..calls.arguments import Arguments
from ..calls.functions import Function
from ..calls.numpy_target import NumpyTarget
from ..calls.package import Package
from ..calls.targets import Opened
from ..files.manifest import check_files

GUARD = 10
"""Decimal digits beyond those that are asked for."""

FEWEST, MOST = 16, 10_000
"""Digits that may be asked for."""

REFUSED = ("simulate", "judge", "equilibrium", "linearize", "diagnose")
"""Members that compute in double precision only."""


PartitionModules = Callable[[int], str]
"""Gives the NumPy module of a partition, with its numbers in more digits."""


class Digits:
    """Decimal numbers of some digits, and what they are to mpmath and to NumPy's functions.

    Parameters
    ----------
    digits : int
        Of results; what is computed with has `GUARD` more.
    """

    def __init__(self, digits: int):
        try:
            import mpmath
        except ModuleNotFoundError:
            raise ImportError("in_precision needs mpmath, which is not installed: pip install mpmath") from None
        self.digits = digits
        self.mp = mpmath.mp.clone()
        self.mp.dps = digits
        self._libmp = mpmath.libmp
        self._bits = int((digits + GUARD) * math.log2(10)) + 10
        # what has no value is nan or infinite, as in floating-point numbers
        self.context = decimal.Context(
            prec=digits + GUARD,
            rounding=decimal.ROUND_HALF_EVEN,
            Emin=decimal.MIN_EMIN,
            Emax=decimal.MAX_EMAX,
            traps=[],
        )
        self._reading = self.context.copy()
        self._reading.traps[decimal.InvalidOperation] = True
        self.to_decimals = np.frompyfunc(self.decimal, 1, 1)
        self.to_mpf = np.frompyfunc(self.mpf, 1, 1)
        self.to_mp = np.frompyfunc(self.of_decimal, 1, 1)

    def mpf(self, x: Any) -> Any:
        """Any number, or its decimal text, as one of mpmath's; floats are exactly what they are.

        Raises
        ------
        TypeError, ValueError
        """
        if isinstance(x, Decimal):
            return self.of_decimal(x)
        if isinstance(x, str):
            try:
                return self.of_decimal(self._reading.create_decimal(x))
            except decimal.InvalidOperation:
                raise ValueError(f"{x!r} is no number") from None
        if hasattr(x, "_mpf_"):
            return self.mp.make_mpf(x._mpf_)
        return self.mp.mpf(int(x) if isinstance(x, (int, np.integer)) else float(x))

    def decimal(self, x: Any) -> Decimal:
        """One of mpmath's numbers, or a float, as a decimal one."""
        if not hasattr(x, "_mpf_"):
            return Decimal(float(x))
        sign, mantissa, exponent, _ = x._mpf_
        if not mantissa and exponent:
            return Decimal(float(x))
        n = -int(mantissa) if sign else int(mantissa)
        return Decimal(n << exponent) + 0 if exponent >= 0 else Decimal(n) / (1 << -exponent)

    def of_decimal(self, x: Any) -> Any:
        """A decimal number as one of mpmath's, rounded to `digits`."""
        return self.mp.make_mpf(self._raw(x, self.mp.prec))

    def _raw(self, x: Any, bits: int) -> Any:
        """What mpmath's functions work on."""
        if isinstance(x, int):
            return self._libmp.from_int(x, bits, "n")
        if not x.is_finite():
            return self._libmp.from_float(float(x))
        return self._libmp.from_str(str(x), bits, "n")

    def as_mpf(self, x: Any) -> Array:
        """An array of any numbers as one of mpmath's."""
        return np.asarray(self.to_mpf(x), object)

    def function(self, e: Elementary) -> Callable[..., Any]:
        """An elementary function as mpmath computes it, on arrays of decimal numbers; nan where it has no real value."""
        f = getattr(self._libmp, f"mpf_{e.spelled('mpmath')}")

        def of(*given: Any) -> Decimal:
            if not all(isinstance(x, int) or x.is_finite() for x in given):
                return Decimal("nan")
            try:
                return self.decimal(self.mp.make_mpf(f(*(self._raw(x, self._bits) for x in given), self._bits, "n")))
            except (self._libmp.ComplexResult, ValueError, ZeroDivisionError):
                return Decimal("nan")

        return np.frompyfunc(of, e.arity, 1)


def _power(a: Any, b: Any) -> Any:
    return Decimal(1) if b == 0 else a**b


class Functions:
    """Stands for NumPy in a module that works on decimal numbers: what makes arrays makes them of objects."""

    def __init__(self, numbers: Digits):
        for e in TABLE.values():
            if e.rounds:
                setattr(self, e.spelled("numpy") or e.name, numbers.function(e))
        self.sqrt = np.frompyfunc(lambda x: Decimal(x).sqrt(), 1, 1)
        self.exp = np.frompyfunc(lambda x: Decimal(x).exp(), 1, 1)
        self.log = np.frompyfunc(lambda x: Decimal(x).ln(), 1, 1)
        self.power = np.frompyfunc(_power, 2, 1)
        self.floor = np.frompyfunc(lambda x: Decimal(x).to_integral_value(decimal.ROUND_FLOOR), 1, 1)
        self.float64 = Decimal

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    @staticmethod
    def asarray(x: Any, dtype: Any = None) -> Any:
        return np.asarray(x)

    @staticmethod
    def zeros(shape: Any) -> Any:
        return np.full(shape, Decimal(0), object)

    @staticmethod
    def empty(shape: Any) -> Any:
        return np.empty(shape, object)

    @staticmethod
    def where(condition: Any, a: Any, b: Any) -> Any:
        return np.where(condition, a, b)[()]


class Text(importlib.abc.InspectLoader):
    """Loads a module of decimal numbers from the text of one of floats.

    Every number that stands in it with a point or an exponent becomes a decimal one: exactly the float where it is what Python
    writes for one, else of all the digits that it is written with.
    """

    def __init__(self, text: str, numbers: Digits):
        self.numbers = numbers
        self.known: dict[str, str] = {}
        tokens = []
        for kind, word, *_ in tokenize.generate_tokens(io.StringIO(text).readline):
            if kind == tokenize.NUMBER and not word.isdigit():
                kind, word = tokenize.NAME, self.known.setdefault(word, f"number_{len(self.known)}_")
            tokens.append((kind, word))
        self.text = tokenize.untokenize(tokens).replace("import numpy as np", "", 1)

    def get_source(self, fullname: str) -> str:
        return self.text

    def module(self, name: str) -> Any:
        """The module, loaded."""
        module = importlib.util.module_from_spec(importlib.machinery.ModuleSpec(name, self))
        functions = module.__dict__["np"] = Functions(self.numbers)
        with decimal.localcontext(self.numbers.context):
            for word, name in self.known.items():
                value = float(word)
                module.__dict__[name] = Decimal(value) if repr(value) == word else Decimal(word)
            self.exec_module(module)
        vars(module).update((name, getattr(functions, name)) for name in ELEMENTWISE)
        return module


class ExtendedTarget(NumpyTarget):
    """The NumPy module of a package on decimal numbers; takes mpmath's numbers, and floats, and gives mpmath's."""

    name = "mpmath"

    def __init__(self, opened: Opened, numbers: Digits, text: str):
        self.numbers, self.text = numbers, text
        super().__init__(opened.folder, opened.manifest)
        self.dtype = np.dtype(object)

    def _load(self, name: str, file: Any) -> Any:
        return Text(self.text, self.numbers).module(name)

    def _call(self, f: Function, arguments: list[Any]) -> list[Any]:
        with decimal.localcontext(self.numbers.context):
            found = self._results(f, [self.numbers.to_decimals(x) for x in arguments])
            with np.errstate(invalid="ignore"):  # what is not finite is reported with the results
                return [np.asarray(self.numbers.to_mp(x), object) for x in found]


class ExtendedArguments(Arguments):
    """Arguments as arrays of mpmath's numbers; see `Arguments`."""

    dtype = np.dtype(object)

    def __init__(self, plain: Arguments, numbers: Digits):
        self.__dict__.update(plain.__dict__)
        self.numbers, self.kind = numbers, numbers.mpf
        finite = np.frompyfunc(numbers.mp.isfinite, 1, 1)
        self.finite = lambda x: np.asarray(finite(x), bool)
        self.is_finite = lambda x: bool(self.finite(x).all())

    def _numbers(self, name: str, value: Any) -> Array:
        try:
            with np.errstate(invalid="ignore"):  # what is not finite is reported with the results
                return self.numbers.as_mpf(np.asarray(value, object))
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{name}: {error}; expected an array of real numbers") from None

    def _check_quaternions(self, q: Array) -> None:
        super()._check_quaternions(q.astype(float))


class Extended(Package):
    """A solver in more digits than double precision has: the same functions by the same statements; see `Solver.in_precision`.

    Attributes
    ----------
    digits : int
    mp : mpmath context
        Of these digits: its functions, such as ``exact.mp.sin``, keep them.
    """

    def __init__(self, solver: Any, digits: int, texts: PartitionModules | None):
        self.__dict__.update((n, x) for n, x in solver.__dict__.items() if not _is_room(type(solver), n))
        self._solver, self._texts = solver, texts
        self._made, self._making = {}, threading.Lock()
        self._digits = Digits(digits)
        self.digits, self.mp = digits, self._digits.mp
        self._arguments = ExtendedArguments(solver._arguments, self._digits)
        self._use(self._open(solver._opened.number))
        self._states: States = States(self, solver._states._equilibrium)
        if self.closure_names:
            from .exact_loops import ExactLoops

            self._states = ExactLoops(self, solver)

    def _open(self, partition: int) -> Opened:
        with self._making:
            if partition not in self._made:
                opened = self._solver._open(partition)
                check_files(opened.folder, opened.package, ("_numpy.py",))
                file = opened.folder / f"{opened.manifest['name']}_numpy.py"
                text = self._texts(partition) if self._texts else file.read_text(encoding="utf-8")
                self._made[partition] = replace(opened, target=ExtendedTarget(opened, self._digits, text))
            return self._made[partition]

    def _is_used(self) -> None:
        super()._is_used()
        self._watched = False  # in double precision there is a warning of directions that have no derivative

    def __reduce__(self) -> Any:
        return extended, (self._solver, self.digits, self._texts)

    def __repr__(self) -> str:
        return f"<{self._solver!r} in {self.digits} digits>"


def _refuse(exact: Extended) -> Any:
    raise AttributeError(f"{', '.join(REFUSED)} compute in double precision; they are not to be had in more digits")


def extended(solver: Any, digits: int, texts: PartitionModules | None = None) -> Any:
    """A solver in more digits; `texts` gives the NumPy module of each partition where it is not the package's own."""
    solver = getattr(solver, "_solver", solver)
    if isinstance(digits, bool) or not isinstance(digits, (int, np.integer)) or not FEWEST <= digits <= MOST:
        raise ValueError(f"digits is {digits!r}, expected a whole number from {FEWEST} to {MOST}; doubles have 16")
    kind: Any = type(solver)
    return _in_front_of(kind)(solver, int(digits), texts)


def _is_room(kind: type, name: str) -> bool:
    """Whether a member is a room of its solver, which works on that one."""
    return isinstance(getattr(kind, name, None), functools.cached_property)


@functools.cache
def _in_front_of(kind: Any) -> Any:
    """`Extended` with the methods of a class of solvers."""
    return type(
        "Extended", (Extended, kind), {"__doc__": Extended.__doc__, **dict.fromkeys(REFUSED, property(_refuse))}
    )
