"""Events of a motion: times at which outputs cross a level, and derivatives of these times."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....html_tables import html_of, shapes_of
from ..arrays import Array
from ..calls.arguments import no_output, of_another_version

DIRECTIONS = {"up": 1, "down": -1, "both": 0}

GRAZING = 1e-8
"""Smallest rate of an output that crosses its level, as a fraction of `Crossing.pace`. At a smaller rate, the output only
touches its level, and the time of the event has no derivative."""


@dataclass(frozen=True, slots=True)
class Event:
    """An output of the model that crosses a level.

    Attributes
    ----------
    output : str
        Name of the output.
    level : float
        The level, in the output's unit.
    direction : {"both", "up", "down"}
        Crossings that count.
    stop : bool
        End the motion at the event. Otherwise the event is recorded and the motion continues.

    Examples
    --------
    >>> from ordernm.runtime import Event
    >>> run = solver.simulate(5.0, events=[Event("upper", direction="down")], sensitivities="length_1")
    >>> run.events
    (<upper = 0 at t = 0.61694715 s>,)
    >>> run.events[0].dt.round(4)
    array([0.2088])
    """

    output: str
    level: float = 0.0
    direction: str = "both"
    stop: bool = True


@dataclass(slots=True, eq=False)
class Crossing:
    """An event that occurred.

    Attributes
    ----------
    event : Event
        The event.
    t : float
        Its time, s.
    q, u, outputs : ndarray (nq,), (nu,), (noutputs,)
        State and outputs at that time.
    rates : ndarray (noutputs,)
        Time derivatives of the outputs.
    pace : float
        Range of the event's output within the integration step, divided by the step size, s. -1 where the output jumps
        with an input, -2 where it jumps at a switch; the state is then the one after the jump.
    dt : ndarray (k,)
        Derivatives of the time. NaN where the output only touches its level.
    dq, du, doutputs : ndarray (k, nq), (k, nu), (k, noutputs)
        Total derivatives of the state and outputs, which include the effect of `dt`.
    """

    event: Event
    t: float
    q: Array
    u: Array
    outputs: Array
    rates: Array
    pace: float
    dt: Array
    dq: Array
    du: Array
    doutputs: Array

    def __repr__(self) -> str:
        return f"<{self.event.output} = {self.event.level:g} at t = {self.t:.9g} s>"

    def _repr_html_(self) -> str:
        arrays = [(name, getattr(self, name)) for name in PARTS]
        return html_of([repr(self)], ("", "shape", "largest"), shapes_of(arrays))


PARTS = ("q", "u", "outputs", "rates", "dt", "dq", "du", "doutputs")
"""Arrays of a crossing, in the order of saved rows."""


def rows_of(crossings: Sequence[Crossing]) -> Array:
    """An array (n, row) of n crossings; a row contains the time, `pace` and the arrays named in `PARTS`."""
    return np.array([np.concatenate([[c.t, c.pace], *(getattr(c, name).ravel() for name in PARTS)]) for c in crossings])


def crossings_of(
    rows: Array, events: Iterable[Sequence[Any]], nq: int, nu: int, noutputs: int, k: int
) -> tuple[Crossing, ...]:
    """Crossings from the rows of `rows_of`, and from the fields of the `Event` of each.

    Raises
    ------
    ValueError
        If a row has the wrong length, or the number of rows is wrong.
    """
    shapes = [(nq,), (nu,), (noutputs,), (noutputs,), (k,), (k, nq), (k, nu), (k, noutputs)]
    ends = np.cumsum([2, *(math.prod(s) for s in shapes)])
    found = []
    for row, event in zip(rows, events, strict=True):
        if row.shape != (ends[-1],):
            raise ValueError(f"an event has {row.size} numbers, expected {ends[-1]}")
        parts = {
            name: x.reshape(shape) for name, x, shape in zip(PARTS, np.split(row, ends[:-1])[1:], shapes, strict=True)
        }
        found.append(Crossing(Event(*event), float(row[0]), pace=float(row[1]), **parts))
    return tuple(found)


def _is_finite(level: Any) -> bool:
    try:
        return math.isfinite(level)
    except (TypeError, OverflowError):
        return False


def take_events(output_names: Sequence[str], given: Any) -> tuple[Event, ...]:
    """Checks events given by a user.

    Raises
    ------
    ValueError
    """
    given = (given,) if isinstance(given, (str, Event)) or not isinstance(given, Iterable) else tuple(given)
    events = tuple(Event(e) if isinstance(e, str) else e for e in given)
    for e in events:
        if not isinstance(e, Event):
            raise ValueError(
                f"events contain {e!r}, expected names of outputs, or Event(output, level, direction, stop)"
                f"{of_another_version(e, [Event])}"
            )
        if e.output not in output_names:
            raise no_output("events", e.output, output_names)
        if e.direction not in [*DIRECTIONS]:
            raise ValueError(f"events: direction is {e.direction!r}; allowed are {', '.join(map(repr, DIRECTIONS))}")
        if not _is_finite(e.level):
            raise ValueError(f"events: the level of {e.output} is {e.level!r}, expected a finite number")
        if not isinstance(e.stop, bool | np.bool_):
            raise ValueError(f"events: stop is {e.stop!r}; allowed are True and False")
    return events


BY_STATE = -2.0
"""The value of `Crossing.pace` for an output that jumps over its level at a switch."""


def crossing_speed(rates: Array, pace: float, index: int) -> float:
    """The rate of an event's output, by which the derivative of the event's time is divided; NaN if the output only touches
    its level. `rates` (noutputs,) are those of all outputs.
    """
    speed = float(rates[index])
    return speed if abs(speed) > GRAZING * pace else np.nan


def crossing(
    event: Event, index: int, t: float, values: Sequence[Array], derivatives: Sequence[Array], rates: Sequence[Array],
    pace: float, given_dt: Array | None = None,
) -> Crossing:  # fmt: skip
    """A crossing with derivatives of its time and state.

    Let g be the output minus the level, and dg, dx derivatives at the fixed time, with the state x. Then ``dt = -dg/g'``,
    and the total derivative of the state is ``dx + x' dt``.

    Parameters
    ----------
    index : int
        Index of the event's output.
    values, rates : q, u, outputs and their time derivatives, at the crossing
    derivatives : dq, du, doutputs at the fixed time, (k, ...)
    pace : float
        See `Crossing`.
    given_dt : array (k,), optional
        Derivatives of the time, for an output that jumps over its level.
    """
    q, u, outputs = values
    dq, du, doutputs = derivatives
    dt = given_dt if given_dt is not None else -doutputs[:, index] / crossing_speed(rates[2], pace, index)
    moved = [d + dt[:, None] * r for d, r in zip((dq, du, doutputs), rates, strict=True)]
    if given_dt is None:
        moved[2][:, index] = np.where(np.isnan(dt), np.nan, 0.0)
    return Crossing(event, t, q, u, outputs, rates[2], pace, dt, *moved)
