"""Andrews' squeezing mechanism: published accelerations and multipliers of a plane mechanism of 7 bodies and 3 loops.

Data and initial values: Test Set for IVP Solvers, problem "andrews" (release 2.4, andrews.f), where the equations stand in
absolute and relative angles of a tree that is cut in point E three times: M qdd + G^T lambda = f. The state at 0.03 s is an
index-1 solution by an extrapolation method of order 16 in 80-bit numbers, good to 13 digits in q, qd and to 8e-14 in qdd and
lambda between two step sizes.
"""

import mpmath
import numpy as np
import pytest
from random_models import expression, vector

from codegen.loops.partition import Ear, Partition
from codegen.model.forces import Spring
from codegen.model.model import Body, Face, Joint, JointForce, Loop, Model, Parameter, Point
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)

DATA = {
    "m1": "0.04325", "m2": "0.00365", "m3": "0.02373", "m4": "0.00706", "m5": "0.07050", "m6": "0.00706",
    "m7": "0.05498", "xa": "-0.06934", "ya": "-0.00227", "xb": "-0.03635", "yb": "0.03273", "xc": "0.014",
    "yc": "0.072", "c0": "4530", "i1": "2.194e-6", "i2": "4.410e-7", "i3": "5.255e-6", "i4": "5.667e-7",
    "i5": "1.169e-5", "i6": "5.667e-7", "i7": "1.912e-5", "d": "28e-3", "da": "115e-4", "e": "2e-2", "ea": "1421e-5",
    "rr": "7e-3", "ra": "92e-5", "l0": "7785e-5", "ss": "35e-3", "sa": "1874e-5", "sb": "1043e-5", "sc": "18e-3",
    "sd": "2e-2", "ta": "2308e-5", "tb": "916e-5", "uu": "4e-2", "ua": "1228e-5", "ub": "449e-5", "zf": "2e-2",
    "zt": "4e-2", "fa": "1421e-5", "mom": "0.033",
}  # fmt: skip

# In the order beta, theta, gamma, phi, delta, Omega, epsilon.
INITIAL_Q = (
    "-0.0617138900142764496358948458001", "0", "0.455279819163070380255912382449", "0.222668390165885884674473185609",
    "0.487364979543842550225598953530", "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
)  # fmt: skip
INITIAL_QDD = ("14222.4439199541138705911625887", "-10666.8329399655854029433719415", "0", "0", "0", "0", "0")
INITIAL_LAMBDA = ("98.5668703962410896057654982170", "-6.12268834425566265503114393122", "0", "0", "0", "0")

LATER_Q = (
    "1.5810771195153704691e+01", "-1.5756371058411837046e+01", "4.0822240119646751159e-02",
    "-5.3473011634207794399e-01", "5.2440996587995403308e-01", "5.3473011634207770118e-01",
    "1.0480807410419377723e+00",
)  # fmt: skip
LATER_QD = (
    "1.1399203022591064587e+03", "-1.4243792951775405951e+03", "1.1032911910618192986e+01",
    "1.9293374105031347900e+01", "5.7356991482946315114e-01", "-1.9293374105031356086e+01",
    "3.2317914924916315769e-01",
)  # fmt: skip
LATER_QDD = (
    "-2.4631763122872729166e+04", "5.1850319636460715646e+04", "3.2410260070757890045e+05",
    "5.6674942200099581009e+05", "1.6743635418345231852e+04", "-5.6674942200099580765e+05",
    "9.8265078015451039537e+03",
)  # fmt: skip
LATER_LAMBDA = (
    "1.9917534810453891819e+02", "-2.9755309974972355842e+01", "2.3066543611622117575e+01",
    "3.1452725275770739257e+01", "2.2642494786394408482e+01", "1.1617392352612265615e+01",
)  # fmt: skip


