"""Inputs over time, as the integrators use them: one B-spline for all signals, or constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from .splines import spline_values

JOINED = {0: "held from one time to the next", 1: "joined by straight lines"}
"""Descriptions of splines without continuous velocity, by degree."""

SMOOTH = "give (times, values, 'cubic'), a cubic spline through the values, or (times, control points, 'spline')"
"""Kinds of smooth signals that messages suggest."""

ROUNDED = 1e-12
"""Jumps up to this fraction of the largest value are rounding errors; jumps of velocities, up to this fraction of the largest
value divided by the mean distance of knots."""

Linear = Callable[[Array], Array]
"""Maps a user's values of a signal (n,) to control points (count,)."""


@dataclass(slots=True)
class Inputs:
    """Inputs over time: a B-spline, or constant numbers.

    Before the first knot and after the last one, inputs are constant.

    Attributes
    ----------
    degree : int
    knots : array (count + degree + 1,) or None
        None for constant inputs; count is then 1.
    values : array (count, nsignals)
        Control points; for degrees 0 and 1 they are the values themselves.
    moving : tuple of int
        Signals that prescribed motion uses. After all signals, inputs contain the rate and the acceleration of each of these.
    given : tuple of array (n,)
        A user's values for each signal; empty if they are the control points.
    control : tuple of callable
        The map from these values to control points, for each signal.
    """

    degree: int
    knots: Array | None
    values: Array
    moving: tuple[int, ...] = ()
    given: tuple[Array, ...] = ()
    control: tuple[Linear, ...] = ()

    # -- over time -----------------------------------------------------------------------------------------------------

    def at(self, t: Array | float, within: Array | None = None, order: int = 0) -> Array:
        """Inputs (*t.shape, ninputs) at times t, or their time derivatives of an order; see `derivative`."""
        return self._inputs(t, order, within)

    def rate(self, t: Array | float) -> Array:
        """Time derivatives (*t.shape, ninputs) of the inputs at times t."""
        return self._inputs(t, 1)

    def _inputs(self, t: Array | float, order: int, within: Array | None = None) -> Array:
        values = self.derivative(t, order, within=within)
        if not self.moving:
            return values
        of = list(self.moving)
        rates = np.stack([self.derivative(t, order + n, within=within)[..., of] for n in (1, 2)], axis=-1)
        return np.concatenate([values, rates.reshape(*np.shape(t), -1)], axis=-1)

    def derivative(self, t: Array | float, order: int, before: bool = False, within: Array | None = None) -> Array:
        """Time derivatives (*t.shape, nsignals) of the given order. At a knot, they are those from the right; with
        `before`, those from the left; with `within`, those of the pieces that contain these times."""
        if self.knots is None:
            constant = np.zeros_like(self.values[0]) if order else self.values[0]
            return np.broadcast_to(constant, (*np.shape(t), len(constant))) if np.ndim(t) else constant
        found = spline_values(self.knots, self.degree, self.values, t, order, before, within)
        t = t if within is None else within
        inside = (t >= self.knots[self.degree]) & (t <= self.knots[len(self.values)])
        return np.where(np.expand_dims(inside, -1), found, 0.0) if order else found

    def check_moving(self, names: Sequence[str], start: float, end: float) -> None:
        """Rejects inputs of prescribed motion that have jumps in value or velocity during the motion.

        Raises
        ------
        ValueError
            If there is such a jump, because its impulse on the mechanism would be ignored.
        """
        changing = [i for i in self.moving if np.ptp(self.values[:, i]) > 0.0]
        if self.knots is None or not changing:
            return
        lost = "the impulse on other bodies would be ignored"
        if self.degree < 2:
            raise ValueError(
                f"inputs: prescribed motion follows {names[changing[0]]!r}, which is {JOINED[self.degree]}: its velocity "
                f"would jump, and {lost}; {SMOOTH}"
            )
        knots = np.unique(self.knots)
        size = np.abs(self.values).max(axis=0)
        times = knots[(knots > start) & (knots < end)]
        sides = np.empty((2, len(times), 2, len(changing)))  # axes: side (before, after), time, order, signal
        jumps = np.empty(sides.shape[1:], bool)
        for order in (0, 1):
            one, other = self.derivative(times, order, before=True), self.derivative(times, order)
            if order:  # inputs are constant before the first knot and after the last one
                one = one * (times > self.knots[self.degree])[:, None]
                other = other * (times < self.knots[len(self.values)])[:, None]
            allowed = ROUNDED * size * (len(knots) / (knots[-1] - knots[0])) ** order
            sides[:, :, order] = one[:, changing], other[:, changing]
            jumps[:, order] = (np.abs(other - one) > allowed)[:, changing]
        for at, order, i in np.argwhere(jumps)[:1].tolist():
            t, (one, other) = float(times[at]), sides[:, at, order, i]
            raise ValueError(
                f"inputs: the {('value', 'velocity')[order]} of {names[changing[i]]!r}, which prescribed motion follows, jumps "
                f"from {one:.6g} to {other:.6g} at t = {t:.9g} s, and {lost}; {self._instead(t)}"
            )

    def _instead(self, t: float) -> str:
        assert self.knots is not None
        ends = {self.knots[self.degree]: "before its first", self.knots[len(self.values)]: "after its last"}
        if t not in ends:
            return SMOOTH
        return f"an input is held {ends[t]} time: give values for the whole motion, or a spline that starts and ends at rest"

    # -- given values --------------------------------------------------------------------------------------------------

    def counts(self) -> tuple[int, ...]:
        """Number of values given for each signal."""
        return tuple(map(len, self.given)) or (len(self.values),) * self.values.shape[1]

    def value(self, signal: int, row: int) -> float:
        """A user's value of a signal, by its row."""
        return float(self.given[signal][row] if self.given else self.values[row, signal])

    def direction(self, signal: int, row: int | None) -> Array:
        """Derivative of the control points (count,) with respect to a user's value of a signal or, if `row` is None, to a
        constant added to all of them."""
        if row is None:
            return np.ones(len(self.values))
        if self.given:
            return self.control[signal](np.eye(1, len(self.given[signal]), row)[0])
        return np.eye(1, len(self.values), row)[0]

    def changed(self, values: Mapping[tuple[int, int], float]) -> Inputs:
        """A copy in which some of the user's values are new; `values` has the keys (signal, row)."""
        new, given = self.values.copy(), [x.copy() for x in self.given]
        for (signal, row), x in values.items():
            (given[signal] if given else new[:, signal])[row] = x
        for signal in {s for s, _ in values} if given else ():
            new[:, signal] = self.control[signal](given[signal])
        return replace(self, values=new, given=tuple(given))
