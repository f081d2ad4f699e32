"""Linearised equations: closed forms, the dense engine, small perturbations, and second derivatives in 50 digits."""

import warnings
from pathlib import Path

import mpmath
import numpy as np
import pytest
import scipy.linalg
from made_once import solvers
from random_elements import with_random_elements
from random_mechanisms import random_mechanisms
from random_models import EVERY, random_state, random_tree
from runtime.test_statics import BALL, CART, PARALLELOGRAM, PENDULUM
from scipy.integrate import solve_ivp
from second_derivatives import observed_mechanism, observed_tree
from split_mechanisms import by_hand

import codegen
from codegen.reference import DenseEngine, RecursiveEngine

EXAMPLES = Path(__file__).parents[2] / "examples"

G = 9.81

DOUBLE = """
model: two_pendulums
gravity: [0, 0, -9.81]
parameters: {l1: 0.8, l2: 0.5, m1: 1.5, m2: 0.7}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: m1, com: [0, 0, -l1]}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -l1]}, mass: m2, com: [0, 0, -l2]}
"""

CHAIN = """
model: springs
parameters: {k: 30, m: 0.4, c: 0}
inputs: [f]
constants: {n: 6}
bodies:
  repeat i in 1..6:
    b(i): {parent: ground, joint: {type: prismatic, axis: x}, mass: m}
forces:
  first: {type: joint, joint: b(1), value: f - k*(2*q.b(1) - q.b(2)) - c*(2*u.b(1) - u.b(2))}
  repeat i in 2..5:
    s(i): {type: joint, joint: b(i), value: -k*(2*q.b(i) - q.b(i-1) - q.b(i+1)) - c*(2*u.b(i) - u.b(i-1) - u.b(i+1))}
  last: {type: joint, joint: b(6), value: -k*(2*q.b(6) - q.b(5)) - c*(2*u.b(6) - u.b(5))}
outputs:
  end: {value: q.b(6) + 3*u.b(1)}
"""

TOP = """
model: top
gravity: [0, 0, -9.81]
parameters: {l: 0.3, C: 0.02}
bodies:
  top: {parent: ground, joint: {type: spherical}, mass: 1.5, com: [0, 0, -l], inertia: {xx: 0.01, yy: 0.01, zz: C}}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return solvers(tmp_path_factory)


def of_engine(engine, solver, q, u, p, inputs, t, h):
    """A, B, C, D in the engine's numbers; commutators of motions by central differences with step h."""
    nu, ni = solver.nu, solver.ninputs
    own = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    units, n = np.eye(nu)[own], len(own)

    def tangents(q):
        return np.array([engine.coordinate_rates(q, e, p) for e in units])

    def along(f, q, dq):
        return (f(q + h * dq) - f(q - h * dq)) / (2 * h)

    N = tangents(q)
    qdot = engine.coordinate_rates(q, u, p)
    here = np.array([along(lambda x: engine.coordinate_rates(x, u, p), q, row) for row in N])
    R = here - along(tangents, q, qdot)
    # least squares by the normal equations, in any numbers
    solve = _solve(N @ N.T, N @ R.T)
    zeros = np.zeros
    seeds = {
        "dq": np.concatenate([N, zeros((n + ni, solver.nq))]),
        "du": np.concatenate([zeros((n, nu)), units, zeros((ni, nu))]),
        "dinputs": np.concatenate([zeros((2 * n, ni)), np.eye(ni)]),
    }
    dudot = np.asarray(engine.sensitivities(q, u, p, inputs, t, **seeds)[1])[:, own]
    dy = np.asarray(engine.output_sensitivities(q, u, p, inputs, t, **seeds)[1])
    A = np.concatenate([np.concatenate([solve, np.eye(n)], axis=1), dudot[: 2 * n].T])
    B = np.concatenate([zeros((n, ni)), dudot[2 * n :].T])
    return A, B, dy[: 2 * n].T, dy[2 * n :].T


def _solve(A, B):
    if A.dtype != object:
        return np.linalg.solve(A, B)
    found = mpmath.matrix(A.tolist()) ** -1 * mpmath.matrix(B.tolist())
    return np.array(found.tolist(), dtype=object).reshape(B.shape)


def floats(x):
    return np.array(x, dtype=float)


