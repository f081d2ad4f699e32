"""Motions that begin, and inputs that jump, exactly to where a force changes its branch: right values; derivatives that agree on
both sides, or NaN with a warning."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed
from scipy.integrate import quad

from codegen.runtime import At, Final, SimulationError

STARTS = """
model: starts
parameters: {a: 0.0, b: 0.0, t0: 0.0, m: 0.7, c: 1.0}
inputs: [push]
tables:
  bent: {x: [-1, 0, 1, 2], y: [0.5, 0, 1, 3], kind: linear, outside: linear}
bodies:
  jump: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  rests: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  timed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  wraps: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  angle: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  bends: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  stays: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  clips: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  kinks: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  jump: {type: joint, joint: jump, value: "if(q.jump > a, -c, 1)"}
  rests: {type: joint, joint: rests, value: "3 - c*sign(u.rests)"}
  timed: {type: joint, joint: timed, value: "if(t < t0, 1, 0)"}
  wraps: {type: joint, joint: wraps, value: "mod(q.wraps - a, m)"}
  angle: {type: joint, joint: angle, value: "atan2(q.angle - a, -1)"}
  bends: {type: joint, joint: bends, value: "-c*bent(q.bends - b)"}
  stays: {type: joint, joint: stays, value: "c*bent(q.stays - a)"}
  clips: {type: joint, joint: clips, value: "c*max(min(q.clips - b, 1), 0) + 1"}
  kinks: {type: joint, joint: kinks, value: "-c*abs(q.kinks - b)"}
initial: {u: {jump: 0.9, wraps: 1, angle: 1, bends: 1, kinks: 1}}
outputs:
  jump: {value: q.jump}
  rests: {value: q.rests}
  timed: {value: q.timed}
  wraps: {value: q.wraps}
  angle: {value: q.angle}
  bends: {value: q.bends}
  stays: {value: q.stays}
  clips: {value: q.clips}
  kinks: {value: q.kinks}
"""

BY = [
    "a",
    "b",
    "t0",
    "c",
    *(f"{kind}.{body}" for kind in ("q0", "u0") for body in ("jump", "rests", "bends", "stays", "clips")),
]

ONE_SIDED = {
    "jump": {"a", "q0.jump"}, "rests": {"u0.rests"}, "timed": {"t0"}, "wraps": {"a"}, "angle": {"a"},
    "stays": {"a", "q0.stays", "u0.stays"},
}  # fmt: skip


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_derivatives_at_a_start_on_a_switch(made: Callable[..., Made], integrator: str) -> None:
    """Derivatives by what moves the start across a jump were those of one side."""
    solver: Any = made(parsed, STARTS).solver
    sin, cos, sh, ch = math.sin(1), math.cos(1), math.sinh(1), math.cosh(1)
    exact = {
        "jump": {"c": -0.5, "u0.jump": 1.0}, "rests": {"c": -0.5, "q0.rests": 1.0},
        "bends": {"b": 1 - cos, "c": (cos - sin) / 2, "q0.bends": cos, "u0.bends": sin},
        "clips": {"b": 1 - ch, "c": sh / 2 - ch + 1, "q0.clips": ch, "u0.clips": sh},
        "kinks": {"b": 1 - cos, "c": (cos - sin) / 2},
    }  # fmt: skip
    for body in ("jump", "rests", "timed", "wraps", "angle", "bends", "stays", "clips", "kinks"):
        lost = ONE_SIDED.get(body, set())
        for way in ("forward", "adjoint"):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                found = solver.judge(
                    1.0, Final(body), inputs=[0.0], wrt=BY, method=way, integrator=integrator, rtol=1e-10, atol=1e-10
                )
            row = dict(zip(BY, found.gradients[0], strict=True))
            for name in lost:
                assert np.isnan(row[name]), (body, way, name)
                assert any(name in str(w.message).split("do not exist")[0] for w in said), (body, way, name)
            for name, x in exact.get(body, {}).items():
                assert row[name] == pytest.approx(x, abs=1e-8), (body, way, name)


GATES = """
model: gates
parameters: {mu: 1.0, c: 5.0}
inputs: [gate]
bodies:
  from: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  above: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  up_to: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  side: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  more: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  from: {type: joint, joint: from, value: "if(gate >= mu, c, 1)"}
  above: {type: joint, joint: above, value: "if(gate > mu, c, 1)"}
  up_to: {type: joint, joint: up_to, value: "if(gate <= mu, c, 1)"}
  side: {type: joint, joint: side, value: "c*sign(gate - mu)"}
  more: {type: joint, joint: more, value: "c*max(gate - mu, 0)"}
