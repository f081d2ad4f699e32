"""Chains with extreme masses, speeds and angles, against the dense method in extended precision and `hard.rods`.

Inertias that differ by ten powers of ten, massless and nearly massless links inside a run of joints, 1e4 rad/s, 1e6 rad.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard.errors import by_scale, error, errors
from hard.rods import accelerations

import codegen
from codegen.reference import DenseEngine
from codegen.runtime import SingularJointError

BODY = "com: [0.1, 0.05, -L/2], inertia: {xx: 0.04*M, yy: 0.05*M, zz: 0.03*M, xy: 0.002*M}"
ARM = """
model: arm
parameters: {g: 9.81, L: 0.7, a: 1.0, b: 1.0, c: 1.0, d: 1.0}
gravity: [0, 0, -g]
bodies:
""" + "".join(
    f"  {name}: {{parent: {parent}, joint: {{{joint}, at: {at}}}, mass: {mass}, {BODY.replace('M', mass)}}}\n"
    for name, parent, joint, at, mass in (
        ("first", "ground", "type: revolute, axis: y", "[0, 0, 0]", "a"),
        ("second", "first", "type: universal, axes: [x, y]", "[0, 0, -L]", "b"),
        ("third", "second", "type: spherical", "[0, 0, -L]", "c"),
        ("fourth", "third", "type: revolute, axis: [1, 0, 1]", "[0, 0, -L]", "d"),
    )
)
Q = np.array([-0.48, -0.4, 0.63, 0.5, 0.5, -0.5, 0.5, 0.3])
U = np.array([0.9, -0.7, 0.4, 0.2, -0.8, 0.6, -0.3])

RODS = """
model: rods
parameters: {g: 9.81, L: 0.5, m0: 1.0, m1: 1.0, m2: 1.0, m3: 1.0, m4: 1.0, m5: 1.0}
gravity: [0, 0, -g]
bodies:
  rod0:
    parent: ground
    joint: {type: revolute, axis: -y}
    shape: {type: rod, axis: z, length: L, mass: m0, center: [0, 0, -L/2]}
