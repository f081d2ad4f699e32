"""Real robots with links held at points of the ground, against Pinocchio's matrices for the same files and multipliers.

``python -m pytest -m campaign tests/importing/test_closed_robots.py``
"""

from typing import Any

import numpy as np
import pytest
from importing.test_robots import folder
from pinocchio_agreement import states

import codegen

ROBOTS = [
    ("ur_description/urdf/ur5_robot.urdf", "fixed", ["wrist_3_link"]),
    ("solo_description/robots/solo12.urdf", "free", ["FL_LOWER_LEG", "HR_LOWER_LEG"]),
    ("anymal_c_simple_description/urdf/anymal.urdf", "free", ["LF_SHANK", "RF_SHANK", "LH_SHANK", "RH_SHANK"]),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "free", ["left_ankle_roll_link", "right_wrist_yaw_link"]),
]  # fmt: skip
"""Files, how their bases stand, and the links whose origins are held."""
SIDE_LOOP = "  hold_{n}: {{joint: {{type: point}}, from: {link}, to: {{body: ground, at: {at}}}}}\n"


def right_accelerations(theirs: Any, q: np.ndarray, u: np.ndarray, links: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Speeds that hold the links' origins, those next to u, and accelerations: all equations with multipliers, solved densely."""
    import pinocchio as pin

    data = theirs.createData()
    frames = [theirs.getFrameId(link) for link in links]
    pin.computeJointJacobians(theirs, data, q)
    pin.updateFramePlacements(theirs, data)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = np.vstack([pin.getFrameJacobian(theirs, data, f, axes)[:3] for f in frames])
    u = u - np.linalg.pinv(J) @ (J @ u)
    pin.forwardKinematics(theirs, data, q, u, np.zeros(theirs.nv))
    pin.updateFramePlacements(theirs, data)
    drift = np.concatenate([pin.getFrameClassicalAcceleration(theirs, data, f, axes).linear for f in frames])
    M = pin.crba(theirs, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    bias = pin.nonLinearEffects(theirs, data, q, u) + np.array(theirs.damping) * u
    n = len(drift)
    whole = np.block([[M, J.T], [J, np.zeros((n, n))]])
    return u, np.linalg.solve(whole, np.concatenate([-bias, -drift]))[: theirs.nv]


@pytest.mark.campaign
@pytest.mark.parametrize(("file", "base", "links"), ROBOTS, ids=[file.rpartition("/")[2] for file, *_ in ROBOTS])
def test_a_held_robot_moves_as_pinocchios_matrices_say(tmp_path, file, base, links):
    path = folder() / file
    import pinocchio as pin

    theirs = (
        pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        if base == "free"
        else pin.buildModelFromUrdf(str(path))
    )
    tree = codegen.import_model(path, base=base, free_mimic=True)
    codegen.generate(tree.model, tmp_path / "tree", target="numpy", compile=False)
    for seed in range(3):
        (q, u), (here_q, _), order, _ = states(theirs, tree, codegen.load(tmp_path / "tree", "numpy"), seed)
        data = theirs.createData()
        pin.framesForwardKinematics(theirs, data, q)
        places = [data.oMf[theirs.getFrameId(link)].translation.tolist() for link in links]
        side = tmp_path / f"side_{seed}.yaml"
        joints = {n: float(x) for n, x in zip(tree.model.coordinate_names, here_q, strict=True)}
        side.write_text(
            "loops:\n"
            + "".join(
                SIDE_LOOP.format(n=n, link=link, at=at) for n, (link, at) in enumerate(zip(links, places, strict=True))
            )
            + "initial:\n  q:\n"
            + "".join(f"    {name}: {value!r}\n" for name, value in joints.items())
        )
        held = codegen.import_model(path, base=base, free_mimic=True, loops=side)
        assert len(held.model.loops) == len(links)
        assert list(held.model.coordinate_names) == list(tree.model.coordinate_names)
        codegen.generate(held.model, tmp_path / f"held_{seed}", target="numpy", compile=False)
        solver = codegen.load(tmp_path / f"held_{seed}", "numpy")
        u, right = right_accelerations(theirs, q, u, links)
        here_u = np.zeros(solver.nu)
        here_u[order] = u
        ours = solver.accelerations(here_q, here_u)[order]
        error = np.abs(ours - right).max() / np.abs(right).max()
        print(f"\n{path.stem}, {len(links)} links held: udot {error:.1e}")
        assert error < 1e-9
