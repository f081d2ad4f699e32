"""The generalised forces that prescribed motion takes."""

from __future__ import annotations

from ..arrays import Array, Numbers, Times
from ..calls.package import Package


class DrivingForces(Package):
    """The generalised forces that prescribed motion takes."""

    def driving_forces(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:  # fmt: skip
        """The generalised force, N m or N, along each of `prescribed_names`, (..., nprescribed).

        It is what has to act there beside the model's own forces for the coordinate to move as it is prescribed; its power is
        force times rate.
        """
        return self._call("driving_forces", (q, u, p, inputs, t), None, out)[0]

    def driving_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """`driving_forces` and their total derivative (k, ..., nprescribed) along the seeds."""
        along = (dq, du, dp, dinputs, dt)
        found: tuple[Array, Array] = self._call("driving_force_sensitivities", (q, u, p, inputs, t), along, out)
        return found
