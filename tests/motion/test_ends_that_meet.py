"""Motions through states in which a force or a distance has no direction: derivatives are exact, or NaN with a warning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed
from motion.test_without_derivatives import IDS, METHODS, gradients

from codegen.runtime import Final, Integral, SimulationError

MODEL = """
model: meets
parameters: {k: 31.0, c: 0.4, x0: -0.5, v0: 1.0, y0: 0.0, w0: 0.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  y: {parent: x, joint: {type: prismatic, axis: y}, mass: 1.5}
  z: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
points: {tip: {body: y, at: [0, 0, 0]}, other: {body: z, at: [-2, 0, 0]}, far: {body: ground, at: [-2, 0, 0]}}
initial: {q: {x: x0, y: y0}, u: {x: v0, y: w0}}
outputs: {x: {value: q.x}, y: {value: q.y}, d: {distance: [tip, {body: ground, at: [0, 0, 0]}]}}
forces:
"""
SPRING = (
    "  f: {type: spring, from: {body: ground, at: [0, 0, 0]}, to: tip, stiffness: k, damping: c, free_length: FREE}\n"
)
LOOP = "loops:\n  held: {joint: {type: spherical}, from: other, to: far}\n"
SWING = """
model: swing
parameters: {k: 2.0, f: 0.3, v0: 12.0, w0: 0.0}
gravity: [0, 0, 0]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  b: {parent: a, joint: {type: revolute, axis: z}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  c: {parent: b, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  s: LAW
initial: {u: {a: v0, b: w0}}
outputs: {c: {value: q.c}}
"""
WAYS = pytest.mark.parametrize("way", ["forward", "adjoint"])
BY = ["k", "c", "x0", "v0", "y0", "w0"]


def x_of_1(k: Any = 31.0, c: Any = 0.4, x0: Any = -0.5, v0: Any = 1.0) -> Any:
    """The damped oscillation x of a mass of 2.5, after 1 s."""
    s = -c / 5.0
    w = np.sqrt(k / 2.5 - s * s)
    return np.exp(s) * (x0 * np.cos(w) + (v0 - s * x0) / w * np.sin(w))


def derivatives() -> np.ndarray:
    """The derivatives of `x_of_1`, by complex steps."""
    values = {"k": 31.0, "c": 0.4, "x0": -0.5, "v0": 1.0}
    return np.array([x_of_1(**values | {n: v + 1e-30j}).imag / 1e-30 for n, v in values.items()])


@WAYS
@pytest.mark.parametrize("options", METHODS, ids=IDS)
@pytest.mark.parametrize("loop", ["", LOOP], ids=["tree", "loop"])
def test_a_damped_spring_whose_ends_meet(
    made: Callable[..., Made], loop: str, options: dict[str, Any], way: str
) -> None:
    """Beside its line the damper's force changes at once: NaN along those directions; along all others derivatives are exact."""
    solver = made(parsed, MODEL + SPRING.replace("FREE", "0") + loop).solver
    found, messages = gradients(solver, [Final("x"), Final("y")], BY, method=way, **options)
    np.testing.assert_allclose(found.gradients[0, :4], derivatives(), rtol=1e-6)
    assert np.isnan(found.gradients[:, 4:]).all()
    assert len(messages) == 1
    assert "y0, w0 may not exist and are NaN: the motion passes ends that coincide in forces.f" in messages[0]


@WAYS
@pytest.mark.parametrize("options", METHODS, ids=IDS)
def test_a_spring_of_some_length_whose_ends_meet(made: Callable[..., Made], options: dict[str, Any], way: str) -> None:
    """Its force jumps there: all derivatives are lost, in steps of constant size, too."""
    solver = made(parsed, MODEL + SPRING.replace("FREE", "0.01")).solver
    found, messages = gradients(solver, [Final("x")], BY, method=way, **options)
    assert np.isnan(found.gradients).all() and any("ends that coincide in forces.f" in m for m in messages)


@WAYS
@pytest.mark.parametrize("options", METHODS, ids=IDS)
def test_a_distance_that_is_integrated_across_zero(
    made: Callable[..., Made], options: dict[str, Any], way: str
) -> None:
    """A distance has a kink at zero: derivatives of its integral are lost; those of a motion without it are exact."""
    solver = made(parsed, MODEL + "  f: {type: joint, joint: x, value: -k*q.x - c*u.x}\n").solver
    found, messages = gradients(solver, [Final("x")], BY, method=way, **options)
    np.testing.assert_allclose(found.gradients[0, :4], derivatives(), rtol=1e-6)
    assert not messages
    found, messages = gradients(solver, [Integral("d")], BY, method=way, **options)
    assert np.isnan(found.gradients[0, :4]).all() and any("ends that coincide in outputs.d" in m for m in messages)


@WAYS
def test_an_axis_that_turns_over(made: Callable[..., Made], way: str) -> None:
    """At half a turn of b across the axis the angle about it is not determined: derivatives beside this motion are lost."""
    law = "{type: torsion, from: {body: ground}, to: {body: c}, axis: x, stiffness: k, free_angle: f}"
    solver = made(parsed, SWING.replace("LAW", law)).solver
    for options in METHODS:
        found, messages = gradients(solver, [Final("c")], ["k", "w0"], method=way, p={"f": 0.0}, **options)
        assert np.isnan(found.gradients[0, 1]), (options, found.gradients, messages)
        assert any("half a turn across the axis in forces.s" in m for m in messages), (options, messages)


def test_a_turn_without_axis(made: Callable[..., Made]) -> None:
    """At half a turn the torque of a bushing jumps: derivatives are lost or the motion ends, and the place is named."""
    law = "{type: bushing, from: {body: ground}, to: {body: c}, rotational_stiffness: [k, k, k], rotational_preload: [f, 0, 0]}"
    solver = made(parsed, SWING.replace("LAW", law)).solver
    for options in METHODS:
        try:
            found, messages = gradients(solver, [Final("c")], ["k", "v0"], **options)
        except SimulationError as ended:
            assert "bushing s: one end is turned by half a turn" in str(ended)
        else:
            assert np.isnan(found.gradients).all() and any("half a turn in forces.s" in m for m in messages), options
