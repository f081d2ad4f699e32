"""CHAIN(n) for 5 s with dq/dL: our integrator against CasADi with cvodes, time against error.

    python benchmarks/motion_against_casadi.py [--instructions avx2] [--rounds 15] [-n 4]

CasADi gets a hand-written articulated-body algorithm in SX scalars (articulated_chain.py) with its own derivative along L beside
it in one system, compiled by gcc -O3, and cvodes' Adams method, the best of its methods for this motion. Ours runs DOP853 with
state and derivative under error control. All begin at the same state and run alternately; the least time of the rounds counts.
Errors are those at 5 s, the largest of q and of dq/dL, against SciPy's DOP853 at 1e-13 on CasADi's function. The last table
says what the stepper costs beside the evaluations.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import articulated_chain
import casadi
import numpy as np
from chains import chain_model, chain_state
from ctiming import FLAGS, add_instructions, restrict_instructions, table, use_one_core
from scipy.integrate import solve_ivp

import codegen

END = 5.0
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
GOAL, TIGHT = 4e-9, 1e-12
"""The error of dq/dL at which both are compared, claimed at most 0.2; and the tolerance, claimed at most 0.25."""


def casadi_system(n: int) -> tuple[casadi.SX, casadi.SX, casadi.SX]:
    """States q, u and their derivatives by L; L; the time derivatives of the states."""
    q, u, sq, su = (casadi.SX.sym(name, n) for name in ("q", "u", "sq", "su"))
    L = casadi.SX.sym("L")
    parts = [q[i] for i in range(n)], [u[i] for i in range(n)]
    udot = casadi.vertcat(*articulated_chain.accelerations(*parts, L, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    dudot = casadi.jtimes(udot, casadi.vertcat(q, u, L), casadi.vertcat(sq, su, 1))
    return casadi.vertcat(q, u, sq, su), L, casadi.cse(casadi.vertcat(u, udot, su, dudot))


def cvodes(n: int, tolerance: float, system: tuple[casadi.SX, casadi.SX, casadi.SX]) -> casadi.Function:
    """CasADi's integrator, compiled."""
    z, L, rate = system
    flags = ["-O3", *(f for f in FLAGS if f.startswith("-m"))]
    options = {
        "abstol": tolerance, "reltol": tolerance, "max_num_steps": 1_000_000, "linear_multistep_method": "adams",
        "nonlinear_solver_iteration": "functional", "jit": True, "compiler": "shell", "jit_options": {"flags": flags},
        "jit_cleanup": False,
    }  # fmt: skip
    return casadi.integrator("motion", "cvodes", {"x": z, "p": L, "ode": rate}, 0, END, options)


def least(run: Callable[[], object], budget: float) -> float:
    """The least seconds of a run, of as many as fit into some time, three at least."""
    best, spent, runs = np.inf, 0.0, 0
    while runs < 3 or spent < budget:
        start = time.perf_counter()
        run()
        seconds = time.perf_counter() - start
        best, spent, runs = min(best, seconds), spent + seconds, runs + 1
    return float(best)


