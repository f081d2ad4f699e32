# ruff: noqa: E501  (tables)
"""Powers of any size: fast to generate, exact where floats are, and equal in C and NumPy."""

from __future__ import annotations

import time
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import Model, ModelError, parse_model
from codegen.pipeline import write_solver

# name of the coordinate: force, state, and the force in mpmath
CASES = {
    "huge": ("(2*q.huge)**1000000000", 0.5 * (1 + 2.0**-33), lambda q: (2 * q) ** 10**9),
    "negative": ("(2*q.negative)**-1000000000", 0.5 * (1 + 2.0**-31), lambda q: (2 * q) ** -(10**9)),
    "odd": ("(2*q.odd)**12345679", -0.5 * (1 + 2.0**-26), lambda q: (2 * q) ** 12345679),
    "tower": ("((q.tower**1000)**1000)**1000", 1.0, lambda q: q**10**9),
    "squares": ("((((q.squares**16)**16)**16)**16)**16", 1.0, lambda q: q**16**5),
    "root": ("(2*q.root)**2.5", 0.7, lambda q: (2 * q) ** mpmath.mpf(2.5)),
    "product": ("(1e200*q.product)**16", 3e-200, lambda q: (mpmath.mpf(1e200) * q) ** 16),
    "small": ("(1e-30*q.small)**12", 2e30, lambda q: (mpmath.mpf(1e-30) * q) ** 12),
    "cube": ("(q.cube/4)**3 - 2*(3*q.cube)**2 + q.cube**-2", 0.7, lambda q: (q / 4) ** 3 - 2 * (3 * q) ** 2 + q**-2),
    "variable": ("(2*q.variable)**(1 + q.variable)", 0.6, lambda q: (2 * q) ** (1 + q)),
    "base": ("1.5**(8*q.base)", 0.6, lambda q: mpmath.mpf(1.5) ** (8 * q)),
}


def sliders(forces: dict[str, str]) -> Model:
    """Unit masses on separate rails: each acceleration equals its force."""
    bodies = "".join(f"  {n}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}\n" for n in forces)
    lines = "".join(f'  {n}: {{type: joint, joint: {n}, value: "{f}"}}\n' for n, f in forces.items())
    return parse_model(f"model: sliders\nbodies:\n{bodies}forces:\n{lines}", "m.yaml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("powers") / "sliders"
    codegen.generate(sliders({n: f for n, (f, *_) in CASES.items()}), path, target="both")
    return path


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_powers_and_their_derivatives_are_exact(folder: Path, target: str) -> None:
    solver = codegen.load(folder, target)
    q = np.array([state for _, state, _ in CASES.values()])
    udot, dudot = solver.sensitivities(q, np.zeros(len(q)), dq=np.eye(len(q)))
    with mpmath.workdps(80):
        for i, (name, (_, state, f)) in enumerate(CASES.items()):
            value, slope = (
                f(mpmath.mpf(state)),
                mpmath.diff(f, mpmath.mpf(state), h=mpmath.mpf(state) * mpmath.mpf(10) ** -40),
            )
            assert abs(udot[i] / value - 1) < 1e-14, name
            assert abs(dudot[i, i] / slope - 1) < 1e-14, name
    assert np.count_nonzero(dudot) == len(q)


@pytest.mark.parametrize(
    "value",
    ["(2*q.a)**1000000000", "(2*q.a)**-1000000000", "(3*q.a)**1e300", "(7*q.a/3)**10000000", "((q.a**1000)**1000)**1000", "(q.a - q.a + 1)**100000",
     "(q.a*u.a*t*7)**123456789", "((((5*q.a)**999)**999)**999)**999", "(-3*q.a)**99999999", "2**q.a**1000000000", "(q.a - q.a + 1e300)**(t - t + 0.5)"],
)  # fmt: skip
def test_large_powers_take_no_time(value: str) -> None:
    start = time.process_time()
    write_solver(sliders({"a": value}))
    assert time.process_time() - start < 10


def test_large_powers_of_parameters_take_no_time() -> None:
    model = parse_model("""
model: rod
parameters: {L: 0.5}
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: x, at: [0, 0, (4*L)**-1000000]}, mass: (2*L)**1000000000, com: [0, 0, (2*L)**-1000000007]}
""")
    start = time.process_time()
    files = write_solver(model).files
    assert time.process_time() - start < 10
    assert "pow(" in files["rod.c"] and "np.power(" in files["rod_numpy.py"]


@pytest.mark.parametrize(
    "value",
    ["exp(t - t + 1e300)", "exp(exp(t - t + 1e5))", "(q.a - q.a + 10)**1000000000", "cosh(exp(q.a - q.a + 700))*q.a"],
)
def test_what_overflows_in_every_state_has_no_value(value: str) -> None:
    start = time.process_time()
    with pytest.raises(ModelError, match="has no value or no derivative") as info:
        write_solver(sliders({"a": value}))
    assert time.process_time() - start < 10
    (problem,) = info.value.problems
    assert (problem.file, problem.line, problem.column, problem.path) == ("m.yaml", 5, 3, "forces.a.value")


def test_formulas_of_one_form_share_what_they_have_in_common() -> None:
    forces = {f"a{k}": f"3*q.a{k}**5 + {k}*u.a{k}" for k in range(3, 8)}
    source = write_solver(sliders(forces)).files["sliders_numpy.py"]
    assert source.count("3.0*") >= 1 and "7.0" in source
