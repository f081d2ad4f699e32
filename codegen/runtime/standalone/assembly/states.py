"""Consistent states: assembly of guesses, the model's initial state, and their derivatives. `Loops` adds closed loops."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Shape, Times, filled, lengths, normalise
from ..calls.arguments import Seeds
from ..calls.functions import ALONG
from ..calls.package import Package, state
from ..calls.room import Room
from ..errors import AssemblyError, SingularLoopError


class States(Room):
    """Consistent states of a model: assembled coordinates and completed speeds.

    Parameters
    ----------
    package : Package
    equilibrium : callable
        `Solver.equilibrium`, for models with an initial equilibrium.
    """

    def __init__(self, package: Package, equilibrium: Callable[..., Any]):
        super().__init__(package)
        self._equilibrium, self._initial = equilibrium, package._initial

    def initial_state(self, p: Numbers) -> tuple[Array, Array]:
        """See `Solver.initial_state`."""
        if "initial_at_rest" in self._manifest:
            return self._at_rest(p, np.zeros(self.np))[:2]
        return self.assemble(None, None, p, None, 0.0)

    def initial_sensitivities(self, p: Numbers, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """See `Solver.initial_sensitivities`."""
        if "initial_at_rest" in self._manifest:
            return self._at_rest(p, dp)
        q, u = self.initial_values(p)
        dq, du = self.first_sensitivities(p, dp) or (None, None)
        return self.assemble_sensitivities((q, u, p, None, 0.0), (dq, du, dp, None, None))

    def first_sensitivities(self, p: Numbers, dp: Numbers) -> tuple[Array, Array] | None:
        """Derivatives (k, nq), (k, nu) of the model's initial values before assembly; None if they are constants."""
        if "initial_at_rest" in self._manifest:
            return self._at_rest(p, dp)[2:]
        if not self.package._has("initial_sensitivities"):
            return None
        _, _, dq, du = self._call("initial_sensitivities", (None, None, p, None, 0.0), (None, None, dp, None, None))
        return dq, du

    def assemble(
        self, q: Numbers, u: Numbers, p: Numbers, inputs: Numbers, t: Times, follow: bool | None = None
    ) -> tuple[Array, Array]:
        """See `Solver.assemble`."""
        if q is None or u is None:
            first = self.initial_values(p)
            q, u = first[0] if q is None else q, first[1] if u is None else u
        consistent = self._consistent((q, u, p, inputs, t))
        if consistent is not None:
            return consistent
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        q_new = self.assembled(arrays, batch, follow)
        return q_new, self.completed(q_new, arrays, batch)

    def assemble_sensitivities(
        self, given: tuple[Any, ...], along: tuple[Any, ...], follow: bool | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """See `Solver.assemble_sensitivities`."""
        consistent = self.consistent_along(given, along)
        if consistent is not None:
            return consistent
        arrays, batch = self._arguments.take(state(*given), self._left_out)
        (seeds, k), batch = Seeds.take(self._arguments, dict(zip(ALONG, along, strict=True)), arrays, batch)
        before = {i: lengths(arrays["q"][..., i : i + 4]) for i in self._arguments.quaternions}
        at, zero = {**arrays, "q": self.assembled(arrays, batch, follow)}, self._arguments.kind(0)
        dq_new, du_new = (
            filled((k, *batch, *self._shapes[n]), seeds.get(f"d{n}", zero), at["q"].dtype) for n in ("q", "u")
        )
        for i, length in before.items():
            e, de = at["q"][..., i : i + 4], dq_new[..., i : i + 4]
            de /= length
            de -= e * np.sum(e * de, axis=-1, keepdims=True)
        return at["q"], *self._completed_along(at, batch, (dq_new, du_new, *along[2:]))

    # -- assembly and completion ---------------------------------------------------------------------------------------

    @property
    def initial_is_fixed(self) -> bool:
        """Whether the initial state consists of constants, so that it does not depend on parameters."""
        return not (
            self.closure_names
            or self.prescribed_names
            or "initial_at_rest" in self._manifest
            or "initial" in self._functions
        )

    def _at_rest(self, p: Numbers, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """The initial equilibrium and its derivatives along dp: q, u, dq (k, nq), du (k, nu)."""
        at: Array = self._arguments.take({"p": p}, self._left_out)[0]["p"]
        if at.ndim != 1:
            raise ValueError(
                f"p has shape {at.shape}, expected ({self.np},): an equilibrium is found for one set of parameters"
            )
        along = np.atleast_2d(self._arguments.array("dp", dp, "p"))
        moving = np.flatnonzero(along.any(axis=0))
        first = self.assemble(None, None, at, None, 0.0)[0]
        found = self._equilibrium(first, at, sensitivities=[self.parameter_names[i] for i in moving])
        return found.q, np.zeros(self.nu), along[:, moving] @ found.dq, np.zeros((len(along), self.nu))

    def initial_values(self, p: Numbers) -> tuple[Array, Array]:
        """The initial values at parameters p, as a guess for assembly.

        If the initial values in the model file do not close the loops, the package contains assembled values for the
        default parameters. Changes of the file's values with the parameters are added to the assembled values.
        """
        if p is None or "initial" not in self._functions:
            return self._initial
        found = self._call("initial", (None, None, p, None, 0.0))
        default = self._call("initial", (None, None, None, None, 0.0))
        q, u = (
            np.where(known == d, x, known + (x - d)) for x, d, known in zip(found, default, self._initial, strict=True)
        )
        return q, u

    def first_values(self, p: Numbers) -> tuple[Array, Array]:
        """Default coordinates and speeds of a motion: the initial values, or the initial equilibrium."""
        return self.initial_state(p) if "initial_at_rest" in self._manifest else self.initial_values(p)

    def left_out(
        self, given: Mapping[str, Any], initial_state: Callable[[Numbers], tuple[Array, Array]]
    ) -> tuple[Array, Array]:
        """Values of entries that a mapping of coordinates or speeds omits: those of the initial state at the given
        parameters."""
        if "initial_at_rest" in self._manifest:
            return initial_state(given.get("p"))
        p = given.get("p")
        if p is not None and self.closure_names:
            # the given values may close the loops even where the initial independent coordinates do not
            with contextlib.suppress(SingularLoopError, AssemblyError):
                return initial_state(p)
        return self.initial_values(p)

    def _consistent(self, given: tuple[Any, ...]) -> tuple[Array, Array] | None:
        """Copies of q and u if they are float64 vectors of one closed state; otherwise None."""
        # the C code tests whether the arrays are float64 vectors
        if self._arguments.quaternions or self.package._one_state("coordinate_rates", given) is None:
            return None
        return given[0].copy(), given[1].copy()

    def consistent_along(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array, Array] | None:
        """Copies of q, u and the seeds dq, du if q and u are float64 vectors of one state that closes the loops; else
        None."""
        q, u, dq, du = *given[:2], *seeds[:2]
        if self._arguments.quaternions or not {type(dq), type(du)} <= {np.ndarray, type(None)}:
            return None
        rates = self.package._one_state("coordinate_rate_sensitivities", given, seeds)
        if rates is None:
            return None
        k = len(rates[1])
        dq = np.zeros((k, self.nq)) if dq is None else dq.reshape(k, self.nq).copy()
        du = np.zeros((k, self.nu)) if du is None else du.reshape(k, self.nu).copy()
        return q.copy(), u.copy(), dq, du

    def assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        """Assembled coordinates, (*batch, nq)."""
        q_new = filled((*batch, self.nq), arrays["q"], arrays["q"].dtype)
        normalise(q_new, self._arguments.quaternions)
        return q_new

    def moved(self, q: Array, arrays: Mapping[str, Any]) -> Array:
        """Assembles the coordinates (nq,) of one slightly changed state, by Newton's method alone."""
        q_new = q.copy()
        normalise(q_new, self._arguments.quaternions)
        return q_new

    def completed(self, q_new: Array, arrays: Mapping[str, Any], batch: Shape) -> Array:
        """Speeds (*batch, nu) consistent with assembled coordinates."""
        return filled((*batch, self.nu), arrays["u"], arrays["u"].dtype)

    def _completed_along(
        self, at: Mapping[str, Any], batch: Shape, seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array]:
        """Speeds consistent with assembled coordinates, and derivatives of coordinates and speeds, (k, *batch, nq) and
        (k, *batch, nu)."""
        return self.completed(at["q"], at, batch), seeds[0], seeds[1]