""" + "".join(
    f"  rod{k}: {{parent: rod{k - 1}, joint: {{type: revolute, axis: -y, at: [0, 0, -L]}}, "
    f"shape: {{type: rod, axis: z, length: L, mass: m{k}, center: [0, 0, -L/2]}}}}\n"
    for k in range(1, 6)
)


@pytest.fixture(scope="module")
def arm(build: Callable[..., Any]) -> Any:
    return build(ARM)


@pytest.fixture(scope="module")
def witness() -> Any:
    return DenseEngine(codegen.parse_model(ARM), numbers="mpmath")


def compared(arm: Any, witness: Any, masses: Any, q: Any = Q, u: Any = U) -> tuple[float, list[float], list[float]]:
    """Errors of udot and of its derivatives with respect to length, masses, q and u; also relative to udot."""
    p = np.array([9.81, 0.7, *masses])
    rng = np.random.default_rng(0)
    dq, du, dp = np.zeros((7, 8)), np.zeros((7, 7)), np.zeros((7, 6))
    dp[:5, 1:] = np.eye(5)
    dq[5], du[6] = rng.uniform(-1, 1, 8), rng.uniform(-1, 1, 7)
    found, along = arm.sensitivities(q, u, p, dq=dq, du=du, dp=dp)
    exact, exact_along = witness.sensitivities(q, u, p, dq=dq, du=du, dp=dp)
    steps = [*p[1:], 1.0, np.abs(u).max()]
    return error(found, exact), errors(along, exact_along), by_scale(along, exact_along, exact, steps)


def test_lighter_and_lighter_outward(arm: Any, witness: Any) -> None:
    """1 to 1e-10 kg: nothing of udot is lost; derivatives by the masses that hardly matter lose digits."""
    of_udot, along, scaled = compared(arm, witness, 10.0 ** (-10 / 3 * np.arange(4)))
    assert of_udot < 1e-14
    assert max(scaled) < 1e-13
    assert max(along) < 1e-10 and max(along[0], *along[5:]) < 1e-14


def test_heavier_and_heavier_outward(arm: Any, witness: Any) -> None:
    """1 to 1e10 kg: what moves the light links is a difference of what holds the heavy ones. The dense method loses as much."""
    of_udot, along, scaled = compared(arm, witness, 10.0 ** (10 / 3 * np.arange(4)))
    assert of_udot < 1e-11
    assert max(scaled) < 1e-10
    assert max(along) < 1e-5


@pytest.mark.parametrize("masses, most", [((1, 0, 1, 1), 1e-13), ((1, 1, 0, 1), 1e-12), ((1, 1e-12, 1, 1), 1e-13)])
def test_massless_and_nearly_massless_links_inside(arm: Any, witness: Any, masses: Any, most: float) -> None:
    of_udot, _, scaled = compared(arm, witness, masses)
    assert of_udot < most / 10
    assert max(scaled) < most


def test_two_massless_links_in_a_row(arm: Any, witness: Any) -> None:
    """Six turns reach the last body, which shows them all; but not where the third body lies across the second, as in Q."""
    q = np.r_[Q[:3], np.array([0.5, 0.1, -0.6, 0.2]) / np.sqrt(0.66), Q[7]]
    of_udot, _, scaled = compared(arm, witness, (1, 0, 0, 1), q=q)
    assert of_udot < 1e-13
    assert max(scaled) < 1e-12
    with pytest.raises(SingularJointError, match=r"nothing outboard of joint second\.\d has positive inertia about it"):
        arm.accelerations(Q, U, [9.81, 0.7, 1, 0, 0, 1])
    with pytest.raises(SingularJointError, match="joint fourth"):
        arm.accelerations(Q, U, [9.81, 0.7, 1, 1, 1, 0])


@pytest.mark.parametrize("masses", [(1, 1, 1, 1e-12), (1, 1e-6, 1e-6, 1)])
def test_nearly_massless_links_at_the_end_and_in_a_row(arm: Any, witness: Any, masses: Any) -> None:
    """In that pose two of 1e-6 kg that a heavier one hangs on lose six digits, by any method; a light last one none."""
    of_udot, _, scaled = compared(arm, witness, masses)
    last = masses[3] < 1
    assert of_udot < (1e-14 if last else 1e-9)
    assert max(scaled) < (1e-12 if last else 1e-8)


def test_spin(arm: Any, witness: Any) -> None:
    of_udot, along, _ = compared(arm, witness, (1, 1, 1, 1), u=1e4 * U)
    assert of_udot < 2e-14
    assert max(along) < 5e-14


def test_angles_of_many_turns(arm: Any, witness: Any) -> None:
    far = np.r_[1e6 * Q[:3], Q[3:7], 1e6 * Q[7]]
    of_udot, along, _ = compared(arm, witness, (1, 1, 1, 1), q=far)
    assert of_udot < 2e-14
    assert max(along) < 1e-13


@pytest.mark.parametrize("ratio", [1e-2, 1e2], ids=["lighter", "heavier"])
def test_rods_whose_masses_differ_by_ten_powers_of_ten(build: Callable[..., Any], ratio: float) -> None:
    """In a plane a hinge passes on the inertia along the rod only; both ways keep nearly all digits."""
    solver = build(RODS)
    masses, none = ratio ** np.arange(6), np.zeros(6)
    q, u = np.array([0.9, -0.4, 0.7, 1.1, -0.8, 0.5]), np.array([1.0, -0.5, 0.3, 0.8, -1.2, 0.4])
    dp = np.zeros((7, 8))
    dp[:, 1:] = np.eye(7)
    found, along = solver.sensitivities(q, u, [9.81, 0.5, *masses], dp=dp)
    exact, exact_along = accelerations(
        q, u, [0.5] * 6, masses, k=7, dlengths=[none + 1, *[none] * 6], dmasses=[none, *np.eye(6)]
    )
    assert error(found, exact) < 1e-12
    assert max(by_scale(along, exact_along, exact, [0.5, *masses])) < 1e-11
    assert max(errors(along, exact_along)) < 1e-5
