"""Exceptions about loops, and lists of names for messages."""

from __future__ import annotations

from collections.abc import Sequence

from ..model.model import Model


def listed(names: Sequence[str], limit: int = 6) -> str:
    """The names, separated by commas; of more than `limit` names, only the number is given."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


def loops_named(model: Model, loops: Sequence[int]) -> str:
    """Loops and couplings by kind and name: ``loops left, right and coupling gear``."""
    parts = []
    for word, named in (
        ("loop", [model.loops[i].name for i in loops if not model.loops[i].is_coupling]),
        ("coupling", [model.loops[i].name for i in loops if model.loops[i].is_coupling]),
    ):
        if named:
            parts.append(f"{word}{'s' * (len(named) > 1)} {listed(named)}")
    return " and ".join(parts)


def loops_counted(model: Model) -> str:
    """The number of loops and couplings of a model as text: ``2 loops and 1 coupling``."""
    couplings = sum(loop.is_coupling for loop in model.loops)
    counts = (("loop", len(model.loops) - couplings), ("coupling", couplings))
    return " and ".join(f"{n} {word}{'s' * (n > 1)}" for word, n in counts if n)


class AssemblyError(ValueError):
    """Raised if the movable joints cannot close the loops; the text names the loop and its residual.

    Attributes
    ----------
    loop : str
        Name of the loop that is furthest from closure.
    residual : float
        Largest scaled residual of this loop.
    """

    def __init__(self, message: str, loop: str = "", residual: float = float("nan")) -> None:
        super().__init__(message)
        self.loop = loop
        self.residual = residual


class PartitionError(ValueError):
    """Raised if no partition exists as requested: a hint cannot be independent, or no degree of freedom is left.

    Attributes
    ----------
    loops : tuple of str
        The loops that do not close because of a hint; empty if no hint is the cause.
    names : tuple of str
        Hinted speeds that cannot be independent, or not all together; empty if no hint is the cause.
    """

    def __init__(self, message: str, loops: Sequence[str] = (), names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.loops = tuple(loops)
        self.names = tuple(names)
