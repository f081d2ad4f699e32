"""Radau IIA: against the explicit method, closed forms and SciPy, for states and sensitivities, stiff and not stiff."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import codegen
from codegen.runtime import At, Final, Integral
from codegen.runtime.standalone.motion.problem import Inputs, Problem
from codegen.runtime.standalone.trajectory.events import Event

EXAMPLES = Path(__file__).parents[2] / "examples"

SPRINGS = """
model: springs
gravity: [0, 0, -9.81]
parameters: {{k: {stiffness}, c: {damping}, m: 1.5, length: 0.3}}
bodies:
  block: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: m}}
  bob:
    parent: block
    joint: {{type: revolute, axis: y}}
    mass: 0.7
    com: [0, 0, -length]
    inertia: {{xx: 0.01, yy: 0.01, zz: 0.01}}
forces:
  wall: {{type: joint, joint: block, value: -k*q.block - c*u.block}}
initial:
  q: {{bob: 1.0}}
  u: {{block: 0.1}}
outputs:
  place: {{value: q.block}}
  angle: {{value: q.bob}}
"""
"""A pendulum below a block that a stiff spring and damper hold: rates of -c/m."""

LINEAR = """
model: linear
parameters: {{k: 50.0, c: {damping}, f: 3.0}}
bodies:
  block: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1.0}}
forces:
  all: {{type: joint, joint: block, value: -k*q.block - c*u.block + f}}
initial:
  q: {{block: 1.0}}
  u: {{block: -2.0}}
"""

# A05 of the IFToMM benchmark library (MBSbenchmarksInOpenSim): a governor whose rods hang on stiff spring-dampers.
FLYBALL = """
model: flyball
gravity: [0, 0, -9.81]
constants: {side: [1, -1]}
parameters: {k: 8.0e5, c: 4.0e4, l0: 0.5}
bodies:
  shaft:
    parent: ground
    joint: {type: revolute, axis: z}
    shape: {type: box, size: [0.01, 0.01, 1.0], mass: 0.3, center: [0, 0, 0.5]}
  slider:
    parent: shaft
    joint: {type: prismatic, axis: z}
    shape: {type: box, size: [0.1, 0.1, 0.1], mass: 3.0}
  repeat i in 1..2:
    rod(i):
      parent: shaft
      joint: {type: revolute, axis: [0, side(i), 0], at: [0.05*side(i), 0, 1]}
      shape: {type: box, size: [1.0, 0.01, 0.01], mass: 0.3, center: [0.5*side(i), 0, 0]}
    ball(i):
      parent: rod(i)
      joint: {type: fixed, at: [side(i), 0, 0]}
      mass: 5.0
forces:
  repeat i in 1..2:
    link(i):
      type: spring
      from: {body: slider, at: [0.05*side(i), 0, 0]}
      to: {body: rod(i), at: [0.5*side(i), 0, 0]}
      stiffness: k
      damping: c
      free_length: l0
initial:
  q: {slider: 0.5, rod_1: pi/6, rod_2: pi/6}
  u: {shaft: 2*pi}
outputs:
  s: {value: q.slider}
"""


BALLS = """
model: balls
gravity: [0, 0, -9.81]
parameters: {crank: 0.3, rod: 1.0, spring: 40.0}
bodies:
  wheel:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 1.0
    com: [crank/2, 0, 0]
    inertia: {xx: 0.02, yy: 0.05, zz: 0.04}
  rod:
    parent: wheel
    joint: {type: spherical, at: [crank, 0, 0]}
    mass: 0.6
    com: [rod/2, 0.02, 0]
    inertia: {xx: 0.01, yy: 0.06, zz: 0.055}
  slider: {parent: ground, joint: {type: prismatic, axis: x, at: [0, 0.2, 0]}, mass: 0.8}
loops:
  ball: {joint: {type: point}, from: {body: rod, at: [rod, 0, 0]}, to: slider}
