"""The same mechanism from a nanometre to a thousand kilometres: results scale with their dimensions, to rounding.

A slider-crank in space with a pendulum on a ball joint, a spring, a motor: lengths are scaled by L, masses by M, times by T. All
else has to follow, whether the model is generated in that size or its parameters are changed at run time.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

MODEL = """
model: press
constants: {L: LENGTH, M: MASS, T: TIME}
parameters:
  {g: 9.81*L/T**2, crank: 0.5*L, rod: 1.3*L, offset: 0.02*L, mass: 2.0*M, flywheel: 0.5*M*L**2, k: 30*M/T**2, c: 2*M/T,
   free: 0.3*L, brake: 0.1*M*L**2/T}
inputs: [motor]
gravity: [0, 0, -g]
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: -y}, inertia: {xx: flywheel, yy: flywheel, zz: flywheel}}
  rod:
    parent: crank
    joint: {type: revolute, axis: -y, at: [crank, 0, 0]}
    shape: {type: rod, axis: x, length: rod, mass: mass, center: [rod/2, 0, 0]}
  piston: {parent: ground, joint: {type: prismatic, axis: x, at: [0, 0, -offset]}, mass: mass}
  pendulum:
    parent: piston
    joint: {type: spherical, at: [0, 0, -offset]}
    mass: mass/3
    com: [0.1*crank, 0, -crank/2]
    inertia: {xx: 0.1*mass*crank**2, yy: 0.2*mass*crank**2, zz: 0.15*mass*crank**2}
loops:
  pin: {joint: {type: revolute, axis: -y}, from: {body: rod, at: [rod, 0, 0]}, to: piston}
forces:
  strut: {type: spring, from: {body: rod, at: [rod/2, 0, 0]}, to: {body: ground, at: [0, 0.2*crank, -2*crank]},
          stiffness: k, damping: c, free_length: free}
  drive: {type: joint, joint: crank, value: motor - brake*u.crank}
initial:
  q: {crank: 0.9, rod: -1.3, piston: 1.5*L, pendulum: [0.8, 0.6, 0, 0]}
  u: {crank: 3/T, pendulum.wx: 1/T, pendulum.wz: 0.5/T}
independent: [crank]
"""
SIZES = (1e-9, 1e-6, 1e-3, 1e3)
Q, U = np.array([0, 0, 1, 0, 0, 0, 0]), np.array([0, 0, 1, 0, 0, 0])
"""Powers of L in coordinates, and in speeds, which are by T too."""

OF_PARAMETERS = np.array(
    [(1, 0, -2), (1, 0, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0), (2, 1, 0), (0, 1, -2), (0, 1, -1), (1, 0, 0), (2, 1, -1)]
)
"""Powers of L, M and T."""


class Scaled:
    """A mechanism of a given size; its results are divided by the units with which they scale."""

    def __init__(self, solver: Any, L: float, M: float, T: float, p: Any = None):
        self.solver, self.p = solver, p
        self.q, self.u = L**Q, L**U / T
        self.of_p = np.prod(np.array([L, M, T]) ** OF_PARAMETERS, axis=1)
        self.torque = M * L * L / T**2
        self.T = T
        guess = np.array([0.9, -1.1, 1.3, 0.8, 0.6, 0.0, 0.0])
        self.state = solver.assemble(guess * self.q, np.array([3.0, 0, 0, 1.0, 0, 0.5]) * self.u, p)

    def accelerations(self) -> tuple[Any, Any]:
        """udot, and its change for a change of each coordinate, speed, parameter and input by its own value."""
        sizes = [self.q, self.u, self.of_p, np.array([self.torque])]
        ends = np.cumsum([len(x) for x in sizes])
        seeds = [np.zeros((ends[-1], len(x))) for x in sizes]
        for seed, size, end in zip(seeds, sizes, ends, strict=True):
            seed[end - len(size) : end] = np.diag(size)
        names = ("dq", "du", "dp", "dinputs")
        a, da = self.solver.sensitivities(
            *self.state, self.p, [0.7 * self.torque], **dict(zip(names, seeds, strict=True))
        )
        return a / self.u * self.T, da / self.u * self.T

    def motion(self) -> tuple[Any, ...]:
        """Coordinates, speeds and their derivatives after 0.5 and 1.5 units of time."""
        by = ("g", "crank", "rod", "mass", "k", "u0.crank")
        found = self.solver.simulate(
            np.array([0, 0.5, 1.5]) * self.T, *self.state, self.p, [0.7 * self.torque], sensitivities=by,
            atol=1e-11 * np.r_[self.q, self.u], rtol=1e-11,
        )  # fmt: skip
        steps = np.r_[self.of_p[[0, 1, 2, 4, 6]], self.u[0]][:, None, None]
        return found.q / self.q, found.u / self.u, found.dq / self.q * steps, found.du / self.u * steps


def text(L: float, M: float, T: float) -> str:
    return MODEL.replace("LENGTH", repr(L)).replace("MASS", repr(M)).replace("TIME", repr(T))


def sizes(L: float) -> tuple[float, float, float]:
    """Length, mass and time of a mechanism of that size: as heavy as its volume, moving as under the same gravity."""
    return L, 1.7 * L**3, 1.3 * L**0.5


@pytest.fixture(scope="module")
def one(build: Callable[..., Any]) -> Scaled:
    """The mechanism at a size of one metre."""
    return Scaled(
        build(text(1.0, 1.0, 1.0), target="c", functions=("motion", "accelerations", "sensitivities")), 1.0, 1.0, 1.0
    )


@pytest.fixture(scope="module")
def expected(one: Scaled) -> Any:
    return one.accelerations(), one.motion()


@pytest.mark.parametrize("L", SIZES)
def test_with_other_parameters(one: Scaled, expected: Any, L: float) -> None:
    (a, da), motion = expected
    here = Scaled(one.solver, *sizes(L), p=one.solver.parameters * np.prod(np.array(sizes(L)) ** OF_PARAMETERS, axis=1))
    np.testing.assert_allclose(here.state[0] / here.q, one.state[0], rtol=0, atol=1e-14)
    same(here.accelerations(), (a, da), 2e-14)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # derivatives by what is small are large, but not chaotic
        for found, exact in zip(here.motion(), motion, strict=True):
            np.testing.assert_allclose(found, exact, rtol=0, atol=2e-9 * np.abs(exact).max())


@pytest.mark.parametrize("L", [1e-6, 1e3, 1e6])
def test_generated_in_that_size(one: Scaled, expected: Any, build: Callable[..., Any], L: float) -> None:
    here = Scaled(build(text(*sizes(L))), *sizes(L))
    np.testing.assert_allclose(here.state[0] / here.q, one.state[0], rtol=0, atol=1e-14)
    same(here.accelerations(), expected[0], 2e-14)


def same(found: Any, exact: Any, most: float) -> None:
    """Check udot and its derivatives, with errors relative to the largest entry."""
    (a, da), (b, db) = found, exact
    np.testing.assert_allclose(a, b, rtol=0, atol=most * np.abs(b).max())
    for x, y in zip(da, db, strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=most * max(np.abs(y).max(), np.abs(b).max() * 1e-3))
