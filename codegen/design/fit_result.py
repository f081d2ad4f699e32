"""Result of an identification: values, uncertainties, and directions that the samples do not determine."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..html_tables import html_of
from ..runtime.standalone.arrays import Array
from ..runtime.standalone.trajectory.trajectory import Trajectory
from ..wording import counted
from .experiments import Experiment, Space
from .fit_curvature import covariance_of, profile_interval
from .outcome import at_bound

PART = 1e-3
"""A variable belongs to an undetermined direction if its entry exceeds this fraction of the largest entry."""

SURE = 100.0
"""Sum of squares per degree of freedom, in units of sigma. Above this number, a warning says that standard deviations
from sigma mean nothing."""

NO_PROGRESS, FEW_MOTIONS = 0.99, 20
"""A search has made no progress if it leaves more than this fraction of the initial cost after more than this number of
motions."""

STRONG = 0.95
"""Correlation above which a pair of variables is listed."""


@dataclass(slots=True, eq=False)
class Fit:
    """Identified values and their uncertainty; ``fit["length"]`` is one of them.

    Attributes
    ----------
    names, units : tuple of str
        Names and units of the variables.
    values : ndarray (n,)
        Values in the model's units.
    deviations : ndarray (n,)
        Standard deviations. Infinite for a variable that the samples do not determine; NaN at a bound, where the
        variable counts as given.
    covariance : ndarray (n, n)
        Covariance of the values, (J^T J)^-1, times `variance` if sigma was not given. NaN where `deviations` are not
        finite.
    correlations : ndarray (n, n)
        Correlations of the values.
    hessian : ndarray (n, n) or None
        With ``hessian=True``: second derivatives of half the sum of squares with respect to the values. J^T J is
        the part of them that would remain if the motion were linear in the variables.
    full_covariance : ndarray (n, n) or None
        Covariance from the inverse of `hessian` instead of (J^T J)^-1; NaN if `hessian` is not positive definite.
    undetermined : tuple of dict of str to float
        Directions along which no sample changes, as changes of variables in their units.
    at_bounds : dict of str to str
        Variables at a bound, and which one: "lower" or "upper".
    singular_values : ndarray
        Singular values of the Jacobian with respect to variables of order one, without the variables at bounds.
    residuals : tuple of dict of str to ndarray (nt,)
        For each experiment the motion minus the samples, in their units.
    trajectories : tuple of Trajectory
        The motion of each experiment, with its derivatives.
    experiments : tuple of str
        Names of the experiments.
    sum_of_squares : float
        Sum of squared residuals, in units of the standard deviations of the samples.
    freedom : int
        Number of samples minus the number of determined variables.
    variance : float
        sum_of_squares/freedom; near 1 if model and given sigma are right.
    sigma_given : bool
        Whether sigma was given.
    success : bool
        Whether the search converged.
    message : str
        Reason for the end of the search.
    motions : int
        Number of evaluations of all motions.
    failures : tuple of str
        Motions that failed during the search, with the reasons.
    cost : float
        Final cost of the search.
    first_cost : float
        Cost at the start of the search.
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
    hessian: Array | None = field(default=None, repr=False)
    full_covariance: Array | None = field(default=None, repr=False)
    search: Any = field(default=None, repr=False)

    @classmethod
    def of(
        cls, space: Space, x: Array, residuals: Array, jacobian: Array, experiments: tuple[Experiment, ...],
        trajectories: tuple[Trajectory, ...], *, sigma_given: bool, undetermined: float, by_x: Array | None = None, **more: Any,
    ) -> Fit:  # fmt: skip
        """Make a fit from residuals and their Jacobian.

        Parameters
        ----------
        space : Space
            The variables.
        x : ndarray (n,)
            Solution, as numbers of order one.
        residuals : ndarray (m,)
            Residuals in standard deviations of the samples.
        jacobian : ndarray (m, n)
            Derivatives of the residuals with respect to x.
        experiments : tuple of Experiment
            The experiments.
        trajectories : tuple of Trajectory
            Their motions.
        sigma_given : bool
            Whether standard deviations were given.
        undetermined : float
            Fraction of the largest singular value below which a direction is not determined.
        by_x : ndarray (n, n), optional
            Second derivatives of half the sum of squares with respect to x.
        **more
            Further fields of the fit.

        Returns
        -------
        Fit
            The fit.

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> type(ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1")).__name__
        'Fit'
        """
        # long: the docstring describes every argument
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
        if by_x is not None:
            full = np.full((n, n), np.nan)
            full[np.ix_(free, free)] = covariance_of(by_x[np.ix_(free, free)], rows[kept]) * np.outer(scale, scale)
            full[lost, :] = full[:, lost] = np.nan
            more["full_covariance"] = full * (1.0 if sigma_given else variance)
            more["hessian"] = by_x / np.outer(space.scale, space.scale)
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
        """Return the standard deviation of a variable.

        Parameters
        ----------
        name : str
            Name of the variable.

        Returns
        -------
        float
            Standard deviation, in the model's unit.

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> found = ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1", sigma=0.01)
        >>> round(found.deviation("length_1"), 4)
        0.0067
        """
        return float(self.deviations[self._place(name)])

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a variable, for the model linearised at the fitted values.

        Parameters
        ----------
        name : str
            Name of the variable.
        probability : float, optional
            Probability of the interval, between 0 and 1. It uses the normal distribution if sigma was given, else
            Student's t.

        Returns
        -------
        lower, upper : float
            Ends of the interval, in the model's unit.

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> found = ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1", sigma=0.01)
        >>> lower, upper = found.interval("length_1")
        >>> lower < 1.1 < upper
        True
        """
        value, deviation, factor = self[name], self.deviation(name), self._factor(probability)
        return value - factor * deviation, value + factor * deviation

    def profile(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Return the profile likelihood interval of a variable, which needs no linear model.

        At each value of the variable, all others take their best values. The interval contains the values with which
        the sum of squares grows by less than the square of the factor of `interval`. Each end takes some motions.

        Parameters
        ----------
        name : str
            Name of the variable.
        probability : float, optional
            Probability of the interval, as in `interval`.

        Returns
        -------
        lower, upper : float
            Ends of the interval, in the model's unit: the variable's bound if that is nearer, and infinite if the
            samples do not limit the variable on this side. Where motions fail, the last value that did not fail.

        Raises
        ------
        ValueError
            If the variable is at a bound, or the loss of the fit was not "linear".

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> found = ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1", sigma=0.01)
        >>> lower, upper = found.profile("length_1")
        >>> lower < 1.1 < upper
        True
        """
        i, factor = self._place(name), self._factor(probability)
        if self.search is None:
            raise ValueError("profile: the loss of this fit is not 'linear'; profile needs a fit with loss='linear'")
        if name in self.at_bounds:
            raise ValueError(f"profile: {name} is at its {self.at_bounds[name]} bound; move the bound, and fit again")
        if math.isinf(self.deviations[i]):
            return -math.inf, math.inf
        return profile_interval(self.search, name, i, factor, 1.0 if self.sigma_given else self.variance)

    def _factor(self, probability: float) -> float:
        """Half the width of an interval, in standard deviations."""
        from scipy.stats import norm, t

        if not 0 < probability < 1:
            raise ValueError(f"probability is {probability!r}, expected a number between 0 and 1")
        at = (1 + probability) / 2
        return float(norm.ppf(at) if self.sigma_given else t.ppf(at, self.freedom))

    def as_dict(self) -> dict[str, float]:
        """Return the values by name.

        Returns
        -------
        dict of str to float
            Values in the model's units. If all variables are parameters, it can be passed as `p` to another call.

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> list(ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1").as_dict())
        ['length_1']
        """
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(f"{name!r} is not a variable of the fit; its variables are {', '.join(self.names[:12])}")
        return self.names.index(name)

    def lines(self) -> list[str]:
        """Return the summary that `repr` shows.

        Returns
        -------
        list of str
            Its lines.

        Examples
        --------
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> true = solver.simulate(times, p={"length_1": 1.1})
        >>> found = ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1")
        >>> found.lines()[0].partition(",")[0]
        '1 variable from 11 samples'
        """
        # long: each part of the summary has its own line of code
        n, m = len(self.names), self.freedom + len(self.singular_values)
        m -= sum(1 for _ in self.undetermined)
        failed = f", {len(self.failures)} of them failed" if self.failures else ""
        lines = [
            f"{counted(n, 'variable')} from {counted(m, 'sample')}, {counted(self.motions, 'motion')}{failed}; "
            f"{counted(self.freedom, 'degree')} of freedom"
        ]
        if self.sigma_given:
            lines.append(
                f"  sum of (residual/sigma)^2: {self.sum_of_squares:.6g}, or {self.variance:.4g} per degree of freedom"
            )
        elif self.freedom > 0:
            lines.append(f"  standard deviation of the residuals: {math.sqrt(self.variance):.4g}")
        else:
            lines.append("  not more samples than variables: give sigma, or more samples, to get standard deviations")
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
            changes = ", ".join(f"{name} by {change:.4g}" for name, change in direction.items())
            lines.append(
                f"  no sample changes if these change together: {changes}; hold one of them fixed, or measure more"
            )
        if self.full_covariance is not None:
            lines += self._with_full_hessian(self.full_covariance)
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
                f"  residuals are {math.sqrt(self.variance):.2g} times as large as sigma. The model or sigma is wrong, or "
                f"the search ended in a local minimum: start from other values (p=), or first fit a shorter part of the "
                f"motion. The standard deviations above, which follow from sigma, are meaningless"
            )
        if self.first_cost > 0.0 and self.cost > NO_PROGRESS * self.first_cost and self.motions > FEW_MOTIONS:
            lines.append(
                f"  the search made no progress: after {self.motions} motions the sum of squares is "
                f"{self.cost / self.first_cost:.6g} of its initial value. Start from other values, first fit a shorter part "
                f"of the motion, or hold some variables fixed"
            )
        if not self.success:
            lines.append(f"  not finished: {self.message}")
        return lines

    def _with_full_hessian(self, covariance: Array) -> list[str]:
        """Lines that compare the standard deviations with those from the full Hessian."""
        known = np.isfinite(self.deviations)
        variances = np.diag(covariance)[known]
        if not known.any():
            return []
        if not np.isfinite(variances).all():
            return [
                "  the full Hessian is not positive definite: the search has not ended in a minimum that is well determined"
            ]
        ratios = np.sqrt(variances) / self.deviations[known]
        return [
            f"  with the full Hessian, standard deviations are {ratios.min():.3g} to {ratios.max():.3g} times these"
        ]

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        names = tuple(f"{name} " for name in self.names)  # lines of the variables, which the table shows
        rows = zip(self.names, self.units, self.values, self.deviations, strict=True)
        lines = [line for line in self.lines() if not line.strip().startswith(names)]
        return html_of(lines, ("variable", "unit", "value", "standard deviation"), rows)


__all__ = ["Fit"]
