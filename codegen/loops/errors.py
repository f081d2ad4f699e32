"""Errors of loops, and lists of names and loops in messages."""

from __future__ import annotations

from collections.abc import Sequence

from ..model.model import Model


def listed(names: Sequence[str], limit: int = 6) -> str:
    """Names, separated by commas; long lists are shortened."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


def loops_named(model: Model, loops: Sequence[int]) -> str:
    """Some of a model's loops and couplings by their names, with what they are: ``loops left, right and coupling gear``."""
    parts = []
    for word, named in (
        ("loop", [model.loops[i].name for i in loops if not model.loops[i].is_coupling]),
        ("coupling", [model.loops[i].name for i in loops if model.loops[i].is_coupling]),
    ):
        if named:
            parts.append(f"{word}{'s' * (len(named) > 1)} {listed(named)}")
    return " and ".join(parts)


def loops_counted(model: Model) -> str:
    """How many loops and couplings a model has: ``2 loops and 1 coupling``."""
    couplings = sum(loop.is_coupling for loop in model.loops)
    counts = (("loop", len(model.loops) - couplings), ("coupling", couplings))
    return " and ".join(f"{n} {word}{'s' * (n > 1)}" for word, n in counts if n)


class AssemblyError(ValueError):
    """Loops that cannot be closed by the joints that may move; the text names the loop and its residual.

    Attributes
    ----------
    loop : str
        Name of the loop that is furthest from closure.
    residual : float
        Its largest scaled residual.
    """

    def __init__(self, message: str, loop: str = "", residual: float = float("nan")) -> None:
        super().__init__(message)
        self.loop = loop
        self.residual = residual


class PartitionError(ValueError):
    """Coordinates that cannot be divided as requested: a hint that cannot be independent, or no freedom left.

    Attributes
    ----------
    loops : tuple of str
        The loops that do not close because of that, where it is a hint.
    names : tuple of str
        The speeds that are asked to be independent and cannot be, or not all of them; empty where it is no hint.
    """

    def __init__(self, message: str, loops: Sequence[str] = (), names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.loops = tuple(loops)
        self.names = tuple(names)
