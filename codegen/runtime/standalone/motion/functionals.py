"""Functionals of a motion: an output at a time, at the end or at an event, its integral, least squares."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from ....html_tables import html_of
from ..arrays import Array
from ..calls.arguments import no_output, of_another_version
from ..trajectory.events import Event, take_events


@dataclass(frozen=True)
class Final:
    """An output at the end of the motion.

    Attributes
    ----------
    output : str
        Name of the output.

    Examples
    --------
    >>> from ordernm.runtime import Final
    >>> solver.judge(1.0, Final("tip_x")).values.round(4)
    array([1.4231])
    """

    output: str


@dataclass(frozen=True)
class At:
    """An output at a given time.

    Attributes
    ----------
    output : str
        Name of the output.
    t : float
        The time, s.

    Examples
    --------
    >>> from ordernm.runtime import At
    >>> solver.judge(1.0, At("tip_x", 0.5)).values.round(4)
    array([-0.5115])
    """

    output: str
    t: float


@dataclass(frozen=True)
class Integral:
    """The integral of an output over the motion, in the output's unit times s.

    Attributes
    ----------
    output : str
        Name of the output.

    Examples
    --------
    >>> from ordernm.runtime import Integral
    >>> solver.judge(1.0, Integral("kinetic"), wrt="mass_1").gradients.round(4)
    array([[1.5369]])
    """

    output: str


@dataclass(frozen=True)
class AtEvent:
    """An output at the first occurrence of an event.

    Attributes
    ----------
    output : str
        Name of the output, or ``"t"`` for the time of the event, s.
    event : Event
        The event.

    Examples
    --------
    >>> from ordernm.runtime import AtEvent, Event
    >>> solver.judge(2.0, AtEvent("t", Event("upper", direction="down"))).values.round(4)
    array([0.6169])
    """

    output: str
    event: Event


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Half the sum of squared differences between outputs and samples, in units of their standard deviations.

    Attributes
    ----------
    times : array_like (n,)
        Times of the samples, s, increasing.
    samples : mapping of str to array_like (n,)
        Samples by the names of outputs. NaN where there is no sample.
    sigma : float, or mapping of str to float or array_like (n,)
        Standard deviations of the samples. Default: 1.

    Examples
    --------
    >>> from ordernm.runtime import LeastSquares
    >>> squares = LeastSquares([0.5, 1.0], {"upper": [0.9, -0.2]}, sigma=0.1)
    >>> solver.judge(1.0, squares, wrt="length_1").values.shape
    (1,)
    """

    times: ArrayLike
    samples: Mapping[str, ArrayLike]
    sigma: float | Mapping[str, ArrayLike] = field(default=1.0)

    def residuals(self, outputs: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the scaled differences between outputs and samples, and the scales.

        Parameters
        ----------
        outputs : ndarray (n, noutputs)
            Outputs at the times of the samples.
        names : sequence of str
            Names of the outputs.

        Returns
        -------
        error : ndarray (n, noutputs)
            (output - sample)/sigma; zero where there is no sample.
        weight : ndarray (n, noutputs)
            1/sigma; zero where there is no sample.

        Examples
        --------
        >>> from ordernm.runtime import LeastSquares
        >>> squares = LeastSquares([0.5], {"x": [1.0]}, sigma=0.5)
        >>> squares.residuals(np.array([[1.5]]), ["x"])
        (array([[1.]]), array([[2.]]))
        """
        error, weight = np.zeros_like(outputs), np.zeros_like(outputs)
        for name, values in self.samples.items():
            i = names.index(name)
            sigma = self.sigma.get(name, 1.0) if isinstance(self.sigma, Mapping) else self.sigma
            known = np.isfinite(np.asarray(values, float))
            weight[:, i] = np.where(known, 1.0 / np.asarray(sigma, float), 0.0)
            error[:, i] = np.where(known, (outputs[:, i] - np.where(known, values, 0.0)) * weight[:, i], 0.0)
        return error, weight


@dataclass(frozen=True, eq=False)
class WeightedResults:
    """The sum of weighted coordinates, speeds and outputs over times: what reverse differentiation of a motion needs.

    Attributes
    ----------
    times : array (nt,)
        Times, s, increasing.
    states : array (nt, nq + nu)
        Weights of coordinates, then of speeds; the weights of a quaternion apply to the normalised quaternion.
    outputs : array (nt, noutputs)
        Weights of outputs.
    """

    times: Array
    states: Array
    outputs: Array


Functional = Final | At | Integral | AtEvent | LeastSquares | WeightedResults


def check_functionals(given: Any, output_names: Sequence[str], start: float, end: float) -> list[Functional]:
    """Checks functionals given by a user.

    Raises
    ------
    ValueError
    """
    found = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]
    if not found:
        raise ValueError("no functional is given; give one, such as Final('tip_x') or Integral('power')")
    for f in found:
        if not isinstance(f, Functional):
            at_end = f", such as Final({f!r})" if isinstance(f, str) else ""
            raise ValueError(
                f"{f!r} is not a functional; allowed are Final, At, Integral, AtEvent and LeastSquares{at_end}"
                f"{of_another_version(f, get_args(Functional))}"
            )
        if isinstance(f, AtEvent):
            take_events(output_names, [f.event])
        names = [] if isinstance(f, WeightedResults) else list(f.samples) if isinstance(f, LeastSquares) else [f.output]
        for name in names:
            if name not in output_names and not (isinstance(f, AtEvent) and name == "t"):
                raise no_output(type(f).__name__, name, output_names)
        if isinstance(f, At) and not isinstance(f.t, (int, float, np.number)):
            raise ValueError(f"At: t is {f.t!r}, expected one time, s; give an At for each time, or LeastSquares")
        if isinstance(f, (At, LeastSquares, WeightedResults)):
            times = np.atleast_1d(np.asarray(f.t if isinstance(f, At) else f.times, float))
            if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                raise ValueError(f"{type(f).__name__}: times must be finite and increasing")
            if len(times) and not start <= times[0] <= times[-1] <= end:
                raise ValueError(
                    f"{type(f).__name__}: times from {times[0]:g} to {times[-1]:g} s are not within the motion, "
                    f"{start:g} to {end:g} s"
                )
        if isinstance(f, LeastSquares):
            for name, values in f.samples.items():
                if np.shape(values) != np.shape(f.times):
                    raise ValueError(
                        f"LeastSquares: {name} has {np.shape(values)} samples, expected {np.shape(f.times)}"
                    )
    return found


SHOWN = 8
"""Number of values, and of derivatives of each, in a `repr`."""


@dataclass(slots=True, eq=False, repr=False)
class Judged:
    """Values of functionals and their gradients.

    Attributes
    ----------
    values : ndarray (m,)
        Values of the functionals.
    gradients : ndarray (m, k)
        Their derivatives.
    names : tuple of str
        The k variables of the gradients.
    method : str
        "forward" or "adjoint"; "none" if no gradient was requested.
    counts : dict
        Steps and evaluations of the motion, and of the adjoint.
    hessian_products : ndarray (m, r, k)
        Products of the functionals' Hessians with r directions; empty if none was requested.
    """

    values: Array
    gradients: Array
    names: tuple[str, ...]
    method: str
    counts: dict[str, Any]
    hessian_products: Array = field(default_factory=lambda: np.empty((0, 0, 0)))

    def __repr__(self) -> str:
        lines = [f"Judged: {len(self.values)} value{'s' * (len(self.values) != 1)}, gradients: {self.method}"]
        for i, value in enumerate(self.values[:SHOWN]):
            by = [f"{n} {g:.6g}" for n, g in zip(self.names, self.gradients[i], strict=True)] if self.names else []
            more = f", and {len(by) - SHOWN} more" if len(by) > SHOWN else ""
            lines.append(f"  {value:.10g}" + (f"; by {', '.join(by[:SHOWN])}{more}" if by else ""))
        if len(self.values) > SHOWN:
            lines.append(f"  and {len(self.values) - SHOWN} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        n = len(self.names[:SHOWN])
        rows = ((f"{i}", x, *self.gradients[i, :n]) for i, x in enumerate(self.values))
        left = [f"the first {n} of {len(self.names)} derivatives"] if len(self.names) > n else []
        return html_of(
            [f"gradients: {self.method}", *left], ("", "value", *(f"by {name}" for name in self.names[:n])), rows
        )
