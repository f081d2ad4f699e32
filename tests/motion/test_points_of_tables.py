"""Derivatives of motions across points of cubic tables and ends of ``step``, where third derivatives jump."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from motion.models import Drawn, Made, parsed

from codegen.runtime import Final, Integral

PASSING = """
model: passing
parameters: {v: 1.7, s: 0.4, w: 0.05, k: 3.0}
tables: {bump: {x: [0, 0.1, 0.2, 0.4], y: [0, 0.7, 1, 0], kind: cubic, outside: constant}}
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces: {pull: {type: joint, joint: b, value: -k*q.b}}
initial: {q: {b: 1}, u: {a: v}}
outputs:
  risen: {value: "step(q.a, s, s + w)"}
  bumped: {value: bump(q.a - s)}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("method", ["forward", "adjoint"])
def test_integrals(made: Callable[..., Made], integrator: str, method: str) -> None:
    """The body passes at constant speed, so an integral over the time is one over the place; before, errors of 1e-5 to 1e-3."""
    solver = made(parsed, PASSING).solver
    found = solver.judge(
        1.0, [Integral("risen"), Integral("bumped")], wrt=("s", "v"), method=method, integrator=integrator
    )
    v, s, w = (solver.parameters[solver.parameter_names.index(n)] for n in "vsw")
    area = (found.values[1] * v).item()
    exact = [[-1.0 / v, (s + w / 2) / v**2], [0.0, -area / v**2]]
    np.testing.assert_allclose(found.gradients, exact, rtol=0, atol=2e-7)


CAM = """
model: turning_cam
gravity: [0, 0, -9.81]
parameters: {base: 0.02, lift: 0.006, tau: 0.2, preload: 20}
tables:
  profile:
    x: [0 deg, 60 deg, 90 deg, 120 deg, 150 deg, 180 deg, 210 deg, 240 deg, 300 deg]
    y: [0, 0, 0.04, 0.46, 1, 0.46, 0.04, 0, 0]
    kind: cubic
    outside: periodic
    period: 360 deg
bodies:
  cam: {parent: ground, joint: {type: revolute, axis: y}, mass: 2, inertia: {xx: 2e-3, yy: 2e-3, zz: 2e-3}}
  follower: {parent: ground, joint: {type: prismatic, axis: z}, mass: 0.1}
loops:
  contact:
    joint: {type: surface, equation: "sqrt(x**2 + z**2) - base - lift*profile(atan2(x, z))"}
    from: cam
    to: follower
forces:
  motor: {type: joint, joint: cam, value: tau - 0.002*u.cam}
  spring: {type: joint, joint: follower, value: -preload - 2000*q.follower}
initial: {q: {follower: 0.02}, u: {cam: 60.0}}
outputs: {speed: {value: u.cam}}
independent: [cam]
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_a_cam_that_turns(made: Callable[..., Made], integrator: str) -> None:
    """Accelerations have the kinks of the profile's second derivative; before, errors of 1e-3 to 4e-3 in the derivatives.

    Differences of motions at 1e-13, with changes of 1e-3, agree with the reference to 1e-5.
    """
    solver = made(parsed, CAM).solver
    names = ("base", "lift", "tau", "preload")
    fine = {"rtol": 1e-13, "atol": 1e-14, "atol_sensitivities": 1e-10}
    exact = solver.simulate([0.0, 0.3], sensitivities=names, **fine).doutputs[:, -1, 0]
    found = solver.judge(0.3, Final("speed"), wrt=names, integrator=integrator)
    np.testing.assert_allclose(found.gradients[0], exact, rtol=1e-5)


RANDOM = """
model: random_tables
gravity: [0, 0, -2]
parameters: {{s: {s}, f: {f}}}
tables: {{one: {one}, two: {two}}}
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, com: [0, 0, -0.2], inertia: {{xx: 0.1, yy: 0.3, zz: 0.1}}}}
  b:
    parent: a
    joint: {{type: revolute, axis: y, at: [0, 0, -0.5]}}
    mass: 0.5
    com: [0, 0, -0.3]
    inertia: {{xx: 0.1, yy: 0.2, zz: 0.1}}
forces:
  on_a: {{type: joint, joint: a, value: "{on_a} - 0.1*u.a"}}
  on_b: {{type: joint, joint: b, value: "{on_b} - 0.1*u.b"}}
initial: {{q: {{a: {qa}, b: {qb}}}, u: {{a: {ua}, b: {ub}}}}}
outputs: {{a: {{value: q.a}}, v: {{value: u.b}}, g: {{value: "{integrated}"}}}}
"""
ARGUMENTS = ("q.a - s", "2*q.b - s", "0.3*u.a", "1.3*t - s", "sin(3*q.a) + s", "q.a + q.b - s", "one(q.a)")
TERMS = ("f*{}({})", "-f*{}({})**2", "f*step({}({}), -0.5, 0.5)")


def random_tables(seed: int) -> Drawn:
    """A double pendulum with forces and an integrated output of two random cubic tables, which are bounded."""
    rng = np.random.default_rng(seed)

    def table() -> str:
        n = rng.integers(3, 7)
        x = np.cumsum(rng.uniform(0.1, 0.5, n)) - 1.0
        return f"{{x: {x.round(3).tolist()}, y: {rng.uniform(-1, 1, n).round(3).tolist()}, kind: cubic, outside: constant}}"

    def term() -> str:
        return str(rng.choice(TERMS)).format(rng.choice(["one", "two"]), rng.choice(ARGUMENTS))

    numbers = rng.uniform([-0.3, 1, -1, -1, -3, -3], [0.3, 4, 1, 1, 3, 3]).round(3)
    values = dict(zip(("s", "f", "qa", "qb", "ua", "ub"), numbers, strict=True))
    return parsed(RANDOM.format(**values, one=table(), two=table(), on_a=term(), on_b=term(), integrated=term()))


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.campaign) for i in range(1, 60))])
def test_random_models(made: Callable[..., Made], seed: int) -> None:
    """Motions at 1e-13, whose derivatives have error control of their own, are the reference."""
    solver = made(random_tables, seed).solver
    functionals, names = [Final("a"), Final("v"), Integral("g")], ("s", "f", "u0.a")
    fine = solver.simulate([0.0, 1.5], sensitivities=names, rtol=1e-13, atol=1e-14, atol_sensitivities=1e-11)
    closest = solver.judge(1.5, functionals, wrt=names, rtol=1e-12, atol=1e-13).gradients
    scale = 1.0 + np.abs(closest)
    assert (np.abs(closest[:2] - fine.doutputs[:, -1, :2].T) / scale[:2]).max() < 1e-7
    for integrator, allowed in (("dop853", 1e-6), ("radau", 5e-6)):
        for method in ("forward", "adjoint"):
            found = solver.judge(1.5, functionals, wrt=names, method=method, integrator=integrator).gradients
            assert (np.abs(found - closest) / scale).max() < allowed, (integrator, method)