def at_error(times: np.ndarray, errors: np.ndarray, goal: float) -> float:
    """The time at which a curve of a work-precision diagram meets an error, by lines in logarithms; nan beyond its ends."""
    order = np.argsort(errors)
    x, y = np.log(errors[order]), np.log(times[order])
    if not x[0] <= np.log(goal) <= x[-1]:
        return float("nan")
    return float(np.exp(np.interp(np.log(goal), x, y)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_instructions(parser)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("-n", type=int, default=4)
    options = parser.parse_args()
    instructions = restrict_instructions(options.instructions)
    n = options.n
    os.environ["ORDERNM_CFLAGS"] = " ".join(["-O2", *(f for f in FLAGS if f.startswith("-m"))])
    use_one_core()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # what is compiled here has flags of its own
        os.chdir(folder)
        system = casadi_system(n)
        q0, u0 = chain_state(n)
        z0 = np.concatenate([q0, u0, np.zeros(2 * n)])
        function = casadi.Function("rates", [system[0], system[1]], [system[2]])
        found = solve_ivp(
            lambda t, z: np.asarray(function(z, 1.0)).ravel(), (0.0, END), z0, method="DOP853", rtol=1e-13, atol=1e-13
        )
        reference = found.y[:, -1]

        def errors(q: np.ndarray, dq: np.ndarray) -> tuple[float, float]:
            return float(np.abs(q - reference[:n]).max()), float(np.abs(dq - reference[2 * n : 3 * n]).max())

        codegen.generate(chain_model(n), Path(folder) / "chain", functions="dynamics,motion")
        solver = codegen.load(Path(folder) / "chain")
        print(f"CHAIN({n}), {END:g} s, state and dq/dL; {instructions}, gcc -O2 (ours), -O3 (CasADi)\n")
        contestants: dict[tuple[str, float], Callable[[], object]] = {}
        results: dict[tuple[str, float], tuple[float, float]] = {}
        for tolerance in TOLERANCES:
            integrator = cvodes(n, tolerance, system)
            results["cvodes", tolerance] = errors(
                *(np.split(np.asarray(integrator(x0=z0, p=1.0)["xf"]).ravel(), 4)[i] for i in (0, 2))
            )
            contestants["cvodes", tolerance] = lambda integrator=integrator: integrator(x0=z0, p=1.0)

            def ours(tolerance: float = tolerance) -> object:
                return solver.simulate(
                    [0.0, END],
                    q0,
                    u0,
                    sensitivities=("L",),
                    rtol=tolerance,
                    atol=tolerance,
                    atol_sensitivities=tolerance,
                )

            motion = ours()
            results["ours", tolerance] = errors(motion.q[-1], motion.dq[0, -1])
            contestants["ours", tolerance] = ours
        best = dict.fromkeys(contestants, np.inf)
        inside = dict.fromkeys(TOLERANCES, np.inf)
        for _ in range(options.rounds):
            for key, run in contestants.items():
                best[key] = min(best[key], least(run, 0.1))
                if key[0] == "ours":
                    inside[key[1]] = min(inside[key[1]], *(run().stats["seconds"] for _ in range(20)))

        def best_of(who: str) -> dict[float, float]:
            return {t: best[who, t] for t in TOLERANCES}

        rows = []
        for tolerance in TOLERANCES:
            mine, theirs = ("ours", tolerance), ("cvodes", tolerance)
            rows.append([
                f"{tolerance:.0e}", *(f"{e:.1e}" for e in results[mine]), f"{1e3 * best[mine]:.3f}",
                f"{1e3 * inside[tolerance]:.3f}", *(f"{e:.1e}" for e in results[theirs]), f"{1e3 * best[theirs]:.3f}",
            ])  # fmt: skip
        head = ["tolerance", "ours: error q", "dq/dL", "ms, Python", "ms, C", "cvodes: error q", "dq/dL", "ms"]
        print(table(head, rows), "\n")
        within = {t: inside[t] for t in TOLERANCES}
        curves = [("ours, from Python", best_of("ours")), ("ours, C", within), ("cvodes", best_of("cvodes"))]
        met = []
        for name, seconds in curves:
            who = name.partition(",")[0]
            arrays = [
                np.array([x[t] for t in TOLERANCES]) for x in (seconds, {t: results[who, t][1] for t in TOLERANCES})
            ]
            met.append(at_error(*arrays, GOAL))
        print(f"error {GOAL:.0e} of dq/dL (claim 0.2): {met[0] / met[2]:.3f} from Python, {met[1] / met[2]:.3f} in C; ms "
              + ", ".join(f"{1e3 * x:.3f}" for x in met))  # fmt: skip
        tight = [seconds[TIGHT] for _, seconds in curves]
        print(
            f"tolerance {TIGHT:.0e} (claim 0.25): {tight[0] / tight[2]:.3f} from Python, {tight[1] / tight[2]:.3f} in C"
        )


if __name__ == "__main__":
    main()
