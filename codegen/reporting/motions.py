"""Motions: work-precision diagrams of every integrator, for state and sensitivities, and conditions along the way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..choices import more_choices
from ..measure.clock import elapsed, in_rounds
from ..measure.operations import operations
from ..runtime.standalone.trajectory.trajectory import FINISHED
from .errors import natural_sizes, relative
from .integrating import (
    COSTLIEST,
    FIXED,
    FIXED_TOLERANCE,
    PROBED,
    ROUNDS,
    Setting,
    evaluation,
    motion,
    timed,
)  # fmt: skip
from .skipped import Skipped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..measure.core import Core
    from ..model import Model
    from ..runtime import Solver, Trajectory

    Array = NDArray[np.float64]

END = 5.0
"""Seconds of motion, if nobody says how many."""

ADAPTIVE = {"dop853": range(4, 13), "radau": range(4, 11)}
"""Tolerances 10^-e of the adaptive methods."""

ORDERS = {"dop853": 8, "radau": 5}

REFERENCES = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9)
"""Tolerances of the motion that errors are against: the first that a motion comes to its end with. Of large angles and speeds the
last digits cannot be computed. Its error is estimated by the next one."""

LOST, LEAST = 1e-3, 1e-3
"""A motion whose reference is known no better, a chaotic one, is halved, down to this part of the requested time."""

EXACT = 1e-11
"""An error below which a motion is exact but for rounding; a method that has one errs by more at its loosest tolerance."""

FACTORS = 20
"""Factorizations that an implicit method needs, at least; where they cost too much it is left out."""

MOTIONS = len(FIXED) + sum(map(len, ADAPTIVE.values()))
"""Settings of a diagram."""

LONGEST = 0.75 * COSTLIEST
"""Those of a motion at a tolerance of 1e-6: what takes more is integrated for a shorter time."""

MOST_SENSITIVITIES = 4

SAMPLES = 101
"""Times along a motion at which conditions are looked at."""

LARGEST_MATRIX = 300
"""Speeds up to which conditions of mass matrices are computed."""


def motions(
    model: Model, solver: Solver, end: float, skipped: list[Skipped], remade: Callable[[int], Solver], core: Core
) -> dict[str, Any] | None:
    """Work-precision diagrams, and conditions along the motion; None if the model does not move.

    Parameters
    ----------
    remade : callable
        Gives a solver with that number of choices of independent coordinates, for motions through dead points.
    core : Core
        Timed beside motions.

    Returns
    -------
    dict
        ``end``; ``choices``, of independent coordinates; ``ended``, why a motion is shorter than asked for; ``sensitivities``,
        names; ``reference_error``, of the state and of ``reference_error_sensitivities``; ``methods``: lists of points, each
        with ``setting``, ``error``, ``sensitivity_error``, ``evaluations``, ``operations``, ``seconds`` of the one motion and
        ``core`` and ``cache`` beside it; ``conditions``, see `conditions`.
    """
    names = sensitivities(model)
    probe = motion(solver, Setting(end, names, "dop853", 1e-6), allowed=PROBED)
    choices = 1
    while not isinstance(probe, str) and (more := more_choices(solver, probe, choices)):
        choices, solver = more, remade(more)
        probe = motion(solver, Setting(end, names, "dop853", 1e-6), allowed=PROBED)
    if isinstance(probe, str):
        skipped.append(Skipped("motions", probe))
        return None
    reached = float(probe.stats["t"])  # which need not be one of its times
    found: dict[str, Any] = {"asked": end, "choices": choices, "sensitivities": names}
    if probe.ended != FINISHED:
        found["ended"] = str(probe.stats["reason"])
        end = float(f"{0.8 * reached:.2g}")
        if not end > 0:
            skipped.append(Skipped("motions", found["ended"]))
            return None
    implicit = FACTORS * _factoring(solver) <= COSTLIEST
    stiff = implicit and _cost(solver, probe, names) > LONGEST
    if stiff:  # an explicit method needs too many steps: the implicit one is the reference
        probe = motion(solver, Setting(end, names, "radau", 1e-6))
    end = _affordable_end(solver, probe, names, end, skipped)
    method = "radau" if stiff else "dop853"
    known = _known(solver, names, method, end, found, skipped)
    if known is None:
        return None
    end, reference, best = known
    found["methods"] = {"rk4": _fixed(solver, end, names, best, core)}
    for name, exponents in ADAPTIVE.items():
        if name == "radau" and not implicit:
            skipped.append(_without_factors(solver, best, names, len(exponents)))
            continue
        looser = [e for e in exponents if 10.0**-e > 1.5 * reference]
        found["methods"][name] = _adaptive(solver, end, names, name, looser, best, skipped, core)
    if _is_rounding(found["methods"]):
        why = "every method integrates this motion exactly, as one at constant acceleration: errors are rounding at any tolerance"
        skipped.append(Skipped("work and precision", why))
        found["methods"] = {}
    found["conditions"] = conditions(solver, end, method, skipped)
    return found


def _known(
    solver: Solver, names: Sequence[str], method: str, end: float, found: dict[str, Any], skipped: list[Skipped]
) -> tuple[float, float, Trajectory] | None:
    """How far a motion is known, s, the tolerance of the reference, and the reference; None where there is none."""
    while True:
        reference, best, beside = _reference(solver, end, names, method)
        if isinstance(best, str) or isinstance(beside, str):
            skipped.append(Skipped("motions", next(x for x in (best, beside) if isinstance(x, str))))
            return None
        own_errors = _errors(beside, best, _values(solver, names))
        if max(own_errors) <= LOST or end < LEAST * found["asked"]:
            break
        found["ended"] = (
            f"at {end:g} s motions that are integrated with tolerances of {reference:g} and ten times as much differ by "
            f"{max(own_errors):.1g} of themselves"
        )
        end = float(f"{end / 2:.2g}")
    found |= {"end": end, "reference": f"{method} at {reference:g}"}
    found["reference_error"], found["reference_error_sensitivities"] = own_errors
    return end, reference, best


def _affordable_end(
    solver: Solver, probe: Trajectory | str, names: Sequence[str], end: float, skipped: list[Skipped]
) -> float:
    """How far motions may go, by the operations of a probe to the end, s."""
    cost = math.inf if isinstance(probe, str) else _cost(solver, probe, names)
    if cost <= LONGEST:
        return end
    shorter = float(f"{end * max(LONGEST / cost, 1e-4):.2g}")
    seconds = None if isinstance(probe, str) else float(probe.stats["seconds"]) * ROUNDS * MOTIONS
    why = "has no end" if isinstance(probe, str) else f"takes {cost:.1g} operations"
    skipped.append(
        Skipped(f"motions beyond {shorter:g} s", f"one of {end:g} s {why}, of {LONGEST:.1g} allowed", seconds)
    )
    return shorter


def _without_factors(solver: Solver, best: Trajectory, names: Sequence[str], settings: int) -> Skipped:
    """The implicit method, which is left out for a matrix that is too large."""
    rate = _cost(solver, best, names) / max(float(best.stats["seconds"]), 1e-9)
    seconds = FACTORS * _factoring(solver) / rate * ROUNDS * settings
    return Skipped("motions by an implicit method", f"it factors matrices of {solver.nu} columns", seconds)


def _is_rounding(methods: dict[str, list[dict[str, Any]]]) -> bool:
    """Whether the errors of all methods are rounding at their loosest settings already, so that they say nothing of methods."""
    points = [p for several in methods.values() for p in several]
    return bool(points) and all(max(p["error"], p["sensitivity_error"] or 0.0) < EXACT for p in points)


def sensitivities(model: Model) -> list[str]:
    """What motions are differentiated by."""
    return list(model.parameter_names[:MOST_SENSITIVITIES])


def settings(found: dict[str, Any]) -> list[tuple[dict[str, Any], Setting]]:
    """All points of the diagrams that `motions` gives, and how to make their motions again."""
    end, names = found["end"], found["sensitivities"]
    return [
        (p, Setting(end, names, method, FIXED_TOLERANCE, round(end / p["setting"])))
        if method == "rk4"
        else (p, Setting(end, names, method, p["setting"]))
        for method, points in found["methods"].items()
        for p in points
    ]


def _reference(
    solver: Solver, end: float, names: Sequence[str], method: str
) -> tuple[float, Trajectory | str, Trajectory | str]:
    """Its tolerance; the motion itself, and one beside it, or why there is none."""
    why = ""
    for tolerance, looser in pairwise(REFERENCES):
        both = []
        for accuracy in (tolerance, looser):
            x = motion(solver, Setting(end, names, method, accuracy))
            if isinstance(x, str) or x.ended != FINISHED:
                why = x if isinstance(x, str) else str(x.stats["reason"])
                break
            both.append(x)
        else:
            return tolerance, both[0], both[1]
    return tolerance, why, why


def _errors(x: Trajectory, exact: Trajectory, values: Array) -> tuple[float, float]:
    """Relative errors at the end: of the state, its coordinates and speeds apart, and of the worst derivative.

    Derivatives that vanish but for rounding have errors in parts of what changes the state by as much as itself; `values` are
    those of what they are by.
    """

    pairs = [(x.q, exact.q, x.dq, exact.dq), (x.u, exact.u, x.du, exact.du)]
    largest = [float(np.max(np.abs(b), initial=0.0)) or 1.0 for _, b, _, _ in pairs]  # along the whole motion
    state = max(relative(a[-1], b[-1], n) for (a, b, _, _), n in zip(pairs, largest, strict=True))
    rows = [
        relative(da[i, -1], db[i, -1], size)
        for (_, _, da, db), n in zip(pairs, largest, strict=True)
        for i, size in enumerate(natural_sizes(n, values))
    ]
    return state, max(rows, default=0.0)


def _values(solver: Solver, names: Sequence[str]) -> Array:
    return np.array([solver.parameters[solver.parameter_names.index(name)] for name in names])


def _point(solver: Solver, s: Setting, best: Trajectory, core: Core) -> dict[str, Any] | str:
    """One point of a diagram; or why the motion did not come to its end."""
    x, turn = timed(solver, s, core)
    if isinstance(x, str):
        return x
    if x.ended != FINISHED:
        return f"it ended at {x.stats['t']:.4g} of {best.t[-1]:g} s: {x.stats['reason']}"
    error, sensitivity_error = _errors(x, best, _values(solver, s.names))
    return {
        "setting": s.end / s.steps if s.steps else s.tolerance, "error": error,
        "sensitivity_error": sensitivity_error if s.names else None, "evaluations": int(x.stats["evaluations"]),
        "operations": _cost(solver, x, s.names), **asdict(turn),
    }  # fmt: skip


def _cost(solver: Solver, x: Trajectory, names: Sequence[str]) -> float:
    """Operations of a motion: those of its evaluations, and of Jacobians and factors of an implicit method."""
    found = float(x.stats["evaluations"]) * evaluation(solver, names)
    if "factorizations" in x.stats:
        found += float(x.stats["jacobians"]) * operations(solver, "sensitivities", solver.nq + solver.nu)
        found += float(x.stats["factorizations"]) * _factoring(solver)
    return found


def _factoring(solver: Solver) -> float:
    """Operations of an implicit method's factors, of one real matrix and one complex."""
    return 10 / 3 * float(solver.nu) ** 3


