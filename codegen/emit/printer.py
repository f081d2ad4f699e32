"""Prints expressions of statements as C or NumPy source."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from types import MappingProxyType
from typing import Self

from ..program.algebra import HALF, MINUS_ONE
from ..program.algebra import function as _function
from ..program.digits import text_of
from ..program.expressions import Expr, Function, Number, Pow

SUM, PRODUCT, ATOM = 0, 1, 2

HELD = {
    "HeldAtLeast": "AtLeast", "HeldFloor": "Floor", "HeldSign": "Sign", "HeldAbsolute": "Absolute",
    "HeldMaximum": "Maximum", "HeldMinimum": "Minimum", "HeldAngle": "atan2",
}  # fmt: skip
"""Functions that take a mode, with those that they are without."""

C_FUNCTIONS = {
    "sin": "sin", "cos": "cos", "tan": "tan", "asin": "asin", "acos": "acos", "atan": "atan", "atan2": "atan2",
    "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "exp": "exp", "log": "log", "sqrt": "sqrt",
    "Absolute": "fabs", "Maximum": "fmax", "Minimum": "fmin", "pow": "pow", "Power": "pow",
    "Floor": "FLOOR", "Choice": "CHOICE", "Vanishing": "VANISHING", "Along": "DIRECTIONS(ALONG)",
}  # fmt: skip
NUMPY_FUNCTIONS = {
    "sin": "np.sin", "cos": "np.cos", "tan": "np.tan", "asin": "np.arcsin", "acos": "np.arccos", "atan": "np.arctan",
    "atan2": "np.arctan2", "sinh": "np.sinh", "cosh": "np.cosh", "tanh": "np.tanh", "exp": "np.exp", "log": "np.log",
    "sqrt": "np.sqrt", "Absolute": "np.abs", "Maximum": "np.maximum", "Minimum": "np.minimum", "Sign": "np.sign",
    "pow": "np.power", "Power": "np.power", "Floor": "np.floor", "Choice": "choice", "Vanishing": "vanishing",
    "Along": "vanishing",
}  # fmt: skip


OWN = ("Floor", "Choice", "Vanishing", "Along")
"""Functions that generated files define themselves, where they call them."""


class Printer:
    """Prints one right side; `functions` names the elementary functions of the language, `names` calls symbols otherwise.

    Attributes
    ----------
    own : set of str
        Those of `OWN` that have been printed.
    """

    def __init__(self, functions: dict[str, str], names: Mapping[str, str] = MappingProxyType({})):
        self.functions = functions
        self.names = names
        self.own: set[str] = set()

    @property
    def words(self) -> list[str]:
        """What generated files define, for those that have been printed."""
        wanted = {"floor": {"Floor"}, "choice": {"Choice"}, "vanishing": {"Vanishing", "Along"}}
        return [word for word, names in wanted.items() if not names.isdisjoint(self.own)]

    def calling(self, names: Mapping[str, str]) -> Self:
        """A printer that calls some symbols by other names. The order of terms and factors stays that of the symbols."""
        found = copy(self)
        found.names = names
        return found

    def __call__(self, e: Expr) -> str:
        return self._print(e, SUM)

    def _print(self, e: Expr, level: int) -> str:
        if e.is_Symbol:
            return self.names.get(e.name, e.name)
        if isinstance(e, Number):
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
        return text_of(e)

    def _sum(self, e: Expr, level: int) -> str:
        terms = [(self._is_negative(t), t) for t in e.args]
        terms.sort(key=lambda item: item[0])  # a positive term first; stable, so the others stay in their order
        text = ""
        for negative, t in terms:
            printed = self._print(-t if negative else t, PRODUCT)
            if not text:
                text = f"-{printed}" if negative else printed
            else:
                text += f" - {printed}" if negative else f" + {printed}"
        return f"({text})" if level > SUM else text

    @staticmethod
    def _is_negative(t: Expr) -> bool:
        first = t.args[0] if t.is_Mul else t
        return isinstance(first, Number) and first < 0

    def _product(self, e: Expr, level: int) -> str:
        factors = list(e.args)
        sign = ""
        first = factors[0]
        if isinstance(first, Number) and first < 0:
            sign = "-"
            factors = ([] if first is MINUS_ONE else [-first]) + factors[1:]
        above = [f for f in factors if not self._is_reciprocal(f)]
        below = [1 / f for f in factors if self._is_reciprocal(f)]
        text = "*".join(self._print(f, ATOM) for f in above) or "1.0"
        if below:
            denominator = "*".join(self._print(f, ATOM) for f in below)
            text = f"{text}/{denominator}" if len(below) == 1 else f"{text}/({denominator})"
        text = sign + text
        return f"({text})" if level == ATOM or (sign and level > SUM) else text

    @staticmethod
    def _is_reciprocal(f: Expr) -> bool:
        return isinstance(f, Pow) and f.exp < 0

    def _power(self, e: Expr, level: int) -> str:
        assert isinstance(e, Pow)
        base, exponent = e.base, e.exp
        if exponent < 0:
            text = f"1.0/{self._print(1 / e, ATOM)}"
            return f"({text})" if level == ATOM else text
        if exponent.is_Integer and int(exponent) <= 16:
            text = self._multiply(self._print(base, ATOM), int(exponent))
            return f"({text})" if level == ATOM else text
        if exponent is HALF:
            return f"{self.functions['sqrt']}({self._print(base, SUM)})"
        return f"{self.functions['pow']}({self._print(base, SUM)}, {self._print(exponent, SUM)})"

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
        if name == "Sign" and "Sign" not in self.functions:
            return f"(TRUTH({arguments[0]} > 0.0) - TRUTH({arguments[0]} < 0.0))"
        return f"{self.functions[name]}({', '.join(arguments)})"

    def at_least(self, a: str, b: str) -> str:
        return f"TRUTH({a} >= {b})"

    def turned(self, angle: str, mode: str) -> str:
        """An angle within half a turn of a mode."""
        return f"TURNED({mode}, {angle})"

    def held(self, name: str, mode: str, arguments: list[str], free: str) -> str:
        """A function whose branch a mode chooses; `free` is the function without."""
        match name:
            case "HeldAtLeast":
                above, below = "1.0", "0.0"
            case "HeldSign":
                above, below = "1.0", "-1.0"
            case "HeldFloor":
                above, below = (
                    f"({c}2.0*FLOOR(0.5*({arguments[0]}) {s} 0.25))" for c, s in (("", "+"), ("1.0 + ", "-"))
                )
            case "HeldAngle":
                above, below = (f"ANGLE_{side}({arguments[1]}, {free})" for side in ("ABOVE", "BELOW"))
            case "HeldAbsolute":
                above, below = arguments[0], f"-({arguments[0]})"
            case "HeldMaximum":
                above, below = arguments
            case _:
                below, above = arguments
        return f"HELD({mode}, {above}, {below}, {free})"


class NumpyPrinter(Printer):
    """NumPy source."""

    def __init__(self) -> None:
        super().__init__(NUMPY_FUNCTIONS)

    def at_least(self, a: str, b: str) -> str:
        return f"np.where({a} >= {b}, 1.0, 0.0)"

    def turned(self, angle: str, mode: str) -> str:
        return angle

    def held(self, name: str, mode: str, arguments: list[str], free: str) -> str:
        """No integrator calls NumPy, so no mode is ever given."""
        return free
