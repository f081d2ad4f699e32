"""Derivatives are those of the discrete motion: the same steps, again, in 40 digits by another engine, and differences of 1e-15.

And the motion itself converges to the continuous one at the orders of the methods, with everything that is derived from it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from motion.models import Made, ball, driven, example, tree

from codegen.reference import RecursiveEngine
from codegen.runtime import Final, Integral

Array = np.ndarray
Tableau = tuple[list[list[float]], list[float], list[float]]

RK4: Tableau = ([[], [0.5], [0.0, 0.5], [0.0, 0.0, 1.0]], [1 / 6, 1 / 3, 1 / 3, 1 / 6], [0.0, 0.5, 0.5, 1.0])


def dop853() -> Tableau:
    """E. Hairer's coefficients, from SciPy."""
    c = pytest.importorskip("scipy.integrate._ivp.dop853_coefficients")
    return [list(map(float, c.A[i, :i])) for i in range(12)], list(map(float, c.B)), list(map(float, c.C[:12]))


class Replay:
    """The steps of a motion, repeated."""

    def __init__(self, of: Made, tableau: Tableau, times: Array, inputs: list[float]):
        self.engine = RecursiveEngine(of.model, numbers="mpmath")
        self.tableau, self.times = tableau, times
        self.inputs = self.array(inputs)

    def array(self, x: Any) -> Any:
        return self.engine.arithmetic.array(np.asarray(x))

    def full(self, z: Any, p: Any) -> tuple[Any, Any]:
        """All coordinates and speeds."""
        nq = len(z) - self.engine.model.nu
        return z[:nq], z[nq:]

    def rates(self, t: Any, z: Any, p: Any) -> Any:
        q, u = self.full(z, p)
        state = (q, u, p, self.inputs, t)
        return np.concatenate([self.engine.coordinate_rates(*state), self.engine.accelerations(*state)])

    def run(self, z: Any, p: Any) -> Any:
        """Outputs and state at the end."""
        A, b, c = self.tableau
        for begins, ends in zip(self.times[:-1], self.times[1:], strict=True):
            t, h = mpmath.mpf(float(begins)), mpmath.mpf(float(ends - begins))
            k: list[Any] = []
            for a, at in zip(A, c, strict=True):
                stage = z + sum((h * mpmath.mpf(x) * r for x, r in zip(a, k, strict=False)), 0 * z)
                k.append(self.rates(t + mpmath.mpf(at) * h, stage, p))
            z = z + sum(h * mpmath.mpf(x) * r for x, r in zip(b, k, strict=True))
        q, u = self.full(z, p)
        outputs = self.engine.outputs(q, u, p, self.inputs, mpmath.mpf(float(self.times[-1])))
        return np.concatenate([np.array(outputs, dtype=object), u])

    def along(self, z: Any, p: Any, dz: Any, dp: Any) -> tuple[Array, Array]:
        """The end state and its derivative along a direction."""
        with mpmath.workdps(40):
            z, p, dz, dp = (self.array(x) for x in (z, p, dz, dp))
            h = mpmath.mpf(10) ** -15
            up, down = self.run(z + h * dz, p + h * dp), self.run(z - h * dz, p - h * dp)
            return ((up + down) / 2).astype(float), ((up - down) / (2 * h)).astype(float)


class FourBar(Replay):
    """The four-bar, whose loop is closed in the plane: two circles."""

    def full(self, z: Any, p: Any) -> tuple[Any, Any]:
        a, b, c, d = p[:4]
        x, y = a * mpmath.cos(z[0]), a * mpmath.sin(z[0])
        coupler, rocker = mpmath.mpf("-0.4"), mpmath.mpf("-1.9")
        near = self.near
        coupler, rocker = near if near is not None else (coupler, rocker)
        for _ in range(40):
            one, two = z[0] + coupler, z[0] + coupler + rocker
            f = x + b * mpmath.cos(one) + c * mpmath.cos(two) - d
            g = y + b * mpmath.sin(one) + c * mpmath.sin(two)
            f2, g2 = -c * mpmath.sin(two), c * mpmath.cos(two)
            f1, g1 = -b * mpmath.sin(one) + f2, b * mpmath.cos(one) + g2
            det = f1 * g2 - f2 * g1
            step = (-(f * g2 - g * f2) / det, -(f1 * g - g1 * f) / det)
            coupler, rocker = coupler + step[0], rocker + step[1]
            if max(map(abs, step)) < mpmath.mpf(10) ** -25:
                break
        self.near = (coupler, rocker)
        q = np.array([z[0], coupler, rocker], dtype=object)
        u = np.array([z[1], mpmath.mpf(0), mpmath.mpf(0)], dtype=object)
        return q, self.engine.complete(q, u, p)[0]

    near: Any = None

    def rates(self, t: Any, z: Any, p: Any) -> Any:
        q, u = self.full(z, p)
        return np.array([z[1], self.engine.accelerations(q, u, p, self.inputs, t)[0]], dtype=object)

    def run(self, z: Any, p: Any) -> Any:
        self.near = None
        return super().run(z, p)


