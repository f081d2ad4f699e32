"""Consistent states: what a guess becomes, the model's initial state, and their derivatives; `Loops` adds what closes loops."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Shape, Times, filled, lengths, normalise
from ..calls.arguments import Seeds
from ..calls.package import Package, seeds, state
from ..errors import AssemblyError, SingularLoopError


class States(Package):
    """Consistent states."""

    @property
    def initial(self) -> tuple[Array, Array]:
        """The model's initial state (q, u) at the default parameters, assembled."""
        return self.initial_state()

    def initial_state(self, p: Numbers = None) -> tuple[Array, Array]:
        """The model's initial state (q, u) at some parameters, assembled: initial values may be expressions of them.

        Of a model that begins in equilibrium it is the state of rest that the initial values lead to, inputs of zero, t = 0.
        """
        if "initial_at_rest" in self._manifest:
            return self._at_rest(p, np.zeros(self.np))[:2]
        return self.assemble(p=p)

    def initial_sensitivities(self, p: Numbers = None, *, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """The state of `initial_state` and its derivatives: q, u, dq (k, ..., nq), du (k, ..., nu).

        Where initial values depend on parameters, theirs are part of it, and loops stay closed.
        """
        if "initial_at_rest" in self._manifest:
            return self._at_rest(p, dp)
        q, u = self._initial_values(p)
        dq = du = None
        if self._has("initial_sensitivities"):
            _, _, dq, du = self._call("initial_sensitivities", (None, None, p, None, 0.0), (None, None, dp, None, None))
        return self.assemble_sensitivities(q, u, p, dq=dq, du=du, dp=dp)

    def assemble(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        follow: bool | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """A consistent state (q, u): loops closed, quaternions of unit length.

        Loops stay on the branch of the guess. A guess whose dependent coordinates are those of a closed state, at other
        independent coordinates or another time, is followed from there as a motion along the straight way would go; so is the
        initial state, from the default parameters and t = 0 too.

        Parameters
        ----------
        q, u : (..., nq) and (..., nu), optional
            The guess; its independent entries are kept, dependent ones are changed. What is left out is the model's initial
            state.
        follow : bool, optional
            Whether the states along the last axis of a batch are a path: each is followed from the one before it, whatever its
            own dependent entries are, and the first from its guess. Left out: along the axis of t where motion is prescribed
            and all times have the same guess, else not.

        Raises
        ------
        AssemblyError
            Names the loop and what is left of its conditions, or where its branch ends on the way.

        Warns
        -----
        RuntimeWarning
            Where the branch is in doubt: loops lose rank on the way, or the guess is far from any closed state.

        Examples
        --------
        >>> q, u = solver.assemble({"crank": np.linspace(0.0, 6.28, 100)}, follow=True)
        """
        if q is None or u is None:
            first = self._initial_values(p)
            q, u = first[0] if q is None else q, first[1] if u is None else u
        consistent = self._consistent((q, u, p, inputs, t))
        if consistent is not None:
            return consistent
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        q_new = self._assembled(arrays, batch, follow)
        return q_new, self._completed(q_new, arrays, batch)

    def assemble_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        follow: bool | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """A consistent state and its derivatives along the seeds: q, u, dq (k, ..., nq), du (k, ..., nu).

        Only the independent entries of the seeds are read; the dependent ones follow from closure. `follow` as for
        `assemble`.
        """
        consistent = self._consistent_along((q, u, p, inputs, t), (dq, du, dp, dinputs, dt))
        if consistent is not None:
            return consistent
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        (along, k), batch = Seeds.take(self._arguments, seeds(dq, du, dp, dinputs, dt), arrays, batch)
        before = {i: lengths(arrays["q"][..., i : i + 4]) for i in self._arguments.quaternions}
        q_new = self._assembled(arrays, batch, follow)
        dq_new = filled((k, *batch, self.nq), along.get("dq", 0.0), q_new.dtype)
        du_new = filled((k, *batch, self.nu), along.get("du", 0.0), q_new.dtype)
        for i, length in before.items():
            e, de = q_new[..., i : i + 4], dq_new[..., i : i + 4]
            de /= length
            de -= e * np.sum(e * de, axis=-1, keepdims=True)
        rest = {"dp": dp, "dinputs": dinputs, "dt": dt}
        return self._completed_along(q_new, arrays, batch, dq_new, du_new, rest)

    def closure(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Scaled residuals of the loops in position and velocity, (..., len(closure_names)) each.

        Linear conditions are divided by the loop's characteristic length; the velocities are those of u as it is given.
        """
        position, velocity = self._call("closure", (q, u, p, inputs, t))
        return position, velocity

    def closure_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Scaled position residuals (..., len(closure_names)), and by how much completed seeds open them, (k, ..., the same).

        The latter is zero to rounding unless conditions are redundant and a direction does not keep them, such as a
        parameter that bends a planar loop out of its plane: then no derivative exists along it.
        """
        along = (dq, du, dp, dinputs, dt)
        found: tuple[Array, Array] = self._call("closure_sensitivities", (q, u, p, inputs, t), along)
        return found

    # -- how -----------------------------------------------------------------------------------------------------------

    @property
    def _initial_is_fixed(self) -> bool:
        """Whether the initial state is a matter of numbers alone: nothing in it follows from parameters."""
        return not (
            self.closure_names
            or self.prescribed_names
            or "initial_at_rest" in self._manifest
            or "initial" in self._functions
        )

    def _at_rest(self, p: Numbers, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """The equilibrium that the initial values lead to, and its derivatives along dp: q, u, dq (k, nq), du (k, nu)."""
        at: Array = self._arguments.take({"p": p}, self._left_out)[0]["p"]
        if at.ndim != 1:
            raise ValueError(
                f"p has shape {at.shape}, expected ({self.np},): an equilibrium is found for one set of parameters"
            )
        along = np.atleast_2d(self._arguments.array("dp", dp, "p"))
        moving = np.flatnonzero(along.any(axis=0))
        statics: Any = self  # a section of its own
        found = statics.equilibrium(self.assemble(p=at)[0], at, sensitivities=[self.parameter_names[i] for i in moving])
        return found.q, np.zeros(self.nu), along[:, moving] @ found.dq, np.zeros((len(along), self.nu))

    def _initial_values(self, p: Numbers) -> tuple[Array, Array]:
        """The initial values at some parameters, as a guess for assembly.

        Where the model's values do not close its loops, the package has assembled ones at the default parameters; they move
        with the parameters as the model's do.
        """
        if p is None or "initial" not in self._functions:
            return self._initial
        found = self._call("initial", (None, None, p, None, 0.0))
        default = self._call("initial", (None, None, None, None, 0.0))
        q, u = (
            np.where(known == d, x, known + (x - d)) for x, d, known in zip(found, default, self._initial, strict=True)
        )
        return q, u

    def _first_values(self, p: Numbers) -> tuple[Array, Array]:
        """Where a motion begins that is given other coordinates or speeds: the initial values, or the state of rest."""
        return self.initial_state(p) if "initial_at_rest" in self._manifest else self._initial_values(p)

    def _left_out(self, name: str, given: Mapping[str, Any]) -> Array | float:
        """What a mapping leaves out: the initial state at the given parameters, default parameters, else zeros."""
        if name not in ("q", "u"):
            return super()._left_out(name, given)
        if "initial_at_rest" in self._manifest:
            return self.initial_state(given.get("p"))[name == "u"]
        p = given.get("p")
        if p is not None and self.closure_names:
            # what the mapping says may close where the initial independent coordinates do not
            with contextlib.suppress(SingularLoopError, AssemblyError):
                return self.initial_state(p)[name == "u"]
        return self._initial_values(p)[name == "u"]

    def _consistent(self, given: tuple[Any, ...]) -> tuple[Array, Array] | None:
        """A copy of q and u where they are one state in plain arrays, consistent as it is; None of anything else."""
        # the C says whether they are plain
        if self._arguments.quaternions or self._one_state("coordinate_rates", given) is None:
            return None
        return given[0].copy(), given[1].copy()

    def _consistent_along(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array, Array] | None:
        """The same with its derivatives along seeds."""
        if self._arguments.quaternions:
            return None
        rates = self._one_state("coordinate_rate_sensitivities", given, seeds)
        if rates is None:
            return None
        k = len(rates[1])
        dq, du = (filled((k, n), 0.0 if x is None else x) for n, x in zip((self.nq, self.nu), seeds, strict=False))
        return given[0].copy(), given[1].copy(), dq, du

    def _assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        """Assembled coordinates, (*batch, nq)."""
        q_new = filled((*batch, self.nq), arrays["q"], arrays["q"].dtype)
        normalise(q_new, self._arguments.quaternions)
        return q_new

    def _moved(self, q: Array, arrays: Mapping[str, Any]) -> Array:
        """Coordinates (nq,) of one state that was moved by little, assembled: by Newton's method alone."""
        q_new = q.copy()
        normalise(q_new, self._arguments.quaternions)
        return q_new

    def _completed(self, q_new: Array, arrays: Mapping[str, Any], batch: Shape) -> Array:
        """Speeds that belong to assembled coordinates, (*batch, nu)."""
        return filled((*batch, self.nu), arrays["u"], arrays["u"].dtype)

    def _completed_along(
        self,
        q_new: Array,
        arrays: Mapping[str, Any],
        batch: Shape,
        dq_new: Array,
        du_new: Array,
        rest: Mapping[str, Any],
    ) -> tuple[Array, Array, Array, Array]:
        """Assembled coordinates, the speeds that belong to them, and derivatives of both, (k, *batch, nq) and (k, *batch, nu)."""
        return q_new, self._completed(q_new, arrays, batch), dq_new, du_new