def andrews():
    """Andrews' mechanism in the x-y plane; all bodies rotate about z, and the crank's angle beta is independent."""
    zero = expression(0)

    def body(name, parent, at, k, com):
        inertia = (zero, zero, expression(f"i{k}"), zero, zero, zero)
        joint = Joint("revolute", (vector(0, 0, 1),), vector(*at))
        return Body(name, parent, joint, expression(f"m{k}"), vector(*com), inertia)

    bodies = (
        body("beta", -1, (0, 0, 0), 1, ("ra", 0, 0)),  # crank OF
        body("theta", 0, ("rr", 0, 0), 2, ("-da", 0, 0)),  # FE, E at -d
        body("gamma", -1, ("xb", "yb", 0), 3, ("sb", "-sa", 0)),  # triangle BDE, E at (0, -ss)
        body("phi", 4, ("zt", 0, 0), 4, (0, "-(e - ea)", 0)),  # GE, E at (0, -e)
        body("delta", -1, ("xa", "ya", 0), 5, ("ta", "tb", 0)),  # AG
        body("Omega", 6, (0, "-uu", 0), 6, ("zf - fa", 0, 0)),  # HE, E at (zf, 0)
        body("epsilon", -1, ("xa", "ya", 0), 7, ("ua", "ub", 0)),  # AH
    )
    z, on_theta = (vector(0, 0, 1),), Face(1, vector("-d", 0, 0))
    others = (Face(2, vector(0, "-ss", 0)), Face(3, vector(0, "-e", 0)), Face(5, vector("zf", 0, 0)))
    loops = tuple(Loop(f"E{i + 1}", "revolute", z, face, on_theta) for i, face in enumerate(others))
    spring = Spring(
        "spring", Point("D", 2, vector("sd", "-sc", 0)), Point("C", -1, vector("xc", "yc", 0)),
        expression("c0"), zero, expression("l0"),
    )  # fmt: skip
    model = Model(
        "andrews", None, tuple(Parameter(name, float(x)) for name, x in DATA.items()), (), bodies, loops,
        (JointForce("motor", 0, (expression("mom"),)),), (spring,),
        initial_q=dict(zip((b.name for b in bodies), (expression(float(x)) for x in INITIAL_Q), strict=True)),
    )  # fmt: skip
    ears = tuple(Ear((i,), pair, 5, 2, 1.0, 2.0**-5) for i, pair in enumerate(((1, 2), (3, 4), (5, 6))))
    return model, Partition(ears, (0,))


def numbers(texts):
    return np.array([mpmath.mpf(x) for x in texts])


@pytest.mark.parametrize("engine", ENGINES)
def test_initial_accelerations_to_every_published_digit(engine):
    model, partition = andrews()
    with mpmath.workdps(40):
        e = engine(model, "mpmath", partition)
        q, p = numbers(INITIAL_Q), numbers(DATA.values())
        udot, published = e.accelerations(q, numbers(["0"] * 7), p), numbers(INITIAL_QDD)
        assert abs(udot[:2] / published[:2] - 1).max() < 1e-27
        assert abs(udot[2:]).max() < 1e-22
        if engine is DenseEngine:
            lambdas, published = multipliers(e.reactions(q, numbers(["0"] * 7), p)), numbers(INITIAL_LAMBDA)
            assert abs(lambdas[:2] / published[:2] - 1).max() < 1e-27
            assert abs(lambdas[2:]).max() < 1e-22


def multipliers(reactions):
    """The problem's constraints are the position of E on body theta less that on the other, along x and y: the force on theta
    is minus lambda. Nothing acts out of the plane.
    """
    assert max(abs(reactions[:, :3]).max(), abs(reactions[:, 5]).max()) <= 1e-13 * abs(reactions).max()
    return -reactions[:, 3:5].ravel()


@pytest.mark.parametrize("engine", ENGINES)
def test_accelerations_in_floats(engine):
    model, partition = andrews()
    for e in (engine(model, partition=partition), engine(model)):
        q = np.array(INITIAL_Q, dtype=float)
        udot = e.accelerations(q, np.zeros(7))
        np.testing.assert_allclose(udot, np.array(INITIAL_QDD, dtype=float), rtol=1e-13, atol=1e-9)
        # At 0.03 s the digits given for q are the limit: 2e-16 in gamma's position is 1e-12 in its acceleration.
        q, u = np.array(LATER_Q, dtype=float), np.array(LATER_QD, dtype=float)
        np.testing.assert_allclose(e.complete(q, u)[0], u, rtol=1e-12)
        np.testing.assert_allclose(e.accelerations(q, u), np.array(LATER_QDD, dtype=float), rtol=1e-11)
        position, velocity = e.closure(q, u)
        assert np.abs(position).max() < 1e-14 and np.abs(velocity).max() < 1e-11
        if engine is DenseEngine:
            np.testing.assert_allclose(multipliers(e.reactions(q, u)), np.array(LATER_LAMBDA, dtype=float), rtol=1e-11)
