"""Motions across forces that jump or have a kink: their derivatives in closed form, forward and by the adjoint."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed

from codegen.runtime import AtEvent, Event, Final, Integral, SimulationError

JUMPS = """
model: jumping
parameters: {t0: 0.7, x0: 1.0, s: 0.5, v0: 3.0, mu: 2.0, w: 5.0, h: 0.4, k: 200.0}
inputs: [push]
bodies:
  timed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  band: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  slope: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  kink: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  pushed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  timed: {type: joint, joint: timed, value: "if(t < t0, 1, 0)"}
  band: {type: joint, joint: band, value: "if(q.band > s, -12, -6)"}
  slope: {type: joint, joint: slope, value: "-w - mu*sign(u.slope)"}
  kink: {type: joint, joint: kink, value: "k*max(0, h - q.kink) - 10"}
  pushed: {type: joint, joint: pushed, value: "if(push > mu, 3, 1)"}
initial: {q: {band: x0, kink: x0}, u: {slope: v0}}
outputs:
  timed: {value: q.timed}
  band: {value: q.band}
  slope: {value: q.slope}
  kink: {value: q.kink}
  pushed: {value: q.pushed}
  high: {value: "if(q.band > s, 1, 3)"}
"""
NAMES = ["t0", "x0", "s", "v0", "mu", "w", "h", "k"]

METHODS: list[dict[str, Any]] = [
    {}, {"rtol": 1e-6, "atol": 1e-6}, {"integrator": "radau"}, {"integrator": "radau", "rtol": 1e-6, "atol": 1e-6},
    {"integrator": "rk4", "step": 0.002},
]  # fmt: skip


def closed_forms(kink_end: float) -> tuple[list[float], np.ndarray]:
    """Values and derivatives with respect to `NAMES` at t = 1 s, except for `kink` and its derivatives."""
    t0, x0, s, v0, mu, w = 0.7, 1.0, 0.5, 3.0, 2.0, 5.0
    values, by = [], np.zeros((6, len(NAMES)))
    values.append(t0 * t0 / 2 + t0 * (1 - t0))
    by[0, 0] = 1 - t0
    t1 = math.sqrt((x0 - s) / 6)
    values.append(s - 12 * t1 * (1 - t1) - 3 * (1 - t1) ** 2)
    by_t1 = -12 * (1 - 2 * t1) + 6 * (1 - t1)
    by[1, 1], by[1, 2] = by_t1 / (12 * t1), 1 - by_t1 / (12 * t1)
    t2 = v0 / (w + mu)
    values.append(v0 * t2 / 2 - (w - mu) / 2 * (1 - t2) ** 2)
    by[2, 3] = t2 + (w - mu) * (1 - t2) / (w + mu)
    by[2, 4] = -t2 * t2 / 2 + (1 - t2) ** 2 / 2 - (w - mu) * (1 - t2) * t2 / (w + mu)
    by[2, 5] = -t2 * t2 / 2 - (1 - t2) ** 2 / 2 - (w - mu) * (1 - t2) * t2 / (w + mu)
    values.append(kink_end)
    values.append(0.5 + 0.5 + 3 * 0.5**2 / 2 - 0.5**2 / 2 - 0.5)
    values.append(t1 + 3 * (1 - t1))
    by[5, 1], by[5, 2] = -2 / (12 * t1), 2 / (12 * t1)
    return values, by


def kinked(x0: float, h: float, k: float) -> float:
    """Free fall with 10 m/s^2 onto a spring, and off it again, at t = 1 s."""
    r, t1 = math.sqrt(k), math.sqrt((x0 - h) / 5)
    v, deep = -10 * t1, 10 / k  # oscillates about h - deep
    a = math.hypot(deep, v / r)
    first = math.atan2(-v / r, deep)  # x = h - deep + a cos(r t + first)
    t2 = t1 + (2 * math.pi - 2 * first) / r
    if t2 > 1:
        return h - deep + a * math.cos(r * (1 - t1) + first)
    return h + -v * (1 - t2) - 5 * (1 - t2) ** 2


def derivative(f: Callable[[float], Any], x: float, h: float = 1e-4) -> Any:
    """A difference quotient of order six."""
    return sum(c * (f(x + n * h) - f(x - n * h)) for n, c in ((1, 45), (2, -9), (3, 1))) / (60 * h)


@pytest.fixture(scope="module")
def jumping(made: Callable[..., Made]) -> Any:
    return made(parsed, JUMPS).solver


@pytest.mark.parametrize("way", ["forward", "adjoint"])
@pytest.mark.parametrize("options", METHODS, ids=["dop853", "dop853 loose", "radau", "radau loose", "rk4"])
def test_derivatives_across_jumps_and_kinks(jumping: Any, options: dict[str, Any], way: str) -> None:
    values, by = closed_forms(kinked(1.0, 0.4, 200.0))
    for column, name in ((1, 0), (6, 1), (7, 2)):
        at = [1.0, 0.4, 200.0]
        by[3, column] = derivative(
            lambda x, at=at, name=name: kinked(*at[:name], x, *at[name + 1 :]), at[name], 1e-3 * at[name]
        )
    wanted = [Final("timed"), Final("band"), Final("slope"), Final("kink"), Integral("high")]
    found = jumping.judge(1.0, wanted, inputs=[0.0], wrt=NAMES, method=way, **options)
    of_rk4 = options.get("integrator") == "rk4"
    tolerance = 1e-7 if of_rk4 else 300 * options.get("rtol", 1e-9)
    np.testing.assert_allclose(found.values, np.delete(values, 4), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(found.gradients, np.delete(by, 4, axis=0), rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_a_switch_of_a_held_input_moves_with_nothing(jumping: Any, way: str) -> None:
    """The input jumps from 0 to 5 at 0.5 s: the force does then, whatever mu is."""
    push = ([0.0, 0.5, 1.0], [[0.0], [5.0], [5.0]], "hold")
    found = jumping.judge(1.0, Final("pushed"), inputs=push, wrt=["mu"], method=way)
    assert found.values[0] == pytest.approx(0.125 + 0.25 + 0.375, rel=1e-12)
    assert abs(found.gradients[0, 0]) < 1e-13


ANGLES = """
model: angles
parameters: {{a: 0.3, s: 0.5, x0: 1.0, v0: 3.0, k: 2.0}}
inputs: [off]
bodies:
  left: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
  right: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
  none: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
