"""Numbers that a motion is judged by: an output at a time, at the end, at an event, its integral, squares of its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..calls.arguments import some
from ..trajectory.events import Event, take_events


@dataclass(frozen=True)
class Final:
    """An output at the end of the motion."""

    output: str


@dataclass(frozen=True)
class At:
    """An output at a time, s."""

    output: str
    t: float


@dataclass(frozen=True)
class Integral:
    """The integral of an output over the motion; in the output's unit times s."""

    output: str


@dataclass(frozen=True)
class AtEvent:
    """An output where an event happens first; the output ``"t"`` is the event's time, s."""

    output: str
    event: Event


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Half the sum of squares of what outputs differ from samples by, in units of their standard deviations.

    Attributes
    ----------
    times : (n,)
        Of the samples, s, rising.
    samples : mapping of str to (n,)
        By names of outputs; NaN where there is no sample.
    sigma : float, or mapping of str to float or (n,)
        Standard deviations of the samples; 1 if left out.
    """

    times: ArrayLike
    samples: Mapping[str, ArrayLike]
    sigma: float | Mapping[str, ArrayLike] = field(default=1.0)

    def residuals(self, outputs: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """What outputs (n, noutputs) differ from samples by, and 1/sigma, (n, noutputs) both; zero where there are none."""
        error, weight = np.zeros_like(outputs), np.zeros_like(outputs)
        for name, values in self.samples.items():
            i = names.index(name)
            sigma = self.sigma.get(name, 1.0) if isinstance(self.sigma, Mapping) else self.sigma
            known = np.isfinite(np.asarray(values, float))
            weight[:, i] = np.where(known, 1.0 / np.asarray(sigma, float), 0.0)
            error[:, i] = np.where(known, (outputs[:, i] - np.where(known, values, 0.0)) * weight[:, i], 0.0)
        return error, weight


Functional = Final | At | Integral | AtEvent | LeastSquares


def check_functionals(given: Any, output_names: Sequence[str], start: float, end: float) -> list[Functional]:
    """Functionals as a caller gives them, checked.

    Raises
    ------
    ValueError
    """
    found = [given] if isinstance(given, Functional) else list(given)
    if not found:
        raise ValueError("no functional is given, such as Final('tip_x') or Integral('power')")
    for f in found:
        if not isinstance(f, Functional):
            raise ValueError(f"{f!r} is no functional; allowed are Final, At, Integral, AtEvent and LeastSquares")
        if isinstance(f, AtEvent):
            take_events(output_names, [f.event])
        names = list(f.samples) if isinstance(f, LeastSquares) else [f.output]
        for name in names:
            if name not in output_names and not (isinstance(f, AtEvent) and name == "t"):
                raise ValueError(f"{type(f).__name__}: the model has no output {name!r}; it has {some(output_names)}")
        if isinstance(f, (At, LeastSquares)):
            times = np.atleast_1d(np.asarray(f.t if isinstance(f, At) else f.times, float))
            if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                raise ValueError(f"{type(f).__name__}: times must be finite and rise")
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
"""Values, and derivatives of each, that a `repr` lists."""


@dataclass(slots=True, eq=False, repr=False)
class Judged:
    """Values of functionals and their gradients.

    Attributes
    ----------
    values : array (m,)
    gradients : array (m, k)
    names : tuple of str
        What gradients are with respect to.
    method : str
        "forward", "adjoint", or "none" where no gradient was asked for.
    counts : dict
        Of the motion, and of the way back.
    """

    values: Array
    gradients: Array
    names: tuple[str, ...]
    method: str
    counts: dict[str, Any]

    def __repr__(self) -> str:
        lines = [f"Judged: {len(self.values)} value{'s' * (len(self.values) != 1)}, gradients: {self.method}"]
        for i, value in enumerate(self.values[:SHOWN]):
            by = [f"{n} {g:.6g}" for n, g in zip(self.names, self.gradients[i], strict=True)] if self.names else []
            more = f", and {len(by) - SHOWN} more" if len(by) > SHOWN else ""
            lines.append(f"  {value:.10g}" + (f"; by {', '.join(by[:SHOWN])}{more}" if by else ""))
        if len(self.values) > SHOWN:
            lines.append(f"  and {len(self.values) - SHOWN} more")
        return "\n".join(lines)
