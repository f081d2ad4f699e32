"""Functions at many states of a motion, with derivatives along its directions; and the transposes of these functions, with
tangents along the directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..calls.arguments import Seeds
from ..statics.jets import Jet, value_of
from ..statics.second_derivatives import SecondDerivatives
from .inputs import Inputs
from .problem import Problem


class AtStates:
    """The functions of a choice of independents, on dual numbers, at many states whose loops are closed.

    Records of states are those of ``motion.h``: independent entries with their derivatives along r directions, and coordinates.
    """

    def __init__(self, functions: SecondDerivatives, problem: Problem, free: Array):
        self.functions, self.problem, self.free, self.r = functions, problem, free, len(problem.dp)
        self.nq, self.nu, self.np = len(problem.q), len(problem.u), len(problem.p)
        self.compiled = "output_hessian_products" in functions.functions

    def states(self, records: Array, t: Array, within: Array, completed: bool) -> Array:
        """All coordinates and speeds (n, 1 + r, nq + nu); dependent speeds are zero, since functions compute them.

        Without `completed`, derivatives of dependent coordinates are zero, too.
        """
        n, r, free, nq = len(records), self.r, self.free, self.nq
        found = np.zeros((n, 1 + r, nq + self.nu))
        rows = (1 + r) * len(free)
        found[:, :, free] = records[:, :rows].reshape(n, 1 + r, len(free))
        loops = len(free) < found.shape[2]
        if loops:
            found[:, 0, :nq] = records[:, rows : rows + nq]
        if completed and loops:
            found[:, 1:, :nq] = self.along("completion_sensitivities", found, t, within)["dfull_q"].transpose(1, 0, 2)
        return found

    def along(self, name: str, states: Array, t: Array, within: Array) -> dict[str, Array]:
        """Values (n, ...) and derivatives (r, n, ...) of a function's results at states (n, 1 + r, nq + nu)."""
        n, r, nq, x = len(states), self.r, self.nq, self.problem
        inputs, dinputs = self.inputs(t, within)
        dy, of = states[:, 1:].transpose(1, 0, 2), self.functions.functions[name]
        given = {
            "q": states[:, 0, :nq], "u": states[:, 0, nq:], "p": np.broadcast_to(x.p, (n, self.np)), "inputs": inputs, "t": t,
        }  # fmt: skip
        seeds = {
            "dq": dy[..., :nq], "du": dy[..., nq:], "dp": np.broadcast_to(x.dp[:, None], (r, n, self.np)),
            "dinputs": dinputs.transpose(2, 0, 1), "dt": np.zeros((r, n)),
        }  # fmt: skip
        found = getattr(self.functions.module, of.name)(
            *(given[a] for a in of.arguments), *(seeds[s] for s in of.seeds)
        )
        return {name: value_of(part) for name, part in zip(of.results, found, strict=True)}

    def outputs(self, states: Array, t: Array, within: Array, weights: Array, changes: Array) -> Array:
        """Gradients (n, 1 + r, free + np + ninputs) of weighted outputs, and their changes; see `transposed`.

        Uses compiled functions if the package has them, else dual numbers.
        """
        transposed = "output_sensitivities_transposed"
        if not self.compiled:
            return self.transposed(transposed, states, t, within, {"doutputs": (weights, changes)})
        n, r, nq, x = len(states), self.r, self.nq, self.problem
        inputs, dinputs = self.inputs(t, within)
        dy, functions = states[:, 1:].transpose(1, 0, 2), self.functions.functions
        arrays = {
            "q": states[:, 0, :nq], "u": states[:, 0, nq:], "p": x.p, "inputs": inputs, "t": t, "output_weights": weights,
        }  # fmt: skip
        along = {
            "dq": dy[..., :nq], "du": dy[..., nq:], "dp": np.broadcast_to(x.dp[:, None], (r, n, self.np)),
            "dinputs": dinputs.transpose(2, 0, 1), "dt": np.zeros((r, n, 1)),
        }  # fmt: skip
        every = np.concatenate([weights[None], changes.transpose(2, 0, 1)]) if changes.any() else weights[None]
        found = np.zeros((n, 1 + r, nq + self.nu + self.np + inputs.shape[1]))
        ends = np.cumsum([0, nq, self.nu, self.np, inputs.shape[1]]).tolist()
        places = {name: slice(*ends[i : i + 2]) for i, name in enumerate(("q", "u", "p", "inputs"))}
        second = functions["output_hessian_products"]
        seeds = {name: along[name] for name in second.seeds}
        for f, of, mark, first in ((functions[transposed], {"doutputs": every}, "d", 0), (second, seeds, "dg", 1)):
            k = len(next(iter(of.values())))
            held = {name: np.ascontiguousarray(array) for name, array in of.items()}
            given = {name: np.ascontiguousarray(arrays[name]) for name in f.arguments}
            results = self.functions.opened.target.compute(f, given, (n,), Seeds(held, k))
            for name, part in zip(f.results, results, strict=True):
                if (of_name := name.removeprefix(mark)) in places and name.startswith(mark):
                    found[:, first : first + k, places[of_name]] += part.transpose(1, 0, 2)
        return np.ascontiguousarray(found[:, :, [*self.free, *range(nq + self.nu, found.shape[2])]])

    def transposed(
        self, name: str, states: Array, t: Array, within: Array, weights: Mapping[str, tuple[Array, Array]]
    ) -> Array:
        """Gradients (n, 1 + r, free + np + ninputs) of weighted results, and their changes.

        Parameters
        ----------
        states : array (n, 1 + r, nq + nu)
        t, within : array (n,)
            Times, and times within the steps that contain them: inputs may jump between steps.
        weights : dict of two arrays (n, size), (n, size, r)
            Weights of results, and their changes along the directions.
        """
        x, n, r = self.problem, len(states), self.r
        y, dy = states[:, 0], states[:, 1:].transpose(0, 2, 1)
        inputs, dinputs = self.inputs(t, within)
        given = {
            "q": Jet(y[:, : self.nq], dy[:, : self.nq]),
            "u": Jet(y[:, self.nq :], dy[:, self.nq :]),
            "p": Jet(np.broadcast_to(x.p, (n, self.np)), np.broadcast_to(x.dp.T, (n, self.np, r))),
            "inputs": Jet(inputs, dinputs),
            "t": t,
        }
        seeds = {seed: Jet(value[None], change[None]) for seed, (value, change) in weights.items()}
        found = self.functions.along(name, given, seeds)
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
        whole = np.concatenate(parts, axis=2)
        kept = [*self.free, *range(self.nq + self.nu, whole.shape[2])]
        return np.ascontiguousarray(whole[:, :, kept])

    def inputs(self, t: Array, within: Array) -> tuple[Array, Array]:
        """Inputs (n, ninputs) at times, and their derivatives along the directions (n, ninputs, r); see `transposed`."""
        x: Inputs = self.problem.inputs
        values = x.at(t, within)
        along = np.zeros((*values.shape, self.r))
        if self.problem.dinputs is not None:
            for i, control in enumerate(self.problem.dinputs):
                along[..., i] = replace(x, values=control).at(t, within)
        return values, along


__all__ = ["AtStates"]
