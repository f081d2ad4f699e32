"""A robot with a controller at 1 kHz: a loop in Python over `accelerations`, beside ``simulate(controller=)``; equal motions.

The robot is the UR5 of the package example-robot-data, each joint with a motor. The controller is a PD law for the
accelerations, and `inverse_dynamics` gives the torques; both contestants call it. The loop makes a classical Runge-Kutta
step for each sample. So does `simulate` with the method "rk4", and the motions are equal to rounding. The other contestants
are the adaptive method, the motion with derivatives by two initial values through the controller, and the controller alone.
Times per sample are those of the fastest of several rounds, in turns.

    pip install example-robot-data
    python benchmarks/controller.py [--seconds 1.0] [--rounds 7]
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np

import codegen
from codegen.measure.clock import elapsed, in_rounds, one_core

PERIOD = 1e-3
STIFFNESS, DAMPING = 100.0, 20.0
GOAL = np.array([0.4, -0.9, 1.1, -0.3, 0.5, 0.2])
START = np.array([0.0, -0.5, 0.5, 0.0, 0.0, 0.0])


def robot(folder: Path) -> Any:
    """A solver of the UR5 with motors."""
    path = next(Path(f.locate()) for f in files("example-robot-data") or () if f.name == "ur5_robot.urdf")
    model = codegen.import_model(path, base="fixed", motors=True).model
    codegen.generate(model, folder / "ur5", check=False, force=True)
    return codegen.load(folder / "ur5")


class Law:
    """The controller: torques for accelerations that a PD law asks for, by inverse dynamics."""

    def __init__(self, solver: Any):
        self._solver = solver

    def torques(self, q: Any, u: Any, p: Any) -> Any:
        return self._solver.inverse_dynamics(q, u, STIFFNESS * (GOAL - q) - DAMPING * u, p)

    def __call__(self, sample: Any) -> Any:
        return self.torques(sample.q, sample.u, sample.p)

    def jacobian(self, sample: Any) -> Any:
        """Derivatives of the torques along the directions."""
        return self._solver.inverse_dynamics_sensitivities(
            sample.q, sample.u, STIFFNESS * (GOAL - sample.q) - DAMPING * sample.u, sample.p,
            dq=sample.dq, du=sample.du, dudot=-STIFFNESS * sample.dq - DAMPING * sample.du, dp=sample.dp,
        )[1]  # fmt: skip


def loop(solver: Any, law: Law, n: int) -> tuple[Any, Any]:
    """The motion by a loop in Python: classical Runge-Kutta steps with held torques."""
    q, u, h, p = START.copy(), np.zeros(solver.nu), PERIOD, solver.parameters
    f = solver.accelerations
    for _ in range(n):
        held = law.torques(q, u, p)
        a1 = f(q, u, p, held)
        q2, u2 = q + h / 2 * u, u + h / 2 * a1
        a2 = f(q2, u2, p, held)
        q3, u3 = q + h / 2 * u2, u + h / 2 * a2
        a3 = f(q3, u3, p, held)
        q4, u4 = q + h * u3, u + h * a3
        a4 = f(q4, u4, p, held)
        q, u = q + h / 6 * (u + 2 * (u2 + u3) + u4), u + h / 6 * (a1 + 2 * (a2 + a3) + a4)
    return q, u


def controlled(solver: Any, law: Law, seconds: float, **options: Any) -> Any:
    """The motion by `simulate`."""
    start = dict(zip(solver.coordinate_names, START, strict=True))
    return solver.simulate([0.0, seconds], start, controller=(law, law.jacobian), period=PERIOD, **options)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, one_core():
        solver = robot(Path(folder))
        law, n = Law(solver), round(given.seconds / PERIOD)
        fixed = {"method": "rk4", "step": PERIOD}
        q, u = loop(solver, law, n)
        run = controlled(solver, law, given.seconds, **fixed)
        apart = max(np.abs(run.q[-1] - q).max(), np.abs(run.u[-1] - u).max())
        print(f"UR5, {n} samples: largest difference of the states at the end {apart:.1e}")
        names = solver.parameter_names[:2] or tuple(f"q0.{name}" for name in solver.coordinate_names[:2])
        contestants = {
            "loop over accelerations": partial(loop, solver, law, n),
            "simulate, rk4": partial(controlled, solver, law, given.seconds, **fixed),
            "simulate, dop853": partial(controlled, solver, law, given.seconds),
            f"simulate, rk4, by {', '.join(names)}": partial(
                controlled, solver, law, given.seconds, sensitivities=names, **fixed
            ),
            "the controller alone": lambda: [law.torques(START, u, solver.parameters) for _ in range(n)],
        }
        found = in_rounds({name: elapsed(run) for name, run in contestants.items()}, given.rounds)
        for name, rounds in found.items():
            print(f"{name:40} {1e6 * rounds.least / n:8.2f} us per sample")


if __name__ == "__main__":
    main()
