"""Mechanisms with one degree of freedom whose closure has a closed form, against the engines.

The independent route: positions of all mass centres as functions of the crank's angle alone, Lagrange's equation in that
angle, and every derivative a central difference of mpmath numbers of 60 digits.
"""

import mpmath
import numpy as np
import pytest
from mpmath import mpf
from random_models import expression, vector

from codegen.loops.partition import Ear, Partition
from codegen.model.forces import Spring
from codegen.model.model import Body, Face, Joint, JointForce, Loop, Model, Output, Parameter, Point
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = [RecursiveEngine, DenseEngine]
G = 9.81
NAMES = ("a", "b", "c", "d", "rho", "k", "l0", "damping")
DEFAULTS = (0.4, 1.1, 0.8, 1.0, 1.7, 30.0, 0.5, 0.9)
Q, U, MOTOR = 0.7, 1.3, 2.1
P = np.array([0.41, 1.08, 0.83, 1.02, 1.6, 29.0, 0.45, 0.8])


def rod(name, parent, at, length):
    """A slender rod along z, hinged about y at its lower end."""
    I, zero = expression(f"rho*{length}**3/12"), expression(0)
    joint = Joint("revolute", (vector(0, 1, 0),), vector(*at))
    mass = expression(f"rho*{length}")
    return Body(name, parent, joint, mass, vector(0, 0, f"{length}/2"), (I, I, zero, zero, zero, zero))


def model(name, bodies, loop, dependent):
    drive = JointForce("drive", 0, (expression(f"motor - 0.1*u.{bodies[2].name}"),))
    ends = (Point("", 0, vector(0, 0, "a")), Point("", -1, vector(0.3, 0, 1.2)))
    spring = Spring("spring", *ends, *map(expression, ("k", "damping", "l0")))
    tip = Output("x", "position", (Point("tip", 2, vector(0, 0, 0)),), vector(1, 0, 0))
    parameters = tuple(Parameter(n, v) for n, v in zip(NAMES, DEFAULTS, strict=True))
    free = tuple({0, 1, 2} - set(dependent))
    return Model(
        name, vector(0, 0, -G), parameters, ("motor",), bodies, (loop,), (drive,), (spring,), (tip,)
    ), Partition((Ear((0,), dependent, 5, 2, 1.0, 0.5),), free)


def four_bar(dependent=(1, 2)):
    """Crank a, coupler b, rocker c about y, ground d along x. In space the closure is redundant: 5 conditions, rank 2."""
    bodies = (
        rod("crank", -1, (0, 0, 0), "a"),
        rod("coupler", 0, (0, 0, "a"), "b"),
        rod("rocker", 1, (0, 0, "b"), "c"),
    )
    foot = Loop("foot", "revolute", (vector(0, 1, 0),), Face(2, vector(0, 0, "c")), Face(-1, vector("d", 0, 0)))
    return model("four_bar", bodies, foot, dependent)


def four_bar_angles(q, p):
    """Angles of coupler and rocker about y, from the crank's: intersection of two circles about the crank's tip and the foot."""
    a, b, c, d = p[:4]
    x, z = d - a * mpmath.sin(q), -a * mpmath.cos(q)  # from the tip to the foot: b (sin, cos) B + c (sin, cos) C
    r2, heading = x * x + z * z, mpmath.atan2(x, z)
    r = mpmath.sqrt(r2)
    return [heading - mpmath.acos((b * b + r2 - c * c) / (2 * b * r)),
            heading + mpmath.acos((c * c + r2 - b * b) / (2 * c * r))]  # fmt: skip


def slider_crank(dependent=(1, 2)):
    """Crank a, rod b, and a rod c on the end of b that slides along x without turning."""
    bodies = (
        rod("crank", -1, (0, 0, 0), "a"),
        rod("connecting", 0, (0, 0, "a"), "b"),
        rod("slider", 1, (0, 0, "b"), "c"),
    )
    rail = Loop("rail", "prismatic", (vector(1, 0, 0),), Face(-1, vector(0, 0, 0)), Face(2, vector(0, 0, 0)))
    return model("slider_crank", bodies, rail, dependent)


def slider_crank_angles(q, p):
    a, b = p[:2]
    return [mpmath.acos(-a * mpmath.cos(q) / b), mpf(0)]  # a cos q + b cos B = 0; the slider stays upright


MECHANISMS = {"four_bar": (four_bar, four_bar_angles), "slider_crank": (slider_crank, slider_crank_angles)}


