"""What numbers the scalar type of a program can hold: margins that blocks are written with follow from it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ..records import dataclass

EPSILON = 2.0**-52
"""Of double precision, for which margins are stated."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a scalar type.

    Attributes
    ----------
    epsilon : float
        Distance from 1 to the next number.
    smallest : float
        The smallest normal number.

    Examples
    --------
    >>> Limits(2.0**-23, 2.0**-126).rounding(2e-15)
    1e-06
    """

    epsilon: float
    smallest: float

    def rounding(self, margin: float, power: int = 1) -> float:
        """A margin for rounding errors, or a power of one, that is stated for double precision, to one digit."""
        return float(f"{margin * (self.epsilon / EPSILON) ** power:.0e}")

    def tiny(self, size: float, root: float) -> float:
        """A size that is stated for double precision, but such that this power of it is a normal number in any case."""
        return max(size, float(f"{2 * self.smallest ** (1 / root):.0e}"))


DOUBLE = Limits(EPSILON, 2.0**-1022)

_limits: ContextVar[Limits] = ContextVar("limits", default=DOUBLE)


@contextmanager
def limited(limits: Limits) -> Iterator[None]:
    """While this lasts, blocks are written for a scalar type with these limits."""
    token = _limits.set(limits)
    try:
        yield
    finally:
        _limits.reset(token)


def limits() -> Limits:
    """Those of the program that is being written."""
    return _limits.get()
