"""Accelerations of an imported SDF, compared with those of Drake for the same file."""

from pathlib import Path
from typing import Any

import numpy as np


def plant_of(file: str) -> Any:
    """A continuous plant with the whole contents of a file; RuntimeError with Drake's message."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    for folder in Path(file).parent.iterdir():
        if folder.is_dir() and not parser.package_map().Contains(folder.name):
            parser.package_map().Add(folder.name, str(folder))
    parser.AddModels(file)
    plant.Finalize()
    return plant


def parts(plant: Any, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Joints and bodies of a model of the plant, by their names in the file; names of nested models are prefixes."""
    from pydrake.multibody.tree import ModelInstanceIndex

    joints, bodies = {}, {}
    for found, indices, get in (
        (joints, plant.GetJointIndices, plant.get_joint), (bodies, plant.GetBodyIndices, plant.get_body),
    ):  # fmt: skip
        for i in range(plant.num_model_instances()):
            whole = plant.GetModelInstanceName(ModelInstanceIndex(i))
            if whole == name or whole.startswith(f"{name}::"):
                path = whole[len(name) :].removeprefix("::")
                for index in indices(ModelInstanceIndex(i)):
                    one = get(index)
                    found[f"{path}::{one.name()}" if path else one.name()] = one
    return joints, bodies


def accelerations(plant: Any, name: str, found: Any, engine: Any, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of ordernm and of Drake, in the order of ordernm's speeds, at a random state.

    Raises
    ------
    LookupError
        If the two have other freedoms.
    """
    rng = np.random.default_rng(seed)
    context = plant.CreateDefaultContext()
    joints, bodies = parts(plant, name)
    model = found.model
    names, speeds = list(model.coordinate_names), list(model.speed_names)
    q, u = np.zeros(len(names)), np.zeros(len(speeds))
    rows: list[tuple[int, int]] = []
    set_q, set_v = plant.GetPositions(context), plant.GetVelocities(context)
    free: list[tuple[str, Any]] = []
    for joint_name, own in found.joints.items():
        local = joint_name.rpartition("::")[2]  # Drake has joints in the model of their child
        alike = [joint for name_, joint in joints.items() if name_.rpartition("::")[2] == local]
        joint = joints[joint_name] if joint_name in joints or len(alike) != 1 else alike[0]
        if joint.num_velocities() != 1:
            raise LookupError(f"joint {joint_name} has {joint.num_velocities()} speeds")
        angle, rate = rng.uniform(-1.2, 1.2), rng.normal()
        set_q[joint.position_start()], set_v[joint.velocity_start()] = angle, rate
        q[names.index(own)], u[speeds.index(own)] = angle, rate
        rows.append((speeds.index(own), joint.velocity_start()))
    for body in model.bodies:
        if body.joint.type == "free" and body.name not in found.joints.values():
            link = next(b for n, b in bodies.items() if found.bodies.get(n) == body.name and _is_base(b))
            free.append((body.name, link))
    if len(rows) + 6 * len(free) != len(speeds):
        raise LookupError(f"{len(rows)} joints and {len(free)} free bodies have other freedoms than {len(speeds)}")
    plant.SetPositions(context, set_q)
    plant.SetVelocities(context, set_v)
    for own, link in free:
        _set_free(plant, context, link, own, rng, (q, u), (names, speeds))
    theirs = plant.get_generalized_acceleration_output_port().Eval(context)
    right = np.zeros(len(speeds))
    for row, place in rows:
        right[row] = theirs[place]
    for own, link in free:
        turn = plant.EvalBodyPoseInWorld(context, link).rotation().matrix()
        place = link.floating_velocities_start_in_v()
        at = [speeds.index(f"{own}.{c}") for c in ("wx", "wy", "wz", "vx", "vy", "vz")]
        w, v = u[at[:3]], u[at[3:]]
        right[at[:3]] = turn.T @ theirs[place : place + 3]
        right[at[3:]] = turn.T @ theirs[place + 3 : place + 6] - np.cross(w, v)
    return engine.accelerations(q, u), right


def _is_base(link: Any) -> bool:
    return bool(link.is_floating_base_body())


def _set_free(plant: Any, context: Any, link: Any, own: str, rng: Any, state: Any, listed: Any) -> None:
    from pydrake.common.eigen_geometry import Quaternion
    from pydrake.math import RigidTransform
    from pydrake.multibody.math import SpatialVelocity

    e = rng.normal(size=4)
    e /= np.linalg.norm(e)
    at, w, v = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    pose = RigidTransform(Quaternion(e), at)
    turn = pose.rotation().matrix()
    plant.SetFreeBodyPose(context, link, pose)
    plant.SetFreeBodySpatialVelocity(context, link, SpatialVelocity(turn @ w, turn @ v))
    for key, value in zip(("px", "py", "pz", "qw", "qx", "qy", "qz"), (*at, *e), strict=True):
        state[0][listed[0].index(f"{own}.{key}")] = value
    for key, value in zip(("wx", "wy", "wz", "vx", "vy", "vz"), (*w, *v), strict=True):
        state[1][listed[1].index(f"{own}.{key}")] = value
