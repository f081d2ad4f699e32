"""Changes of the weights of outputs along directions, for functionals whose weights depend on the motion.

An event is the time T at which an output g has its level. With the outputs o(t, x) of a motion with variables x, the functional
is one entry of o(T(x), x). Let W = w . o with constant w: the unit vector of this entry minus o_t/g_t times that of g. Then

    gradient = W_x,  T_x = -g_x/g_t,  Hessian = W_xx + T_x W_tx + W_tx T_x + W_tt T_x T_x.

W_xx is the Hessian at a fixed time. W_t = w . (o_y f + o_inputs inputs' + o_t) is a function of the state y, so the other terms
are gradients at the state, with weights that depend on the direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..arrays import Array
from .at_states import AtStates
from .functionals import LeastSquares
from .inputs import Inputs


@dataclass(slots=True)
class Crossed:
    """The event of a functional: its time, s; the index of its output, and the rate of this output there."""

    t: float
    output: int
    speed: float


class Sampled(Protocol):
    """A segment's functions, and its states at times of outputs."""

    functions: AtStates
    times: Array
    states: Array
    within: Array
    r: int


def of_squares(f: LeastSquares, of: Sampled, names: Sequence[str]) -> Array:
    """Changes (nt, noutputs, r), along directions, of the derivatives of a sum of squares with respect to outputs."""
    times = np.asarray(f.times, float)
    _, every = f.residuals(np.zeros((len(times), len(names))), names)
    weight = np.zeros((len(of.times), len(names)))
    here = np.isin(times, of.times)
    weight[np.searchsorted(of.times, times[here])] = every[here]
    value = of.functions.along("output_sensitivities", of.states, of.times, of.within)["doutputs"]
    found: Array = (weight**2)[..., None] * value.reshape(of.r, *weight.shape).transpose(1, 2, 0)
    return found


@dataclass(slots=True)
class AtTime:
    """Contributions of a functional that changes with its time T.

    Attributes
    ----------
    weights : array (noutputs, r)
        Changes of the weights of outputs.
    source : array (r, free + np + ninputs)
        T's changes times the gradient of W_t.
    inputs : array (r, count, nsignals)
        The part of these changes that is due to rates of inputs, as gradients with respect to control points.
    """

    weights: Array
    source: Array
    inputs: Array


def of_event(event: Crossed, of: Sampled, row: int, weights: Array) -> AtTime:
    """Contributions of an event whose time is that of a row of states; with the weights w of outputs."""
    functions, r, x = of.functions, of.r, of.functions.problem
    at = of.states[row : row + 1], of.times[row : row + 1], of.within[row : row + 1]
    flow, seeds = functions.flow(*at), functions.seeds(*at)
    none, names = np.zeros((1, len(weights), 1)), ("dq", "du", "dp", "dinputs", "dt")
    gradient, rate = functions.outputs(*at, weights[None], none, flow)[0]
    rate = rate + _rates_transposed(functions, *at, gradient)
    by_inputs = gradient[functions.inputs_at : -1]
    kept = [
        *functions.free,
        *range(functions.nq + functions.nu, functions.nq + functions.nu + functions.np + len(by_inputs) + 1),
    ]
    motion = np.concatenate([flow[name][0, 0] for name in names])[kept]
    along = np.concatenate([seeds[name][:, 0] for name in names], axis=1)[:, kept]
    W_tv = along @ rate + functions.input_directions(*at[1:], 1)[:, 0] @ by_inputs
    W_tt = motion @ rate + x.inputs.at(*at[1:], 2)[0] @ by_inputs
    dT = -functions.along("output_sensitivities", *at)["doutputs"].reshape(r, -1)[:, event.output] / event.speed
    changes = np.zeros((len(weights), r))
    changes[event.output] = -(W_tv + W_tt * dT) / event.speed
    inputs = by_control_points(x.inputs, *at[1:], np.outer(dT, by_inputs), 1)
    return AtTime(changes, np.outer(dT, rate[:-1]), inputs)


def _rates_transposed(functions: AtStates, states: Array, t: Array, within: Array, weights: Array) -> Array:
    """Gradient (free + np + ninputs + 1) of the rates of independent entries; an array begins with their weights."""
    whole, nq = np.zeros((1, functions.nq + functions.nu)), functions.nq
    whole[0, functions.free] = weights[: len(functions.free)]
    found = np.zeros(1)
    parts = (
        ("sensitivities_transposed", "dudot", whole[:, nq:]),
        ("coordinate_rate_sensitivities_transposed", "dqdot", whole[:, :nq]),
    )
    for name, seed, of in parts:
        by = {seed: (of, np.zeros((*of.shape, functions.r)))}
        found = found + functions.transposed(name, states, t, within, by)[0, 0]
    return found


def by_control_points(x: Inputs, t: Array, within: Array, columns: Array, order: int = 0) -> Array:
    """Gradients (n, count, nsignals) with respect to control points, from gradients `columns` (n, ninputs) with respect to
    inputs at a time, or to their time derivatives."""
    whole = np.zeros((len(columns), *x.values.shape))
    unit = replace(x, values=np.eye(len(x.values)), moving=())
    signals = [(i, 0) for i in range(x.values.shape[1])] + [(i, n) for i in x.moving for n in (1, 2)]
    for (signal, n), column in zip(signals, columns.T, strict=True):
        whole[:, :, signal] += np.outer(column, unit.derivative(t, n + order, within=within)[0])
    return whole


__all__ = ["AtTime", "Crossed", "by_control_points", "of_event", "of_squares"]
