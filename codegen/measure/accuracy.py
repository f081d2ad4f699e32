"""Errors: differences from a reference in any number type, relative to its largest entry."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np

SMALLEST = 1e-30
"""A reference without entries above this size counts as zero; errors are then absolute."""

DIGITS = 50
"""Decimal digits for differences from references in extended precision."""


def largest(x: Any) -> Any:
    """The largest magnitude of an entry; zero for an empty array."""
    return max((abs(e) for e in np.ravel(x)), default=0)


def relative(x: Any, exact: Any, size: Any = None) -> float:
    """The relative error max_i |x_i - exact_i| / max_i |exact_i|.

    Parameters
    ----------
    x : array_like of float or of mpmath's numbers
    exact : array_like of float or of mpmath's numbers
    size : number, optional
        Reference size of the errors, in place of the largest entry.
    """
    x, exact = np.ravel(x), np.ravel(exact)
    if len(x) != len(exact):
        raise ValueError(f"{len(x)} numbers are compared with {len(exact)}")
    if size is None:
        size = largest(exact)
        size = size if size > SMALLEST else 1.0
    if exact.dtype != object:
        return float(largest(x - exact) / size)
    with mpmath.workdps(DIGITS):
        return float(largest([mpmath.mpf(a) - b for a, b in zip(x, exact, strict=True)]) / size)


def by_direction(x: Any, exact: Any) -> list[float]:
    """The relative error of each row."""
    return [relative(a, b) for a, b in zip(x, exact, strict=True)]
