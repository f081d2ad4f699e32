"""Spatial loops with redundant conditions: a planar four-bar, Bennett's and Bricard's linkages, in any orientation.

Exact values come from the dense method in extended precision; Bennett's angles from the closed form
tan(a/2) tan(b/2) = sin((beta + alpha)/2)/sin((beta - alpha)/2).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard.errors import error, errors
from scipy.spatial.transform import Rotation

import codegen
from codegen.reference import DenseEngine

PLACE = "gx: 0.3, gy: -1.0, gz: -9.7, x: 0.0, y: 0.0, z: 0.0, roll: 0.0, pitch: 0.0, yaw: 0.0"
FRAME = "frame: {parent: ground, joint: {type: fixed, at: [x, y, z], rpy: [roll, pitch, yaw]}}"


def solid(mass: str) -> str:
    return (
        f"mass: {mass}, com: [0.3, 0.05, 0.1], inertia: {{xx: 0.02*{mass}, yy: 0.09*{mass}, zz: 0.1*{mass}, xy: 0.003}}"
    )


FOUR_BAR = f"""
model: four_bar
parameters: {{m1: 1.3, m2: 0.7, crank: 0.4, coupler: 1.2, {PLACE}}}
gravity: [gx, gy, gz]
bodies:
  {FRAME}
  one: {{parent: frame, joint: {{type: revolute, axis: z}}, {solid("m1")}}}
  two: {{parent: one, joint: {{type: revolute, axis: z, at: [crank, 0, 0]}}, {solid("m2")}}}
  three: {{parent: two, joint: {{type: revolute, axis: z, at: [coupler, 0, 0]}}, {solid("m2")}}}
loops:
  four: {{joint: {{type: revolute, axis: z}}, from: {{body: three, at: [0.9, 0, 0]}}, to: {{body: frame, at: [1.1, 0, 0]}}}}
initial: {{q: {{one: 0.8, two: -0.4, three: -1.9}}, u: {{one: 1.5}}}}
independent: [one]
"""
BENNETT = f"""
model: bennett
constants: {{alpha: 0.7, beta: 1.1}}
parameters: {{m1: 1.3, m2: 0.7, a: 1.0, b: sin(beta)/sin(alpha), {PLACE}}}
gravity: [gx, gy, gz]
bodies:
  {FRAME}
  one: {{parent: frame, joint: {{type: revolute, axis: z}}, {solid("m1")}}}
  two: {{parent: one, joint: {{type: revolute, axis: z, at: [a, 0, 0], rotate: [{{axis: x, angle: alpha}}]}}, {solid("m2")}}}
  three: {{parent: two, joint: {{type: revolute, axis: z, at: [b, 0, 0], rotate: [{{axis: x, angle: beta}}]}}, {solid("m2")}}}
loops:
  four: {{joint: {{type: revolute, axis: z}}, from: {{body: three, at: [a, 0, 0], rotate: [{{axis: x, angle: alpha}}]}},
         to: {{body: frame, at: [-b, 0, 0], rotate: [{{axis: x, angle: -beta}}]}}}}
initial:
  q: {{one: 1.0, two: 2*atan(sin((beta + alpha)/2)/sin((beta - alpha)/2)/tan(0.5)), three: -1.0}}
  u: {{one: 1.5}}
independent: [one]
"""
BRICARD = f"""
model: bricard
parameters: {{m1: 1.3, m2: 0.7, l: 1.0, {PLACE}}}
gravity: [gx, gy, gz]
bodies:
  {FRAME}
  one: {{parent: frame, joint: {{type: revolute, axis: y}}, {solid("m1")}}}
  two: {{parent: one, joint: {{type: revolute, axis: z, at: [l, 0, 0]}}, {solid("m2")}}}
  three: {{parent: two, joint: {{type: revolute, axis: x, at: [0, -l, 0]}}, {solid("m1")}}}
  four: {{parent: three, joint: {{type: revolute, axis: y, at: [0, 0, l]}}, {solid("m2")}}}
  five: {{parent: four, joint: {{type: revolute, axis: z, at: [-l, 0, 0]}}, {solid("m1")}}}
loops:
  six: {{joint: {{type: revolute, axis: x}}, from: {{body: five, at: [0, l, 0]}}, to: {{body: frame, at: [0, 0, l]}}}}