def differ(found, expected, rtol):
    """Largest difference divided by the largest entry."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max(initial=0.0) <= rtol * max(1.0, np.abs(expected).max(initial=0.0))


# ---- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_a_pendulum_whose_rest_moves(made, target):
    """I s^2 + c s + m g l cos q = 0 with sin q = -tau/(m g l): eigenvalues and derivatives, with the state that moves."""
    solver, tau = made(PENDULUM, target), 4.0
    l, m, J, c = 0.8, 1.5, 0.2, 0.1
    state = solver.equilibrium(inputs=[tau])
    found = solver.linearize(state.q, inputs=[tau])
    assert found.state_names == ("q.rod", "u.rod")

    def eigenvalue(l, m, J, c, tau):
        inertia, stiffness = J + m * l**2, mpmath.sqrt((m * G * l) ** 2 - tau**2)
        return (-c - mpmath.sqrt(mpmath.mpc(c**2 - 4 * inertia * stiffness))) / (2 * inertia)

    point = (l, m, J, c, tau)
    expected = complex(eigenvalue(*point))
    differ(found.eigenvalues(), [expected, expected.conjugate()], 1e-14)
    with mpmath.workdps(40):
        slopes = [complex(mpmath.diff(eigenvalue, point, tuple(int(i == j) for i in range(5)))) for j in range(5)]
    slopes = np.array(slopes)
    names = ["l", "m", "J", "c", "inputs.motor"]
    differ(found.eigenvalue_sensitivities(names), np.stack([slopes, slopes.conj()], axis=1), 1e-13)
    held = found.sensitivities("inputs.motor", moving=False)
    assert np.abs(held.A).max() == 0.0  # at a fixed angle the torque is constant
    assert np.abs(found.sensitivities("inputs.motor").A).max() > 0.1


def test_a_hanging_double_pendulum(made):
    """Frequencies and their derivatives by the characteristic polynomial of two point masses."""
    solver = made(DOUBLE)
    found = solver.linearize(solver.equilibrium().q)
    point = tuple(solver.parameters)

    def frequency(sign):
        def of(l1, l2, m1, m2):
            a, b, c = m1 * l1 * l2, -(m1 + m2) * G * (l1 + l2), (m1 + m2) * G**2
            return mpmath.sqrt((-b + sign * mpmath.sqrt(b * b - 4 * a * c)) / (2 * a))

        return of

    modes = found.modes()
    differ(modes.frequencies, [float(frequency(sign)(*point)) for sign in (-1, 1)], 1e-14)
    assert np.abs(modes.damping).max() < 1e-14
    d = found.eigenvalue_sensitivities()[:, 1::2]  # positive imaginary parts
    for k, sign in enumerate((-1, 1)):
        with mpmath.workdps(40):
            slopes = [
                float(mpmath.diff(frequency(sign), point, tuple(int(i == j) for i in range(4)))) for j in range(4)
            ]
        differ(d[:, k], 1j * np.array(slopes), 1e-13)


def test_a_chain_of_masses_and_springs(made):
    """w_k = 2 sqrt(k/m) sin(k pi/14), with stiffness damping of ratio c w/(2 k)."""
    solver = made(CHAIN)
    found = solver.linearize(p={"c": 0.2})
    modes = found.modes()
    w = 2 * np.sqrt(30 / 0.4) * np.sin(np.arange(1, 7) * np.pi / 14)
    differ(modes.frequencies, w, 1e-13)
    differ(modes.damping, 0.2 * w / 60, 1e-13)
    for k, shape in enumerate(modes.shapes):
        sine = np.sin(np.arange(1, 7) * (k + 1) * np.pi / 7)
        across = shape[:6] - sine * (sine @ shape[:6]) / (sine @ sine)
        assert np.abs(across).max() < 1e-12
    differ(found.B, np.eye(12)[:, [6]] / 0.4, 1e-15)
    differ(found.C, [[0, 0, 0, 0, 0, 1, 3, 0, 0, 0, 0, 0]], 1e-15)
    assert found.D.tolist() == [[0.0]]
    assert (found.input_names, found.output_names) == (("f",), ("end",))
    z = 0.2 * w / 60
    of_pair = -z * w + 1j * w * np.sqrt(1 - z**2)  # s^2 + c w^2/k s + w^2 = 0, w^2 ~ k/m: by c
    by_c = -of_pair * (w**2 / 30) / (2 * of_pair + 0.2 * w**2 / 30)
    differ(found.eigenvalue_sensitivities("c")[0, 1::2], by_c, 1e-12)


def test_a_spinning_top_that_hangs(made):
    """In axes that turn with the body: A r^2 - (2A - C) n i r + ... , from A s^2 - i C n s + m g l = 0 in the ground's."""
    solver, n = made(TOP), 7.0
    q, u = np.array([1.0, 0, 0, 0]), np.array([0.0, 0, n])
    found = solver.linearize(q, u)
    assert found.state_names == (
        "rotation.top.wx", "rotation.top.wy", "rotation.top.wz", "u.top.wx", "u.top.wy", "u.top.wz"
    )  # fmt: skip
    A, C, weight = 0.01 + 1.5 * 0.09, 0.02, 1.5 * G * 0.3
    s = np.roots([A, -1j * C * n, weight])  # of x + i y in the ground frame
    r = s - 1j * n  # the body's axes turn by n t
    expected = np.concatenate([r, r.conj(), [0, 0]])
    values = found.eigenvalues()
    assert all(np.abs(values - x).min() < 1e-7 for x in expected)
    for x in (*r, *r.conj()):
        assert np.abs(values - x).min() < 1e-12
    # d s/dC from the quadratic: (2 A s - i C n) ds = i n s dC
    with pytest.warns(RuntimeWarning, match="repeated"):
        d = found.eigenvalue_sensitivities("C")[0]
    for s_k, r_k in zip(s, r, strict=True):
        slope = 1j * n * s_k / (2 * A * s_k - 1j * C * n)
        assert abs(d[np.argmin(np.abs(values - r_k))] - slope) < 1e-11


