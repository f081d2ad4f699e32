"""Statics and linearisation: equilibria and their derivatives, and the linearised equations about any state."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..assembly.partitions import conditions
from ..assembly.states import States
from ..calls.arguments import name_or_names, unknown
from ..calls.functions import ALONG, STATE
from ..calls.named_entries import Named, seeds_by_name
from ..calls.package import Package, state
from ..calls.room import Room, alone
from ..warning import warn
from .equilibrium import Equilibrium, Motions, Search, followed, neutral_directions, rests
from .linearization import Linearization, Matrices, is_stable
from .second_derivatives import SecondDerivatives
from .tangent_equations import Motion, Point, TangentEquations
from .tangent_space import TangentSpace

POOR = 1e4
"""Condition number of a closure matrix above which a warning says that equilibria and linearisations are doubtful."""

AT_REST = 1e-7
"""Acceleration, relative to that of a small motion, below which `linearize` treats a state as an equilibrium."""


class Statics(Room):
    """Methods that find equilibria and linearise the equations of motion."""

    def __init__(self, package: Package, states: States):
        super().__init__(package)
        self.states = states

    def equilibrium(
        self, q: Numbers, p: Numbers, inputs: Numbers, t: Times, sensitivities: str | Sequence[str], relax: bool,
        tolerance: float,
    ) -> Equilibrium:  # fmt: skip
        """See `Solver.equilibrium`."""
        self.package._needs_all("equilibrium")
        along = seeds_by_name(sensitivities, self.parameter_names, self.input_names)
        at, space = self._point(q, 0.0, p, inputs, t), self._tangent_space()

        def motions(q: Array) -> Motions:
            return self._motions(space, at._replace(q=q))

        f = self._functions["accelerations"]

        def udot(q: Array) -> Array:
            # the search may pass through any state: no warnings of infinite accelerations
            return self._opened.target.compute(f, at._replace(q=q).named(), ())[0][space.speeds]

        def retract(q: Array) -> Array:
            return self.states.moved(q, at.named())

        search = Search(motions, udot, retract, tolerance)
        found, m, relaxed = search.find(at.q, space.speed_names, relax)
        at, n = at._replace(q=found), space.n
        doubtful = self._look_at_rank("equilibrium", at, space, tolerance)
        damping = self._accelerations_along(at, du=space.units)[1][:, space.speeds].T
        A = np.block([[np.zeros((n, n)), np.eye(n)], [m.J, damping]])
        neutral = neutral_directions(m.J)
        return Equilibrium(
            at.q, at.u, float(np.abs(m.udot).max(initial=0.0)), search.iterations, relaxed, along.names,
            self._following(at, m, space, along), None if doubtful else is_stable(A, len(neutral)),
            neutral @ m.tangents, self.coordinate_names,
        )  # fmt: skip

    def linearize(
        self, q: Numbers, u: Numbers, p: Numbers, inputs: Numbers, t: Times, outputs: str | Sequence[str] | None
    ) -> Linearization:
        """See `Solver.linearize`."""
        self.package._needs_all("linearize")
        opened, space = self._opened, self._tangent_space()
        at = self._point(q, 0.0 if u is None else u, p, inputs, t)
        asked = self._asked_outputs(outputs)
        equations = TangentEquations(self.package, space, at, [self.output_names.index(name) for name in asked])
        udot, matrices = equations.matrices()
        n = space.n
        at_rest = not equations.moves and rests(udot, matrices.A[n:, :n], AT_REST)
        self._look_at_rank("linearize", at, space, AT_REST if at_rest else np.inf)

        @functools.cache
        def second() -> SecondDerivatives:
            return SecondDerivatives(opened)

        def derivatives(names: Sequence[str], moving: bool) -> Matrices:
            along = seeds_by_name(names, self.parameter_names, self.input_names)
            if self._opened is not opened:
                raise ValueError("the partition was changed after linearize; call linearize again, or change it back")
            if moving and not at_rest:
                raise ValueError(
                    "moving=True, but the state is not an equilibrium, so it cannot move with the parameters"
                )
            if moving:
                m = Motions(equations.tangents, udot, matrices.A[n:, :n])
                dq, du = self._following(at, m, space, along), np.zeros((len(along.names), self.nu))
            else:
                held = np.zeros((len(along.names), self.nq))
                _, _, dq, du = self._assembled_along(at, held, along.p)
            lost = np.isnan(dq).any(axis=1)
            dq[lost] = 0.0
            found = equations.derivatives(second, Motion(dq, du, along.p, along.inputs))
            for x in found:
                x[lost] = np.nan
            return found

        names = (*space.names, *(f"u.{name}" for name in space.speed_names))
        known = (*self.parameter_names, *(f"inputs.{name}" for name in self.input_names))
        return Linearization(
            matrices, (names, self.input_names, asked, known), (at.q, at.u, equations.tangents), at_rest, derivatives
        )

    # -- parts of the methods ------------------------------------------------------------------------------------------

    def _tangent_space(self) -> TangentSpace:
        return TangentSpace({**self._manifest, **self._opened.manifest})

    def _point(self, q: Numbers, u: Any, p: Numbers, inputs: Numbers, t: Times) -> Point:
        """One assembled state; u may be 0.0, which means rest."""
        q = self.states.assemble(None, None, p, None, 0.0)[0] if q is None else q
        u = np.zeros(self.nu) if isinstance(u, float) else u
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        alone(batch)
        at = Point(*(arrays[name] for name in STATE))
        q, u = self.states.assemble(*at)
        return at._replace(q=q, u=u)

    def _accelerations_along(self, at: Point, **seeds: Array) -> tuple[Array, Array]:
        """udot (nu,) and its derivatives (k, nu) along seeds."""
        return self._call("sensitivities", tuple(at), tuple(seeds.get(s) for s in ALONG))

    def _tangents(self, at: Point, space: TangentSpace) -> Array:
        """Changes of the coordinates (n, nq) per unit of each independent speed."""
        return self._call("coordinate_rates", (at.q, space.units, *at[2:]))[0]

    def _assembled_along(self, at: Point, dq: Array, dp: Array) -> tuple[Array, Array, Array, Array]:
        """The assembled state and its derivatives along changes of independent coordinates and parameters."""
        return self.states.assemble_sensitivities((*at[:3], None, 0.0), (dq, None, dp, None, None))

    def _motions(self, space: TangentSpace, at: Point) -> Motions:
        tangents = self._tangents(at, space)
        udot, dudot = self._accelerations_along(at, dq=tangents)
        return Motions(tangents, udot[space.speeds], dudot[:, space.speeds].T)

    def _look_at_rank(self, name: str, at: Point, space: TangentSpace, tolerance: float) -> bool:
        """Whether a loop has nearly lost rank; if so, warns that results are doubtful.

        Parameters
        ----------
        name : str
            The solver method in use, for the warning.
        at : Point
            A closed state; an equilibrium, if `tolerance` is finite.
        space : TangentSpace
        tolerance : float
            Tolerance for the accelerations of all speeds, including dependent ones, relative to 1 plus the accelerations that
            small motions of at most 1 rad or 1 m cause.
        """
        if not self.closure_names:
            return False
        choices = conditions(self.package, at.q, *at[2:])
        here = float(choices[self._opened.number])
        seen = [] if here <= POOR else [f"the condition number of its closure is {here:.2g}"]
        tangents = self._tangents(at, space)
        if space.n and math.isfinite(tolerance):
            udot, dudot = self._accelerations_along(at, dq=tangents)
            sizes = np.maximum(1.0, np.abs(tangents).max(axis=1, keepdims=True))
            left = np.abs(udot) - tolerance * (1.0 + np.abs(dudot / sizes).sum(axis=0))
            worst = int(np.argmax(left))
            if left[worst] > 0.0:
                seen.append(f"udot.{self.speed_names[worst]} = {udot[worst]:.2g} remains at a dependent speed")
        if not seen:
            return False
        better = int(np.argmin(choices))
        instead = (
            f"use_partition({better}), where the condition number is {choices[better]:.2g}, then call {name} again"
        )
        if choices[better] > 0.1 * here:
            instead = "call diagnose to see whether other independent coordinates (--partitions 2) are better"
        values = ", ".join(f"{n}={x:.6g}" for n, x in zip(self.coordinate_names[:6], at.q, strict=False))
        warn(
            f"{name}: loop {self._poorest_loop(at)} has nearly lost rank at {values}{', ...' * (self.nq > 6)}: "
            f"{' and '.join(seen)}. There, the independent coordinates "
            f"{', '.join(self.independent_names[:6])}{', ...' * (len(self.independent_names) > 6)} do not "
            f"determine position, stability, modes and derivatives, and other branches may begin; {instead}"
        )
        return True

    def _poorest_loop(self, at: Point) -> str:
        """The loop with the largest condition number of its closure."""
        opened = self._opened
        (of_loops,) = opened.target.compute(opened.functions["conditions"], at._replace(q=at.q.copy()).named(), ())
        loops: list[str] = opened.manifest["loops"]
        return loops[int(np.argmax(of_loops))]

    def _following(self, at: Point, m: Motions, space: TangentSpace, along: Named) -> Array:
        """dq (k, nq): derivatives of an equilibrium with respect to parameters and inputs; NaN if none exists
        nearby."""
        if not along.names:
            return np.zeros((0, self.nq))
        pushes = self._accelerations_along(at, dp=along.p, dinputs=along.inputs)[1][:, space.speeds]
        w = followed(m.J, pushes)
        lost = np.isnan(w).any(axis=1)
        w[lost] = 0.0
        dq = self._assembled_along(at, w @ m.tangents, along.p)[2]
        dq[lost] = np.nan
        return dq

    def _asked_outputs(self, outputs: str | Sequence[str] | None) -> tuple[str, ...]:
        """Names of the requested outputs; an error is raised if one is unknown or has no derivatives."""
        if outputs is None:
            return self.output_names if "output_sensitivities" in self._functions else ()
        asked = name_or_names("outputs", outputs)
        for name in asked:
            if name not in self.output_names:
                raise unknown("outputs", name, self.output_names)
        if asked:
            self._find(self._opened, "output_sensitivities")
        return asked
