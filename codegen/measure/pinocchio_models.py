"""Trees that both Pinocchio and ordernm can read: chains, and robots from URDF files."""

from __future__ import annotations

import os
import sysconfig
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..importing import from_pinocchio
from ..model import Model
from .compiled import Array


class Robot(NamedTuple):
    """A robot's file in the folder ``robots`` of example-robot-data, and whether the robot is free-floating."""

    file: str
    free: bool


ROBOTS = {
    "UR5": Robot("ur_description/urdf/ur5_robot.urdf", False),
    "Panda": Robot("panda_description/urdf/panda.urdf", False),
    "Solo12": Robot("solo_description/robots/solo12.urdf", True),
    "ANYmal": Robot("anymal_b_simple_description/robots/anymal.urdf", True),
    "G1": Robot("g1_description/urdf/g1_29dof_rev_1_0.urdf", True),
    "Talos": Robot("talos_data/robots/talos_reduced.urdf", True),
}
"""Robots with URDF files: arms, quadrupeds and humanoids."""


def robots_folder() -> Path:
    """The robots of the package example-robot-data, in the current environment or in CMEEL_PREFIX."""
    prefix = Path(os.environ.get("CMEEL_PREFIX", Path(sysconfig.get_path("purelib")) / "cmeel.prefix"))
    return prefix / "share" / "example-robot-data" / "robots"


def chain(n: int) -> Any:
    """Pinocchio's model of ``CHAIN(n)``: uniform rods with hinges about y and x in alternation."""
    import pinocchio as pin

    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([(3 * 0.05**2 + 1) / 12] * 2 + [0.05**2 / 2]))
    for k in range(n):
        joint = pin.JointModelRY() if k % 2 == 0 else pin.JointModelRX()
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if k else 0.0]))
        model.appendBodyToJoint(model.addJoint(k, joint, at, f"link{k}"), inertia, pin.SE3.Identity())
    return model


def robot(folder: Path, name: str) -> Any:
    """A URDF file, read by Pinocchio; continuous joints become revolute joints."""
    import pinocchio as pin

    file = str(folder / ROBOTS[name].file)
    read = (
        pin.buildModelFromUrdf(file, pin.JointModelFreeFlyer()) if ROBOTS[name].free else pin.buildModelFromUrdf(file)
    )
    model = pin.Model()
    for i in range(1, read.njoints):
        joint = read.joints[i]
        kind = joint.shortname().removeprefix("JointModel")
        if kind.startswith("RUB"):
            joint = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}[kind[3]]()
        model.addJoint(read.parents[i], joint, read.jointPlacements[i], read.names[i])
        model.appendBodyToJoint(i, read.inertias[i], pin.SE3.Identity())
    return model


def theirs_of(name: str, folder: Path | None = None) -> Any:
    """Pinocchio's model of ``CHAIN(n)``, or of a robot in a folder (default: that of example-robot-data)."""
    size = name.removeprefix("CHAIN(").removesuffix(")")
    if size.isdigit():
        return chain(int(size))
    folder = folder or robots_folder()
    if not (folder / ROBOTS[name].file).is_file():
        raise FileNotFoundError(2, "not found (pip install example-robot-data)", str(folder / ROBOTS[name].file))
    return robot(folder, name)


def ours(theirs: Any, name: str) -> Model:
    """The same model in ordernm, with an input force on every degree of freedom; `State` gives the order of speeds."""
    return from_pinocchio(theirs, name=name.lower().replace("(", "").replace(")", ""), motors=True).model


class State(NamedTuple):
    """A state of a robot in both programs.

    Attributes
    ----------
    theirs, ours : (q, u)
    order : (nu,)
        Index of each of Pinocchio's speeds in ours.
    rates : (nq, nu)
        Derivatives of our coordinates along our speeds.
    """

    theirs: tuple[Array, Array]
    ours: tuple[Array, Array]
    order: Array
    rates: Array


def usual_state(theirs: Any, q: Array | None = None, u: Array | None = None) -> State:
    """The usual state: q_k = 0.3 sin k and u_k = 0.2 cos k, with normalised quaternions."""
    import pinocchio as pin

    q = 0.3 * np.sin(np.arange(1, theirs.nq + 1)) if q is None else q.copy()
    u = 0.2 * np.cos(np.arange(1, theirs.nv + 1)) if u is None else u
    of_q, of_u = np.arange(theirs.nq), np.arange(theirs.nv)
    rates = np.zeros((theirs.nq, theirs.nv))
    for joint in list(theirs.joints)[1:]:
        i, v = joint.idx_q, joint.idx_v
        if joint.nv == 1:
            rates[i, v] = 1.0
            continue
        at = i + joint.nq - 4  # index of the first entry of the quaternion
        e = q[at : at + 4] + [0, 0, 0, 1]
        x, y, z, w = q[at : at + 4] = e / np.linalg.norm(e)
        of_q[at : at + 4] = at + np.array([1, 2, 3, 0])
        rates[at : at + 4, v : v + 3] = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
        if joint.nq == 7:
            of_u[v : v + 6] = v + np.array([3, 4, 5, 0, 1, 2])
            rates[i : i + 3, v + 3 : v + 6] = pin.Quaternion(w, x, y, z).matrix()
    here = np.empty_like(q), np.empty_like(u)
    here[0][of_q], here[1][of_u] = q, u
    return State((q, u), here, of_u, rates)
