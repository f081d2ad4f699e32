"""Straight and coiled planar chains of 10, 100 and 1000 rods: errors do not follow the condition of the mass matrix.

Total length 1 m and mass 1 kg. In hinge angles the mass matrix has condition 4e4, 4e8 and 4e12 (straight) and 2e4, 1e6 and 1e8
(coiled). The exact udot and its derivatives are computed in 60 digits from the forces in the hinges (`hard.rods`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from comparison import error as relative
from comparison import worst
from hard.errors import error, errors
from hard.rods import accelerations

import codegen
from codegen.reference import RecursiveEngine

MODEL = """
model: rods
constants: {{n: {n}}}
parameters: {{g: 9.81, L: {part}, m: {part}, first: {part}}}
gravity: [0, 0, -g]
bodies:
  repeat k in 1..n:
    rod(k):
      parent: rod(k-1)
      joint: {{type: revolute, axis: -y, at: [0, 0, -L]}}
      shape: {{type: rod, axis: z, length: L, mass: m, center: [0, 0, -L/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}, shape: {{mass: first}}}}
"""
ENOUGH = {10: 1e-14, 100: 2e-14, 1000: 4e-14}
"""What is left of sixteen digits, in parts of the largest entry of each direction."""

Array = np.ndarray


def coordinates(form: str, n: int) -> tuple[Array, Array]:
    """Hinge angles, and speeds: 22.5 degrees in every hinge; or a rod as a whole, a radian off the vertical; or random."""
    q = {
        "coiled": np.full(n, np.pi / 8),
        "straight": np.zeros(n),
        "wavy": np.random.default_rng(1).uniform(-0.3, 0.3, n),
    }
    if form == "straight":
        q[form][0] = 1.0
    return q[form.partition(" ")[0]], np.zeros(n) if "at rest" in form else np.sin(1.0 + np.arange(n))


def condition_of_mass_matrix(q: Array) -> float:
    """Condition of the mass matrix in hinge angles, from velocities of the rods' centres and angular velocities."""
    n = len(q)
    angle = np.cumsum(q)
    along = np.stack([np.cos(angle), np.sin(angle)]) / n  # how the far end moves with the rod's angle
    J = np.zeros((2, n, n))
    for k in range(n):
        J[:, k, :k], J[:, k, k] = along[:, :k], along[:, k] / 2
    of_angles = sum(x.T @ x for x in J) / n + np.eye(n) / (12 * n**3)
    hinges = np.tril(np.ones((n, n)))
    return float(np.linalg.cond(hinges.T @ of_angles @ hinges))


FORMS = ("straight", "coiled", "coiled at rest", "wavy")
CASES = [
    pytest.param(n, form, marks=[pytest.mark.campaign] if n == 1000 and "coiled" not in form else [])
    for n in ENOUGH
    for form in FORMS
]


@pytest.mark.parametrize("n, form", CASES)
def test_errors_do_not_follow_the_condition(build: Callable[..., Any], n: int, form: str) -> None:
    solver = build(MODEL.format(n=n, part=repr(1 / n)))
    q, u = coordinates(form, n)
    rng = np.random.default_rng(n)
    any_dq, any_du, one, none = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), np.ones(n), np.zeros(n)
    moving = form in ("coiled", "wavy")  # at rest nothing follows u; straight and swinging as one rod neither
    dq = [any_dq, one, none, none, none, *[none] * moving]
    du = [none, none, none, none, none, *[any_du] * moving]
    dp = [np.zeros(4), np.zeros(4), *np.eye(4)[1:], *[np.zeros(4)] * moving]
    found, along = solver.sensitivities(q, u, dq=dq, du=du, dp=dp)
    part, first = 1 / n, np.eye(n)[0]
    exact, exact_along = accelerations(
        q, u, [part] * n, [part] * n, k=len(dq), dq=dq, du=du, dlengths=[none, none, one, none, none, *[none] * moving],
        dmasses=[none, none, none, one - first, first, *[none] * moving],
    )  # fmt: skip
    assert error(found, exact) < 1e-14
    assert max(errors(along, exact_along)) < ENOUGH[n]


