"""Equilibria and linearisations where a loop loses rank, or at a dead point of the independent coordinate: messages."""

import math
import warnings

import numpy as np
import pytest

LINKS = """model: links
gravity: [0, 0, -9.81]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -0.5], inertia: {xx: 1, yy: 0.1, zz: 1}}
"""
PARALLELOGRAM = (
    LINKS
    + """  b:
    parent: ground
    joint: {type: revolute, axis: y, at: [0, 0, -2]}
    mass: 1
    com: [0, 0, -0.5]
    inertia: {xx: 1, yy: 0.1, zz: 1}
loops:
  rod: {joint: {type: distance, length: 2}, from: {body: a, at: [0, 0, -1]}, to: {body: b, at: [0, 0, -1]}}
initial:
  q: {a: 0.3, b: 0.3}
independent: [a]
"""
)
"""It hangs at rest in its flat pose."""
SLIDER = (
    LINKS
    + """  s: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}
loops:
  rod: {joint: {type: distance, length: 2}, from: {body: a, at: [0, 0, -1]}, to: s}
initial:
  q: {a: 0.3, s: -2.9}
independent: [INDEPENDENT]
"""
)
"""It hangs at rest with its crank and its rod in one line: a dead point of the slider, not of the crank."""


@pytest.fixture(scope="module")
def slider(build):
    return build(SLIDER.replace("INDEPENDENT", "s"), partitions=2, functions=None)


def test_a_flat_pose_leaves_stability_open(build):
    """A closure of condition 1e13 gave "stable" and an eigenvalue of -24.1 where 14.01 is right along its branch."""
    solver = build(PARALLELOGRAM, functions=None)
    with pytest.warns(
        RuntimeWarning, match=r"equilibrium: loop rod has nearly lost rank at a=.*, b=.*condition number of its"
    ):
        found = solver.equilibrium()
    assert found.stable is None and abs(found.q).max() < 1e-6
    with pytest.warns(RuntimeWarning, match=r"linearize: loop rod has nearly lost rank at a="):
        solver.linearize(found.q)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solver.linearize([0.3, 0.3])


@pytest.mark.parametrize("tolerance", [1e-9, 1e-6, 1e-4])
def test_a_dead_point_of_the_independent_coordinate_names_the_better_choice(slider, tolerance):
    slider.use_partition(0)
    assert slider.independent_names == ("s",)
    with pytest.warns(
        RuntimeWarning, match=r"nearly lost rank at .*use_partition\(1\), where the condition number is 1, then"
    ):
        found = slider.equilibrium(tolerance=tolerance)
    assert found.stable is None


def test_by_the_better_choice_nothing_is_said(slider):
    slider.use_partition(1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = slider.equilibrium()
        values = slider.linearize(found.q).eigenvalues()
    assert found.stable is True
    np.testing.assert_allclose(found.q, [0.0, -3.0], rtol=0, atol=1e-12)
    # crank: weight at 0.5 m; slider: rises by (1 + 1/2)/2*a^2, and is massless to second order
    rate = math.sqrt(9.81 * (0.5 + 1.5) / 0.35)
    np.testing.assert_allclose(abs(values), rate, rtol=1e-9)
