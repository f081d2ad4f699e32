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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from ....elementary import ELEMENTWISE, TABLE, Elementary
from ..arrays import Array, Numbers, Shape, Times, normalise
from ..calls.arguments import NO_SEEDS, Arguments, Seeds, placing
from ..calls.functions import Function
from ..calls.non_finite import tell_infinite
from ..calls.numpy_target import NumpyTarget, in_rows
from ..calls.package import Package, state
from ..calls.room import Room
from ..calls.targets import Opened
from ..files.manifest import check_files
from ..state.derivatives import JACOBIANS, Jacobians, asked_for, jacobians_of

GUARD = 10
"""Decimal digits beyond those that are asked for."""

FEWEST, MOST = 16, 10_000
"""Digits that may be asked for."""

NEWTON = 60
"""Steps of Newton's method from a state that is closed in double precision."""

LEFT = 5
"""Digits of the closure that may be missing where it can be no better."""

SAME = 1e-13
"""What closing a loop in double precision changes by less, against one, it does not change."""

NO_PLACES = "out: arrays of float64 cannot hold the results; leave it out, or use astype(float) on them"
"""What is said of ``out=``."""

REFUSED = ("simulate", "judge", "equilibrium", "linearize", "diagnose")
"""Members that compute in double precision only."""


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

    def _load(self, name: str, file: Any) -> Any:
        return Text(self.text, self.numbers).module(name)

    def _call(self, f: Function, arguments: list[Any], shapes: list[Shape], out: Sequence[Array]) -> list[Any]:
        with decimal.localcontext(self.numbers.context):
            found = self._results(f, [self.numbers.to_decimals(x) for x in arguments])
            with np.errstate(invalid="ignore"):  # what is not finite is reported with the results
                found = [np.asarray(self.numbers.to_mp(x), object) for x in found]
            return [
                np.broadcast_to(in_rows(x, alone), shape).copy()
                for x, alone, shape in zip(found, f.shapes, shapes, strict=True)
            ]


class ExtendedArguments(Arguments):
    """Arguments as arrays of mpmath's numbers; see `Arguments`."""

    dtype = np.dtype(object)

    def __init__(self, plain: Arguments, numbers: Digits):
        self.__dict__.update(plain.__dict__)
        self.numbers, self.kind = numbers, numbers.mpf
        finite = np.frompyfunc(numbers.mp.isfinite, 1, 1)
        self._finite = lambda x: np.asarray(finite(x), bool)
        self._is_finite = lambda x: bool(self._finite(x).all())

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

    def __init__(self, solver: Package, digits: int, texts: Callable[[int], str] | None):
        self.__dict__.update((n, x) for n, x in solver.__dict__.items() if not _is_room(type(solver), n))
        self._solver, self._texts = solver, texts
        self._made, self._making = {}, threading.Lock()
        self._digits = Digits(digits)
        self.digits, self.mp = digits, self._digits.mp
        self._arguments = ExtendedArguments(solver._arguments, self._digits)
        self._use(self._open(solver._opened.number))

    def _open(self, partition: int) -> Opened:
        with self._making:
            if partition not in self._made:
                opened = self._solver._open(partition)
                check_files(opened.folder, opened.package, ("_numpy.py",))
                file = opened.folder / f"{opened.manifest['name']}_numpy.py"
                text = self._texts(partition) if self._texts else file.read_text(encoding="utf-8")
                self._made[partition] = replace(opened, target=ExtendedTarget(opened, self._digits, text))
            return self._made[partition]

    def __reduce__(self) -> Any:
        return extended, (self._solver, self.digits, self._texts)

    def __repr__(self) -> str:
        return f"<{self._solver!r} in {self.digits} digits>"

    # -- calls ---------------------------------------------------------------------------------------------------------

    def _why_not(self, name: str) -> str:
        if name in REFUSED:
            return f"{name!r} is not to be had in more digits; it computes in double precision"
        return super()._why_not(name)

    def _call(self, name: str, given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None, out: Any = None) -> Any:
        if out is not None:
            raise ValueError(NO_PLACES)
        return super()._call(name, given, seeds)

    def _compute(
        self,
        opened: Opened,
        f: Function,
        arrays: Mapping[str, Any],
        batch: Shape,
        seeds: Seeds,
        taken: list[Array],
        bad: Mapping[int, str] | None = None,
    ) -> list[Array]:
        if taken:
            raise ValueError(NO_PLACES)
        if not f.has_entries():
            return [np.empty(shape, object) for shape in f.whole_shapes(batch, seeds.k)]
        results = opened.target.compute(f, arrays, batch, seeds)
        if not all(map(self._arguments._is_finite, results)):
            in_double = self._solver._open(opened.number)  # which knows by what
            floats = {n: np.asarray(x, float) for n, x in arrays.items()}
            directions = Seeds({n: x.astype(float) for n, x in seeds.of.items()}, seeds.k)
            tell_infinite(in_double, f, [x.astype(float) for x in results], floats, batch, directions)
        return results

    @functools.cached_property
    def _states(self) -> Any:
        of_doubles: Any = self._solver
        return _with(ExtendedStates, type(of_doubles._states))(self, of_doubles._states)

    @functools.cached_property
    def _gradients(self) -> Any:
        of_doubles: Any = self._solver
        return _with(ExtendedGradients, type(of_doubles._gradients))(self, self._states)

    def jacobians(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        wrt: str | Sequence[str] | None = None,
        out: Jacobians | None = None,
    ) -> Jacobians:
        """The partial derivatives of udot, or those by what `wrt` names."""
        asked = asked_for(wrt)
        f = self._find(self._opened, "jacobians")
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        taken = [] if out is None else [np.empty(0)]
        found = dict(zip(f.results, self._compute(self._opened, f, arrays, batch, NO_SEEDS, taken), strict=True))
        zero = self._digits.mpf(0)
        shapes = {n: batch + self._shapes[f"J_{n}"] for n in JACOBIANS}
        return jacobians_of({n: found.get(f"J_{n}", np.full(shapes[n], zero, object)) for n in asked})

    def _look_at_directions(self, name: str, given: Sequence[Any], seeds: Sequence[Any]) -> None:
        """In double precision there is a warning of directions that have no derivative."""


