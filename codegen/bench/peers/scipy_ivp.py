"""SciPy's integrators on trees, with our compiled accelerations called from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp

from ..problem import Motion
from .contestant import Contestant, Ends

if TYPE_CHECKING:
    from ...runtime import Solver

METHODS = (("DOP853", (1e-6, 1e-8, 1e-10, 1e-12)), ("Radau", (1e-6,)))


def contestants(problem: Motion, solver: Solver, stiff: bool) -> list[Contestant]:
    """Its explicit method, or, for stiff models, its implicit one with our exact Jacobians."""
    q, u = solver.initial
    if problem.start:
        q, _ = solver.assemble(dict(problem.start))
    n, start = solver.nq, np.concatenate([q, u])
    method, tolerances = METHODS[stiff]

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], solver.accelerations(y[:n], y[n:])])

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        J = solver.jacobians(y[:n], y[n:])
        return np.block([[np.zeros((n, n)), np.eye(n)], [J.q, J.u]])

    def at_end(y: np.ndarray) -> list[float]:
        names = [f"q.{x}" for x in solver.coordinate_names] + [f"u.{x}" for x in solver.speed_names]
        values = dict(zip(names, y, strict=True))
        if solver.output_names:
            values |= dict(zip(solver.output_names, solver.outputs(y[:n], y[n:]), strict=True))
        return [float(values[name]) for name in problem.quantities]

    found = []
    for tolerance in tolerances:

        def run(tolerance: float = tolerance) -> Ends:
            more = {"jac": jacobian} if stiff else {}
            y = solve_ivp(rates, (0.0, problem.end), start, method=method, rtol=tolerance, atol=tolerance, **more).y
            return at_end(y[:, -1]), None

        found.append(Contestant("SciPy, our accelerations", f"{method} {tolerance:.0e}", run))
    return found
