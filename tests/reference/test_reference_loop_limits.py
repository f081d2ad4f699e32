"""Loops and springs: closed forms, reactions, and the errors and warnings of the engines."""

import dataclasses

import mpmath
import numpy as np
import pytest
from random_mechanisms import assemble
from random_models import expression, relative_error, vector

from codegen.loops.partition import Ear, Partition
from codegen.model.forces import Spring
from codegen.model.model import CLOSURE_ROWS, Body, Face, Joint, Loop, Model, Parameter, Point
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.arithmetic import Arithmetic, LeftInverse, SingularMatrixError

ENGINES = (RecursiveEngine, DenseEngine)
INERTIA = tuple(expression(x) for x in (0.4, 0.7, 0.9, 0.05, -0.02, 0.03))
Y = (vector(0, 1, 0),)


def rod(name, parent, length, at=(0, 0, 0)):
    I, zero = expression(f"{length}**2/12"), expression(0)
    return Body(name, parent, Joint("revolute", Y, vector(*at)), expression(1), vector(0, 0, f"{length}/2"),
                (I, I, zero, zero, zero, zero))  # fmt: skip


def four_bar(dependent=(1, 2), d=1.2):
    """In the x-z plane: crank 0.4, coupler 1.1, rocker 0.8, ground d; ``off`` moves the rocker's hinge out of the plane."""
    bodies = (rod("crank", -1, 0.4), rod("coupler", 0, "b", (0, 0, 0.4)), rod("rocker", 1, 0.8, (0, "off", "b")))
    foot = Loop("foot", "revolute", Y, Face(2, vector(0, 0, 0.8)), Face(-1, vector(d, 0, 0)))
    parameters = (Parameter("b", 1.1), Parameter("off", 0.0))
    model = Model("four_bar", vector(0, 0, -9.81), parameters, (), bodies, (foot,))
    free = tuple(sorted({0, 1, 2} - set(dependent)))
    return model, Partition((Ear((0,), dependent, 5, len(dependent), 1.0, 1.0),), free)


def assembled(model, partition):
    return assemble(DenseEngine(model, partition=partition), [0.3, 1.0, 1.5], [1.1, 0.0])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_parameter_that_bends_a_redundant_loop_is_reported(engine):
    model, partition = four_bar()
    e, q = engine(model, partition=partition), assembled(model, partition)
    with pytest.warns(RuntimeWarning, match=r"foot\.l2 is not met in position along direction 2: 1\.0"):
        e.sensitivities(q, [1, 0, 0], dp=np.eye(2))
    e.sensitivities(q, [1, 0, 0], dp=[1, 0])  # no warning


@pytest.mark.parametrize("engine", ENGINES)
def test_rank_lost_names_loop_joints_and_rank(engine):
    """Coupler and rocker in one line: their speeds do not follow from the crank's."""
    model, partition = four_bar(d=1.5)
    with pytest.raises(SingularMatrixError, match=r"foot.*coupler, rocker at this state: rank 1 of 2"):
        engine(model, partition=partition).accelerations([-np.pi / 2, np.pi, 0], [1, 0, 0])


def test_too_few_dependents_are_noticed():
    model, partition = four_bar(dependent=(2,))
    q = assembled(*four_bar())
    with pytest.raises(SingularMatrixError, match=r"foot\.l\d does not follow from the others: 1 dependent"):
        DenseEngine(model, partition=partition).accelerations(q, [1, 0, 0])
    with pytest.warns(RuntimeWarning, match=r"redundant condition foot\.l\d is not met in velocity"):
        RecursiveEngine(model, partition=partition).accelerations(q, [1, 0, 0])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_partition_has_to_fit_the_model(engine):
    model, partition = four_bar()
    with pytest.raises(ValueError, match="ears close the loops"):
        engine(model, partition=Partition((), (0, 1, 2)))
    with pytest.raises(ValueError, match="either independent or dependent"):
        engine(model, partition=dataclasses.replace(partition, independent=(0, 1)))
    if engine is RecursiveEngine:
        loop = dataclasses.replace(model.loops[0], start=Face(1, vector(0, 0, 0)))
        with pytest.raises(ValueError, match="rocker, which its loops do not pass"):
            engine(dataclasses.replace(model, loops=(loop,)), partition=partition)


