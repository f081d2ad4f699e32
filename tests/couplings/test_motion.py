"""Motions with coupled coordinates: energy, closure, gradients forward and by the adjoint, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from coupled_models import FIVE, MODELS
from made_once import solvers

from codegen.runtime import Final

WINCH = """
model: winch
gravity: [0, 0, -9.81]
parameters: {radius: 0.2, J: 0.05, m: 1.5, n: -4, Jm: 0.001}
bodies:
  motor: {parent: ground, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: Jm, yy: Jm, zz: Jm}}
  drum: {parent: ground, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: J, yy: J, zz: J}}
  load: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
couplings:
  gear: {joint: motor, follows: {drum: n}}
  rope: {joint: load, follows: {drum: radius}, offset: 0.1}
outputs: {kinetic: kinetic_energy, potential: potential_energy}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return solvers(tmp_path_factory)


def test_a_winch_falls_as_its_reflected_inertia_says(made) -> None:
    """Constant acceleration of the drum, -m g radius / (J + n^2 Jm + m radius^2), and its derivatives."""
    solver = made(WINCH, "c")
    radius, J, m, n, Jm, g = 0.2, 0.05, 1.5, -4.0, 0.001, 9.81
    run = solver.simulate([0.0, 0.7], sensitivities=solver.parameter_names, rtol=1e-11, atol=1e-11)
    inertia = J + n**2 * Jm + m * radius**2
    turned = -m * g * radius / inertia * 0.7**2 / 2
    assert run.q[-1] == pytest.approx([n * turned, turned, radius * turned + 0.1], rel=1e-12)
    by_inertia = -turned / inertia
    by = {"radius": turned / radius + by_inertia * 2 * m * radius, "J": by_inertia, "m": turned / m + by_inertia * radius**2,
          "n": by_inertia * 2 * n * Jm, "Jm": by_inertia * n**2}  # fmt: skip
    drum = run.dq[:, -1, 1]
    assert drum == pytest.approx([by[name] for name in solver.parameter_names], rel=1e-11)
    # what follows moves with its own ratio too
    motor, load = run.dq[:, -1, 0], run.dq[:, -1, 2]
    assert motor == pytest.approx(n * drum + turned * np.eye(5)[3], rel=1e-11, abs=1e-12)
    assert load == pytest.approx(radius * drum + turned * np.eye(5)[0], rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(("method", "options"), [
    ("dop853", {"rtol": 1e-11, "atol": 1e-11}), ("radau", {"rtol": 1e-10, "atol": 1e-10}), ("rk4", {"step": 2e-4}),
])  # fmt: skip
def test_energy_is_kept_and_couplings_stay_met(made, method: str, options: dict) -> None:
    for text in (FIVE.replace("BASE", "ground").replace(" - 0.1*u.a", ""), MODELS["sharing"]):
        solver = made(text, "c")
        q, u = solver.assemble(solver.initial[0], 0.5 * np.ones(solver.nu))
        run = solver.simulate(0.3, q=q, u=u, method=method, **options)
        energy = run.outputs[:, 0] + run.outputs[:, 1]
        assert np.ptp(energy) < 1e-8 * np.abs(run.outputs).max()
        closure = [solver.closure(a, b) for a, b in zip(run.q, run.u, strict=True)]
        assert np.abs(closure).max() < 1e-10


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_gradients_of_a_motion_are_the_same_forward_and_backward(made, method: str) -> None:
    solver = made(FIVE.replace("BASE", "ground"), "c")
    options = {"integrator": method, "rtol": 1e-8, "atol": 1e-8}
    forward, back = (
        solver.judge(0.3, Final("kinetic"), wrt=solver.parameter_names, method=way, **options)
        for way in ("forward", "adjoint")
    )
    assert back.values == pytest.approx(forward.values, rel=1e-13)
    assert back.gradients == pytest.approx(forward.gradients, rel=1e-9, abs=1e-9)
