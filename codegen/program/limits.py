"""Range and precision of a program's scalar type, from which the margins in its blocks follow."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ..records import dataclass

EPSILON = 2.0**-52
"""Limits of double precision, for which all margins in the source are stated."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Range and precision of a scalar type.

    Attributes
    ----------
    epsilon : float
        Distance from 1 to the next larger number.
    smallest : float
        The smallest normal number.

    Examples
    --------
    >>> Limits(2.0**-23, 2.0**-126).rounding(2e-15)
    1e-06
    """

    epsilon: float
    smallest: float

    def rounding(self, margin: float, power: float = 1) -> float:
        """Convert a margin for rounding errors from double precision to this type, rounded to one significant digit. It is
        proportional to `power` of the type's rounding error."""
        return float(f"{margin * (self.epsilon / EPSILON) ** power:.0e}")

    def tiny(self, size: float, root: float) -> float:
        """The given size, but increased if ``size**root`` would be too small for a normal number of this type."""
        return max(size, float(f"{2 * self.smallest ** (1 / root):.0e}"))


DOUBLE = Limits(EPSILON, 2.0**-1022)

_limits: ContextVar[Limits] = ContextVar("limits", default=DOUBLE)


@contextmanager
def limited(limits: Limits) -> Iterator[None]:
    """Write blocks for a scalar type with these limits inside the context."""
    token = _limits.set(limits)
    try:
        yield
    finally:
        _limits.reset(token)


def limits() -> Limits:
    """The limits of the scalar type of the program that is being written."""
    return _limits.get()
