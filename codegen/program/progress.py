"""How far long work has come: what whoever does it calls, and whoever waits may listen to."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is being done, such as ``expanding``, the step (from 1) and the number of steps; 0, 0: not counted."""


def silent(stage: str, step: int, steps: int) -> None:
    """Nobody listens."""
