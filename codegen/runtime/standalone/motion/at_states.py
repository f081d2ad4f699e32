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
from .problem import Problem


class AtStates:
    """The functions of a choice of independents, on dual numbers, at many states whose loops are closed.

    Records of states are those of ``motion.h``: independent entries with their derivatives along r directions, and coordinates.
    """

    def __init__(self, functions: SecondDerivatives, problem: Problem, free: Array):
        self.functions, self.problem, self.free, self.r = functions, problem, free, len(problem.dp)
        self.nq, self.nu, self.np = len(problem.q), len(problem.u), len(problem.p)
        self.inputs_at = len(free) + self.np  # where the entries for inputs begin in a gradient
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

    def given(self, states: Array, t: Array, within: Array) -> dict[str, Array]:
        """Arguments of functions at states."""
        n, nq, x = len(states), self.nq, self.problem
        p, inputs = np.broadcast_to(x.p, (n, self.np)), x.inputs.at(t, within)
        return {"q": states[:, 0, :nq], "u": states[:, 0, nq:], "p": p, "inputs": inputs, "t": t}

    def seeds(self, states: Array, t: Array, within: Array) -> dict[str, Array]:
        """The directions (r, n, size) at states (n, 1 + r, nq + nu)."""
        n, r, nq = len(states), self.r, self.nq
        dy, dp = states[:, 1:].transpose(1, 0, 2), np.broadcast_to(self.problem.dp[:, None], (r, n, self.np))
        dinputs = self.input_directions(t, within)
        return {"dq": dy[..., :nq], "du": dy[..., nq:], "dp": dp, "dinputs": dinputs, "dt": np.zeros((r, n, 1))}

    def along(self, name: str, states: Array, t: Array, within: Array) -> dict[str, Array]:
        """Values (n, ...) and derivatives (r, n, ...) of a function's results at states (n, 1 + r, nq + nu)."""
        return self.results(name, states, t, within, self.seeds(states, t, within))

    def results(
        self, name: str, states: Array, t: Array, within: Array, seeds: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Results of a function, along seeds if it has any."""
        given, of = self.given(states, t, within), self.functions.functions[name]
        along = {s: x[..., 0] if s == "dt" else x for s, x in seeds.items()}
        found = getattr(self.functions.module, of.name)(
            *(given[a] for a in of.arguments), *(along[s] for s in of.seeds)
        )
        return {name: value_of(part) for name, part in zip(of.results, found, strict=True)}

    def outputs(
        self,
        states: Array,
        t: Array,
        within: Array,
        weights: Array,
        changes: Array,
        along: Mapping[str, Array] | None = None,
    ) -> Array:
        """Gradients (n, 1 + r, free + np + ninputs + 1) of weighted outputs, and their changes; see `transposed`.

        Uses compiled functions if the package has them, else dual numbers.
        """
        transposed = "output_sensitivities_transposed"
        along = self.seeds(states, t, within) if along is None else along
        if not self.compiled:
            return self.transposed(transposed, states, t, within, {"doutputs": (weights, changes)}, along)
        n, r, functions = len(states), len(along["dt"]), self.functions.functions
        arrays = self.given(states, t, within) | {"p": self.problem.p, "output_weights": weights}
        every = np.concatenate([weights[None], changes.transpose(2, 0, 1)]) if changes.any() else weights[None]
        ends = np.cumsum([0, self.nq, self.nu, self.np, arrays["inputs"].shape[1], 1]).tolist()
        found = np.zeros((n, 1 + r, ends[-1]))
        places = {name: slice(*ends[i : i + 2]) for i, name in enumerate(("q", "u", "p", "inputs", "t"))}
        second = functions["output_hessian_products"]
        seeds = {name: along[name] for name in second.seeds}
        for f, of, mark, first in ((functions[transposed], {"doutputs": every}, "d", 0), (second, seeds, "dg", 1)):
            k = len(next(iter(of.values())))
            held = {name: np.ascontiguousarray(array) for name, array in of.items()}
            given = {name: np.ascontiguousarray(arrays[name]) for name in f.arguments}
            results = self.functions.opened.target.compute(f, given, (n,), Seeds(held, k))
            for name, part in zip(f.results, results, strict=True):
                if (of_name := name.removeprefix(mark)) in places and name.startswith(mark):
                    found[:, first : first + k, places[of_name]] += part.reshape(k, n, -1).transpose(1, 0, 2)
        return np.ascontiguousarray(found[:, :, [*self.free, *range(self.nq + self.nu, found.shape[2])]])

    def transposed(
        self,
        name: str,
        states: Array,
        t: Array,
        within: Array,
        weights: Mapping[str, tuple[Array, Array]],
        along: Mapping[str, Array] | None = None,
    ) -> Array:
        """Gradients (n, 1 + r, free + np + ninputs + 1) of weighted results, and their changes.

        Gradients have entries for the independent entries of the state, the parameters, the inputs and time.

        Parameters
        ----------
        states : array (n, 1 + r, nq + nu)
        t, within : array (n,)
            Times, and times within the steps that contain them: inputs may jump between steps.
        weights : dict of two arrays (n, size), (n, size, r)
            Weights of results, and their changes along the directions.
        along : dict of array (r, n, size), optional
            Other directions than the problem's.
        """
        along = self.seeds(states, t, within) if along is None else along
        n, r = len(states), len(along["dt"])
        slopes = {name: part.transpose(1, 2, 0) for name, part in along.items()} | {"dt": along["dt"][..., 0].T}
        given = {name: Jet(x, slopes[f"d{name}"]) for name, x in self.given(states, t, within).items()}
        seeds = {seed: Jet(value[None], change[None]) for seed, (value, change) in weights.items()}
        found = self.functions.along(name, given, seeds)
        sizes = {"dq": self.nq, "du": self.nu, "dp": self.np, "dinputs": given["inputs"].value.shape[1], "dt": 1}
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

    def input_directions(self, t: Array, within: Array, order: int = 0) -> Array:
        """Derivatives (r, n, ninputs) of the inputs, or of their time derivatives, along the directions."""
        x, of = self.problem.inputs, self.problem.dinputs
        if of is None:
            return np.zeros((self.r, *x.at(t, within).shape))
        return np.array([replace(x, values=control).at(t, within, order) for control in of])

    def flow(self, states: Array, t: Array, within: Array) -> dict[str, Array]:
        """The motion itself as a direction: rates (1, n, size) of independent entries, inputs and time at states."""
        rates = self.results("state_rates", states, t, within, {})
        dy = np.zeros((1, len(states), self.nq + self.nu))
        dy[0][:, self.free] = np.concatenate([rates["qdot"], rates["udot"]], axis=1)[:, self.free]
        zeros, dinputs = np.zeros((1, len(states), self.np)), self.problem.inputs.at(t, within, 1)[None]
        ones = np.ones((1, len(states), 1))
        found = {"dq": dy[..., : self.nq], "du": dy[..., self.nq :], "dp": zeros, "dinputs": dinputs, "dt": ones}
        if not self.compiled and len(self.free) < dy.shape[2]:
            found["dq"] = self.results("completion_sensitivities", states, t, within, found)["dfull_q"]
        return found


__all__ = ["AtStates"]
