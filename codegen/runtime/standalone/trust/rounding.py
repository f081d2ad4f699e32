"""Estimates rounding errors by repeating a computation with all operations rounded up, and again rounded down.

The O(n) recursion is insensitive to the condition number of the mass matrix, so this number does not indicate errors.
Repetition with another rounding mode indicates them, because it makes other rounding errors of similar size. This is the
idea of J. Vignes's CESTAC method, here with two of the three usual modes and without random numbers. The result with
rounding to nearest usually lies between the two others, and is closer to the exact one."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import platform
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ....elementary import named
from ..arrays import Array

DIRECTED = ("up", "down")
"""Rounding modes other than rounding to nearest."""

MODES = {
    **dict.fromkeys(("x86_64", "AMD64", "i386", "i686"), (0x800, 0x400)),
    **dict.fromkeys(("aarch64", "arm64"), (0x400000, 0x800000)),
    **dict.fromkeys(("ppc64le", "ppc64", "s390x"), (2, 3)),
    "riscv64": (3, 2), "loongarch64": (0x200, 0x300),
}  # fmt: skip
"""Arguments of ``fesetround`` for `DIRECTED`, by processor: a field of its control register. Rounding to nearest is 0
on all processors."""

NEAREST = 0

SHARE = 1.0 / 3.0
"""Ratio of the error with rounding to nearest to the larger of the two differences. On average, rounding to nearest
changes a result by a quarter of its last place; directed rounding changes it by half a place, always to the same side.
Measured; see docs/theory.md, section 9."""

UNIT = 2.0**-53
"""Largest relative error of one operation that is rounded to nearest; no estimate of an error is smaller."""

ELEMENTARY = (*named("numpy", lambda e: e.rounds), "power")
"""NumPy functions that are always computed with rounding to nearest, because their algorithms may need it."""


@functools.cache
def _library() -> Any:
    """The C library of this process."""
    return ctypes.CDLL(None)


@contextlib.contextmanager
def rounding(direction: str) -> Iterator[None]:
    """Sets the rounding mode of this thread, and restores the previous mode at the end of the block."""
    library = _library()
    before = library.fegetround()
    try:
        library.fesetround(MODES[platform.machine()][DIRECTED.index(direction)])
        yield
    finally:
        library.fesetround(before)


@functools.cache
def can_round() -> bool:
    """Whether this machine supports directed rounding, tested on sums with known results."""
    one, little = np.float64(1.0), np.float64(2.0**-60)
    try:
        found = []
        for direction in DIRECTED:
            with rounding(direction):
                found.append((float(one + little) > 1.0, float(-one - little) < -1.0))
    except (OSError, AttributeError, KeyError, TypeError):  # there is no such processor, library, or library function
        return False
    return found == [(True, False), (False, True)] and float(one + little) == 1.0


class NearestFunctions:
    """NumPy, with elementary functions that always round to nearest."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        return to_nearest(found) if name in ELEMENTARY else found


def to_nearest(function: Callable[..., Any]) -> Callable[..., Any]:
    """A variant of a function that always rounds to nearest."""

    def of(*given: Any) -> Any:
        library = _library()
        mode = library.fegetround()
        try:
            library.fesetround(NEAREST)
            return function(*given)
        finally:
            library.fesetround(mode)

    return of


def spread(compute: Callable[[], Sequence[Array]], nearest: Sequence[Array]) -> list[Array]:
    """Estimates of the rounding errors of results, entry by entry; infinite for results that are not finite.

    Parameters
    ----------
    compute : callable
        Repeats the computation; called once for each of `DIRECTED`.
    nearest : arrays
        The results with rounding to nearest.

    Returns
    -------
    list of array
        Errors, at least `UNIT` of each entry.
    """
    errors = [UNIT * np.abs(x) for x in nearest]
    for direction in DIRECTED:
        try:
            with rounding(direction):
                found = compute()
        except np.linalg.LinAlgError:  # a pivot consists of rounding errors only
            return [np.full(x.shape, np.inf) for x in nearest]
        with np.errstate(all="ignore"):
            off = [SHARE * np.abs(x - y) for x, y in zip(found, nearest, strict=True)]
        errors = [np.fmax(a, np.where(np.isfinite(b), b, np.inf)) for a, b in zip(errors, off, strict=True)]
    return errors
