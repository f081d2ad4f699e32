"""What trees only have: the mass matrix and its solutions, and the joint forces that a motion needs.

In loops joint forces are not unique.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.package import Package


class TreeForces(Package):
    """Mass matrix and inverse dynamics."""

    def mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The mass matrix M of Eq. 4, (..., nu, nu); of `inputs` and `t` prescribed motion makes use."""
        return self._call("mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def mass_matrix_sensitivities(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """M (..., nu, nu) and its total derivative (k, ..., nu, nu) along the seeds."""
        found: tuple[Array, Array] = self._call(
            "mass_matrix_sensitivities", (q, None, p, inputs, t), (dq, None, dp, dinputs, dt), out
        )
        return found

    def inverse_mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The inverse of the mass matrix, (..., nu, nu), in O(n^2): M is not formed. Its columns are those of `solve_mass`."""
        return self._call("inverse_mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def solve_mass(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The solution x (..., nu) of M x = b for generalised forces b (..., nu), in O(n)."""
        return self._call("solve_mass", (q, None, p, inputs, t, b), None, out)[0]

    def solve_mass_sensitivities(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        db: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """x (..., nu) of M x = b and its total derivative (k, ..., nu) along the seeds; ``db (k, ..., nu)``."""
        along = (dq, None, dp, dinputs, dt, db)
        found: tuple[Array, Array] = self._call("solve_mass_sensitivities", (q, None, p, inputs, t, b), along, out)
        return found

    def inverse_dynamics(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The joint forces (..., nu) that udot (..., nu) needs beside the model's own: M udot - K."""
        return self._call("inverse_dynamics", (q, u, p, inputs, t, udot), None, out)[0]

    def inverse_dynamics_sensitivities(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None, dinputs: Numbers = None,
        dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The joint forces of `inverse_dynamics` and their total derivative (k, ..., nu); ``dudot (k, ..., nu)``."""
        given, along = (q, u, p, inputs, t, udot), (dq, du, dp, dinputs, dt, dudot)
        found: tuple[Array, Array] = self._call("inverse_dynamics_sensitivities", given, along, out)
        return found

    def bias_force(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The joint forces (..., nu) that hold udot at zero, -K of Eq. 4: M udot + bias_force = 0."""
        return self._call("inverse_dynamics", (q, u, p, inputs, t, np.zeros(self.nu)), None, out)[0]

    def bias_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The forces of `bias_force` and their total derivative (k, ..., nu) along the seeds."""
        given, along = (q, u, p, inputs, t, np.zeros(self.nu)), (dq, du, dp, dinputs, dt, None)
        found: tuple[Array, Array] = self._call("inverse_dynamics_sensitivities", given, along, out)
        return found
