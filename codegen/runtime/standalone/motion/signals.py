"""Input signals as a user gives them: numbers, values at times, functions of time, or splines, by name or all together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.arguments import has_none, of_another_version, some, unknown
from .inputs import Inputs, Linear
from .splines import MOST_DEGREE, Rewritten, Through, common_knots, knots_through, pieces, spline_values

DEGREES = {"hold": 0, "linear": 1, "spline": 3, "cubic": 3, "quintic": 5}
"""Degrees of the B-splines, by their names."""

THROUGH = ("cubic", "quintic")
"""Kinds of splines through the given values; for other kinds, the given values are control points."""

SAMPLED_DEGREE = 9
"""Degree of the spline that approximates a function of time."""

FEWEST, MOST = 16, 4096
"""Smallest and largest number of pieces of the spline that approximates a function of time."""

SAMPLED, BENT = 1e-10, 1e-7
"""Tolerances of the approximation, tested at the last halving of the pieces. SAMPLED: difference between function and
spline, relative to the largest value. BENT, for signals of prescribed motion: difference between the second derivatives
of the last two splines."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class Same:
    """The identity: the control points are the values."""

    def __call__(self, values: Array) -> Array:
        return values


@dataclass(frozen=True)
class Chain:
    """The composition of two linear maps of values."""

    first: Linear
    then: Linear

    def __call__(self, values: Array) -> Array:
        return self.then(self.first(values))


@dataclass(frozen=True)
class Constant:
    """A constant signal: all control points are equal."""

    count: int

    def __call__(self, values: Array) -> Array:
        return np.full(self.count, values[0])


@dataclass(frozen=True)
class Signal:
    """One or several signals with the same knots.

    Attributes
    ----------
    degree : int
    knots : array or None
        None for constants.
    given : array (n, m)
        The user's values; no rows for a function.
    values : array (count, m)
        Control points.
    control : callable
        Maps `given` to control points, column by column.
    """

    degree: int
    knots: Array | None
    given: Array
    values: Array
    control: Linear


def take_inputs(
    names: Sequence[str], given: Any, moving: Sequence[str] = (), interval: Interval | None = None
) -> Inputs:
    """Checks and converts a user's inputs of a motion.

    Parameters
    ----------
    names : sequence of str
        Names of the signals.
    moving : sequence of str
        Names of the signals that prescribed motion uses.
    interval : (start, end), optional
        Time interval of the motion, in which functions of time are sampled.

    Raises
    ------
    ValueError
    """
    places = tuple(names.index(n) for n in moving)
    if given is None:
        return Inputs(0, None, np.zeros((1, len(names))), places)
    if isinstance(given, Inputs):
        return given
    if older := of_another_version(given, [Inputs]):
        raise ValueError(f"inputs are of another class{older}")
    if isinstance(given, Mapping):
        signals = _by_name(names, given, moving, interval)
        if any(s.knots is not None for s in signals):
            return _together(signals, places)
        return Inputs(0, None, np.concatenate([s.values for s in signals], axis=1), places)
    signal = _signal("inputs", names, given, bool(moving), interval)
    if signal.control == Same():
        return Inputs(signal.degree, signal.knots, signal.values, places)
    columns = tuple(np.ascontiguousarray(signal.given.T))
    return Inputs(signal.degree, signal.knots, signal.values, places, columns, (signal.control,) * len(names))


def _by_name(
    names: Sequence[str], given: Mapping[Any, Any], moving: Sequence[str], interval: Interval | None
) -> list[Signal]:
    for name in (k for k in given if k not in names):
        if isinstance(name, str) and name.partition(".")[0] in moving:
            raise ValueError(
                f"inputs: {name!r} is not known; expected one of {some(names)}; time derivatives of inputs follow from their "
                f"values over time"
            )
        raise unknown("inputs", name, names)
    return [_signal(f"inputs[{n!r}]", (n,), given.get(n, 0.0), n in moving, interval) for n in names]