def motions(angles, q, p):
    """The three angles, then x and z of the three mass centres, then the spring's length, for the crank's angle q."""
    absolute = [q, *angles(q, p)]
    x, z, centres = mpf(0), mpf(0), []
    for length, angle in zip(p[:3], absolute, strict=True):
        s, c = length * mpmath.sin(angle), length * mpmath.cos(angle)
        centres += [x + s / 2, z + c / 2]
        x, z = x + s, z + c
    return np.array(
        [*absolute, *centres, mpmath.hypot(p[0] * mpmath.sin(q) - mpf(0.3), p[0] * mpmath.cos(q) - mpf(1.2))]
    )


def lagrange(angles, q, u, p, motor):
    """Accelerations of the three joints, all speeds, both energies: T = m(q) u^2/2, m qdd + m' u^2/2 + V' = Q."""
    h = mpf(10) ** -15
    up, X, down = (motions(angles, q + x, p) for x in (h, 0, -h))
    D, D2 = (up - down) / (2 * h), (up - 2 * X + down) / h**2
    masses = [p[4] * length for length in p[:3]]
    weights = [m * length**2 / 12 for m, length in zip(masses, p[:3], strict=True)]
    weights = np.array([*weights, *(m for m in masses for _ in "xz"), mpf(0)])
    stretch = X[9] - p[6]
    slope = sum(m * mpf(G) * D[4 + 2 * i] for i, m in enumerate(masses)) + p[5] * stretch * D[9]
    joint_force = motor - mpf(0.1) * (D[2] - D[1]) * u
    inertia = weights @ (D * D)
    qdd = (joint_force - p[7] * D[9] ** 2 * u - slope - weights @ (D * D2) * u * u) / inertia
    potential = sum(m * mpf(G) * X[4 + 2 * i] for i, m in enumerate(masses)) + p[5] * stretch**2 / 2
    return np.array([*relative(D2 * u * u + D * qdd), *relative(D * u), inertia * u * u / 2, potential])


def relative(x):
    return x[0], x[1] - x[0], x[2] - x[1]


def reference(angles, seeds):
    """`lagrange` and its derivatives along seeds of the crank's angle and speed, the parameters and the motor."""
    with mpmath.workdps(80):
        q, p = mpf(Q), np.array([mpf(float(x)) for x in P])
        value = lagrange(angles, q, mpf(U), p, mpf(MOTOR))
        h, rows = mpf(10) ** -10, []
        for dq, du, dp, dmotor in zip(*seeds, strict=True):
            both = [
                lagrange(angles, q + s * mpf(dq), mpf(U) + s * mpf(du), p + s * np.array([mpf(x) for x in dp]),
                         mpf(MOTOR) + s * mpf(dmotor))
                for s in (h, -h)
            ]  # fmt: skip
            rows.append((both[0] - both[1]) / (2 * h))
        return value, np.array(rows)


def assembled(angles):
    with mpmath.workdps(30):
        q = mpf(Q)
        return np.array([float(x) for x in relative([q, *angles(q, [mpf(float(x)) for x in P])])])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", MECHANISMS)
def test_accelerations_and_derivatives(engine, name):
    make, angles = MECHANISMS[name]
    model, partition = make()
    e, q, rng = engine(model, partition=partition), assembled(angles), np.random.default_rng(1)
    k = 4
    dq, du, dp, dmotor = rng.normal(size=k), rng.normal(size=k), rng.normal(size=(k, len(P))), rng.normal(size=k)
    value, rows = reference(angles, (dq, du, dp, dmotor))
    nonsense = rng.normal(size=(k, 3))
    seeds = {"dq": np.array([dq, *nonsense[:, 1:].T]).T, "du": np.array([du, *nonsense[:, :2].T]).T, "dp": dp}
    u = [U, 7.0, -5.0]  # dependent ones are not read
    udot, dudot = e.sensitivities(q, u, P, [MOTOR], **seeds, dinputs=dmotor[:, None])
    closed, dclosed = value.astype(float), rows.astype(float)
    np.testing.assert_allclose(udot, closed[:3], rtol=1e-13)
    for j in range(k):
        np.testing.assert_allclose(dudot[j], dclosed[j, :3], rtol=0, atol=2e-12 * np.abs(dclosed[j, :3]).max())
    full_u, dq_full, du_full = e.complete(q, u, P, **seeds)
    np.testing.assert_allclose(full_u, closed[3:6], rtol=1e-13)
    np.testing.assert_allclose(du_full, dclosed[:, 3:6], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(dq_full[:, 0], dq)
    energies, denergies = e.energy_sensitivities(q, u, P, **seeds)
    np.testing.assert_allclose(energies, closed[6:], rtol=1e-13)
    np.testing.assert_allclose(np.array(denergies).T, dclosed[:, 6:], rtol=1e-11)
    position, velocity = e.closure(q, full_u, P)
    assert np.abs(position).max() < 1e-15 and np.abs(velocity).max() < 1e-15
