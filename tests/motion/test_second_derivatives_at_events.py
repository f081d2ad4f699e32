"""Hessians of outputs at events and of the times of events: closed forms, symmetry, differences of gradients."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from motion.models import FALLING
from motion.test_second_derivatives import same_as_differences
from motions import crank_driven_by_its_piston

import codegen
from codegen.runtime import AtEvent, Event, Final

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTIONS = "motion,hessian_products"
TIGHT = {"rtol": 1e-13, "atol": 1e-13}


@pytest.fixture(scope="module")
def falling(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    folder = tmp_path_factory.mktemp("falling") / "package"
    codegen.generate(codegen.parse_model(FALLING), folder, functions=FUNCTIONS)
    return codegen.load(folder)


@pytest.mark.parametrize("method", [{"integrator": "rk4", "step": 0.1}, {"integrator": "dop853"}])
@pytest.mark.parametrize("stop", [True, False])
def test_closed_forms_of_a_falling_stone(falling: codegen.Solver, method: Any, stop: bool) -> None:
    g, h, v, m, push = x = sympy.symbols("g h v m push")
    a, level = g - push / m, sympy.Rational(1, 2)
    fast = sympy.sqrt(v**2 + 2 * a * (h - level))
    e = Event("z", 0.5, "down", stop)
    outputs = {"t": (v + fast) / a, "w": -fast, "cube": sympy.Integer(0), "force": push}
    at = dict(zip(x, (9.81, 2.0, 0.7, 1.3, 1.5), strict=True))
    p = {str(name): value for name, value in at.items() if name is not push}
    found = falling.judge(
        2.0, [AtEvent(name, e) for name in outputs], p=p, inputs=[1.5], wrt=("g", "h", "v", "m", "inputs.push"),
        hessian=True, **method,
    )  # fmt: skip
    for name, formula, gradient, hessian in zip(
        outputs, outputs.values(), found.gradients, found.hessian_products, strict=True
    ):
        wanted = np.array(sympy.hessian(formula, x).subs(at), float)
        np.testing.assert_allclose(gradient, [float(sympy.diff(formula, of).subs(at)) for of in x], atol=1e-12)
        np.testing.assert_allclose(hessian, wanted, rtol=0, atol=1e-11, err_msg=name)


WRT = ("pole_length", "bob_mass", "cart_damping", "q0.pole", "u0.cart", "inputs.push[1]", "inputs.push[2]")


def test_trees_with_inputs_over_time(tmp_path: Path) -> None:
    """An output that reads the input changes with the input's rate at the event. Compiled products of outputs are the same."""
    solvers = []
    for name in (FUNCTIONS, f"{FUNCTIONS},output_hessian_products"):
        folder = tmp_path / f"package{len(solvers)}"
        codegen.generate(EXAMPLES / "swing_up.yaml", folder, functions=name)
        solvers.append(codegen.load(folder))

    def judge(x: np.ndarray, solver: codegen.Solver = solvers[0], stop: bool = True, **more: Any) -> Any:
        push = np.array([1.0, x[5], x[6], 0.5])
        e, p = Event("angle", 0.3, stop=stop), dict(zip(WRT[:3], x[:3], strict=True))
        wanted = [AtEvent(name, e) for name in ("t", "tip_x", "effort", "kinetic")]
        inputs = (np.linspace(0.0, 1.0, 4), push, "cubic")
        return solver.judge(1.0, wanted, [0.1, x[3]], [x[4], -0.4], p, inputs, wrt=WRT, **TIGHT, **more)

    x = np.array([0.6, 0.2, 0.1, 0.7, 0.3, -2.0, 3.0])
    hessians = same_as_differences(judge, x, np.full(7, 2e-3), 1e-9)
    compiled = judge(x, solvers[1], hessian=True).hessian_products
    goes_on = judge(x, stop=False, hessian=True).hessian_products
    for one, other, third in zip(hessians, compiled, goes_on, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max())
        np.testing.assert_allclose(one, third, rtol=0, atol=1e-10 * np.abs(one).max())


def test_prescribed_motion_that_follows_an_input(tmp_path: Path) -> None:
    """The driving force reads the acceleration of the input; the motion, and an output, read time as well."""
    text = (EXAMPLES / "shaken_pendulum.yaml").read_text()
    for old, new in {
        "bodies:": "inputs: [shake]\nbodies:",
        "amplitude*cos(2*pi*frequency*t)": "amplitude*cos(2*pi*frequency*t) + shake",
        "  kinetic: kinetic_energy": "  swing: {value: q.rod + 0.1*t*q.tip**2}\n  kinetic: kinetic_energy",
    }.items():
        text = text.replace(old, new, 1)
    (tmp_path / "shaken.yaml").write_text(text)
    codegen.generate(tmp_path / "shaken.yaml", tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("amplitude", "frequency", "length", "q0.rod", "u0.tip", "inputs.shake[2]")

    def judge(x: np.ndarray, **more: Any) -> Any:
        e, p = Event("swing", 0.6, "up"), dict(zip(wrt[:3], x[:3], strict=True))
        wanted = [AtEvent(name, e) for name in ("t", "motor", "height", "kinetic")]
        inputs = (np.linspace(0.0, 1.0, 6), np.array([0.0, 0.05, x[5], 0.02, -0.1, 0.1]), "quintic")
        return solver.judge(1.0, wanted, [x[3], 0.25], [0.2, x[4]], p, inputs, wrt=wrt, **TIGHT, **more)

    x = np.array([0.2, 1.5, 0.3, 0.4, 0.2, 0.1])
    same_as_differences(judge, x, 1e-3 * x, 1e-8)


@pytest.mark.parametrize(("time", "more"), [("before", ""), ("after", ",output_hessian_products")])
def test_loops_before_and_after_a_change_of_independents(tmp_path: Path, time: str, more: str) -> None:
    solver = crank_driven_by_its_piston(tmp_path, FUNCTIONS + more)
    wrt = ("crank_length", "rod_length", "offset", "q0.piston", "u0.piston", "inputs.load")
    q0, u0 = solver.initial_state()
    place = solver.coordinate_names.index("piston")
    e = Event("stroke", 0.45, {"before": "down", "after": "up"}[time], stop=False)

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip(wrt[:3], x[:3], strict=True)), q0.copy(), u0.copy()
        q[place], u[place] = x[3:5]
        q, u = solver.assemble(q, u, p)
        wanted = [AtEvent("t", e), AtEvent("kinetic", e), Final("stroke")]
        found = solver.judge(0.4, wanted, q, u, p, [x[5]], wrt=wrt, rtol=1e-12, atol=1e-12, **more)
        assert found.counts["partitions_changed"] == 1
        assert (found.values[0] > 0.15) == (time == "after")
        return found

    same_as_differences(judge, np.array([0.15, 0.5, 0.02, q0[place], u0[place], 0.5]), np.full(6, 1e-4), 1e-6, 1e-11)


def test_events_at_which_an_output_jumps_are_refused(falling: codegen.Solver) -> None:
    jump = ([0.0, 0.2, 0.4], [0.0, 2.0, 1.0], "hold")
    with pytest.raises(ValueError, match=r"hessian: force jumps over the level 1 of an event at t = 0\.2 s"):
        falling.judge(1.0, AtEvent("z", Event("force", 1.0)), inputs=jump, wrt="g", hessian=True)
