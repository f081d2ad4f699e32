"""The cart with a pole against Lagrange's equations, and its energy."""

import itertools

import numpy as np
import pytest
from motions import built, motion


def test_the_pole_on_the_cart_follows_lagranges_equations(tmp_path):
    solver = built("swing_up", tmp_path, "accelerations", "jacobians", "energies", "outputs")
    p = dict(zip(solver.parameter_names, solver.parameters, strict=True))
    M, L, m, bob = (p[n] for n in ("cart_mass", "pole_length", "pole_mass", "bob_mass"))
    first, second = (m / 2 + bob) * L, (m / 3 + bob) * L * L  # moments of mass about the hinge
    for angle, speed, spin, push in itertools.product((0.0, 1.0, 2.8), (0.7,), (0.0, -3.0), (0.0, 5.0)):
        c, s = np.cos(angle), np.sin(angle)
        mass = [[M + m + bob, first * c], [first * c, second]]
        force = [push - 0.1 * speed + first * s * spin**2, -9.81 * first * s - 0.002 * spin]
        expected = np.linalg.solve(mass, force)
        assert solver.accelerations([0.3, angle], [speed, spin], inputs=[push]) == pytest.approx(expected, rel=1e-12)
    upright = solver.jacobians([0.0, np.pi], [0.0, 0.0])
    rate = 9.81 * first * (M + m + bob) / ((M + m + bob) * second - first**2)
    assert upright.q[1, 1] == pytest.approx(rate, rel=1e-12), "it falls over from the aim, which is at rest"
    assert np.abs(solver.accelerations([0.0, np.pi], [0.0, 0.0])).max() < 1e-14
    still = {"cart_damping": 0.0, "pole_damping": 0.0}
    states = motion(solver, [0, 2.0], [0, 1.0], [0, 1.0, 3.0], still)
    energies = [np.sum(solver.energies(q, u)) for q, u in states]
    assert energies == pytest.approx([energies[0]] * 3, abs=1e-9)
