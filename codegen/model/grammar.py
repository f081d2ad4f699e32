"""Words of the expression grammar: functions, limits and errors."""

from __future__ import annotations

from typing import Final

from ..elementary import TABLE
from ..elementary import Tree as Tree
from .errors import nearest

Number = int | float

FUNCTIONS: Final[dict[str, int]] = {name: e.arity for name, e in TABLE.items()}
"""Functions of the grammar, each with its number of arguments; for ``min`` and ``max`` this is the smallest number."""

AT_LEAST: Final = "at_least"
"""In trees only: 1 if the first argument is at least the second, otherwise 0. Comparisons use it."""

CHOICE: Final = "choice"
"""In trees only: the second argument if the first is 1, the third if it is 0. The other argument has no effect, whatever its
value. ``if`` uses it."""

VANISHING: Final = "vanishing"
"""In trees only: a product that is 0 if its first factor is 0, even if the second factor is infinite or has no value;
see `regular`."""

WRAPPED: Final = "wrapped"
"""In trees only: ``mod`` in an expression that is smooth where the remainder jumps, such as a periodic cubic table."""

OF_TREES: Final = (AT_LEAST, CHOICE, VANISHING, WRAPPED)

JUMPS: Final = (AT_LEAST, "sign", "mod")
"""Functions of the grammar that have jumps."""

WRITTEN_OUT: Final = {"if": "if(condition, x, y)", "step": "step(x, from, to)", "distance": "distance(POINT, POINT)",
                      "rate": "rate(POINT, POINT)"}  # fmt: skip
"""Functions that the parser replaces by expressions of other functions, each with its form in a file."""

_OTHER_LANGUAGES: Final = {other: name for name, e in TABLE.items() for other in e.elsewhere}


def functions(name: str) -> str:
    """A hint for an unknown function: ``functions are sin, cos, ...; did you mean 'log'?``."""
    other = {
        "heaviside": "; a step is if(x > 0, 1, 0), a smooth one step(x, from, to)", "pow": "; a power is written a**b",
        "log10": "; write log(x)/log(10)", "log2": "; write log(x)/log(2)", "cbrt": "; write x**(1/3)",
    }.get(name.lower())  # fmt: skip
    if other is None and name.lower() in _OTHER_LANGUAGES:
        other = f"; did you mean {_OTHER_LANGUAGES[name.lower()]!r}?"
    every = [*FUNCTIONS, *WRITTEN_OUT]
    return f"functions are {', '.join(every)}{other or nearest(name, every)}"


MEASURED: Final = ("position", "velocity")
"""Measures of points in expressions, by components in the ground frame: ``position.tip.x``."""

MAX_LENGTH: Final = 10_000
MAX_NESTING: Final = 100
MAX_DEPTH: Final = 200

EXACT = 2**53
ZERO: Tree = ("number", 0)
ONE: Tree = ("number", 1)


class ExpressionError(ValueError):
    """Raised if a text is not an expression, or if an expression has no value.

    Attributes
    ----------
    message : str
        What was found and what is allowed.
    column : int or None
        Column of the text, counted from 1; None if the error concerns the whole expression.
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message if column is None else f"column {column}: {message}")
        self.message = message
        self.column = column