class ExtendedGradients(Room):
    """In front of `WeightedGradients`: results as numbers of mpmath's."""

    package: Extended

    def _filled(self, found: Mapping[str, Array], k: int, batch: Shape) -> Any:
        gradients = super()._filled(found, k, batch)  # type: ignore[misc]
        return type(gradients)(*map(self.package._digits.as_mpf, gradients))


class ExtendedStates(Room):
    """In front of `States`, or `Loops`: consistent states in more digits, from those of doubles."""

    package: Extended

    def __init__(self, package: Extended, of_doubles: Any):
        super().__init__(package, of_doubles._equilibrium)  # type: ignore[call-arg]
        self._digits, self.closing = package._digits, package._solver._open

    def _closing(self) -> Opened:
        return self.closing(self._opened.number)  # double precision closes the loops first

    def assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        q_new = np.broadcast_to(arrays["q"], (*batch, self.nq)).astype(object)
        normalise(q_new, self._arguments.quaternions)
        if self.closure_names:
            p = placing(arrays, batch, self._opened.manifest)
            rough = {n: np.asarray(arrays[n]).astype(float) for n in ("p", "inputs", "t") if n in arrays}
            near = super().assembled({"q": q_new.astype(float), **rough}, batch, follow)  # type: ignore[misc]
            for at in np.ndindex(batch):
                moved = np.abs(near[at] - q_new[at].astype(float)) > SAME * (1.0 + np.abs(near[at]))
                q_new[at] = self._closed(np.where(moved, self._digits.to_mpf(near[at]), q_new[at]), p[at], at)
        return q_new

    def _completed_along(self, *given: Any) -> Any:
        return tuple(map(self._digits.as_mpf, super()._completed_along(*given)))  # type: ignore[misc]

    def _closed(self, q: Any, p: Any, at: tuple[int, ...]) -> Any:
        """Coordinates (nq,) that are closed in double precision, closed in this one."""
        opened, assembly = self._opened, self.assembly  # type: ignore[attr-defined]
        u, named = np.zeros(self.nu), assembly.newton.named

        def gaps(q: Any) -> Any:
            found = opened.target.compute(opened.functions["closure"], named(q, p) | {"u": u}, ())[0]
            return np.abs(found)[assembly.kept]

        left = gaps(q)
        for _ in range(NEWTON):
            (step,) = opened.target.compute(opened.functions["newton_step"], named(q, p), ())
            trial = q + step
            normalise(trial, self._arguments.quaternions)
            after = gaps(trial)
            if not 2 * max(after) < max(left):
                break
            q, left = trial, after
        if not max(left) < self.package.mp.mpf(10) ** (LEFT - self.package.digits):
            where = f" (state {list(at)} of the batch)" if at else ""
            digits = f" in {self.package.digits} digits{where}"
            raise assembly.open(int(np.argmax(left)), float(max(left)), digits)
        return q


class Refused:
    """Stands for a member that computes in double precision only."""

    def __init__(self, name: str):
        self.name = name

    def __get__(self, package: Package | None, kind: type | None = None) -> Any:
        raise AttributeError(f"{self.name!r} is not to be had in more digits; it computes in double precision")


for _name in REFUSED:
    setattr(Extended, _name, Refused(_name))


def extended(solver: Package, digits: int, texts: Callable[[int], str] | None = None) -> Any:
    """A solver in more digits; `texts` gives the NumPy module of each partition where it is not the package's own."""
    solver = getattr(solver, "_solver", solver)
    if isinstance(digits, bool) or not isinstance(digits, (int, np.integer)) or not FEWEST <= digits <= MOST:
        raise ValueError(f"digits is {digits!r}, expected a whole number from {FEWEST} to {MOST}; doubles have 16")
    return _with(Extended, type(solver))(solver, int(digits), texts)


def _is_room(kind: type, name: str) -> bool:
    """Whether a member is a room of its solver, which works on that one."""
    return isinstance(getattr(kind, name, None), functools.cached_property)


def _with(front: Any, plain: Any) -> Any:
    """A class with one of these in front of it."""
    return _made_of(front, plain)


@functools.cache
def _made_of(front: Any, plain: Any) -> Any:
    return type(front.__name__, (front, plain), {"__doc__": front.__doc__})
