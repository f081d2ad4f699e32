"""The words of the expression grammar: functions, limits and errors."""

from __future__ import annotations

from typing import Final

from ..elementary import TABLE
from ..elementary import Tree as Tree
from .errors import nearest

Number = int | float

FUNCTIONS: Final[dict[str, int]] = {name: e.arity for name, e in TABLE.items()}
"""Functions of the grammar and how many arguments they take (``min`` and ``max``: at least that number)."""

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

EXACT = 2**53
ZERO: Tree = ("number", 0)
ONE: Tree = ("number", 1)


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
