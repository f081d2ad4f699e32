"""Jumps of prescribed motion or of its velocity, at which other bodies would receive an impulse.

A node with branches has a switching function, such as ``t - 0.5`` in ``max(0, t - 0.5)``. At its zeros the motion is compared
from both sides, with the branches of each side. A jump of the acceleration alone is not reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..elementary import named
from .expressions import Expression, functions_for
from .grammar import AT_LEAST, WRAPPED, Tree
from .rates import rate, rates_of
from .switches import switching
from .trees import parts

TOUCHING: Final = ("**", *named("name", lambda e: e.touches))
"""Functions that may also be non-smooth where the switching function touches zero."""

BESIDE: Final = 1e-9
"""Relative distance from a time at which the branches are determined."""

FAR_BESIDE: Final = 1e-5
"""The same where a function has no derivative at the time itself."""

JUMP: Final = 1e-7
"""Jumps below this fraction of the largest values nearby are rounding errors."""

NEAR_BY: Final = np.concatenate([np.logspace(-8, -1, 15), -np.logspace(-8, -1, 15)])
"""Distances in s at which these values are computed; relative to t for t above 1 s."""

MOST_TIMES: Final = 8
"""Number of zeros examined of a switching function that is not linear."""

TIMES: Final = np.array(sorted({*np.logspace(-6, 6, 1201).tolist(), *np.linspace(0.0, 100.0, 2001).tolist()}))
"""Times in s at which switching functions are searched for changes of sign; linear ones are solved."""


@dataclass(frozen=True)
class Kink:
    """A jump of a motion or of its velocity.

    Attributes
    ----------
    node : Expression
        The node that is not smooth there.
    t : float or None
        Time in s; None if it depends on inputs.
    order : int
        0 if the motion itself jumps, 1 if its velocity does.
    before, after : float
    """

    node: Expression
    t: float | None
    order: int
    before: float
    after: float


def nodes(tree: Tree) -> Iterator[tuple[Tree, Tree]]:
    """Nodes of a tree that may not be smooth, with their switching functions; each once, inner ones first."""
    seen: set[Tree] = set()

    def of(tree: Tree) -> Iterator[tuple[Tree, Tree]]:
        if tree in seen:
            return
        seen.add(tree)
        for a in parts(tree):
            yield from of(a)
        kind = tree[0]
        if kind == "call" and (s := switching(tree[1], tree[2:])) is not None:
            yield tree, s
        elif kind == "**" and not (tree[2][0] == "number" and isinstance(tree[2][1], int)):
            yield tree, tree[1]

    yield from of(tree)


def find_kink(value: Expression, parameters: Mapping[str, float], inputs: frozenset[str]) -> Kink | None:
    """The first jump of a motion or its velocity at given parameters, for t >= 0 and any inputs; None if none is found."""
    moving = {"t", *inputs}
    branching = [
        (n, s) for n, s in ((n, Expression(s)) for n, s in nodes(value.tree)) if not s.names.isdisjoint(moving)
    ]
    if not branching:
        return None
    motion = value, rate(value, moving=inputs)
    rng = np.random.default_rng(0)
    at = {**parameters, **{n: float(rng.uniform(0.3, 0.9)) for x in sorted(inputs) for n in (x, *rates_of(x))}}
    of_time = [(n, s) for n, s in branching if s.names.isdisjoint(inputs)]
    zeros = [(t, n) for n, s in of_time for t in _zeros(s, at, n[1] in TOUCHING or n[0] in TOUCHING)]
    if zeros:
        zeros.sort(key=lambda zero: zero[0])
        t = np.array([x for x, _ in zeros])
        for i, order, before, after in _jumps(motion, lambda x: {**at, "t": x}, t):
            return Kink(Expression(zeros[i][1]), float(t[i]), order, before, after)
    for node, s in branching:
        for name in sorted(s.names & inputs):
            for moved, t in _switched_by(s, at, inputs, name, rng):
                for _, order, before, after in _jumps(motion, moved, t):
                    return Kink(Expression(node), None, order, before, after)
    return None


# -- zeros of switching functions ------------------------------------------------------------------------------------


def _zeros(s: Expression, at: Mapping[str, float], touching: bool) -> list[float]:
    """Times t >= 0 at which a function changes its sign or, if `touching`, touches zero."""
    f = _as_function(s, at)
    slope = rate(s)
    if "t" not in slope.names:
        by, start = _as_function(slope, at)(np.zeros(1))[0], f(np.zeros(1))[0]
        t = float(-start / by) if by else math.nan
        return [abs(t)] if t >= 0.0 and math.isfinite(t) else []
    extremes = np.array(list(_changes(_as_function(slope, at), TIMES)))
    found = list(_changes(f, np.union1d(TIMES, extremes)))  # extremes are included to find short changes of sign
    if touching:
        of = f(TIMES)
        size = np.abs(of[np.isfinite(of)]).max(initial=0.0)
        found += extremes[np.abs(f(extremes)) <= 1e-12 * size].tolist()
    return found


def _switched_by(
    s: Expression, at: Mapping[str, float], inputs: frozenset[str], name: str, rng: np.random.Generator
) -> Iterator[tuple[Callable[[np.ndarray], dict[str, Any]], np.ndarray]]:
    """Times at which an input makes a switching function zero, and all values around these times."""
    values = np.concatenate([-np.logspace(3, -3, 300), [0.0], np.logspace(-3, 3, 300)])
    for begin in rng.uniform(0.1, 2.0, 4).tolist():
        for x in _changes(_as_function(s, {**at, "t": begin}, name), values):
            here = {**at, name: x}

            def moved(t: np.ndarray, begin: float = begin, here: dict[str, float] = here) -> dict[str, Any]:
                found: dict[str, Any] = {**here, "t": t}
                gone = t - begin
                for y in inputs:
                    first, second = rates_of(y)
                    found[y] = here[y] + gone * (here[first] + 0.5 * gone * here[second])
                    found[first] = here[first] + gone * here[second]
                return found

            yield moved, np.array([begin])


def _changes(f: Callable[[np.ndarray], np.ndarray], t: np.ndarray) -> Iterator[float]:
    """Arguments at which a function changes its sign, or is zero at one of the points t."""
    of = f(t)
    sign = np.sign(of)
    yield from t[sign == 0.0][:MOST_TIMES].tolist()
    for i in np.flatnonzero(sign[:-1] * sign[1:] < 0.0)[:MOST_TIMES]:
        low, high = float(t[i]), float(t[i + 1])
        guess = low - float(of[i]) * (high - low) / float(of[i + 1] - of[i])  # linear interpolation
        apart = 4.0 * np.spacing(max(abs(low), abs(high)))
        beside = np.array([max(guess - apart, low), min(guess + apart, high)])
        if np.array_equal(np.sign(f(beside)), sign[i : i + 2]):
            low, high = beside.tolist()
        while low < (middle := 0.5 * (low + high)) < high:  # bisection
            low, high = (middle, high) if np.sign(f(np.array([middle]))[0]) == sign[i] else (low, middle)
        yield high


def _as_function(e: Expression, at: Mapping[str, float], name: str = "t") -> Callable[[np.ndarray], np.ndarray]:
    """A function of one name from an expression; nan where it has no value."""
    return lambda x: _plain(e, {**at, name: x}, x.shape)


# -- values from both sides ------------------------------------------------------------------------------------------


def _jumps(
    motion: tuple[Expression, Expression], at: Callable[[np.ndarray], dict[str, Any]], t: np.ndarray
) -> Iterator[tuple[int, int, float, float]]:
    """Index of each time with a jump, order of the derivative that jumps, and its values before and after."""
    found: dict[int, tuple[int, int, float, float]] = {}
    for order, e in enumerate(motion):
        before, after = (_beside(e, at, t, side) for side in (-1.0, 1.0))
        size = np.maximum(np.abs(before), np.abs(after))
        with np.errstate(invalid="ignore"):
            jumps = np.flatnonzero(np.isfinite(size) & (np.abs(after - before) > JUMP * size))
        if len(jumps):
            near_by = t[jumps, None] + NEAR_BY * np.maximum(t[jumps], 1.0)[:, None]
            around = _plain(e, at(near_by), near_by.shape)
            around = np.abs(np.where(np.isfinite(around), around, 0.0)).max(axis=1)
            jumps = jumps[np.abs(after - before)[jumps] > JUMP * np.maximum(around, size[jumps])]
        for i in jumps.tolist():
            found.setdefault(i, (i, order, float(before[i]), float(after[i])))
    yield from (found[i] for i in sorted(found))


def _beside(e: Expression, at: Callable[[np.ndarray], dict[str, Any]], t: np.ndarray, side: float) -> np.ndarray:
    """Values at times t with the branches of one side; where they are not finite, limits from that side."""
    step = np.maximum(np.abs(t), 1e-6) * BESIDE * side
    here = _sided(e, at(np.stack([t, t + step])))[0]
    if np.isfinite(here).all():
        return here
    far = np.maximum(np.abs(t), 1e-3) * FAR_BESIDE * side
    near, farther = (_plain(e, at(t + x * far), t.shape) for x in (1.0, 2.0))
    return np.where(np.isfinite(here), here, 2.0 * near - farther)


def _sided(e: Expression, at: Mapping[str, Any]) -> np.ndarray:
    """Values (2, n) at times and beside them, always with the branches taken beside them."""
    shape = at["t"].shape

    def beside(x: Any) -> np.ndarray:
        return np.broadcast_to(np.asarray(x, float), shape)[1]

    def branches(condition: np.ndarray, a: Any, b: Any) -> np.ndarray:
        return np.where(condition, np.broadcast_to(a, shape), np.broadcast_to(b, shape))

    return _plain(e, at, shape, {
        "min": lambda a, b: branches(beside(a) < beside(b), a, b),
        "max": lambda a, b: branches(beside(a) > beside(b), a, b),
        "abs": lambda x: branches(beside(x) >= 0.0, x, -x),
        "sign": lambda x: branches(beside(x) > 0.0, 1.0, branches(beside(x) < 0.0, -1.0, 0.0)),
        AT_LEAST: lambda a, b: branches(beside(a) >= beside(b), 1.0, 0.0),
        "atan2": lambda y, x: np.arctan2(np.copysign(np.abs(y), beside(y)), x),
        **dict.fromkeys(("mod", WRAPPED), lambda x, m: x - m * np.floor(beside(x) / beside(m))),
    })  # fmt: skip


def _plain(
    e: Expression, at: Mapping[str, Any], shape: tuple[int, ...], by: Mapping[str, Callable[..., Any]] | None = None
) -> np.ndarray:
    """Values of a given shape, nan where there are none; functions of the grammar may replace those of NumPy."""
    functions = functions_for(np) | dict(by or {})
    with np.errstate(all="ignore"):
        try:
            found = np.asarray(e.evaluate(at, functions), float)
        except (ArithmeticError, ValueError):
            found = np.asarray(math.nan)
    return np.broadcast_to(found, shape)