@pytest.mark.parametrize("engine", ENGINES)
def test_what_is_for_trees_only_says_so(engine):
    model, partition = four_bar()
    e, q = engine(model, partition=partition), assembled(model, partition)
    for call in (
        lambda: e.solve_mass(q, np.ones(3)),
        lambda: e.solve_mass_sensitivities(q, np.ones(3), dq=np.eye(3)),
        lambda: e.inverse_dynamics(q, np.zeros(3), np.zeros(3)),
        lambda: e.inverse_dynamics_sensitivities(q, np.zeros(3), np.zeros(3), dq=np.eye(3)),
    ):
        with pytest.raises(NotImplementedError, match="model four_bar has closed loops"):
            call()
    tree = dataclasses.replace(model, loops=())
    np.testing.assert_allclose(e.mass_matrix(q), engine(tree).mass_matrix(q), rtol=1e-14)
    u, dq, du = e.complete(q, [1.0, 0.0, 0.0])
    assert u.shape == (3,) and dq.shape == du.shape == (0, 3)
    # A tree is complete as it is.
    u, dq, du = engine(tree).complete(q, [1.0, 2.0, 3.0], dq=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal([u, dq[0], du[0]], [[1, 2, 3], [1, 2, 3], [0, 0, 0]])
    assert [x.shape for x in engine(tree).closure(q, q)] == [(0,), (0,)]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("type", ["fixed", "prismatic", "revolute", "cylindrical", "planar"])
def test_half_a_turn_is_not_closed(engine, type):
    """A joint about x whose second hinge turns about y: the residual is 2 sin(t/2), up to the far side."""
    body = Body("b", -1, Joint("revolute", Y, vector(0, 0, 0)), expression(1), vector(0, 0, 1), INERTIA)
    bodies = (body, dataclasses.replace(body, name="c", parent=0))
    axes = () if type == "fixed" else (vector(1, 0, 0),)
    loop = Loop("l", type, axes, Face(-1, vector(0, 0, 0)), Face(1, vector(0, 0, 0)))
    partition = Partition((Ear((0,), (1,), sum(CLOSURE_ROWS[type]), 1, 1.0, 1.0),), (0,))
    e = engine(Model("m", None, (), (), bodies, (loop,)), partition=partition)
    for angle in (0, 0.5, 2, 3.1, np.pi, -2, -3.1):
        q = [0.3, angle - 0.3]
        position, velocity = e.closure(q, [1, 0])
        np.testing.assert_allclose(np.linalg.norm(position), 2 * abs(np.sin(angle / 2)), rtol=1e-9, atol=1e-15)
        if angle == 0.5:  # with the sign of the velocity that makes it grow
            moving = np.argmax(np.abs(position))
            assert position[moving] * velocity[moving] > 0


@pytest.mark.parametrize("engine", ENGINES)
def test_a_body_on_a_ball_is_a_spherical_pendulum(engine):
    """A free body held in one point by a loop against a tree joint there; the reaction is m (a - g)."""
    m, com, at = expression(1.3), vector(0.1, -0.3, 0.7), vector(0.2, 0.1, -0.4)
    zero, g = vector(0, 0, 0), np.array([0, 0, -9.81])
    held = Body("b", -1, Joint("free", (), zero), m, com, INERTIA)
    ball = Loop("ball", "spherical", (), Face(-1, at), Face(0, zero))
    one = Model("held", vector(0, 0, -9.81), (), (), (held,), (ball,))
    hung = Body("b", -1, Joint("spherical", (), at), m, com, INERTIA)
    two = Model("hung", vector(0, 0, -9.81), (), (), (hung,))
    e = engine(one, partition=Partition((Ear((0,), (3, 4, 5), 3, 3, 1.0, 1.0),), (0, 1, 2)))
    rotation, w = np.array([0.5, 0.1, -0.7, 0.5]), np.array([0.3, -0.8, 1.1])
    q, u = [0.2, 0.1, -0.4, *rotation], [*w, 9, 9, 9]
    expected, dexpected = engine(two).sensitivities(rotation, w, dq=np.eye(4), du=np.eye(3, 3)[[0, 1, 2, 2]])
    dq, du = np.zeros((4, 7)), np.zeros((4, 6))
    dq[:, 3:], du[:, :3] = np.eye(4), np.eye(3)[[0, 1, 2, 2]]
    udot, dudot = e.sensitivities(q, u, dq=dq, du=du)
    np.testing.assert_allclose(udot[:3], expected, rtol=1e-13)
    assert np.abs(udot[3:]).max() < 1e-13  # the held point rests, in body components too
    np.testing.assert_allclose(dudot[:, :3], dexpected, rtol=1e-12, atol=1e-12)
    if engine is DenseEngine:
        x, y, z, s = rotation[1], rotation[2], rotation[3], rotation[0]
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        R = np.eye(3) + 2 * (s * K + K @ K) / (rotation @ rotation)
        r = np.array([0.1, -0.3, 0.7])
        acceleration = R @ (np.cross(expected, r) + np.cross(w, np.cross(w, r)))
        (wrench,) = e.reactions(q, u)
        np.testing.assert_allclose(wrench, [0, 0, 0, *(1.3 * (acceleration - g))], atol=1e-13)


def test_reactions_of_a_redundant_loop_and_their_derivatives():
    """Nothing acts out of the plane; derivatives against differences of assembled systems."""
    model, partition = four_bar()
    with mpmath.workdps(40):
        e = DenseEngine(model, "mpmath", partition)
        b, h = mpmath.mpf("1.1"), mpmath.mpf(10) ** -14
        q, u = assemble(e, [0.3, 1.0, 1.5], [b, 0]), [1.0, 0.0, 0.0]
        reaction, dreaction = e.reaction_sensitivities(q, u, [b, 0], dp=[1, 0], dq=[0.7, 0, 0], du=[-0.3, 0, 0])
        both = [
            e.reactions(
                assemble(e, q + x * np.array([0.7, 0, 0]), [b + x, 0]), [1 - mpmath.mpf(0.3) * x, 0, 0], [b + x, 0]
            )
            for x in (h, -h)
        ]
        assert relative_error(dreaction.reshape(1, 6), ((both[0] - both[1]) / (2 * h)).reshape(1, 6)) < 1e-15
        assert abs(reaction[0, [0, 1, 2, 4]]).max() < 1e-38
    # What the foot does is what the tree lacks: M udot - K of the open chain.
    tree, floats = DenseEngine(dataclasses.replace(model, loops=())), DenseEngine(model, partition=partition)
    q = assembled(model, partition)
    u, _, _ = floats.complete(q, [1.0, 0, 0])
    udot = floats.accelerations(q, u)
    missing = tree.inverse_dynamics(q, u, udot)
    force = -floats.reactions(q, u)[0, [3, 5]]  # on the rocker, which is the loop's start: along x and z
    angles, lengths = np.cumsum(q), (0.4, 1.1, 0.8)
    tips = np.array([[length * np.sin(a), length * np.cos(a)] for length, a in zip(lengths, angles, strict=True)])
    arms = tips[::-1].cumsum(axis=0)[::-1]  # from the three hinges to the foot
    np.testing.assert_allclose(missing, arms[:, 1] * force[0] - arms[:, 0] * force[1], rtol=1e-11)


def test_with_two_equal_joints_in_one_place_each_carries_half():
    """The minimum-norm choice: a second foot on the first one is redundant, row for row."""
    model, partition = four_bar()
    twin = dataclasses.replace(model, loops=(*model.loops, dataclasses.replace(model.loops[0], name="twin")))
    both = Partition((Ear((0, 1), (1, 2), 10, 2, 1.0, 1.0),), (0,))
    q, u = assembled(model, partition), [1.0, 0, 0]
    (single,), halves = (DenseEngine(x, partition=y).reactions(q, u) for x, y in ((model, partition), (twin, both)))
    np.testing.assert_allclose(halves, [single / 2, single / 2], rtol=1e-12, atol=1e-14)
    for engine in ENGINES:
        a, b = (engine(x, partition=y).accelerations(q, u) for x, y in ((model, partition), (twin, both)))
        np.testing.assert_allclose(a, b, rtol=1e-12)


# --- springs ---------------------------------------------------------------------------------------------------------


def slider(free_length, damping):
    body = Body(
        "x", -1, Joint("prismatic", (vector(1, 0, 0),), vector(0, 0, 0)), expression("m"), vector(0, 0, 0), INERTIA
    )
    spring = Spring("s", Point("", -1, vector(0, 0, 0)), Point("", 0, vector(0, 0, 0)),
                    expression("k*(1 + pull) + t"), expression(damping), expression(free_length))  # fmt: skip
    parameters = tuple(Parameter(n, v) for n, v in (("m", 2.0), ("k", 30.0), ("c", 0.7), ("l0", 0.4)))
    return Model("slider", None, parameters, ("pull",), (body,), loads=(spring,))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_mass_on_a_spring(engine):
    """m x'' = -k (x - l0) - c x', with a stiffness of parameters, inputs and t; on the far side everything is mirrored."""
    e, m, k, c, l0, x, u = engine(slider("l0", "c")), 2.0, 30 * 1.1 + 0.2, 0.7, 0.4, 0.9, -0.3
    for sign in (1, -1):
        udot, dudot = e.sensitivities([sign * x], [sign * u], None, [0.1], 0.2, dp=np.eye(4))
        force = -k * (x - l0) - c * u
        np.testing.assert_allclose(udot, [sign * force / m], rtol=1e-14)
        expected = np.array([-force / m**2, -1.1 * (x - l0) / m, -u / m, k / m])
        np.testing.assert_allclose(sign * dudot[:, 0], expected, rtol=1e-13)
        J = e.jacobians([sign * x], [sign * u], None, [0.1], 0.2)
        np.testing.assert_allclose([J.q[0, 0], J.u[0, 0], sign * J.inputs[0, 0], sign * J.t[0]],
                                   [-k / m, -c / m, -30 * (x - l0) / m, -(x - l0) / m], rtol=1e-13)  # fmt: skip
    np.testing.assert_allclose(e.energies([x], [u]), [m * u**2 / 2, 30 * (x - l0) ** 2 / 2], rtol=1e-14)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_spring_without_length(engine):
    e = engine(slider(0, 0))
    udot, dudot = e.sensitivities([0.0], [1.0], dq=[1.0])
    np.testing.assert_allclose([udot[0], dudot[0, 0]], [0, -15], atol=1e-15)
    for free_length, damping in (("l0", 0), (0, "c")):
        with pytest.raises(ValueError, match="spring s: its two points coincide"):
            engine(slider(free_length, damping)).accelerations([0.0], [1.0])


# --- the small linear algebra ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("numbers", ["float64", "mpmath"])
def test_left_inverse_and_independent_rows(numbers):
    arithmetic, rng = Arithmetic(numbers), np.random.default_rng(2)
    for m, n in ((3, 3), (6, 2), (7, 4), (5, 0)):
        E = rng.normal(size=(m, n)) * np.geomspace(1, 1e-5, n)
        b = rng.normal(size=(2, m, 3))
        inverse = LeftInverse(arithmetic, arithmetic.array(E))
        expected = np.linalg.pinv(E) @ b
        np.testing.assert_allclose(inverse(arithmetic.array(b)).astype(float), expected, rtol=1e-9, atol=1e-12)
        assert np.abs(inverse.Q.T @ inverse.Q - np.eye(n)).max(initial=0) < 1e-14
    A = rng.normal(size=(6, 3)) @ rng.normal(size=(3, 5))
    rows, rank = arithmetic.independent_rows(arithmetic.array(A))
    assert rank == len(set(rows.tolist())) == 3 == np.linalg.matrix_rank(A[rows])
    with pytest.raises(SingularMatrixError, match="rank 3 of 5"):
        LeftInverse(arithmetic, arithmetic.array(A))
    assert arithmetic.independent_rows(arithmetic.zeros(3, 0))[1] == 0
