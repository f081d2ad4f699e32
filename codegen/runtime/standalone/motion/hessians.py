"""Hessian products of functionals of a motion, by tangents of the discrete adjoint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import PackageError
from ..statics.jets import Jet
from ..statics.second_derivatives import SecondDerivatives
from .adjoint import made_again
from .functionals import AtEvent, Functional, LeastSquares
from .inputs import Inputs
from .problem import Problem, Segment

TOGETHER = 8
"""Number of directions that are computed together; further ones repeat the motion's steps."""

FUNCTIONS = "motion, hessian_products"
"""Functions that a package needs, as messages name them."""


def directions_of(hessian: Any, names: Sequence[str]) -> Array | None:
    """Rows of factors of the variables (r, k) from a user's argument; None if no Hessian product is requested.

    Raises
    ------
    ValueError
    """
    if hessian is None or hessian is False:
        return None
    k = len(names)
    if not k:
        raise ValueError("hessian: there is nothing to differentiate by; name variables in wrt")
    if hessian is True:
        return np.eye(k)
    try:
        found = np.asarray(hessian, float)
    except (TypeError, ValueError):
        found = np.empty(())
    if found.ndim not in (1, 2) or found.shape[-1] != k or not found.size:
        raise ValueError(
            f"hessian is {hessian!r}; allowed are True, for the whole Hessian, or directions (r, {k}): "
            f"a factor for each of {', '.join(names[:4])}{', ...' if k > 4 else ''}"
        )
    if not np.isfinite(found).all():
        raise ValueError("hessian: directions must be finite numbers")
    return np.atleast_2d(found)


def check_supported(package: Any, method: str, wanted: Sequence[Functional]) -> None:
    """Refuses models, methods and functionals without Hessian products.

    Raises
    ------
    ValueError
    PackageError
        The package lacks a function.
    """
    what = ""
    if package.closure_names:
        what = f"{package.name} has closed loops; allowed are models without loops"
    elif package.coordinate_names != package.speed_names:
        what = f"{package.name} has quaternions; allowed are models whose speeds are the rates of their coordinates"
    elif "switches" in package._functions:
        what = f"{package.name} has forces or outputs with branches (such as abs, min or a comparison); allowed are smooth ones"
    elif method == "radau":
        what = "integrator is 'radau'; allowed are 'dop853' and 'rk4'"
    elif any(isinstance(f, AtEvent) for f in wanted):
        what = "a functional is AtEvent; allowed are Final, At, Integral and LeastSquares"
    if what:
        raise ValueError(f"hessian: {what}. Gradients are available without hessian")
    for name in ("hessian_products", "sensitivities_transposed", "output_sensitivities_transposed"):
        if name not in package._functions:
            raise PackageError(
                f"hessian: {package.name} was generated without {name}; generate it with --functions '{FUNCTIONS}'"
            )


@dataclass(slots=True)
class Curvature:
    """Derivatives of functionals by the initial state, parameters and inputs, and their changes along r directions.

    Attributes
    ----------
    state : array (m, 1 + r, nq + nu)
        First the gradient, then its changes.
    p : array (m, 1 + r, np)
    inputs : array (m, 1 + r, count, nsignals)
    products : int
        Number of Hessian products at single states.
    """

    state: Array
    p: Array
    inputs: Array
    products: int


