"""Gradients of weighted sums of results, by the transposed functions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array, Numbers, filled, lengths
from ..assembly.states import States
from ..calls.arguments import Seeds
from ..calls.functions import ALONG, STATE, WEIGHTED, WEIGHTS, Wanted
from ..calls.package import Package, state
from ..calls.room import Room
from .derivatives import Gradients

BY_ALL = {name: Wanted(name, ALONG) for name in WEIGHTED}
"""Gradients with respect to all arguments, including those that are zero in every state."""


class WeightedGradients(Room):
    """Gradients by transposed functions; the cost does not depend on the number of parameters."""

    def __init__(self, package: Package, states: States):
        super().__init__(package)
        self.states = states

    def of_assembled(self, given: tuple[Any, ...], weights_q: Numbers, weights_u: Numbers) -> Gradients:
        """See `Solver.assemble_gradients`."""
        if not self.closure_names:
            consistent = self.states.consistent_along(given, (weights_q, weights_u, None, None, None))
            if consistent is not None:
                *_, dq, du = consistent
                k = len(dq)
                return Gradients(dq, du, np.zeros((k, self.np)), np.zeros((k, self.ninputs)), np.zeros(k))
        arrays, batch = self._arguments.take(state(*given), self._left_out)
        weights = {"dfull_q": weights_q, "dfull_u": weights_u}
        (along, k), batch = Seeds.take(self._arguments, weights, arrays, batch, WEIGHTS)
        before = {i: lengths(arrays["q"][..., i : i + 4]) for i in self._arguments.quaternions}
        q_new: Array = self.states.assembled(arrays, batch)
        if self.package._has("completion_sensitivities_transposed"):
            name, at = "completion_sensitivities_transposed", {**arrays, "q": q_new}
            found = self.of(name, tuple(at[n] for n in STATE), tuple(along.get(d) for d in WEIGHTED[name]))
        else:
            zero, dtype = self._arguments.kind(0), q_new.dtype
            found = Gradients(
                *(filled((k, *batch, *self._shapes[n]), along.get(f"dfull_{n}", zero), dtype) for n in STATE)
            )
        for i, length in before.items():
            e, bar = q_new[..., i : i + 4], found.q[..., i : i + 4]
            bar -= e * np.sum(e * bar, axis=-1, keepdims=True)
            bar /= length
        return found

    def of(self, name: str, given: tuple[Any, ...], weights: tuple[Any, ...]) -> Gradients:
        """Gradients that the transposed function `name` returns."""
        return Gradients(*self._call(BY_ALL[name], given, weights))