def test_a_parallelogram(made):
    """(J_a + J_b + 2 m_r (l/2)^2 + m l^2) s^2 + k + g l (m + 0.5) cos a = 0, the angle moving with the parameters."""
    solver = made(PARALLELOGRAM)
    found = solver.linearize(solver.equilibrium().q)
    assert found.state_names == ("q.a", "u.a")

    def square(l, m, k):
        angle = mpmath.findroot(lambda a: k * (a - 0.5) + G * l * (m + 0.5) * mpmath.sin(a), 0.3)
        return (k + G * l * (m + 0.5) * mpmath.cos(angle)) / (0.04 + 0.25 * l**2 + m * l**2)

    point = (0.6, 1.2, 5.0)
    with mpmath.workdps(40):
        w = float(mpmath.sqrt(square(*point)))
        slopes = [
            float(mpmath.diff(lambda *x: mpmath.sqrt(square(*x)), point, tuple(int(i == j) for i in range(3))))
            for j in range(3)
        ]
    differ(found.eigenvalues(), [-1j * w, 1j * w], 1e-14)
    differ(found.eigenvalue_sensitivities()[:, 1], 1j * np.array(slopes), 1e-13)


def test_repeated_eigenvalues_that_do_not_split_have_derivatives(made):
    text = BALL.replace("stiffness: 8", "stiffness: 0").replace("yy: 0.03", "yy: 0.02")
    solver = made(text)
    state = solver.equilibrium()
    assert state.stable is True
    found = solver.linearize(state.q)
    w = np.sqrt(2 * G * 0.5 / (0.02 + 2 * 0.25))
    differ(found.modes().frequencies, [0.0, w, w, 10.0], 1e-13)
    d = found.eigenvalue_sensitivities("l")[0]
    inertia = 0.02 + 2 * 0.25
    slope = (2 * G / inertia - 2 * G * 0.5 * 4 * 0.5 / inertia**2) / (2 * w)
    differ(d[1:5], 1j * slope * np.sign(found.eigenvalues()[1:5].imag), 1e-10)


def test_a_cart_that_is_free_has_two_zero_eigenvalues(made):
    found = made(CART).linearize(made(CART).equilibrium().q)
    assert np.abs(found.eigenvalues()[:2]).max() < 1e-7
    w = np.sqrt(0.5 * G * 0.7 / (0.01 + 0.5 * 0.49 - (0.5 * 0.7) ** 2 / 2.5))
    differ(found.eigenvalues()[2:], [-1j * w, 1j * w], 1e-13)
    square = w**2 * (1 / 0.7 - 0.5 * 2 * 0.7 * (1 - 0.5 / 2.5) / (0.01 + 0.5 * 0.49 * (1 - 0.5 / 2.5)))  # of w^2, by l
    with pytest.warns(RuntimeWarning, match="repeated"):
        d = found.eigenvalue_sensitivities("l")[0]
    assert np.isnan(d[:2]).all()
    differ(d[2:], [-1j * square / (2 * w), 1j * square / (2 * w)], 1e-13)


# ---- the dense engine, and 50 digits ---------------------------------------------------------------------------------


