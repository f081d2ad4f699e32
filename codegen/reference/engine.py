"""What the reference engines have in common: the face. Arguments are checked and become pairs, results become arrays.

No mechanics stands here. An engine fills in the methods that begin with an underscore.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np

from ..loops.partition import Partition
from ..loops.partition import partition as choose_partition
from ..loops.speed_groups import SpeedGroup, coordinates_of
from ..model.entries import ZERO
from ..model.forces import ForceElement
from ..model.model import Model, closure_row_names
from ..model.places import Face, Point
from .arithmetic import Arithmetic, Array
from .forces import LAWS, End, Wrench
from .outputs import VALUES, Moving
from .pairs import Pair, Pairs
from .primitives import placed_rotation

INCONSISTENT = 1e-6
"""A redundant condition that is off by more than this part of the speeds or seeds is reported."""

ALLOWED = 10.0
"""Tolerances of the model that a dropped condition may be off by, per unit of speeds or seeds."""

SMALLEST_QUATERNION = 1e-6
"""A quaternion shorter than this has no direction worth a rotation."""


@dataclass(frozen=True, slots=True)
class State:
    """The arguments of one call, as pairs.

    Attributes
    ----------
    pairs : Pairs
        Evaluates the model's expressions at this state.
    q : Pair
        Coordinates, (nq, 1), with derivatives (k, nq, 1).
    u : Pair
        Speeds, (nu, 1), with derivatives (k, nu, 1).
    """

    pairs: Pairs
    q: Pair
    u: Pair

    def moved(self, model: Model, q: Pair, u: Pair) -> State:
        """The same arguments with other coordinates and speeds."""
        environment = dict(self.pairs.environment)
        environment |= {f"q.{name}": q[i, 0] for i, name in enumerate(model.coordinate_names)}
        environment |= {f"u.{name}": u[i, 0] for i, name in enumerate(model.speed_names)}
        return State(Pairs(self.pairs.arithmetic, self.pairs.k, environment), q, u)


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Partial derivatives of a result (n,), udot for one: q (n, nq), u (n, nu), p (n, np), inputs (n, ninputs), t (n,)."""

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array


Gradients = tuple[Array, Array, Array, Array, Array]
"""Of k weighted sums with respect to q, u, p, inputs, (k, n) each, and t, (k,)."""


