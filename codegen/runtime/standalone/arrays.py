"""Arrays of the run time: types, tests for finite numbers, states of a batch, and quaternions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
C_TYPES = {"f": "float", "d": "double", "g": "long double"}
"""Real types of C, by NumPy's characters for them."""

Indices = NDArray[np.intp]
Shape = tuple[int, ...]
Numbers = ArrayLike | Mapping[str, ArrayLike] | None
"""Numbers from the user: an array, a mapping with some entries by name, or None for the default."""
Times = ArrayLike
"""The time, or an array of times."""


def dtype_of(manifest: Mapping[str, Any]) -> Any:
    """NumPy's dtype of the scalar type of a package."""
    return np.dtype(manifest.get("scalar", "float64"))


FEW = 32
"""Largest length at which a Python loop over the entries is faster than a call of NumPy."""


def is_finite(x: Array) -> bool:
    """Whether all entries of a one-dimensional array are finite; no intermediate result can overflow."""
    return all(map(math.isfinite, x.tolist())) if len(x) <= FEW else bool(np.isfinite(x).all())


def largest(x: Array) -> float:
    """The largest magnitude of an entry; 0 for an empty array."""
    flat = x.reshape(-1)
    return max(map(abs, flat.tolist()), default=0.0) if len(flat) <= FEW else float(np.abs(flat).max())


LONG = 4096
"""Up to this length, a dot product is the faster test for finite numbers. For longer arrays BLAS starts threads, which
may cost 4 ms on a busy machine for work of 20 us."""


def all_finite(x: Array) -> bool:
    """Whether all entries are finite, for any number of axes, and for objects as entries."""
    flat = x.reshape(-1)
    if x.dtype == object:
        return all(e - e == 0 for e in flat)
    if len(flat) <= FEW:
        return all(map(math.isfinite, flat.tolist()))
    if len(flat) <= LONG:
        with np.errstate(all="ignore"):
            if math.isfinite(flat.dot(flat)):
                return True
    return bool(np.isfinite(x).all())


def once(x: Array) -> Array:
    """The array without repetitions by broadcasting: axes along which it repeats have length 1."""
    if 0 not in x.strides:
        return x
    return x[tuple(slice(None) if step else slice(0, 1) for step in x.strides)]


def of_state(x: Array, batch: Shape, at: tuple[int, ...], rows: int) -> Array:
    """The entries of one state of a batch; `rows` axes come before those of the batch."""
    missing = len(batch) + rows + 1 - x.ndim
    x = x.reshape(*x.shape[:rows], *(1,) * missing, *x.shape[rows:])
    whole = np.broadcast_to(x, (*x.shape[:rows], *batch, x.shape[-1]))
    return whole[(slice(None),) * rows + at]


def filled(shape: Shape, x: Any, dtype: Any = np.float64) -> Array:
    """A new array with x broadcast to `shape`; five times as fast as `numpy.broadcast_to`."""
    found: Array = np.empty(shape, dtype)
    found[...] = x
    return found


def lengths(e: Array) -> Array:
    """Norms of quaternions (..., 4), as (..., 1), without overflow or underflow."""
    largest = np.abs(e).max(axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        e = e / largest
        return largest * np.sqrt(np.add.reduce(e * e, axis=-1, keepdims=True))


def normalise(q: Array, quaternions: tuple[int, ...]) -> None:
    """Normalises, in place, the quaternions that begin at these entries of q (..., nq)."""
    for i in quaternions:
        e = q[..., i : i + 4]
        e /= np.abs(e).max(axis=-1, keepdims=True)
        e /= lengths(e)
