"""Errors of the generated solver relative to the generic engine at extended precision, at the same states."""

from __future__ import annotations

import contextlib
import decimal
import time
import warnings
from collections.abc import Iterator, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np

from ..measure import accuracy
from ..measure.clock import elapsed, in_rounds
from ..model import Model, parse_model
from ..reference import RecursiveEngine
from .skipped import Skipped
from .states import State

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..runtime import Solver

    Array = NDArray[np.float64]

DIGITS = 40
"""Number of decimal digits of the reference."""

MOST_PARAMETERS, MIXED = 16, 3
"""Number of parameters whose derivatives are compared, and number of random directions, along which all quantities change."""

VANISHING = 1e-12
"""Below this fraction of its natural size, a derivative is zero except for the rounding of the state. An example is the
derivative with respect to the speeds of a parallelogram, since its links rotate equally."""

MOST_COLUMNS = 60
"""Largest number of columns for which Jacobians and a gradient are compared."""

WITNESS = """\
model: witness
gravity: [0, 0, -9.81]
parameters: {length: 1.0}
bodies:
  upper:
    parent: ground
    joint: {type: revolute, axis: y, at: [0, 0, 0]}
    shape: {type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}
  lower:
    parent: upper
    joint: {type: revolute, axis: x, at: [0, 0, -length]}
    shape: {type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}
"""
"""A small model on which the reference is timed in extended precision and in doubles."""

Exact = Any
"""Results of the reference, (nu,), as mpmath numbers."""

NUMBERS = "decimal"
"""The number type in which the reference computes."""

_as_mpf = np.frompyfunc(mpmath.mp.convert, 1, 1)


@contextlib.contextmanager
def _extended() -> Iterator[None]:
    """A context in which the reference computes, and its results are compared, at extended precision."""
    with mpmath.workdps(DIGITS), decimal.localcontext(prec=DIGITS):
        yield


@cache
def slowdown() -> float:
    """Ratio of the reference's time in extended precision to its time in doubles, on this machine."""
    model = parse_model(WITNESS)
    calls = {
        n: partial(RecursiveEngine(model, numbers=n).accelerations, [0.3, 0.4], [1.0, -1.0])
        for n in (NUMBERS, "float64")
    }
    with _extended():
        found = in_rounds({n: elapsed(call, clock=time.process_time) for n, call in calls.items()}, 3)
    return found[NUMBERS].least / found["float64"].least


def relative(x: Any, exact: Any, natural: float = 1.0) -> float:
    """The error by `accuracy.relative`; where the exact values vanish, the error relative to `natural`."""
    return accuracy.relative(x, exact, _size(np.ravel(exact), natural))


def vanishes(exact: Any, natural: float) -> bool:
    """Whether a derivative is no larger than the effect of rounding the state."""
    return bool(accuracy.largest(exact) <= VANISHING * natural)


def _size(exact: Any, natural: float) -> Any:
    return mpmath.mpf(natural) if vanishes(exact, natural) else accuracy.largest(exact)


def natural_sizes(udot: Any, values: Any) -> Array:
    """Natural sizes of derivatives with respect to quantities of given values.

    A derivative has its natural size if a change of the quantity by its value (or by 1 if that is zero) changes udot by the
    size of udot.
    """
    values = np.abs(np.asarray(values, float))
    return _float_size(udot) / np.where(values > 0, values, 1.0)


def _float_size(udot: Any) -> float:
    return float(_size(udot, 1.0))


def directions(model: Model, solver: Solver) -> tuple[list[str], dict[str, Any]]:
    """Names and seeds of the directions: parameters one by one, then random directions, along which all quantities change."""
    rng = np.random.default_rng(2)
    names = list(model.parameter_names)
    if len(names) > MOST_PARAMETERS:  # the chosen parameters are spread over the list
        names = [names[i] for i in np.linspace(0, len(names) - 1, MOST_PARAMETERS).astype(int)]
    k = len(names) + MIXED
    seeds: dict[str, Any] = {name: np.zeros((k, n)) for name, n in
             (("dq", solver.nq), ("du", solver.nu), ("dp", solver.np), ("dinputs", solver.ninputs))}  # fmt: skip
    for i, name in enumerate(names):
        seeds["dp"][i, model.parameter_names.index(name)] = 1.0
    for x in seeds.values():
        x[len(names) :] = rng.normal(size=(MIXED, x.shape[1]))
    seeds["dt"] = np.concatenate([np.zeros(len(names)), rng.normal(size=MIXED)])
    return [*names, *(f"mixed {i + 1}" for i in range(MIXED))], seeds


