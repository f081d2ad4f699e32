"""Experiments of an identification: samples of motions, and the variables on which each depends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.calls.arguments import some
from ..runtime.standalone.errors import SimulationError
from ..runtime.standalone.trajectory.trajectory import Trajectory
from .variables import Variables, Wanted

KEYS = ("times", "samples", "sigma", "q", "u", "p", "inputs", "start", "name", "variables")


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The variables of all experiments together.

    Attributes
    ----------
    names, units : tuple of str
    x0 : array (n,)
    x_bounds : (array (n,), array (n,))
    origin, scale : array (n,)
        Values are ``origin + scale*x``.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    x0: Array
    x_bounds: tuple[Array, Array]
    origin: Array
    scale: Array


@dataclass(slots=True, eq=False)
class Experiment:
    """A motion and its samples.

    Attributes
    ----------
    name : str
    variables : Variables
    places : array of int
        Positions of `variables` among the variables of all experiments.
    times : array (nt,)
    start : float
    samples, sigma : dict of str to array (nt,)
    sigma_given : bool
    simulation : dict
        Further arguments of `simulate`.
    """

    name: str
    variables: Variables
    places: Any
    times: Array
    start: float
    samples: dict[str, Array]
    sigma: dict[str, Array]
    sigma_given: bool
    simulation: dict[str, Any]

    @property
    def count(self) -> int:
        """Number of samples."""
        return sum(int(np.isfinite(s).sum()) for s in self.samples.values())

    def simulate(self, x: Array) -> Trajectory:
        """The motion with its derivatives, at the times of the samples."""
        early = self.start < self.times[0]
        times = np.concatenate([[self.start], self.times]) if early else self.times
        if len(times) < 2:
            times = np.append(times, times[-1] + 1e-3)
        v = self.variables
        found: Trajectory = v.solver.simulate(
            times, **v.motion(x[self.places]), sensitivities=v.names, **self.simulation
        )
        if len(found) < len(times):
            raise SimulationError(
                f"the motion ends at t = {found.stats['t']:g} s, before the last sample: {found.ended}", found
            )
        return found

    def residuals(self, trajectory: Trajectory, n: int) -> tuple[Array, Array]:
        """Residuals in standard deviations, (m,), and their Jacobian with respect to x, (m, n)."""
        first = int(self.start < self.times[0])
        rows = slice(first, first + len(self.times))
        errors, jacobians = [], []
        for name, samples in self.samples.items():
            known = np.isfinite(samples)
            sigma = self.sigma[name][known]
            errors.append((trajectory[name][rows][known] - samples[known]) / sigma)
            part = np.zeros((int(known.sum()), n))
            for i, place in enumerate(self.places):
                part[:, place] = trajectory.derivative(name, i)[rows][known] * self.variables.scale[i] / sigma
            jacobians.append(part)
        return np.concatenate(errors), np.concatenate(jacobians)

    def by_name(self, residuals: Array) -> dict[str, Array]:
        """Residuals (count,) of this experiment as an array (nt,) for each output, in its unit; NaN where there is no sample."""
        found, first = {}, 0
        for name, samples in self.samples.items():
            known = np.isfinite(samples)
            m = int(known.sum())
            found[name] = np.full(len(samples), np.nan)
            found[name][known] = residuals[first : first + m] * self.sigma[name][known]
            first += m
        return found


def take_experiments(
    solver: Any, common: Mapping[str, Any], wanted: Wanted, given: Sequence[Mapping[str, Any]] | None, simulation: dict[str, Any]
) -> tuple[Space, list[Experiment]]:  # fmt: skip
    """Check the experiments given by a caller; return them with the variables of all.

    Raises
    ------
    ValueError
    """
    if given is not None and (common["times"] is not None or common["samples"] is not None):
        raise ValueError("fit: times or samples are given beside experiments; put them into the experiments")
    if isinstance(given, Mapping) or not all(isinstance(e, Mapping) for e in given or ()):
        raise ValueError("fit: experiments must be a list of mappings, such as [{'times': t, 'samples': {'tip_x': x}}]")
    several = [dict(e) for e in given] if given is not None else [{}]
    if not several:
        raise ValueError(
            "fit: the list of experiments is empty; give at least one, such as {'times': t, 'samples': {'tip_x': x}}"
        )
    names: list[str] = []
    units: list[str] = []
    numbers: list[tuple[float, ...]] = []
    found = []
    for i, one in enumerate(several):
        unknown = [k for k in one if k not in KEYS]
        label = str(one.get("name", f"experiment {i + 1}"))
        if unknown:
            raise ValueError(f"fit: {label} has the unknown entry {unknown[0]!r}; allowed are {', '.join(KEYS)}")
        own = one.pop("variables", ())
        own_names = [own] if isinstance(own, str) else list(own)
        one = {**common, **one}
        both = {**_mapping(wanted), **_mapping(own)}
        twice = [n for n in own_names if n in _mapping(wanted)]
        if twice:
            raise ValueError(f"fit: {twice[0]} is a variable of all experiments and also of {label}; give it only once")
        interval = _interval(one)
        v = Variables(solver, both, one["q"], one["u"], one["p"], one["inputs"], interval)
        places = []
        for k, name in enumerate(v.names):
            is_own = any(name == n or name.startswith(f"{n}[") for n in own_names)
            told = f"{name} ({label})" if is_own else name
            if told not in names:
                names.append(told)
                units.append(v.unit(k))
                numbers.append((v.start[k], v.lower[k], v.upper[k], v.origin[k], v.scale[k]))
            at = names.index(told)
            v.origin[k], v.scale[k] = numbers[at][3:]  # shared variables have the same scale
            places.append(at)
        found.append(_experiment(label, v, np.array(places), one, simulation))
    labels = [e.name for e in found]
    if len(set(labels)) < len(labels):
        twice_named = next(n for i, n in enumerate(labels) if n in labels[:i])
        raise ValueError(f"fit: two experiments have the name {twice_named}; give them different names")
    known = [e.sigma_given for e in found]
    if any(known) and not all(known):
        lacks = found[known.index(False)].name
        raise ValueError(f"fit: {lacks} has no sigma, but others have; give it for all experiments, or for none")
    start, lower, upper, origin, scale = np.array(numbers).T
    x = [(a - origin) / scale for a in (start, lower, upper)]
    return Space(tuple(names), tuple(units), x[0], (x[1], x[2]), origin, scale), found


def _mapping(wanted: Wanted) -> dict[str, Any]:
    if isinstance(wanted, Mapping):
        return dict(wanted)
    return dict.fromkeys([wanted] if isinstance(wanted, str) else wanted)


def _interval(one: Mapping[str, Any]) -> tuple[float, float]:
    """Start and end of the motion of an experiment."""
    if not isinstance(one["start"], (int, float, np.number)):
        raise ValueError(
            f"fit: start is {one['start']!r}, expected the start of the motion, s; the search starts from the values in p"
        )
    last = np.max(one["times"]) if one["times"] is not None and np.size(one["times"]) else one["start"] + 1.0
    return float(one["start"]), float(last)


def _experiment(
    label: str, v: Variables, places: Any, one: Mapping[str, Any], simulation: dict[str, Any]
) -> Experiment:
    if one["times"] is None or one["samples"] is None:
        raise ValueError(f"fit: {label} has no times or no samples; both are needed")
    times = np.asarray(one["times"], float)
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise ValueError(f"fit: times of {label} must be an increasing array (nt,) of finite numbers")
    start = float(one["start"])
    if start > times[0]:
        raise ValueError(
            f"fit: {label} starts at {start:g} s, after its first sample at {times[0]:g} s; give an earlier start"
        )
    if not isinstance(one["samples"], Mapping) or not one["samples"]:
        raise ValueError(f"fit: samples of {label} must be a mapping of names to (nt,), such as {{'tip_x': x}}")
    solver, sigma = v.solver, one["sigma"]
    known = [
        *solver.output_names,
        *(f"q.{n}" for n in solver.coordinate_names),
        *(f"u.{n}" for n in solver.speed_names),
    ]
    samples, deviations = {}, {}
    if isinstance(sigma, Mapping):
        if unknown := [n for n in sigma if n not in known]:
            raise ValueError(
                f"fit: {label} has sigma of {unknown[0]!r}, which the model does not have; allowed are {some(known)}"
            )
        lacking = [n for n in one["samples"] if n not in sigma]
        if lacking:
            raise ValueError(
                f"fit: sigma of {label} has no entry for {lacking[0]}; give one for each series, or leave out sigma"
            )
    for name, values in one["samples"].items():
        if name not in known:
            raise ValueError(
                f"fit: {label} has samples of {name!r}, which the model does not have; allowed are {some(known)}"
            )
        array = np.asarray(values, float)
        if array.shape != times.shape:
            raise ValueError(f"fit: {name} of {label} has samples of shape {array.shape}, expected {times.shape}")
        if np.isinf(array).any():
            raise ValueError(f"fit: {name} of {label} has infinite samples; NaN marks a missing sample")
        width = sigma[name] if isinstance(sigma, Mapping) else 1.0 if sigma is None else sigma
        try:
            deviation = np.broadcast_to(np.asarray(width, float), times.shape)
        except ValueError:
            raise ValueError(
                f"fit: sigma of {name} in {label} has shape {np.shape(width)}, expected {times.shape}"
            ) from None
        if not (np.isfinite(deviation) & (deviation > 0)).all():
            raise ValueError(f"fit: sigma of {name} in {label} must be positive and finite")
        samples[name], deviations[name] = array, deviation
    return Experiment(label, v, places, times, start, samples, deviations, sigma is not None, simulation)


__all__ = ["Experiment", "Space", "take_experiments"]
