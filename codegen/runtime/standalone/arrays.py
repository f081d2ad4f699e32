"""Arrays: their names in signatures, whether their numbers are finite, and what of them belongs to one state of a batch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
SCALARS = {"float64": "double", "float32": "float"}
"""What C calls the types of numbers, by those of arrays."""

Indices = NDArray[np.intp]
Shape = tuple[int, ...]
Numbers = ArrayLike | Mapping[str, ArrayLike] | None
"""What a caller may give: an array, or some of its entries by name; None for what is left out."""
Times = ArrayLike
"""The same for the time, of which there is one."""


def dtype_of(manifest: Mapping[str, Any]) -> Any:
    """The type of the numbers of a package."""
    return np.dtype(manifest.get("scalar", "float64"))


FEW = 32
"""So many numbers are looked at one by one in less time than NumPy takes to begin."""


def is_finite(x: Array) -> bool:
    """Whether all numbers of a row are finite, without arithmetic that could overflow."""
    return all(map(math.isfinite, x.tolist())) if len(x) <= FEW else bool(np.isfinite(x).all())


def largest(x: Array) -> float:
    """The largest size of an entry; 0 where there is none."""
    flat = x.reshape(-1)
    return max(map(abs, flat.tolist()), default=0.0) if len(flat) <= FEW else float(np.abs(flat).max())


LONG = 4096
"""Numbers up to which a product tells sooner. Longer ones go to the threads of BLAS, and whoever asked spins until they have had
a core: 4 ms each time where others want it too, for what takes 20 us."""


def all_finite(x: Array) -> bool:
    """The same for any number of axes, and for numbers that are objects."""
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
    """An array without the repetitions that broadcasting has made."""
    if 0 not in x.strides:
        return x
    return x[tuple(slice(None) if step else slice(0, 1) for step in x.strides)]


def of_state(x: Array, batch: Shape, at: tuple[int, ...], rows: int) -> Array:
    """What belongs to a state of a batch, after so many axes in front."""
    missing = len(batch) + rows + 1 - x.ndim
    x = x.reshape(*x.shape[:rows], *(1,) * missing, *x.shape[rows:])
    whole = np.broadcast_to(x, (*x.shape[:rows], *batch, x.shape[-1]))
    return whole[(slice(None),) * rows + at]


def filled(shape: Shape, x: Any, dtype: Any = np.float64) -> Array:
    """A new array of that shape, x repeated in it as broadcasting does; in a fifth of the time of `numpy.broadcast_to`."""
    found: Array = np.empty(shape, dtype)
    found[...] = x
    return found


def lengths(e: Array) -> Array:
    """Lengths of quaternions (..., 4), as (..., 1); their squares may be beyond floating-point numbers."""
    largest = np.abs(e).max(axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        e = e / largest
        return largest * np.sqrt(np.add.reduce(e * e, axis=-1, keepdims=True))


def normalise(q: Array, quaternions: tuple[int, ...]) -> None:
    """Give the quaternions that begin at these entries of q (..., nq) length one."""
    for i in quaternions:
        e = q[..., i : i + 4]
        e /= np.abs(e).max(axis=-1, keepdims=True)
        e /= lengths(e)
