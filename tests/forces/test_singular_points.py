"""Derivatives where plain rules give 0/0 or 0 times infinity are limits, in every target, forward and transposed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

LAWS = {
    "hertz": "k*max(0, -q.a)**n",
    "below_one": "k*max(0, -q.a)**(n - 1)",
    "guarded": "if(q.a < 0, k*(-q.a)**n, 0)",
    "logarithm": "if(q.a > 1, log(q.a - 1)/(q.a - 1), k)",
    "unused_root": "if(q.a > 2, sqrt(q.a - 2), k*q.a)",
    "drag": "-k*sqrt(u.a**2 + u.b**2)*u.a",
    "weighted": "-k*sqrt(2*u.a**2 + k*u.b**2 + u.c*u.c)*(u.a + u.b)",
    "power": "-k*abs(u.a)**(n - 1)*u.a",
    "half_power": "-k*u.a*sqrt(abs(u.a))",
    "thin": "-k*u.a*(u.a**2 + u.b**2)**((n - 1)/4)",
    "thinner": "-k*u.a**3/sqrt(u.a**2 + u.b**2)**1.5",
    "x_log_x": "k*u.a**2*log(abs(u.a))",
    "root_of_product": "sqrt(k*(1 - cos(u.a)))*u.b",
    "one_base": "k*abs(u.a)**n*abs(u.a)**(2 - n)",
    "arc": "k*(1 - q.c)*asin(q.c)*sqrt(1 - q.c)",
    "angle": "k*(u.a**2 + u.b**2)*atan2(u.a, u.b)",
    "cancelled": "k*u.a*u.b/u.a",
}
"""Forces whose derivatives all exist at q.a = 0.05, q.c = 1, u = 0."""

NAMES = ("q.a", "q.b", "q.c", "u.a", "u.b", "u.c", "k", "n")
AT = (0.05, 0.3, 1.0, 0.0, 0.0, 0.0, 3.0, 1.5)
FUNCTIONS: dict[str, Any] = {name: getattr(mpmath, name) for name in ("sqrt", "log", "cos", "asin", "atan2")}
FUNCTIONS |= {"abs": abs, "max": max, "__builtins__": {}}


def limits(law: str) -> np.ndarray:
    """Derivatives with respect to `NAMES` as one-sided limits in 200 digits, by quotients over 2e-60; q.c is at most 1."""
    if law.startswith("if("):
        condition, x, y = law[3:-1].split(", ")
        law = f"(({x}) if {condition} else ({y}))"
    for name in NAMES[:6]:
        law = law.replace(name, f"v['{name}']")
    code = compile(law, "law", "eval")
    with mpmath.workdps(200):
        start = dict(zip(NAMES, map(mpmath.mpf, AT), strict=True))
        h = mpmath.mpf(10) ** -60

        def value(name: str, step: Any) -> Any:
            v = start | {name: start[name] + step}
            v["u.a"] = v["u.a"] or h**3  # else 0/0 or 0 times infinity: the value beside it
            return eval(code, FUNCTIONS | {"v": v, "k": v["k"], "n": v["n"]})  # a text of this test

        return np.array([
            float((value(n, 0 if n == "q.c" else h) - value(n, -h)) / (h if n == "q.c" else 2 * h)) for n in NAMES
        ])  # fmt: skip


def model_of(laws: dict[str, str]) -> Model:
    """A model with a body and an output for each law; the law is the acceleration of the body."""
    lines = ["model: singular", "parameters: {k: 3.0, n: 1.5}", "bodies:"]
    lines += [
        f"  {b}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}" for b in ("a", "b", "c", *laws)
    ]
    lines += ["forces:", *(f'  {n}: {{type: joint, joint: {n}, value: "{law}"}}' for n, law in laws.items())]
    lines += ["outputs:", *(f'  {n}: {{value: "{law}"}}' for n, law in laws.items())]
    return parse_model("\n".join(lines))


N = 3 + len(LAWS)
Q, U = np.zeros(N), np.zeros(N)
Q[:3] = AT[:3]


@pytest.fixture(scope="module")
def expected() -> np.ndarray:
    return np.array([limits(law) for law in LAWS.values()])


def rows(J: Any) -> np.ndarray:
    """The derivatives of the laws with respect to `NAMES`."""
    return np.hstack([J.q[3:, :3], J.u[3:, :3], J.p[3:]])


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
def test_reference_engines_against_limits(engine: Any, expected: np.ndarray) -> None:
    np.testing.assert_allclose(rows(engine(model_of(LAWS)).jacobians(Q, U)), expected, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_generated_code_against_limits_forward_and_transposed(
    tmp_path: Path, target: str, expected: np.ndarray
) -> None:
    codegen.generate(model_of(LAWS), tmp_path / "singular", target=target)
    solver = codegen.load(tmp_path / "singular")
    seeds = {"dq": np.zeros((8, N)), "du": np.zeros((8, N)), "dp": np.zeros((8, 2))}
    seeds["dq"][:3, :3], seeds["du"][3:6, :3], seeds["dp"][6:] = np.eye(3), np.eye(3), np.eye(2)

    def compare(found: np.ndarray) -> None:
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-9, atol=1e-7)

    compare(rows(solver.jacobians(Q, U)))
    for q in (Q, np.tile(Q, (5, 1))):  # alone and in a batch of states
        udot, along = solver.sensitivities(q, 0 * q, **seeds)
        compare(np.moveaxis(along[..., 3:], 0, -1))
        outputs, along = solver.output_sensitivities(q, 0 * q, **seeds)
        compare(np.moveaxis(along, 0, -1))
        np.testing.assert_allclose(outputs, udot[..., 3:], atol=1e-14)
    one, other = np.eye(N)[3:], np.eye(len(LAWS))
    for found in (solver.gradients(Q, U, weights=one), solver.output_gradients(Q, U, weights=other)):
        compare(np.hstack([found.q[:, :3], found.u[:, :3], found.p]))
    exact = solver.in_precision(30).jacobians(Q, U)
    compare(np.hstack([exact.q[3:, :3], exact.u[3:, :3], exact.p[3:]]).astype(float))