def _adaptive(
    solver: Solver, end: float, names: Sequence[str], method: str, exponents: Sequence[int], best: Trajectory,
    skipped: list[Skipped], core: Core,
) -> list[dict[str, Any]]:  # fmt: skip
    points: list[dict[str, Any]] = []
    for i, e in enumerate(exponents):
        point = _point(solver, Setting(end, names, method, 10.0**-e), best, core)
        if isinstance(point, str):
            skipped.append(Skipped(f"a motion by {method} at the tolerance {10.0**-e:.0e}", point))
            continue
        points.append(point)
        if point["operations"] > COSTLIEST and (left := len(exponents) - i - 1):
            tenth = 10 ** (1 / ORDERS[method])  # so much longer a motion takes for a tenth of the error
            seconds = ROUNDS * point["seconds"] * sum(tenth**n for n in range(1, left + 1))
            why = f"one takes {point['operations']:.1g} operations, of {COSTLIEST:.1g} allowed"
            skipped.append(Skipped(f"motions by {method} at tolerances below {point['setting']:.0e}", why, seconds))
            break
    return points


def _fixed(solver: Solver, end: float, names: Sequence[str], best: Trajectory, core: Core) -> list[dict[str, Any]]:
    points: list[dict[str, Any]] = []
    for steps in FIXED:
        point = _point(solver, Setting(end, names, "rk4", FIXED_TOLERANCE, steps), best, core)
        if not isinstance(point, str) and np.isfinite(point["error"]) and point["error"] < 1:
            points.append(point)
            if 2 * point["operations"] > COSTLIEST:  # the next takes twice as many
                break
    return points


