"""Motions: work-precision diagrams of every integrator, for state and sensitivities, and conditions along a motion."""

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
"""Default duration of the motions, s."""

ADAPTIVE = {"dop853": range(4, 13), "radau": range(4, 11)}
"""Exponents e of the tolerances 10^-e at which the adaptive methods run."""

ORDERS = {"dop853": 8, "radau": 5}

REFERENCES = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9)
"""Tolerances tried for the reference motion; the first that reaches the final time is used. With large angles and speeds the
last digits cannot be computed. The error of the reference is estimated with the next tolerance."""

LOST, LEAST = 1e-3, 1e-3
"""If the reference is less accurate than this, as for a chaotic motion, the final time is halved, down to this fraction of the
requested time."""

EXACT = 1e-11
"""Error below which a motion at the loosest tolerance is exact except for rounding."""

FACTORS = 20
"""A motion by an implicit method takes at least this many factorisations; if they cost too much, it is left out."""

MOTIONS = len(FIXED) + sum(map(len, ADAPTIVE.values()))
"""Number of settings of all methods in a diagram."""

LONGEST = 0.75 * COSTLIEST
"""Largest number of operations of a motion at a tolerance of 1e-6; if it is exceeded, the final time is reduced."""

MOST_SENSITIVITIES = 4

SAMPLES = 101
"""Number of times along a motion at which conditions are computed."""

LARGEST_MATRIX = 300
"""Largest number of speeds for which conditions of mass matrices are computed."""


