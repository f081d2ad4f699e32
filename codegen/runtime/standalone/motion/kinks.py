"""Tests whether prescribed motion with branches has a jump in velocity during a motion, at its parameters and inputs.

The model reader tests the default parameters. Here, the impulse of a jump would be ignored, so a motion ends before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ....elementary import ON_ARRAYS, TABLE, tree_of
from ..arrays import Array
from .inputs import Inputs

SAMPLES = 2000
"""Number of times at which switching functions are evaluated; linear ones are solved exactly, extrema are refined."""

BESIDE, FAR_BESIDE = 1e-9, 1e-5
"""Relative distance from a time at which its branches are evaluated; and the distance where no derivative exists at the time."""

JUMP = 1e-7
"""Jumps below this fraction of the largest nearby value are rounding errors."""

NEAR_BY = np.concatenate([np.logspace(-8, -1, 15), -np.logspace(-8, -1, 15)])
"""Distances at which nearby values are evaluated, in s, or relative for later times."""

Pair = tuple[Any, Any]
"""Values and their rates, as numbers or arrays."""

Switches = dict[str, Callable[..., Pair]]
Known = Callable[[Array], Mapping[str, Pair]]
"""Returns values and rates of variables at given times."""


def first_kink(motion: Sequence[Mapping[str, Any]], known: Known, times: Array) -> tuple[float, str] | None:
    """The first jump of prescribed motion or of its velocity during a motion, with a message; None if there is none.

    Parameters
    ----------
    motion : sequence of mapping
        Prescribed motions, with the keys ``name``, ``tree`` and ``names`` (variables of the tree); see the manifest.
    known : callable
    times : array
        Increasing times from the start to the end of the motion, at which switching functions are evaluated.
    """
    found: list[tuple[float, str]] = []
    for one in motion:
        tree = _hashable(one["tree"])
        zeros = sorted({t for s in dict.fromkeys(_switching(tree)) for t in _zeros(s, known, times)})
        if not zeros:
            continue
        t = np.array(zeros)
        for order, what in enumerate(("value", "velocity")):
            before, after = (_beside(tree, known, t, side, order) for side in (-1.0, 1.0))
            jumps = _are_jumps(tree, known, t, order, before, after)
            if len(jumps):
                i = int(jumps[0])
                message = (
                    f"the {what} of the prescribed motion of {one['name']!r} jumps from {before[i]:.6g} to {after[i]:.6g} "
                    f"there, at these parameters and inputs, and the impulse on other bodies would be ignored; use an expression "
                    f"with continuous velocity, such as step(t, from, to)"
                )
                found.append((zeros[i], message))
    return min(found, default=None)


def _hashable(tree: Any) -> Any:
    """Converts nested lists to nested tuples."""
    return tuple(map(_hashable, tree)) if isinstance(tree, (list, tuple)) else tree


def known_of(names: Sequence[str], p: Array, input_names: Sequence[str], inputs: Inputs) -> Known:
    """The variables of prescribed motions, as functions of time."""
    parameters = {n: (float(x), 0.0) for n, x in zip(names, p, strict=True)}

    def known(t: Array) -> Mapping[str, Pair]:
        values = np.array([inputs.at(x) for x in t.reshape(-1).tolist()]) if len(input_names) else np.zeros((t.size, 0))
        rates = np.array([inputs.rate(x) for x in t.reshape(-1).tolist()]) if len(input_names) else values
        of_inputs = {
            n: (values[:, i].reshape(t.shape), rates[:, i].reshape(t.shape)) for i, n in enumerate(input_names)
        }
        return {**parameters, **of_inputs, "t": (t, 1.0)}

    return known


def times_of(start: float, end: float, inputs: Inputs) -> Array:
    """Times at which switching functions are evaluated, with several between any two knots."""
    found = np.linspace(start, end, SAMPLES)
    if inputs.knots is not None:
        knots = np.unique(np.clip(inputs.knots, start, end))
        between = knots[:-1, None] + np.diff(knots)[:, None] * np.linspace(0.0, 1.0, 5)
        found = np.union1d(found, between)
    return found


# -- switching functions ---------------------------------------------------------------------------------------------


def _switching(tree: Sequence[Any]) -> Iterator[Any]:
    """The switching functions of an expression tree, as trees."""
    kind = tree[0]
    if kind in ("number", "name"):
        return
    of = tree[2 if kind == "call" else 1 :]
    for a in of:
        yield from _switching(a)
    if kind == "call":
        e = TABLE.get({"at_least": "max", "wrapped": "mod"}.get(tree[1], tree[1]))
        if e is not None and e.switching is not None:
            yield tree_of(e.switching, of)
    elif kind == "**" and not (tree[2][0] == "number" and isinstance(tree[2][1], int)):
        yield of[0]


def _zeros(s: Sequence[Any], known: Known, times: Array) -> Iterator[float]:
    """Zeros of a switching function during the motion, including those without a change of sign."""

    def f(t: Array) -> Array:
        return _evaluated(s, known(t), t.shape)[0]

    def slope(t: Array) -> Array:
        return _evaluated(s, known(t), t.shape)[1]

    if (rate := _constant_rate(s, known, times[:1])) is not None:
        t = float(times[0] - f(times[:1])[0] / rate) if rate and math.isfinite(rate) else math.nan
        if times[0] <= t <= times[-1]:
            yield t
        return
    if not np.isfinite(of := f(times)).any() or not of.any():
        return
    extremes = np.array(list(_changes(slope, times)))
    yield from _changes(f, np.union1d(times, extremes))
    if len(extremes):
        size = np.abs(_finite(of)).max(initial=0.0)
        yield from extremes[np.abs(f(extremes)) <= 1e-12 * size].tolist()


def _constant_rate(s: Sequence[Any], known: Known, t: Array) -> float | None:
    """The rate of a function that is linear in time and depends on no other variable quantity; else None."""
    names = known(t)

    def degree(tree: Sequence[Any]) -> int:
        """Degree in time: 0, 1, or 2 for higher or unknown degrees."""
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

    return float(_evaluated(s, names, t.shape)[1][0]) if degree(s) < 2 else None


def _changes(f: Callable[[Array], Array], t: Array) -> Iterator[float]:
    """Sign changes of a function, and those of the times at which it is zero."""
    of = f(t)
    sign = np.sign(of)
    yield from t[sign == 0.0].tolist()
    for i in np.flatnonzero(sign[:-1] * sign[1:] < 0.0):
        low, high = float(t[i]), float(t[i + 1])
        guess = low - float(of[i]) * (high - low) / float(of[i + 1] - of[i])  # by linear interpolation
        apart = 4.0 * np.spacing(max(abs(low), abs(high)))
        beside = np.array([max(guess - apart, low), min(guess + apart, high)])
        if np.array_equal(np.sign(f(beside)), sign[i : i + 2]):
            low, high = beside.tolist()
        while low < (middle := 0.5 * (low + high)) < high:  # bisection
            low, high = (middle, high) if np.sign(f(np.array([middle]))[0]) == sign[i] else (low, middle)
        yield high


# -- one-sided limits -------------------------------------------------------------------------------------------------


def _are_jumps(tree: Sequence[Any], known: Known, t: Array, order: int, before: Array, after: Array) -> Any:
    """Indices of times with jumps that are not small compared with nearby values."""
    size = np.maximum(np.abs(before), np.abs(after))
    with np.errstate(invalid="ignore"):
        found = np.flatnonzero(np.isfinite(size) & (np.abs(after - before) > JUMP * size))
    if not len(found):
        return found
    near_by = t[found, None] + NEAR_BY * np.maximum(np.abs(t[found]), 1.0)[:, None]
    around = np.abs(_finite(_evaluated(tree, known(near_by), near_by.shape)[order])).max(axis=1)
    return found[np.abs(after - before)[found] > JUMP * np.maximum(around, size[found])]


def _beside(tree: Sequence[Any], known: Known, t: Array, side: float, order: int) -> Array:
    """Values or rates at times, on the branch of the given side; limits from that side where the values are undefined."""
    step = np.maximum(np.abs(t), 1e-6) * BESIDE * side
    both = np.stack([t, t + step])
    here = _evaluated(tree, known(both), both.shape, True)[order][0]
    if np.isfinite(here).all():
        return here
    far = np.maximum(np.abs(t), 1e-3) * FAR_BESIDE * side
    near, farther = (_evaluated(tree, known(t + x * far), t.shape)[order] for x in (1.0, 2.0))
    return np.where(np.isfinite(here), here, 2.0 * near - farther)


def _finite(x: Array) -> Array:
    return np.where(np.isfinite(x), x, 0.0)


def _evaluated(
    tree: Sequence[Any], known: Mapping[str, Pair], shape: tuple[int, ...], sided: bool = False
) -> tuple[Array, Array]:
    """Values and rates; if `sided`, the first row uses the branches of the second."""
    with np.errstate(all="ignore"):
        x, dx = _pair(tree, known, lambda c: np.broadcast_to(c, shape)[1] if sided else c)
    return np.broadcast_to(np.asarray(x, float), shape), np.broadcast_to(np.asarray(dx, float), shape)


def _pair(tree: Sequence[Any], known: Mapping[str, Pair], taken: Callable[[Any], Any]) -> Pair:
    kind = tree[0]
    if kind == "number":
        return float(tree[1]), 0.0
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
            x = (
                np.power(a, b)
                if not (tree[2][0] == "number" and isinstance(tree[2][1], int))
                else np.power(a, tree[2][1] * 1.0)
            )
            by_exponent = x * np.log(a) * db if np.any(db) else 0.0
            return x, b * np.power(a, b - 1.0) * da + by_exponent


def _function(name: str, of: list[Pair], taken: Callable[[Any], Any]) -> Pair:
    a, da = of[0]
    if name == "choice":
        return tuple(np.where(a != 0.0, x, y) for x, y in zip(of[1], of[2], strict=True))
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
        raise ValueError(f"the package's prescribed motion contains the unknown function {name!r}")
    x = getattr(ON_ARRAYS, name)(a)
    return x, TABLE[name].slopes[0](ON_ARRAYS, x, a) * da
