"""Errors and warnings of a model: collected with their places, printed one per line, raised together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..wording import nearest as nearest
from ..wording import with_article as with_article

_LINE = 1200


@dataclass(frozen=True, slots=True)
class Problem:
    """An error or a warning about a model.

    Attributes
    ----------
    file : str
        File name, ``<string>``, or ``builder``.
    line, column : int or None
        Counted from 1; None if there is no text (a model built in Python).
    path : str
        Keys that lead to the value, such as ``bodies.crank.mass``; empty for the whole file.
    message : str
        What was found; what is allowed; the nearest known name.
    severity : str
        ``error`` or ``warning``.
    """

    file: str
    line: int | None
    column: int | None
    path: str
    message: str
    severity: str = "error"

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}:{self.column}"
        path = f" {self.path}:" if self.path else ""
        warning = " warning:" if self.severity == "warning" else ""
        return f"{place}:{warning}{path} {self.message}"


class ModelError(Exception):
    """Raised for a model with errors; its text has one line for each problem.

    Attributes
    ----------
    problems : list of Problem
        The errors in the order of the file, then the warnings.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = list(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(p) for p in self.problems)


def within_a_line(text: str) -> str:
    """A message with its middle left out if it is too long to read."""
    return text if len(text) <= _LINE else f"{text[: _LINE * 2 // 3]} ... {text[-_LINE // 3 :]}"


def count_of_values(count: int) -> str:
    """The number with its noun: ``1 value``, ``2 values``."""
    return f"{count} value" + "s" * (count != 1)
