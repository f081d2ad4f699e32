"""The final state of a motion, computed by other programs: by SciPy, with ordernm's accelerations, for any tree, and by
the others for the chain.

Each program has a function that imports the program; in `comparing` the programs take turns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...measure import articulated_chain
from ...measure.pinocchio_models import chain
from ...runtime.standalone.files.compiler import optimization
from ..problem import Motion

if TYPE_CHECKING:
    from ...runtime import Solver

Ends = tuple[Sequence[float], Sequence[Sequence[float]] | None]
"""The quantities of a problem at its end, and their derivatives if the program computes them."""

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
SCIPY = (("DOP853", TOLERANCES), ("Radau", TOLERANCES[:1]))
STEPS = (4e-3, 1e-3, 2.5e-4)
"""Sizes of MuJoCo's time steps, s."""


@dataclass(frozen=True)
class Contestant:
    """A program with its settings.

    Attributes
    ----------
    who, setting : str
    run : callable
        Computes the motion from the initial state.
    """

    who: str
    setting: str
    run: Callable[[], Ends]


def casadi(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """cvodes on the chain of n rods from a state, with derivatives with respect to the length, compiled with ``-O3``.

    Adams' method with functional iteration is the fastest method of cvodes for this motion.
    """
    from casadi import integrator

    z, L, rate = casadi_rates(n)
    flags = ["-O3", *(f for f in optimization() if f.startswith("-m"))]
    start = np.concatenate([q, u, np.zeros(2 * n)])

    def run(motion: Any) -> Ends:
        q, _, dq, _ = np.split(np.asarray(motion(x0=start, p=1.0)["xf"]).ravel(), 4)
        return q.tolist(), [dq.tolist()]

    found = []
    for tolerance in TOLERANCES:
        options: Any = {
            "abstol": tolerance, "reltol": tolerance, "max_num_steps": 1_000_000, "linear_multistep_method": "adams",
            "nonlinear_solver_iteration": "functional", "jit": True, "compiler": "shell", "jit_options": {"flags": flags},
            "jit_cleanup": True,
        }  # fmt: skip
        motion = integrator("motion", "cvodes", {"x": z, "p": L, "ode": rate}, 0, problem.end, options)
        found.append(Contestant("CasADi, cvodes", f"Adams {tolerance:.0e}", partial(run, motion)))
    return found


def casadi_rates(n: int) -> tuple[Any, Any, Any]:
    """Three SX expressions of CasADi, from a hand-written algorithm: the states (q, u and their derivatives with respect to
    L), the parameter L, and the time derivatives of the states."""
    import casadi

    q, u, sq, su = (casadi.SX.sym(name, n) for name in ("q", "u", "sq", "su"))
    L = casadi.SX.sym("L")
    parts = [q[i] for i in range(n)], [u[i] for i in range(n)]
    udot = casadi.vertcat(*articulated_chain.accelerations(*parts, L, casadi.sin, casadi.cos, 1.0, 0.05, 9.81))
    dudot = casadi.jtimes(udot, casadi.vertcat(q, u, L), casadi.vertcat(sq, su, 1))
    return casadi.vertcat(q, u, sq, su), L, casadi.cse(casadi.vertcat(u, udot, su, dudot))


def mujoco(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """The chain of n rods, integrated by MuJoCo's method of order 4 with constant steps."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(chain_xml(n))
    data = mujoco.MjData(model)

    def run(step: float) -> Ends:
        model.opt.timestep = step
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q, u
        mujoco.mj_step(model, data, nstep=round(problem.end / step))
        return data.qpos.tolist(), None

    return [Contestant("MuJoCo", f"RK4, step {step:g} s", partial(run, step)) for step in STEPS]


def chain_xml(n: int) -> str:
    """The chain in MuJoCo's format: rods of 1 kg, 1 m and radius 5 cm."""
    mass, length, radius = 1.0, 1.0, 0.05
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    inner = ""
    for k in reversed(range(n)):
        axis = "1 0 0" if k % 2 else "0 1 0"
        inner = (
            f'<body pos="0 0 {-length if k else 0.0}"><joint type="hinge" axis="{axis}"/>'
            f'<inertial pos="0 0 {-length / 2}" mass="{mass}" diaginertia="{across!r} {across!r} {along!r}"/>{inner}</body>'
        )
    option = '<option gravity="0 0 -9.81" integrator="RK4"><flag contact="disable"/></option>'
    return f"<mujoco>{option}<worldbody>{inner}</worldbody></mujoco>"


def pinocchio(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """The chain by Pinocchio's articulated-body algorithm and SciPy's DOP853, as a Python user would write it."""
    import pinocchio as pin
    from scipy.integrate import solve_ivp

    model = chain(n)
    data, force, start = model.createData(), np.zeros(n), np.concatenate([q, u])

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], pin.aba(model, data, y[:n], y[n:], force)])

    def run(tolerance: float) -> Ends:
        y = solve_ivp(rates, (0.0, problem.end), start, method="DOP853", rtol=tolerance, atol=tolerance).y
        return y[:n, -1].tolist(), None

    return [Contestant("Pinocchio, SciPy", f"aba, DOP853 {x:.0e}", partial(run, x)) for x in TOLERANCES]


def scipy(problem: Motion, solver: Solver, stiff: bool) -> list[Contestant]:
    """SciPy's explicit method, or for stiff models its implicit method. Accelerations, and Jacobians for the implicit method,
    are those of ordernm, called from Python."""
    from scipy.integrate import solve_ivp

    q, u = solver.initial
    if problem.start:
        q, _ = solver.assemble(dict(problem.start))
    n, start = solver.nq, np.concatenate([q, u])
    method, tolerances = SCIPY[stiff]

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], solver.accelerations(y[:n], y[n:])])

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        J = solver.jacobians(y[:n], y[n:])
        return np.block([[np.zeros((n, n)), np.eye(n)], [J.q, J.u]])

    def run(tolerance: float) -> Ends:
        more = {"jac": jacobian} if stiff else {}
        y = solve_ivp(rates, (0.0, problem.end), start, method=method, rtol=tolerance, atol=tolerance, **more).y[:, -1]
        names = [f"q.{x}" for x in solver.coordinate_names] + [f"u.{x}" for x in solver.speed_names]
        values = dict(zip(names, y, strict=True))
        if solver.output_names:
            values |= dict(zip(solver.output_names, solver.outputs(y[:n], y[n:]), strict=True))
        return [float(values[name]) for name in problem.quantities], None

    return [Contestant("SciPy, our accelerations", f"{method} {x:.0e}", partial(run, x)) for x in tolerances]
