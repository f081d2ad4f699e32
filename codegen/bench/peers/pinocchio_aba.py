"""Pinocchio's articulated-body algorithm on the chain, integrated by SciPy's DOP853: what a Python user of it would write."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from ..problem import Motion
from .contestant import Contestant, Ends

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)


def contestants(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """The chain of n rods, 1 kg/m, 1 m and radius 5 cm, hinges about y, x, y, ..., from a state."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    mass, length, radius = 1.0, 1.0, 0.05
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    rod = pin.Inertia(mass, np.array([0.0, 0.0, -length / 2]), np.diag([across, across, along]))
    last = 0
    for k in range(n):
        joint = pin.JointModelRX() if k % 2 else pin.JointModelRY()
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length if k else 0.0]))
        last = model.addJoint(last, joint, place, f"hinge{k}")
        model.appendBodyToJoint(last, rod, pin.SE3.Identity())
    data, force = model.createData(), np.zeros(n)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], pin.aba(model, data, y[:n], y[n:], force)])

    found = []
    for tolerance in TOLERANCES:

        def run(tolerance: float = tolerance) -> Ends:
            start = np.concatenate([q, u])
            y = solve_ivp(rates, (0.0, problem.end), start, method="DOP853", rtol=tolerance, atol=tolerance).y
            return y[:n, -1].tolist(), None

        found.append(Contestant("Pinocchio, SciPy", f"aba, DOP853 {tolerance:.0e}", run))
    return found