forces:
  hold: {type: joint, joint: slider, value: -spring*(q.slider - 1) - 2*u.slider}
initial:
  q: {wheel: 0.4, slider: 1.2}
  u: {wheel: 3.0}
independent: [wheel]
"""
"""A rod between two balls turns freely about itself: one of its three speeds is independent."""


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    """Opens the solver of an example, or of a model's text."""
    opened = {}
    folder = tmp_path_factory.mktemp("radau")

    def of(model):
        if model not in opened:
            source, made = EXAMPLES / f"{model}.yaml", folder / f"package_{len(opened)}"
            if "\n" in model:
                source = folder / f"model_{len(opened)}.yaml"
                source.write_text(model)
            codegen.generate(source, made, functions="motion", compile="all")
            opened[model] = codegen.load(made)
        return opened[model]

    return of


def motion(s, end, tolerance, directions=0, parameters=None, inputs=None, **options):
    """A run along the first parameters, and what is in its rows: q, u, outputs, integrals, and these per direction."""
    p = s.parameters if parameters is None else parameters
    dp = np.eye(s.np)[directions] if isinstance(directions, list) else np.eye(s.np)[:directions]
    k = len(dp)
    q, u, *dqu = s.initial_sensitivities(p, dp=dp) if k else s.initial_state(p)
    dq, du = dqu or (np.zeros((0, s.nq)), np.zeros((0, s.nu)))
    nx = len(options.get("integrals", ()))
    given = {
        "times": np.linspace(0.0, end, 8),
        "method": "radau",
        "atol": np.full(s.nq + s.nu + nx, tolerance),
    } | options
    r = s._motions._run(
        Problem(
            start=0.0, end=end, q=q, u=u, p=p, inputs=inputs or Inputs(0, None, np.zeros((1, s.ninputs))), dq=dq, du=du, dp=dp,
            dinputs=None, rtol=tolerance, most_steps=200_000, **given,
        )
    )  # fmt: skip
    parts, at, rows = [], 1, r.rows
    for many in (1, k):
        for n in (s.nq, s.nu, s.noutputs, nx):
            parts.append(rows[:, at : at + many * n].reshape(len(rows), many, n))
            at += many * n
    values = np.concatenate(parts[:4], axis=2)[:, 0]
    along = np.concatenate(parts[4:], axis=2)
    return r, values, along


def error(found, expected):
    """The largest error, relative to the largest number of an entry over time."""
    return np.max(np.abs(found - expected) / (1e-3 + np.abs(expected).max(axis=0)))


# ---- not stiff -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["double_pendulum", "four_bar", "satellite", "slider_crank", BALLS])
@pytest.mark.parametrize("directions", [1, 3])
def test_the_explicit_method_gives_the_same(solver, name, directions):
    s = solver(name)
    integrals = (0, 1) if s.noutputs else ()
    end = 0.5 if name == "slider_crank" else 1.0
    options = {"atol_directions": np.full(directions, 1e-12), "integrals": integrals}
    r, x, dx = motion(s, end, 1e-13, directions, **options)
    e, y, dy = motion(s, end, 1e-12, directions, method="dop853", **options)
    assert (r.reason, e.reason) == ("end", "end")
    assert error(x, y) < 1e-8
    assert error(dx, dy) < 1e-8
    assert "stiffness" not in r.counts and e.counts["stiffness"] == 0.0
    assert not {"jacobians", "factorizations"} & set(e.counts)
    assert 0 < r.counts["factorizations"] <= r.counts["steps"] + r.counts["rejected"] + r.counts["jacobians"]


