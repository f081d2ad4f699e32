"""Choice of dependent speeds: well-conditioned columns of a closure matrix, near the cut.

The elimination is a pivoted Gram-Schmidt with re-orthogonalisation (the paper's Eqs. 33-38, done stably). The pivot is not
the largest column but the first in a given order, from the cut inward, that is not much smaller than the largest among
its neighbours: that keeps an ear short.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, islice, product

import numpy as np

from ..model.vectors import Array
from .geometry import Geometry

RANK_TOLERANCE = 1e-7
"""Singular values below this part of the largest count as zero: well above the rounding of the assembly, well
below those of a closure matrix half a degree from a singular pose."""

WINDOWS = (10, 30, 100)
"""Number of useful columns that compete for a pivot, in order of trial."""

THRESHOLDS = (0.05, 0.3, 1.0)
"""A column is taken if it is at least this part of the best in the window, in order of trial."""

GOOD_CONDITION = 20.0
"""Condition below which no other choice is sought; above it, one 4 times better is worth twice the distance from the cut."""

MAX_COMBINATIONS = 500
"""Number of ways of making whole quaternion joints dependent that are tried."""

MAX_SERVING = 8
"""Number of ways that serve and are compared."""

MAX_DIVIDED = 6
"""Number of rotations or displacements that are tried as the only divided one."""


def ranks(A: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Numerical ranks ``(S,)`` of matrices ``(S, rows, f)`` whose entries are of order one."""
    if 0 in A.shape:
        return np.zeros(len(A), dtype=int)
    s = np.linalg.svd(A, compute_uv=False)
    return np.sum(s > tolerance * np.maximum(s[:, :1], tolerance), axis=1)


def conditions(A: Array) -> Array:
    """Condition ``(S,)`` of the columns of dependent speeds, ``(S, rows, f)``, scaled: section 4.7 of the theory page.

    How far dependent speeds follow what opens the loop by one, in parts of the least that f of them can: the Frobenius norm
    of the inverse times that of the matrix, or of a unit matrix if it is smaller, over f. So it grows too where the columns
    become small all together; of a single column it is one over its length.
    """
    f = A.shape[-1]
    if 0 in A.shape:
        return np.ones(len(A))
    s = np.linalg.svd(A, compute_uv=False)
    with np.errstate(divide="ignore", over="ignore"):
        inverse = np.sqrt(np.sum(1 / s**2, axis=1)) if s.shape[1] == f else np.full(len(s), np.inf)
        size = np.sqrt(np.maximum(np.sum(s**2, axis=1), f)) / f if f > 1 else 1.0
        found: Array = np.maximum(inverse * size, 1.0)
    return np.where(np.isfinite(found), found, np.inf)


def condition(A: Array) -> float:
    """The worst condition of matrices ``(S, rows, f)``."""
    return float(np.max(conditions(A), initial=1.0))


def whole_joints(geometry: Geometry, speeds: Array, columns: Array) -> list[tuple[int, ...]]:
    """Columns in the order given, those of a quaternion joint together; `speeds` are the speeds of the columns."""
    joints: dict[int, list[int]] = {}
    for c in map(int, columns):
        s = int(speeds[c])
        k = int(geometry.speed_body[s])
        joints.setdefault(k if geometry.whole[k] else geometry.ground + s, []).append(c)
    return [tuple(x) for x in joints.values()]


def divided_joints(joints: Sequence[tuple[int, ...]]) -> Iterator[list[tuple[int, ...]]]:
    """The same columns with quaternion joints divided, with the fewest divisions first.

    Rotations and displacements of free joints apart; then single columns of one such group, those near the cut first; then
    single columns of all.
    """
    groups = [part for columns in joints for part in ((columns[:3], columns[3:]) if len(columns) == 6 else (columns,))]
    if len(groups) > len(joints):
        yield groups
    several = [i for i, columns in enumerate(groups) if len(columns) > 1]
    for i in several[:MAX_DIVIDED] if len(several) > 1 else ():
        yield [*groups[:i], *((c,) for c in groups[i]), *groups[i + 1 :]]
    yield [(c,) for columns in groups for c in columns]


def divide(A: Array, joints: Sequence[tuple[int, ...]], rank: int) -> list[int]:
    """Columns that span A, as `choose_dependents` finds them, with as few quaternion joints divided as possible."""
    best: list[int] = []
    lowest = float("inf")
    for parts in divided_joints(joints):
        chosen = choose_dependents(A, parts, rank)
        if chosen is None:
            continue
        found = condition(A[..., chosen])
        if not best or found < lowest:
            best, lowest = chosen, found
        if lowest < GOOD_CONDITION:
            break
    return best


