"""Jumps of functions of time, given as expression trees, and of their rates; for the model reader and generated packages.

A function with branches may jump, or have a kink, where a switching function is zero, such as ``t - 0.5`` in ``max(0, t - 0.5)``.
At such a time, the function is evaluated from both sides, with the branches of each side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .elementary import ON_ARRAYS, TABLE, Tree, tree_of

Array = NDArray[np.float64]

BESIDE, FAR_BESIDE = 1e-9, 1e-5
"""Distances from a time, multiplied by `_scale`: one for the choice of branches, one for extrapolating values that are not
finite there."""

JUMP = 1e-7
"""Fraction of the largest nearby value below which a jump counts as a rounding error."""

NEAR_BY = np.concatenate([np.logspace(-8, -1, 15), -np.logspace(-8, -1, 15)])
"""Distances at which nearby values are evaluated: in s up to a time of 1 s, then relative to the time."""

Pair = tuple[Any, Any]
"""A value and its rate, both numbers or both arrays."""

Known = Callable[[Array], Mapping[str, Pair]]
"""A function that returns values and rates of variables at given times."""


class Jump(NamedTuple):
    """A jump of a function (order 0) or of its rate (order 1), at the time of index `at`."""

    at: int
    order: int
    before: float
    after: float


def from_to(before: float, after: float) -> str:
    """The text ``from A to B``, with enough digits to tell A from B."""
    digits = next(d for d in (6, 9, 17) if f"{before:.{d}g}" != f"{after:.{d}g}")
    return f"from {before:.{digits}g} to {after:.{digits}g}"


def switched(tree: Tree) -> Iterator[tuple[Tree, Tree]]:
    """Nodes of a tree at which the function may not be smooth, with their switching functions; each node once, inner
    nodes first."""
    seen: set[Tree] = set()

    def of(tree: Tree) -> Iterator[tuple[Tree, Tree]]:
        kind = tree[0]
        if kind in ("number", "name") or tree in seen:
            return
        seen.add(tree)
        arguments = tree[2 if kind == "call" else 1 :]
        for a in arguments:
            yield from of(a)
        if kind == "call":
            e = TABLE.get({"at_least": "max", "wrapped": "mod"}.get(str(tree[1]), str(tree[1])))
            if e is not None and e.switching is not None:
                yield tree, tree_of(e.switching, arguments)
        elif kind == "**" and not (tree[2][0] == "number" and isinstance(tree[2][1], int)):
            yield tree, tree[1]

    yield from of(tree)


def zeros(s: Tree, known: Known, times: Array, end: float, most: int | None = None) -> Iterator[float]:
    """Zeros of a switching function from the first of the times to `end`, including zeros without a change of sign.

    Zeros of linear functions are exact; other functions are evaluated at the times. `most` limits the number of changes
    of sign.
    """

    def f(t: Array) -> Array:
        return evaluated(s, known(t), t.shape)[0]

    if (rate := _constant_rate(s, known, times[:1])) is not None:
        t = float(times[0] - f(times[:1])[0] / rate) if rate and math.isfinite(rate) else math.nan
        if times[0] <= t <= end:
            yield t
        return
    if not np.isfinite(of := f(times)).any() or not of.any():
        return
    extremes = np.array(list(changes(lambda t: evaluated(s, known(t), t.shape)[1], times, most)))
    yield from changes(f, np.union1d(times, extremes), most)
    if len(extremes):
        size = np.abs(_finite(of)).max(initial=0.0)
        yield from extremes[np.abs(f(extremes)) <= 1e-12 * size].tolist()


def _constant_rate(s: Tree, known: Known, t: Array) -> float | None:
    """The rate of a function that is linear in time and depends on no other variable; None for other functions."""
    names = known(t)

    def degree(tree: Tree) -> int:
        """Degree in time: 0 or 1; 2 stands for higher and unknown degrees."""
        kind = tree[0]
        if kind == "number":
            return 0
        if kind == "name":
            return 1 if tree[1] == "t" else 0 if np.ndim(names[tree[1]][0]) == 0 else 2
        of = [degree(a) for a in tree[2 if kind == "call" else 1 :]]
        if kind in ("+", "-", "neg"):
            return max(of)
        if kind == "*" or (kind == "/" and not of[1]):
            return min(sum(of), 2)
        return 2 if any(of) else 0

    return float(evaluated(s, names, t.shape)[1][0]) if degree(s) < 2 else None


def changes(f: Callable[[Array], Array], t: Array, most: int | None = None) -> Iterator[float]:
    """Elements of t where a function is zero, then arguments between them where it changes its sign; at most `most` of each."""
    of = f(t)
    sign = np.sign(of)
    yield from t[sign == 0.0][:most].tolist()
    at = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)[:most]
    if not len(at):
        return
    low, high, first = t[at], t[at + 1], sign[at]
    guess = low - of[at] * (high - low) / (of[at + 1] - of[at])  # by linear interpolation
    apart = 4.0 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    beside = np.concatenate([np.maximum(guess - apart, low), np.minimum(guess + apart, high)])
    before, after = np.sign(f(beside)).reshape(2, -1)
    between = (before == first) & (after == sign[at + 1])
    low, high = np.where(between, beside.reshape(2, -1), [low, high])
    while ((low < (middle := 0.5 * (low + high))) & (middle < high)).any():  # bisection
        same = np.sign(f(middle)) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    yield from high.tolist()


# -- one-sided limits -------------------------------------------------------------------------------------------------


def jumps(tree: Tree, known: Known, t: Array) -> list[Jump]:
    """Jumps of a function in the order of their times, and jumps of its rate where the function itself does not
    jump."""
    found: dict[int, Jump] = {}
    for order in (0, 1):
        before, after = (_beside(tree, known, t, side, order) for side in (-1.0, 1.0))
        size = np.maximum(np.abs(before), np.abs(after))
        with np.errstate(invalid="ignore"):
            at = np.flatnonzero(np.isfinite(size) & (np.abs(after - before) > JUMP * size))
        if len(at):
            near_by = t[at, None] + NEAR_BY * np.maximum(np.abs(t[at]), 1.0)[:, None]
            around = np.abs(_finite(evaluated(tree, known(near_by), near_by.shape)[order])).max(axis=1)
            at = at[np.abs(after - before)[at] > JUMP * np.maximum(around, size[at])]
        for i in at.tolist():
            found.setdefault(i, Jump(i, order, float(before[i]), float(after[i])))
    return sorted(found.values())


def _beside(tree: Tree, known: Known, t: Array, side: float, order: int) -> Array:
    """Values or rates at times, on the branch of the given side; limits from that side where the values are undefined."""
    step = _scale(t, 1e-6) * BESIDE * side
    both = np.stack([t, t + step])
    here: Array = evaluated(tree, known(both), both.shape, True)[order][0]
    if np.isfinite(here).all():
        return here
    far = _scale(t, 1e-3) * FAR_BESIDE * side
    near, farther = (evaluated(tree, known(t + x * far), t.shape)[order] for x in (1.0, 2.0))
    with np.errstate(invalid="ignore"):  # both values may be infinite
        return np.where(np.isfinite(here), here, 2.0 * near - farther)


def _scale(t: Array, least: float) -> Array:
    """The time up to 1 s, then its root: distances stay above rounding errors, and below the pieces of fast functions, such
    as the segments of a cam's table."""
    t = np.abs(t)
    return np.maximum(np.minimum(t, np.sqrt(t)), least)


