"""Contact forces such as ``max(0, -x)**1.5`` or ``sqrt(max(0, -x))``: derivatives across contacts, within the tolerance."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed

from codegen.runtime import Final, Integral

LAWS = {
    "k*max(0, -q.{0})**1.1": 1.1,
    "k*max(0, -q.{0})**n": 1.5,
    "k*(abs(q.{0}) - q.{0})**1.5/8**0.5": 1.5,
    "k*max(-q.{0}, 0)**2.5": 2.5,
    "if(q.{0} < 0, k*abs(q.{0})**1.3, 0)": 1.3,
    "0.25*k*sqrt(max(0, -q.{0})) + 0.375*k*sqrt(-4*min(q.{0}, 0))": 0.5,
    "if(q.{0} < 0, k*(q.{0}**2)**0.3, 0)": 0.6,
    "k*max(0, -q.{0})*sqrt(max(0, -q.{0}))": 1.5,
}
"""Forces on bodies that meet a wall at zero, and the exponents of the depth that they are proportional to."""

NAMES = [f"b{i}" for i in range(len(LAWS))]
TEXT = (
    "model: contact\nparameters: {k: 40.3, m: 1.3, x0: 0.31, v0: 1.7, n: 1.5}\nbodies:\n"
    + "".join(f"  {n}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: m}}\n" for n in NAMES)
    + "forces:\n"
    + "".join(
        f'  {n}: {{type: joint, joint: {n}, value: "{law.format(n)}"}}\n' for n, law in zip(NAMES, LAWS, strict=True)
    )
    + f"initial: {{q: {{{', '.join(f'{n}: x0 + {i}*0.013' for i, n in enumerate(NAMES))}}}, "
    + f"u: {{{', '.join(f'{n}: -v0' for n in NAMES)}}}}}\n"
    + f"outputs: {{{', '.join(f'{n}: {{value: q.{n}}}' for n in NAMES)}}}\n"
)
BY = ["k", "m", "x0", "v0"]


def rebound(p: float, ahead: float, end: float = 1.5) -> np.ndarray:
    """Derivatives of ``x(end) = v (end - T) - x0``, behind a contact of ``T = c (m v^2/k)^(1/(p + 1))/v``."""
    k, m, x0, v = 40.3, 1.3, 0.31 + ahead, 1.7
    of = 1 / (p + 1)
    depth = ((p + 1) * m * v**2 / (2 * k)) ** of
    T = 2 * depth / v * math.sqrt(math.pi) * math.gamma(1 + of) / math.gamma(0.5 + of)
    assert T + x0 / v < end
    return np.array([v * T * of / k, -v * T * of / m, -1.0, end - T - T * (2 * of - 1)])


@pytest.mark.parametrize("way", ["forward", "adjoint"])
@pytest.mark.parametrize(
    ("options", "allowed"),
    [({}, 2e-7), ({"rtol": 1e-6, "atol": 1e-6}, 5e-5), ({"integrator": "radau"}, 2e-6)],
    ids=["dop853", "dop853 loose", "radau"],
)
def test_rebound_from_contacts(made: Callable[..., Made], options: dict[str, Any], allowed: float, way: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solver = made(parsed, TEXT).solver
        found = solver.judge(1.5, [Final(n) for n in NAMES], wrt=BY, method=way, **options).gradients
    wanted = np.array([rebound(p, 0.013 * i) for i, p in enumerate(LAWS.values())])
    np.testing.assert_allclose(found, wanted, atol=allowed)


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_rebound_by_constant_steps(made: Callable[..., Made], way: str) -> None:
    """Derivatives across powers below one are NaN, with a warning."""
    solver, names = made(parsed, TEXT).solver, [f"{x}0.{n}" for n in NAMES for x in "qu"]
    with pytest.warns(RuntimeWarning, match="are unbounded"):
        found = solver.judge(
            1.5, [Final(n) for n in NAMES], wrt=names, method=way, integrator="rk4", step=1e-3
        ).gradients
    for i, p in enumerate(LAWS.values()):
        wanted = np.array([1.0, -1.0]) * rebound(p, 0.013 * i)[2:] if p > 1 else np.full(2, np.nan)
        np.testing.assert_allclose(found[i, 2 * i : 2 * i + 2], wanted, atol=1e-5)


def test_steps_are_graded_where_derivatives_are_taken_only(made: Callable[..., Made]) -> None:
    solver = made(parsed, TEXT).solver
    alone, along = solver.simulate(1.5), solver.simulate(1.5, sensitivities=BY)
    assert alone.stats["steps"] < along.stats["steps"] < 6 * alone.stats["steps"]
    np.testing.assert_allclose(alone.q[-1], along.q[-1], atol=1e-7)


DRIVEN = """
model: driven
parameters: {k: 90.0, a: 0.07, w: 3.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  r: {parent: x, joint: {type: revolute, axis: y}, mass: 0.3, com: [0.2, 0, 0.1], inertia: {xx: 0.02, yy: 0.02, zz: 0.02}}
forces:
  x: {type: joint, joint: x, value: "k*sqrt(max(0, a - q.x))*max(0, a - q.x) + 0.3*cos(w*t)"}
  r: {type: joint, joint: r, value: "-u.r*sqrt(abs(u.r)) - 9*q.r"}
initial: {q: {x: 0.3, r: 0.2}, u: {x: -0.7, r: 2}}
outputs: {x: {value: q.x}, r: {value: q.r}, work: {value: "u.x*sqrt(max(0, a - q.x))"}}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_roots_beside_forces_over_time(made: Callable[..., Made], integrator: str) -> None:
    """Forward and adjoint are the same to rounding, and what differences of motions are."""
    solver, names = made(parsed, DRIVEN).solver, ["k", "a", "w", "q0.x", "u0.r"]
    wanted = [Final("x"), Final("r"), Integral("work")]
    forward, adjoint = (
        solver.judge(0.9, wanted, wrt=names, method=m, integrator=integrator).gradients for m in ("forward", "adjoint")
    )
    np.testing.assert_allclose(forward, adjoint, atol=1e-11)
    p = np.array([90.0, 0.07, 3.0])
    for i in range(3):
        h = 1e-4 * p[i]
        high, low = (
            solver.judge(0.9, wanted, p=p + s * h * np.eye(3)[i], rtol=1e-13, atol=1e-13).values for s in (1, -1)
        )
        np.testing.assert_allclose(forward[:, i], (high - low) / (2 * h), atol=3e-6)


CANCELS = """
model: cancels
parameters: {k: 40.0, a: 0.1, J: 3.0}
bodies: {x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces:
  wall: {type: joint, joint: x, value: "LAW + if(q.x < a, J, 0)"}
initial: {q: {x: 0.337}, u: {x: -1.7}}
outputs: {x: {value: q.x}}
"""


@pytest.mark.parametrize(
    "part",
    ["(abs(q.x - a) - (q.x - a))/2", "0.5*abs(q.x - a) - q.x/2 + a/2", "(a - q.x + sqrt((a - q.x)**2))/2"],
)
def test_a_positive_part_that_is_a_difference(made: Callable[..., Made], part: str) -> None:
    """Rounding of ``abs(b) - b`` does not become negative: the base of a power keeps its value, and values are those of max."""
    found = made(parsed, CANCELS.replace("LAW", f"k*({part})**1.5")).solver
    exact = made(parsed, CANCELS.replace("LAW", "k*max(0, a - q.x)**1.5")).solver
    for options in ({}, {"integrator": "radau"}, {"integrator": "rk4", "step": 1e-3}):
        one, other = (s.judge(0.7, Final("x"), wrt=["k", "a", "J"], **options) for s in (found, exact))
        np.testing.assert_allclose(one.values, other.values, rtol=1e-10)
        np.testing.assert_allclose(one.gradients, other.gradients, rtol=1e-8, atol=1e-10)
