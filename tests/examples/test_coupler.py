"""A four-bar that guides a point: its curve against intersections of two circles, and its energy."""

import numpy as np
import pytest
from motions import built, meeting, motion


def test_the_coupler_leads_its_point_along_the_curve_of_two_circles(tmp_path):
    """All round, at other parameters; derivatives against differences of the circles as well, coarsely."""
    solver = built("coupler", tmp_path, "outputs", "output_sensitivities", "assemble_sensitivities", "closure")
    chosen = {"crank": 0.3, "coupler": 0.8, "along": 0.3, "across": -0.2, "A_x": 0.1, "A_y": -0.05, "B_y": 0.1}
    p = np.array([chosen.get(n, x) for n, x in zip(solver.parameter_names, solver.parameters, strict=True)])

    def point(angle, p):
        of = dict(zip(solver.parameter_names, p, strict=True))
        A, B = np.array([of["A_x"], of["A_y"]]), np.array([of["B_x"], of["B_y"]])
        C = A + of["crank"] * np.array([np.cos(angle), np.sin(angle)])
        D = meeting(C, B, of["coupler"], of["rocker"], 1)
        e = (D - C) / of["coupler"]
        return C + of["along"] * e + of["across"] * np.array([-e[1], e[0]])

    q = solver.initial[0]
    for angle in np.linspace(0.5, 0.5 + 2 * np.pi, 25):
        q[0] = angle
        q, u, dq, du = solver.assemble_sensitivities(q, np.zeros(3), p, dp=np.eye(solver.np))
        assert np.abs(solver.closure(q, u, p)[0]).max() < 1e-12
        values, derivatives = solver.output_sensitivities(q, u, p, dq=dq, du=du, dp=np.eye(solver.np))
        assert values[:2] == pytest.approx(point(angle, p), abs=1e-12)
        steps = [(point(angle, p + h) - point(angle, p - h)) / 2e-6 for h in 1e-6 * np.eye(solver.np)]
        assert derivatives[:, :2] == pytest.approx(np.array(steps), abs=1e-8)


def test_the_four_bar_of_the_coupler_keeps_its_energy(tmp_path):
    solver = built("coupler", tmp_path, "accelerations", "energies", "closure")
    q, u = solver.initial
    states = motion(solver, q, u, [0.5, 1.0, 2.0], {"friction": 0, "flywheel": 0.05})
    energies = [np.sum(solver.energies(q, u, {"flywheel": 0.05})) for q, u in [(q, u), *states]]
    assert np.ptp(energies) < 1e-9 * energies[0]
    assert states[-1][0][0] > 10, "the crank turns round"
    assert np.abs(solver.closure(*states[-1])[0]).max() < 1e-9
