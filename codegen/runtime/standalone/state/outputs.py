"""The model's outputs; arrays without entries where it has none."""

from __future__ import annotations

from ..arrays import Array, Numbers, Times
from ..calls.package import Package


class Outputs(Package):
    """The model's outputs."""

    def outputs(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The model's outputs (..., noutputs), in the order of `output_names`."""
        return self._call("outputs", (q, u, p, inputs, t), None, out)[0]

    def output_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The model's outputs (..., noutputs) and their total derivative (k, ..., noutputs) along the seeds."""
        along = (dq, du, dp, dinputs, dt)
        found: tuple[Array, Array] = self._call("output_sensitivities", (q, u, p, inputs, t), along, out)
        return found