def motions(
    model: Model, solver: Solver, end: float, skipped: list[Skipped], remade: Callable[[int], Solver], core: Core
) -> dict[str, Any] | None:
    """Work-precision diagrams, and conditions along the motion; None if the model does not move.

    Parameters
    ----------
    remade : callable
        Returns a solver with the given number of choices of independent coordinates, for motions through dead points.
    core : Core
        Fixed work that is timed beside motions.

    Returns
    -------
    dict
        ``end``; ``choices`` of independent coordinates; ``ended``, the reason for a shorter motion than requested;
        names of the ``sensitivities``; ``reference_error`` and ``reference_error_sensitivities``; ``methods``: lists of
        points with ``setting``, ``error``, ``sensitivity_error``, ``evaluations``, ``operations``, ``seconds``, and the
        times ``core`` and ``cache`` of the fixed work; ``conditions``, see `conditions`.
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
    reached = float(probe.stats["t"])  # the end of the motion, which need not be an output time
    found: dict[str, Any] = {"asked": end, "choices": choices, "sensitivities": names}
    if probe.ended != FINISHED:
        found["ended"] = str(probe.stats["reason"])
        end = float(f"{0.8 * reached:.2g}")
        if not end > 0:
            skipped.append(Skipped("motions", found["ended"]))
            return None
    implicit = FACTORS * _factoring(solver) <= COSTLIEST
    stiff = implicit and _cost(solver, probe, names) > LONGEST
    if stiff:  # an explicit method needs too many steps, so the reference is by the implicit method
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
        why = "every method integrates this motion exactly, like one at constant acceleration, so the errors are only rounding"
        skipped.append(Skipped("work and precision", why))
        found["methods"] = {}
    found["conditions"] = conditions(solver, end, method, skipped)
    return found


def _known(
    solver: Solver, names: Sequence[str], method: str, end: float, found: dict[str, Any], skipped: list[Skipped]
) -> tuple[float, float, Trajectory] | None:
    """The final time, s, up to which a motion is accurate; the tolerance of the reference; and the reference motion.
    None if there is no such motion."""
    while True:
        reference, best, beside = _reference(solver, end, names, method)
        if isinstance(best, str) or isinstance(beside, str):
            skipped.append(Skipped("motions", next(x for x in (best, beside) if isinstance(x, str))))
            return None
        own_errors = _errors(beside, best, _values(solver, names))
        if max(own_errors) <= LOST or end < LEAST * found["asked"]:
            break
        found["ended"] = (
            f"at {end:g} s, motions with tolerances of {reference:g} and {10 * reference:g} differ by "
            f"{max(own_errors):.1g} of their size"
        )
        end = float(f"{end / 2:.2g}")
    found |= {"end": end, "reference": f"{method} at {reference:g}"}
    found["reference_error"], found["reference_error_sensitivities"] = own_errors
    return end, reference, best


def _affordable_end(
    solver: Solver, probe: Trajectory | str, names: Sequence[str], end: float, skipped: list[Skipped]
) -> float:
    """Final time of the motions, s, from the operations of a probe."""
    cost = math.inf if isinstance(probe, str) else _cost(solver, probe, names)
    if cost <= LONGEST:
        return end
    shorter = float(f"{end * max(LONGEST / cost, 1e-4):.2g}")
    seconds = None if isinstance(probe, str) else float(probe.stats["seconds"]) * ROUNDS * MOTIONS
    why = "does not reach its end" if isinstance(probe, str) else f"takes {cost:.1g} operations"
    skipped.append(
        Skipped(
            f"motions beyond {shorter:g} s",
            f"a motion of {end:g} s {why}; the limit is {LONGEST:.1g} operations",
            seconds,
        )
    )
    return shorter


def _without_factors(solver: Solver, best: Trajectory, names: Sequence[str], settings: int) -> Skipped:
    """Records that the implicit method is left out because its matrix is too large."""
    rate = _cost(solver, best, names) / max(float(best.stats["seconds"]), 1e-9)
    seconds = FACTORS * _factoring(solver) / rate * ROUNDS * settings
    return Skipped("motions by an implicit method", f"it factorises matrices of {solver.nu} columns", seconds)


def _is_rounding(methods: dict[str, list[dict[str, Any]]]) -> bool:
    """Whether the errors of all methods are only rounding, even at the loosest settings; then they do not distinguish
    the methods."""
    points = [p for several in methods.values() for p in several]
    return bool(points) and all(max(p["error"], p["sensitivity_error"] or 0.0) < EXACT for p in points)


def sensitivities(model: Model) -> list[str]:
    """Names of the quantities with respect to which motions are differentiated."""
    return list(model.parameter_names[:MOST_SENSITIVITIES])


def settings(found: dict[str, Any]) -> list[tuple[dict[str, Any], Setting]]:
    """All points of the diagrams of `motions`, each with the setting that repeats its motion."""
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
    """The reference, its tolerance and a second, less accurate reference; or the reason why there is none."""
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
    """Relative errors at the end: of the state (the larger of coordinates and speeds), and of the worst derivative.

    Errors of derivatives that vanish except for rounding are relative to a natural size: with a derivative of that
    size, a change of a quantity by its own value (in `values`) would change the state by as much as the state itself.
    """

    pairs = [(x.q, exact.q, x.dq, exact.dq), (x.u, exact.u, x.du, exact.du)]
    largest = [float(np.max(np.abs(b), initial=0.0)) or 1.0 for _, b, _, _ in pairs]  # of the whole motion
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
    """One point of a diagram, or the reason why the motion did not reach its end."""
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
    """Operations of a motion: its evaluations, and for an implicit method the Jacobians and factorisations."""
    found = float(x.stats["evaluations"]) * evaluation(solver, names)
    if "factorizations" in x.stats:
        found += float(x.stats["jacobians"]) * operations(solver, "sensitivities", solver.nq + solver.nu)
        found += float(x.stats["factorizations"]) * _factoring(solver)
    return found


def _factoring(solver: Solver) -> float:
    """Operations of the factorisations of an implicit method, one real and one complex matrix each."""
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
            tenth = 10 ** (1 / ORDERS[method])  # ratio of times for a tenth of the error
            seconds = ROUNDS * point["seconds"] * sum(tenth**n for n in range(1, left + 1))
            why = f"a motion takes {point['operations']:.1g} operations; the limit is {COSTLIEST:.1g}"
            skipped.append(Skipped(f"motions by {method} at tolerances below {point['setting']:.0e}", why, seconds))
            break
    return points


def _fixed(solver: Solver, end: float, names: Sequence[str], best: Trajectory, core: Core) -> list[dict[str, Any]]:
    points: list[dict[str, Any]] = []
    for steps in FIXED:
        point = _point(solver, Setting(end, names, "rk4", FIXED_TOLERANCE, steps), best, core)
        if not isinstance(point, str) and np.isfinite(point["error"]) and point["error"] < 1:
            points.append(point)
            if 2 * point["operations"] > COSTLIEST:  # the next motion has twice as many steps
                break
    return points


def conditions(solver: Solver, end: float, method: str, skipped: list[Skipped]) -> dict[str, Any] | None:
    """Condition numbers along the motion by `Solver.diagnose`: the worst of the closures, and that of the mass matrix.

    Returns
    -------
    dict
        ``t`` and, if they exist, ``closures`` and ``mass_matrix``: a number for each time, at least 1.
    """
    x = motion(solver, Setting(end, (), method, 1e-9), times=np.linspace(0.0, end, SAMPLES))
    if isinstance(x, str):
        return None
    if solver.nu > LARGEST_MATRIX:
        why = f"the mass matrix has {solver.nu} columns; the limit is {LARGEST_MATRIX}"
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
    """Estimated seconds for the singular values of a large matrix, from the time for a smaller one, which is
    scaled with the cube of the size."""
    matrix = np.random.default_rng(0).normal(size=(LARGEST_MATRIX, LARGEST_MATRIX))
    run = elapsed(lambda: np.linalg.svd(matrix, compute_uv=False), clock=time.thread_time)
    return in_rounds({"": run}, 3)[""].least * (columns / LARGEST_MATRIX) ** 3
