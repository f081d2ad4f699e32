"""Hessians of motions by the implicit method: in 40 digits, symmetry, differences of gradients, and the adjoint method."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.test_second_derivatives import same_as_differences
from motions import crank_driven_by_its_piston

import codegen
from codegen.runtime import At, AtEvent, Event, Final, Integral, LeastSquares

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTIONS = "motion,hessian_products"
DIGITS = 40
TIGHT = {"integrator": "radau", "rtol": 1e-12, "atol": 1e-12}


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    folder = tmp_path_factory.mktemp("swing") / "package"
    codegen.generate(EXAMPLES / "swing_up.yaml", folder, functions=FUNCTIONS)
    return codegen.load(folder)


def test_hessians_equal_differences_in_40_digits(swing: codegen.Solver) -> None:
    """Second differences of the same steps, whose stages are iterated to 40 digits."""
    exact, mp = swing.in_precision(DIGITS), __import__("mpmath").mp.clone()
    mp.dps = DIGITS
    number = np.frompyfunc(mp.mpf, 1, 1)
    root, apart = mp.sqrt(6), mp.mpf(10) ** -10
    third = (16 - root) / 36, (16 + root) / 36, mp.mpf(1) / 9
    rows = (
        ((88 - 7 * root) / 360, (296 - 169 * root) / 1800, (-2 + 3 * root) / 225),
        ((296 + 169 * root) / 1800, (88 + 7 * root) / 360, (-2 - 3 * root) / 225),
        third,
    )
    A, names = np.array(rows), ["tip_x", "tip_z", "kinetic", "angle"]

    at = np.array([0.1, 0.7, 0.3, -0.4, 1.0, 0.6, 0.1, 0.2, 0.1, 0.002])
    given, tolerance = (at[:2], at[2:4], at[4:], [2.0]), {"rtol": 1e-10, "atol": 1e-10}
    steps = np.diff(number(swing.simulate(0.03, *given, method="radau", **tolerance).t))
    assert len(steps) > 1

    def outputs(x: np.ndarray) -> np.ndarray:
        z, p = x[:4], x[4:]
        for h in steps:
            stages = np.array([z] * 3)
            for _ in range(200):
                rates = [[*y[2:], *exact.accelerations(y[:2], y[2:], p, number([2.0]))] for y in stages]
                before, stages = stages, z + h * (A @ np.array(rates))
                if max(abs(stages - before).ravel()) < mp.mpf(10) ** -37:
                    break
            z = stages[2]
        found = exact.outputs(z[:2], z[2:], p, number([2.0]))
        return np.array([found[swing.output_names.index(n)] for n in names])

    wrt = ("q0.cart", "q0.pole", "u0.cart", "u0.pole", *swing.parameter_names)
    found = swing.judge(
        0.03, [Final(n) for n in names], *given, wrt=wrt, hessian=True, integrator="radau", **tolerance
    ).hessian_products  # fmt: skip
    x, scale = number(at), np.abs(found).max(axis=(1, 2))
    for i, j in ((1, 1), (1, 5), (3, 6), (5, 5), (5, 7)):
        one, other = number(np.eye(10)[i]) * apart, number(np.eye(10)[j]) * apart
        sides = (
            outputs(x + one + other) - outputs(x + one - other) - outputs(x - one + other) + outputs(x - one - other)
        )
        wanted = (sides / (4 * apart**2)).astype(float)
        assert (np.abs(found[:, i, j] - wanted) < 1e-11 * scale).all(), (i, j)


WRT = ("pole_length", "bob_mass", "cart_damping", "q0.pole", "u0.cart", "inputs.push[1]", "inputs.push[2]")


def judged(solver: codegen.Solver, x: np.ndarray, **more: Any) -> Any:
    samples = {"angle": [0.1, 0.2, np.nan, 0.3], "tip_x": [0.0, 0.1, 0.2, 0.3]}
    wanted = [
        Final("tip_x"), At("tip_z", 0.53), Integral("effort"), Integral("kinetic"),
        LeastSquares([0.0, 0.2, 0.77, 1.0], samples, sigma=0.1), AtEvent("tip_x", Event("angle", 0.3, stop=False)),
    ]  # fmt: skip
    inputs, p = (
        (np.linspace(0.0, 1.0, 4), np.array([1.0, x[5], x[6], 0.5]), "cubic"),
        dict(zip(WRT[:3], x, strict=False)),
    )
    return solver.judge(1.0, wanted, [0.1, x[3]], [x[4], -0.4], p, inputs, wrt=WRT, integrator="radau", **more)


AT = np.array([0.6, 0.2, 0.1, 0.7, 0.3, -2.0, 3.0])


@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_hessians_are_symmetric_at_any_tolerance(swing: codegen.Solver, tolerance: float) -> None:
    more: dict[str, Any] = {"rtol": tolerance, "atol": tolerance}
    found, plain = judged(swing, AT, hessian=True, **more), judged(swing, AT, method="adjoint", **more)
    np.testing.assert_allclose(found.gradients, plain.gradients, rtol=1e-12, atol=1e-13)
    for hessian in found.hessian_products:
        assert np.abs(hessian).max() > 0.0
        np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-12 * np.abs(hessian).max())


def test_hessians_of_trees_equal_differences(swing: codegen.Solver) -> None:
    def judge(x: np.ndarray, **more: Any) -> Any:
        return judged(swing, x, rtol=1e-12, atol=1e-12, **more)

    same_as_differences(judge, AT, np.full(7, 2e-3), 1e-7)


def test_a_long_chain_is_solved_in_rounds(tmp_path: Path) -> None:
    """Equations of 36 entries use the factors of one Jacobian, and twelve variables are two groups of directions."""
    n = 18
    bodies = "".join(
        f"  rod_{i}: {{parent: {f'rod_{i - 1}' if i else 'ground'}, "
        f"joint: {{type: revolute, axis: y, at: [0, 0, {'-l' if i else 0}]}}, mass: m_{i}, com: [0, 0, -l/2], "
        "inertia: {xx: 0.01, yy: 0.01, zz: 0.01}}\n"
        for i in range(n)
    )
    forces = "".join(f"  f_{i}: {{type: joint, joint: rod_{i}, value: -c*u.rod_{i}}}\n" for i in range(n))
    masses = ", ".join(f"m_{i}: 0.2" for i in range(n))
    text = (
        f"model: chain\ngravity: [0, 0, -9.81]\nparameters: {{l: 0.3, c: 2.0, {masses}}}\nbodies:\n{bodies}forces:\n{forces}"
        "points: {tip: {body: rod_17, at: [0, 0, -l]}}\noutputs:\n  x: {position: tip, axis: x}\n  kinetic: kinetic_energy\n"
    )
    codegen.generate(codegen.parse_model(text), tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("l", "c", "m_3", "m_17", "q0.rod_0", "u0.rod_9", *(f"m_{i}" for i in range(10, 16)))

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip((*wrt[:4], *wrt[6:]), [*x[:4], *x[6:]], strict=True)), np.full(n, 0.1), np.zeros(n)
        q[0], u[9] = x[4:6]
        return solver.judge(0.1, [Final("x"), Integral("kinetic")], q, u, p, wrt=wrt, **TIGHT, **more)

    same_as_differences(judge, np.array([0.3, 2.0, 0.2, 0.2, 0.8, 0.3, *[0.2] * 6]), np.full(12, 1e-3), 1e-8)


def test_loops(tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("crank_length", "coupler_length", "rocker_length", "base", "q0.crank", "u0.crank", "inputs.motor[1]")
    samples = LeastSquares([0.0, 0.13, 0.4], {"swing": [0.1, 0.2, 0.3], "trace_z": [0.1, np.nan, 0.2]}, sigma=0.1)
    wanted = [Final("trace_x"), Final("kinetic"), Integral("swing"), Integral("kinetic"), At("swing", 0.19), samples]

    def judge(x: np.ndarray, **more: Any) -> Any:
        p = dict(zip(wrt[:4], x[:4], strict=True))
        q, u = solver.assemble([x[4], -0.3, -2.3], [x[5], 0.0, 0.0], p)
        return solver.judge(
            0.4, wanted, q, u, p, ([0.0, 0.1, 0.5], [0.0, x[6], 0.0], "linear"), wrt=wrt, **TIGHT, **more
        )

    same_as_differences(judge, np.array([0.5, 1.2, 0.9, 1.0, 0.8, 2.0, 3.0]), np.full(7, 1e-3), 1e-7)


def test_independents_that_change_on_the_way(tmp_path: Path) -> None:
    solver = crank_driven_by_its_piston(tmp_path, FUNCTIONS)
    wrt = ("crank_length", "rod_length", "offset", "q0.piston", "u0.piston", "inputs.load")
    q0, u0 = solver.initial_state()
    place = solver.coordinate_names.index("piston")

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip(wrt[:3], x[:3], strict=True)), q0.copy(), u0.copy()
        q[place], u[place] = x[3:5]
        q, u = solver.assemble(q, u, p)
        found = solver.judge(
            0.3, [Final("stroke"), At("speed", 0.11), Integral("kinetic")], q, u, p, [x[5]], wrt=wrt, **TIGHT, **more
        )
        assert found.counts["partitions_changed"] == 1
        return found

    same_as_differences(judge, np.array([0.15, 0.5, 0.02, q0[place], u0[place], 0.5]), np.full(6, 1e-4), 1e-6, 1e-11)


def test_quaternions(tmp_path: Path) -> None:
    """A ball joint, along parameters and speeds."""
    text = """
