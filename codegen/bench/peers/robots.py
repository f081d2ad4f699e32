"""Accelerations, Jacobians, mass matrices and their inverses of robots, and accelerations of batches of states. ordernm and
Pinocchio compute them alternately, both called from Python."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ... import generation
from ...measure import pinocchio_models
from ...measure.clock import alternate, calibrated
from ...measure.pinocchio_models import State
from ...runtime import load
from ..problem import Array, Robots

FUNCTIONS = ("accelerations", "jacobians", "mass_matrix", "inverse_mass_matrix")
STATES = 1024
"""Number of states in the batch."""

Call = Callable[[], Any]


def measure_robots(
    problem: Robots, folder: Path, quick: bool, progress: Callable[[str], None], budget: float
) -> dict[str, Any]:
    """Errors and times of every robot whose file can be read, and the reason for each robot that was not measured."""
    rows: list[dict[str, Any]] = []
    skipped: dict[str, str] = {}
    there = importlib.util.find_spec("pinocchio") is not None
    robots = pinocchio_models.robots_folder()
    for name in problem.quick if quick else problem.models:
        if not there:
            skipped[name] = "pinocchio is not installed (pip install ordernm[peers])"
        elif name in pinocchio_models.ROBOTS and not (robots / pinocchio_models.ROBOTS[name].file).is_file():
            skipped[name] = f"{pinocchio_models.ROBOTS[name].file} is not there (pip install example-robot-data)"
        else:
            rows.append(_robot(name, robots, folder, progress, budget))
    return {
        "kind": "robots", "title": problem.title, "source": problem.source, "within": problem.within, "rows": rows,
        "skipped": skipped, "failed": [r["model"] for r in rows if not r["error"] <= problem.within],
    }  # fmt: skip


def _robot(name: str, robots: Path, folder: Path, progress: Callable[[str], None], budget: float) -> dict[str, Any]:
    progress(f"robots, {name}: generating")
    theirs = pinocchio_models.theirs_of(name, robots)
    model = pinocchio_models.ours(theirs, name)
    start = time.perf_counter()
    generation.generate(model, folder / model.name, functions=FUNCTIONS)
    solver, seconds = load(folder / model.name), time.perf_counter() - start
    state = pinocchio_models.usual_state(theirs)
    ours, peers = _ours(solver, state), _theirs(theirs, state)
    progress(f"robots, {name}: timing")
    error = _difference(ours, peers, state)
    calls = {(what, "seconds"): f for what, f in ours.items()} | {(what, "theirs"): f for what, f in peers.items()}
    times = alternate({" ".join(key): calibrated(f) for key, f in calls.items()}, budget)
    row: dict[str, Any] = {
        "model": name, "speeds": theirs.nv, "error": error, "generation_seconds": seconds, "seconds": {}, "theirs": {},
    }  # fmt: skip
    for what, who in calls:
        states = STATES if what == BATCH else 1
        row[who][what] = times[f"{what} {who}"].least / states
    return row


UDOT, JACOBIANS, MASS, INVERSE, BATCH = "udot", "Jacobians", "M", "M^-1", "udot of a batch"


def _ours(solver: Any, state: State) -> dict[str, Call]:
    q, u = state.ours
    many_q, many_u = np.tile(q, (STATES, 1)), np.tile(u, (STATES, 1))
    return {
        UDOT: lambda: solver.accelerations(q, u),
        JACOBIANS: lambda: solver.jacobians(q, u, wrt="q, u, inputs"),
        MASS: lambda: solver.mass_matrix(q),
        INVERSE: lambda: solver.inverse_mass_matrix(q),
        BATCH: lambda: solver.accelerations(many_q, many_u),
    }


def _theirs(model: Any, state: State) -> dict[str, Call]:
    import pinocchio as pin

    q, u = state.theirs
    data, force = model.createData(), np.zeros(model.nv)

    def derivatives() -> tuple[Array, Array, Array]:
        pin.computeABADerivatives(model, data, q, u, force)
        return data.ddq_dq, data.ddq_dv, data.Minv

    def batch() -> Array:
        found = np.empty((STATES, model.nv))
        for row in found:
            row[:] = pin.aba(model, data, q, u, force)
        return found

    return {
        UDOT: lambda: pin.aba(model, data, q, u, force),
        JACOBIANS: derivatives,
        MASS: lambda: pin.crba(model, data, q),
        INVERSE: lambda: pin.computeMinverse(model, data, q),
        BATCH: batch,
    }


def _difference(ours: dict[str, Call], theirs: dict[str, Call], state: State) -> float:
    """The largest relative difference of all computed quantities; symmetric matrices are compared in their upper
    half."""
    order, square = state.order, np.ix_(state.order, state.order)
    J = ours[JACOBIANS]()
    by_q, by_u, inverse = (np.array(x) for x in theirs[JACOBIANS]())
    pairs = [
        (ours[UDOT]()[order], theirs[UDOT]()), (ours[BATCH]()[:, order], theirs[BATCH]()),
        ((J.q @ state.rates)[square], by_q), (J.u[square], by_u),
        *((np.triu(mine[square]), np.triu(np.array(other))) for mine, other in (
            (J.inputs, inverse), (ours[MASS](), theirs[MASS]()), (ours[INVERSE](), theirs[INVERSE]()))),
    ]  # fmt: skip
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)