@pytest.mark.parametrize("form", ["coiled", "coiled at rest"])
@pytest.mark.parametrize("n", [100, pytest.param(1000, marks=pytest.mark.campaign)])
def test_small_derivatives_keep_their_digits(build: Callable[..., Any], n: int, form: str) -> None:
    """By the angle of a joint far out on a coil, of rods that all but fall freely: down to 1e-166 of the largest.

    They are products over all joints on the way, of factors that are alike: half a unit in the last place for each may add up.
    """
    solver = build(MODEL.format(n=n, part=repr(1 / n)))
    q, u = coordinates(form, n)
    dq = np.eye(n)[[n // 4, n // 2, n - 1]]
    _, along = solver.sensitivities(q, u, dq=dq)
    _, exact = accelerations(q, u, [1 / n] * n, [1 / n] * n, k=len(dq), dq=dq)
    assert max(errors(along, exact)) < max(4e-14, n * 2.0**-53)


@pytest.mark.parametrize(
    "form, n, expected",
    [
        ("straight", 10, 4.4e4),
        ("straight", 100, 4.0e8),
        ("straight", 1000, 3.9e12),
        ("coiled", 10, 2.0e4),
        ("coiled", 100, 1.1e6),
        ("coiled", 1000, 1.1e8),
    ],
)
def test_the_condition_is_what_is_said(form: str, n: int, expected: float) -> None:
    assert condition_of_mass_matrix(coordinates(form, n)[0]) == pytest.approx(expected, rel=0.05)


BRANCHED = """
model: branched
constants: {n: 42}
parameters: {L: 0.1, m: 0.1}
gravity: [0, 0, -9.81]
bodies:
  repeat k in 1..n:
    rod(k):
      parent: rod(k-1)
      joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -L]}
      shape: {type: cylinder, axis: z, length: L, radius: 0.02, mass: m, center: [0, 0, -L/2]}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
      last: {joint: {at: [0.1*L, 0.2*L, -L], rpy: [0.1, L, 0.3]}}
    side(k): {parent: rod(k), joint: {type: spherical, at: [L, 0, 0]}, mass: m, com: [0.1*L, 0, -L],
              inertia: {xx: 0.01*m, yy: 0.01*m, zz: 0.01*m}}
initial:
  q: {repeat k in 1..n: {rod(k): 0.3*sin(k)}}
  u: {repeat k in 1..n: {rod(k): cos(k)}}
"""
TIED = """
loops:
  tip: {joint: {type: spherical}, from: {body: rod(n), at: [0, 0, -L]}, to: {body: ground, at: [0.4*L*n, 0.1*L, -0.6*L*n]}}
"""


@pytest.mark.parametrize("loop", ["", TIED], ids=["tree", "tip tied"])
def test_long_chains_with_branches_against_the_generic_engine(loop: str, build: Callable[..., Any]) -> None:
    text = BRANCHED + loop
    solver = build(text, functions=("accelerations", "sensitivities", "gradients"), target="both" if loop else "numpy")
    engine = RecursiveEngine(codegen.parse_model(text))
    rng = np.random.default_rng(0)
    q, u = solver.initial
    free_q = [solver.coordinate_names.index(x) for x in solver.independent_names]
    dq, du, dp = np.zeros((3, solver.nq)), np.zeros((3, solver.nu)), np.array([[0, 0], [0, 0], [1, -0.5]])
    dq[0, free_q] = rng.uniform(-1, 1, len(free_q))
    du[1] = rng.uniform(-1, 1, solver.nu)
    seeds = {"dq": dq, "du": du, "dp": dp}
    (a, da), (b, db) = (of.sensitivities(q, u, **seeds) for of in (solver, engine))
    assert relative(a, b) < 1e-11
    assert worst(da, db) < 1e-10
    weights = rng.uniform(-1, 1, solver.nu)
    back = solver.gradients(q, u, weights=weights)
    for i, along in enumerate(da):
        products = np.concatenate([back.q[0] * dq[i], back.u[0] * du[i], back.p[0] * dp[i]])
        assert weights @ along == pytest.approx(products.sum(), abs=1e-12 * np.abs(products).sum())


@pytest.mark.parametrize("form", ["coiled", "wavy"])
def test_columns_computed_at_once_keep_their_digits(build: Callable[..., Any], form: str) -> None:
    """Columns of the Jacobians, each in parts of its own largest entry."""
    n, some = 100, [0, 25, 50, 99]
    q, u = coordinates(form, n)
    solver = build(MODEL.format(n=n, part=repr(1 / n)), functions=("accelerations", "jacobians"), target="c")
    J = solver.jacobians(q, u, wrt="q, u")
    for name, matrix in (("dq", J.q), ("du", J.u)):
        _, exact = accelerations(q, u, [1 / n] * n, [1 / n] * n, k=len(some), **{name: np.eye(n)[some]})
        assert max(errors(list(matrix.T[some]), exact)) < 4e-14
