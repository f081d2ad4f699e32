"""Result of an optimisation by name: values of variables, the objective, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..html_tables import html_of
from ..runtime.standalone.arrays import Array
from ..runtime.standalone.motion.functionals import (
    At,
    AtEvent,
    Final,
    Functional,
    Integral,
    LeastSquares,
    WeightedResults,
)

ROWS = 40
"""Largest number of variables in the summary."""

AT_BOUND = 1e-6
"""A value closer than this fraction of its range, or of its size, is at its bound."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Named values at a point; ``outcome["length"]`` is one of them.

    Attributes
    ----------
    names : tuple of str
        Names of the variables.
    values, lower, upper : ndarray (n,)
        Values and bounds in the model's units.
    units : tuple of str
        Units of the variables.
    value : float
        Value of the objective.
    gradient : ndarray (n,)
        Derivatives of `value` with respect to the variables, in the model's units.
    functionals : tuple of m functionals
        Functionals of the objective, then of the constraints.
    functional_values : ndarray (m,)
        Values of the functionals.
    motions, failures : int
        Number of motions that were run so far, and of those that failed.
    """

    names: tuple[str, ...]
    values: Array
    lower: Array
    upper: Array
    units: tuple[str, ...]
    value: float
    gradient: Array
    functionals: tuple[Functional, ...]
    functional_values: Array
    motions: int
    failures: int

    def __getitem__(self, name: str) -> float:
        if name not in self.names:
            raise KeyError(f"{name!r} is not a variable; the variables are {', '.join(self.names[:12])}")
        return float(self.values[self.names.index(name)])

    def as_dict(self) -> dict[str, float]:
        """Return the variables by name.

        Returns
        -------
        dict of str to float
            Values in the model's units.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.result([0.5]).as_dict()
        {'length_1': 1.25}
        """
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def __repr__(self) -> str:
        failed = f", {self.failures} of them failed" if self.failures else ""
        lines = [f"objective {self.value:.9g} after {self.motions} motions{failed}"]
        lines += [f"  {in_words(f)} = {x:.9g}" for f, x in zip(self.functionals, self.functional_values, strict=True)]
        width = max(map(len, self.names))
        for i, name in enumerate(self.names[:ROWS]):
            x, low, high = self.values[i], self.lower[i], self.upper[i]
            unit = f" {self.units[i]}" if self.units[i] else ""
            bound = at_bound(float(x), float(low), float(high))
            where = f"  at its {bound} bound" if bound else ""
            lines.append(f"  {name:{width}s}  {x:14.8g}{unit}  derivative {self.gradient[i]:.4g}{where}")
        if len(self.names) > ROWS:
            lines.append(f"  and {len(self.names) - ROWS} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        n = len(self.functionals)
        rows = zip(self.names, self.units, self.values, self.lower, self.upper, self.gradient, strict=True)
        head = ("variable", "unit", "value", "lower bound", "upper bound", "derivative")
        return html_of(repr(self).splitlines()[: 1 + n], head, rows, ROWS)


def at_bound(x: float, lower: float, upper: float) -> str:
    """The bound at which a value lies, "lower" or "upper"; empty if none."""
    size = upper - lower if np.isfinite(upper - lower) else max(abs(x), 1.0)
    if x - lower <= AT_BOUND * size:
        return "lower"
    return "upper" if upper - x <= AT_BOUND * size else ""


def in_words(f: Functional) -> str:
    """A functional described in words."""
    match f:
        case Final():
            return f"{f.output} at the end"
        case At():
            return f"{f.output} at {f.t:g} s"
        case Integral():
            return f"integral of {f.output}"
        case AtEvent():
            return f"{f.output} where {f.event.output} = {f.event.level:g}"
        case LeastSquares():
            return f"half the squares of {', '.join(f.samples)}"
        case WeightedResults():
            return "weighted sum of states and outputs"


__all__ = ["AT_BOUND", "Outcome", "at_bound", "in_words"]
