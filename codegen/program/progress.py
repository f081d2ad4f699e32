"""Progress of long work: the worker calls a function, and a caller may listen."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""A function that is called with a description such as ``expanding``, the step (from 1) and the number of steps; 0, 0
if steps are not counted."""


def silent(stage: str, step: int, steps: int) -> None:
    """A progress function that ignores its arguments."""
