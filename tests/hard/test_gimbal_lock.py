"""A thin rod on a universal joint and on a spherical one, where it is along the first axis of the universal joint.

There turning about the first axis moves nothing: the joint has to be named before numbers become wrong. A rod that passes near by
turns quickly about that axis, which is right; its end moves as that of a spherical pendulum, whose equation stands here. A ball
joint knows no such pose.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard.errors import errors
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import codegen
from codegen.reference import DenseEngine
from codegen.runtime import SimulationError, SingularJointError, SingularLoopError

MODEL = """
model: stick
gravity: [0, 0, -9.81]
parameters: {l: 0.8, thin: 0.0}
bodies:
  stick: {parent: ground, joint: {type: JOINT}, mass: 1.2, com: [0, 0, -l/2],
          inertia: {xx: 1.2*l**2/12, yy: 1.2*l**2/12, zz: thin}}
points: {tip: {body: stick, at: [0, 0, -l]}}
outputs:
  x: {position: tip, axis: x}
  y: {position: tip, axis: y}
  z: {position: tip, axis: z}
"""
HOOKE = MODEL.replace("JOINT", "universal, axes: [x, y]")
BALL = MODEL.replace("JOINT", "spherical").replace("thin: 0.0", "thin: 1e-4")
MOTION = {"target": "c", "functions": ("motion", "accelerations", "sensitivities")}
LOCKED = r"nothing outboard of joint stick\.1 has positive inertia about it.*gimbal lock"
TIMES = np.linspace(0.0, 1.0, 11)


@pytest.fixture(scope="module")
def hooke(build: Callable[..., Any]) -> Any:
    return build(HOOKE, **MOTION)


def spherical_pendulum(place: Any, velocity: Any) -> Any:
    """The end of a thin rod of 0.8 m over time, as a spherical pendulum: r'' = 3/2 g across r - v^2 r / l^2."""

    def rates(t: float, y: Any) -> Any:
        r, v = y[:3], y[3:]
        g = np.array([0.0, 0.0, -9.81]) * 1.5
        return np.r_[v, g - r * (g @ r + v @ v) / (r @ r)]

    y = np.r_[place, velocity]
    found = solve_ivp(rates, (0, TIMES[-1]), y, method="DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-13)
    return found.y[:3].T


def rod(q: Any, u: Any) -> tuple[Any, Any]:
    """Position and velocity of the rod's end from angles and speeds of the universal joint."""
    R = Rotation.from_euler("XY", q)
    r = R.apply([0, 0, -0.8])
    turning = np.array([u[0], 0, 0]) + Rotation.from_euler("X", q[0]).apply([0, u[1], 0])
    return r, np.cross(turning, r)


@pytest.mark.parametrize("u", [(1e-6, 8.5), (1e-3, 8.5), (0.1, 8.5)])
def test_a_motion_that_nearly_meets_it_is_right(hooke: Any, u: Any) -> None:
    q = np.zeros(2)
    found = hooke.simulate(TIMES, q, u, rtol=1e-11, atol=1e-11)
    tip = np.stack([found[n] for n in "xyz"], axis=-1)
    np.testing.assert_allclose(tip, spherical_pendulum(*rod(q, u)), rtol=0, atol=1e-7)
    assert np.abs(np.diff(found["q.stick.1"])).max() > 1.0, "it turns about the first axis in passing"


def test_a_motion_into_it_ends_with_the_name_of_the_joint(hooke: Any) -> None:
    with pytest.raises(SimulationError, match=LOCKED) as caught:
        hooke.simulate(1.0, [0.0, 0.0], [1e-9, 8.5])
    reached = caught.value.trajectory
    assert abs(reached["q.stick.2"][-1] - np.pi / 2) < 1e-3
    np.testing.assert_allclose(np.linalg.norm([reached[n] for n in "xyz"], axis=0), 0.8, rtol=1e-14)


def test_states_near_it_are_exact_until_they_are_refused(hooke: Any) -> None:
    engine = DenseEngine(codegen.parse_model(HOOKE), numbers="mpmath")
    u, dq = [1.0, 2.0], np.eye(2)
    for off in (1e-2, 1e-4, 1e-6, 1e-7, 7e-8):
        q = [0.3, np.pi / 2 - off]
        found, along = hooke.sensitivities(q, u, dq=dq)
        exact, exact_along = engine.sensitivities(q, u, dq=dq)
        # rounding of 1e-16 in what drives the first axis, over an inertia that falls with the square of the distance
        assert max(errors([found, *along], [exact, *exact_along])) < 1e-14 + 1e-15 / off
    for off in (2e-8, 1e-8, 0.0):
        with pytest.raises(SingularJointError, match=LOCKED):
            hooke.sensitivities([0.3, np.pi / 2 - off], u, dq=dq)


def test_a_ball_joint_passes_the_pose(build: Callable[..., Any]) -> None:
    """With and without a swing across; the rod has a little inertia about itself, which its end does not see."""
    ball = build(BALL, **MOTION)
    for across in (0.0, 1e-9, 0.1):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = ball.simulate(TIMES, [1, 0, 0, 0], [across, 8.5, 0], p=[0.8, 1e-9], rtol=1e-11, atol=1e-11)
        tip = np.stack([found[n] for n in "xyz"], axis=-1)
        np.testing.assert_allclose(tip, spherical_pendulum(*rod([0, 0], [across, 8.5])), rtol=0, atol=1e-8)
        assert tip[:, 0].min() < -0.79, "it has lain along the x axis"


SHAFTS = """
model: shafts
parameters: {bend: 0.5}
inputs: [motor]
bodies:
  driving: {parent: ground, joint: {type: revolute, axis: x}, inertia: {xx: 0.02, yy: 0.02, zz: 0.02}}
  driven: {parent: driving, joint: {type: universal, axes: [y, z]}, inertia: {xx: 0.03, yy: 0.03, zz: 0.03}}
loops:
  bearing: {joint: {type: cylindrical, axis: x}, from: driven, to: {body: ground, rotate: [{axis: z, angle: bend}]}}
forces: {motor: {type: joint, joint: driving, value: motor}}
initial: {q: {driving: 0.4, driven.1: 0.1, driven.2: 0.4}, u: {driving: 1}}
independent: [driving]
outputs: {out: {angular_velocity: driven, axis: x, frame: body}}
"""


def test_shafts_through_a_hookes_joint(build: Callable[..., Any]) -> None:
    """The driven shaft's speed in closed form up to a bend of a right angle, where both shafts are locked: named."""
    shafts = build(SHAFTS, functions=("accelerations", "outputs", "states"))
    q, u = shafts.initial
    for bend in (0.1, 0.5, 1.0, 1.4, 1.55):
        q, u = shafts.assemble({"driving": 0.4, "driven.1": q[1], "driven.2": q[2]}, {"driving": 1.0}, [bend])
        (out,) = shafts.outputs(q, u, [bend])
        expected = np.cos(bend) / (1 - np.sin(bend) ** 2 * np.sin(0.4) ** 2)
        other = np.cos(bend) / (1 - np.sin(bend) ** 2 * np.cos(0.4) ** 2)  # the cross turned by a right angle
        assert min(abs(abs(out) - expected), abs(abs(out) - other)) < 1e-12
    for q in ([0.0, 0.0, np.pi / 2], [0.7, 0.0, np.pi / 2]):
        with pytest.raises(SingularLoopError, match="bearing"):
            shafts.accelerations(q, {"driving": 1.0}, [np.pi / 2])