class _Outputs:
    """Gradients of weighted outputs at many states, and their changes along directions."""

    def __init__(self, functions: SecondDerivatives, problem: Problem):
        self.functions, self.problem = functions, problem
        self.nq, self.nu, self.np = len(problem.q), len(problem.u), len(problem.p)

    def sources(self, states: Array, t: Array, within: Array, weights: Array, changes: Array) -> Array:
        """Sources (n, 1 + r, nq + nu + np + ninputs).

        Parameters
        ----------
        states : array (n, 1 + r, nq + nu)
        t, within : array (n,)
            Times, and times within the steps that contain them: inputs may jump between steps.
        weights, changes : array (n, noutputs), (n, noutputs, r)
            Weights of outputs, and their changes along the directions.
        """
        x, n, r = self.problem, len(states), states.shape[1] - 1
        y, dy = states[:, 0], states[:, 1:].transpose(0, 2, 1)
        inputs, dinputs = self.inputs(t, within, r)
        given = {
            "q": Jet(y[:, : self.nq], dy[:, : self.nq]),
            "u": Jet(y[:, self.nq :], dy[:, self.nq :]),
            "p": Jet(np.broadcast_to(x.p, (n, self.np)), np.broadcast_to(x.dp.T, (n, self.np, r))),
            "inputs": Jet(inputs, dinputs),
            "t": t,
        }
        name = "output_sensitivities_transposed"
        found = self.functions.along(name, given, {"doutputs": Jet(weights[None], changes[None])})
        sizes = {"dq": self.nq, "du": self.nu, "dp": self.np, "dinputs": inputs.shape[1]}
        by_name = dict(zip(self.functions.functions[name].results, found, strict=True))
        parts = []
        for part, size in sizes.items():
            jet = by_name.get(part)
            if jet is None:
                parts.append(np.zeros((n, 1 + r, size)))
                continue
            value, slope = jet.value.reshape(n, size, 1), jet.slope.reshape(n, size, r)
            parts.append(np.concatenate([value, slope], axis=2).transpose(0, 2, 1))
        return np.ascontiguousarray(np.concatenate(parts, axis=2))

    def inputs(self, t: Array, within: Array, r: int) -> tuple[Array, Array]:
        """Inputs (n, ninputs) at times, and their derivatives along the directions (n, ninputs, r); see `sources`."""
        x: Inputs = self.problem.inputs
        values = x.at(t, within)
        along = np.zeros((*values.shape, r))
        if self.problem.dinputs is not None:
            for i, control in enumerate(self.problem.dinputs):
                along[..., i] = replace(x, values=control).at(t, within)
        return values, along


class _Tangents:
    """A motion's steps with tangents of their stages, ready for functionals."""

    def __init__(self, motion: tuple[Any, Any, Any], segment: Segment, along: Problem, times: Array, memory: int):
        self.library, self.ffi, self.system = motion
        self.along, self.times, self.r = along, times, len(along.dp)
        self.n = len(along.q) + len(along.u)
        self.system.precise = self.ffi.NULL
        c = self.c = along.in_c(self.ffi, self.system)
        plain = segment.problem.in_c(self.ffi, self.system)
        self.states = np.zeros((len(times), 1 + self.r, self.n))
        g = self.g = self.ffi.new("ordernm_hessians *")
        self.kept = [self._pointer(times), self._pointer(self.states)]
        g.ntimes, (g.times, g.states) = len(times), self.kept
        self.room = self.ffi.from_buffer("double[]", np.zeros(self.library.ordernm_hessians_room(c)))
        self.curvature = self.library.ordernm_hessians_begin(c, g, self.room)
        self.stages = int(self.library.ordernm_hessians_stages(self.curvature))
        self._check_memory(segment, memory)
        self.parts = [
            rows if heads is None else made_again(self.library, self.ffi, plain, rows, known, heads)
            for rows, known, heads in zip(segment.steps, segment.known, segment.heads, strict=True)
        ]
        steps = np.concatenate(self.parts)
        steps = steps[steps[:, 1] > 0.0]
        self.within = _middles(steps)[np.maximum(np.searchsorted(steps[:, 0], times) - 1, 0)]
        ends = [float(rows[0, 0]) for rows in self.parts[1:]] + [math.inf]
        self.tapes, self.nodes = [], []
        for rows, until in zip(self.parts, ends, strict=True):
            tape, nodes = np.zeros((len(rows), self.stages, 1 + self.r, self.n)), np.zeros((len(rows), self.stages, 2))
            status = self.library.ordernm_tangents(
                self.curvature, self._pointer(rows), len(rows), until, self._pointer(tape), self._pointer(nodes)
            )
            if status:
                raise RuntimeError(f"tangents of a motion cannot use one of its states ({status})")
            self.tapes.append(tape)
            self.nodes.append(nodes)

    def _check_memory(self, segment: Segment, memory: int) -> None:
        """Refuses motions whose stages with tangents do not fit the memory."""
        steps = sum(len(x if h is None else h) for x, h in zip(segment.steps, segment.heads, strict=True))
        needed = 8 * steps * self.stages * (1 + self.r) * self.n
        if needed > memory:
            raise ValueError(
                f"hessian: {steps} steps with tangents need {needed / 2**20:.0f} MB, and memory allows "
                f"{memory / 2**20:.0f} MB; make memory larger, the motion shorter, or the tolerances larger"
            )

    def _pointer(self, x: Array) -> Any:
        return self.ffi.from_buffer("double[]", np.ascontiguousarray(x, float)) if x.size else self.ffi.NULL

    def back(self, sources: Array, integrands: Sequence[Array | None]) -> tuple[Array, Array, Array]:
        """Gradients by the state at the start, the parameters and the inputs, and their changes, for one functional."""
        g, rows = self.g, 1 + self.r
        found = [
            np.zeros((rows, self.n)),
            np.zeros((rows, len(self.along.p))),
            np.zeros((rows, *self.along.inputs.values.shape)),
        ]
        kept = [self._pointer(x) for x in (sources, *found)]
        g.sources, g.start, g.p, g.inputs = kept
        self.library.ordernm_hessians_turn(self.curvature)
        for steps, tape, of in reversed(list(zip(self.parts, self.tapes, integrands, strict=True))):
            held = [self._pointer(steps), self._pointer(tape), self.ffi.NULL if of is None else self._pointer(of)]
            status = self.library.ordernm_hessians_backwards(self.curvature, held[0], len(steps), *held[1:])
            if status:
                raise RuntimeError(f"Hessian products cannot use a state of the motion ({status})")
        self.library.ordernm_hessians_end(self.curvature)
        return found[0], found[1], found[2]


