"""Gradients of weighted sums of results: the transposes of the functions along seeds, in one sweep back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, lengths
from ..assembly.states import States
from ..calls.arguments import Seeds
from ..calls.functions import ALONG, STATE, WEIGHTED, Wanted
from ..calls.package import Package, state
from ..calls.room import Room
from .derivatives import Gradients

WEIGHTS = {"dudot": "weights", "doutputs": "weights", "denergy": "weights", "dqdot": "weights", "dfull_q": "weights_q",
           "dfull_u": "weights_u"}  # fmt: skip
"""What the weights of generated functions are called here."""


BY_ALL = {name: Wanted(name, ALONG) for name in WEIGHTED}
"""Derivatives by everything, those too that the functions leave out since they are zero."""


class WeightedGradients(Room):
    """Gradients, by the transposes of the sensitivities: the cost does not depend on the number of parameters."""

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
            wide = {
                n: np.broadcast_to(along.get(f"dfull_{n}", 0.0), (k, *batch, *self._shapes[n])).astype(q_new.dtype)
                for n in "qu"
            }
            found = self._filled({f"d{n}": x for n, x in wide.items()}, k, batch)
        for i, length in before.items():
            e, bar = q_new[..., i : i + 4], found.q[..., i : i + 4]
            bar -= e * np.sum(e * bar, axis=-1, keepdims=True)
            bar /= length
        return found

    def of(self, name: str, given: tuple[Any, ...], weights: tuple[Any, ...]) -> Gradients:
        """Gradients by a transposed function."""
        package = self.package
        if not package._watched:
            gradients = package._calls[BY_ALL[name]](given, weights, None)
            if gradients is not None:
                return Gradients(*gradients)
        arrays, batch = self._arguments.take(dict(zip(STATE, given, strict=True)), self._left_out)
        named = dict(zip(WEIGHTED[name], weights, strict=True))
        seeds, batch = Seeds.take(self._arguments, named, arrays, batch, WEIGHTS)
        if not any(self._shapes[w[1:]][-1] for w in named):  # no outputs
            return self._filled({}, seeds.k, batch)
        opened = package._opened
        f = self._find(opened, name)
        if package._watched:
            package._look_at_directions(name, given, (None, None, np.eye(self.np), None, None))
        results = dict(zip(f.results, package._compute(opened, f, arrays, batch, seeds, []), strict=True))
        return self._filled(results, seeds.k, batch)

    def _filled(self, found: Mapping[str, Array], k: int, batch: tuple[int, ...]) -> Gradients:
        """Gradients, zero with respect to what a function does not depend on."""
        return Gradients(
            *(
                found[d] if d in found else np.zeros((k, *batch, *self._shapes[d[1:]]), self._arguments.dtype)
                for d in ALONG
            )
        )
