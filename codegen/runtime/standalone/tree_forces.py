"""What trees only have: the mass matrix and its solutions, and the joint forces that a motion needs.

In loops joint forces are not unique.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Array, Numbers, Times
from .package import Package, seeds, state


class TreeForces(Package):
    """Mass matrix and inverse dynamics."""

    def mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The mass matrix M of Eq. 4, (..., nu, nu); of `inputs` and `t` prescribed motion makes use."""
        found: Array | None = self._desk.mass_matrix(q, None, p, inputs, t, out)
        return self._values("mass_matrix", _placed(q, p, inputs, t), out)[0] if found is None else found

    def mass_matrix_sensitivities(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """M (..., nu, nu) and its total derivative (k, ..., nu, nu) along the seeds."""
        along = {"dq": dq, "dp": dp, "dinputs": dinputs, "dt": dt}
        return self._along("mass_matrix_sensitivities", _placed(q, p, inputs, t), along, out)

    def inverse_mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The inverse of the mass matrix, (..., nu, nu), in O(n^2): M is not formed. Its columns are those of `solve_mass`."""
        found: Array | None = self._desk.inverse_mass_matrix(q, None, p, inputs, t, out)
        return self._values("inverse_mass_matrix", _placed(q, p, inputs, t), out)[0] if found is None else found

    def solve_mass(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The solution x (..., nu) of M x = b for generalised forces b (..., nu), in O(n)."""
        return self._values("solve_mass", {"b": b} | _placed(q, p, inputs, t), out)[0]

    def solve_mass_sensitivities(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        db: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """x (..., nu) of M x = b and its total derivative (k, ..., nu) along the seeds; ``db (k, ..., nu)``."""
        along = {"dq": dq, "db": db, "dp": dp, "dinputs": dinputs, "dt": dt}
        return self._along("solve_mass_sensitivities", {"b": b} | _placed(q, p, inputs, t), along, out)

    def inverse_dynamics(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The joint forces (..., nu) that udot (..., nu) needs beside the model's own: M udot - K."""
        return self._values("inverse_dynamics", {"udot": udot} | state(q, u, p, inputs, t), out)[0]

    def inverse_dynamics_sensitivities(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None, dinputs: Numbers = None,
        dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The joint forces of `inverse_dynamics` and their total derivative (k, ..., nu); ``dudot (k, ..., nu)``."""
        given, along = {"udot": udot} | state(q, u, p, inputs, t), seeds(dq, du, dp, dinputs, dt) | {"dudot": dudot}
        return self._along("inverse_dynamics_sensitivities", given, along, out)

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
        return self.inverse_dynamics(q, u, np.zeros(self.nu), p, inputs, t, out=out)

    def bias_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The forces of `bias_force` and their total derivative (k, ..., nu) along the seeds."""
        given, along = {"udot": np.zeros(self.nu)} | state(q, u, p, inputs, t), seeds(dq, du, dp, dinputs, dt)
        return self._along("inverse_dynamics_sensitivities", given, along, out)


def _placed(q: Numbers, p: Numbers, inputs: Numbers, t: Times) -> dict[str, Any]:
    """Arguments by name of what speeds do not enter."""
    return {"q": q, "p": p, "inputs": inputs, "t": t}
