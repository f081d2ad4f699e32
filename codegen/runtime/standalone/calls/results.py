"""Arrays for results: new arrays, or those that the caller passes as ``out=``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Shape


def empty(shape: Shape, dtype: Any = np.float64) -> Array:
    """A new array for results.

    Raises
    ------
    MemoryError
        If the array is too large; the message gives its size.
    """
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError):
        size = math.prod(shape) * 8 / 2**30
        raise MemoryError(
            f"results of shape {shape} take {size:,.0f} GiB, more than there is; use fewer states or directions per call"
        ) from None


def places(out: Any, names: Sequence[str], shapes: Sequence[Shape], dtype: Any = np.float64) -> list[Array]:
    """The arrays that the caller passes as ``out=``, after checks."""
    if not isinstance(out, (tuple, list)) or len(out) != len(names):
        raise ValueError(f"out is {type(out).__name__}, expected a tuple of {len(names)} arrays: {', '.join(names)}")
    for name, x, shape in zip(names, out, shapes, strict=True):
        if not isinstance(x, np.ndarray) or isinstance(x, np.ma.MaskedArray):  # its mask would not be updated
            seen = f"is {type(x).__name__}"
        elif x.dtype != dtype or x.shape != shape:
            seen = f"holds {x.dtype} and has shape {x.shape}"
        elif not x.flags.carray:
            seen = "is read-only, not contiguous or not aligned"
        else:
            continue
        wanted = f"expected a writeable C-contiguous array of {np.dtype(dtype)} of shape {shape}"
        raise ValueError(f"out ({name}) {seen}, {wanted}")
    if both := overlapping(out):
        first, second = (names[i] for i in both)
        raise ValueError(
            f"out ({first}) and out ({second}) share memory, so that one result would overwrite the other; expected arrays that "
            f"do not overlap"
        )
    return list(out)


def overlapping(arrays: Iterable[Array]) -> tuple[int, int] | None:
    """Indices of two contiguous arrays that share memory; None if no two do."""
    for (i, a), (j, b) in itertools.combinations(enumerate(arrays), 2):
        if np.may_share_memory(a, b):
            return i, j
    return None


def overlap(taken: Sequence[Array], arrays: Mapping[str, Any]) -> bool:
    """Whether writing the results would overwrite arguments that are still needed."""
    if not taken:
        return False
    for x in arrays.values():
        if isinstance(x, np.ndarray):
            for place in taken:
                if np.may_share_memory(place, x):
                    return True
    return False


def put(results: Sequence[Array], out: Sequence[Array]) -> list[Array]:
    """Copies results into the arrays of ``out`` and returns these arrays; without ``out``, returns the results."""
    for place, result in zip(out, results, strict=False):
        if place is not result:
            place[...] = result
    return list(out) or list(results)
