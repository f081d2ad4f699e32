"""Motions that begin, or stay, where plain rules of differentiation give 0 times infinity; messages without a derivative."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import codegen
from codegen.model import parse_model
from codegen.runtime import At, Final, Solver

HERTZ = """\
model: hertz
gravity: [0, 0, -9.81]
parameters: {k: 1e4, m: 0.5, n: 1.5}
bodies:
  ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
  other: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
forces:
  floor: {type: joint, joint: ball, value: "k*max(0, -q.ball)**n"}
initial: {q: {ball: 0.05}}
outputs: {h: {value: q.ball}, root: {value: sqrt(0.05 - q.ball)*k}, below: {value: 1/(q.ball - 0.05)}}
"""
P = np.array([1e4, 0.5, 1.5])
NAMES = ["k", "m", "n"]


@pytest.fixture(scope="module")
def hertz(tmp_path_factory: pytest.TempPathFactory) -> Solver:
    folder = tmp_path_factory.mktemp("hertz") / "hertz"
    codegen.generate(parse_model(HERTZ), folder, compile="all")
    return codegen.load(folder)


def bounce(p: np.ndarray) -> float:
    """The height after 0.15 s."""
    k, m, n = p
    found = solve_ivp(
        lambda t, x: [x[1], -9.81 + k * max(0.0, -x[0]) ** n / m],
        (0, 0.15),
        [0.05, 0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
    )
    return float(found.y[0, -1])


def test_a_bouncing_ball_beside_outputs_that_nobody_asks_for(hertz: Solver) -> None:
    expected = [(bounce(P + e) - bounce(P - e)) / (2 * e.sum()) for e in np.diag(1e-6 * P)]
    with pytest.warns(RuntimeWarning, match="the value of below"):
        run = hertz.simulate([0, 0.15], sensitivities=NAMES, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.dq[:, -1, 0], expected, rtol=1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for method in ("forward", "adjoint"):
            judged = hertz.judge(0.15, [Final("h"), At("h", 0.0)], wrt=NAMES, method=method, rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(judged.gradients, [expected, [0.0] * 3], rtol=1e-5)


def test_outputs_of_weight_zero_are_skipped_and_others_named(hertz: Solver) -> None:
    q, u = np.array([0.05, 0.0]), np.zeros(2)
    states = np.tile(q, (5, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for q_of in (q, states):
            found = hertz.output_gradients(q_of, 0 * q_of, weights=[1.0, 0.0, 0.0])
            np.testing.assert_array_equal(found.q, np.broadcast_to([[1.0, 0.0]], found.q.shape))
            assert not found.p.any()
    with pytest.warns(RuntimeWarning, match=r"not finite: the derivative of root with respect to q\.ball"):
        hertz.output_gradients(q, u, weights=[0.0, 1.0, 0.0])
    with pytest.warns(RuntimeWarning, match=r"at t = 0 s the derivative of root with respect to q\.ball is not"):
        hertz.judge(0.01, At("root", 0.0), wrt=["q0.ball"], method="adjoint")


FORCES = {
    "on joint a": (
        "{type: joint, joint: a, value: sqrt(q.a)*k}",
        r"the force on joint a with respect to q\.a is not finite \(force law: ",
    ),
    "on a body": (
        "{type: force, on: b, value: [k*sqrt(velocity.b.x), 0, 0]}",
        r"body b \(force law: on b; .* with respect to ",
    ),
    "a spring": (
        "{type: spring, from: ground, to: b, stiffness: k*sqrt(t)}",
        "the coefficients of spring law with respect to t are not",
    ),
}


@pytest.mark.parametrize("name", FORCES)
def test_messages_name_the_force_and_the_variable(tmp_path: Path, name: str) -> None:
    law, message = FORCES[name]
    text = f"""\