def check(solver, model, state, digits=40, names=None):
    """Check A, B, C, D against the dense engine, and their derivatives against those in 40 digits."""
    q, u, p, inputs, t = state
    q, u = solver.assemble(q, u, p)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solver.linearize(q, u, p, inputs, t)
    # the bracket of the engine is a difference: coarse in floats
    engine = DenseEngine(model)
    A, B, C, D = of_engine(engine, solver, q, u, p, inputs, t, 1e-5)
    n = len(A) // 2
    differ(found.A[n:], floats(A[n:]), 1e-9)
    differ(found.A[:n], floats(A[:n]), 1e-6)
    for ours, theirs in zip((found.B, found.C, found.D), (B, C, D), strict=True):
        differ(ours, floats(theirs), 1e-9)
    if not u.any():
        assert np.allclose(
            np.sort_complex(np.round(found.eigenvalues(), 5)), np.sort_complex(np.round(scipy.linalg.eigvals(floats(A)), 5)),
            atol=1e-3,
        )  # fmt: skip
    asked = list(names or solver.parameter_names[:2])
    ours = found.sensitivities(asked, moving=False)
    exact = DenseEngine(model, numbers="mpmath") if model.loops else RecursiveEngine(model, numbers="mpmath")
    for j, name in enumerate(asked):
        e = np.eye(solver.np)[solver.parameter_names.index(name)]
        _, _, dq, du = solver.assemble_sensitivities(q, u, p, dp=e)
        with mpmath.workdps(digits):
            h = mpmath.mpf(10) ** -12
            ends = [
                of_engine(
                    exact, solver, q + s * h * dq[0], u + s * h * du[0], p + s * h * e, inputs, t, mpmath.mpf(10) ** -18
                ) for s in (1, -1)
            ]  # fmt: skip
            middle = floats((ends[0][0] + ends[1][0]) / 2)  # A itself, but for h^2
            theirs = [floats((a - b) / (2 * h)) for a, b in zip(*ends, strict=True)]
        differ(found.A, middle, 1e-11)
        for matrix, x, y in zip("ABCD", ours, theirs, strict=True):
            scale = max(1.0, np.abs(y).max(initial=0.0))
            assert np.abs(x[j] - y).max(initial=0.0) <= 1e-9 * scale, f"d{matrix}/d{name}"


@pytest.mark.parametrize("seed", [101, pytest.param(105, marks=pytest.mark.campaign), 108])
def test_random_trees_in_motion(made, seed):
    rng = np.random.default_rng(seed)
    model = with_random_elements(rng, random_tree(rng, 3, joints=EVERY))
    state = random_state(rng, model)
    check(made(model), model, state)


@pytest.mark.parametrize("name", ["rssr", "rods_on_platform"])
def test_split_joints_in_motion(made, name):
    drawn = by_hand(name)
    solver = made(drawn.model)
    found = solver.linearize(drawn.q, drawn.u)
    engine = DenseEngine(drawn.model)
    q, u = solver.assemble(drawn.q, drawn.u)
    A = of_engine(engine, solver, q, u, drawn.p, drawn.inputs, 0.0, 1e-5)[0]
    differ(found.A, floats(A), 1e-7)


@pytest.mark.campaign
def test_random_mechanisms_in_motion(made):
    for _, drawn in random_mechanisms(1, first=11, bodies=(3, 3), loops=(1, 1), scene="spatial"):
        check(made(drawn.model), drawn.model, drawn[1:6], names=solver_names(drawn))


LINEARISED = "simulate,statics,states,dynamics,rates,outputs"
CURVED = "hessian_products,output_hessian_products"


def with_and_without_products(model, folder):
    """The same model without and with compiled second derivatives."""
    for name, more in (("without", ""), ("with", f",{CURVED}")):
        codegen.generate(model, folder / name, functions=LINEARISED + more)
    return codegen.load(folder / "without"), codegen.load(folder / "with")


@pytest.mark.parametrize(
    "seed", [1, pytest.param(2, marks=pytest.mark.campaign), pytest.param(3, marks=pytest.mark.campaign)]
)
def test_compiled_second_derivatives_of_random_trees(tmp_path, seed):
    """Quaternions, inputs and outputs, in motion: compiled Hessian products against the NumPy module on dual numbers."""
    model, state = observed_tree(seed)
    same_derivatives(*with_and_without_products(model, tmp_path), state)


def test_compiled_second_derivatives_of_a_mechanism(tmp_path):
    model, state = observed_mechanism(25, scene="planar", bodies=(2, 3), loops=(1, 1))
    same_derivatives(*with_and_without_products(model, tmp_path), state)


