"""States of MuJoCo in the coordinates of an imported model, and accelerations of the model in MuJoCo's coordinates."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from codegen.reference import RecursiveEngine


def of_mujoco(model: Any, data: Any, found: Any, solver: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The state in the model's coordinates, and the matrix T that converts MuJoCo's speeds v: u = T v.

    Parameters
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
    found : codegen.Imported
    solver : object
        With `initial`, `coordinate_names` and `speed_names`.
    """
    import mujoco

    q, u = (np.array(x, float) for x in solver.initial)
    T = np.zeros((len(u), model.nv))
    for k in range(model.njnt):
        body = found.joints[model.joint(k).name or f"joint_{k}"]
        at, dof, type_ = model.jnt_qposadr[k], model.jnt_dofadr[k], model.jnt_type[k]
        coordinates = [i for i, n in enumerate(solver.coordinate_names) if n.split(".")[0] == body]
        speeds = [i for i, n in enumerate(solver.speed_names) if n.split(".")[0] == body]
        if type_ == mujoco.mjtJoint.mjJNT_FREE:  # ours: wx wy wz vx vy vz in the body's axes
            q[coordinates] = data.qpos[at : at + 7]
            T[np.ix_(speeds[3:], range(dof, dof + 3))] = data.xmat[model.jnt_bodyid[k]].reshape(3, 3).T
            T[np.ix_(speeds[:3], range(dof + 3, dof + 6))] = np.eye(3)
        elif type_ == mujoco.mjtJoint.mjJNT_BALL:
            q[coordinates] = data.qpos[at : at + 4]
            T[np.ix_(speeds, range(dof, dof + 3))] = np.eye(3)
        else:
            q[coordinates] = data.qpos[at] - model.qpos0[at]
            T[speeds, dof] = 1.0
    return q, T @ data.qvel, T


def ours_of(model: Any, data: Any, T: np.ndarray, qacc: np.ndarray) -> np.ndarray:
    """Our accelerations: those of a free base are of components in a frame that turns."""
    import mujoco

    found = T @ qacc
    for k in range(model.njnt):
        if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE:
            dof = model.jnt_dofadr[k]
            turn = data.xmat[model.jnt_bodyid[k]].reshape(3, 3)
            w, v = data.qvel[dof + 3 : dof + 6], turn.T @ data.qvel[dof : dof + 3]
            rows = np.nonzero(np.any(T[:, dof : dof + 3] != 0, axis=1))[0]
            found[rows] -= np.cross(w, v)
    return found


def apart(path: Any, found: Any, seeds: int = 3) -> float:
    """Relative difference of the tree's accelerations and MuJoCo's, computed without compilation."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    tree = replace(found.model, loops=())
    names = SimpleNamespace(
        initial=(np.zeros(len(tree.coordinate_names)), np.zeros(len(tree.speed_names))),
        coordinate_names=list(tree.coordinate_names), speed_names=list(tree.speed_names),
    )  # fmt: skip
    engine, data, rng, worst = RecursiveEngine(tree), mujoco.MjData(model), np.random.default_rng(2), 0.0
    for _ in range(seeds):
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.6)
        data.qvel[:] = rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        q, u, T = of_mujoco(model, data, found, names)
        right = ours_of(model, data, T, data.qacc)
        worst = max(worst, float(np.abs(engine.accelerations(q, u) - right).max() / np.abs(right).max()))
    return worst
