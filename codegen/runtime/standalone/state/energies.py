"""Kinetic and potential energy."""

from __future__ import annotations

from ..arrays import Array, Numbers, Times
from ..calls.package import Package


class Energies(Package):
    """Kinetic and potential energy."""

    def energies(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Kinetic and potential energy, (...) each, J; gravity's is zero at the ground's origin."""
        (energy,) = self._call("energies", (q, u, p, inputs, t))
        return energy[..., 0], energy[..., 1]

    def energy_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:  # fmt: skip
        """Kinetic and potential energy, and their total derivatives: (T, V), (dT, dV), dT and dV (k, ...)."""
        along = (dq, du, dp, dinputs, dt)
        energy, denergy = self._call("energy_sensitivities", (q, u, p, inputs, t), along)
        return (energy[..., 0], energy[..., 1]), (denergy[..., 0], denergy[..., 1])