def errors(
    model: Model, solver: Solver, states: Sequence[State], budget: float, skipped: list[Skipped]
) -> tuple[list[dict[str, Any]], dict[str, Exact]]:
    """Relative errors at each state: of udot, of each derivative, of Jacobians and of a gradient.

    Parameters
    ----------
    model : Model
    solver : Solver
    states : sequence of State
    budget : float
        Approximate CPU seconds for the reference; what would exceed them is left out and listed in `skipped`.

    Returns
    -------
    records : list of dict
        ``state``, ``udot``, ``derivatives`` (by direction); ``estimate`` and ``estimates`` of these errors by `Solver.diagnose`;
        ``vanish``, the directions whose derivative is zero, with errors relative to `natural_sizes`. At the first state also
        ``jacobians`` (the worst column) and ``gradient``, if the model is small enough.
    exact : dict of str to (nu,) numbers
        Exact derivatives at the first state by direction.
    """
    names, seeds = directions(model, solver)
    alone = _seconds_of_udot(model, states[0], budget)
    if alone is None:
        seconds = slowdown() * _seconds_of_udot_in_doubles(model, states[0]) * (1 + len(names)) * len(states)
        skipped.append(
            Skipped("errors against the generic engine in extended precision", "the model is too large", seconds)
        )
        return [], {}
    names, seeds = _affordable(names, seeds, alone, budget, skipped)
    engine = RecursiveEngine(model, numbers=NUMBERS)
    found: list[dict[str, Any]] = []
    derivatives: dict[str, Exact] = {}
    spent, expected = 0.0, alone * (1 + len(names))
    for state in states:
        if found and spent + expected > budget:
            skipped.append(
                Skipped(f"errors at state {state.name!r}", f"the reference has used its {budget:g} s", expected)
            )
            continue
        record, dexact, expected = _at_state(engine, solver, state, names, seeds, _values(model, solver, names))
        found.append(record)
        spent += expected
        derivatives = derivatives or dict(zip(names, dexact, strict=True))
    columns = model.nq + model.nu + len(model.parameters) + len(model.inputs) + 1
    cost = expected * columns / len(names)
    if columns <= MOST_COLUMNS and spent + cost <= 2 * budget:
        with _extended():
            first = states[0]
            found[0] |= _of_all_columns(engine, solver, (first.q, first.u, None, first.inputs, first.t))
    else:
        skipped.append(Skipped("errors of Jacobians and of a gradient", f"the Jacobians have {columns} columns", cost))
    return found, derivatives


def _affordable(
    names: list[str], seeds: dict[str, Any], alone: float, budget: float, skipped: list[Skipped]
) -> tuple[list[str], dict[str, Any]]:
    """The directions that the reference can compute at one state within the budget; `alone` is the time of its accelerations."""
    affordable = int(budget / alone) - 1
    if affordable >= len(names):
        return names, seeds
    left = max(affordable, 1)
    what = f"errors of derivatives along more than {left} direction{'s' * (left > 1)}"
    why = f"one state with all {len(names)} would take longer than {budget:g} s"
    skipped.append(Skipped(what, why, alone * (1 + len(names))))
    return names[:left], {name: x[:left] for name, x in seeds.items()}


