"""Errors and warnings of a model: collected with their places, printed one per line, raised together."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

_LONG, _MANY, _LINE = 100, 1000, 1200


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


def nearest(name: str, known: Iterable[str]) -> str:
    """The hint ``; did you mean 'mass'?`` for a misspelt name; empty if no known name is similar."""
    if len(name) > _LONG:
        return ""
    listed = list(known)
    if len(listed) > _MANY:  # a comparison with all names would take too long
        listed = [n for n in listed if n[:2] == name[:2] and abs(len(n) - len(name)) <= 2][:_MANY]
    matches = difflib.get_close_matches(name, listed, n=1, cutoff=0.6)
    matches = matches or [n for n in listed if n.lower() == name.lower()]
    return f"; did you mean {matches[0]!r}?" if matches else ""


def within_a_line(text: str) -> str:
    """A message with its middle left out if it is too long to read."""
    return text if len(text) <= _LINE else f"{text[: _LINE * 2 // 3]} ... {text[-_LINE // 3 :]}"


def count_of_values(count: int) -> str:
    """The number with its noun: ``1 value``, ``2 values``."""
    return f"{count} value" + "s" * (count != 1)


def with_article(what: str) -> str:
    """The noun with its article: ``an input``, ``a body``."""
    return f"an {what}" if what[0] in "aeiou" else f"a {what}"