def _together(signals: list[Signal], moving: tuple[int, ...]) -> Inputs:
    """Rewrites several signals with common knots and degree."""
    changing = [s for s in signals if s.knots is not None]
    last = max(float(s.knots[np.isfinite(s.knots)].max()) for s in changing if s.knots is not None)
    splines = []
    for s in changing:
        assert s.knots is not None
        splines.append((s.degree, np.where(np.isfinite(s.knots), s.knots, last + 1.0)))
    if all(k == splines[0][0] and np.array_equal(t, splines[0][1]) for k, t in splines):
        degree, knots = splines[0]
    else:
        degree, knots = common_knots(splines)
    count = len(knots) - degree - 1
    columns: list[Array] = []
    control: list[Linear] = []
    own = iter(splines)
    for s in signals:
        maps: Linear = Constant(count)
        if s.knots is not None:
            k, t = next(own)
            maps = s.control
            if k != degree or not np.array_equal(t, knots):
                onto = Rewritten(t, k, knots, degree)
                maps = onto if maps == Same() else Chain(maps, onto)
                columns.append(onto(s.values[:, 0]))
            else:
                columns.append(s.values[:, 0])
        else:
            columns.append(maps(s.values[:, 0]))
        control.append(maps)
    given = tuple(np.ascontiguousarray(s.given[:, 0]) for s in signals)
    return Inputs(degree, knots, np.stack(columns, axis=1), moving, given, tuple(control))


def _signal(label: str, names: Sequence[str], given: Any, moves: bool, interval: Interval | None) -> Signal:
    """A signal from a user's value for it. If `names` has several entries, the value has a column for each."""
    if not names and not (hasattr(given, "__len__") and len(given) == 0):
        raise ValueError(f"{label} are given, but {has_none(label)}")
    if isinstance(given, tuple) and len(given) in (2, 3) and np.ndim(given[0]) == 1 and not isinstance(given[0], str):
        return _over_time(label, names, *given)
    kinds = {c.__name__ for c in type(given).__mro__}
    if "BSpline" in kinds:
        return _of_spline(label, names, given.k, _numbers(label, given.t), given.c, given)
    if "PPoly" in kinds:
        c = _numbers(label, given.c)
        if len(c) - 1 > MOST_DEGREE:
            raise ValueError(f"{label}: a spline of degree {len(c) - 1}; at most {MOST_DEGREE} is allowed")
        degree, knots, values = pieces(_numbers(label, given.x), c.reshape(*c.shape[:2], -1))
        return _of_spline(label, names, degree, knots, values, given)
    if callable(given):
        return _sampled(label, names, given, moves, interval)
    values = _numbers(label, given)
    shape = (len(names),) if label == "inputs" else ()
    if values.shape != shape:
        have = "have" if label == "inputs" else "has"
        raise ValueError(
            f"{label} {have} shape {values.shape}, expected {shape}: one number for each of {some(names)}; or (times, values), "
            f"(times, values, {' | '.join(map(repr, DEGREES))}), a function of time, a spline, or these by name"
        )
    values = values.reshape(1, -1)
    return Signal(0, None, values, values, Same())


def _over_time(label: str, names: Sequence[str], times: Any, values: Any, between: str = "linear") -> Signal:
    if between not in DEGREES:
        raise ValueError(f"{label}: joined by {between!r}; allowed are {', '.join(map(repr, DEGREES))}")
    degree, through = DEGREES[between], between in THROUGH
    t, x = _numbers(f"times of {label}", times), _numbers(f"values of {label}", values)
    if x.ndim == 1 and len(names) == 1:
        x = x[:, None]
    if t.ndim != 1 or (np.diff(t) <= 0).any() or len(t) < 1 + (degree > 0):
        raise ValueError(
            f"times of {label}: they must increase, with at least {1 + (degree > 0)} entr{'ies' if degree else 'y'}"
        )
    count = len(t) + 2 if between == "spline" else len(t)
    if x.shape != (count, len(names)):
        what = "control points, two more than times" if between == "spline" else "values, one row for each time"
        raise ValueError(f"values of {label} have shape {x.shape}, expected ({count}, {len(names)}): {what}")
    x = np.ascontiguousarray(x)
    if through:
        degree, knots = knots_through(t, degree)
        control = Through(knots, degree, t)
        return Signal(degree, knots, x, control(x), control)
    # repeat the end knots so that the spline starts and ends at its first and last control point
    before, after = [t[0]] * degree, [t[-1]] * degree if degree else [np.inf]
    return Signal(degree, np.array([*before, *t, *after], float), x, x, Same())