def curvature_of(
    motion: tuple[Any, Any, Any], functions: SecondDerivatives, segment: Segment, along: Problem, wanted: Sequence[Functional],
    times: Array, by_output: Array, by_integral: Array, output_names: Sequence[str], memory: int,
) -> Curvature:  # fmt: skip
    """Gradients of m functionals and their changes along the directions of `along`, for the kept steps of a segment.

    Parameters
    ----------
    times : array (nt,)
    by_output, by_integral : array (m, nt, noutputs), (m, nintegrals)
        Derivatives of the functionals by outputs at these times, and by integrals.
    """
    # least squares have curvature also at samples without error, where their gradient is zero
    samples = [np.asarray(f.times, float) for f in wanted if isinstance(f, LeastSquares)]
    used = by_output.any(axis=(0, 2)) | np.isin(times, np.concatenate([*samples, []]))
    times, by_output = np.ascontiguousarray(times[used]), by_output[:, used]
    chunks: list[tuple[Array, Array, Array]] = []
    count = 0
    for first in range(0, len(along.dp), TOGETHER):
        part = slice(first, first + TOGETHER)
        dinputs = None if along.dinputs is None else along.dinputs[part]
        some = replace(along, dq=along.dq[part], du=along.du[part], dp=along.dp[part], dinputs=dinputs, kept=[])
        tangents = _Tangents(motion, segment, some, times, memory)
        *found, n = _all_functionals(tangents, _Outputs(functions, some), wanted, by_output, by_integral, output_names)
        chunks.append((found[0], found[1], found[2]))
        count += n
    # each part begins with the same gradients
    state, p, inputs = (np.concatenate([chunks[0][i][:, :1], *(c[i][:, 1:] for c in chunks)], axis=1) for i in range(3))
    return Curvature(state, p, inputs, count)