"""


@pytest.mark.parametrize("values", [(0, 1, 0), (1, 0, 1), (2, 1, 2), (1, 2, 1), (0, 1, 2), (1, 1, 1)])
@pytest.mark.parametrize("method", ["dop853", "radau", "rk4"])
def test_an_input_that_jumps_exactly_to_a_threshold(
    made: Callable[..., Made], method: str, values: tuple[int, ...]
) -> None:
    """The branch before the jump was kept in silence: `gate >= 1` remained false where gate became 1."""
    solver: Any = made(parsed, GATES).solver
    options = {"step": 0.05} if method == "rk4" else {}
    inputs = ([0.0, 0.4, 0.7], [[float(g)] for g in values], "hold")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        run = solver.simulate([0.0, 1.0], inputs=inputs, sensitivities=["c", "mu"], method=method, **options)
    x, v, by_c, v_by_c = (np.zeros(5) for _ in range(4))
    for h, g in zip((0.4, 0.3, 0.3), values, strict=True):
        of_c = np.array([g >= 1, g > 1, g <= 1, np.sign(g - 1), max(g - 1, 0)], float)
        force = 5 * of_c + (1 - of_c) * np.array([1, 1, 1, 0, 0])
        x, v = x + h * v + h * h / 2 * force, v + h * force
        by_c, v_by_c = by_c + h * v_by_c + h * h / 2 * of_c, v_by_c + h * of_c
    np.testing.assert_allclose(run.q[-1], x, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(run.dq[0, -1], by_c, rtol=0.0, atol=1e-11)
    assert np.isnan(run.dq[1, -1]).all() and any(
        "derivatives of the motion with respect to mu" in str(w.message) for w in said
    )


RAMPS = """
model: ramps
parameters: {mu: 1.0, c: 5.0}
inputs: [gate]
bodies:
  from: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  more: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  from: {type: joint, joint: from, value: "if(gate >= mu, c, 1)"}
  more: {type: joint, joint: more, value: "c*max(gate - mu, 0)"}
outputs:
  from: {value: q.from}
  more: {value: q.more}
"""


@pytest.mark.parametrize("values", [(0, 1, 2), (2, 1, 0), (0, 1, 0), (2, 1, 2), (0, 1, 1), (1, 1, 2), (0, 2, 0)])
@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_an_input_that_reaches_a_threshold_at_a_knot(
    made: Callable[..., Made], integrator: str, values: tuple[int, ...]
) -> None:
    """Where the input stays at the threshold, the branch before was kept; derivatives by the threshold were those of one side."""
    solver: Any = made(parsed, RAMPS).solver
    times = [0.0, 0.4, 1.0]
    places = sorted({0.0, 0.2, 0.4, 0.7, 1.0})  # the last ramp of (0, 2, 0) passes the threshold in its middle
    from_, more = (
        sum(
            quad(lambda t, of=of: (1 - t) * of(np.interp(t, times, values)), a, b)[0]
            for a, b in itertools.pairwise(places)
        )
        for of in (lambda g: float(g >= 1), lambda g: max(g - 1, 0))
    )
    for way in ("forward", "adjoint"):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = solver.judge(
                1.0, [Final("from"), Final("more")], inputs=(times, [[float(g)] for g in values], "linear"),
                wrt=["c", "mu"], method=way, integrator=integrator,
            )  # fmt: skip
        np.testing.assert_allclose(found.values, [5 * from_ + 0.5 - from_, 5 * more], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(found.gradients[:, 0], [from_, more], rtol=0.0, atol=1e-10)
        if values == (0, 2, 0):
            np.testing.assert_allclose(found.gradients[:, 1], [-1.0, -1.375], rtol=0.0, atol=1e-10)
        else:
            assert np.isnan(found.gradients[:, 1]).all()
            assert any("derivatives of the motion with respect to mu do not exist" in str(w.message) for w in said)


SAMPLED = """
model: sampled
parameters: {t0: 0.5, b: 0.4, c: 2.0}
bodies:
  timed: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  moved: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  bends: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  timed: {type: joint, joint: timed, value: "if(t < t0, c, 1)"}
  moved: {type: joint, joint: moved, value: "if(q.moved < b, c, 1)"}
  bends: {type: joint, joint: bends, value: "c*max(0, t - t0)"}
