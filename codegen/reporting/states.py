"""States at which a report measures: random ones, extreme ones, and one near a singularity."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..runtime.standalone.errors import AssemblyError, SingularJointError, SingularLoopError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..model import Model
    from ..runtime import Solver

    Array = NDArray[np.float64]

RANDOM = 3
"""Number of random states in a report."""

NEARER, FARTHER = 0.7, 1.1
"""After each random state whose loops do not close, the spread is multiplied by the first factor; after each state
whose loops close, by the second. So about one state of five does not close; finding that out takes the longest."""

SEARCHED = 100
"""Number of random states of which the one with the largest condition number is taken."""

TURNS, FAST = 1e5, 1e3
"""For extreme states: turns of every independent revolute joint, and a factor for the speeds."""

SPREAD, SPREAD_CLOSED = 1.0, 0.15
"""Standard deviation of coordinates about the initial state, rad or m, without and with loops."""


@dataclass(frozen=True)
class State:
    """A state at which functions are evaluated.

    Attributes
    ----------
    name : str
        "random 1", "many turns", ...
    q, u, inputs : (nq,), (nu,), (ninputs,)
    t : float
        s.
    """

    name: str
    q: Array
    u: Array
    inputs: Array
    t: float


def states(model: Model, solver: Solver, condition: Callable[[State], float]) -> list[State]:
    """The states of a report; the same for the same solver.

    Parameters
    ----------
    condition : callable
        Returns a number that is large near a singularity.
    """
    drawn = random_states(solver, np.random.default_rng(1))
    ordinary = [s for _, s in zip(range(RANDOM), drawn, strict=False)]
    if not ordinary:
        return []
    first = ordinary[0]
    found = [first]
    found += [s for s in (_turned(model, solver, first), _fast(solver, first)) if s is not None]
    worst, worst_condition = None, -1.0
    for _, s in zip(range(SEARCHED), drawn, strict=False):
        c = condition(s)
        if np.isfinite(c) and c > worst_condition:
            worst, worst_condition = s, c
    if worst is not None:
        found.append(State("worst condition", worst.q, worst.u, worst.inputs, worst.t))
    return found + ordinary[1:]  # if the reference has no time for all states, it takes the first ones


def random_states(solver: Solver, rng: np.random.Generator, most: int = 10 * SEARCHED) -> Iterator[State]:
    """Random states about the initial one, with closed loops and finite accelerations.

    If few of them close, the others are drawn closer to the initial state.
    """
    try:
        q0, u0 = solver.initial
    except (AssemblyError, SingularLoopError):
        return
    spread = SPREAD_CLOSED if solver.closure_names else SPREAD
    number, nearer = 0, 1.0
    for _ in range(most):
        q, u = q0 + nearer * spread * rng.normal(size=solver.nq), u0 + rng.normal(size=solver.nu)
        inputs, t = rng.normal(size=solver.ninputs), float(rng.uniform(0.1, 1.0))
        state = _closed(solver, f"random {number + 1}", q, u, inputs, t)
        nearer = min(nearer * FARTHER, 1.0) if state else nearer * NEARER
        if state is not None:
            number += 1
            yield state


def _closed(solver: Solver, name: str, q: Array, u: Array, inputs: Array, t: float) -> State | None:
    try:
        q, u = solver.assemble(q, u)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            finite = np.isfinite(solver.accelerations(q, u, None, inputs, t)).all()
    except (AssemblyError, SingularLoopError, SingularJointError):
        return None
    return State(name, q, u, inputs, t) if finite else None


def _turned(model: Model, solver: Solver, state: State) -> State | None:
    """A state in which every independent angle is many turns from zero."""
    units = zip(model.coordinate_names, model.coordinate_units, strict=True)
    angles = [i for i, (name, unit) in enumerate(units) if unit == "rad" and name in solver.independent_names]
    if not angles:
        return None
    q = state.q.copy()
    q[angles] += TURNS * 2 * np.pi
    return _closed(solver, "many turns", q, state.u, state.inputs, state.t)


def _fast(solver: Solver, state: State) -> State | None:
    return _closed(solver, "fast", state.q, FAST * state.u, state.inputs, state.t)
