"""Choice of dependent speeds: well-conditioned columns of a closure matrix, belonging to joints near the cut.

The elimination is a pivoted Gram-Schmidt process with re-orthogonalisation (a stable form of the paper's Eqs. 33-38). The
columns are ordered from the cut inward. The pivot is the first column that is not much smaller than the largest among the
next few. This choice keeps an ear short.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, islice, product

import numpy as np

from ..model.vectors import Array
from .geometry import Geometry

RANK_TOLERANCE = 1e-7
"""Singular values below this fraction of the largest count as zero. This is well above the rounding errors of assembly, and
well below the singular values of a closure matrix half a degree from a singular pose."""

WINDOWS = (10, 30, 100)
"""Numbers of nonzero columns that compete for a pivot, in the order in which they are tried."""

THRESHOLDS = (0.05, 0.3, 1.0)
"""Fractions of the largest norm in the window that a pivot column must reach, in the order in which they are tried."""

GOOD_CONDITION = 20.0
"""Condition number that ends the search. Above it, a condition number that is 4 times smaller outweighs twice the
distance from the cut."""

MAX_COMBINATIONS = 500
"""Largest number of combinations of whole quaternion joints that are tried as dependent."""

MAX_SERVING = 8
"""Largest number of combinations, with columns that span the range of A, that are compared."""

MAX_DIVIDED = 6
"""Largest number of rotations or displacements that are tried one by one as the only divided group."""


def ranks(A: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Numerical ranks ``(S,)`` of matrices ``(S, rows, f)`` whose entries are of order one."""
    if 0 in A.shape:
        return np.zeros(len(A), dtype=int)
    s = np.linalg.svd(A, compute_uv=False)
    return np.sum(s > tolerance * np.maximum(s[:, :1], tolerance), axis=1)


def conditions(A: Array) -> Array:
    """Condition numbers ``(S,)`` of the scaled columns of dependent speeds, ``(S, rows, f)``; see section 4.7 of the theory page.

    The number measures how far f dependent speeds move per unit violation of the conditions, relative to the smallest
    possible value. It is the product of the Frobenius norms of the inverse and of the matrix (at least of a unit
    matrix), divided by f. So the number also grows if all columns become small together; for a single column it is one
    over the column's length.
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
    """The worst condition number of matrices ``(S, rows, f)``."""
    return float(np.max(conditions(A), initial=1.0))


def whole_joints(geometry: Geometry, speeds: Array, columns: Array) -> list[tuple[int, ...]]:
    """Columns in the given order, where columns of one quaternion joint are kept together; `speeds` are the speeds of
    all columns."""
    joints: dict[int, list[int]] = {}
    for c in map(int, columns):
        s = int(speeds[c])
        k = int(geometry.speed_body[s])
        joints.setdefault(k if geometry.whole[k] else geometry.ground + s, []).append(c)
    return [tuple(x) for x in joints.values()]


def divided_joints(joints: Sequence[tuple[int, ...]]) -> Iterator[list[tuple[int, ...]]]:
    """Ways to divide the quaternion joints among some columns, the fewest divisions first.

    First, rotations and displacements of free joints are separated. Then one such group is divided into single columns, those
    near the cut first. Last, all groups are divided.
    """
    groups = [part for columns in joints for part in ((columns[:3], columns[3:]) if len(columns) == 6 else (columns,))]
    if len(groups) > len(joints):
        yield groups
    several = [i for i, columns in enumerate(groups) if len(columns) > 1]
    for i in several[:MAX_DIVIDED] if len(several) > 1 else ():
        yield [*groups[:i], *((c,) for c in groups[i]), *groups[i + 1 :]]
    yield [(c,) for columns in groups for c in columns]


def divide(A: Array, joints: Sequence[tuple[int, ...]], rank: int) -> list[int]:
    """Columns that span the range of A and divide few quaternion joints; found as in `choose_dependents`."""
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
    """Choose columns that span the range of A.

    Parameters
    ----------
    A : (S, rows, f) array
        Closure matrices at S configurations, columns scaled, each of rank `rank`.
    joints : sequence of tuple of int
        The columns in order of preference; those of one tuple are taken together or not at all.
    rank : int
    dense : bool
        Whether the distance from the cut has less weight: half the condition number then outweighs twice the distance.

    Returns
    -------
    list of int or None
        `rank` columns; None if no combination of whole joints adds up to the rank.
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
    """Sets of joints that are taken whole, smallest sets first; of sets of equal size, those near the cut come
    first."""
    for count in range(len(several) + 1):
        if count and count * min(map(len, several)) > rank:
            return
        yield from combinations(several, count)


def _extend(A: Array, taken: list[int], single: list[int], rank: int, weight: float) -> list[int]:
    """The columns `taken`, plus columns among `single` that complete the rank, well conditioned and not far from the
    cut."""
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
    """The columns `taken` and the columns that one elimination adds; the module's docstring explains the pivots."""
    chosen = list(taken)
    rest = A[..., single].copy()
    basis: list[Array] = []
    for c in taken:
        _orthogonalise(rest, basis, A[..., c])
    while len(chosen) < rank:
        size = np.min(np.linalg.norm(rest, axis=1), axis=0)
        useful = np.flatnonzero(size > RANK_TOLERANCE * 10)[:window]
        if not len(useful):  # `ranks` has found full rank, so the longest column is taken, however short
            useful = np.array([int(np.argmax(size))])
        pivot = useful[np.argmax(size[useful] >= threshold * np.max(size[useful]))]
        chosen.append(single[pivot])
        _orthogonalise(rest, basis, rest[..., pivot].copy())
        rest[..., pivot] = 0
    return chosen


def columns_at_all(A: Array, rank: int) -> list[int]:
    """Columns of ``(S, rows, f)`` from an elimination whose pivot is the column with the largest minimum norm over
    S."""
    return _eliminate(A, [], list(range(A.shape[2])), rank, A.shape[2], 1.0)


def pivoted_columns(A: Array, rank: int) -> Array:
    """Columns ``(S, rank)`` that Gram-Schmidt with column pivoting selects in each matrix ``(S, rows, f)``."""
    rest, basis = A.copy(), list[Array]()
    chosen = np.empty((len(A), rank), dtype=int)
    for i in range(rank):
        chosen[:, i] = pivot = np.argmax(np.linalg.norm(rest, axis=1), axis=1)
        _orthogonalise(rest, basis, np.take_along_axis(rest, pivot[:, None, None], axis=2)[..., 0])
        np.put_along_axis(rest, np.broadcast_to(pivot[:, None, None], (*rest.shape[:2], 1)), 0.0, axis=2)
    return chosen


def _orthogonalise(rest: Array, basis: list[Array], column: Array) -> None:
    """Adds a column ``(S, rows)`` to the orthonormal basis, and removes it from the other columns ``(S, rows, f)``."""
    for _ in range(2):  # the second pass removes the rounding errors of the first
        for b in basis:
            column = column - np.sum(b * column, axis=1, keepdims=True) * b
    b = column / np.maximum(np.linalg.norm(column, axis=1, keepdims=True), 1e-300)
    basis.append(b)
    rest -= b[..., None] * (b[:, None] @ rest)
