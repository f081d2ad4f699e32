"""Arguments of the reference engines: checks, conversion to pairs, and dependent values from closure."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..loops.partition import Partition
from ..loops.partition import partition as choose_partition
from ..loops.speed_groups import SpeedGroup, coordinates_of
from ..model.errors import with_article
from ..model.model import Model, closure_row_names
from .arithmetic import Arithmetic, Array
from .pairs import Pair, Pairs

ALONG = ("dq", "du", "dp", "dinputs", "dt")
"""Names of seeds, in the order of the arguments."""

INCONSISTENT = 1e-6
"""A warning reports the residual of a redundant condition if it exceeds this fraction of the speeds or seeds."""

ALLOWED = 10.0
"""A warning reports the residual of a dropped condition if it exceeds the speeds or seeds times the model's tolerance
times this number."""

SMALLEST_QUATERNION = 1e-6
"""Smallest norm of a quaternion that defines a rotation accurately."""


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


class Arguments(ABC):
    """The model, the partition and the methods of an engine that this module uses; see `Engine`."""

    def __init__(self, model: Model, numbers: str | Arithmetic = "float64", partition: Partition | None = None) -> None:
        if not isinstance(model, Model):
            raise TypeError(
                f"{with_article(type(model).__name__)} is given; a Model is needed; load_model reads a file"
            )
        self.given = model
        model = self.model = model.released
        self.held = np.array(
            [model.coordinate_slices[x.body][1].start + x.index for x in self.given.prescribed], dtype=int
        )
        held_q = [model.coordinate_slices[x.body][0].start + x.index for x in self.given.prescribed]
        self.free_q, self.free_u = (
            np.setdiff1d(np.arange(n), held) for n, held in ((model.nq, held_q), (model.nu, self.held))
        )
        self.arithmetic = Arithmetic(numbers) if isinstance(numbers, str) else numbers
        if partition is None:
            partition = choose_partition(self.given) if model.loops else Partition((), tuple(range(model.nu)))
        self.partition = partition
        model = self.model = model.with_turned(partition.turned)
        self.given = self.given.with_turned(partition.turned)
        self.dependent = np.array(sorted(i for ear in partition.ears for i in ear.dependent), dtype=int)
        self.dependent_coordinates = np.array(coordinates_of(model, set(self.dependent.tolist()))[0], dtype=int)
        self.split = partition.split(model)
        closed = sorted({loop for ear in partition.ears for loop in ear.loops})
        if closed != list(range(len(model.loops))):
            raise ValueError(
                f"partition: its ears close the loops {closed}, expected all {len(model.loops)} loops of the model"
            )
        if sorted([*self.dependent, *partition.independent]) != list(range(model.nu)):
            raise ValueError("partition: every speed must be either independent or dependent in one ear")
        self.lengths = partition.lengths
        ends = np.cumsum([0, *(len(closure_row_names(loop)) for loop in model.loops)])
        self.closure_slices = tuple(slice(a, b) for a, b in pairwise(ends.tolist()))
        self.dropped_rows = partition.dropped_rows(model)
        self.kept = np.setdiff1d(np.arange(ends[-1]), partition.dropped_conditions(model))

    def _state(self, q: Any, u: Any, p: Any, inputs: Any, t: Any, **seeds: Any) -> State:
        """The arguments, with dependent speeds and seeds from closure."""
        state = self._arguments(q, u, p, inputs, t, **seeds)
        return self._completed(state) if self.model.loops else state

    def _arguments(self, q: Any, u: Any, p: Any, inputs: Any, t: Any, **seeds: Any) -> State:
        """Check the arguments and bind the names that expressions know."""
        dq, du, dp, dinputs, dt = (seeds.get(name) for name in ALONG)
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
            if not (self.arithmetic.symbolic or e @ e >= SMALLEST_QUATERNION**2):
                name = model.bodies[body].name
                raise ValueError(f"q: the quaternion of {name} is {e}; its length must be at least 1e-6")
        return State(Pairs(self.arithmetic, k, environment), q, u).moved(model, q, u)

    def _pair(self, name: str, value: Any, n: int, seed: Any, k: int) -> Pair:
        """An argument (n,) and its seed (k, n) as a column."""
        value = self.arithmetic.array(value)
        if value.shape != (n,):
            raise ValueError(f"{name} has shape {value.shape}, expected ({n},)")
        if not self.arithmetic.symbolic and any(map(self.arithmetic.is_nan, value)):
            raise ValueError(f"{name} holds NaN: {value}")
        tangent = self.arithmetic.zeros(k, n) if seed is None else seed
        if tangent.shape != (k, n):
            raise ValueError(f"d{name} has shape {tangent.shape}, expected ({k}, {n})")
        return Pair(value[:, None], tangent[..., None])

    def _seeds(self, allowed: Sequence[str], given: Mapping[str, Any]) -> dict[str, Array]:
        """All seeds of a method in order, with a common number of directions k; missing ones are zero."""
        if wrong := [name for name in given if name not in allowed]:
            raise TypeError(f"seeds {', '.join(wrong)} are not known here; {', '.join(allowed)} are")
        seeds = {name: given.get(name) for name in allowed}
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
            shape = (k,) if name == "dt" else (k, self._seed_size(name))
            array = arrays.setdefault(name, self.arithmetic.zeros(*shape))
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected {shape}: {first} has {k} directions")
        return {name: arrays[name] for name in allowed}

    def _seed_size(self, name: str) -> int:
        """Number of entries of a seed, without the directions."""
        of_arguments = {
            "dq": self.given.nq, "dp": len(self.model.parameters), "dinputs": len(self.model.inputs), "dt": 1,
        }  # fmt: skip
        return of_arguments.get(name, self.given.nu)

    def _udot(self, state: State, udot: Any, dudot: Any) -> Pair:
        found = self._of_speeds("udot", udot, dudot, state.pairs)
        return self._with_accelerations(found, state.pairs)

    # --- prescribed motion ------------------------------------------------------------------------------------------

    def _with_prescribed(self, q: Pair, u: Pair, pairs: Pairs) -> tuple[Pair, Pair]:
        """All coordinates and speeds: the given ones and the prescribed ones."""
        if not self.given.motion:
            return q, u
        held_q = np.setdiff1d(np.arange(self.model.nq), self.free_q)
        found = []
        for of, n, free, held, order in (
            (q, self.model.nq, self.free_q, held_q, 0), (u, self.model.nu, self.free_u, self.held, 1),
        ):  # fmt: skip
            whole = pairs.zeros(n, 1)
            given = pairs.vector([x.values[order] for x in self.given.prescribed])
            for rows, part in ((free, of), (held, given)):
                whole[rows] = part
            found.append(whole)
        return found[0], found[1]

    def _prescribed_accelerations(self, pairs: Pairs) -> Pair:
        """The accelerations of prescribed coordinates, (n, 1)."""
        return pairs.vector([x.values[2] for x in self.given.prescribed])

    def _with_accelerations(self, udot: Pair, pairs: Pairs) -> Pair:
        """The accelerations of all speeds, including the prescribed ones."""
        if len(self.held):
            given = self._prescribed_accelerations(pairs)
            udot[self.held] = given
        return udot

    def _of_speeds(self, name: str, value: Any, seed: Any, pairs: Pairs) -> Pair:
        """An argument for the free speeds, (nu, 1), with zeros for prescribed speeds."""
        part = self._pair(name, value, self.given.nu, seed, pairs.k)
        whole = pairs.zeros(self.model.nu, 1)
        whole[self.free_u] = part
        return whole

    def _of_free(self, column: Pair) -> tuple[Array, Array]:
        """Value (nu,) and derivatives (k, nu) of the free speeds of a column."""
        return flat(column[self.free_u])

    # --- closed loops ---------------------------------------------------------------------------------------------

    def _completed(self, state: State) -> State:
        """Speeds and seeds whose dependent entries follow from closure; the caller's values of these entries are
        ignored."""
        model, dependent = self.model, self.dependent
        q, u = (Pair(x.value.copy(), x.tangent.copy()) for x in (state.q, state.u))
        q.tangent[:, self.dependent_coordinates] *= 0
        for group in self.split:
            q.tangent[:, group.coordinates] = self._along_independents(state, group)
        u.value[dependent] *= 0
        u.tangent[:, dependent] *= 0
        state = state.moved(model, q, u)
        if state.pairs.k:
            # Displacements relate to coordinates as speeds relate to qdot: Eq. 1.
            still = state.moved(model, Pair(q.value, 0 * q.tangent), Pair(0 * u.value, self._displacements(state)))
            q.tangent += self._coordinate_rates(still).tangent
            state = state.moved(model, q, u)
        closed = self._closed_speeds(state)
        u[dependent] = closed
        state = state.moved(model, q, u)
        if len(dependent) < len(model.closure_names):
            self._check_redundant(state)
        return state

    def _along_independents(self, state: State, group: SpeedGroup) -> Array:
        """The part of a group's seeds that moves the group along its independent speeds, (k, n, 1).

        A displacement relates to coordinates as a speed relates to qdot, and the qdot of the speeds of a group are
        mutually perpendicular. So this part is the projection of the seeds on the qdot of the independent speeds.
        Changes of a quaternion's length are dropped with the rest.
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
        """Warns if a redundant condition, which the dependent speeds cannot satisfy, does not hold. Along a direction
        that violates it, no derivative exists."""
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

    @abstractmethod
    def _closure(self, state: State) -> tuple[Pair, Pair]:
        """Scaled residuals of position and velocity closure, (m, 1) each."""

    @abstractmethod
    def _displacements(self, state: State) -> Array:
        """Displacements along dependent speeds that keep the loops closed along the seeds; (k, nu, 1)."""

    @abstractmethod
    def _closed_speeds(self, state: State) -> Pair:
        """The dependent speeds, in the order of `dependent`, (r, 1), from velocity closure at the state."""

    @abstractmethod
    def _coordinate_rates(self, state: State) -> Pair:
        """The time derivatives qdot of the coordinates, (nq, 1)."""


def flat(column: Pair) -> tuple[Array, Array]:
    """Value (n,) and derivatives (k, n) of a column."""
    return column.value[:, 0], column.tangent[..., 0]