model: rooted
parameters: {{k: 2.0}}
bodies:
  a: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
  b: {{parent: ground, joint: {{type: free}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
forces:
  law: {law}
initial: {{q: {{b: [1, 0, 0, 1, 0, 0, 0]}}}}
"""
    codegen.generate(parse_model(text), tmp_path / "rooted", target="both", compile="all")
    solver = codegen.load(tmp_path / "rooted")
    q, u = [0.0, 1, 0, 0, 1, 0, 0, 0], np.zeros(7)
    for call in (lambda: solver.jacobians(q, u), lambda: solver.gradients(q, u, weights=np.eye(7))):
        with pytest.warns(RuntimeWarning, match=message):
            call()
    if name == "on joint a":
        with pytest.warns(RuntimeWarning, match=message):
            along = solver.simulate([0, 1], sensitivities=["q0.a"])
        assert np.isnan(along.dq[0, -1]).all()


REMAINDERS = """\
model: remainders
parameters: {m: 0.7}
tables:
  wave: {x: [0, 1, 2], y: [0, 1, 0], kind: cubic, outside: periodic, period: 3}
bodies:
  repeat k in 1..3: {b(k): {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces:
  in_time: {type: joint, joint: b_1, value: "mod(t, m)"}
  in_place: {type: joint, joint: b_2, value: "mod(q.b_2, m)"}
  smooth: {type: joint, joint: b_3, value: wave(m*q.b_3)}
initial: {u: {repeat k in 1..3: {b(k): k - 1}}}
outputs: {repeat k in 1..3: {x(k): {value: q.b(k)}}}
"""


def test_remainders_end_steps_and_smooth_tables_do_not(tmp_path: Path) -> None:
    model = parse_model(REMAINDERS)
    assert sorted(s.words for s in model.switches.found) == ["mod(q.b_2, m)", "mod(t, m)"]
    codegen.generate(model, tmp_path / "remainders", compile="all")
    solver = codegen.load(tmp_path / "remainders")
    end, m = 2.0, 0.7
    jumps = [k * m for k in range(1, 3)]
    x = end**3 / 6 - m * sum((end - t) ** 2 / 2 for t in jumps)
    slope = sum(k * m * (end - t) - (end - t) ** 2 / 2 for k, t in enumerate(jumps, 1))
    options = {"rtol": 1e-11, "atol": 1e-12}
    names = ["x_1", "x_2", "x_3"]
    found = [
        solver.judge(end, [Final(n) for n in names], wrt=["m"], method=w, **options) for w in ("forward", "adjoint")
    ]
    for judged in found:
        assert judged.values[0] == pytest.approx(x, rel=1e-9) and judged.gradients[0, 0] == pytest.approx(
            slope, rel=1e-9
        )
    np.testing.assert_allclose(found[0].gradients, found[1].gradients, rtol=1e-8)
    up, down = (solver.judge(end, [Final(n) for n in names], p=[m + h], **options).values for h in (1e-4, -1e-4))
    np.testing.assert_allclose(found[0].gradients[:, 0], (up - down) / 2e-4, rtol=1e-5)


ROOTS = """\
model: roots
parameters: {a: 0.3, b: 0.3, f: 2.0, g: 3.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  r: {type: joint, joint: x, value: "f*sqrt(max(0, q.x - a)) + g*max(0, q.x - b)**1.5 - 0.2*q.x"}
initial: {u: {x: 1}}
outputs: {x: {value: q.x}}
"""


@pytest.fixture(scope="module")
def roots(tmp_path_factory: pytest.TempPathFactory) -> Solver:
    folder = tmp_path_factory.mktemp("roots") / "roots"
    codegen.generate(parse_model(ROOTS), folder, functions=["motion"], check=False, compile="all")
    return codegen.load(folder)


@pytest.mark.parametrize("apart", [3e-10, 3e-11, 1e-12])
@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_another_switch_just_after_the_zero_of_a_root(roots: Solver, integrator: str, apart: float) -> None:
    """Errors of up to 1e-4: the step after both zeros was far too long for the root."""
    a, b, f, g = 0.3, 0.3 + apart, 2.0, 3.0
    options = {"p": {"b": b}, "wrt": ["a", "f"], "integrator": integrator}
    found, back = (roots.judge(1.0, Final("x"), method=way, **options) for way in ("forward", "adjoint"))

    def speed(x: float) -> float:
        """The speed from the energy."""
        return math.sqrt(1 + 4 / 3 * f * max(0, x - a) ** 1.5 + 4 / 5 * g * max(0, x - b) ** 2.5 - 0.2 * x * x)

    end = found.values[0]
    time = [quad(lambda x: 1 / speed(x), 0, a, epsrel=1e-12)]
    time.append(quad(lambda s: 2 * s / speed(a + s * s), 0, math.sqrt(end - a), epsrel=1e-12))
    assert sum(t for t, _ in time) == pytest.approx(1.0, abs=1e-8)
    by_a, by_f = (
        speed(end)
        * quad(lambda s, of=of: 2 * s * of(s) / speed(a + s * s) ** 3, 0, math.sqrt(end - a), epsrel=1e-12)[0]
        for of in (lambda s: -f * s, lambda s: 2 / 3 * s**3)
    )
    np.testing.assert_allclose(found.gradients, [[by_a, by_f]], rtol=0.0, atol=3e-8)
    np.testing.assert_allclose(back.gradients, found.gradients, rtol=0.0, atol=1e-11)