forces:
  left: {{type: joint, joint: left, value: "k*{left} - 9"}}
  right: {{type: joint, joint: right, value: "k*{right} - 9"}}
  none: {{type: joint, joint: none, value: "-k*{none} - 5"}}
initial: {{q: {{left: x0, right: x0}}, u: {{none: v0}}}}
outputs: {{left: {{value: q.left}}, right: {{value: q.right}}, none: {{value: q.none}}}}
"""


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_an_angle_that_jumps_at_half_a_turn(made: Callable[..., Made], method: str) -> None:
    """`atan2` jumps where its second argument is negative, or zero; elsewhere it does not. The same is written with `sign`."""
    angles = ("atan2(q.left - s, -a)", "atan2(q.right - s, a)", "atan2(u.none, off)")
    signs = ("(pi*sign(q.left - s) - atan((q.left - s)/a))", "atan((q.right - s)/a)", "pi/2*sign(u.none)")
    found, wanted = (
        [
            solver.judge(
                1.0, [Final(o) for o in solver.output_names], inputs=[0.0], wrt=["a", "s", "x0", "v0", "k"], method=way,
                integrator=method, rtol=1e-10, atol=1e-10,
            )
            for way in ("forward", "adjoint")
        ]
        for solver in (
            made(parsed, ANGLES.format(left=left, right=right, none=none)).solver
            for left, right, none in (angles, signs)
        )
    )  # fmt: skip
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(one.gradients, other.gradients, rtol=1e-7, atol=1e-7)


def test_speeds_without_bounds_are_no_accumulation(made: Callable[..., Made]) -> None:
    """The speed grows beyond all bounds before t = 1, while q passes kinks more and more often, which do not end the motion."""
    solver = made(parsed, BOUNDLESS).solver
    with pytest.raises(SimulationError, match=r"because of u\.block; it may be unbounded") as ended:
        solver.simulate(2.0)
    assert ended.value.trajectory.t[-1] <= 1.0


BOUNDLESS = """
model: boundless
parameters: {a: 1.0}
bodies: {block: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces: {f: {type: joint, joint: block, value: "u.block**2 + a*abs(sin(5*q.block))"}}
initial: {u: {block: 1}}
"""

STUCK = """
model: stuck
parameters: {mu: 4.0, k: 10.0}
bodies: {block: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces: {friction: {type: joint, joint: block, value: "-mu*sign(u.block) - k*q.block"}}
initial: {q: {block: 1.5}}
outputs: {x: {value: q.block}}
"""


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_a_block_that_sticks_is_told_by_name(made: Callable[..., Made], method: str) -> None:
    """From 1.5 m it swings to -0.7 m, where 7 N do push it on, and then to -0.1 m, where friction holds it."""
    solver = made(parsed, STUCK).solver
    with pytest.raises(
        SimulationError, match=r"sign\(u\.block\) in forces\.friction\.value changes its branch"
    ) as ended:
        solver.simulate(10.0, method=method)
    stopped = ended.value.trajectory
    assert stopped.t[-1] == pytest.approx(2 * math.pi / math.sqrt(10), rel=1e-7)
    assert stopped["x"][-1] == pytest.approx(-0.1, abs=1e-7)
    assert stopped.stats["steps"] < 500


ALONE = """
model: alone
parameters: {{mu: 0.4, a: 1.0, s: 0.5, k: 5.0}}
bodies: {{block: {{parent: ground, joint: {{type: {joint}}}, mass: 1, inertia: {{zz: 1, xx: 1, yy: 1}}}}}}
forces: {{f: {{{force}}}}}
initial: {{q: {{block: {q}}}, u: {{block: {u}}}}}
outputs: {{x: {{value: q.block}}, v: {{value: u.block}}, step: {{value: "if(q.block > s, 1, 3)"}}}}
"""


def alone(force: str, q: float, u: float) -> str:
    """A block of 1 kg with a single force."""
    value = f'type: joint, joint: block, value: "{force}"'
    return ALONE.format(joint="prismatic, axis: x", force=value, q=q, u=u)


def test_rest_at_a_kink_and_with_friction_goes_on(made: Callable[..., Made]) -> None:
    for force in ("-a*q.block - mu*sign(u.block)", "-a*abs(q.block) - u.block*abs(u.block)"):
        run = made(parsed, alone(force, 0.0, 0.0)).solver.simulate(5.0, sensitivities=["a", "mu"])
        assert run.ended == "finished" and not run.q.any() and not run.dq.any() and run.stats["steps"] < 50


def test_a_block_that_friction_holds_does_not_move(made: Callable[..., Made]) -> None:
    solver = made(parsed, alone("-a*q.block - mu*sign(u.block)", 0.2, 0.0)).solver
    with pytest.raises(SimulationError, match=r"at t = 0 s: where sign\(u\.block\) .* sticks or slides"):
        solver.simulate(5.0)


def test_switches_that_accumulate_end_a_motion(made: Callable[..., Made]) -> None:
    """Fuller's problem: the state comes to rest after infinitely many switches in a finite time."""
    solver = made(parsed, alone("-a*sign(q.block) - mu*sign(u.block)", 1.0, 0.0)).solver
    with pytest.raises(SimulationError, match="changes its branch faster and faster") as ended:
        solver.simulate(20.0)
    v, ratio = (
        math.sqrt(1.2),
        0.6 / 1.4,
    )  # each half swing is that part of the one before, and takes the root of it in time
    at_rest = (v / 0.6 + v / 1.4) / (1 - math.sqrt(ratio))
    assert ended.value.trajectory.t[-1] == pytest.approx(at_rest, abs=1e-6)
    assert ended.value.trajectory.stats["steps"] < 2000


def test_a_switch_that_is_only_touched_is_told(made: Callable[..., Made]) -> None:
    """Thrown up to the very height from which on another force acts."""
    solver = made(parsed, alone("if(q.block > s, -2, -1)", 0.0, 1.0)).solver
    with pytest.warns(RuntimeWarning, match=r"only touches a switch, where s >= q\.block in forces\.f\.value"):
        solver.simulate(1.5, sensitivities=["s"])


def test_a_branch_without_a_value_beyond_its_switch_is_told(made: Callable[..., Made]) -> None:
    solver = made(parsed, alone("if(q.block > s, -5 - sqrt(q.block - s), -1)", 1.0, 0.0)).solver
    with pytest.warns(RuntimeWarning, match=r"derivatives lack that jump; write max\(0, \.\.\)"):
        solver.simulate(0.5, sensitivities=["s"])


def test_an_event_where_a_force_jumps(made: Callable[..., Made]) -> None:
    """From 1 m with -12 m/s^2: 0.5 m are passed at sqrt((1 - s)/6)."""
    solver = made(parsed, alone("if(q.block > s, -12*a, -6)", 1.0, 0.0)).solver
    event = Event("step", 2.0, stop=False)
    (met,) = solver.simulate(0.5, sensitivities=["a", "s"], events=[event]).events
    t = math.sqrt(0.5 / 6)
    assert met.t == pytest.approx(t, rel=1e-12)
    np.testing.assert_allclose(met.dt, [-t / 2, -1 / (12 * t)], rtol=1e-9)
    np.testing.assert_allclose([met.q[0], met.u[0]], [0.5, -12 * t], rtol=1e-12)
    np.testing.assert_allclose(met.dq[:, 0], [0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(met.du[:, 0], [-6 * t, 1 / t], rtol=1e-9)
    back = solver.judge(0.5, AtEvent("t", event), wrt=["a", "s"], method="adjoint")
    assert back.method == "adjoint"
    np.testing.assert_allclose(back.gradients[0], met.dt, rtol=1e-9)


def swung(k: float, u: float = 10.0, end: float = 1.0) -> float:
    """A torsion spring from 2 rad at a speed: its angle jumps from pi to -pi."""
    w, a, t, turns = math.sqrt(k), 2.0, 0.0, 0.0
    while True:
        size, phase = math.hypot(a, u / w), math.atan2(u / w, a)
        x = (phase - math.acos(math.pi / size)) / w if size > math.pi else math.inf
        if not 0 <= x < end - t:
            break
        a, u = -math.pi, -a * w * math.sin(w * x) + u * math.cos(w * x)
        t, turns = t + x, turns + 2 * math.pi
    return turns + a * math.cos(w * (end - t)) + u / w * math.sin(w * (end - t))


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_a_torsion_spring_at_half_a_turn(made: Callable[..., Made], way: str) -> None:
    force = "type: torsion, from: ground, to: block, axis: z, stiffness: k"
    solver = made(parsed, ALONE.format(joint="revolute, axis: z", force=force, q=2.0, u=10.0)).solver
    found = solver.judge(1.0, Final("x"), wrt=["k", "u0.block"], method=way)
    assert found.values[0] == pytest.approx(swung(5.0), rel=1e-9)
    by = [derivative(swung, 5.0, 1e-3), derivative(lambda u: swung(5.0, u), 10.0, 1e-3)]
    np.testing.assert_allclose(found.gradients[0], by, rtol=1e-7)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_steps_that_are_made_again_keep_their_modes(jumping: Any, integrator: str) -> None:
    wanted = [Final("band"), Final("slope"), Final("kink"), Integral("high")]
    options: dict[str, Any] = {"wrt": NAMES, "inputs": [0.0], "method": "adjoint", "integrator": integrator}
    found = [jumping.judge(1.0, wanted, memory=memory, rtol=1e-11, atol=1e-11, **options) for memory in (2**28, 2**15)]
    assert np.array_equal(found[0].gradients, found[1].gradients)


FORCES = {
    "springs through their points": """
model: sliding
parameters: {k: 20.0, L: 0.5, c: 0.3, b: 2.0}
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  b: {parent: a, joint: {type: prismatic, axis: -x, at: [L, 0, 0]}, mass: 2}
points: {pa: {body: a, at: [0.1, 0, 0]}, pb: {body: b, at: [-0.1, 0, 0]}}
forces:
  one: {type: spring, from: ground, to: a, stiffness: k, damping: c, free_length: L}
  two: {type: hardening_spring, from: pa, to: pb, stiffness: k, hardening: b, free_length: L, damping: c}
initial: {q: {a: 1.5, b: 0.2}, u: {b: 3.0}}
outputs: {a: {value: q.a}, b: {value: q.b}}
""",
    "points that pass a plane": """
model: passing
gravity: [0, 0, -10]
parameters: {h: 0.4, k: 200.0, z0: 1.0, L: 1.0, c: 3.0}
bodies:
  ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}
  arm:
    {parent: ground, joint: {type: revolute, axis: y, at: [3, 0, 0]}, mass: 1, com: [L, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  hand:
    {parent: arm, joint: {type: revolute, axis: y, at: [L, 0, 0]}, mass: 0.5, com: [0.3, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
points: {tip: {body: hand, at: [0.5, 0, 0]}, foot: {body: ball, at: [0, 0, 0]}}
forces:
  floor: {type: force, on: foot, value: [0, 0, "k*max(0, h - position.foot.z)"]}
  pad: {type: force, on: tip, value: [0, 0, "if(position.tip.z < -h and velocity.tip.z < 0, 2, 0) - c*velocity.tip.z"]}
initial: {q: {ball: z0}}
outputs: {z: {position: foot, axis: z}, tip: {position: tip, axis: z}, arm: {value: q.arm}}
""",
}


@pytest.mark.parametrize("name", FORCES)
def test_elements_that_jump(made: Callable[..., Made], name: str) -> None:
    solver, model, *_ = made(parsed, FORCES[name])
    names, wanted = list(solver.parameter_names), [Final(o) for o in solver.output_names]
    options: dict[str, Any] = {"wrt": names, "rtol": 1e-11, "atol": 1e-11}
    found = solver.judge(1.5, wanted, method="forward", **options).gradients
    np.testing.assert_allclose(solver.judge(1.5, wanted, method="adjoint", **options).gradients, found, atol=1e-11)
    assert len(model.switches.found) > 1
    p = np.array(list(model.defaults.values()))
    for i, value in enumerate(p):

        def at(x: float, i: int = i) -> Any:
            return solver.judge(1.5, wanted, p=np.where(np.arange(len(p)) == i, x, p), rtol=1e-13, atol=1e-13).values

        np.testing.assert_allclose(found[:, i], derivative(at, value, 1e-4 * value), rtol=1e-6, atol=1e-7)


INSIDE = {
    "log(abs(q.x) + 0.1)": lambda x: np.sign(x) / (abs(x) + 0.1),
    "sqrt(abs(q.x) + 0.1)": lambda x: 0.5 * np.sign(x) / np.sqrt(abs(x) + 0.1),
    "(max(q.x, -0.1) + 0.3)**1.5": lambda x: 1.5 * np.sqrt(max(x, -0.1) + 0.3) * (x > -0.1),
    "acos(abs(q.x)/2)": lambda x: -0.5 * np.sign(x) / np.sqrt(1 - x * x / 4),
}
"""Kinks in arguments of functions that are defined for some numbers only, and the slopes."""


@pytest.mark.parametrize("law", list(INSIDE))
def test_kinks_within_the_bounds_of_functions_are_exact(made: Callable[..., Made], law: str) -> None:
    """x passes at constant speed, so the derivative of y is an integral over time."""
    text = "model: inside\nbodies:\n" + "".join(
        f"  {n}: {{parent: ground, joint: {{type: prismatic, axis: {n}}}, mass: 1}}\n" for n in "xy"
    )
    text += f'forces:\n  f: {{type: joint, joint: y, value: "{law}"}}\n'
    solver = made(parsed, text + "initial: {q: {x: -0.31}, u: {x: 1}}\noutputs: {y: {value: q.y}}\n").solver
    nodes, weights = np.polynomial.legendre.leggauss(60)
    wanted = 0.0
    for low, high in ((0.0, 0.21), (0.21, 0.31), (0.31, 0.9)):
        t = 0.5 * (high - low) * nodes + 0.5 * (high + low)
        wanted += (
            0.5 * (high - low) * sum(w * (0.9 - s) * INSIDE[law](s - 0.31) for w, s in zip(weights, t, strict=True))
        )
    for method in ("forward", "adjoint"):
        for options in ({}, {"integrator": "radau"}, {"integrator": "rk4", "step": 0.01}):
            found = solver.judge(0.9, Final("y"), wrt=["q0.x"], method=method, **options)
            assert abs(found.gradients[0, 0] - wanted) < 2e-7, (method, options)


NESTED = {
    "if(max(0, -q.{0}) > 0, 5 + 900*max(0, -q.{0}) - u.{0}, 0)": (5.0, 900.0, 1.0),
    "sign(max(0, -q.{0}))*(5 + 900*max(0, -q.{0}))": (5.0, 900.0, 0.0),
    "if(max(-q.{0}, 0) > 0, 900*max(-q.{0}, 0) - u.{0}, 0)": (0.0, 900.0, 1.0),
    "if((abs(q.{0}) - q.{0})/2 > 0, 400*(abs(q.{0}) - q.{0})/2, 0)": (0.0, 400.0, 0.0),
}
"""Contacts under a condition whose switching function is zero all along the flight, and their force, stiffness and damping."""


def after_contact(x0: float, v0: float, force: float, stiffness: float, damping: float, end: float = 0.8) -> float:
    """Where a body of mass 1 is that flies from x0 to zero and back: x'' = force - stiffness x - damping x' where x < 0."""
    w, decay, rest = np.sqrt(stiffness - damping**2 / 4), damping / 2, force / stiffness
    a, b = -rest, (-v0 - decay * rest) / w
    low, high = 0.3 * np.pi / w, 1.2 * np.pi / w
    for _ in range(80):
        t = 0.5 * (low + high)
        inside = rest + np.exp(-decay * t) * (a * np.cos(w * t) + b * np.sin(w * t)) < 0
        low, high = (t, high) if inside else (low, t)
    v = np.exp(-decay * low) * ((b * w - decay * a) * np.cos(w * low) - (a * w + decay * b) * np.sin(w * low))
    return float(v * (end - x0 / v0 - low))


@pytest.mark.parametrize("options", [{}, {"integrator": "radau"}, {"integrator": "rk4", "step": 1e-3}])
def test_conditions_that_are_zero_on_one_side(made: Callable[..., Made], options: dict[str, Any]) -> None:
    """Bodies fly against the wall and away from it, by closed form; the force may jump there."""
    names = [f"b{i}" for i in range(len(NESTED))]
    text = "model: nested\nparameters: {x0: 0.31, v0: 1.7}\nbodies:\n" + "".join(
        f"  {n}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}\n" for n in names
    )
    text += "forces:\n" + "".join(
        f'  {n}: {{type: joint, joint: {n}, value: "{law.format(n)}"}}\n' for n, law in zip(names, NESTED, strict=True)
    )
    text += f"initial: {{q: {{{', '.join(f'{n}: x0 + {i}*0.013' for i, n in enumerate(names))}}}, "
    text += f"u: {{{', '.join(f'{n}: -v0' for n in names)}}}}}\n"
    solver = made(parsed, text + f"outputs: {{{', '.join(f'{n}: {{value: q.{n}}}' for n in names)}}}\n").solver
    for method in ("forward", "adjoint"):
        found = solver.judge(0.8, [Final(n) for n in names], wrt=["x0", "v0"], method=method, **options)
        for i, law in enumerate(NESTED.values()):
            x0 = 0.31 + 0.013 * i
            wanted = [
                derivative(lambda x, law=law: after_contact(x, 1.7, *law), x0),
                derivative(lambda v, law=law, x0=x0: after_contact(x0, v, *law), 1.7),
            ]
            assert abs(found.values[i] - after_contact(x0, 1.7, *law)) < 1e-6
            np.testing.assert_allclose(found.gradients[i], wanted, atol=1e-5)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_a_force_without_a_value_at_its_switch(made: Callable[..., Made], integrator: str) -> None:
    """x^3/abs(x) has no value at zero, where a step would end; it is the same force as x*abs(x)."""
    text = "model: quotient\nparameters: {k: 40, x0: -0.3}\nbodies:\n" + "".join(
        f"  {n}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}\n" for n in "ab"
    )
    text += 'forces:\n  a: {type: joint, joint: a, value: "-k*q.a**3/abs(q.a)"}\n'
    text += '  b: {type: joint, joint: b, value: "-k*q.b*abs(q.b)"}\n'
    text += "initial: {q: {a: x0, b: x0}, u: {a: 1, b: 1}}\noutputs: {a: {value: q.a}, b: {value: q.b}}\n"
    solver = made(parsed, text).solver
    for method in ("forward", "adjoint"):
        found = solver.judge(2.0, [Final("a"), Final("b")], wrt=["k", "x0"], method=method, integrator=integrator)
        assert abs(found.values[0] - found.values[1]) < 1e-8
        np.testing.assert_allclose(found.gradients[0], found.gradients[1], atol=1e-6)


FOLDED = """
model: folded
parameters: {{k: 0.3}}
bodies:
  b: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
forces:
  f: {{type: joint, joint: b, value: "{}"}}
initial: {{q: {{b: {}}}, u: {{b: 1.0}}}}
outputs: {{b: {{value: q.b}}}}
"""


@pytest.mark.parametrize(
    ("law", "same", "start"),
    [
        ("k*acos(cos(q.b))", "k*abs(q.b)", -0.5),
        ("k*acos(cos(q.b))", "k*if(q.b < pi, q.b, 2*pi - q.b)", 2.8),
        ("k*acos(cos(2*q.b + 1))", "k*abs(2*q.b + 1)", -0.9),
        ("k*asin(sin(q.b))", "k*if(q.b < pi/2, q.b, pi - q.b)", 1.2),
        ("k*atan(tan(q.b))", "k*if(q.b < pi/2, q.b, q.b - pi)", 1.2),
        ("k*atan2(0, q.b)", "k*if(q.b < 0, pi, 0)", -0.5),
        ("k*atan2(0, -q.b)", "k*if(q.b > 0, pi, 0)", -0.5),
    ],
)
def test_folded_angles_have_derivatives_beyond_their_folds(
    made: Callable[..., Made], law: str, same: str, start: float
) -> None:
    """Inverse functions of their own functions are pieces of straight lines, and ``atan2(0, x)`` is a step."""
    found, known = (made(parsed, FOLDED.format(x, start)).solver for x in (law, same))
    for options in METHODS:
        for way in ("forward", "adjoint"):
            one, other = (
                s.judge(1.0, Final("b"), wrt=["k", "q0.b", "u0.b"], method=way, **options) for s in (found, known)
            )
            close = 1e-5 if "rtol" in options or "step" in options else 1e-8
            np.testing.assert_allclose(one.values, other.values, rtol=close)
            np.testing.assert_allclose(one.gradients, other.gradients, rtol=close, atol=close)