def conditions(solver: Solver, end: float, method: str, skipped: list[Skipped]) -> dict[str, Any] | None:
    """Conditions along the motion, as `Solver.diagnose` has them: of the closures, the worst, and of the mass matrix.

    Returns
    -------
    dict
        ``t`` and, where there are any, ``closures`` and ``mass_matrix``: a number for each time, at least 1.
    """
    x = motion(solver, Setting(end, (), method, 1e-9), times=np.linspace(0.0, end, SAMPLES))
    if isinstance(x, str):
        return None
    if solver.nu > LARGEST_MATRIX:
        why = f"mass matrices of {solver.nu} columns, of {LARGEST_MATRIX} allowed"
        skipped.append(Skipped("conditions along the motion", why, _seconds_of_condition(solver.nu) * SAMPLES))
        return None
    along = [solver.diagnose(q, u, t=t, derivatives=False) for q, u, t in zip(x.q, x.u, x.t, strict=True)]
    found: dict[str, Any] = {"t": x.t.tolist()}
    if solver.closure_names:
        found["closures"] = [max((c.condition for c in d.closures), default=1.0) for d in along]
    if all(d.mass is not None for d in along):
        found["mass_matrix"] = [d.mass.condition for d in along if d.mass is not None]
    return found if len(found) > 1 else None


def _seconds_of_condition(columns: int) -> float:
    """Of a large matrix, by the singular values of a smaller one, which take the cube of its size."""
    matrix = np.random.default_rng(0).normal(size=(LARGEST_MATRIX, LARGEST_MATRIX))
    run = elapsed(lambda: np.linalg.svd(matrix, compute_uv=False), clock=time.thread_time)
    return in_rounds({"": run}, 3)[""].least * (columns / LARGEST_MATRIX) ** 3
