"""Measures one problem: generates its solver, compares it with the reference, counts operations and measures times."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .. import generation
from ..measure import accuracy
from ..measure.clock import alternate, repeated
from ..measure.compiled import Functions, Workshop
from ..measure.motions import timed
from ..measure.operations import point, total
from ..model import parse_model
from ..runtime import Solver, load
from .peers.robots import measure_robots
from .problem import Array, Evaluation, Family, Goal, Motion, Problem, Robots, Setting
from .work_precision import Point, best, diagram, error_at_end, integrate

BATCH = 1e-3
"""Approximate duration of one measurement in C, s."""

Progress = Callable[[str], None]
Result = dict[str, Any]

WIDTH = 8
"""Number of directions at which functions over directions are timed."""


def measure(problem: Problem, folder: Path, quick: bool, progress: Progress, budget: float = 0.3) -> Result:
    """Measure a problem; returns the entry for the JSON file.

    Parameters
    ----------
    problem : Motion, Family or Robots
    folder : Path
        For generated packages.
    quick : bool
        Measure only the cheap part.
    progress : callable
        Called with a description of the current step.
    budget : float
        Approximate seconds of timing for each figure.
    """
    if isinstance(problem, Motion):
        return _motion(problem, folder, quick, progress, budget)
    if isinstance(problem, Robots):
        return measure_robots(problem, folder, quick, progress, budget)
    return _family(problem, folder, quick, progress, budget)


def generated(text: str, name: str, folder: Path, functions: Sequence[str]) -> tuple[Solver, float]:
    """A solver and the seconds that generating and compiling it took."""
    start = time.perf_counter()
    generation.generate(parse_model(text, name), folder / name, functions=functions)
    return load(folder / name), time.perf_counter() - start


# -- motions ---------------------------------------------------------------------------------------------------------------


def _motion(problem: Motion, folder: Path, quick: bool, progress: Progress, budget: float) -> Result:
    progress(f"{problem.name}: generating")
    solver, seconds = generated(problem.text(), problem.name, folder, ("motion",))
    exact, start = problem.exact(), dict(problem.start)
    progress(f"{problem.name}: integrating")
    points = diagram(
        solver, problem.end, problem.quick if quick else problem.settings,
        lambda x: error_at_end(x, problem.end, problem.quantities, exact), start, budget=budget,
    )  # fmt: skip
    result: Result = {
        "kind": "motion", "title": problem.title, "source": problem.source, "end": problem.end,
        "quantities": list(problem.quantities), "generation_seconds": seconds,
        "operations": total(solver.operations["accelerations"]), "points": [point_record(p) for p in points],
    }  # fmt: skip
    if quick:
        result["within"] = problem.within
        result["failed"] = [str(p.setting) for p in points if not p.error <= problem.within]
    else:
        result["goals"] = [_goal(goal, points) for goal in problem.goals]
        result["failed"] = [g["goal"] for g in result["goals"] if not g["met"] and not g["slow"]]
    if problem.derivatives is not None:
        result["derivatives"] = _derivatives(problem, solver, start, quick)
        if not result["derivatives"]["error"] <= result["derivatives"]["within"]:
            result["failed"].append("derivatives")
    return result


def point_record(p: Point) -> Result:
    """The record of a point as it is written to JSON."""
    found = asdict(p)
    return found.pop("setting") | found | {"error": p.error if math.isfinite(p.error) else None}


def _goal(goal: Goal, points: Sequence[Point]) -> Result:
    """Whether a goal is met, and the best setting that meets it: the one with the fewest evaluations or, if the goal
    limits time, the fastest."""
    found = best(points, goal.error, "evaluations" if goal.seconds is None else "seconds")
    slow = found is not None and goal.seconds is not None and found.seconds >= goal.seconds
    costly = found is not None and goal.evaluations is not None and found.evaluations >= goal.evaluations
    return {
        "goal": str(goal), "met": found is not None and not slow and not costly, "slow": slow,
        "reached": None if found is None else point_record(found),
    }  # fmt: skip


TIGHT, LOOSE = Setting("dop853", 1e-12, 1e-12), Setting("dop853", 1e-9, 1e-9)


def _derivatives(problem: Motion, solver: Solver, start: dict[str, float], quick: bool) -> Result:
    """Errors of derivatives of the final state: for each parameter, the largest error over the largest exact
    derivative."""
    assert problem.derivatives is not None
    setting = LOOSE if quick else TIGHT
    x, seconds = timed(lambda: integrate(solver, problem.end, setting, start, problem.sensitivities))
    found = [[x.derivative(name, by)[-1] for name in problem.quantities] for by in problem.sensitivities]
    errors = accuracy.by_direction(found, problem.derivatives())
    return {
        "by": list(problem.sensitivities), "setting": str(setting), "error": max(errors), "within": 1e-4 if quick else 1e-8,
        "evaluations": x.stats["evaluations"], "seconds": seconds,
    }  # fmt: skip


# -- families --------------------------------------------------------------------------------------------------------------


def _family(problem: Family, folder: Path, quick: bool, progress: Progress, budget: float) -> Result:
    rows = []
    for size in problem.quick if quick else problem.sizes:
        progress(f"{problem.name} {size}: generating")
        evaluation = problem.make(size)
        rows.append(_evaluation(evaluation, f"{problem.name}_{size}", folder, progress, budget) | {"size": size})
    return {
        "kind": "family", "title": problem.title, "source": problem.source, "unit": problem.unit, "within": problem.within,
        "sizes": rows, "failed": [f"{row['size']} {problem.unit}" for row in rows if _is_off(row["error"], problem.within)],
    }  # fmt: skip


def _is_off(error: float | None, within: float) -> bool:
    return error is not None and not error <= within


def _evaluation(x: Evaluation, name: str, folder: Path, progress: Progress, budget: float) -> Result:
    solver, seconds = generated(x.text, name, folder, ("accelerations", "sensitivities"))
    first = solver.initial
    q, u = first[0] if x.q is None else x.q, first[1] if x.u is None else x.u
    udot, dudot = solver.sensitivities(q, u, dq=x.dq, du=x.du, dp=x.dp)
    result: Result = {
        "bodies": int(solver.nu), "generation_seconds": seconds, "operations": total(solver.operations["accelerations"]),
        "operations_direction": total(solver.operations["sensitivities"], "per_direction"), "error": None, "errors": None,
    }  # fmt: skip
    if x.reference is not None:
        progress(f"{name}: computing the reference in extended precision")
        start = time.perf_counter()
        exact = x.reference()
        errors = accuracy.by_direction([udot, *dudot[: len(exact.dudot)]], [exact.udot, *exact.dudot])
        labels = ["udot", *(x.directions or [f"direction {i + 1}" for i in range(len(errors) - 1)])]
        result |= {
            "error": max(errors), "errors": dict(zip(labels, errors, strict=True)),
            "reference_seconds": time.perf_counter() - start,
        }  # fmt: skip
    progress(f"{name}: timing")
    times = _times(solver, folder / name, q, u, x, budget)
    functions = zip(times.items(), (("accelerations", 0), ("sensitivities", WIDTH)), strict=True)
    roofline = [point(solver, label, function, k, seconds) for (label, seconds), (function, k) in functions]
    return result | {"seconds": times, "roofline": roofline}


def _times(solver: Solver, package: Path, q: Array, u: Array, x: Evaluation, budget: float) -> dict[str, float]:
    """Times of one evaluation in C, s: of udot, and of udot with eight directions (the problem's directions,
    repeated)."""
    functions, workshop = Functions.of_package(package), Workshop.of_packages(package.parent)
    given = {"q": q, "u": u, "p": np.array(solver.parameters, float)}
    seeds = {n: np.resize(d, (WIDTH, d.shape[1])) for n, d in (("dq", x.dq), ("du", x.du), ("dp", x.dp))}
    contestants = [
        functions.contestant("accelerations", given, name="udot"),
        functions.contestant("sensitivities", given | seeds, WIDTH, name=f"udot + {WIDTH}"),
    ]
    turns = {c.name: repeated(workshop.compiled(c, "-O2").seconds, BATCH, warm_up=True) for c in contestants}
    return {name: s.least for name, s in alternate(turns, budget).items()}
