"""MuJoCo on the chain: its own integrator of order 4, at constant steps."""

from __future__ import annotations

import numpy as np

from ..problem import Motion
from .contestant import Contestant, Ends

STEPS = (4e-3, 1e-3, 2.5e-4)
"""s."""


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


def contestants(problem: Motion, n: int, q: np.ndarray, u: np.ndarray) -> list[Contestant]:
    """The chain of n rods from a state."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(chain_xml(n))
    data = mujoco.MjData(model)
    found = []
    for step in STEPS:

        def run(step: float = step) -> Ends:
            model.opt.timestep = step
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = q, u
            mujoco.mj_step(model, data, nstep=round(problem.end / step))
            return data.qpos.tolist(), None

        found.append(Contestant("MuJoCo", f"RK4, step {step:g} s", run))
    return found
