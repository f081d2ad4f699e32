"""Second derivatives where the quotients of a law are 0/0, or overflow: in doubles against engines with 50 digits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import codegen
from codegen.reference import DenseEngine
from codegen.runtime import SingularForceError

ARM = """
model: arm
gravity: [0, 0, -9.81]
parameters: {k: 30, l: 0.4, m: 1.3}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: m, com: [l, 0, 0.1], inertia: {xx: 1, yy: 1.2, zz: 1.1}}
  b:
    parent: a
    joint: {type: universal, at: [l, 0, 0], axes: [x, z]}
    mass: 0.8
    com: [0.1, 0, l]
    inertia: {xx: 0.3, yy: 0.2, zz: 0.2}
points: {eye: {body: a, at: [l, 0.1, 0.2]}, hook: {body: b, at: [0, 0.1, 0.2]}}
forces:
  f: FORCE
"""
FUNCTIONS = "accelerations,hessian_products,energies,energy_hessian_products"
U, WEIGHTS = np.array([0.3, -0.2, 0.5]), np.array([0.7, -0.4, 1.1])
DIRECTIONS = {
    "dq": np.array([[0.4, -0.7, 0.2], [0, 1, 0]]),
    "du": np.array([[0.1, 0.5, -0.3], [0, 0, 0]]),
    "dp": np.array([[2, 0.1, 0.3], [0, 0, 0]]),
}
DISTANCES = (0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.19, 0.21)


def errors(model: Any, engines: Sequence[Any], q: list[float], u: np.ndarray = U) -> list[float]:
    """Of solvers or engines in doubles, relative to the largest entry by q, by u and by p."""
    p = np.array(list(model.defaults.values()))
    with mpmath.workdps(50):
        exact = DenseEngine(model, numbers="mpmath").hessian_products(q, u, p, weights=WEIGHTS, **DIRECTIONS)
    by = [np.asarray(x).astype(float) for x in exact[:3]]
    found = [engine.hessian_products(q, u, p, weights=WEIGHTS, **DIRECTIONS)[:3] for engine in engines]
    return [
        np.abs(np.asarray(a, float) - b).max() / np.abs(b).max() for of in found for a, b in zip(of, by, strict=True)
    ]


SPRINGS = {
    "spring": "{type: spring, from: eye, to: hook, stiffness: k}",
    "hardening spring": "{type: hardening_spring, from: eye, to: hook, stiffness: k, hardening: 20*m}",
    "bushing": "{type: bushing, from: eye, to: hook, stiffness: [4, 5, k], rotational_stiffness: [k, 2, 1], "
    "rotational_preload: [m, 0.3, -0.5]}",
}


@pytest.mark.parametrize("force", SPRINGS.values(), ids=SPRINGS)
def test_ends_that_nearly_meet(tmp_path: Path, force: str) -> None:
    """Springs without free length and bushings are smooth there."""
    model = codegen.parse_model(ARM.replace("FORCE", force))
    codegen.generate(model, tmp_path / "m", functions=FUNCTIONS, check=False, compile="all")
    solver = codegen.load(tmp_path / "m")
    for distance in DISTANCES:
        q = [0.4, distance, 0.6 * distance]
        assert max(errors(model, [solver, DenseEngine(model)], q)) < 2e-14, distance
        hessian = solver.hessians(q, U, weights=WEIGHTS, wrt="q, u, p")
        assert np.abs(hessian - hessian.T).max() < 1e-14 * np.abs(hessian).max()


def test_the_energy_of_a_spring_whose_ends_meet(tmp_path: Path) -> None:
    """It is k d^2/2 with the distance d, also where d has no derivative; a damper changes nothing."""
    force = "{type: spring, from: eye, to: hook, stiffness: k, damping: 2}"
    model = codegen.parse_model(ARM.replace("FORCE", force).replace("-9.81", "0"))
    codegen.generate(model, tmp_path / "m", functions=FUNCTIONS, check=False, compile="all")
    solver = codegen.load(tmp_path / "m")
    dq = np.eye(3)
    found = solver.energy_hessian_products([0.4, 0.0, 0.0], 0 * U, weights=[0, 1], dq=dq).q
    arm = np.array([0.1, 0.2])  # of the hook about x, across it, m, and about z
    exact = 30 * np.array([[0, 0, 0], [0, arm @ arm, 0], [0, 0, 0.1**2]])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13)


@pytest.mark.parametrize("size", [1.0, 300.0, 720.0, 1e5])
def test_friction_far_from_rest(tmp_path: Path, size: float) -> None:
    """Where the square of the hyperbolic cosine overflows, second derivatives of tanh(u/v) are zero."""
    model = codegen.parse_model(ARM.replace("FORCE", "{type: friction, joint: a, coulomb: k, velocity: m/1300}"))
    codegen.generate(model, tmp_path / "m", functions=FUNCTIONS, check=False, compile="all")
    u = np.array([1e-3 * size, -0.2, 0.5])
    assert max(errors(model, [codegen.load(tmp_path / "m")], [0.4, 0.3, 0.2], u)) < 1e-13


def test_torsion_springs_whose_axes_are_nearly_opposite(tmp_path: Path) -> None:
    """There the angle would consist of rounding errors."""
    model = codegen.parse_model(ARM.replace("FORCE", "{type: torsion, axis: z, from: a, to: b, stiffness: k}"))
    codegen.generate(model, tmp_path / "m", functions="accelerations", target="both", check=False)
    engine = DenseEngine(model)
    for solver in (codegen.load(tmp_path / "m"), codegen.load(tmp_path / "m", "numpy")):
        for distance in (0.0, 1e-12, 1e-8, 7e-5):
            q = [0.4, np.pi - distance, 0.3]
            with pytest.raises(SingularForceError, match="torsion f: one end is turned by half a turn about a line"):
                solver.accelerations(q, U)
            with pytest.raises(ValueError, match="torsion f: one end is turned by half a turn about a line"):
                engine.accelerations(q, U, solver.parameters)
        with mpmath.workdps(50):
            q = [0.4, np.pi - 0.01, 0.3]
            exact = DenseEngine(model, numbers="mpmath").accelerations(q, U, solver.parameters).astype(float)
        assert np.abs(solver.accelerations(q, U) - exact).max() < 1e-9 * np.abs(exact).max()


AXES = """
model: axes
gravity: [0.3, -0.5, -9.81]
parameters: {ax: 0, ay: 0, az: 1, l: 0.4}
bodies:
  a: {parent: ground, joint: JOINT, mass: 1.2, com: [l, 0, 0.1], inertia: {xx: 1, yy: 1.2, zz: 1.1}}
  b: {parent: a, joint: {type: spherical, at: [l, 0.1, 0]}, mass: 0.8, com: [0.1, 0, l], inertia: {xx: 0.3, yy: 0.2, zz: 0.2}}