@pytest.mark.parametrize(
    ("name", "method", "order", "counts"),
    [
        ("double_pendulum", "radau", 5, (100, 200)),
        ("four_bar", "radau", 5, (100, 200)),
        ("double_pendulum", "dop853", 8, (16, 32)),
        ("four_bar", "dop853", 8, (60, 120)),
        ("double_pendulum", "rk4", 4, (100, 200)),
        ("four_bar", "rk4", 4, (100, 200)),
    ],
)
def test_errors_fall_with_the_order(solver, name, method, order, counts):
    s = solver(name)
    end = 0.8
    exact = motion(s, end, 1e-14, 3, method="dop853", atol_directions=np.full(3, 1e-14))
    errors = []
    for n in counts:
        r, x, dx = motion(s, end, 1e-13, 3, method=method, step=end / n, fixed=True, times=np.array([0.0, end]))
        assert r.counts["steps"] == n
        errors.append([error(x[-1:], exact[1][-1:]), error(dx[-1:], exact[2][-1:])])
    seen = np.log2(np.array(errors[0]) / errors[1])
    assert np.all(seen > order - 0.6), (seen, errors)
    assert np.all(np.array(errors[1]) > 1e-14)


@pytest.mark.parametrize("name", ["double_pendulum", "four_bar"])
def test_sensitivities_are_derivatives_of_the_steps_made(solver, name):
    """Steps are so long that the method's error is seen well; differences of runs agree with sensitivities far better."""
    s = solver(name)
    options = {"step": 0.05, "fixed": True, "times": np.array([0.0, 1.0])}
    _, _, dx = motion(s, 1.0, 1e-13, 3, **options)
    _, _, exact = motion(s, 1.0, 1e-12, 3, times=np.array([0.0, 1.0]), method="dop853")
    for j in range(3):
        ends = []
        step = 2e-4 * max(1.0, abs(s.parameters[j]))
        for k in (-2, -1, 1, 2):
            p = s.parameters.copy()
            p[j] += k * step
            ends.append(motion(s, 1.0, 1e-13, parameters=p, **options)[1][-1])
        difference = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        scale = np.abs(dx[-1, j]).max() + 1e-3
        of_steps = np.abs(dx[-1, j] - difference).max() / scale
        of_method = np.abs(exact[-1, j] - difference).max() / scale
        assert of_steps < 1e-2 * of_method, (of_steps, of_method)
        assert of_steps < 1e-5


def test_formed_jacobians_and_sweeps_through_the_system_agree(solver):
    """Of a system of 18 entries Jacobians at the stages are formed for two groups of directions, and for one they are not."""
    s = solver("pinned_chain")
    r, x, dx = motion(s, 0.4, 1e-9, [0])
    t, y, dy = motion(s, 0.4, 1e-9, [0] * 10)
    assert t.counts["jacobians"] > 3 * t.counts["steps"] > 3 * r.counts["jacobians"]
    assert error(x, y) < 1e-9
    for copy in range(10):
        assert error(dx[:, 0], dy[:, copy]) < 1e-8


def test_small_motions_are_as_exact_as_is_asked_for(solver):
    """A wheel nearly at rest, by micrometres: what RADAU5 takes for granted of motions of size one is not of these."""
    s = solver("double_wishbone")
    _, exact, _ = motion(s, 0.3, 1e-13, method="dop853")
    for tolerance in (1e-8, 1e-10):
        _, x, _ = motion(s, 0.3, tolerance)
        assert np.abs(x - exact)[:, : s.nq + s.nu].max() < 100 * tolerance


def test_between_steps_it_is_as_exact_as_the_polynomial(solver):
    """The collocation polynomial is of degree 3: nearly as exact as the ends of steps, of which every one is asked for too."""
    s = solver("double_pendulum")
    ends = motion(s, 1.0, 1e-8, 2, times=np.zeros(0))
    times = ends[0].rows[:, 0]
    _, exact, along = motion(s, 1.0, 1e-13, 2, times=times, method="dop853")
    assert error(ends[1], exact) < 1e-6
    assert error(ends[2], along) < 1e-5
    _, at, da = motion(s, 1.0, 1e-8, 2, times=times)
    np.testing.assert_array_equal(at, ends[1])
    np.testing.assert_array_equal(da, ends[2])
    middle = np.sort(np.concatenate([times, (times[1:] + times[:-1]) / 2]))
    _, exact, along = motion(s, 1.0, 1e-13, 2, times=middle, method="dop853")
    _, at, da = motion(s, 1.0, 1e-8, 2, times=middle)
    assert error(at, exact) < 1e-5
    assert error(da, along) < 1e-4


