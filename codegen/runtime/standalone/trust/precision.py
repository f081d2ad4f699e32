"""A solver in extended precision: the statements of a package's NumPy module on decimal numbers, with mpmath results.

The module works element by element, so it accepts arrays of objects. Arithmetic uses Python's ``decimal`` numbers,
which are implemented in C. Elementary functions use mpmath; arguments and results of the solver are mpmath numbers.
"""

from __future__ import annotations

import decimal
import functools
import importlib.abc
import importlib.machinery
import importlib.util
import math
import re
import threading
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
"""Additional decimal digits in intermediate results."""

FEWEST, MOST = 16, 10_000
"""Smallest and largest number of digits."""

REFUSED = ("simulate", "judge", "equilibrium", "linearize", "ode", "diagnose")
"""Methods that compute in double precision only."""


PartitionModules = Callable[[int], str]
"""A function that returns the NumPy module of a partition, with constants in more digits."""


class Digits:
    """Decimal numbers with a given number of digits, and conversions to and from mpmath and NumPy.

    Parameters
    ----------
    digits : int
        Digits of results; intermediate results have `GUARD` more.
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
        # undefined results are nan or infinite, as in floating-point arithmetic
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
        """Converts any number, or its decimal text, to an mpmath number; floats are converted exactly.

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
                raise ValueError(f"{x!r} is not a number") from None
        if hasattr(x, "_mpf_"):
            return self.mp.make_mpf(x._mpf_)
        return self.mp.mpf(int(x) if isinstance(x, (int, np.integer)) else float(x))

    def decimal(self, x: Any) -> Decimal:
        """Converts an mpmath number or a float to a decimal number."""
        if not hasattr(x, "_mpf_"):
            return Decimal(float(x))
        sign, mantissa, exponent, _ = x._mpf_
        if not mantissa and exponent:
            return Decimal(float(x))
        n = -int(mantissa) if sign else int(mantissa)
        return Decimal(n << exponent) + 0 if exponent >= 0 else Decimal(n) / (1 << -exponent)

    def of_decimal(self, x: Any) -> Any:
        """Converts a decimal number to an mpmath number, rounded to `digits`."""
        return self.mp.make_mpf(self._raw(x, self.mp.prec))

    def _raw(self, x: Any, bits: int) -> Any:
        """Converts a number to mpmath's internal representation."""
        if isinstance(x, int):
            return self._libmp.from_int(x, bits, "n")
        if not x.is_finite():
            return self._libmp.from_float(float(x))
        return self._libmp.from_str(str(x), bits, "n")

    def as_mpf(self, x: Any) -> Array:
        """An array of mpmath numbers from any numbers."""
        return np.asarray(self.to_mpf(x), object)

    def function(self, e: Elementary) -> Callable[..., Any]:
        """An elementary function computed by mpmath on arrays of decimal numbers; nan where it has no real value."""
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
    """Replacement of NumPy in a module on decimal numbers; new arrays contain objects."""

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


# The tokens of Python that contain floats: strings and comments, where they stay, and the floats themselves.
STRINGS_AND_FLOATS = re.compile(
    r'"""[\s\S]*?"""|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'|#.*'
    r"|(?<![\w.])(?P<number>(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)"
)


class Text(importlib.abc.InspectLoader):
    """Loads a module of decimal numbers from the text of a module of floats.

    Every number with a point or an exponent becomes a decimal number. It is exactly the float if the text is Python's own
    notation of that float; otherwise it has all the digits of the text.
    """

    def __init__(self, text: str, numbers: Digits):
        self.numbers = numbers
        self.known: dict[str, str] = {}

        def named(found: re.Match[str]) -> str:
            word = found["number"]
            return self.known.setdefault(word, f"number_{len(self.known)}_") if word else found[0]

        self.text = STRINGS_AND_FLOATS.sub(named, text).replace("import numpy as np", "", 1)

    def get_source(self, fullname: str) -> str:
        return self.text

    def module(self, name: str) -> Any:
        """The module, with decimal numbers in place of floats."""
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
    """The NumPy module of a package on decimal numbers. It takes mpmath numbers and floats, and returns mpmath
    numbers."""

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
            with np.errstate(invalid="ignore"):  # the solver warns of results that are not finite
                return [np.asarray(self.numbers.to_mp(x), object) for x in found]


class ExtendedArguments(Arguments):
    """Arguments as arrays of mpmath numbers; see `Arguments`."""

    dtype = np.dtype(object)

    def __init__(self, plain: Arguments, numbers: Digits):
        self.__dict__.update(plain.__dict__)
        self.numbers, self.kind = numbers, numbers.mpf
        finite = np.frompyfunc(numbers.mp.isfinite, 1, 1)
        self.finite = lambda x: np.asarray(finite(x), bool)
        self.is_finite = lambda x: bool(self.finite(x).all())

    def _numbers(self, name: str, value: Any) -> Array:
        try:
            with np.errstate(invalid="ignore"):  # the test for finite numbers comes later
                return self.numbers.as_mpf(np.asarray(value, object))
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{name}: {error}; expected an array of real numbers") from None

    def _check_quaternions(self, q: Array) -> None:
        super()._check_quaternions(q.astype(float))


class Extended(Package):
    """A solver in extended precision, with the same functions and statements; see `Solver.in_precision`.

    Attributes
    ----------
    digits : int
    mp : mpmath context
        Context with these digits; its functions, such as ``exact.mp.sin``, have this precision.
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
        self._watched = False  # the solver in double precision warns of directions without a derivative

    def __reduce__(self) -> Any:
        return extended, (self._solver, self.digits, self._texts)

    def __repr__(self) -> str:
        return f"<{self._solver!r} in {self.digits} digits>"


def _refuse(exact: Extended) -> Any:
    raise AttributeError(
        f"{', '.join(REFUSED)} compute in double precision only; they are not available with more digits"
    )


def extended(solver: Any, digits: int, texts: PartitionModules | None = None) -> Any:
    """A solver in extended precision; `texts` returns the NumPy module of a partition if the package's own does not
    suffice."""
    solver = getattr(solver, "_solver", solver)
    if isinstance(digits, bool) or not isinstance(digits, (int, np.integer)) or not FEWEST <= digits <= MOST:
        raise ValueError(f"digits is {digits!r}, expected an integer from {FEWEST} to {MOST}; doubles have 16")
    kind: Any = type(solver)
    return _in_front_of(kind)(solver, int(digits), texts)


def _is_room(kind: type, name: str) -> bool:
    """Whether an attribute is a cached part of the solver, which must not be shared."""
    return isinstance(getattr(kind, name, None), functools.cached_property)


@functools.cache
def _in_front_of(kind: Any) -> Any:
    """`Extended` combined with the methods of a solver class."""
    return type(
        "Extended", (Extended, kind), {"__doc__": Extended.__doc__, **dict.fromkeys(REFUSED, property(_refuse))}
    )
