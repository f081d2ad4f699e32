"""What an identification found: values, how sure they are, and which of them the samples do not determine."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.trajectory.trajectory import Trajectory
from .experiments import Experiment, Space
from .outcome import at_bound

PART = 1e-3
"""A variable has part in a direction that is not determined where its entry is more than this part of the largest."""

SURE = 100.0
"""Squares of residuals per freedom, in those of sigma, beyond which deviations that follow from sigma are no measure."""

NO_PROGRESS, FEW_MOTIONS = 0.99, 20
"""A search that has run more motions and leaves more than this part of the first squares went nowhere."""

STRONG = 0.95
"""Stronger correlations are listed."""


@dataclass(slots=True, eq=False)
class Fit:
    """Values that were identified; ``fit["length"]`` is one of them.

    Attributes
    ----------
    names, units : tuple of str
    values : array (n,)
        In the model's units.
    deviations : array (n,)
        Standard deviations; infinite where the samples do not determine a variable, NaN at a bound, which counts as given.
    covariance : array (n, n)
        Of the values, (J^T J)^-1, in the variance of the residuals where sigma was not given; NaN where `deviations` are not
        finite.
    correlations : array (n, n)
    undetermined : tuple of dict of str to float
        Directions along which the motions do not change where there are samples: changes of variables in their units.
    at_bounds : dict of str to str
        Variables that lie at a bound, and at which, "lower" or "upper".
    singular_values : array
        Of the Jacobian by variables of order one, those at bounds left out.
    residuals : tuple of dict of str to array (nt,)
        For each experiment, by the names of its samples: what the motion is more than them, in their units.
    trajectories : tuple of Trajectory
        For each experiment, with its derivatives.
    experiments : tuple of str
    sum_of_squares : float
        Of residuals, in standard deviations of the samples.
    freedom : int
        Samples less variables that they determine.
    variance : float
        sum_of_squares/freedom; near 1 where model and given sigma are right.
    sigma_given : bool
    success : bool
    message : str
    motions : int
    failures : tuple of str
        Motions of the search that failed, with why.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    deviations: Array
    covariance: Array
    correlations: Array
    undetermined: tuple[dict[str, float], ...]
    at_bounds: dict[str, str]
    singular_values: Array
    residuals: tuple[dict[str, Array], ...]
    trajectories: tuple[Trajectory, ...]
    experiments: tuple[str, ...]
    sum_of_squares: float
    freedom: int
    variance: float
    sigma_given: bool
    success: bool
    message: str
    motions: int
    failures: tuple[str, ...]
    cost: float = field(repr=False)
    first_cost: float = field(default=math.nan, repr=False)

    @classmethod
    def of(
        cls, space: Space, x: Array, residuals: Array, jacobian: Array, experiments: tuple[Experiment, ...],
        trajectories: tuple[Trajectory, ...], *, sigma_given: bool, undetermined: float, **more: Any,
    ) -> Fit:  # fmt: skip
        """From residuals (m,) and their Jacobian (m, n) by x (n,), in standard deviations of the samples."""
        n = len(x)
        low, high = space.x_bounds
        bounds = {i: side for i in range(n) if (side := at_bound(float(x[i]), float(low[i]), float(high[i])))}
        free = np.array([i for i in range(n) if i not in bounds], int)
        _, sizes, rows = np.linalg.svd(jacobian[:, free], full_matrices=False)
        kept = sizes > undetermined * sizes.max(initial=0.0)
        null = rows[~kept]
        part = np.abs(null) > PART * np.abs(null).max(axis=1, initial=0.0, keepdims=True)
        inverse = (rows[kept].T / sizes[kept] ** 2) @ rows[kept]
        squares = float(residuals @ residuals)
        freedom = len(residuals) - int(kept.sum())
        variance = squares / freedom if freedom > 0 else math.nan
        covariance = np.full((n, n), np.nan)
        scale = space.scale[free]
        covariance[np.ix_(free, free)] = inverse * np.outer(scale, scale) * (1.0 if sigma_given else variance)
        lost = free[part.any(axis=0)]
        covariance[lost, :] = covariance[:, lost] = np.nan
        deviations = np.sqrt(np.diag(covariance))
        deviations[lost] = np.inf
        with np.errstate(all="ignore"):
            correlations = covariance / np.outer(deviations, deviations)
        directions = []
        for row, chosen in zip(null, part, strict=True):
            change = row * scale
            change = change / np.abs(change[chosen]).max()
            directions.append({space.names[free[i]]: float(change[i]) for i in np.flatnonzero(chosen)})
        by_name, first = [], 0
        for e in experiments:
            by_name.append(e.by_name(residuals[first : first + e.count]))
            first += e.count
        return cls(
            space.names, space.units, space.origin + space.scale * x, deviations, covariance, correlations,
            tuple(directions), {space.names[i]: side for i, side in bounds.items()}, sizes, tuple(by_name), trajectories,
            tuple(e.name for e in experiments), squares, freedom, variance, sigma_given, **more,
        )  # fmt: skip

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._place(name)])

    def deviation(self, name: str) -> float:
        """The standard deviation of a variable."""
        return float(self.deviations[self._place(name)])

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Where the true value lies with some probability, as far as the model is linear there (Student's t, or normal)."""
        from scipy.stats import norm, t

        if not 0 < probability < 1:
            raise ValueError(f"probability is {probability!r}, expected a number between 0 and 1")
        at = (1 + probability) / 2
        factor = float(norm.ppf(at) if self.sigma_given else t.ppf(at, self.freedom))
        value, deviation = self[name], self.deviation(name)
        return value - factor * deviation, value + factor * deviation

    def as_dict(self) -> dict[str, float]:
        """Values by name, in the model's units: ``p`` of another call, where all are parameters."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(f"{name!r} is no variable of the fit; there are {', '.join(self.names[:12])}")
        return self.names.index(name)

    def lines(self) -> list[str]:
        """What `repr` says, line by line."""
        n, m = len(self.names), self.freedom + len(self.singular_values)
        m -= sum(1 for _ in self.undetermined)
        failed = f", {len(self.failures)} of them failed" if self.failures else ""
        lines = [f"{n} variables from {m} samples, {self.motions} motions{failed}; {self.freedom} degrees of freedom"]
        if self.sigma_given:
            lines.append(
                f"  squares of residuals over sigma^2: {self.sum_of_squares:.6g}, that is {self.variance:.4g} per freedom"
            )
        elif self.freedom > 0:
            lines.append(f"  standard deviation of the residuals: {math.sqrt(self.variance):.4g}")
        else:
            lines.append(
                "  no more samples than variables: give sigma, or more samples, to know how sure these values are"
            )
        width = max(map(len, self.names))
        for name, unit, x, d in zip(self.names, self.units, self.values, self.deviations, strict=True):
            if name in self.at_bounds:
                sure = f"at its {self.at_bounds[name]} bound"
            elif math.isinf(d):
                sure = "not determined"
            else:
                sure = "" if math.isnan(d) else f"+- {d:.2g}" + (f" ({100 * d / abs(x):.2g}%)" if x else "")
            lines.append(f"  {name:{width}s}  {x:14.8g}{' ' + unit if unit else ''}  {sure}")
        for direction in self.undetermined:
            told = ", ".join(f"{name} by {change:.4g}" for name, change in direction.items())
            lines.append(
                f"  the samples do not distinguish {told} from no change; hold one of these fixed, or measure more"
            )
        strong = [
            f"{self.names[i]} and {self.names[j]} {self.correlations[i, j]:.3f}"
            for i in range(n)
            for j in range(i)
            if abs(self.correlations[i, j]) > STRONG
        ]
        if strong:
            lines.append(f"  strongly correlated: {', '.join(strong[:8])}")
        if self.sigma_given and self.variance > SURE:
            lines.append(
                f"  residuals are {math.sqrt(self.variance):.2g} times as large as sigma says: the model or sigma is wrong, and "
                f"the deviations above, which follow from sigma, say nothing"
            )
        if self.first_cost > 0.0 and self.cost > NO_PROGRESS * self.first_cost and self.motions > FEW_MOTIONS:
            lines.append(
                f"  the search went nowhere: after {self.motions} motions the squares of residuals are "
                f"{self.cost / self.first_cost:.6g} of what they were; begin elsewhere, fit a shorter part of the motion "
                f"first, or hold some variables"
            )
        if not self.success:
            lines.append(f"  not finished: {self.message}")
        return lines

    def __repr__(self) -> str:
        return "\n".join(self.lines())


__all__ = ["Fit"]