def steps_of(solver: Any, method: str, q: Any, p: Any, inputs: Any, names: tuple[str, ...], end: float) -> Any:
    """A motion at its own steps, few and long ones: nothing but the discrete motion counts."""
    if method == "rk4":
        return solver.simulate(end, q, None, p, inputs, sensitivities=names, method="rk4", step=end / 1.5)
    return solver.simulate(end, q, None, p, inputs, sensitivities=names, rtol=1e-5, atol=1e-5, step=end / 1.5)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("ball", "rk4"),
        ("four_bar", "rk4"),
        ("four_bar", "dop853"),
        pytest.param("ball", "dop853", marks=pytest.mark.campaign),
        pytest.param("tree", "rk4", marks=pytest.mark.campaign),
        pytest.param("tree", "dop853", marks=pytest.mark.campaign),
    ],
)
def test_the_same_steps_in_forty_digits(made: Callable[..., Made], name: str, method: str) -> None:
    of = made(*{"tree": (tree, 7), "ball": (ball, 1), "four_bar": (example, "four_bar")}[name])
    solver = of.solver
    inputs = [0.3, -0.4][: solver.ninputs]
    names = (
        *solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names),
        *(f"u0.{n}" for n in solver.independent_speed_names),
    )  # fmt: skip
    p = solver.parameters if of.p is None else of.p
    q, u = solver.assemble(of.q, None, p)
    found = steps_of(solver, method, of.q, p, inputs, names, 0.3)
    assert 3 <= len(found) < 8
    tableau = RK4 if method == "rk4" else dop853()
    replay = (FourBar if name == "four_bar" else Replay)(of, tableau, found.t, inputs)
    v = np.random.default_rng(1).uniform(-1, 1, len(names))
    free_q = [solver.coordinate_names.index(n) for n in solver.independent_names]
    free_u = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    end, derivative = replay.along(np.concatenate([q[free_q], u[free_u]]), p, v[len(p) :], v[: len(p)])
    values = np.concatenate([found.outputs[-1], found.u[-1]])
    directions = np.concatenate([found.doutputs[:, -1], found.du[:, -1]], axis=1)
    assert np.abs(values - end).max() < 1e-12 * np.abs(end).max()
    assert np.abs(v @ directions - derivative).max() < 1e-11 * np.abs(derivative).max()
    # and backwards
    output = solver.output_names[0]
    options = (
        {"integrator": "rk4", "step": 0.3 / 1.5} if method == "rk4" else {"rtol": 1e-5, "atol": 1e-5, "step": 0.3 / 1.5}
    )
    back = solver.judge(0.3, Final(output), of.q, None, p, inputs, wrt=names, method="adjoint", **options)
    assert back.counts["steps"] == len(found) - 1
    assert abs(back.gradients[0] @ v - derivative[0]) < 1e-11 * np.abs(derivative).max()


def radau() -> Any:
    """The coefficients of Radau IIA of order 5 as they are defined: collocation at (4 -+ sqrt 6)/10 and 1."""
    root = mpmath.sqrt(6)
    c = [(4 - root) / 10, (4 + root) / 10, mpmath.mpf(1)]
    moments = mpmath.matrix(3, 3)
    for i in range(3):
        for k in range(3):
            moments[i, k] = c[i] ** (k + 1) / (k + 1)
    powers = mpmath.matrix([[x**k for x in c] for k in range(3)])
    return moments * powers.T**-1


