"""Second derivatives of equilibria: a closed form, and differences of first derivatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from resting_models import PENDULUM
from second_derivatives import EXAMPLES, made

import codegen

FUNCTIONS = "statics,gradients,hessian_products"
OF_LOOPS = f"{FUNCTIONS},assemble_gradients,assemble_hessian_products"

TWO_RODS = """
model: two_rods
gravity: [0, 0, -9.81]
parameters: {a: 1.0, b: 0.7, k: 12.0, q0: 0.4}
inputs: [push]
bodies:
  upper: {parent: ground, joint: {type: revolute, axis: y}, mass: 2*a, com: [0, 0, -a/2], inertia: {xx: 0, yy: 0.1, zz: 0}}
  lower: {parent: upper, joint: {type: revolute, axis: [0, 1, 0.3], at: [0, 0, -a]}, mass: b, com: [0.1*b, 0, -b/2],
    inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  spring: {type: joint, joint: lower, value: -k*(q.lower - q0)}
  stiffening: {type: joint, joint: upper, value: 0.3 + push*q.lower - 3*(q.upper - q0)**3}
"""

BALL = """
model: ball
gravity: [0, 0, -9.81]
parameters: {l: 0.8, k: 40.0, n: 0.5, x: 0.6}
bodies:
  stick: {parent: ground, joint: {type: spherical}, shape: {type: cylinder, axis: z, length: l, radius: 0.02, mass: 2,
    center: [0.05, 0, l/2]}}
forces:
  a: {type: spring, from: {body: stick, at: [0.1, 0, l]}, to: {body: ground, at: [x, 0.1, 1.2]}, stiffness: k, free_length: n}
  b: {type: spring, from: {body: stick, at: [0.1, 0.2, 0.1*l]}, to: {body: ground, at: [-x, 0.5, 0.2]}, stiffness: k}
  c: {type: spring, from: {body: stick, at: [0.1, 0, l]}, to: {body: ground, at: [0.2, -x, 0.4]}, stiffness: 2*k}
"""

FREE = """
model: free
gravity: [0, 0, -9.81]
parameters: {l: 0.8, k: 60.0, n: 0.3, x: 0.6}
bodies:
  box: {parent: ground, joint: {type: free}, shape: {type: box, size: [l, 0.5, 0.3], mass: 4, center: [0.05, 0, 0]}}
  arm: {parent: box, joint: {type: revolute, axis: [0.2, 1, 0], at: [0.3, 0, 0.1]},
    shape: {type: cylinder, axis: z, length: l, radius: 0.02, mass: 1, center: [0, 0, -l/2]}}
points:
  a: {body: box, at: [l/2, 0.2, 0.1]}
  b: {body: box, at: [-l/2, 0.25, 0.1]}
  c: {body: box, at: [0, -0.25, 0.1]}
  A: {body: ground, at: [x, 0.1, 1.2]}
  B: {body: ground, at: [-x, 0.5, 1.1]}
  C: {body: ground, at: [0.2, -x, 1.4]}
  D: {body: ground, at: [0.8, -x, 0.4]}
forces:
  aA: {type: spring, from: a, to: A, stiffness: k, free_length: n}
  bB: {type: spring, from: b, to: B, stiffness: k, free_length: n}
  cC: {type: spring, from: c, to: C, stiffness: 2*k, free_length: n}
  dD: {type: spring, from: {body: arm, at: [0, 0, -l]}, to: D, stiffness: k/2, free_length: n}
  aD: {type: spring, from: a, to: D, stiffness: k/3, free_length: n}
  bC: {type: spring, from: b, to: C, stiffness: k/2, free_length: n}
"""

FOUR_BAR = """
model: four_bar
gravity: [0, 0, -9.81]
parameters: {a: 0.4, b: 1.0, c: 0.7, d: 1.1, k: 30.0}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, mass: a, com: [0, 0, a/2], inertia: {xx: 0, yy: 0.1, zz: 0}}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, a]}, mass: b, com: [0, 0, b/2],
    inertia: {xx: 0, yy: 0.1, zz: 0}}
  rocker: {parent: ground, joint: {type: revolute, axis: y, at: [d, 0, 0]}, mass: c, com: [0, 0, c/2],
    inertia: {xx: 0, yy: 0.1, zz: 0}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: coupler, at: [0, 0, b]}, to: {body: rocker, at: [0, 0, c]}}