def _finite(x: Array) -> Array:
    return np.where(np.isfinite(x), x, 0.0)


# -- values and rates -------------------------------------------------------------------------------------------------


def evaluated(
    tree: Tree, known: Mapping[str, Pair], shape: tuple[int, ...], sided: bool = False
) -> tuple[Array, Array]:
    """Values and rates of a tree; if `sided`, both are (2, n), and the first row is computed with the branches of the second."""
    with np.errstate(all="ignore"):
        x, dx = _pair(tree, known, lambda c: np.broadcast_to(c, shape)[1] if sided else c)
    return np.broadcast_to(np.asarray(x, float), shape), np.broadcast_to(np.asarray(dx, float), shape)


def _pair(tree: Tree, known: Mapping[str, Pair], taken: Callable[[Any], Any]) -> Pair:
    kind = tree[0]
    if kind == "number":
        return np.float64(tree[1]), 0.0
    if kind == "name":
        return known[tree[1]]
    if kind == "call":
        return _function(tree[1], [_pair(a, known, taken) for a in tree[2:]], taken)
    a, da = _pair(tree[1], known, taken)
    if kind == "neg":
        return -a, -da
    b, db = _pair(tree[2], known, taken)
    match kind:
        case "+":
            return a + b, da + db
        case "-":
            return a - b, da - db
        case "*":
            return a * b, da * b + a * db
        case "/":
            return np.divide(a, b), np.divide(da - np.divide(a, b) * db, b)
        case _:
            x = np.power(a, b)
            return x, b * np.power(a, b - 1.0) * da + (x * np.log(a) * db if np.any(db) else 0.0)


def _function(name: str, of: list[Pair], taken: Callable[[Any], Any]) -> Pair:
    a, da = of[0]
    if name == "choice":
        x, dx = (np.where(a != 0.0, x, y) for x, y in zip(of[1], of[2], strict=True))
        return x, dx
    if name == "vanishing":
        b, db = of[1]
        return np.where(a == 0.0, 0.0, a * b), np.where(da == 0.0, 0.0, da * b) + np.where(a == 0.0, 0.0, a * db)
    if name in ("mod", "wrapped"):
        b, db = of[1]
        turns = np.floor(taken(a) / taken(b))
        return a - turns * b, da - turns * db
    if name in ("min", "max", "at_least", "atan2"):
        b, db = of[1]
        above = taken(a - b) > 0.0
        match name:
            case "max":
                return np.where(above, a, b), np.where(above, da, db)
            case "min":
                return np.where(above, b, a), np.where(above, db, da)
            case "at_least":
                return np.where(taken(a - b) >= 0.0, 1.0, 0.0), 0.0
            case _:
                up = np.copysign(np.abs(a), taken(a))
                return np.arctan2(up, b), (b * da - a * db) / (a * a + b * b)
    if name == "abs":
        sign = np.where(taken(a) < 0.0, -1.0, 1.0)
        return sign * a, sign * da
    if name == "sign":
        return np.sign(taken(a)) + 0.0 * a, 0.0
    if name not in TABLE:
        raise ValueError(f"the prescribed motion contains the unknown function {name!r}")
    x = getattr(ON_ARRAYS, name)(a)
    return x, TABLE[name].slopes[0](ON_ARRAYS, x, a) * da


__all__ = ["Known", "Pair", "changes", "evaluated", "from_to", "jumps", "switched", "zeros"]