def test_inputs_over_time(solver):
    s = solver("slider_crank")
    knots = np.array([0.0, 0.0, 0.1, 0.25, 0.3, 0.3])
    inputs = Inputs(1, knots, np.array([[0.0], [40.0], [-20.0], [10.0]]))
    along = {"inputs": inputs, "atol_directions": np.full(2, 1e-11)}
    _, x, dx = motion(s, 0.3, 1e-11, 2, **along)
    _, y, dy = motion(s, 0.3, 1e-12, 2, **along, method="dop853")
    assert error(x, y) < 1e-8
    assert error(dx, dy) < 1e-6
    jumps = Inputs(0, np.array([0.0, 0.1, 0.2, 0.3]), np.array([[30.0], [-30.0], [0.0]]))
    _, x, _ = motion(s, 0.3, 1e-11, inputs=jumps)
    _, y, _ = motion(s, 0.3, 1e-12, inputs=jumps, method="dop853")
    assert error(x, y) < 1e-7


# ---- stiff -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [1e4, 1e5, 1e6])
def test_a_linear_system_against_its_closed_form(solver, rate):
    """m x'' = -k x - c x' + f: the matrix exponential, and its derivatives by k and c as one of twice the size."""
    s = solver(LINEAR.format(damping=rate))
    times = np.array([0.0, 1.3 / rate, 1e-3, 0.7, 20.0])
    r, x, dx = motion(s, 20.0, 1e-10, 3, times=times, atol_directions=1e-10 * np.array([1e-2, 1.0 / rate, 1e-2]))
    assert r.reason == "end" and r.counts["steps"] < 1500
    k, c, f = s.parameters
    J = np.array([[0.0, 1, 0], [-k, -c, f], [0, 0, 0]])
    parts = [np.zeros((3, 3)) for _ in range(3)]
    parts[0][1, 0], parts[1][1, 1], parts[2][1, 2] = -1, -1, 1
    for i, t in enumerate(times):
        for j, part in enumerate(parts):
            both = np.block([[J, np.zeros((3, 3))], [part, J]])
            state = scipy.linalg.expm(t * both) @ [1.0, -2.0, 1.0, 0, 0, 0]
            np.testing.assert_allclose(x[i], state[:2], rtol=2e-8, atol=2e-9)
            np.testing.assert_allclose(
                dx[i, j], state[3:5], rtol=1e-6, atol=2e-8 * np.abs(state[3:5]).max() + 1e-12 * (t == 0)
            )


@pytest.mark.parametrize(("stiffness", "damping"), [(1e5, 1.5e4), (1e9, 1.5e6), (1e8, 10.0)])
def test_stiff_springs(solver, stiffness, damping):
    """Against SciPy's Radau for the state; sensitivities against the explicit method in steps of half a time constant.

    In the last case vibrations hardly die out, and steps do have to be small.
    """
    s = solver(SPRINGS.format(stiffness=stiffness, damping=damping))
    end = {10.0: 0.02, 1.5e4: 0.3, 1.5e6: 0.03}[damping]
    sizes = np.abs(motion(s, end, 1e-8, 4)[2]).max(axis=0)
    cs = 1e-8 * np.min(np.where(sizes > 0, sizes, np.inf), axis=1)
    r, x, dx = motion(s, end, 1e-10, 4, atol_directions=cs)
    steps = int(2 * end * max(damping, np.sqrt(stiffness)) / 1.5)
    e, y, dy = motion(s, end, 1e-11, 4, method="dop853", step=end / steps, fixed=True)
    assert (r.reason, e.reason) == ("end", "end")
    if damping > 100:
        assert r.counts["steps"] < e.counts["steps"] / 4
        assert motion(s, 2.0, 1e-6, method="dop853")[0].counts["stiffness"] > 6.1
    assert "stiffness" not in r.counts
    assert error(x, y) < 1e-7
    for j in range(4):
        scale = np.abs(dy[:, j]).max(axis=0)
        assert np.all(np.abs(dx[:, j] - dy[:, j]) < 1e-6 * scale + 1e-12 * scale.max()), j

    def rates(_, z):
        return np.concatenate([z[2:], s.accelerations(z[:2], z[2:])])

    q, u = s.initial
    times = np.linspace(0.0, end, 8)
    found = scipy.integrate.solve_ivp(rates, (0, end), np.concatenate([q, u]), "Radau", times, rtol=1e-9, atol=1e-10)
    assert error(x[:, :4], found.y.T) < 1e-6