initial: {{u: {{one: 1.5}}}}
independent: [one]
"""
LOOPS = {  # model, redundant conditions of five, directions of parameters that keep it closed
    "planar": (FOUR_BAR, 3, ({"m1": 1.3}, {"crank": 0.4}, {"coupler": 1.2}, {"gx": 1.0})),
    "bennett": (BENNETT, 3, ({"m1": 1.3}, {"m2": 0.7}, {"a": 1.0, "b": np.sin(1.1) / np.sin(0.7)}, {"gx": 1.0})),
    "bricard": (BRICARD, 1, ({"m1": 1.3}, {"m2": 0.7}, {"l": 1.0}, {"gy": 1.0})),
}
STATES = ("accelerations", "sensitivities", "jacobians", "states")

TURNS = 20
"""Random orientations that each loop is put into."""


def directions(solver: Any, of_parameters: Any) -> dict[str, Any]:
    """Seeds of the parameters, of the independent coordinate and of its speed."""
    k = len(of_parameters)
    dp, dq, du = np.zeros((k + 2, solver.np)), np.zeros((k + 2, solver.nq)), np.zeros((k + 2, solver.nu))
    for row, changes in zip(dp, of_parameters, strict=False):
        for name, change in changes.items():
            row[solver.parameter_names.index(name)] = change
    dq[k, 0] = du[k + 1, 0] = 1.0
    return {"dq": dq, "du": du, "dp": dp}


@pytest.mark.parametrize("name", LOOPS)
def test_exact_and_redundancy_reported_in_any_orientation(name: str, build: Callable[..., Any]) -> None:
    text, redundant, of_parameters = LOOPS[name]
    solver = build(text, functions=STATES)
    assert f"{redundant} of 5 conditions are redundant" in solver_report(solver)
    q, u = solver.initial
    q, u = solver.assemble({"one": q[0] + 0.3}, u)
    seeds = directions(solver, of_parameters)
    witness = DenseEngine(codegen.parse_model(text), numbers="mpmath")
    exact, exact_along = witness.sensitivities(q, u, solver.parameters, **seeds)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, along = solver.sensitivities(q, u, **seeds)
        assert error(found, exact) < 1e-13
        assert max(errors(along, exact_along)) < 1e-12
        rng = np.random.default_rng(1)
        for R in Rotation.random(TURNS, rng=rng):
            yaw, pitch, roll = R.as_euler("ZYX")
            p = solver.parameters.copy()
            i = solver.parameter_names.index("gx")
            p[i : i + 9] = [*R.apply(p[i : i + 3]), *rng.uniform(-100, 100, 3), roll, pitch, yaw]
            turned = {**seeds, "dp": seeds["dp"].copy()}
            turned["dp"][:, i : i + 3] = R.apply(turned["dp"][:, i : i + 3])
            q_there, u_there = solver.assemble({"one": q[0]}, u, p)
            np.testing.assert_allclose(q_there, q, rtol=0, atol=1e-13)
            found, along = solver.sensitivities(q_there, u_there, p, **turned)
            # places 100 m away have conditions with 1e-14 of rounding
            assert error(found, exact) < 1e-11
            assert max(errors(along, exact_along)) < 1e-10


def test_bennett_closes_as_its_closed_form_says(build: Callable[..., Any]) -> None:
    solver = build(BENNETT, functions=STATES)
    q, u = solver.initial
    ratio = np.sin(0.9) / np.sin(0.2)
    for angle in np.linspace(0.5, 5.5, 11):
        q, u = solver.assemble({"one": angle, "two": q[1], "three": q[2]}, u)
        other = 2 * np.arctan(ratio / np.tan(angle / 2))
        np.testing.assert_allclose(
            np.sin(q[1:] / 2) ** 2, np.sin(np.array([other, angle]) / 2) ** 2, rtol=0, atol=1e-14
        )
        # (tan(a/2) tan(b/2))' = 0
        assert u[1] == pytest.approx(-u[0] * np.sin(other) / np.sin(angle), rel=1e-12)


def test_a_length_alone_opens_bennetts_linkage_and_every_function_says_so(build: Callable[..., Any]) -> None:
    solver = build(BENNETT, functions=STATES)
    q, u = solver.initial
    for name in ("sensitivities", "assemble_sensitivities"):
        with pytest.warns(RuntimeWarning, match=r"parameter a opens the redundant condition four\.\w+ by"):
            getattr(solver, name)(q, u, dp={"a": 1.0})
    with pytest.warns(RuntimeWarning, match=r"parameter a opens the redundant condition four\.\w+ by"):
        solver.jacobians(q, u)


def solver_report(solver: Any) -> str:
    """The messages about the loops."""
    return "\n".join(solver._manifest["description"])