outputs: {v: {value: u.timed}, w: {value: u.moved}}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_results_at_the_time_of_a_switch_have_a_warning(made: Callable[..., Made], integrator: str) -> None:
    """Derivatives of speeds jump there: du/dt0 is 0 before, 1 after."""
    solver: Any = made(parsed, SAMPLED).solver
    names = ["t0", "b", "c"]
    for times in ([0.0, 0.5, 1.0], [0.0, 0.25, 0.5]):  # within the motion, and at its end
        with pytest.warns(
            RuntimeWarning,
            match=r"at t = 0\.5 s, exactly where t >= t0 .* derivatives of results with respect to t0 are",
        ):
            run = solver.simulate(times, sensitivities=names, method=integrator)
        np.testing.assert_allclose(run.du[:, times.index(0.5)], [[0, 0, 0], [0, 0, 0], [0.5, 0.5, 0]], atol=1e-9)
    for way in ("forward", "adjoint"):
        with pytest.warns(RuntimeWarning, match="derivatives of results with respect to t0 are those of one side"):
            solver.judge(1.0, At("v", 0.5), wrt=names, method=way, integrator=integrator)
        with pytest.warns(RuntimeWarning, match=r"exactly where q\.moved >= b .* with respect to b, c are"):
            solver.judge(math.sqrt(0.4), Final("w"), wrt=names, method=way, integrator=integrator)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = solver.simulate([0.0, 0.49, 0.51, 1.0], sensitivities=names, method=integrator)
        solver.simulate([0.0, 0.5, 1.0], sensitivities=["c", "q0.timed"], method=integrator)
        solver.simulate([0.0, 0.5, 1.0], method=integrator)
    np.testing.assert_allclose(run.du[0, 1:, 0], [0.0, 1.0, 1.0], atol=1e-9)


TOGETHER = """
model: together
parameters: {a: 0.0, b: 0.0}
bodies:
  cancel: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  cancel: {type: joint, joint: cancel, value: "sign(q.cancel - a) - sign(q.cancel - b)"}
initial: {u: {cancel: 2}}
outputs:
  x: {position: cancel, axis: x}
  work: {value: "u.cancel"}
"""


@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize("adjoint", ["forward", "adjoint"])
def test_a_start_at_two_jumps_that_cancel(made: Callable[..., Made], method: str, adjoint: str) -> None:
    """If both are shifted, the force stays zero; if one is shifted, a force acts on the way between them."""
    solver: Any = made(parsed, TOGETHER).solver
    with pytest.warns(RuntimeWarning, match="derivatives of the motion with respect to [ab] do not exist and are NaN"):
        found = solver.judge(
            0.5,
            [Final("x"), Final("work")],
            wrt=["a", "b", "q0.cancel", "u0.cancel"],
            integrator=method,
            method=adjoint,
        )
    assert np.isnan(found.gradients[:, :2]).all()
    assert found.gradients[:, 2:] == pytest.approx(np.array([[1, 0.5], [0, 1]]), abs=1e-12)