forces:
  coil: {type: torsion, from: ground, to: b, axis: [ax, 2*ay, az], stiffness: 3}
"""


@pytest.mark.parametrize(
    "joint", ["{type: revolute, axis: [ax, ay, az]}", "{type: screw, axis: [ax, ay, az], pitch: l}"]
)
def test_axes_that_parameters_turn(tmp_path: Path, joint: str) -> None:
    """The other directions of a frame follow the axis: no parameters make them 0/0, nor their derivatives lose digits."""
    model = codegen.parse_model(AXES.replace("JOINT", joint))
    codegen.generate(model, tmp_path / "m", functions=FUNCTIONS, check=False, compile="all")
    solver = codegen.load(tmp_path / "m")
    q, u = [0.4, 0.8, 0.3, -0.1, 0.5], np.array([0.3, -0.2, 0.5, 0.7])
    q[1:] = list(np.array(q[1:]) / np.linalg.norm(q[1:]))
    w, dp = [0.7, -0.4, 1.1, 0.3], np.array([[0.3, 0.2, -0.1, 0.4]])
    for axis in ([1, 0, 0], [0, 1, 0], [0, 0, -1], [1, 1e-9, 0], [1e-9, 1, 1e-6], [1, 1, 1], [0.3, 0.1, 0.9]):
        p = [*axis, 0.4]
        with mpmath.workdps(40):
            engine = DenseEngine(model, numbers="mpmath")
            exact = engine.hessian_products(q, u, p, weights=w, dp=dp)[2].astype(float)
            udot = engine.accelerations(q, u, p).astype(float)
        assert np.abs(solver.accelerations(q, u, p) - udot).max() < 1e-14 * np.abs(udot).max(), axis
        assert np.abs(solver.hessian_products(q, u, p, weights=w, dp=dp).p - exact).max() < 1e-13 * np.abs(exact).max()