def _of_spline(label: str, names: Sequence[str], degree: int, knots: Array, values: Any, given: Any) -> Signal:
    """A signal from a spline object of SciPy."""
    if getattr(given, "extrapolate", None) == "periodic":
        raise ValueError(
            f"{label}: periodic splines are not allowed, because inputs are constant outside their times; give a function of time"
        )
    if degree > MOST_DEGREE:
        raise ValueError(f"{label}: a spline of degree {degree}; at most {MOST_DEGREE} is allowed")
    c = _numbers(label, values)
    c = c.reshape(len(c), -1)[: len(knots) - degree - 1]
    if c.shape[1] != len(names):
        raise ValueError(f"{label}: the spline has {c.shape[1]} values at a time, expected {len(names)}: {some(names)}")
    c = np.ascontiguousarray(c)
    return Signal(degree, knots, c, c, Same())


# -- functions of time -----------------------------------------------------------------------------------------------


def _sampled(
    label: str, names: Sequence[str], f: Callable[[float], Any], moves: bool, interval: Interval | None
) -> Signal:
    """The spline that approximates a function of time."""
    if interval is None:
        raise ValueError(f"{label}: functions of time are not allowed here; give (times, values)")
    start, end = interval
    known: dict[float, Array] = {}

    def values(t: Array) -> Array:
        for x in t.tolist():
            if x not in known:
                try:
                    row = np.asarray(f(x), float)
                except (TypeError, ValueError) as error:
                    raise ValueError(f"{label}: the function at t = {x:g} s: {error}") from None
                if row.shape not in {(len(names),), ()} or (row.shape == () and len(names) > 1):
                    raise ValueError(
                        f"{label}: the function at t = {x:g} s has shape {row.shape}, expected ({len(names)},): {some(names)}"
                    )
                if not np.isfinite(row).all():
                    raise ValueError(f"{label}: the function at t = {x:g} s is {row}, expected finite numbers")
                known[x] = row.reshape(len(names))
        return np.array([known[x] for x in t.tolist()])

    before: tuple[Array, Array] | None = None
    n = FEWEST
    while n <= MOST:
        t = start + (end - start) * np.arange(n + 1) / n
        t[-1] = end
        _, knots = knots_through(t, SAMPLED_DEGREE)
        control = Through(knots, SAMPLED_DEGREE, t)
        x = values(t)
        c = control(x)
        if before is not None:
            off = _misfit(before, (knots, c), t, x, moves)
            if off.max() <= 1.0:
                return Signal(SAMPLED_DEGREE, knots, np.zeros((0, len(names))), c, Same())
            worst = float(t[int(np.argmax(off))])
        before, n = (knots, c), 2 * n
    joined = "'cubic'" if moves else "'hold' | 'linear' | 'cubic'"
    raise ValueError(
        f"{label}: the function of time is not smooth, or changes too fast, near t = {worst:.4g} s: a spline of {MOST} pieces "
        f"does not follow it; give (times, values, {joined}){'' if moves else ', with its jumps and bends among the times'}"
    )


def _misfit(old: tuple[Array, Array], new: tuple[Array, Array], t: Array, x: Array, moves: bool) -> Array:
    """(nt,): the error of the previous spline at the times of the new one, relative to the tolerance."""

    def of(spline: tuple[Array, Array], order: int) -> Array:
        return spline_values(spline[0], SAMPLED_DEGREE, spline[1], t, order)

    size = np.abs(x).max(axis=0)
    off = np.abs(of(old, 0) - x) / np.where(size > 0.0, SAMPLED * size, 1.0)
    if moves:
        bend = of(new, 2)
        rounding = 1e4 * np.finfo(float).eps * size / (t[1] - t[0]) ** 2
        allowed = BENT * np.abs(bend).max(axis=0) + rounding
        off = np.maximum(off, np.abs(of(old, 2) - bend) / np.where(allowed > 0.0, allowed, 1.0))
    return off.max(axis=1)


def _numbers(name: str, given: Any) -> Array:
    try:
        found = np.asarray(given, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}; expected real numbers") from None
    if not np.isfinite(found).all():
        raise ValueError(f"{name} has entries that are not finite, expected finite numbers")
    return found
