"""What takes part in a comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

Ends = tuple[Sequence[float], Sequence[Sequence[float]] | None]
"""The quantities of a problem at its end, and their derivatives, if this program has any."""


@dataclass(frozen=True)
class Contestant:
    """A program with its settings.

    Attributes
    ----------
    who, setting : str
    run : callable
        Computes the motion from its beginning.
    """

    who: str
    setting: str
    run: Callable[[], Ends]
