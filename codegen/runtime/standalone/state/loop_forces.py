"""Mass matrix and inverse dynamics of mechanisms with loops, on their independent speeds.

The joint forces of a loop are not unique. They become unique if only joints with independent speeds have forces. Let x
be a vector of all speeds, in which the independent speeds are given and the dependent speeds follow from closure. The
kinetic energy is ``T(x) = x^T M x / 2``. Its derivative along a change y of the speeds is ``x^T M y``. Its derivative
along a change of configuration gives dM, by ``4 x^T dM y = (x + y)^T dM (x + y) - (x - y)^T dM (x - y)``. No nearby
states are subtracted, so the result is exact to rounding.

Prescribed motion moves the mechanism even at zero independent speeds: ``T(x) = x^T M x / 2 + b^T x + c``. The terms b and c
cancel between x and -x. The speeds are scaled by a large power of two, so that rounding errors of b and c vanish, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.functions import ALONG, STATE
from ..calls.package import Composed, Package
from ..calls.results import places, put
from ..calls.room import Room

FAST = 2.0**40
"""Factor on unit speeds that makes the speeds of prescribed motion negligible."""


class LoopForces(Room):
    """Mass matrix and inverse dynamics of a mechanism with loops, on its n independent speeds.

    Attributes
    ----------
    functions : dict of str to callable
        Called like `Package._call`: with arguments and seeds in the order of `Function`, and `out`.
    """

    def __init__(self, package: Package):
        super().__init__(package)
        self.functions: dict[str, Composed] = {
            "mass_matrix": self.mass_matrix, "mass_matrix_sensitivities": self.mass_matrix_sensitivities,
            "inverse_dynamics": self.inverse_dynamics, "inverse_dynamics_sensitivities": self.inverse_dynamics_sensitivities,
        }  # fmt: skip

    def mass_matrix(self, given: tuple[Any, ...], along: tuple[Any, ...] | None, out: Any) -> list[Array]:
        """The mass matrix M (..., n, n) of the independent speeds, in O(n^2); only prescribed motion depends on `inputs` and
        `t`."""
        M = self._independent_mass(self._configuration(given))
        return _placed(["M"], [M], None if out is None else [out])

    def mass_matrix_sensitivities(self, given: tuple[Any, ...], along: tuple[Any, ...], out: Any) -> tuple[Array, ...]:
        """M (..., n, n) and its total derivative (k, ..., n, n) along the seeds, in O(n^3)."""
        at, seeds = self._configuration(given), {s: x for s, x in zip(ALONG, along, strict=True) if s != "du"}
        M = self._independent_mass(at)
        n = M.shape[-1]
        size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
        columns = [
            self._mass_along(at, np.eye(n)[j] / size[..., j : j + 1], size, seeds) * size[..., j, None]
            for j in range(n)
        ]
        if not columns:
            raise ValueError(
                f"{self.name} has no independent speeds, because all motion is prescribed, so its mass matrix is empty"
            )
        dM = np.stack(columns, axis=-1)
        return tuple(_placed(["M", "dM"], [M, 0.5 * (dM + np.swapaxes(dM, -1, -2))], out))

    def inverse_dynamics(self, given: tuple[Any, ...], along: tuple[Any, ...] | None, out: Any) -> list[Array]:
        """Forces (..., n) at joints with independent speeds that udot requires in addition to the model's forces.

        Only the independent entries of udot (..., nu) are used; joints with dependent speeds have no additional force.
        """
        missing = self._missing("udot", given[5], self._call("accelerations", given[:5])[0])
        M = self._independent_mass(self._configuration(given))
        return _placed(["force"], [(M @ missing[..., None])[..., 0]], None if out is None else [out])

    def inverse_dynamics_sensitivities(
        self, given: tuple[Any, ...], along: tuple[Any, ...], out: Any
    ) -> tuple[Array, ...]:
        """The forces of `inverse_dynamics` and their total derivative (k, ..., n). The last seed is ``dudot (k, ..., nu)``."""
        seeds, dudot = along[:5], along[5]
        if all(x is None for x in seeds):
            if dudot is None:
                raise ValueError("no seed given; give at least one of dq, du, dudot, dp, dinputs, dt")
            seeds = (None, np.zeros(self.nu), None, None, None)
        free, changed = self._call("sensitivities", given[:5], seeds)
        at = self._configuration(given)
        M, missing = self._independent_mass(at), self._missing("udot", given[5], free)
        more = self._missing("dudot", np.zeros((1, self.nu)) if dudot is None else dudot, changed)
        size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
        dtau = (M @ more[..., None])[..., 0]
        moving = ("dq", "dp", "dinputs", "dt") if self.prescribed_names else ("dq", "dp")
        shift = {s: x for s, x in zip(ALONG, along[:5], strict=True) if s in moving}
        if any(x is not None for x in shift.values()):
            largest = np.abs(missing * size).max(axis=-1, keepdims=True, initial=0.0)
            unit = missing / np.where(largest > 0.0, largest, 1.0)
            dtau = dtau + largest * self._mass_along(at, unit, size, shift)
        return tuple(_placed(["force", "dforce"], [(M @ missing[..., None])[..., 0], dtau], out))

    # -- derivatives of the kinetic energy -----------------------------------------------------------------------------

    @property
    def _free_speeds(self) -> list[int]:
        """Indices of the independent speeds in u."""
        return [self.speed_names.index(name) for name in self.independent_speed_names]

    def _configuration(self, given: tuple[Any, ...]) -> Mapping[str, Array]:
        """The arguments on which positions depend, as arrays."""
        read = ("q", "p", "inputs", "t") if self.prescribed_names else ("q", "p")
        known = {n: x for n, x in zip(STATE, given, strict=False) if n in read}
        return self._arguments.take(known, self._left_out)[0]

    def _speeds(self, x: Array) -> Array:
        """Speeds (..., nu) with independent entries x (..., n)."""
        u = np.zeros((*x.shape[:-1], self.nu), x.dtype)
        u[..., self._free_speeds] = x
        return u

    def _independent_mass(self, at: Mapping[str, Array]) -> Array:
        """M (..., n, n): row i holds the derivatives of the kinetic energy T at unit speed i with respect to all
        speeds."""
        n = len(self._free_speeds)
        batch = np.broadcast_shapes(*(np.shape(x)[: np.ndim(x) - (name != "t")] for name, x in at.items()))
        rows = self._speeds(np.eye(n)).reshape(n, *(1,) * len(batch), self.nu)
        along = rows.reshape(n, *(1,) * (1 + len(batch)), self.nu)
        speeds = np.broadcast_to(rows, (n, *batch, self.nu))

        def slopes(u: Array) -> Array:
            """Derivatives of T along unit changes of the speeds, (n, n, ...)."""
            return self._kinetic_along(at, u, {"du": along})

        if self.prescribed_names:
            dT = (slopes(FAST * speeds) - slopes(-FAST * speeds)) / (2.0 * FAST)
        else:
            dT = slopes(speeds)
        M = np.moveaxis(dT, (0, 1), (-2, -1))
        return 0.5 * (M + np.swapaxes(M, -1, -2))

    def _mass_along(self, at: Mapping[str, Array], y: Array, size: Array, along: Mapping[str, Any]) -> Array:
        """dM y along seeds, (k, ..., n); the entries of y (..., n) should have the magnitude of 1/size."""
        n = size.shape[-1]
        units = np.moveaxis(np.eye(n) / size[..., None], -2, 0)  # (n, ..., n): unit speeds scaled to unit energy
        same = {}  # (k, 1, ..., m): shared by all n speeds
        for name, x in along.items():
            seed = None if x is None else self._arguments.array(name, x, name[1:])
            axes = 1 if name == "dt" else 2
            same[name] = seed if seed is None or seed.ndim < axes else seed[:, None]

        def change(x: Array) -> Array:
            """dT at the given independent speeds, (k, n, ...)."""
            return self._kinetic_along(at, self._speeds(x), same)

        if not self.prescribed_names:
            total, difference = (change(units + sign * y) for sign in (1.0, -1.0))
            return np.moveaxis(0.5 * (total - difference), 1, -1) * size
        total, difference = (
            change(FAST * (units + sign * y)) + change(-FAST * (units + sign * y)) for sign in (1.0, -1.0)
        )
        return np.moveaxis(0.25 * (total - difference) / FAST**2, 1, -1) * size

    def _kinetic_along(self, at: Mapping[str, Array], u: Array, seeds: Mapping[str, Any]) -> Array:
        """The derivative of the kinetic energy along given seeds."""
        given = at["q"], u, at["p"], at.get("inputs"), at.get("t", 0.0)
        return self._call("energy_sensitivities", given, tuple(seeds.get(s) for s in ALONG))[1][..., 0]

    def _missing(self, name: str, wanted: Any, free: Array) -> Array:
        """The differences of required and free accelerations (or their derivatives) of the independent speeds."""
        return np.asarray((self._arguments.array(name, wanted, "udot") - free)[..., self._free_speeds])


def _placed(names: Sequence[str], found: Sequence[Array], out: Any) -> list[Array]:
    """Copies results in C order to the caller's arrays, if there are any."""
    return put([*map(np.ascontiguousarray, found)], [] if out is None else places(out, names, [x.shape for x in found]))
