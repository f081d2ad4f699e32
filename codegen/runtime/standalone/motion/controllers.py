"""Sampled controllers: functions of the user that set inputs at a fixed rate during a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, is_finite
from ..calls.arguments import some
from ..warning import warn
from .directions import Directions
from .inputs import Inputs

SHORTEST_PERIOD = 1e-7
"""Smallest period, as a fraction of the largest magnitude of a time plus one second."""

MOST_SAMPLES = 10_000_000
"""Maximum number of samples of a motion."""

PARTS = ("q", "u", "outputs", "p", "inputs")
"""The parts that the Jacobian of a controller may have."""


@dataclass(slots=True, eq=False)
class Sample:
    """What a controller sees at one of its sampling times.

    Attributes
    ----------
    t : float
        Time, s.
    q, u : ndarray (nq,), (nu,)
        Coordinates and speeds, with the loops closed.
    outputs : ndarray (noutputs,)
        Outputs of the model, with the controlled inputs that were held until now, and with the new values of other inputs
        that jump at this time; empty if the package lacks their function.
    p : ndarray (np,)
        Parameters.
    inputs : ndarray (n,)
        What the controller returned at the previous sample; zeros at the first.
    dq, du, doutputs, dp, dinputs : ndarray (k, nq), (k, nu), (k, noutputs), (k, np), (k, n)
        Derivatives of these along the directions of the motion's sensitivities.

    Examples
    --------
    >>> def command(sample):
    ...     return {"motor": 2.0 * (0.8 - sample.q[0]) - 0.5 * sample.u[0]}
    >>> run = four_bar.simulate(1.0, controller=command, period=0.01)
    >>> run.ended
    'finished'
    """

    t: float
    q: Array
    u: Array
    outputs: Array
    p: Array
    inputs: Array
    dq: Array
    du: Array
    doutputs: Array
    dp: Array
    dinputs: Array


@dataclass(slots=True)
class Controller:
    """A user's controller, checked.

    Attributes
    ----------
    command : callable
        From a `Sample` to the new values of the controlled inputs.
    jacobian : callable or None
        From a `Sample` to the derivatives of these values.
    period : float
        Time between samples, s.

    Raises
    ------
    ValueError
        If the controller or its period is not allowed.
    """

    command: Callable[[Sample], Any]
    jacobian: Callable[[Sample], Any] | None
    period: float


def take_controller(controller: Any, period: Any) -> Controller | None:
    """Checks the arguments ``controller`` and ``period`` of `Solver.simulate`.

    Raises
    ------
    ValueError
    """
    if controller is None:
        if period is not None:
            raise ValueError(f"period is {period!r}, but there is no controller: give controller, or leave period out")
        return None
    command, jacobian = controller if isinstance(controller, tuple) and len(controller) == 2 else (controller, None)
    if not callable(command) or not (jacobian is None or callable(jacobian)):
        raise ValueError(
            f"controller is {controller!r}; expected a function of a sample, or a pair of the function and its Jacobian"
        )
    number = isinstance(period, (int, float, np.number)) and not isinstance(period, bool)
    if not number or not math.isfinite(period) or period <= 0:
        raise ValueError(f"period is {period!r}, expected the time between two samples of the controller, s")
    return Controller(command, jacobian, float(period))


def sampling_times(start: float, end: float, period: float) -> Array:
    """The times of the samples: from the start of the motion, and before its end.

    Raises
    ------
    ValueError
    """
    shortest = SHORTEST_PERIOD * (1.0 + max(abs(start), abs(end)))
    shortest = max(shortest, (end - start) / MOST_SAMPLES)
    if period < shortest:
        raise ValueError(
            f"period is {period:g} s; for a motion until t = {end:g} s, at least {shortest:.3g} s is allowed"
        )
    times = start + period * np.arange(math.ceil((end - start) / period), dtype=np.float64)
    return times[times < end - 1e-9 * period]


def with_controlled(
    names: Sequence[str], given: Any, moving: Sequence[str], times: Array
) -> tuple[dict[str, Any], tuple[int, ...]]:
    """A user's inputs, with signals added that hold their values from sample to sample; and the indices of these signals
    in `names`.

    Raises
    ------
    ValueError
    """
    if given is not None and not isinstance(given, Mapping):
        raise ValueError(
            "inputs: with a controller, give a mapping with the signals that the controller does not set, or nothing"
        )
    given = dict(given or {})
    free = [name for name in names if name not in given]
    if not free:
        found = "inputs gives all of them" if names else "the model has no inputs"
        raise ValueError(f"controller: no signal is left that it could set: {found}")
    driven = [name for name in free if name in moving]
    if driven:
        raise ValueError(
            f"controller: prescribed motion follows {driven[0]!r}, whose velocity would jump at each sample; give this signal "
            f"in inputs"
        )
    values = np.zeros(len(times))
    held = dict.fromkeys(free, (times, values, "hold"))
    return given | held, tuple(names.index(name) for name in free)


class Sampling:
    """Calls a controller at its sampling times, and writes its values into the inputs of the running motion.

    Parameters
    ----------
    controller : Controller
    names : tuple of str
        Names of all signals.
    places : tuple of int
        Indices of the controlled signals.
    times : array (n,)
        Sampling times.
    inputs : Inputs
        Inputs of the motion, from `with_controlled`; their control points are changed here.
    directions : Directions
        Directions of the motion, whose seeds of inputs are changed here.
    p : array (np,)

    Attributes
    ----------
    failure : BaseException or None
        What the controller raised, or why its result was rejected.
    """

    def __init__(
        self, controller: Controller, names: tuple[str, ...], places: tuple[int, ...], times: Array, inputs: Inputs,
        directions: Directions, p: Array,
    ):  # fmt: skip
        self.failure: BaseException | None = None
        self._controller, self._p = controller, p.copy()  # a controller may write into its sample
        self._names = tuple(names[i] for i in places)
        together = places == tuple(range(places[0], places[-1] + 1))
        self._places: Any = slice(places[0], places[-1] + 1) if together else list(places)
        self._times, self._next = times, 0
        self._inputs = inputs
        count, k = len(inputs.values), directions.k
        owner = inputs.control[places[0]](np.arange(len(times), dtype=float)) if inputs.control else np.arange(count)
        self._first = [*np.searchsorted(np.round(owner), np.arange(len(times))).tolist(), count, count]
        self._held, self._along = np.zeros(len(places)), np.zeros((k, len(places)))
        self._dp, self._seeds = directions.dp.copy(), None
        if k:
            if directions.dinputs is None:
                directions.dinputs = np.zeros((k, *inputs.values.shape))
            self._seeds = directions.dinputs
            if self._seeds[:, :, self._places].any():
                raise ValueError(
                    "sensitivities: there is no derivative with respect to an input that the controller sets"
                )
            if controller.jacobian is None:
                warn(
                    "the controller has no Jacobian, so derivatives of the motion keep the controller's values fixed; give "
                    "controller=(function, jacobian) for derivatives of the controlled motion"
                )

    def is_due(self, t: float) -> bool:
        """Whether a sample has to be taken at a time."""
        return self._next < len(self._times) and t >= self._times[self._next] - 1e-9 * self._controller.period

    def take(self, t: float, values: Sequence[Array], derivatives: Sequence[Array]) -> None:
        """Takes the next sample.

        Parameters
        ----------
        t : float
        values : q, u, outputs
        derivatives : dq, du, doutputs
        """
        q, u, outputs = values
        dq, du, doutputs = derivatives
        sample = Sample(t, q, u, outputs, self._p, self._held.copy(), dq, du, doutputs, self._dp, self._along.copy())
        held = self._values(self._controller.command(sample), t)
        # also the control points of the next sample: its outputs are computed with the inputs held until then
        own = slice(self._first[self._next], self._first[self._next + 2])
        if self._seeds is not None and self._controller.jacobian is not None:
            self._along = self._derivatives(self._controller.jacobian(sample), sample)
            self._seeds[:, own, self._places] = self._along[:, None]
        self._held = held
        self._inputs.values[own, self._places] = held
        self._next += 1

    def _values(self, given: Any, t: float) -> Array:
        """The controlled inputs (n,), from what the controller returned."""
        names = self._names
        if type(given) is not np.ndarray and isinstance(given, Mapping):
            if set(given) != set(names):
                found = some([str(name) for name in given])
                raise ValueError(f"the controller at t = {t:g} s returned {found}; expected values of {some(names)}")
            given = [given[name] for name in names]
        try:
            values = np.array(given, float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"the controller at t = {t:g} s: {error}; expected values of {some(names)}") from None
        if values.shape != (len(names),) and not (values.shape == () and len(names) == 1):
            raise ValueError(
                f"the controller at t = {t:g} s returned an array of shape {values.shape}, expected ({len(names)},): values "
                f"of {some(names)}"
            )
        if not is_finite(values.reshape(-1)):
            raise ValueError(
                f"the controller at t = {t:g} s returned {values}, expected finite values of {some(names)}"
            )
        return values.reshape(len(names))

    def _derivatives(self, given: Any, sample: Sample) -> Array:
        """Derivatives (k, n) of the controlled inputs along the directions, from what the Jacobian's function returned."""
        n, at = len(self._names), f"the controller's Jacobian at t = {sample.t:g} s"
        if not isinstance(given, Mapping):
            found = np.array(given, float)
            if found.shape != sample.dinputs.shape:
                raise ValueError(
                    f"{at} has shape {found.shape}; expected a mapping with any of {some(PARTS)}, or derivatives of the "
                    f"inputs along the directions, {sample.dinputs.shape}"
                )
            return found
        found = np.zeros(sample.dinputs.shape)
        for name, part in given.items():
            if name not in PARTS:
                raise ValueError(f"{at} contains {name!r}; allowed are {some(PARTS)}")
            along: Array = getattr(sample, f"d{name}")
            matrix = np.asarray(part, float)
            matrix = matrix[None] if n == 1 and matrix.ndim == 1 else matrix
            if matrix.shape != (n, along.shape[1]):
                raise ValueError(f"{at}: {name!r} has shape {matrix.shape}, expected {(n, along.shape[1])}")
            found += along @ matrix.T
        return found
