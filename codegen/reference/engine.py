"""What the reference engines have in common: the face. Arguments are checked and become pairs, results become arrays.

No mechanics stands here. An engine fills in the methods that begin with an underscore.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from ..model.entries import ZERO
from ..model.forces import ForceElement
from ..model.places import Face, Point
from .arguments import ALONG, Arguments, State, flat
from .arithmetic import Array
from .forces import LAWS, End, Wrench
from .outputs import VALUES, Moving, Seen
from .pairs import Pair, Pairs
from .primitives import placed_rotation


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


class Engine(Arguments):
    """A reference engine: any model, one state per call, derivatives along any seeds.

    Parameters
    ----------
    model : Model
    numbers : {"float64", "mpmath", "decimal"} or Arithmetic
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

    # --- the face -------------------------------------------------------------------------------------------------

    def accelerations(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the speeds, udot (nu,)."""
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t)))[0]

    def sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """udot (nu,) and its total derivatives along the seeds, (k, nu)."""
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

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
        self, q: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """M (nu, nu) and its total derivatives, (k, nu, nu)."""
        given = self._seeds(("dq", "dp", "dinputs", "dt"), seeds)
        result = self._mass_matrix(self._state(q, None, p, inputs, t, **given))[np.ix_(self.free_u, self.free_u)]
        return result.value, result.tangent

    def solve_mass(self, q: Any, b: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """M^-1 b, (nu,), for generalised forces b (nu,). Trees only."""
        self._trees_only("solve_mass")
        state = self._state(q, None, p, inputs, t)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, None, state.pairs)))[0]

    def solve_mass_sensitivities(
        self, q: Any, b: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """M^-1 b (nu,) and its total derivatives, (k, nu); ``db (k, nu)``. Trees only."""
        self._trees_only("solve_mass_sensitivities")
        given = self._seeds(("dq", "db", "dp", "dinputs", "dt"), seeds)
        db = given.pop("db")
        state = self._state(q, None, p, inputs, t, **given)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, db, state.pairs)))

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The joint forces needed in addition to the model's own for the accelerations udot: M udot - K, (nu,).

        Trees only.
        """
        self._trees_only("inverse_dynamics")
        state = self._state(q, u, p, inputs, t)
        return self._of_free(self._inverse_dynamics(state, self._udot(state, udot, None)))[0]

    def inverse_dynamics_sensitivities(
        self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """The joint forces of `inverse_dynamics`, (nu,), and their total derivatives, (k, nu); ``dudot (k, nu)``."""
        self._trees_only("inverse_dynamics_sensitivities")
        given = self._seeds((*ALONG, "dudot"), seeds)
        dudot = given.pop("dudot")
        state = self._state(q, u, p, inputs, t, **given)
        return self._of_free(self._inverse_dynamics(state, self._udot(state, udot, dudot)))

    def driving_forces(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The generalised forces that prescribed motion takes, (nprescribed,), N m or N."""
        return flat(self._driving_forces(self._state(q, u, p, inputs, t)))[0]

    def driving_force_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """`driving_forces` (nprescribed,) and their total derivatives, (k, nprescribed)."""
        return flat(self._driving_forces(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

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
                unit[self.dependent] = closed
            found.append(pairs.dot(unit, left_over))
        return pairs.column(found)

    def energies(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> tuple[Any, Any]:
        """Kinetic and potential energy, J. The potential of gravity is zero at the ground's origin."""
        state = self._state(q, u, p, inputs, t)
        kinetic, potential = self._energies(state, self._motion(state))
        return kinetic.value[0, 0], potential.value[0, 0]

    def energy_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[tuple[Any, Any], tuple[Array, Array]]:
        """Kinetic and potential energy and their total derivatives: (T, V), (dT (k,), dV (k,))."""
        state = self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))
        kinetic, potential = self._energies(state, self._motion(state))
        derivatives = kinetic.tangent[:, 0, 0], potential.tangent[:, 0, 0]
        return (kinetic.value[0, 0], potential.value[0, 0]), derivatives

    def coordinate_rates(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the coordinates, Eq. 1, (nq,)."""
        return flat(self._coordinate_rates(self._state(q, u, p, inputs, t))[self.free_q])[0]

    def coordinate_rate_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """qdot (nq,) and its total derivatives, (k, nq)."""
        return flat(self._coordinate_rates(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds)))[self.free_q])

    def outputs(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The model's named outputs, (noutputs,)."""
        return flat(self._outputs(self._state(q, u, p, inputs, t)))[0]

    def output_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """The outputs (noutputs,) and their total derivatives, (k, noutputs)."""
        return flat(self._outputs(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

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
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array, Array]:
        """Speeds u (nu,) that close the loops, and seeds dq (k, nq), du (k, nu) that keep them closed."""
        given = self._seeds(ALONG, seeds) if any(x is not None for x in seeds.values()) else {}
        state = self._state(q, u, p, inputs, t, **given)
        (_, dq), (u, du) = flat(state.q[self.free_q]), flat(state.u[self.free_u])
        return u, dq, du

    def _trees_only(self, name: str) -> None:
        if self.model.loops:
            raise NotImplementedError(
                f"{name}: model {self.model.name} has closed loops, where joint forces are not unique; it is for trees"
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
        axis = self.given.switches.direction_of(element.name)
        if axis:
            found[0].line = pairs.unit(pairs.column([pairs.number(v) for v in axis]))
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
        tau = pairs.zeros(self.model.nu, 1)
        for element in self.model.elements:
            for body, values in LAWS[type(element)].on_speeds(element, pairs).items():
                rows = self.model.coordinate_slices[body][1]
                tau[rows] = tau[rows] + values
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
        seen = self._seen(state)
        return seen.pairs.column([VALUES[output.measure](output, seen) for output in self.model.outputs])

    def _seen(self, state: State) -> Seen:
        """What outputs read; accelerations and sums are found when the first of them needs these."""
        pairs, motion, names = state.pairs, self._motion(state), self.given.prescribed_names
        accelerating = cache(lambda: self._accelerating(state, motion, self._accelerations(state)))
        driving = cache(lambda: self._driving_forces(state))
        return Seen(
            pairs,
            point=lambda point: self._point(motion, point.body, pairs.vector(point.at)),
            acceleration=lambda point: accelerating()(point.body, pairs.vector(point.at)),
            attitude=lambda body: self._attitude(motion, body),
            energies=lambda: self._energies(state, motion),
            driving_forces=lambda: {name: driving()[i : i + 1] for i, name in enumerate(names)},
            bodies=cache(lambda: self._moving(state, motion)),
        )


def _weighted(weights: Any, J: Jacobians) -> Gradients:
    """``weights^T J`` by argument, for weights (k, n) or (n,)."""
    w = np.atleast_2d(np.asarray(weights))
    return w @ J.q, w @ J.u, w @ J.p, w @ J.inputs, w @ J.t