forces:
  hinge: {type: joint, joint: crank, value: -k*(q.crank - 0.5)}
  above: {type: spring, from: {body: coupler, at: [0.1, 0, b/2]}, to: {body: ground, at: [0.2, 0, 2]}, stiffness: k,
    free_length: 0.3}
initial: {q: {crank: 0.3, coupler: 1.0, rocker: 0.2}}
independent: [crank]
"""

RSSR = """
model: rssr
gravity: [0, 0, -9.81]
parameters: {a: 0.3, b: 1.0, c: 0.6, d: 0.9, k: 30.0}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, mass: a, com: [0, 0, a/2], inertia: {xx: 0, yy: 0.1, zz: 0}}
  coupler: {parent: crank, joint: {type: spherical, at: [0, 0, a]}, mass: b, com: [b/2, 0.03, 0],
    inertia: {xx: 0.1, yy: 0.2, zz: 0.2}}
  rocker: {parent: ground, joint: {type: revolute, axis: [0.2, 1, 0.4], at: [d, 0.2, 0]}, mass: c, com: [0, 0, c/2],
    inertia: {xx: 0, yy: 0.1, zz: 0}}
loops:
  pin: {joint: {type: point}, from: {body: coupler, at: [b, 0, 0]}, to: {body: rocker, at: [0, 0, c]}}
forces:
  hinge: {type: joint, joint: crank, value: -k*(q.crank - 0.5)}
  high: {type: spring, from: {body: coupler, at: [0.1, 0.1, b/2]}, to: {body: ground, at: [0.2, 0, 2]}, stiffness: k,
    free_length: 0.3}
  side: {type: spring, from: {body: coupler, at: [0.1, 0.2, 0.1]}, to: {body: ground, at: [0.2, -0.6, 1.2]}, stiffness: k,
    free_length: 0.3}
initial: {q: {crank: 0.3, rocker: 0.2}}
"""
"""Loops determine a part of the coupler's quaternion."""

MODELS = {"two_rods": TWO_RODS, "ball": BALL, "free": FREE, "four_bar": FOUR_BAR, "rssr": RSSR}


def opened(text: str, folder: Path, target: str = "numpy") -> codegen.Solver:
    return made(codegen.parse_model(text), folder, target, OF_LOOPS if "loops:" in text else FUNCTIONS)