def _all_functionals(
    tangents: _Tangents, outputs: _Outputs, wanted: Sequence[Functional], by_output: Array, by_integral: Array,
    output_names: Sequence[str],
) -> tuple[Array, Array, Array, int]:  # fmt: skip
    """Results of `_Tangents.back` for each functional, and the number of Hessian products."""
    x, r, found = tangents.along, tangents.r, []
    t, no = tangents.times, len(output_names)
    for f, of_output, of_integral in zip(wanted, by_output, by_integral, strict=True):
        changes = np.zeros((len(t), no, r))
        if isinstance(f, LeastSquares):
            changes = _changes(f, outputs, tangents, output_names)
        sources = outputs.sources(tangents.states, t, tangents.within, of_output, changes) if len(t) else np.zeros(0)
        integrands: list[Array | None] = [None] * len(tangents.parts)
        if of_integral.any():
            weights = np.zeros(no)
            np.add.at(weights, list(x.integrals), of_integral)
            for i, (rows, tape, nodes) in enumerate(zip(tangents.parts, tangents.tapes, tangents.nodes, strict=True)):
                integrands[i] = _integrands(outputs, rows, tape, nodes, weights)
        found.append(tangents.back(sources, integrands))
    state, p, inputs = (np.array([one[i] for one in found]) for i in range(3))
    return state, p, inputs, int(tangents.g.products)


def _middles(steps: Array) -> Array:
    """Times in the middle of steps."""
    middles: Array = steps[:, 0] + 0.5 * steps[:, 1]
    return middles


def _integrands(outputs: _Outputs, rows: Array, tape: Array, nodes: Array, weights: Array) -> Array:
    """Sources (count, all, 1 + r, n) of weighted outputs at the stages of steps."""
    count, stages, width, n = tape.shape
    used = np.flatnonzero((nodes[:, :, 1] != 0.0).any(axis=0))
    states = tape[:, used].reshape(-1, width, n)
    t = nodes[:, used, 0]
    within = np.broadcast_to(_middles(rows)[:, None], t.shape)
    of = np.broadcast_to(weights, (len(states), len(weights)))
    found = outputs.sources(states, t.ravel(), within.ravel(), of, np.zeros((*of.shape, width - 1)))
    whole = np.zeros((count, stages, *found.shape[1:]))
    whole[:, used] = found.reshape(count, len(used), *found.shape[1:])
    return whole


def _changes(f: LeastSquares, outputs: _Outputs, tangents: _Tangents, names: Sequence[str]) -> Array:
    """Changes along the directions of the weights (nt, noutputs, r) with which least squares weigh outputs."""
    t, r, no = tangents.times, tangents.r, len(names)
    weight = np.zeros((len(t), no))
    rows = np.searchsorted(t, np.asarray(f.times, float))
    _, weight[rows] = f.residuals(np.zeros((len(rows), no)), names)
    y = tangents.states
    x, nq = tangents.along, len(tangents.along.q)
    inputs, dinputs = outputs.inputs(t, tangents.within, r)
    dy = y[:, 1:].transpose(1, 0, 2)
    of = outputs.functions.functions["output_sensitivities"]
    given = {
        "q": y[:, 0, :nq],
        "u": y[:, 0, nq:],
        "p": np.broadcast_to(x.p, (len(t), len(x.p))),
        "inputs": inputs,
        "t": t,
    }
    seeds = {
        "dq": dy[..., :nq], "du": dy[..., nq:], "dp": np.broadcast_to(x.dp[:, None], (r, len(t), len(x.p))),
        "dinputs": dinputs.transpose(2, 0, 1), "dt": np.zeros((r, len(t))),
    }  # fmt: skip
    module = outputs.functions.module
    found = getattr(module, of.name)(*(given[a] for a in of.arguments), *(seeds[s] for s in of.seeds))
    doutputs = found[list(of.results).index("doutputs")]
    value = doutputs.value if isinstance(doutputs, Jet) else np.asarray(doutputs)
    return (weight**2)[..., None] * value.reshape(r, len(t), no).transpose(1, 2, 0)


__all__ = ["Curvature", "check_supported", "curvature_of", "directions_of"]