model: ball
gravity: [0, 0, -9.81]
parameters: {l: 0.5, m: 1.2, c: 0.3}
bodies:
  bob: {parent: ground, joint: {type: spherical}, mass: m, com: [0.1, 0, -l], inertia: {xx: 0.1, yy: 0.2, zz: 0.05*m}}
  arm: {parent: bob, joint: {type: revolute, axis: x, at: [0, 0, -l]}, mass: 0.5, com: [0, 0, -l]}
forces:
  hinge: {type: joint, joint: arm, value: -c*u.arm}
points: {tip: {body: arm, at: [0, 0.1, -l]}}
outputs:
  height: {position: tip, axis: z}
  kinetic: kinetic_energy
"""
    functions = f"{FUNCTIONS},coordinate_rate_hessian_products"
    codegen.generate(codegen.parse_model(text), tmp_path / "package", functions=functions)
    solver = codegen.load(tmp_path / "package")
    wrt = ("l", "m", "c", "q0.arm", *(f"u0.{n}" for n in solver.speed_names))

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q = dict(zip(wrt[:3], x[:3], strict=True)), np.array(solver.initial_state()[0])
        q[solver.coordinate_names.index("arm")] = x[3]
        return solver.judge(0.2, [Final("height"), Integral("kinetic")], q, x[4:], p, wrt=wrt, **TIGHT, **more)

    same_as_differences(judge, np.array([0.5, 1.2, 0.3, 0.4, 1.0, -2.0, 0.5, 3.0]), np.full(8, 1e-3), 1e-8)
