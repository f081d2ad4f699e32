"""Outputs against Pinocchio, where it has them: frames, their velocities and accelerations, centre of mass, momenta.

The model is a tree on revolute and prismatic joints, with a free base; skipped where Pinocchio is not installed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from measured import Seen, outputs_of

from codegen.model import parse_model
from codegen.reference import DenseEngine

pin: Any = pytest.importorskip("pinocchio")

TEXT = """
model: compared
gravity: [0.4, -0.2, -9.81]
bodies:
  hull: {parent: ground, joint: {type: free}, mass: 2, com: [0.1, 0, 0.2], inertia: {xx: 0.3, yy: 0.2, zz: 0.25, yz: 0.02}}
  arm: {parent: hull, joint: {type: revolute, axis: y, at: [0, 0.3, 0]}, mass: 0.8, com: [0, 0.1, -0.4],
        inertia: {xx: 0.1, yy: 0.12, zz: 0.05}}
  slide: {parent: arm, joint: {type: prismatic, axis: x, at: [0, 0, -0.8]}, mass: 0.7, com: [0, 0.05, -0.2],
          inertia: {xx: 0.02, yy: 0.025, zz: 0.015}}
  wheel: {parent: hull, joint: {type: revolute, axis: x, at: [0, 0, 0.5]}, mass: 0.5, com: [0, 0.1, 0],
          inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
points:
  tip: {body: slide, at: [0.1, -0.2, 0.3]}
  rim: {body: wheel, at: [0.3, 0.1, 0]}
outputs:
"""
PLACES = {"hull": ("ground", (0, 0, 0)), "arm": ("hull", (0, 0.3, 0)), "slide": ("arm", (0, 0, -0.8)),
          "wheel": ("hull", (0, 0, 0.5))}  # fmt: skip
POINTS = {"tip": ("slide", (0.1, -0.2, 0.3)), "rim": ("wheel", (0.3, 0.1, 0))}


def theirs(model: Any) -> Any:
    """The same model in Pinocchio, with frames at the points."""
    made = pin.Model()
    made.gravity.linear = np.array([e.value for e in model.gravity])
    joints = {"hull": pin.JointModelFreeFlyer(), "arm": pin.JointModelRY(), "slide": pin.JointModelPX(),
              "wheel": pin.JointModelRX()}  # fmt: skip
    number = {"ground": 0}
    for body in model.bodies:
        parent, at = PLACES[body.name]
        number[body.name] = made.addJoint(
            number[parent], joints[body.name], pin.SE3(np.eye(3), np.array(at, float)), body.name
        )
        xx, yy, zz, xy, xz, yz = (e.value for e in body.inertia)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)
        com = np.array([e.value for e in body.com], float)
        made.appendBodyToJoint(number[body.name], pin.Inertia(body.mass.value, com, inertia), pin.SE3.Identity())
    for name, (body, at) in POINTS.items():
        place = pin.SE3(np.eye(3), np.array(at, float))
        made.addFrame(pin.Frame(name, number[body], 0, place, pin.FrameType.OP_FRAME))
    return made


def test_it_has_the_same_numbers() -> None:
    lines = [f"c_{i}: {{center_of_mass: system, axis: {i}}}" for i in "xyz"]
    lines += [f"P_{i}: {{momentum: linear, axis: {i}}}" for i in "xyz"]
    lines += [f"S_{i}: {{momentum: angular, axis: {i}, about: center_of_mass}}" for i in "xyz"]
    for point, (body, _) in POINTS.items():
        lines += [f"{m}_{point}_{i}: {{{m}: {point}, axis: {i}}}" for m in ("velocity", "acceleration") for i in "xyz"]
        lines += [f"w_{point}_{i}: {{angular_velocity: {body}, axis: {i}, frame: body}}" for i in "xyz"]
        lines += [f"R_{point}_{i}{j}: {{rotation: {body}, entry: {i}{j}}}" for i in "xyz" for j in "xyz"]
        lines += [f"e_{point}_{i}: {{rotation: {body}, entry: q{i}}}" for i in "wxyz"]
    lines += ["d: {distance: [tip, rim]}"]
    model = parse_model(TEXT + outputs_of("\n".join(lines)))
    engine = DenseEngine(model)
    rng = np.random.default_rng(12)
    e = rng.normal(size=4)
    e /= np.linalg.norm(e)
    place, angles = rng.normal(size=3), rng.uniform(-1, 1, 3)
    w, v, rates = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    values = {f"hull.p{i}": x for i, x in zip("xyz", place, strict=True)}
    values |= {f"hull.q{i}": x for i, x in zip("wxyz", e, strict=True)}
    values |= {f"hull.w{i}": x for i, x in zip("xyz", w, strict=True)}
    values |= {f"hull.v{i}": x for i, x in zip("xyz", v, strict=True)}
    names = ("arm", "slide", "wheel")
    q = np.array([(values | dict(zip(names, angles, strict=True)))[n] for n in model.coordinate_names])
    u = np.array([(values | dict(zip(names, rates, strict=True)))[n] for n in model.speed_names])
    seen = Seen(engine, q, u, np.zeros(0), np.zeros(0), 0.0)
    udot = dict(zip(model.speed_names, engine.accelerations(q, u), strict=True))

    made = theirs(model)
    data = made.createData()
    pq = np.array([*place, *e[1:], e[0], *angles])
    pv = np.array([*v, *w, *rates])
    pa = pin.aba(made, data, pq, pv, np.zeros(made.nv))
    assert np.abs(pa[6:] - [udot[n] for n in names]).max() < 1e-11
    pin.forwardKinematics(made, data, pq, pv, pa)
    pin.updateFramePlacements(made, data)
    pin.centerOfMass(made, data, pq, pv)
    pin.ccrba(made, data, pq, pv)
    assert np.abs(seen.vector("c") - data.com[0]).max() < 1e-14
    assert np.abs(seen.vector("P") - data.hg.linear).max() < 1e-13
    assert np.abs(seen.vector("S") - data.hg.angular).max() < 1e-13
    places = {}
    for point in POINTS:
        frame = made.getFrameId(point)
        R = data.oMf[frame].rotation
        places[point] = data.oMf[frame].translation
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        velocity = pin.getFrameVelocity(made, data, frame, aligned).linear
        acceleration = pin.getFrameClassicalAcceleration(made, data, frame, aligned).linear
        turning = pin.getFrameVelocity(made, data, frame, pin.ReferenceFrame.LOCAL).angular
        assert np.abs(seen.vector(f"velocity_{point}") - velocity).max() < 1e-13
        assert np.abs(seen.vector(f"acceleration_{point}") - acceleration).max() < 1e-11
        assert np.abs(seen.vector(f"w_{point}") - turning).max() < 1e-13
        found = np.array([[seen.value[f"R_{point}_{i}{j}"] for j in "xyz"] for i in "xyz"])
        assert np.abs(found - R).max() < 1e-14
        quaternion = pin.Quaternion(R).coeffs()[[3, 0, 1, 2]]
        quaternion *= np.sign(quaternion[0])
        assert np.abs([seen.value[f"e_{point}_{i}"] for i in "wxyz"] - quaternion).max() < 1e-14
    assert abs(seen.value["d"] - np.linalg.norm(places["tip"] - places["rim"])) < 1e-14