class Engine(ABC):
    """A reference engine: any model, one state per call, derivatives along any seeds.

    Parameters
    ----------
    model : Model
    numbers : {"float64", "mpmath", "decimal"}
        With ``mpmath`` every array holds mpf numbers of the caller's ``mpmath.mp.dps`` digits, with ``decimal`` numbers of
        `decimal.Decimal` of the caller's context, in a fifth of the time; float arguments are taken at their exact binary value.
    partition : Partition, optional
        Which speeds are dependent, for a model with loops; left out, `codegen.loops` chooses.

    Attributes
    ----------
    given : Model
    model : Model
        The same with nothing prescribed: within an engine prescribed coordinates are coordinates, whose accelerations are given.
    held : array of int
        Speeds of `model` that are prescribed; `free_u` are the others, `free_q` the coordinates that are not.
    partition : Partition
        Of `model`.
    dependent, dependent_coordinates : array of int
        Indices of the dependent speeds, and of the coordinates that only they move.
    split : list of SpeedGroup
        Rotations and displacements of which some speeds are dependent and some are not. Their coordinates count as
        independent; of their seeds the components along dependent speeds follow from closure.
    lengths : tuple of float
        Characteristic length of every loop, m.
    closure_slices : tuple of slice
        For each loop, where its conditions stand among all.
    dropped_rows : tuple of set of int
        For each loop, which of its conditions have been dropped: the results do not depend on them.
    kept : array of int
        Which of all conditions have not.

    Notes
    -----
    Arguments of every method: coordinates ``q (nq,)``, speeds ``u (nu,)``, parameters ``p (np,)`` (None: the model's
    values), ``inputs (ninputs,)`` (None: zeros), time ``t``, in SI units. Seeds carry their k directions first:
    ``dq (k, nq)``, ``du (k, nu)``, ``dp (k, np)``, ``dinputs (k, ninputs)``, ``dt (k,)``; one without k counts as
    k = 1, a missing one is zero. Quaternions may have any length: the rotation of e is that of e/abs(e).

    Loops: dependent speeds are recomputed from velocity closure in every call, whatever was passed; dependent coordinates
    are used as passed and have to close the loops. Of ``dq`` and ``du`` the independent entries are read, the others
    follow from the derivatives of closure. Where a rotation or displacement is split, its seed is read as a rotation vector
    or displacement in child axes: components along independent speeds are kept, the others follow from closure too.
    """

    def __init__(self, model: Model, numbers: str = "float64", partition: Partition | None = None) -> None:
        self.given = model
        model = self.model = model.released
        self.held = np.array(
            [model.coordinate_slices[x.body][1].start + x.index for x in self.given.prescribed], dtype=int
        )
        held_q = [model.coordinate_slices[x.body][0].start + x.index for x in self.given.prescribed]
        self.free_q, self.free_u = (
            np.setdiff1d(np.arange(n), held) for n, held in ((model.nq, held_q), (model.nu, self.held))
        )
        self.arithmetic = Arithmetic(numbers)
        if partition is None:
            partition = choose_partition(self.given) if model.loops else Partition((), tuple(range(model.nu)))
        self.partition = partition
        model = self.model = model.with_turned(partition.turned)
        self.given = self.given.with_turned(partition.turned)
        self.dependent = np.array(sorted(i for ear in partition.ears for i in ear.dependent), dtype=int)
        self.dependent_coordinates = np.array(coordinates_of(model, set(self.dependent.tolist()))[0], dtype=int)
        self.split = partition.split(model)
        lengths = {loop: ear.length for ear in partition.ears for loop in ear.loops}
        if sorted(lengths) != list(range(len(model.loops))):
            raise ValueError(f"partition: its ears close the loops {sorted(lengths)} of {len(model.loops)}")
        if sorted([*self.dependent, *partition.independent]) != list(range(model.nu)):
            raise ValueError("partition: every speed must be either independent or dependent in one ear")
        self.lengths = tuple(lengths[i] for i in range(len(model.loops)))
        ends = np.cumsum([0, *(len(closure_row_names(loop)) for loop in model.loops)])
        self.closure_slices = tuple(slice(a, b) for a, b in pairwise(ends.tolist()))
        self.dropped_rows = partition.dropped_rows(model)
        self.kept = np.array([i for i in range(ends[-1]) if i not in partition.dropped_conditions(model)], dtype=int)

    # --- the face -------------------------------------------------------------------------------------------------

    def accelerations(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the speeds, udot (nu,)."""
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t)))[0]

    def sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """udot (nu,) and its total derivatives along the seeds, (k, nu)."""
        seeds = self._seeds(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt)
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t, **seeds)))

    def jacobians(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Jacobians:
        """Every partial derivative of udot."""
        return self._partials(lambda **seeds: self.sensitivities(q, u, p, inputs, t, **seeds)[1])

    def _partials(self, along: Callable[..., Array]) -> Jacobians:
        """Every partial derivative of a function, from its derivatives along unit seeds, (k, n)."""
        sizes = (self.given.nq, self.given.nu, len(self.model.parameters), len(self.model.inputs), 1)
        start = np.cumsum((0, *sizes))
        seeds = [np.eye(start[-1], dtype=int)[:, a:b] for a, b in pairwise(start)]
        dq, du, dp, dinputs, dt = seeds
        derivatives = along(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt[:, 0])
        by_q, by_u, by_p, by_inputs, by_t = (derivatives[a:b].T for a, b in pairwise(start))
        return Jacobians(by_q, by_u, by_p, by_inputs, by_t[:, 0])

    def gradients(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any) -> Gradients:
        """Gradients of ``sum_i weights_i udot_i``, (k, n) with respect to q, u, p, inputs and (k,) to t: ``weights^T J``."""
        return _weighted(weights, self.jacobians(q, u, p, inputs, t))

    def output_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """The same of weighted sums of outputs, weights (k, noutputs)."""
        along = self._partials(lambda **seeds: self.output_sensitivities(q, u, p, inputs, t, **seeds)[1])
        return _weighted(weights, along)

    def energy_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """The same of weighted sums of kinetic and potential energy, weights (k, 2)."""

        def along(**seeds: Any) -> Array:
            return np.stack(self.energy_sensitivities(q, u, p, inputs, t, **seeds)[1], axis=-1)

        return _weighted(weights, self._partials(along))

    def coordinate_rate_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """The same of weighted sums of the derivatives of the coordinates, weights (k, nq)."""
        along = self._partials(lambda **seeds: self.coordinate_rate_sensitivities(q, u, p, inputs, t, **seeds)[1])
        return _weighted(weights, along)

    def mass_matrix(self, q: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The mass matrix M of Eq. 4 over all speeds of the tree, (nu, nu); loops do not enter."""
        M: Array = self._mass_matrix(self._state(q, None, p, inputs, t))[np.ix_(self.free_u, self.free_u)].value
        return M

    def mass_matrix_sensitivities(
        self,
        q: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """M (nu, nu) and its total derivatives, (k, nu, nu)."""
        seeds = self._seeds(dq=dq, dp=dp, dinputs=dinputs, dt=dt)
        result = self._mass_matrix(self._state(q, None, p, inputs, t, **seeds))[np.ix_(self.free_u, self.free_u)]
        return result.value, result.tangent

    def solve_mass(self, q: Any, b: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """M^-1 b, (nu,), for generalised forces b (nu,). Trees only."""
        self._trees_only("solve_mass")
        state = self._state(q, None, p, inputs, t)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, None, state.pairs)))[0]

    def solve_mass_sensitivities(
        self,
        q: Any,
        b: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        db: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """M^-1 b (nu,) and its total derivatives, (k, nu); ``db (k, nu)``. Trees only."""
        self._trees_only("solve_mass_sensitivities")
        seeds = self._seeds(dq=dq, db=db, dp=dp, dinputs=dinputs, dt=dt)
        db = seeds.pop("db")
        state = self._state(q, None, p, inputs, t, **seeds)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, db, state.pairs)))

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The joint forces needed in addition to the model's own for the accelerations udot: M udot - K, (nu,).

        Trees only.
        """
        self._trees_only("inverse_dynamics")
        state = self._state(q, u, p, inputs, t)
        return self._of_free(self._inverse_dynamics(state, self._udot(state, udot, None)))[0]

    def inverse_dynamics_sensitivities(
        self,
        q: Any,
        u: Any,
        udot: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dudot: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """The joint forces of `inverse_dynamics`, (nu,), and their total derivatives, (k, nu); ``dudot (k, nu)``."""
        self._trees_only("inverse_dynamics_sensitivities")
        seeds = self._seeds(dq=dq, du=du, dudot=dudot, dp=dp, dinputs=dinputs, dt=dt)
        dudot = seeds.pop("dudot")
        state = self._state(q, u, p, inputs, t, **seeds)
        result = self._inverse_dynamics(state, self._udot(state, udot, dudot))
        return self._of_free(result)

    def driving_forces(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The generalised forces that prescribed motion takes, (nprescribed,), N m or N."""
        return _flat(self._driving_forces(self._state(q, u, p, inputs, t)))[0]

    def driving_force_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """`driving_forces` (nprescribed,) and their total derivatives, (k, nprescribed)."""
        seeds = self._seeds(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt)
        return _flat(self._driving_forces(self._state(q, u, p, inputs, t, **seeds)))

    def _armature(self, pairs: Pairs) -> Pair:
        """Reflected inertia of the rotors by speed, (nu, 1): what stands in M beside the inertia of bodies."""
        of_speeds = [
            e for body in self.model.bodies for e in body.joint.armature or (ZERO,) * len(body.joint.kind.speeds)
        ]
        return pairs.column([pairs.expression(e) for e in of_speeds])

    def _driving_forces(self, state: State) -> Pair:
        """``b^T (M udot - K)``, (n, 1), b all speeds of the tree for a unit of a prescribed one: loops do no work along it."""
        pairs, model = state.pairs, self.model
        left_over = self._inverse_dynamics(state, self._accelerations(state))
        found = []
        for i in self.held:
            unit = pairs.constant(np.eye(model.nu, dtype=int)[:, i : i + 1])
            if model.loops:
                closed = self._closed_speeds(state.moved(model, state.q, unit))
                unit.value[self.dependent], unit.tangent[:, self.dependent] = closed.value, closed.tangent
            found.append(pairs.dot(unit, left_over))
        return pairs.column(found)

    def energies(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> tuple[Any, Any]:
        """Kinetic and potential energy, J. The potential of gravity is zero at the ground's origin."""
        state = self._state(q, u, p, inputs, t)
        kinetic, potential = self._energies(state, self._motion(state))
        return kinetic.value[0, 0], potential.value[0, 0]

    def energy_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[tuple[Any, Any], tuple[Array, Array]]:
        """Kinetic and potential energy and their total derivatives: (T, V), (dT (k,), dV (k,))."""
        state = self._state(q, u, p, inputs, t, **self._seeds(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt))
        kinetic, potential = self._energies(state, self._motion(state))
        derivatives = kinetic.tangent[:, 0, 0], potential.tangent[:, 0, 0]
        return (kinetic.value[0, 0], potential.value[0, 0]), derivatives

    def coordinate_rates(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the coordinates, Eq. 1, (nq,)."""
        return _flat(self._coordinate_rates(self._state(q, u, p, inputs, t))[self.free_q])[0]

    def coordinate_rate_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """qdot (nq,) and its total derivatives, (k, nq)."""
        seeds = self._seeds(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt)
        return _flat(self._coordinate_rates(self._state(q, u, p, inputs, t, **seeds))[self.free_q])

    def outputs(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The model's named outputs, (noutputs,)."""
        return _flat(self._outputs(self._state(q, u, p, inputs, t)))[0]

    def output_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """The outputs (noutputs,) and their total derivatives, (k, noutputs)."""
        seeds = self._seeds(dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt)
        result = self._outputs(self._state(q, u, p, inputs, t, **seeds))
        return _flat(result)

    # --- loops ----------------------------------------------------------------------------------------------------

    def closure(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> tuple[Array, Array]:
        """How far the loops are from closing in position and velocity at q and u as passed, (m,) each.

        In the order of `Model.closure_names`, linear conditions divided by the loop's characteristic length.
        """
        if not self.model.loops:
            return self.arithmetic.zeros(0), self.arithmetic.zeros(0)
        position, velocity = self._closure(self._arguments(q, u, p, inputs, t))
        return position.value[:, 0], velocity.value[:, 0]

    def complete(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        inputs: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array, Array]:
        """Speeds u (nu,) that close the loops, and seeds dq (k, nq), du (k, nu) that keep them closed."""
        given = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
        seeds = self._seeds(**given) if any(x is not None for x in given.values()) else {}
        state = self._state(q, u, p, inputs, t, **seeds)
        (_, dq), (u, du) = _flat(state.q[self.free_q]), _flat(state.u[self.free_u])
        return u, dq, du

    def _trees_only(self, name: str) -> None:
        if self.model.loops:
            raise NotImplementedError(
                f"{name}: model {self.model.name} has closed loops, where joint forces are not unique; it is for trees"
            )

    def _completed(self, state: State) -> State:
        """Dependent speeds and seeds from closure; what was passed for them is dropped."""
        model, dependent = self.model, self.dependent
        q, u = (Pair(x.value.copy(), x.tangent.copy()) for x in (state.q, state.u))
        q.tangent[:, self.dependent_coordinates] *= 0
        for group in self.split:
            q.tangent[:, group.coordinates] = self._along_independents(state, group)
        u.value[dependent] *= 0
        u.tangent[:, dependent] *= 0
        state = state.moved(model, q, u)
        if state.pairs.k:
            # Displacements are to coordinates what speeds are to their rates: Eq. 1.
            still = state.moved(model, Pair(q.value, 0 * q.tangent), Pair(0 * u.value, self._displacements(state)))
            q.tangent += self._coordinate_rates(still).tangent
            state = state.moved(model, q, u)
        closed = self._closed_speeds(state)
        u.value[dependent], u.tangent[:, dependent] = closed.value, closed.tangent
        state = state.moved(model, q, u)
        if len(dependent) < len(model.closure_names):
            self._check_redundant(state)
        return state

    def _along_independents(self, state: State, group: SpeedGroup) -> Array:
        """Of a group's seeds what moves it along its independent speeds, (k, n, 1).

        A displacement is to coordinates what a speed is to their rates, and the rates that the speeds of a group cause are
        perpendicular to each other: so this is the seeds' projection on some of them. What changes a quaternion's length is
        dropped with the rest.
        """
        seed = state.q.tangent[:, group.coordinates]
        kept = 0 * seed
        for speed in set(group.speeds) - set(self.dependent.tolist()):
            u = self.arithmetic.zeros(self.model.nu, 1)
            u[speed] += 1
            moving = state.moved(self.model, state.q, Pair(u, 0 * state.u.tangent))
            rate = self._coordinate_rates(moving).value[group.coordinates]
            kept = kept + rate @ (rate.T @ seed) / (rate.T @ rate)
        return kept

    def _check_redundant(self, state: State) -> None:
        """Warn where conditions beyond the rank do not hold: no derivative exists along a direction that opens them."""
        position, velocity = self._closure(state)
        names, seeds = self.model.closure_names, [x.tangent for x in state.pairs.environment.values()]
        allowed = np.full(len(names), INCONSISTENT)
        allowed[np.setdiff1d(np.arange(len(names)), self.kept)] = ALLOWED * self.model.loop_tolerance
        checks = [("in velocity", velocity.value, np.abs(state.u.value).max(initial=0))]
        for j in range(state.pairs.k):
            size = max(abs(seed[j]) for seed in seeds)
            checks.append((f"in position along direction {j + 1}", position.tangent[j], size))
            checks.append((f"in velocity along direction {j + 1}", velocity.tangent[j], size))
        for where, residual, size in checks:
            excess = np.abs(residual[:, 0]) / self.arithmetic.array(allowed)
            worst = int(np.argmax(excess))
            if excess[worst] > size:
                warnings.warn(
                    f"redundant condition {names[worst]} is not met {where}: {float(abs(residual[worst, 0])):.1e}",
                    RuntimeWarning,
                    stacklevel=5,
                )

    # --- what an engine fills in ----------------------------------------------------------------------------------

    @abstractmethod
    def _accelerations(self, state: State) -> Pair:
        """udot, (nu, 1), of prescribed speeds too."""

    @abstractmethod
    def _mass_matrix(self, state: State) -> Pair:
        """M, (nu, nu)."""

    @abstractmethod
    def _solve_mass(self, state: State, b: Pair) -> Pair:
        """M^-1 b, (nu, 1)."""

    @abstractmethod
    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        """M udot - K, (nu, 1)."""

    @abstractmethod
    def _closure(self, state: State) -> tuple[Pair, Pair]:
        """Scaled residuals of position and velocity closure, (m, 1) each."""

    @abstractmethod
    def _displacements(self, state: State) -> Array:
        """Displacements, in the sense of speeds, that keep position closed along the seeds; (k, nu, 1), dependents only."""

    @abstractmethod
    def _closed_speeds(self, state: State) -> Pair:
        """The dependent speeds in their order, (r, 1), from velocity closure with the independent ones of the state."""

    @abstractmethod
    def _coordinate_rates(self, state: State) -> Pair:
        """qdot, (nq, 1)."""

    @abstractmethod
    def _motion(self, state: State) -> Any:
        """Whatever the engine's own `_energies` and `_point` want to know about the bodies."""

    @abstractmethod
    def _energies(self, state: State, motion: Any) -> tuple[Pair, Pair]:
        """Kinetic and potential energy, (1, 1) each."""

    @abstractmethod
    def _point(self, motion: Any, body: int, at: Pair) -> tuple[Pair, Pair]:
        """Position and velocity in the ground frame, (3, 1), of the point ``at`` in body axes of ``body``."""

    @abstractmethod
    def _attitude(self, motion: Any, body: int) -> tuple[Pair, Pair]:
        """Body components into ground components, (3, 3), and angular velocity in the ground frame, (3, 1), of a body."""

    @abstractmethod
    def _accelerating(self, state: State, motion: Any, udot: Pair) -> Callable[[int, Pair], Pair]:
        """Gives the acceleration, (3, 1) in the ground frame, of the point ``at`` (3, 1) in body axes of a body."""

    @abstractmethod
    def _moving(self, state: State, motion: Any) -> list[Moving]:
        """Mass, motion and angular momentum of all bodies."""

    def _ends(self, pairs: Pairs, motion: Any, element: ForceElement) -> list[End]:
        """Where a force element acts."""
        found = []
        for place in element.ends:
            R, omega = self._attitude(motion, place.body)
            if isinstance(place, Face):
                R = R @ placed_rotation(place, pairs)
            found.append(End(*self._point(motion, place.body, pairs.vector(place.at)), R, omega))
        return found

    def _measured(self, pairs: Pairs, motion: Any, element: ForceElement) -> Pairs:
        """Evaluates the expressions of a force element, which may name positions and velocities of points."""
        if not element.measured:
            return pairs
        known = {}
        for point in element.measured:
            x, v = self._point(motion, point.body, pairs.vector(point.at))
            for i, c in enumerate("xyz"):
                known[f"position.{point.name}.{c}"], known[f"velocity.{point.name}.{c}"] = x[i, 0], v[i, 0]
        return Pairs(self.arithmetic, pairs.k, {**pairs.environment, **known})

    def _wrenches(self, pairs: Pairs, motion: Any) -> Iterator[tuple[Point | Face, End, Wrench]]:
        """What all force elements do to bodies, and where."""
        for element in self.model.elements:
            ends, seen = self._ends(pairs, motion, element), self._measured(pairs, motion, element)
            yield from zip(element.ends, ends, LAWS[type(element)].wrenches(element, seen, ends), strict=True)

    def _forces_on_speeds(self, pairs: Pairs) -> Pair:
        """The generalised forces on joints' speeds that force elements exert directly, (nu, 1)."""
        tau = pairs.constant(np.zeros((self.model.nu, 1), int))
        for element in self.model.elements:
            for body, values in LAWS[type(element)].on_speeds(element, pairs).items():
                rows = self.model.coordinate_slices[body][1]
                pairs.put(tau, rows.start, tau[rows] + values)
        return tau

    def _potential(self, pairs: Pairs, motion: Any) -> Pair:
        """The potential energy of all force elements, a number, J."""
        total = pairs.number(0)
        for element in self.model.elements:
            energy = LAWS[type(element)].energy(element, pairs, self._ends(pairs, motion, element))
            total = total if energy is None else total + energy
        return total

    def _outputs(self, state: State) -> Pair:
        """The outputs, (noutputs, 1)."""
        seen = _Seen(self, state, self._motion(state))
        return state.pairs.column([VALUES[output.measure](output, seen) for output in self.model.outputs])

    # --- arguments ------------------------------------------------------------------------------------------------

    def _state(
        self,
        q: Any,
        u: Any,
        p: Any,
        inputs: Any,
        t: Any,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> State:
        """The arguments, with dependent speeds and seeds from closure."""
        state = self._arguments(q, u, p, inputs, t, dq, du, dp, dinputs, dt)
        return self._completed(state) if self.model.loops else state

    def _arguments(
        self,
        q: Any,
        u: Any,
        p: Any,
        inputs: Any,
        t: Any,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dinputs: Any = None,
        dt: Any = None,
    ) -> State:
        """Check the arguments and bind the names that expressions know."""
        model, k = self.model, len(dq) if dq is not None else 0
        if p is None:
            p = [x.value for x in model.parameters]
        nq, nu = self.given.nq, self.given.nu
        q = self._pair("q", q, nq, dq, k)
        u = self._pair("u", np.zeros(nu, int) if u is None else u, nu, du, k)
        p = self._pair("p", p, len(model.parameters), dp, k)
        inputs = self._pair(
            "inputs", np.zeros(len(model.inputs), int) if inputs is None else inputs, len(model.inputs), dinputs, k
        )
        time = self._pair("t", np.reshape(t, (1,)), 1, None if dt is None else dt[:, None], k)
        environment = {"t": time[0, 0]}
        environment |= {name: p[i, 0] for i, name in enumerate(model.parameter_names)}
        environment |= {name: inputs[i, 0] for i, name in enumerate(model.inputs)}
        q, u = self._with_prescribed(q, u, Pairs(self.arithmetic, k, environment))
        for body, place in model.quaternions:
            e = q.value[place, 0]
            if not e @ e >= SMALLEST_QUATERNION**2:
                name = model.bodies[body].name
                raise ValueError(f"q: the quaternion of {name} is {e}; its length must be at least 1e-6")
        return State(Pairs(self.arithmetic, k, environment), q, u).moved(model, q, u)

    def _pair(self, name: str, value: Any, n: int, seed: Any, k: int) -> Pair:
        """An argument (n,) and its seed (k, n) as a column."""
        value = self.arithmetic.array(value)
        if value.shape != (n,):
            raise ValueError(f"{name} has shape {value.shape}, expected ({n},)")
        if any(map(mpmath.isnan, value)):
            raise ValueError(f"{name} holds NaN: {value}")
        tangent = self.arithmetic.zeros(k, n) if seed is None else seed
        if tangent.shape != (k, n):
            raise ValueError(f"d{name} has shape {tangent.shape}, expected ({k}, {n})")
        return Pair(value[:, None], tangent[..., None])

    def _seeds(self, **seeds: Any) -> dict[str, Array]:
        """All seeds with the same k in front; those that are missing become zeros."""
        n = {"dq": self.given.nq} | dict.fromkeys(("du", "dudot", "db"), self.given.nu)
        n |= {"dp": len(self.model.parameters), "dinputs": len(self.model.inputs)}
        arrays: dict[str, Array] = {}
        for name, seed in seeds.items():
            if seed is not None:
                array = self.arithmetic.array(seed)
                depth = 1 if name == "dt" else 2
                arrays[name] = array[None] if array.ndim == depth - 1 else array
                if arrays[name].ndim != depth:
                    raise ValueError(f"{name} has shape {array.shape}, expected (k, n)")
        if not arrays:
            raise ValueError(f"no seed given; give at least one of {', '.join(seeds)}")
        first = next(iter(arrays))
        k = len(arrays[first])
        for name in seeds:
            shape = (k,) if name == "dt" else (k, n[name])
            array = arrays.setdefault(name, self.arithmetic.zeros(*shape))
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected {shape}: {first} has {k} directions")
        return arrays

    def _udot(self, state: State, udot: Any, dudot: Any) -> Pair:
        found = self._of_speeds("udot", udot, dudot, state.pairs)
        return self._with_accelerations(found, state.pairs)

    # --- what is prescribed -----------------------------------------------------------------------------------------

    def _with_prescribed(self, q: Pair, u: Pair, pairs: Pairs) -> tuple[Pair, Pair]:
        """All coordinates and speeds from those that are free."""
        if not self.given.motion:
            return q, u
        held_q = np.setdiff1d(np.arange(self.model.nq), self.free_q)
        found = []
        for of, n, free, held, order in (
            (q, self.model.nq, self.free_q, held_q, 0), (u, self.model.nu, self.free_u, self.held, 1),
        ):  # fmt: skip
            whole = pairs.constant(np.zeros((n, 1), int))
            given = pairs.vector([x.values[order] for x in self.given.prescribed])
            for rows, part in ((free, of), (held, given)):
                whole.value[rows], whole.tangent[:, rows] = part.value, part.tangent
            found.append(whole)
        return found[0], found[1]

    def _prescribed_accelerations(self, pairs: Pairs) -> Pair:
        """Of what is prescribed, (n, 1)."""
        return pairs.vector([x.values[2] for x in self.given.prescribed])

    def _with_accelerations(self, udot: Pair, pairs: Pairs) -> Pair:
        """The accelerations of all speeds, those that are prescribed put in their places."""
        if len(self.held):
            given = self._prescribed_accelerations(pairs)
            udot.value[self.held], udot.tangent[:, self.held] = given.value, given.tangent
        return udot

    def _of_speeds(self, name: str, value: Any, seed: Any, pairs: Pairs) -> Pair:
        """An argument for the free speeds, (nu, 1) with zeros for the others."""
        part = self._pair(name, value, self.given.nu, seed, pairs.k)
        whole = pairs.constant(np.zeros((self.model.nu, 1), int))
        whole.value[self.free_u], whole.tangent[:, self.free_u] = part.value, part.tangent
        return whole

    def _of_free(self, column: Pair) -> tuple[Array, Array]:
        """Of the free speeds: a column's value (nu,) and derivatives (k, nu)."""
        return _flat(column[self.free_u])


class _Seen:
    """What outputs see of a model: `outputs.Seen`. Accelerations and sums are found when the first output asks."""

    def __init__(self, engine: Engine, state: State, motion: Any) -> None:
        self.engine = engine
        self.state = state
        self.motion = motion

    @property
    def pairs(self) -> Pairs:
        return self.state.pairs

    def point(self, point: Point) -> tuple[Pair, Pair]:
        return self.engine._point(self.motion, point.body, self.pairs.vector(point.at))

    @cached_property
    def _accelerations(self) -> Callable[[int, Pair], Pair]:
        return self.engine._accelerating(self.state, self.motion, self.engine._accelerations(self.state))

    def acceleration(self, point: Point) -> Pair:
        return self._accelerations(point.body, self.pairs.vector(point.at))

    def attitude(self, body: int) -> tuple[Pair, Pair]:
        return self.engine._attitude(self.motion, body)

    @cached_property
    def _bodies(self) -> list[Moving]:
        return self.engine._moving(self.state, self.motion)

    def bodies(self) -> list[Moving]:
        return self._bodies

    @cached_property
    def _driving_forces(self) -> Pair:
        return self.engine._driving_forces(self.state)

    def driving_force(self, name: str) -> Pair:
        return self._driving_forces[self.engine.given.prescribed_names.index(name), 0]

    def energies(self) -> tuple[Pair, Pair]:
        kinetic, potential = self.engine._energies(self.state, self.motion)
        return kinetic[0, 0], potential[0, 0]


def _weighted(weights: Any, J: Jacobians) -> Gradients:
    """``weights^T J`` by argument, for weights (k, n) or (n,)."""
    w = np.atleast_2d(np.asarray(weights))
    return w @ J.q, w @ J.u, w @ J.p, w @ J.inputs, w @ J.t


def _flat(column: Pair) -> tuple[Array, Array]:
    """A column's value (n,) and derivatives (k, n)."""
    return column.value[:, 0], column.tangent[..., 0]
