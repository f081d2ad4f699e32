"""Mass matrix and inverse dynamics of mechanisms with loops, on their independent speeds.

Joint forces of a loop are not unique; those of the joints whose speeds are independent, with none at the others, are. The kinetic
energy of speeds x, to which the dependent ones are completed, is ``T(x) = x^T M x / 2``. Its derivative along a change y of them
is ``x^T M y``, and its derivative along a change of configuration gives that of M, by ``4 x^T dM y = (x + y)^T dM (x + y) - (x -
y)^T dM (x - y)``: no difference of neighbouring states, exact to rounding.

Where motion is prescribed it moves the mechanism without any independent speed, ``T(x) = x^T M x / 2 + b^T x + c``. Of x and -x
together b and c cancel; speeds are taken so large, by a power of two, that nothing of them is left in rounding either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.package import Package, seeds
from ..calls.results import places, put

FAST = 2.0**40
"""Times a unit speed, beside which prescribed motion stands still."""


class LoopForces(Package):
    """Mass matrix and inverse dynamics on independent speeds; n is their number."""

    def mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The mass matrix M (..., n, n) on the independent speeds, in O(n^2); of `inputs` and `t` prescribed motion makes use."""
        M = self._independent_mass(self._configuration(q, p, inputs, t))
        return _placed(["M"], [M], None if out is None else [out])[0]

    def mass_matrix_sensitivities(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """M (..., n, n) and its total derivative (k, ..., n, n) along the seeds, in O(n^3)."""
        at, along = self._configuration(q, p, inputs, t), {"dq": dq, "dp": dp, "dinputs": dinputs, "dt": dt}
        M = self._independent_mass(at)
        n = M.shape[-1]
        size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
        columns = [
            self._mass_along(at, np.eye(n)[j] / size[..., j : j + 1], size, along) * size[..., j, None]
            for j in range(n)
        ]
        if not columns:
            raise ValueError(
                f"{self.name} has no independent speeds, for its motion is wholly prescribed: its mass matrix has no entries"
            )
        dM = np.stack(columns, axis=-1)
        M, dM = _placed(["M", "dM"], [M, 0.5 * (dM + np.swapaxes(dM, -1, -2))], out)
        return M, dM

    def inverse_dynamics(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The forces (..., n) of the independent speeds' joints that udot needs beside the model's own.

        Of udot (..., nu) the independent entries are read; no force acts on the dependent ones.
        """
        functions: Any = self  # those of other sections
        missing = self._missing(udot, functions.accelerations(q, u, p, inputs, t))
        M = self._independent_mass(self._configuration(q, p, inputs, t))
        return _placed(["force"], [(M @ missing[..., None])[..., 0]], None if out is None else [out])[0]

    def inverse_dynamics_sensitivities(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None, dinputs: Numbers = None,
        dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The forces of `inverse_dynamics` and their total derivative (k, ..., n); ``dudot (k, ..., nu)``."""
        given = seeds(dq, du, dp, dinputs, dt)
        if all(x is None for x in given.values()):
            if dudot is None:
                raise ValueError("no seed is given; give at least one of dq, du, dudot, dp, dinputs, dt")
            given["du"] = np.zeros(self.nu)
        functions: Any = self
        free, changed = functions.sensitivities(q, u, p, inputs, t, **given)
        at = self._configuration(q, p, inputs, t)
        M, missing = self._independent_mass(at), self._missing(udot, free)
        more = self._missing(0.0 if dudot is None else self._arguments.array("dudot", dudot, "u"), changed)
        size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
        dtau = (M @ more[..., None])[..., 0]
        along = {"dq": dq, "dp": dp} | ({"dinputs": dinputs, "dt": dt} if self.prescribed_names else {})
        if any(x is not None for x in along.values()):
            largest = np.abs(missing * size).max(axis=-1, keepdims=True, initial=0.0)
            unit = missing / np.where(largest > 0.0, largest, 1.0)
            dtau = dtau + largest * self._mass_along(at, unit, size, along)
        force, dforce = _placed(["force", "dforce"], [(M @ missing[..., None])[..., 0], dtau], out)
        return force, dforce

    def bias_force(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The forces (..., n) that hold the independent accelerations at zero: M udot + bias_force = 0."""
        return self.inverse_dynamics(q, u, np.zeros(self.nu), p, inputs, t, out=out)

    def bias_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The forces of `bias_force` and their total derivative (k, ..., n) along the seeds."""
        return self.inverse_dynamics_sensitivities(
            q, u, np.zeros(self.nu), p, inputs, t, dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt, out=out
        )

    # -- from the kinetic energy ---------------------------------------------------------------------------------------

    @property
    def _free_speeds(self) -> list[int]:
        """Where the independent speeds stand in u."""
        return [self.speed_names.index(name) for name in self.independent_speed_names]

    def _configuration(self, q: Numbers, p: Numbers, inputs: Numbers, t: Times) -> Mapping[str, Array]:
        """What places of bodies depend on, as arrays."""
        given = {"q": q, "p": p} | ({"inputs": inputs, "t": t} if self.prescribed_names else {})
        found: Mapping[str, Array] = self._arguments.take(given, self._left_out)[0]
        return found

    def _speeds(self, x: Array) -> Array:
        """Speeds (..., nu) whose independent entries are x (..., n)."""
        u = np.zeros((*x.shape[:-1], self.nu))
        u[..., self._free_speeds] = x
        return u

    def _independent_mass(self, at: Mapping[str, Array]) -> Array:
        """M, (..., n, n): row by row the derivatives of T at a unit speed along unit changes of speeds."""
        n = len(self._free_speeds)
        batch = np.broadcast_shapes(*(np.shape(x)[: np.ndim(x) - (name != "t")] for name, x in at.items()))
        rows = self._speeds(np.eye(n)).reshape(n, *(1,) * len(batch), self.nu)
        along = rows.reshape(n, *(1,) * (1 + len(batch)), self.nu)
        speeds = np.broadcast_to(rows, (n, *batch, self.nu))
        functions: Any = self

        def slopes(u: Array) -> Array:
            """Derivatives of T along unit changes of speeds, (n, n, ...)."""
            found: Array = functions.energy_sensitivities(u=u, du=along, **at)[1][0]
            return found

        if self.prescribed_names:
            dT = (slopes(FAST * speeds) - slopes(-FAST * speeds)) / (2.0 * FAST)
        else:
            dT = slopes(speeds)
        M = np.moveaxis(dT, (0, 1), (-2, -1))
        return 0.5 * (M + np.swapaxes(M, -1, -2))

    def _mass_along(self, at: Mapping[str, Array], y: Array, size: Array, along: Mapping[str, Any]) -> Array:
        """dM y along seeds, (k, ..., n), for y (..., n) about as large as 1/size."""
        n = size.shape[-1]
        units = np.moveaxis(np.eye(n) / size[..., None], -2, 0)  # (n, ..., n): unit speeds of unit energy
        functions: Any = self
        same = {}  # (k, 1, ..., m): the same for all n states
        for name, x in along.items():
            seed = None if x is None else self._arguments.array(name, x, name[1:])
            axes = 1 if name == "dt" else 2
            same[name] = seed if seed is None or seed.ndim < axes else seed[:, None]

        def change(x: Array) -> Array:
            """dT at speeds, (k, n, ...)."""
            found: Array = functions.energy_sensitivities(u=self._speeds(x), **at, **same)[1][0]
            return found

        if not self.prescribed_names:
            total, difference = (change(units + sign * y) for sign in (1.0, -1.0))
            return np.moveaxis(0.5 * (total - difference), 1, -1) * size
        total, difference = (
            change(FAST * (units + sign * y)) + change(-FAST * (units + sign * y)) for sign in (1.0, -1.0)
        )
        return np.moveaxis(0.25 * (total - difference) / FAST**2, 1, -1) * size

    def _missing(self, udot: Any, free: Array) -> Array:
        """By how much accelerations differ from those wanted, at independent speeds."""
        wanted = np.asarray(udot, np.float64)
        if wanted.ndim and wanted.shape[-1] != self.nu:
            raise ValueError(f"udot has shape {wanted.shape}, expected (..., {self.nu}); independent entries are read")
        return np.asarray((wanted - free)[..., self._free_speeds])


def _placed(names: Sequence[str], found: Sequence[Array], out: Any) -> list[Array]:
    """Results in C order, in the caller's arrays if there are any."""
    return put([*map(np.ascontiguousarray, found)], [] if out is None else places(out, names, [x.shape for x in found]))
