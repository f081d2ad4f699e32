"""What a call from Python costs above the C function: CHAIN(n), one state, both ways of cffi; against pin.aba from Python.

The time of the Python call minus that of the same C function called in a C loop (its batch function over one state again and
again), measured in turns in one process on one core; the fastest of many. Pinocchio's rows are left out where it is not
installed.

    python benchmarks/python_overhead.py [n] [rounds]
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from chains import chain_model, chain_seeds, chain_state
from ctiming import use_one_core

import codegen

LOOP = 200


def contestants(solver: Any, mode: str, n: int) -> dict[str, tuple[Callable[[], Any], Callable[[], Any] | None]]:
    """By name: what is called from Python, and what loops over its C function."""
    q, u = chain_state(n)
    p = solver.parameters
    dq, du, dp = chain_seeds(n)
    dq_1, du_1, dp_1 = dq[0], du[0], dp[0]
    result, lists = np.empty(n), (q.tolist(), u.tolist())
    target = solver._target
    functions = solver._functions

    def loop(name: str, width: int = 0, seeds: Any = ()) -> Callable[[], Any]:
        f = functions[name]
        lanes = [np.ascontiguousarray(s[:width].T) for s in seeds]
        results = [
            np.empty((LOOP, math.prod(s) * (width if d else 1))) for s, d in zip(f.shapes, f.derived, strict=True)
        ]
        given = [(target.pointer(x), 0) for x in (q, u, p, *lanes)]
        return lambda: target.batches.rows(f, width, given, results, LOOP)

    return {
        f"{mode}: accelerations(q, u)": (lambda: solver.accelerations(q, u), loop("accelerations")),
        f"{mode}: accelerations(q, u, p)": (lambda: solver.accelerations(q, u, p), loop("accelerations")),
        f"{mode}: accelerations(..., out=)": (lambda: solver.accelerations(q, u, p, out=result), loop("accelerations")),
        f"{mode}: sensitivities, 1 direction": (
            lambda: solver.sensitivities(q, u, p, dq=dq_1, du=du_1, dp=dp_1),
            loop("sensitivities", 1, (dq, du, dp)),
        ),
        f"{mode}: sensitivities, 8 directions": (
            lambda: solver.sensitivities(q, u, p, dq=dq, du=du, dp=dp),
            loop("sensitivities", 8, (dq, du, dp)),
        ),
        f"{mode}: jacobians": (lambda: solver.jacobians(q, u, p), loop("jacobians")),
        f"{mode}: coordinate_rates": (lambda: solver.coordinate_rates(q, u, p), None),
        f"{mode}: accelerations(lists)": (lambda: solver.accelerations(lists[0], lists[1]), None),
    }


def pinocchio(n: int) -> dict[str, tuple[Callable[[], Any], Callable[[], Any] | None]]:
    """The same chain at L = 1 in Pinocchio, if it is there; its accelerations must agree."""
    try:
        import pinocchio as pin
    except ImportError:
        return {}
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.81])
    across, along = 0.05**2 / 4 + 1 / 12, 0.05**2 / 2
    parent = 0
    for k in range(1, n + 1):
        joint = pin.JointModelRX() if k % 2 == 0 else pin.JointModelRY()
        place = pin.SE3(np.eye(3), np.array([0, 0, -1.0 if k > 1 else 0.0]))
        parent = model.addJoint(parent, joint, place, f"j{k}")
        inertia = pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([across, across, along]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    data = model.createData()
    q, u = chain_state(n)
    tau = np.zeros(n)
    return {
        "pin.aba": (lambda: pin.aba(model, data, q, u, tau), None),
        "pin.computeABADerivatives": (lambda: pin.computeABADerivatives(model, data, q, u, tau), None),
    }


def fastest(call: Callable[[], Any], repetitions: int) -> float:
    """Seconds of one of so many calls."""
    clock = time.perf_counter
    start = clock()
    for _ in range(repetitions):
        call()
    return (clock() - start) / repetitions


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    use_one_core()
    folder = Path(tempfile.mkdtemp()) / "chain"
    codegen.generate(chain_model(n), folder)
    all_of_them: dict[str, Any] = {}
    solvers = []
    for mode in ("api", "abi"):
        os.environ["ORDERNM_CFFI"] = mode
        solvers.append(codegen.load(folder))
        all_of_them |= contestants(solvers[-1], mode, n)
    theirs = pinocchio(n)
    if theirs:
        found, expected = solvers[0].accelerations(*chain_state(n)), theirs["pin.aba"][0]()
        assert np.max(np.abs(found - expected)) < 1e-11 * np.max(np.abs(expected))
    all_of_them |= theirs
    python = dict.fromkeys(all_of_them, math.inf)
    c = dict.fromkeys(all_of_them, math.inf)
    for _ in range(rounds):
        for name, (call, loop) in all_of_them.items():
            python[name] = min(python[name], fastest(call, 500))
            if loop is not None:
                c[name] = min(c[name], fastest(loop, 3) / LOOP)
    print(f"CHAIN({n}), microseconds; Python {sys.version.split()[0]}, NumPy {np.__version__}")
    print(f"{'':40s} {'Python':>8s} {'C':>8s} {'above C':>8s}" + ("  of pin.aba" if theirs else ""))
    for name in all_of_them:
        line = f"{name:40s} {1e6 * python[name]:8.2f}"
        line += f" {1e6 * c[name]:8.2f} {1e6 * (python[name] - c[name]):8.2f}" if c[name] < math.inf else 18 * " "
        if theirs:
            line += f" {python[name] / python['pin.aba']:11.2f}"
        print(line)


if __name__ == "__main__":
    main()
