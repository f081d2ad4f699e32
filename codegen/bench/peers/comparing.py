"""Problems that other programs also solve: one run measures all programs in turn."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...measure.clock import alternate, elapsed
from ...measure.models import chain_state
from ..measuring import generated
from ..problem import Motion, Problem, Setting, tolerances
from ..problems.motions import CHAIN_MOTION, FLYBALL, RODS
from ..work_precision import integrate
from . import programs
from .programs import Contestant, Ends

NEEDED = {"CasADi": "casadi", "Pinocchio": "pinocchio", "MuJoCo": "mujoco", "SciPy": "scipy"}
"""The other programs, each with the modules that it needs."""

TREES = ("flyball", "chain_motion")
"""Motions that other programs compute."""


def compare_with_peers(
    problems: Sequence[Problem], folder: Path, quick: bool, progress: Callable[[str, int, int], object]
) -> dict[str, Any]:
    """Times and errors of all installed programs.

    Returns
    -------
    dict
        "skipped": reasons by program; "problems": a list of rows by problem.
    """
    there = {who for who, module in NEEDED.items() if importlib.util.find_spec(module) is not None}
    skipped = {
        who: f"{module} is not installed (pip install ordernm[peers])"
        for who, module in NEEDED.items()
        if who not in there
    }
    found: dict[str, Any] = {}
    for problem in problems:
        if isinstance(problem, Motion) and problem.name in TREES:
            progress(f"{problem.name}: other programs", 0, 0)
            everyone = contestants(problem, folder / "peers", there)
            found[problem.name] = rows(problem, everyone[::2] if quick else everyone, 0.05 if quick else 0.2)
    return {"skipped": skipped, "problems": found}


def contestants(problem: Motion, folder: Path, there: set[str]) -> list[Contestant]:
    """The contestants of a problem: ordernm and all installed programs."""
    solver, _ = generated(problem.text(), problem.name, folder, ("motion", "jacobians"))

    def ours(setting: Setting) -> Contestant:
        def run() -> Ends:
            x = integrate(solver, problem.end, setting, dict(problem.start), problem.sensitivities)
            values = [float(x[name][-1]) for name in problem.quantities]
            if not problem.sensitivities:
                return values, None
            return values, [
                [float(x.derivative(n, by)[-1]) for n in problem.quantities] for by in problem.sensitivities
            ]

        return Contestant("ordernm, from Python", str(setting), run)

    stiff = problem is FLYBALL
    settings = (
        tolerances("radau", 6, 8) if stiff else tuple(Setting("dop853", 10.0**-e, 10.0**-e) for e in (6, 8, 10, 12))
    )
    everyone = [ours(setting) for setting in settings]
    if "SciPy" in there:
        everyone += programs.scipy(problem, solver, stiff)
    if problem is CHAIN_MOTION:
        state = chain_state(RODS)
        for who, program in (
            ("CasADi", programs.casadi),
            ("Pinocchio", programs.pinocchio),
            ("MuJoCo", programs.mujoco),
        ):
            if who in there:
                everyone += program(problem, RODS, *state)
    return everyone


def rows(problem: Motion, everyone: Sequence[Contestant], budget: float) -> list[dict[str, Any]]:
    """The error, the error of derivatives and the least CPU time of each program, called from Python."""
    exact = problem.exact()
    found = []
    for c in everyone:
        values, derivatives = c.run()
        error = max(abs(a - b) for a, b in zip(values, exact, strict=True))
        found.append({"who": c.who, "setting": c.setting, "error": error, "error_derivatives": None})
        if derivatives is not None and problem.derivatives is not None:
            pairs = zip(derivatives, problem.derivatives(), strict=True)
            found[-1]["error_derivatives"] = max(max(abs(a - b) for a, b in zip(*p, strict=True)) for p in pairs)
    times = alternate(
        {str(i): elapsed(c.run, clock=time.thread_time) for i, c in enumerate(everyone)}, budget, least_turns=2
    )
    return [row | {"seconds": times[str(i)].least} for i, row in enumerate(found)]