ROOTS = """
model: roots
parameters: {a: 0.0, k: 5.0, g: 0.0, b: -10.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  y: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  x: {type: joint, joint: x, value: g}
  y: {type: joint, joint: y, value: "LAW"}
initial: {u: {x: 2.0}}
outputs: {y: {value: q.y}, w: {value: u.y}}
"""
LAWS = {
    "k*sqrt(max(0, q.x - a))": 0.5,
    "k*sqrt(abs(q.x - a))": 0.5,
    "k*abs(q.x - a)**0.3": 0.3,
    "k*abs(q.x - a)**0.7": 0.7,
}
"""Laws, and their exponents."""
BY_ROOTS = ["a", "k", "q0.x", "u0.x", "u0.y"]


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("law", LAWS)
def test_a_start_with_a_speed_at_the_zero_of_a_root(made: Callable[..., Made], law: str, integrator: str) -> None:
    """u.y = k v^n T^(n + 1)/(n + 1): the derivative of the force is infinite at the start, its integral is not."""
    solver: Any = made(parsed, ROOTS.replace("LAW", law)).solver
    n, k, v, t = LAWS[law], 5.0, 2.0, 1.5
    w, y = k * v**n * t ** (n + 1) / (n + 1), k * v**n * t ** (n + 2) / ((n + 1) * (n + 2))
    by_place = k * v ** (n - 1) * np.array([t ** (n + 1) / (n + 1), t**n])  # d/dx0 of both
    exact = np.array([-by_place, [y / k, w / k], by_place, [n * y / v, n * w / v], [t, 1.0]]).T
    for way in ("forward", "adjoint"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = solver.judge(t, [Final("y"), Final("w")], wrt=BY_ROOTS, method=way, integrator=integrator)
        assert found.method == way
        np.testing.assert_allclose(found.values, [y, w], rtol=1e-7)
        np.testing.assert_allclose(found.gradients, exact, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize(
    ("law", "options"),
    [
        ("k*sqrt(max(0, q.x - a))", {"p": {"g": 1.0}, "u": [0.0, 0.0]}),  # at rest: like e log(e)
        ("k*sqrt(max(0, q.x - a)) + sqrt(max(0, u.x - 2))", {"p": {"g": 1.0}}),  # two zeros
    ],
)
@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_a_start_at_roots_without_derivatives(
    made: Callable[..., Made], law: str, options: Any, integrator: str, way: str
) -> None:
    solver: Any = made(parsed, ROOTS.replace("LAW", law)).solver
    with pytest.warns(RuntimeWarning, match="may not exist and are NaN"):
        found = solver.judge(1.5, Final("w"), wrt=["a", "q0.x", "u0.y"], method=way, integrator=integrator, **options)
    assert np.isnan(found.gradients[0, :2]).all() and found.gradients[0, 2] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_a_start_at_rest_between_forces_that_push_back(made: Callable[..., Made], integrator: str) -> None:
    """Steps became ever smaller, up to a million of them, and the message advised looser tolerances."""
    text = """
model: held
parameters: {f: 2.0, k: 3.0}
bodies: {x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}
forces: {x: {type: joint, joint: x, value: "f - k*if(q.x > 0, 1, 0)"}}
outputs: {x: {value: q.x}}
"""
    solver: Any = made(parsed, text).solver
    with pytest.raises(SimulationError, match=r"t = 0 s: where 0 >= q\.x in forces\.x\.value .* push the motion back"):
        solver.simulate(0.8, method=integrator)
    left = solver.simulate([0.0, 0.8], p={"k": 1.0}, method=integrator)
    assert left.q[-1] == pytest.approx([0.5 * 0.8**2], rel=1e-12)
    np.testing.assert_allclose(
        solver.simulate([0.0, 0.8], p={"f": 0.0, "k": 0.0}, method=integrator).q[-1], 0.0, atol=0.0
    )
