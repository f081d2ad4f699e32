"""What the reference engines have in common: the face. Arguments are checked and become pairs, results become arrays.

No mechanics stands here. An engine fills in the methods that begin with an underscore.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np

from ..model.model import Model
from .arithmetic import Arithmetic, Array
from .pairs import Pair, Pairs

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


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Partial derivatives of udot: q (nu, nq), u (nu, nu), p (nu, np), inputs (nu, ninputs), t (nu,)."""

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array


class Engine(ABC):
    """A reference engine: any tree model, one state per call, derivatives along any seeds.

    Parameters
    ----------
    model : Model
    numbers : {"float64", "mpmath"}
        With ``mpmath`` every array holds mpf numbers of the caller's ``mpmath.mp.dps`` digits; float arguments are taken
        at their exact binary value.

    Notes
    -----
    Arguments of every method: coordinates ``q (nq,)``, speeds ``u (nu,)``, parameters ``p (np,)`` (None: the model's
    values), ``inputs (ninputs,)`` (None: zeros), time ``t``, in SI units. Seeds carry their k directions first:
    ``dq (k, nq)``, ``du (k, nu)``, ``dp (k, np)``, ``dinputs (k, ninputs)``, ``dt (k,)``; one without k counts as
    k = 1, a missing one is zero. Quaternions may have any length: the rotation of e is that of e/abs(e).
    """

    def __init__(self, model: Model, numbers: str = "float64") -> None:
        self.model = model
        self.arithmetic = Arithmetic(numbers)

    # --- the face -------------------------------------------------------------------------------------------------

    def accelerations(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the speeds, udot (nu,)."""
        return _flat(self._accelerations(self._state(q, u, p, inputs, t)))[0]

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
        return _flat(self._accelerations(self._state(q, u, p, inputs, t, **seeds)))

    def jacobians(self, q: Any, u: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Jacobians:
        """Every partial derivative of udot."""
        sizes = (self.model.nq, self.model.nu, len(self.model.parameters), len(self.model.inputs), 1)
        start = np.cumsum((0, *sizes))
        seeds = [np.eye(start[-1], dtype=int)[:, a:b] for a, b in pairwise(start)]
        dq, du, dp, dinputs, dt = seeds
        _, dudot = self.sensitivities(q, u, p, inputs, t, dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt[:, 0])
        by_q, by_u, by_p, by_inputs, by_t = (dudot[a:b].T for a, b in pairwise(start))
        return Jacobians(by_q, by_u, by_p, by_inputs, by_t[:, 0])

    def mass_matrix(self, q: Any, p: Any = None) -> Array:
        """The mass matrix M of Eq. 4, (nu, nu)."""
        M: Array = self._mass_matrix(self._state(q, None, p, None, 0.0)).value
        return M

    def mass_matrix_sensitivities(
        self, q: Any, p: Any = None, *, dq: Any = None, dp: Any = None
    ) -> tuple[Array, Array]:
        """M (nu, nu) and its total derivatives, (k, nu, nu)."""
        result = self._mass_matrix(self._state(q, None, p, None, 0.0, **self._seeds(dq=dq, dp=dp)))
        return result.value, result.tangent

    def solve_mass(self, q: Any, b: Any, p: Any = None) -> Array:
        """M^-1 b, (nu,), for generalised forces b (nu,)."""
        state = self._state(q, None, p, None, 0.0)
        return _flat(self._solve_mass(state, self._pair("b", b, self.model.nu, None, 0)))[0]

    def solve_mass_sensitivities(
        self, q: Any, b: Any, p: Any = None, *, dq: Any = None, db: Any = None, dp: Any = None
    ) -> tuple[Array, Array]:
        """M^-1 b (nu,) and its total derivatives, (k, nu); ``db (k, nu)``."""
        seeds = self._seeds(dq=dq, db=db, dp=dp)
        db = seeds.pop("db")
        state = self._state(q, None, p, None, 0.0, **seeds)
        return _flat(self._solve_mass(state, self._pair("b", b, self.model.nu, db, len(db))))

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, p: Any = None, inputs: Any = None, t: Any = 0.0) -> Array:
        """The joint forces needed in addition to the model's own for the accelerations udot: M udot - K, (nu,)."""
        state = self._state(q, u, p, inputs, t)
        return _flat(self._inverse_dynamics(state, self._udot(state, udot, None)))[0]

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
        seeds = self._seeds(dq=dq, du=du, dudot=dudot, dp=dp, dinputs=dinputs, dt=dt)
        dudot = seeds.pop("dudot")
        state = self._state(q, u, p, inputs, t, **seeds)
        result = self._inverse_dynamics(state, self._udot(state, udot, dudot))
        return _flat(result)

    def energies(self, q: Any, u: Any, p: Any = None, t: Any = 0.0) -> tuple[Any, Any]:
        """Kinetic and potential energy, J. The potential of gravity is zero at the ground's origin."""
        state = self._state(q, u, p, None, t)
        kinetic, potential = self._energies(state, self._motion(state))
        return kinetic.value[0, 0], potential.value[0, 0]

    def energy_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dt: Any = None,
    ) -> tuple[tuple[Any, Any], tuple[Array, Array]]:
        """Kinetic and potential energy and their total derivatives: (T, V), (dT (k,), dV (k,))."""
        state = self._state(q, u, p, None, t, **self._seeds(dq=dq, du=du, dp=dp, dt=dt))
        kinetic, potential = self._energies(state, self._motion(state))
        derivatives = kinetic.tangent[:, 0, 0], potential.tangent[:, 0, 0]
        return (kinetic.value[0, 0], potential.value[0, 0]), derivatives

    def coordinate_rates(self, q: Any, u: Any, p: Any = None, t: Any = 0.0) -> Array:
        """The derivatives of the coordinates, Eq. 1, (nq,)."""
        return _flat(self._coordinate_rates(self._state(q, u, p, None, t)))[0]

    def coordinate_rate_sensitivities(
        self,
        q: Any,
        u: Any,
        p: Any = None,
        t: Any = 0.0,
        *,
        dq: Any = None,
        du: Any = None,
        dp: Any = None,
        dt: Any = None,
    ) -> tuple[Array, Array]:
        """qdot (nq,) and its total derivatives, (k, nq)."""
        result = self._coordinate_rates(self._state(q, u, p, None, t, **self._seeds(dq=dq, du=du, dp=dp, dt=dt)))
        return _flat(result)

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

    # --- what an engine fills in ----------------------------------------------------------------------------------

    @abstractmethod
    def _accelerations(self, state: State) -> Pair:
        """udot, (nu, 1)."""

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

    def _outputs(self, state: State) -> Pair:
        """The outputs, (noutputs, 1)."""
        pairs, motion, values = state.pairs, self._motion(state), []
        for output in self.model.outputs:
            if output.measure in ("kinetic_energy", "potential_energy"):
                values.append(self._energies(state, motion)[output.measure == "potential_energy"][0, 0])
            elif output.expression is not None:
                values.append(pairs.expression(output.expression))
            elif output.point is not None and output.axis is not None:
                position, velocity = self._point(motion, output.point.body, pairs.vector(output.point.at))
                axis = pairs.unit(pairs.vector(output.axis))
                values.append(pairs.dot(axis, position if output.measure == "position" else velocity))
            else:
                raise ValueError(f"output {output.name}: measure {output.measure!r} is not known or incomplete")
        return pairs.column(values)

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
        """Check the arguments and bind the names that expressions know."""
        model, k = self.model, len(dq) if dq is not None else 0
        if p is None:
            p = [x.value for x in model.parameters]
        q = self._pair("q", q, model.nq, dq, k)
        u = self._pair("u", np.zeros(model.nu, int) if u is None else u, model.nu, du, k)
        p = self._pair("p", p, len(model.parameters), dp, k)
        inputs = self._pair(
            "inputs", np.zeros(len(model.inputs), int) if inputs is None else inputs, len(model.inputs), dinputs, k
        )
        time = self._pair("t", np.reshape(t, (1,)), 1, None if dt is None else dt[:, None], k)
        environment = {"t": time[0, 0]}
        environment |= {name: p[i, 0] for i, name in enumerate(model.parameter_names)}
        environment |= {name: inputs[i, 0] for i, name in enumerate(model.inputs)}
        environment |= {f"q.{name}": q[i, 0] for i, name in enumerate(model.coordinate_names)}
        environment |= {f"u.{name}": u[i, 0] for i, name in enumerate(model.speed_names)}
        for body, (rows, _) in zip(model.bodies, model.coordinate_slices, strict=True):
            if body.joint.type in ("spherical", "free"):
                e = q.value[rows.stop - 4 : rows.stop, 0]
                if not e @ e >= SMALLEST_QUATERNION**2:
                    raise ValueError(f"q: the quaternion of {body.name} is {e}; its length must be at least 1e-6")
        return State(Pairs(self.arithmetic, k, environment), q, u)

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
        n = {"dq": self.model.nq, "du": self.model.nu, "dudot": self.model.nu, "db": self.model.nu}
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
        return self._pair("udot", udot, self.model.nu, dudot, state.pairs.k)


def _flat(column: Pair) -> tuple[Array, Array]:
    """A column's value (n,) and derivatives (k, n)."""
    return column.value[:, 0], column.tangent[..., 0]
