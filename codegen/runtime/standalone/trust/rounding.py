"""What rounding does to a result: the same code once more with every operation rounded up, and once rounded down.

A recursion of O(n) does not suffer from the condition of the mass matrix, so no condition number says how large its error
is. The code itself does: rounded in other directions it makes other errors, of the size of those that it makes anyway
(the idea of J. Vignes' CESTAC method; of the three usual modes two, which needs no random numbers). The result to nearest
lies between the two others, as a rule, and is nearer to the exact one than they are.
"""

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
"""Directions of rounding beside the usual one, to nearest."""

MODES = {
    **dict.fromkeys(("x86_64", "AMD64", "i386", "i686"), (0x800, 0x400)),
    **dict.fromkeys(("aarch64", "arm64"), (0x400000, 0x800000)),
    **dict.fromkeys(("ppc64le", "ppc64", "s390x"), (2, 3)),
    "riscv64": (3, 2), "loongarch64": (0x200, 0x300),
}  # fmt: skip
"""What ``fesetround`` takes for `DIRECTED`, by processor: a field of its control register. To nearest is 0 on all."""

NEAREST = 0

SHARE = 1.0 / 3.0
"""Of the larger of the two differences is the error to nearest: an operation rounded to nearest is off by a quarter of its last
place in the mean, by half of it in a directed mode, and always to the same side; measured, see docs/theory.md, section 9."""

UNIT = 2.0**-53
"""Rounding of one operation to nearest, relative: the least error that a number has."""

ELEMENTARY = (*named("numpy", lambda e: e.rounds), "power")
"""Functions of NumPy's that are computed to nearest in any mode: their own algorithms may count on it."""


@functools.cache
def _library() -> Any:
    """The C library of this process."""
    return ctypes.CDLL(None)


@contextlib.contextmanager
def rounding(direction: str) -> Iterator[None]:
    """Every operation of this thread rounded up or down; afterwards as before, whatever happens."""
    library = _library()
    before = library.fegetround()
    try:
        library.fesetround(MODES[platform.machine()][DIRECTED.index(direction)])
        yield
    finally:
        library.fesetround(before)


@functools.cache
def can_round() -> bool:
    """Whether rounding can be directed on this machine: tried on sums whose results are known."""
    one, little = np.float64(1.0), np.float64(2.0**-60)
    try:
        found = []
        for direction in DIRECTED:
            with rounding(direction):
                found.append((float(one + little) > 1.0, float(-one - little) < -1.0))
    except (OSError, AttributeError, KeyError, TypeError):  # no such processor, library, or function in it
        return False
    return found == [(True, False), (False, True)] and float(one + little) == 1.0


class NearestFunctions:
    """NumPy, with elementary functions that round to nearest in any mode."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        return to_nearest(found) if name in ELEMENTARY else found


def to_nearest(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that rounds to nearest in any mode."""

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
    """Estimates of the rounding errors of results, entry by entry; infinite where a result is not finite.

    Parameters
    ----------
    compute : callable
        Computes the results anew; called once for each of `DIRECTED`.
    nearest : arrays
        The results to nearest.

    Returns
    -------
    list of array
        At least `UNIT` of each entry.
    """
    errors = [UNIT * np.abs(x) for x in nearest]
    for direction in DIRECTED:
        try:
            with rounding(direction):
                found = compute()
        except np.linalg.LinAlgError:  # what is left of a pivot is rounding
            return [np.full(x.shape, np.inf) for x in nearest]
        with np.errstate(all="ignore"):
            off = [SHARE * np.abs(x - y) for x, y in zip(found, nearest, strict=True)]
        errors = [np.fmax(a, np.where(np.isfinite(b), b, np.inf)) for a, b in zip(errors, off, strict=True)]
    return errors