def _at_state(
    engine: RecursiveEngine, solver: Solver, state: State, names: Sequence[str], seeds: dict[str, Any], values: Array
) -> tuple[dict[str, Any], Exact, float]:
    """A record of `errors`, the exact derivatives, and CPU seconds of the reference."""
    at = state.q, state.u, None, state.inputs, state.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        udot, dudot = solver.sensitivities(*at, **seeds)
    start = time.process_time()
    with _extended():
        exact, dexact = map(_as_mpf, engine.sensitivities(*at, **seeds))
        natural = natural_sizes(exact, values)
        record = {
            "state": state.name,
            "udot": relative(udot, exact),
            "derivatives": {n: relative(a, b, x) for n, a, b, x in zip(names, dudot, dexact, natural, strict=True)},
            "vanish": [n for n, b, size in zip(names, dexact, natural, strict=True) if vanishes(b, size)],
        }
        sizes = [float(_size(b, size)) for b, size in zip(dexact, natural, strict=True)]
    seconds = time.process_time() - start
    return record | _estimates(solver, at, seeds, names, _float_size(exact), sizes), dexact, seconds


def _values(model: Model, solver: Solver, names: Sequence[str]) -> Array:
    """The value of the parameter that belongs to each direction; 1 for random directions."""
    at = {name: float(x) for name, x in zip(model.parameter_names, solver.parameters, strict=True)}
    return np.array([at.get(name, 1.0) for name in names])


def _estimates(
    solver: Solver, at: Sequence[Any], seeds: dict[str, Any], names: Sequence[str], size: float, sizes: Sequence[float]
) -> dict[str, Any]:
    """Errors of udot and of each derivative as estimated by `Solver.diagnose`, relative to `size` and `sizes`."""
    found = solver.diagnose(*at, **seeds)
    parts = [float(np.max(e, initial=0.0)) / n for e, n in zip(found.dudot_error, sizes, strict=True)]
    return {
        "estimate": float(np.max(found.udot_error, initial=0.0)) / size,
        "estimates": dict(zip(names, parts, strict=True)),
    }


def _seconds_of_udot(model: Model, state: State, budget: float) -> float | None:
    """CPU seconds of the reference for the accelerations alone; None if they exceed the budget."""
    if slowdown() * _seconds_of_udot_in_doubles(model, state) > budget:
        return None
    with _extended():
        return _seconds_of(RecursiveEngine(model, numbers=NUMBERS), state)


def _seconds_of_udot_in_doubles(model: Model, state: State) -> float:
    return _seconds_of(RecursiveEngine(model), state)


def _seconds_of(engine: RecursiveEngine, state: State) -> float:
    """CPU seconds of one evaluation of the accelerations by the reference."""
    call = partial(engine.accelerations, state.q, state.u, None, state.inputs, state.t)
    return elapsed(call, clock=time.process_time)()


def _of_all_columns(engine: RecursiveEngine, solver: Solver, at: Sequence[Any]) -> dict[str, float]:
    """The largest error of any column of the Jacobians, and of the gradient with respect to any of q, u, p, inputs and t."""
    exact = engine.jacobians(*at)
    given = solver.jacobians(*at)
    udot = _as_mpf(engine.accelerations(*at))
    weights = np.random.default_rng(3).normal(size=solver.nu)
    gradients = solver.gradients(*at, weights=weights)
    exact_weights = np.array([mpmath.mpf(float(w)) for w in weights], dtype=object)
    q, u, _, inputs, t = at
    worst_column, worst_part = 0.0, 0.0
    for part, values in (("q", q), ("u", u), ("p", solver.parameters), ("inputs", inputs), ("t", [t])):
        columns, ours = _as_mpf(getattr(exact, part)), np.asarray(getattr(given, part))
        if not columns.size:
            continue
        columns, ours = columns.reshape(solver.nu, -1), ours.reshape(solver.nu, -1)
        natural = natural_sizes(udot, values)
        for a, b, size in zip(ours.T, columns.T, natural, strict=True):
            worst_column = max(worst_column, relative(a, b, size))
        worst_part = max(
            worst_part,
            relative(np.ravel(getattr(gradients, part)), exact_weights @ columns, float(np.max(natural))),
        )
    return {"jacobians": worst_column, "gradient": worst_part}
