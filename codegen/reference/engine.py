"""Public interface of the reference engines: arguments are checked and become pairs, results become arrays.

This module contains no mechanics. An engine implements the methods that begin with an underscore.
"""
# long: each of twenty methods has a docstring with an example

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from copy import copy
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
from .second_order import DualArithmetic


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Partial derivatives of a result with n entries.

    Attributes
    ----------
    q : ndarray (n, nq)
        With respect to the coordinates.
    u : ndarray (n, nu)
        With respect to the speeds.
    p : ndarray (n, np)
        With respect to the parameters.
    inputs : ndarray (n, ninputs)
        With respect to the inputs.
    t : ndarray (n,)
        With respect to time.
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array


Gradients = tuple[Array, Array, Array, Array, Array]
"""Gradients of k weighted sums with respect to q, u, p and inputs, (k, n) each, and with respect to t, (k,)."""


class Engine(Arguments):
    """Reference engine: any model, one state per call, derivatives along any seeds.

    Parameters
    ----------
    model : Model
        The model.
    numbers : {"float64", "mpmath", "decimal"} or Arithmetic, optional
        With "mpmath" arrays hold mpf numbers with the digits of the caller's ``mpmath.mp.dps``; with "decimal" they
        hold `decimal.Decimal` numbers of the caller's context, which take a fifth of the time. Floats count as exactly
        what they are.
    partition : Partition, optional
        Choice of dependent speeds, for a model with loops. Default: `codegen.loops` chooses.

    Attributes
    ----------
    given : Model
        The model.
    model : Model
        The model with nothing prescribed: an engine treats prescribed coordinates as coordinates with given
        accelerations.
    held : ndarray of int
        Prescribed speeds of `model`. `free_u` are the others, `free_q` the coordinates that are not prescribed.
    partition : Partition
        Choice of dependent speeds of `model`.
    dependent, dependent_coordinates : ndarray of int
        Indices of the dependent speeds, and of the coordinates that only they move.
    split : list of SpeedGroup
        Rotations and displacements with both dependent and independent speeds. Their coordinates count as independent;
        the components of their seeds along dependent speeds follow from closure.
    lengths : tuple of float
        Characteristic length of every loop, m.
    closure_slices : tuple of slice
        Conditions of each loop among all conditions.
    dropped_rows : tuple of set of int
        Dropped conditions of each loop. Results do not depend on them.
    kept : ndarray of int
        Indices of the other conditions.

    Notes
    -----
    Methods have the names, arguments, results and units of those of `Solver`, but compute one state per call and return new
    arrays. Arguments of every method: coordinates ``q (nq,)``, speeds ``u (nu,)``, parameters ``p (np,)`` (None: the model's
    values), ``inputs (ninputs,)`` (None: zeros), time ``t``, in SI units. Seeds have their k directions first: ``dq (k,
    nq)``, ``du (k, nu)``, ``dp (k, np)``, ``dinputs (k, ninputs)``, ``dt (k,)``. A seed without k counts as k = 1; a
    missing one is zero. Quaternions may have any length: the rotation of e is that of e/abs(e).

    Every call computes the dependent speeds from velocity closure. Dependent coordinates are used as they are passed
    and have to close the loops. Only the independent entries of ``dq`` and ``du`` are read; the others follow from
    closure. Where a rotation or displacement is split, its seed is read as a rotation vector or displacement in child
    axes, and the components along dependent speeds follow from closure.

    Examples
    --------
    >>> from ordernm.reference import DenseEngine
    >>> engine = DenseEngine(ordernm.load_model("examples/double_pendulum.yaml"))
    >>> engine.accelerations([1.2, -0.4], [0, 0]).round(3)
    array([-15.414,  32.58 ])
    >>> engine.sensitivities([1.2, -0.4], [0, 0], dp=[1, 0, 0, 0, 0, 0])[1].round(3)
    array([[ 16.333, -17.918]])
    >>> engine.gradients([1.2, -0.4], [0, 0], weights=[0, 1])[2].round(3)
    array([[-17.918, -31.526,  -1.793,  -7.936,   5.313,   0.   ]])
    >>> engine.hessian_products([1.2, -0.4], [0, 0], weights=[0, 1], dq=[1, 0])[0].round(3)
    array([[-21.954,  26.433]])
    """

    # --- public methods -------------------------------------------------------------------------------------------

    def accelerations(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the derivatives of the speeds."""
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t)))[0]

    def sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return udot and its total derivatives along seeds."""
        return self._of_free(self._accelerations(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

    def jacobians(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Jacobians:
        """Return all partial derivatives of udot."""
        return self._partials(lambda **seeds: self.sensitivities(q, u, p, inputs, t, **seeds)[1])

    def _partials(self, along: Callable[..., Array]) -> Jacobians:
        """All partial derivatives of a function, from its derivatives along unit seeds, (k, n)."""
        by_q, by_u, by_p, by_inputs, by_t = self._by_arguments(along, ALONG)
        return Jacobians(by_q, by_u, by_p, by_inputs, by_t[:, 0])

    def _by_arguments(self, along: Callable[..., Array], names: tuple[str, ...]) -> list[Array]:
        """The partial derivatives (n, size) for each argument, by the names of the seeds, of which dt is the last."""
        start = np.cumsum([0, *(self._seed_size(name) for name in names)])
        units = [np.eye(start[-1], dtype=int)[:, a:b] for a, b in pairwise(start)]
        seeds = dict(zip(names, units, strict=True))
        seeds["dt"] = seeds["dt"][:, 0]
        derivatives = along(**seeds)
        return [derivatives[a:b].T for a, b in pairwise(start)]

    def gradients(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any) -> Gradients:
        """Return gradients of ``sum_i weights_i udot_i``."""
        return _weighted(weights, self.jacobians(q, u, p, inputs, t))

    def output_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """Return gradients of weighted sums of outputs."""
        along = self._partials(lambda **seeds: self.output_sensitivities(q, u, p, inputs, t, **seeds)[1])
        return _weighted(weights, along)

    def energy_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """Return gradients of weighted sums of kinetic and potential energy."""

        def along(**seeds: Any) -> Array:
            return np.stack(self.energy_sensitivities(q, u, p, inputs, t, **seeds)[1], axis=-1)

        return _weighted(weights, self._partials(along))

    def coordinate_rate_gradients(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any
    ) -> Gradients:
        """Return gradients of weighted sums of the time derivatives of the coordinates."""
        along = self._partials(lambda **seeds: self.coordinate_rate_sensitivities(q, u, p, inputs, t, **seeds)[1])
        return _weighted(weights, along)

    # --- second derivatives ---------------------------------------------------------------------------------------

    def hessian_products(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any, **seeds: Any
    ) -> Gradients:
        """Return the changes of `gradients` along seeds: products of the Hessian of the weighted sum."""
        return self._changed("gradients", (q, u, p, inputs, t), weights, seeds)

    def output_hessian_products(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any, **seeds: Any
    ) -> Gradients:
        """Return the changes of `output_gradients` along seeds."""
        return self._changed("output_gradients", (q, u, p, inputs, t), weights, seeds)

    def energy_hessian_products(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any, **seeds: Any
    ) -> Gradients:
        """Return the changes of `energy_gradients` along seeds."""
        return self._changed("energy_gradients", (q, u, p, inputs, t), weights, seeds)

    def coordinate_rate_hessian_products(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any, **seeds: Any
    ) -> Gradients:
        """Return the changes of `coordinate_rate_gradients` along seeds."""
        return self._changed("coordinate_rate_gradients", (q, u, p, inputs, t), weights, seeds)

    def inverse_dynamics_hessian_products(
        self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, *, weights: Any, **seeds: Any
    ) -> tuple[Array, ...]:
        """Return products of seeds with the Hessian of a weighted sum of `inverse_dynamics`: one for each of q, u, udot, p,
        inputs and t."""
        self._trees_only("inverse_dynamics_hessian_products")
        names = ("dq", "du", "dudot", "dp", "dinputs", "dt")

        def gradient(engine: Engine, *at: Any) -> tuple[Array, ...]:
            def along(**units: Any) -> Array:
                return engine.inverse_dynamics_sensitivities(*at, **units)[1]

            *found, by_t = (self.arithmetic.array(weights) @ x for x in engine._by_arguments(along, names))
            return *found, by_t[0]

        return self._changes(gradient, (q, u, udot, p, inputs, t), self._seeds(names, seeds))

    def _changed(self, name: str, at: tuple[Any, ...], weights: Any, seeds: Mapping[str, Any]) -> Gradients:
        """The changes of the gradients that a method returns."""

        def gradient(engine: Engine, *at: Any) -> tuple[Array, ...]:
            return tuple(x[0] for x in getattr(engine, name)(*at, weights=self.arithmetic.array(weights)))

        by_q, by_u, by_p, by_inputs, by_t = self._changes(gradient, at, self._seeds(ALONG, seeds))
        return by_q, by_u, by_p, by_inputs, by_t

    def _changes(
        self, of: Callable[..., tuple[Array, ...]], at: tuple[Any, ...], given: dict[str, Array]
    ) -> tuple[Array, ...]:
        """The changes of gradients along each direction, computed with duals of this engine's numbers."""
        numbers = DualArithmetic(self.arithmetic)
        other = copy(self)
        other.arithmetic = numbers
        *state, p, inputs, t = at
        p = [x.value for x in self.model.parameters] if p is None else p
        inputs = np.zeros(len(self.model.inputs), int) if inputs is None else inputs
        if self.model.loops:
            q, u = state
            u, given["dq"], given["du"] = self.complete(q, u, p, inputs, t, **given)
            state = [q, u]
        values = dict(zip(given, (*state, p, inputs, t), strict=True))
        found = []
        for j in range(len(given["dt"])):
            along = [numbers.duals(x, given[name][j]) for name, x in values.items()]
            found.append([numbers.along(x) for x in of(other, *along)])
        return tuple(np.stack(parts) for parts in zip(*found, strict=True))

    def mass_matrix(self, q: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the mass matrix of Eq. 4 over all speeds of the tree, without the conditions of loops."""
        M: Array = self._mass_matrix(self._state(q, None, p, inputs, t))[np.ix_(self.free_u, self.free_u)].value
        return M

    def mass_matrix_sensitivities(
        self, q: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the mass matrix and its total derivatives along seeds."""
        given = self._seeds(("dq", "dp", "dinputs", "dt"), seeds)
        result = self._mass_matrix(self._state(q, None, p, inputs, t, **given))[np.ix_(self.free_u, self.free_u)]
        return result.value, result.tangent

    def solve_mass(self, q: Any, b: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the solution x of ``M x = b``, for models without loops."""
        self._trees_only("solve_mass")
        state = self._state(q, None, p, inputs, t)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, None, state.pairs)))[0]

    def solve_mass_sensitivities(
        self, q: Any, b: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the solution of ``M x = b`` and its total derivatives along seeds."""
        self._trees_only("solve_mass_sensitivities")
        given = self._seeds(("dq", "db", "dp", "dinputs", "dt"), seeds)
        db = given.pop("db")
        state = self._state(q, None, p, inputs, t, **given)
        return self._of_free(self._solve_mass(state, self._of_speeds("b", b, db, state.pairs)))

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the joint forces that given accelerations require in addition to the model's own forces."""
        self._trees_only("inverse_dynamics")
        state = self._state(q, u, p, inputs, t)
        return self._of_free(self._inverse_dynamics(state, self._udot(state, udot, None)))[0]

    def inverse_dynamics_sensitivities(
        self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the forces of `inverse_dynamics` and their total derivatives along seeds."""
        self._trees_only("inverse_dynamics_sensitivities")
        given = self._seeds((*ALONG, "dudot"), seeds)
        dudot = given.pop("dudot")
        state = self._state(q, u, p, inputs, t, **given)
        return self._of_free(self._inverse_dynamics(state, self._udot(state, udot, dudot)))

    def driving_forces(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the generalised forces that prescribed motion requires."""
        return flat(self._driving_forces(self._state(q, u, p, inputs, t)))[0]

    def driving_force_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the forces of `driving_forces` and their total derivatives along seeds."""
        return flat(self._driving_forces(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

    def _armature(self, pairs: Pairs) -> Pair:
        """Reflected inertia of the rotors by speed, (nu, 1), which is added to the diagonal of M."""
        of_speeds = [
            e for body in self.model.bodies for e in body.joint.armature or (ZERO,) * len(body.joint.kind.speeds)
        ]
        return pairs.column([pairs.expression(e) for e in of_speeds])

    def _driving_forces(self, state: State) -> Pair:
        """``b^T (M udot - K)``, (n, 1), where b holds the speeds of the tree per unit prescribed speed; loops do no
        work."""
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
        """Return kinetic and potential energy."""
        state = self._state(q, u, p, inputs, t)
        kinetic, potential = self._energies(state, self._motion(state))
        return kinetic.value[0, 0], potential.value[0, 0]

    def energy_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[tuple[Any, Any], tuple[Array, Array]]:
        """Return kinetic and potential energy and their total derivatives along seeds."""
        state = self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))
        kinetic, potential = self._energies(state, self._motion(state))
        derivatives = kinetic.tangent[:, 0, 0], potential.tangent[:, 0, 0]
        return (kinetic.value[0, 0], potential.value[0, 0]), derivatives

    def coordinate_rates(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the time derivatives of the coordinates (Eq. 1)."""
        return flat(self._coordinate_rates(self._state(q, u, p, inputs, t))[self.free_q])[0]

    def coordinate_rate_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return qdot and its total derivatives along seeds."""
        return flat(self._coordinate_rates(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds)))[self.free_q])

    def outputs(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """Return the model's outputs."""
        return flat(self._outputs(self._state(q, u, p, inputs, t)))[0]

    def output_sensitivities(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array]:
        """Return the model's outputs and their total derivatives along seeds."""
        return flat(self._outputs(self._state(q, u, p, inputs, t, **self._seeds(ALONG, seeds))))

    # --- loops ----------------------------------------------------------------------------------------------------

    def closure(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> tuple[Array, Array]:
        """Return the scaled residuals of the loops in position and velocity at the given q and u."""
        if not self.model.loops:
            return self.arithmetic.zeros(0), self.arithmetic.zeros(0)
        position, velocity = self._closure(self._arguments(q, u, p, inputs, t))
        return position.value[:, 0], velocity.value[:, 0]

    def complete(
        self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0, **seeds: Any
    ) -> tuple[Array, Array, Array]:
        """Return speeds that satisfy the loops, (nu,), and seeds of q and u that do so, (k, nq) and (k, nu)."""
        given = self._seeds(ALONG, seeds) if any(x is not None for x in seeds.values()) else {}
        state = self._state(q, u, p, inputs, t, **given)
        (_, dq), (u, du) = flat(state.q[self.free_q]), flat(state.u[self.free_u])
        return u, dq, du

    def _trees_only(self, name: str) -> None:
        if self.model.loops:
            raise NotImplementedError(
                f"{name}: model {self.model.name} has closed loops, where joint forces are not unique; it is for trees"
            )

    # --- methods that an engine implements ------------------------------------------------------------------------

    @abstractmethod
    def _accelerations(self, state: State) -> Pair:
        """The accelerations udot, (nu, 1), including those of prescribed speeds."""

    @abstractmethod
    def _mass_matrix(self, state: State) -> Pair:
        """The mass matrix M, (nu, nu)."""

    @abstractmethod
    def _solve_mass(self, state: State, b: Pair) -> Pair:
        """The solution M^-1 b, (nu, 1)."""

    @abstractmethod
    def _inverse_dynamics(self, state: State, udot: Pair) -> Pair:
        """The joint forces M udot - K, (nu, 1), in addition to the model's own forces."""

    @abstractmethod
    def _motion(self, state: State) -> Any:
        """Data about the bodies that the engine's own `_energies` and `_point` need."""

    @abstractmethod
    def _energies(self, state: State, motion: Any) -> tuple[Pair, Pair]:
        """Kinetic and potential energy of the state, (1, 1) each."""

    @abstractmethod
    def _point(self, motion: Any, body: int, at: Pair) -> tuple[Pair, Pair]:
        """Position and velocity in the ground frame, (3, 1) each, of the point that is at ``at`` in the axes of
        ``body``."""

    @abstractmethod
    def _attitude(self, motion: Any, body: int) -> tuple[Pair, Pair]:
        """Rotation matrix from body to ground components, (3, 3), and angular velocity in the ground frame, (3, 1), of a body."""

    @abstractmethod
    def _accelerating(self, state: State, motion: Any, udot: Pair) -> Callable[[int, Pair], Pair]:
        """Returns the acceleration, (3, 1) in the ground frame, of the point ``at`` (3, 1) in body axes of a body."""

    @abstractmethod
    def _moving(self, state: State, motion: Any) -> list[Moving]:
        """Mass, motion and angular momentum of each body."""

    def _ends(self, pairs: Pairs, motion: Any, element: ForceElement) -> list[End]:
        """The attachment points of a force element."""
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
        """Evaluates expressions of a force element, which may contain positions and velocities of points."""
        if not element.measured:
            return pairs
        known = {}
        for point in element.measured:
            x, v = self._point(motion, point.body, pairs.vector(point.at))
            for i, c in enumerate("xyz"):
                known[f"position.{point.name}.{c}"], known[f"velocity.{point.name}.{c}"] = x[i, 0], v[i, 0]
        return Pairs(self.arithmetic, pairs.k, {**pairs.environment, **known})

    def _wrenches(self, pairs: Pairs, motion: Any) -> Iterator[tuple[Point | Face, End, Wrench]]:
        """Forces and torques of all force elements on bodies, with their points."""
        for element in self.model.elements:
            yield from self._wrenches_of(element, pairs, motion)

    def _wrenches_of(
        self, element: ForceElement, pairs: Pairs, motion: Any
    ) -> Iterator[tuple[Point | Face, End, Wrench]]:
        """Forces and torques of one force element."""
        ends, seen = self._ends(pairs, motion, element), self._measured(pairs, motion, element)
        yield from zip(element.ends, ends, LAWS[type(element)].wrenches(element, seen, ends), strict=True)

    def _forces_on_speeds(self, pairs: Pairs) -> Pair:
        """Generalised forces of force elements that act directly on speeds of joints, (nu, 1)."""
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
        """The values of all outputs, (noutputs, 1)."""
        seen = self._seen(state)
        return seen.pairs.column([VALUES[output.measure](output, seen) for output in self.model.outputs])

    def _seen(self, state: State) -> Seen:
        """Data about bodies for outputs; accelerations and sums are computed at their first use."""
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
