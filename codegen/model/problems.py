"""Errors and warnings of a model with their places in the files, each reported once, up to a limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from .errors import Problem, within_a_line
from .parts import Instance
from .positions import Document, Path_, show_path

MAX_PROBLEMS: Final = 200
MAX_ERRORS: Final = 10_000
"""Largest number of errors counted, including those of repetitions that are not reported again."""


class TooManyProblems(Exception):
    """Raised when reading stops because the largest number of errors has been collected."""


class Problems:
    """Collects the errors and warnings of a model.

    Attributes
    ----------
    problems : list of Problem
    errors : int
        Number of errors found, including those of repeated entries that are reported only once. If reading entries has
        not changed this number, they are correct.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: list[Problem] = list(document.problems)
        self.errors = 0
        self._reported: set[tuple[Any, ...]] = set()

    def add(self, problem: Problem) -> None:
        if problem.severity == "error" and sum(p.severity == "error" for p in self.problems) >= MAX_PROBLEMS:
            message = f"more than {MAX_PROBLEMS} problems; correct these first"
            self.problems.append(Problem(self.document.file, problem.line, problem.column, "", message))
            raise TooManyProblems
        self.problems.append(problem)

    def report(
        self,
        at: Instance,
        sub: Path_,
        message: str | Callable[[], str],
        *,
        key: bool = False,
        inside: int | None = None,
        severity: str = "error",
    ) -> None:
        """Report an error or a warning in an entry; for repeated entries only the first one.

        A message that takes long to make, such as one with the nearest of many names, is given as a function.
        """
        self.errors += severity == "error"
        path = (at.key, *sub)
        existing = existing_path(at.container, path)
        if at.section == ("submodels",):  # keys of its joint are directly in the entry, see `files._frame`
            existing = tuple("on" if key == "parent" else key for key in existing if key != "joint")
        shown = show_path((*at.section, *existing))
        document = at.part.document
        line, column = document.place(at.container, path, key=key, inside=inside)
        if self.errors > MAX_ERRORS:
            message = f"more than {MAX_ERRORS} errors, counting those in repetitions; correct these first"
            self.problems.append(Problem(document.file, line, column, shown, message))
            raise TooManyProblems
        if at.indices or at.part.is_submodel:
            mark = (document.file, line, column, shown, severity)
            if mark in self._reported:
                return
            self._reported.add(mark)
        text = message if isinstance(message, str) else message()
        if at.indices:
            text += " (" + ", ".join(f"{k} = {v}" for k, v in at.indices.items()) + ")"
        text += at.part.where
        self.add(Problem(document.file, line, column, shown, within_a_line(text), severity))


def existing_path(container: Any, path: Path_) -> Path_:
    """The beginning of a path up to its last part that exists."""
    result: list[str | int] = []
    for part in path:
        listed = isinstance(container, (list, tuple)) and isinstance(part, int) and part < len(container)
        if listed or (isinstance(container, dict) and part in container):
            container = container[part]
            result.append(part)
    return tuple(result)