def test_the_flyball_governor(solver):
    """At 10 s: s of two reductions by hand, its derivative by l0, and one by k that is seventeen orders smaller than s*k."""
    s = solver(FLYBALL)
    at = s.coordinate_names.index("slider")
    cs = 1e-8 * np.array([1e-9, 1e-9, 1.0])
    r, x, dx = motion(s, 10.0, 1e-8, 3, times=np.array([0.1, 2.0, 10.0]), atol_directions=cs)
    np.testing.assert_allclose(x[:, at], [0.5238364755695756, 0.5059092942967034, 0.6196229170613666], rtol=3e-8)
    np.testing.assert_allclose(dx[-1, 2, at], -1.1457145, rtol=1e-7)
    np.testing.assert_allclose(dx[-1, 0, at], 3.15e-11, rtol=1e-3)
    assert r.counts["steps"] < 4000
    _, y, _ = motion(s, 1.0, 1e-9, method="dop853")
    assert error(motion(s, 1.0, 1e-9)[1], y) < 1e-5
    assert motion(s, 1.0, 1e-6, method="dop853")[0].counts["stiffness"] > 6.1  # stability keeps its steps small


# ---- by name ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["slider_crank", SPRINGS.format(stiffness=1e5, damping=1.5e4)])
def test_events_within_implicit_steps(solver, name):
    s = solver(name)
    event = Event("speed", 0.0, stop=False) if name == "slider_crank" else Event("angle", 0.2, stop=False)
    of = [n for n in s.parameter_names if n not in ("k", "c")]
    atol = np.full(len(of), 1e-11)
    made = [
        s.simulate(
            0.9, events=[event], sensitivities=of, method="radau", rtol=1e-11, atol=1e-12, atol_sensitivities=atol
        )
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made.append(s.simulate(0.9, events=[event], sensitivities=of, rtol=1e-12, atol=1e-12, atol_sensitivities=atol))
    assert len(made[0].events) == len(made[1].events) > 0
    for x, y in zip(made[0].events, made[1].events, strict=True):
        np.testing.assert_allclose(x.t, y.t, rtol=1e-8)
        np.testing.assert_allclose(x.dt, y.dt, rtol=1e-5, atol=1e-6 * np.abs(y.dt).max())
        np.testing.assert_allclose(x.q, y.q, rtol=1e-7, atol=1e-8)


def test_who_takes_an_explicit_method_for_a_stiff_model_is_told(solver):
    s = solver(FLYBALL)
    with pytest.warns(RuntimeWarning, match=r"stability, not accuracy, kept the steps .* method='radau'"):
        s.simulate(0.5, rtol=1e-6, atol=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        s.simulate(0.5, rtol=1e-6, atol=1e-6, method="radau", sensitivities=["k", "l0"])


# ---- backwards -------------------------------------------------------------------------------------------------------


def test_the_flyball_governor_backwards(solver):
    """At 10 s: derivatives by l0 and k, eleven orders apart, as above, and the same as forward."""
    s = solver(FLYBALL)
    options = {"wrt": s.parameter_names, "integrator": "radau", "rtol": 1e-9, "atol": 1e-9}
    forward, adjoint = (s.judge(10.0, Final("s"), method=method, **options) for method in ("forward", "adjoint"))
    by_k, _, by_l0 = adjoint.gradients[0]
    np.testing.assert_allclose(by_l0, -1.1457145, rtol=1e-7)
    np.testing.assert_allclose(by_k, 3.15e-11, rtol=1e-3)
    assert forward.counts["steps"] == adjoint.counts["steps"] < 1000
    np.testing.assert_allclose(adjoint.gradients, forward.gradients, rtol=1e-11)
    assert adjoint.counts["adjoint_transposes"] <= 4 * adjoint.counts["steps"]


@pytest.mark.parametrize("tolerance", [1.0, 1e-3, 1e-8])
def test_large_systems_backwards_by_factors_near_by(solver, tolerance):
    """34 entries: rounds with the factors of one Jacobian; in long steps neither those at hand nor fresh ones do."""
    s = solver((EXAMPLES / "chain.yaml").read_text().replace("n: 12,", "n: 17,"))
    wanted, wrt = (
        [Final("kinetic"), At("kinetic", 0.613), Integral("kinetic")],
        (*s.parameter_names, "q0.link_1", "u0.link_17"),
    )
    options = {"wrt": wrt, "integrator": "radau", "rtol": tolerance, "atol": tolerance}
    for some in (wanted[:1], wanted):
        forward, adjoint = (s.judge(1.0, some, method=method, **options) for method in ("forward", "adjoint"))
        steps, calls = adjoint.counts["steps"], adjoint.counts["adjoint_evaluations"]
        assert forward.counts["steps"] == steps
        scale = np.abs(forward.gradients).max(axis=1, keepdims=True)
        assert np.all(np.abs(forward.gradients - adjoint.gradients) < 1e-11 * scale)
        # a Jacobian takes five calls; all of them in every step would be fifteen
        assert calls < 2 * steps if tolerance < 1e-6 else calls > 5 * steps if tolerance == 1.0 else True


@pytest.mark.parametrize(("name", "output"), [("double_pendulum", "tip_x"), ("four_bar", "trace_x")])
def test_gradients_backwards_converge_with_the_order(solver, name, output, monkeypatch):
    s = solver(name)
    end, wanted = 0.8, [Final(output), Integral(output)]
    exact = s.judge(end, wanted, wrt=s.parameter_names, method="adjoint", rtol=1e-14, atol=1e-14).gradients
    own = type(s._motions)._problem

    def fixed(self, *arguments, **options):
        problem, directions = own(self, *arguments, **options)
        return replace(problem, fixed=True), directions

    monkeypatch.setattr(type(s._motions), "_problem", fixed)
    errors = []
    for n in (100, 200):
        options = {"integrator": "radau", "step": end / n, "rtol": 1e-13, "atol": 1e-13}
        found = s.judge(end, wanted, wrt=s.parameter_names, method="adjoint", **options)
        assert found.counts["steps"] == n
        errors.append(np.abs(found.gradients - exact).max(axis=1) / np.abs(exact).max(axis=1))
    assert np.all(np.log2(errors[0] / errors[1]) > 4.4), errors
    assert np.all(errors[1] > 1e-14)


# ---- what can go wrong -----------------------------------------------------------------------------------------------


def test_a_step_of_fixed_size_that_cannot_be_solved_for_is_none(solver):
    s = solver("four_bar")
    r, _, _ = motion(s, 5.0, 1e-10, 1, step=1.0, fixed=True)
    assert r.reason in ("step collapsed", "open loop", "singular") and r.counts["t"] < 5.0


def test_two_runs_give_the_same_bytes(solver):
    s = solver("slider_crank")
    first, again = (motion(s, 0.3, 1e-8, 5)[0] for _ in range(2))
    assert first.rows.tobytes() == again.rows.tobytes()
