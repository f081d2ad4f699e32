"""Prints expressions of statements. The class of each target adds the methods that differ between languages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from operator import itemgetter
from types import MappingProxyType
from typing import Self

from ..program.algebra import HALF, MINUS_ONE, Expr, Function, Number, Pow, Symbol
from ..program.algebra import function as _function
from ..program.digits import text_of
from .target import Scalar, Target

SUM, PRODUCT, ATOM = 0, 1, 2

HELD = {
    "HeldAtLeast": "AtLeast", "HeldFloor": "Floor", "HeldSign": "Sign", "HeldAbsolute": "Absolute",
    "HeldMaximum": "Maximum", "HeldMinimum": "Minimum", "HeldAngle": "atan2",
}  # fmt: skip
"""Functions that take a mode, each with its counterpart without mode."""

OWN = ("Floor", "Choice", "Vanishing", "Along")
"""Functions that a generated file defines itself if it calls them."""


def _is_negative(term: Expr) -> bool:
    """Whether a term begins with a negative number."""
    first = term.args[0] if term.is_Mul else term
    return isinstance(first, Number) and first.value < 0


def _without_sign(product: Expr) -> Sequence[Expr]:
    """The factors of a product that begins with a negative number, with the sign reversed."""
    first, *others = product.args
    return others if first is MINUS_ONE else (-first, *others)


_sign: Callable[[tuple[bool, Expr]], bool] = itemgetter(0)


class Printer(ABC):
    """Prints the right side of a statement.

    Parameters
    ----------
    target : Target
        Spelling of the elementary functions.
    scalar : Scalar
        Spelling of numbers.
    names : mapping of str to str
        Other names for some symbols.

    Attributes
    ----------
    own : set of str
        Functions of `OWN` that have been printed.
    called : set of str
        Functions that have been printed.
    """

    def __init__(self, target: Target, scalar: Scalar, names: Mapping[str, str] = MappingProxyType({})):
        self.target, self.scalar = target, scalar
        self.names = names
        self.own: set[str] = set()
        self.called: set[str] = set()

    @property
    def words(self) -> list[str]:
        """Definitions of functions in `OWN` that have been printed, for the generated file."""
        wanted = {"floor": {"Floor"}, "choice": {"Choice"}, "vanishing": {"Vanishing", "Along"}}
        return [word for word, names in wanted.items() if not names.isdisjoint(self.own)]

    def calling(self, names: Mapping[str, str]) -> Self:
        """A printer that renames some symbols. The order of terms and factors is that of the original symbols."""
        found = copy(self)
        found.names = names
        return found

    def __call__(self, e: Expr) -> str:
        return self._print(e, SUM)

    def _print(self, e: Expr, level: int) -> str:
        if isinstance(e, Symbol):
            return self.names.get(e.name, e.name)
        if e.is_Number:
            text = self.number(e)
            return f"({text})" if level > SUM and text.startswith("-") else text
        if e.is_Add:
            return self._sum(e, level)
        if e.is_Mul:
            return self._product(e, level)
        if e.is_Pow:
            return self._power(e, level)
        return self._call(e)

    def number(self, e: Expr) -> str:
        return self.scalar.literal(text_of(e))

    def spelled(self, function: str) -> str:
        """Name of an elementary function in the target; the call is recorded."""
        self.called.add(function)
        return self.target.function(function)

    def _sum(self, e: Expr, level: int) -> str:
        terms = [(_is_negative(t), t) for t in e.args]
        terms.sort(key=_sign)  # a positive term comes first; the sort is stable, so the other terms keep their order
        text = ""
        for negative, t in terms:
            printed = self._unsigned(t) if negative else self._print(t, PRODUCT)
            if not text:
                text = f"-{printed}" if negative else printed
            else:
                text += f" - {printed}" if negative else f" + {printed}"
        return f"({text})" if level > SUM else text

    def _product(self, e: Expr, level: int) -> str:
        negative = _is_negative(e)
        text = f"-{self._factors(_without_sign(e))}" if negative else self._factors(e.args)
        return f"({text})" if level == ATOM or (negative and level > SUM) else text

    def _unsigned(self, term: Expr) -> str:
        """The text of a negative term without its minus sign."""
        factors = _without_sign(term) if term.is_Mul else (-term,)
        return self._factors(factors) if len(factors) > 1 else self._print(factors[0], PRODUCT)

    def _factors(self, factors: Sequence[Expr]) -> str:
        """The text of a product, from its factors."""
        names, above, below = self.names, [], []
        for f in factors:
            if isinstance(f, Symbol):
                above.append(names.get(f.name, f.name))
            elif isinstance(f, Pow) and f.exp < 0:
                below.append(self._print(1 / f, ATOM))
            else:
                above.append(self._print(f, ATOM))
        text = "*".join(above) or self.scalar.literal("1.0")
        if below:
            denominator = "*".join(below)
            text = f"{text}/{denominator}" if len(below) == 1 else f"{text}/({denominator})"
        return text

    def _power(self, e: Expr, level: int) -> str:
        assert isinstance(e, Pow)
        base, exponent = e.base, e.exp
        if exponent < 0:
            text = f"{self.scalar.literal('1.0')}/{self._print(1 / e, ATOM)}"
            return f"({text})" if level == ATOM else text
        if exponent.is_Integer and int(exponent) <= 16:
            text = self._multiply(self._print(base, ATOM), int(exponent))
            return f"({text})" if level == ATOM else text
        if exponent is HALF:
            return f"{self.spelled('sqrt')}({self._print(base, SUM)})"
        return f"{self.spelled('pow')}({self._print(base, SUM)}, {self._print(exponent, SUM)})"

    def _multiply(self, base: str, n: int) -> str:
        """A power by repeated squaring, as `operations.count_expression` counts it."""
        if n == 1:
            return base
        half = self._multiply(base, n // 2)
        text = f"({half})*({half})" if n > 3 else f"{half}*{half}"
        return f"{text}*{base}" if n % 2 else text

    def _call(self, e: Expr) -> str:
        assert isinstance(e, Function)
        name = e.name
        arguments = [self._print(a, SUM) for a in e.args]
        if name in OWN:
            self.own.add(name)
        if name == "AtLeast":
            return self.at_least(*arguments)
        if name == "HeldTurn":
            return self.turned(*arguments)
        if name in HELD:
            return self.held(name, arguments[-1], arguments[:-1], self._call(_function(HELD[name], *e.args[:-1])))
        if name == "Sign":
            return self.sign(*arguments)
        return f"{self.spelled(name)}({', '.join(arguments)})"

    @abstractmethod
    def sign(self, x: str) -> str:
        """The text of the sign of an expression: 1, 0 or -1."""

    @abstractmethod
    def at_least(self, a: str, b: str) -> str:
        """The text of a comparison: 1 where a is at least b, else 0."""

    @abstractmethod
    def turned(self, angle: str, mode: str) -> str:
        """The text of the angle plus whole turns, so that it differs from the mode by at most half a turn."""

    @abstractmethod
    def held(self, name: str, mode: str, arguments: list[str], free: str) -> str:
        """A function whose branch is selected by a mode; `free` is its counterpart without mode."""