def van_der_pol(a: Any, z: Any, times: Array) -> Any:
    """The end of implicit steps of q'' = 20 a (1 - q^2) q' - q, their stages by Newton's method to the last digit."""
    A = radau()
    for begins, ends in itertools.pairwise(times):
        h = mpmath.mpf(float(ends)) - mpmath.mpf(float(begins))
        Z = mpmath.matrix(6, 1)
        for _ in range(30):
            F, M = Z.copy(), mpmath.eye(6)
            for j in range(3):
                q, u = z[0] + Z[2 * j], z[1] + Z[2 * j + 1]
                rate = (u, 20 * a * (1 - q * q) * u - q)
                J = ((0, 1), (-40 * a * q * u - 1, 20 * a * (1 - q * q)))
                for i in range(3):
                    for row in range(2):
                        F[2 * i + row] -= h * A[i, j] * rate[row]
                        for column in range(2):
                            M[2 * i + row, 2 * j + column] -= h * A[i, j] * J[row][column]
            change = mpmath.lu_solve(M, -F)
            Z += change
            if mpmath.norm(change) < mpmath.mpf(10) ** -33:
                break
        z = (z[0] + Z[4], z[1] + Z[5])
    return z


def test_implicit_steps_in_forty_digits(made: Callable[..., Made]) -> None:
    """A stiff oscillator at its own steps: values, sensitivities and gradients backwards against differences of 1e-15."""
    solver = made(
        driven,
        "1",
        "20*a*(1 - q.stone*q.stone)*u.stone - q.stone",
        "q: {stone: 2.0}, u: {stone: 0.5}",
        functions=("motion",),
    ).solver
    names, end, accuracy = ("a", "q0.stone", "u0.stone"), 8.0, {"rtol": 1e-8, "atol": 1e-8}
    found = solver.simulate(end, sensitivities=names, method="radau", **accuracy)
    assert 30 < len(found) < 200
    v = np.array([0.7, -0.4, 0.9])
    with mpmath.workdps(40):
        ends = []
        for sign in (1, -1):
            a, q, u = (
                mpmath.mpf(x) + sign * mpmath.mpf(10) ** -15 * mpmath.mpf(y)
                for x, y in zip((1, 2, 0.5), v, strict=True)
            )
            ends.append(van_der_pol(a, (q, u), found.t))
        value = [float((x + y) / 2) for x, y in zip(*ends, strict=True)]
        derivative = np.array([float((x - y) / (2 * mpmath.mpf(10) ** -15)) for x, y in zip(*ends, strict=True)])
    np.testing.assert_allclose(found.outputs[-1], value, rtol=1e-9)
    np.testing.assert_allclose(v @ found.doutputs[:, -1], derivative, rtol=1e-8)
    back = solver.judge(end, [Final("z"), Final("w")], wrt=names, method="adjoint", integrator="radau", **accuracy)
    assert back.counts["steps"] == len(found) - 1
    np.testing.assert_allclose(back.gradients @ v, derivative, rtol=1e-8)
    np.testing.assert_allclose(back.gradients, found.doutputs[:, -1].T, rtol=1e-11)


@pytest.mark.parametrize(("method", "order", "h"), [("rk4", 4, 0.00125), ("dop853", 8, 0.025)])
def test_order_of_convergence(four_bar: Any, method: str, order: int, h: float) -> None:
    """Of the state, of sensitivities, of gradients by the adjoint, integrals among them."""
    end, wrt = 0.6, ("crank_length", "base", "u0.crank", "inputs.motor")
    common = {"inputs": [0.3]}

    def of(h: float, tight: bool = False) -> list[Array]:
        exact = {"rtol": 1e-14, "atol": 1e-14, "largest_step": 0.005}
        rough = {"rtol": 1e3, "atol": 1e3, "step": h, "largest_step": h}
        options = exact if tight else {"step": h} if method == "rk4" else rough
        named = {"method": "dop853" if tight else method}
        found = four_bar.simulate([0.0, end], sensitivities=wrt, **common, **options, **named)
        assert tight or found.stats["steps"] == round(end / h)
        judged = four_bar.judge(
            end,
            [Final("trace_x"), Integral("kinetic")],
            wrt=wrt,
            method="adjoint",
            integrator=named["method"],
            **common,
            **options,
        )
        return [
            found.q[-1], found.u[-1], found.dq[:, -1], found.du[:, -1], found.doutputs[:, -1], judged.values, judged.gradients,
        ]  # fmt: skip

    exact = of(h, tight=True)
    errors = [[np.abs(x - y).max() for x, y in zip(of(step), exact, strict=True)] for step in (h, h / 2)]
    orders = np.log2(np.array(errors[0]) / np.array(errors[1]))
    # dop853 has not come to its asymptotic order yet, and errors of both signs cancel
    assert (orders > order - 0.3).all() and (method == "dop853" or (orders < order + 0.3).all()), (orders, errors)
    assert min(errors[1]) > 1e-13 and max(errors[1]) < 1e-7, errors