def same_derivatives(without, compiled, state):
    q, u, p, inputs, t = state
    names = [*without.parameter_names, *(f"inputs.{n}" for n in without.input_names)]
    found, expected = (
        s.linearize(q, u, p, inputs, t, outputs=list(s.output_names)).sensitivities(names, moving=False)
        for s in (compiled, without)
    )
    assert compiled._statics._opened.functions.get("hessian_products")
    for matrix, x, y in zip("ABCD", found, expected, strict=True):
        assert np.abs(x - y).max(initial=0.0) <= 1e-11 * max(1.0, np.abs(y).max(initial=0.0)), matrix
    assert np.abs(expected.A).max() > 0.0


def solver_names(drawn):
    return [p.name for p in drawn.model.parameters[:1]]


def test_two_choices_of_independents_have_the_same_eigenvalues(tmp_path):
    """A four-bar under gravity at rest, and how its eigenvalues follow lengths and masses: whatever is independent."""
    model = codegen.load_model(EXAMPLES / "four_bar.yaml")
    codegen.generate(model, tmp_path / "p", target="numpy", partitions=2)
    solver = codegen.load(tmp_path / "p")
    found = []
    for number in (0, 1):
        solver.use_partition(number)
        state = solver.equilibrium(sensitivities=solver.parameter_names)
        linear = solver.linearize(state.q)
        found.append((state.q, state.dq, linear.eigenvalues(), linear.eigenvalue_sensitivities(), linear.state_names))
    (q, dq, values, slopes, names), (q2, dq2, values2, slopes2, names2) = found
    assert names != names2
    differ(q, q2, 1e-13)
    differ(dq, dq2, 1e-12)
    differ(values, values2, 1e-12)
    differ(slopes, slopes2, 1e-11)
    solver.use_partition(0)
    with pytest.raises(ValueError, match="partition was changed"):
        linear.sensitivities()


# ---- what the matrices mean ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["satellite", "stewart"])
def test_a_small_perturbation_of_a_motion_obeys_the_equations(made, name):
    """Two motions that begin a little apart: their difference in the tangent space against x' = A(t) x along the first."""
    solver = made(codegen.load_model(EXAMPLES / f"{name}.yaml"), "c")
    q, u = solver.initial
    u = solver.assemble(q, u + 0.3 * np.sin(np.arange(solver.nu)))[1]
    own = [solver.speed_names.index(s) for s in solver.independent_speed_names]
    n, size, end = len(own), 1e-5, 0.3
    x = np.cos(np.arange(2 * n))

    def rates(t, y):
        q, u = y[: solver.nq], y[solver.nq :]
        return np.concatenate([solver.coordinate_rates(q, u), solver.accelerations(q, u, t=t)])

    def moved(s):
        N = solver.linearize(q, u).tangents
        v = u.copy()
        v[own] += s * size * x[n:]
        q1, u1 = solver.assemble(q + s * size * x[:n] @ N, v)
        y = solve_ivp(rates, (0, end), np.concatenate([q1, u1]), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        return solver.assemble(y[: solver.nq], y[solver.nq :])

    steps = solve_ivp(
        rates, (0, end), np.concatenate([q, u]), method="DOP853", rtol=1e-11, atol=1e-11, dense_output=True
    )

    def linear(t, x):
        y = steps.sol(t)
        return solver.linearize(*solver.assemble(y[: solver.nq], y[solver.nq :]), t=t).A @ x

    final = solve_ivp(linear, (0, end), x, method="RK45", rtol=1e-7, atol=1e-8).y[:, -1]
    (q2, u2), (q1, u1) = moved(1), moved(-1)
    at_end = solver.linearize(*solver.assemble(*np.split(steps.sol(end), [solver.nq]))).tangents
    differ(final[:n] @ at_end, (q2 - q1) / (2 * size), 1e-5)
    differ(final[n:], (u2 - u1)[own] / (2 * size), 1e-5)


def test_names_and_words(made):
    solver = made(PENDULUM)
    with pytest.raises(ValueError, match="outputs: 'tip' is not known"):
        solver.linearize(outputs=["tip"])
    moving = solver.linearize(u=[1.0])
    assert not moving.at_rest
    assert "a state in motion: 2 states, 1 inputs, 0 outputs" in repr(moving)
    with pytest.raises(ValueError, match="not an equilibrium, so it cannot move"):
        moving.sensitivities("l", moving=True)
    with pytest.raises(ValueError, match="'length' is not known"):
        moving.sensitivities("length")
    assert moving.sensitivities([]).A.shape == (0, 2, 2)
