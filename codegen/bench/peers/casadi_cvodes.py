"""CasADi with cvodes on the chain: an articulated-body algorithm written by hand, its derivative beside it, compiled by ``-O3``.

Adams' method with functional iteration is the best of cvodes' for this motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...measure import articulated_chain
from ...runtime.standalone.compiler import optimization
from ..problem import Motion
from .contestant import Contestant, Ends

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)


def contestants(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """The chain of n rods from a state, with its derivatives by the length."""
    import casadi

    z, L, rate = system(n)
    flags = ["-O3", *(f for f in optimization() if f.startswith("-m"))]
    start = np.concatenate([q, u, np.zeros(2 * n)])
    found = []
    for tolerance in TOLERANCES:
        options: Any = {
            "abstol": tolerance, "reltol": tolerance, "max_num_steps": 1_000_000, "linear_multistep_method": "adams",
            "nonlinear_solver_iteration": "functional", "jit": True, "compiler": "shell", "jit_options": {"flags": flags},
            "jit_cleanup": True,
        }  # fmt: skip
        integrator = casadi.integrator("motion", "cvodes", {"x": z, "p": L, "ode": rate}, 0, problem.end, options)

        def run(integrator: Any = integrator) -> Ends:
            q, _, dq, _ = np.split(np.asarray(integrator(x0=start, p=1.0)["xf"]).ravel(), 4)
            return q.tolist(), [dq.tolist()]

        found.append(Contestant("CasADi, cvodes", f"Adams {tolerance:.0e}", run))
    return found


def system(n: int) -> tuple[Any, Any, Any]:
    """States q, u and their derivatives by L; L; the time derivatives of the states: CasADi's SX."""
    import casadi

    q, u, sq, su = (casadi.SX.sym(name, n) for name in ("q", "u", "sq", "su"))
    L = casadi.SX.sym("L")
    parts = [q[i] for i in range(n)], [u[i] for i in range(n)]
    udot = casadi.vertcat(*articulated_chain.accelerations(*parts, L, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    dudot = casadi.jtimes(udot, casadi.vertcat(q, u, L), casadi.vertcat(sq, su, 1))
    return casadi.vertcat(q, u, sq, su), L, casadi.cse(casadi.vertcat(u, udot, su, dudot))
