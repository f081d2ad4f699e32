"""Mechanisms whose equations of motion are known from textbooks."""

import numpy as np
import pytest
from random_models import expression, vector

from codegen.model.model import Body, Joint, JointForce, Model, Output, Parameter, Point
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)
NOTHING = (expression(0),) * 6
G = 9.81

# Point masses m1, m2 on massless rods L1, L2, hinged about y, hanging along -z.
PARAMETERS = (Parameter("L1", 1.3), Parameter("L2", 0.7), Parameter("m1", 2.0), Parameter("m2", 0.9))


def pendulum(n):
    bodies = [
        Body(
            f"rod{k + 1}",
            k - 1,
            Joint("revolute", (vector(0, 1, 0),), vector(0, 0, 0 if k == 0 else "-L1")),
            expression(f"m{k + 1}"),
            vector(0, 0, f"-L{k + 1}"),
            NOTHING,
        )
        for k in range(n)
    ]
    tip = Output("x", "position", (Point("tip", n - 1, vector(0, 0, f"-L{n}")),), vector(1, 0, 0))
    return Model("pendulum", vector(0, 0, -G), PARAMETERS, (), tuple(bodies), outputs=(tip,))


@pytest.mark.parametrize("engine", ENGINES)
def test_pendulum(engine):
    e, q, L = engine(pendulum(1)), 0.4, PARAMETERS[0].value
    # qddot = -g/L sin q, whatever the mass; positive q about y swings the bob to -x.
    udot, dudot = e.sensitivities([q], [0.8], dp=np.eye(4))
    np.testing.assert_allclose(udot, [-G / L * np.sin(q)], rtol=1e-14)
    np.testing.assert_allclose(dudot[:, 0], [G / L**2 * np.sin(q), 0, 0, 0], rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(e.jacobians([q], [0.8]).q, [[-G / L * np.cos(q)]], rtol=1e-14)
    np.testing.assert_allclose(e.outputs([q], [0.8]), [-L * np.sin(q)], rtol=1e-14)
    np.testing.assert_allclose(e.energies([q], [0.8]), [2 * L**2 * 0.8**2 / 2, -2 * G * L * np.cos(q)], rtol=1e-14)
    np.testing.assert_allclose(e.mass_matrix([q]), [[2 * L**2]], rtol=1e-15)


@pytest.mark.parametrize("engine", ENGINES)
def test_double_pendulum(engine):
    """Lagrange's equations in the absolute angles a1 = q1, a2 = q1 + q2."""
    e, q, u = engine(pendulum(2)), np.array([0.4, -0.9]), np.array([1.1, 0.3])

    def udot(p):
        (L1, L2, m1, m2), (a1, a2), (w1, w2) = p, np.cumsum(q), np.cumsum(u)
        d = a1 - a2
        M = np.array([[(m1 + m2) * L1**2, m2 * L1 * L2 * np.cos(d)], [m2 * L1 * L2 * np.cos(d), m2 * L2**2]])
        K = np.array(
            [
                -m2 * L1 * L2 * np.sin(d) * w2**2 - (m1 + m2) * G * L1 * np.sin(a1),
                m2 * L1 * L2 * np.sin(d) * w1**2 - m2 * G * L2 * np.sin(a2),
            ]
        )
        return np.diff(np.linalg.solve(M, K), prepend=0)

    p = np.array([x.value for x in PARAMETERS])
    np.testing.assert_allclose(e.accelerations(q, u), udot(p), rtol=1e-13)
    # Complex steps through the closed form: derivatives without rounding.
    step = 1e-30
    expected = np.array([udot(p + 1j * step * x).imag / step for x in np.eye(4)])
    np.testing.assert_allclose(e.sensitivities(q, u, dp=np.eye(4))[1], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_free_body(engine):
    """Euler's equations, and a body origin that is not the mass centre."""
    inertia = tuple(expression(x) for x in (0.4, 0.7, 0.9, 0.05, -0.02, 0.03))
    c, m, J = np.array([0.1, -0.2, 0.3]), 1.7, np.array([[0.4, 0.05, -0.02], [0.05, 0.7, 0.03], [-0.02, 0.03, 0.9]])
    body = Body("b", -1, Joint("free", (), vector(0.3, 0.1, 0)), expression(m), vector(*map(float, c)), inertia)
    torque = np.array([0.3, -0.1, 0.2, 1.0, 2.0, -1.0])  # about the body's origin, and at it, in body axes
    force = JointForce("f", 0, tuple(expression(float(x)) for x in torque))
    e = engine(Model("body", vector(0, 0, -G), (), (), (body,), forces=(force,)))
    q = np.array([0.5, 0.6, 0.7, 0.8, 0.0, 0.6, 0.0])  # turned about y by 2 acos 0.8
    u = np.array([0.5, -0.4, 0.9, 0.2, 0.1, -0.3])
    s, co = 2 * 0.8 * 0.6, 0.8**2 - 0.6**2
    R = np.array([[co, 0, s], [0, 1, 0], [-s, 0, co]])
    w, v, weight = u[:3], u[3:], m * R.T @ [0, 0, -G]
    alpha = np.linalg.solve(J, torque[:3] - np.cross(c, torque[3:]) - np.cross(w, J @ w))
    acceleration = (torque[3:] + weight) / m  # of the mass centre, body components
    # a_centre = vdot + w x v + alpha x c + w x (w x c), vdot in body components
    vdot = acceleration - np.cross(w, v) - np.cross(alpha, c) - np.cross(w, np.cross(w, c))
    np.testing.assert_allclose(e.accelerations(q, u), [*alpha, *vdot], rtol=1e-13)
    rates = e.coordinate_rates(q, u)
    np.testing.assert_allclose(rates[:3], R @ v, rtol=1e-14)
    e0, ev = q[3], q[4:]
    np.testing.assert_allclose(rates[3:], [-ev @ w / 2, *((e0 * w + np.cross(ev, w)) / 2)], rtol=1e-14, atol=1e-16)
    height = np.array([0.3, 0.1, 0]) + q[:3] + R @ c
    np.testing.assert_allclose(e.energies(q, u)[1], m * G * height[2], rtol=1e-14)


@pytest.mark.parametrize("engine", ENGINES)
def test_universal_joint_is_two_revolute_joints(engine):
    inertia = tuple(expression(x) for x in (0.4, 0.7, 0.9, 0.05, -0.02, 0.03))
    mass, com, at = expression(1.2), vector(0.1, 0.2, -0.4), vector(0.2, 0, 0.1)
    y, x, none = vector(0, 1, 0), vector(1, 0, 0), vector(0, 0, 0)
    one = (Body("b", -1, Joint("universal", (y, x), at), mass, com, inertia),)
    two = (
        Body("a", -1, Joint("revolute", (y,), at), expression(0), none, NOTHING),
        Body("b", 0, Joint("revolute", (x,), none), mass, com, inertia),
    )
    q, u = [0.4, 0.7], [1.0, -0.3]
    a, b = (engine(Model("m", vector(1, 2, -G), (), (), bodies)).jacobians(q, u) for bodies in (one, two))
    np.testing.assert_allclose(a.q, b.q, rtol=1e-13)
    np.testing.assert_allclose(a.u, b.u, rtol=1e-13)