def choose_dependents(A: Array, joints: Sequence[tuple[int, ...]], rank: int, dense: bool = False) -> list[int] | None:
    """Columns that span A.

    Parameters
    ----------
    A : (S, rows, f) array
        Closure matrices at S configurations, columns scaled, each of rank `rank`.
    joints : sequence of tuple of int
        The columns in order of preference; several together are taken together or not at all.
    rank : int
    dense : bool
        Whether the way from the cut hardly matters: a condition twice as good is worth twice the way.

    Returns
    -------
    list of int or None
        `rank` columns; None if whole joints do not add up to the rank.
    """
    single = [c for columns in joints if len(columns) == 1 for c in columns]
    several = [columns for columns in joints if len(columns) > 1]
    place = {c: i for i, c in enumerate(c for columns in joints for c in columns)}
    weight = 1.0 if dense else 0.5
    best: list[int] | None = None
    lowest = float("inf")
    serving = 0
    for together in islice(_sums(several, rank), MAX_COMBINATIONS):
        taken = [c for columns in together for c in columns]
        if len(taken) > rank or (taken and np.any(ranks(A[..., taken]) < len(taken))):
            continue
        if np.any(ranks(A[..., taken + single]) < rank):
            continue
        serving += 1
        chosen = _extend(A, taken, single, rank, weight)
        found = condition(A[..., chosen])
        price = found**weight * (1 + max((place[c] for c in chosen), default=0))
        if price < lowest:
            best, lowest = chosen, price
        if found < GOOD_CONDITION or serving == MAX_SERVING:
            break
    return best


def _sums(several: list[tuple[int, ...]], rank: int) -> Iterable[tuple[tuple[int, ...], ...]]:
    """Sets of joints to take as a whole, the smallest first, those near the cut first."""
    for count in range(len(several) + 1):
        if count and count * min(map(len, several)) > rank:
            return
        yield from combinations(several, count)


def _extend(A: Array, taken: list[int], single: list[int], rank: int, weight: float) -> list[int]:
    """`taken` and as many of `single` as complete the rank: a good condition, not far from the cut."""
    if len(taken) == rank:
        return taken
    if len(taken) + len(single) == rank:
        return taken + single
    best, lowest = taken, float("inf")
    place = {c: i for i, c in enumerate(single)}
    for window, threshold in product(WINDOWS, THRESHOLDS):
        chosen = _eliminate(A, taken, single, rank, window, threshold)
        found = condition(A[..., chosen])
        price = found**weight * (1 + max(place[c] for c in chosen[len(taken) :]))
        if price < lowest:
            best, lowest = chosen, price
        if found < GOOD_CONDITION or (len(single) <= window and threshold == 1):
            break
    return best


def _eliminate(A: Array, taken: list[int], single: list[int], rank: int, window: int, threshold: float) -> list[int]:
    """One elimination; see the module."""
    chosen = list(taken)
    rest = A[..., single].copy()
    basis: list[Array] = []
    for c in taken:
        _orthogonalise(rest, basis, A[..., c])
    while len(chosen) < rank:
        size = np.min(np.linalg.norm(rest, axis=1), axis=0)
        useful = np.flatnonzero(size > RANK_TOLERANCE * 10)[:window]
        if not len(useful):  # full rank in sum but not column by column: the tolerance of ranks decides
            useful = np.array([int(np.argmax(size))])
        pivot = useful[np.argmax(size[useful] >= threshold * np.max(size[useful]))]
        chosen.append(single[pivot])
        _orthogonalise(rest, basis, rest[..., pivot].copy())
        rest[..., pivot] = 0
    return chosen


def columns_at_all(A: Array, rank: int) -> list[int]:
    """Columns of ``(S, rows, f)`` by an elimination that always takes the largest column of the worst matrix."""
    return _eliminate(A, [], list(range(A.shape[2])), rank, A.shape[2], 1.0)


def pivoted_columns(A: Array, rank: int) -> Array:
    """Columns ``(S, rank)`` that a Gram-Schmidt process with column pivoting takes of each matrix ``(S, rows, f)``."""
    rest, basis = A.copy(), list[Array]()
    chosen = np.empty((len(A), rank), dtype=int)
    for i in range(rank):
        chosen[:, i] = pivot = np.argmax(np.linalg.norm(rest, axis=1), axis=1)
        _orthogonalise(rest, basis, np.take_along_axis(rest, pivot[:, None, None], axis=2)[..., 0])
        np.put_along_axis(rest, np.broadcast_to(pivot[:, None, None], (*rest.shape[:2], 1)), 0.0, axis=2)
    return chosen


def _orthogonalise(rest: Array, basis: list[Array], column: Array) -> None:
    """Add a column ``(S, rows)`` to the orthonormal basis, and project it out of the rest ``(S, rows, f)``."""
    for _ in range(2):  # a second time, for the rounding of the first
        for b in basis:
            column = column - np.sum(b * column, axis=1, keepdims=True) * b
    b = column / np.maximum(np.linalg.norm(column, axis=1, keepdims=True), 1e-300)
    basis.append(b)
    rest -= b[..., None] * (b[:, None] @ rest)