def hessian(solver: codegen.Solver, q: Any, given: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The Hessian with respect to the parameters, then the inputs."""
    n = solver.np
    units = np.eye(len(given))
    seeds = {"dp": units[:, :n]} | ({"dinputs": units[:, n:]} if solver.ninputs else {})
    found = solver.equilibrium_hessian_products(q, given[:n], given[n:], weights_q=weights, **seeds)
    return np.concatenate([found.p, found.inputs], axis=1)


def differences(solver: codegen.Solver, q: Any, given: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Fourth-order differences of the first derivatives."""
    names = [*solver.parameter_names, *(f"inputs.{name}" for name in solver.input_names)]

    def gradient(at: np.ndarray) -> np.ndarray:
        n = solver.np
        return solver.equilibrium(q, at[:n], at[n:], sensitivities=names, tolerance=1e-13).dq @ weights

    rows = []
    for j, x in enumerate(given):
        step = 1e-4 * max(abs(x), 0.1) * np.eye(len(given))[j]
        ahead, far = (gradient(given + k * step) - gradient(given - k * step) for k in (1, 2))
        rows.append((8 * ahead - far) / (12 * step[j]))
    return np.array(rows)


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_a_pendulum_with_a_motor_is_a_closed_form(tmp_path: Path, target: str) -> None:
    """q = -asin(s) with s = tau/(m g l) up to the sign, and second derivatives by l, m and tau."""
    solver = opened(PENDULUM, tmp_path, target)
    l, m, tau = 0.8, 1.5, 4.0
    q = solver.equilibrium(inputs=[tau]).q
    H = hessian(solver, q, np.array([*solver.parameters, tau]), np.array([1.0]))
    names = (*solver.parameter_names, *solver.input_names)
    by = [names.index(n) for n in ("l", "m", "motor")]
    rest = np.setdiff1d(range(len(names)), by)  # inertia and friction have no effect
    assert np.abs(H[rest]).max() < 1e-15 and np.abs(H[:, rest]).max() < 1e-15
    H = H[np.ix_(by, by)]
    s = tau / (m * 9.81 * l)
    first, second = 1 / np.sqrt(1 - s * s), s / (1 - s * s) ** 1.5
    ds = np.array([-s / l, -s / m, s / tau])
    dds = s * np.array([
        [2 / l**2, 1 / (l * m), -1 / (l * tau)], [1 / (l * m), 2 / m**2, -1 / (m * tau)], [-1 / (l * tau), -1 / (m * tau), 0]
    ])  # fmt: skip
    expected = np.sign(q[0]) * (second * np.outer(ds, ds) + first * dds)
    assert np.abs(H - expected).max() < 1e-14 * np.abs(expected).max()


@pytest.mark.parametrize("name", MODELS)
def test_products_are_differences_of_first_derivatives(tmp_path: Path, name: str) -> None:
    solver = opened(MODELS[name], tmp_path)
    given = np.array([*solver.parameters, *[0.7] * solver.ninputs])
    q = solver.equilibrium(inputs=given[solver.np :]).q
    weights = np.random.default_rng(1).normal(size=solver.nq)
    H, D = hessian(solver, q, given, weights), differences(solver, q, given, weights)
    assert np.abs(D).max() > 1e-3
    assert np.abs(H - D).max() < 1e-8 * np.abs(D).max()
    assert np.abs(H - H.T).max() < 1e-12 * np.abs(H).max()


def test_what_is_no_equilibrium_is_refused(tmp_path: Path) -> None:
    solver = opened(PENDULUM, tmp_path)
    with pytest.raises(
        ValueError, match=r"q is not an equilibrium: rod accelerates by .*; pass the q of an Equilibrium"
    ):
        solver.equilibrium_hessian_products([0.3], weights_q=[1.0], dp=np.eye(4))
    with pytest.raises(ValueError, match="weights_q"):
        solver.equilibrium_hessian_products([0.0], weights_q=[1.0, 2.0], dp=np.eye(4))
    with pytest.raises(ValueError, match=r"batch of shape \(3,\), expected one state"):
        solver.equilibrium_hessian_products([0.0], weights_q=[1.0], dp=np.ones((2, 3, 4)))
    with pytest.raises(ValueError, match=r"no seeds|direction|seed"):
        solver.equilibrium_hessian_products([0.0], weights_q=[1.0])


def test_a_neutral_direction_has_no_second_derivatives(tmp_path: Path) -> None:
    text = PENDULUM.replace("gravity: [0, 0, -9.81]", "gravity: [0, 0, 0]")
    with pytest.warns(RuntimeWarning, match="rod may rest anywhere"):
        found = opened(text, tmp_path).equilibrium_hessian_products([0.4], weights_q=[1.0], dp=np.eye(4))
    assert np.isnan(found.p).all()


def test_a_package_without_products_says_what_to_generate(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "pendulum.yaml", tmp_path, functions="statics")
    with pytest.raises(AttributeError, match=r"add them to --functions"):
        solver.equilibrium_hessian_products([0.0], weights_q=[1.0], dp=np.eye(4))
