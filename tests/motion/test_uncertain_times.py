"""Times of switches and events have the errors of the motion; derivatives that depend on their order do not exist.

Derivatives that depend on an order within these errors do not exist, and nothing is passed unseen.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, parsed

from codegen.runtime import AtEvent, Event, Final

NEAR = """
model: near
parameters: {a: 100.0, b: 100.0, f: 2.0, w: 9.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  y: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  x: {type: joint, joint: x, value: "3*sin(w*t) - 20*q.x + f*if(q.y > a, u.x, 1)*if(q.x > b, 1, 0)"}
  y: {type: joint, joint: y, value: "-30*sin(q.y) + f*if(q.y > a, 1, 0)"}
initial: {u: {x: 0.5, y: 2}, q: {x: -0.1, y: -0.3}}
outputs: {x: {value: q.x}, w: {value: u.x}, y: {value: q.y}, past: {value: q.x - b}, behind: {value: 2*q.x - 2*b}}
"""
NAMES = ["a", "b", "f", "w"]
WANTED = [Final("x"), Final("w"), Final("y"), AtEvent("w", Event("past", stop=False))]


def near(solver: Any, apart: float, wanted: Any = WANTED, **options: Any) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Values, derivatives and messages; q.y passes `a` at 0.2 s, and q.x passes `b` later by a given time."""
    at = solver.simulate([0.0, 0.1, 0.2], rtol=1e-13, atol=1e-13)
    p = {"a": at.q[-1, 1], "b": at.q[-1, 0] + apart * at.u[-1, 0]}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = solver.judge(0.5, wanted, p=p, wrt=NAMES, **options)
    return np.array(found.values), found.gradients, [str(w.message) for w in said]


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("tolerance", [1e-9, 1e-6])
def test_an_order_within_the_errors_of_a_motion(made: Callable[..., Made], integrator: str, tolerance: float) -> None:
    """Radau took switches 6e-9 s apart in the wrong order. Events were missed if the step to a switch had passed them."""
    solver: Any = made(parsed, NEAR).solver
    options: dict[str, Any] = {"integrator": integrator, "rtol": tolerance, "atol": tolerance}
    for apart in (0.0, *(s * by * tolerance for by in (1e-3, 0.1, 1.0, 5.0) for s in (1, -1))):
        for way in ("forward", "adjoint"):
            _, found, said = near(solver, apart, method=way, **options)
            assert np.isnan(found[:3, :2]).all() and np.isfinite(found[:, 2]).all(), apart
            assert any("change their branches at the same time" in text for text in said)
    for apart in (100 * tolerance, -100 * tolerance, 1e-3, -1e-3):
        exact = near(solver, apart, rtol=1e-13, atol=1e-13)
        for way in ("forward", "adjoint"):
            values, found, said = near(solver, apart, method=way, **options)
            assert not said
            np.testing.assert_allclose(values, exact[0], rtol=0.0, atol=100 * tolerance)
            np.testing.assert_allclose(found, exact[1], rtol=0.0, atol=1000 * tolerance)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_switches_of_one_function_keep_their_order(made: Callable[..., Made], integrator: str) -> None:
    """Errors move both alike, so that neither precedes the other, whatever the tolerance."""
    text = NEAR.replace("if(q.y > a, u.x, 1)*if(q.x > b, 1, 0)", "if(q.x > b, 1, 0)*if(2*q.x > 2*b - 2e-4, u.x, 2)")
    solver: Any = made(parsed, text).solver
    exact = near(solver, 0.0, rtol=1e-13, atol=1e-13)
    _, found, said = near(solver, 0.0, integrator=integrator, rtol=1e-5, atol=1e-5)
    assert not any("same time" in text for text in said)
    np.testing.assert_allclose(found, exact[1], rtol=0.0, atol=1e-2)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("apart", [0.0, 4e-7, -4e-7, 2e-6, -2e-6])
def test_events_at_a_switch_within_the_errors(made: Callable[..., Made], integrator: str, apart: float) -> None:
    """The speed at the event q.y = .. jumps in its derivatives if q.x passes `b` before."""
    solver: Any = made(parsed, NEAR).solver
    level = float(solver.simulate([0.0, 0.1, 0.2], rtol=1e-13, atol=1e-13).q[-1, 1])
    event = AtEvent("w", Event("y", level, stop=False))
    for way in ("forward", "adjoint"):
        found, said = near(solver, apart, [event], method=way, integrator=integrator, rtol=1e-6, atol=1e-6)[1:]
        assert np.isnan(found[0, 1])
        assert any(f"the event y = {level:g} occurs where" in text for text in said)
        well = near(solver, 1e-3, [event], method=way, integrator=integrator, rtol=1e-6, atol=1e-6)
        exact = near(solver, 1e-3, [event], rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(well[1], exact[1], rtol=0.0, atol=1e-3)


THROWN = """
model: thrown
parameters: {g: 10.0, v: 10.0, top: 5.0, f: 3.0}
gravity: [0, 0, -g]
bodies:
  ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}
  beside: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}
forces: {push: {type: joint, joint: beside, value: "g + if(q.ball > top, f, 0)"}}
initial: {u: {ball: v}}
outputs: {z: {value: q.beside}, w: {value: u.beside}}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_a_switch_that_errors_may_leave_out(made: Callable[..., Made], integrator: str, way: str) -> None:
    """The top of a throw, 5 m: u.beside = f 2 sqrt(2 (5 - top)/g) while the ball is above `top`."""
    solver: Any = made(parsed, THROWN).solver
    options: dict[str, Any] = {"wrt": ["top", "f"], "method": way, "integrator": integrator}
    for below in (1e-9, -1e-9, 1e-10, 1e-8):
        with pytest.warns(RuntimeWarning, match=r"only touches a switch, where top >= q\.ball"):
            solver.judge(1.5, Final("w"), p={"top": 5.0 - below}, **options)
    for below in (1e-5, 1e-2):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = solver.judge(1.5, Final("w"), p={"top": 5.0 - below}, **options).gradients
        long = 2 * np.sqrt(2 * below / 10)
        np.testing.assert_allclose(found, [[-3.0 * long / (2 * below), long]], rtol=1e-3)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = solver.judge(1.5, Final("w"), p={"top": 5.0 + below}, **options).gradients
        assert (found == 0.0).all()


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_results_within_the_errors_of_a_switch(made: Callable[..., Made], integrator: str, way: str) -> None:
    """The derivative of the speed by the threshold jumps where it is passed."""
    solver: Any = made(parsed, NEAR).solver
    options: dict[str, Any] = {"method": way, "integrator": integrator, "rtol": 1e-6, "atol": 1e-6}
    for after in (0.0, 1e-7, -1e-7, 2e-6, -2e-6):
        at = solver.simulate([0.0, 0.2 + after], rtol=1e-13, atol=1e-13)
        with pytest.warns(RuntimeWarning, match=r"where a >= q\.y .* with respect to a.* are those of one side"):
            solver.judge(0.2, Final("y"), p={"a": at.q[-1, 1]}, wrt=NAMES, **options)
    at = solver.simulate([0.0, 0.2], rtol=1e-13, atol=1e-13)
    for end in (0.2 - 1e-4, 0.2 + 1e-4):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            solver.judge(end, Final("y"), p={"a": at.q[-1, 1]}, wrt=NAMES, **options)


KNOTS = """
model: knots
parameters: {c: 0.0, f: 2.0}
inputs: [push]
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  x: {type: joint, joint: x, value: "push - 20*sin(q.x) + if(u.x > c, f, 0)"}
initial: {u: {x: 0.5}, q: {x: -0.4}}
outputs: {x: {value: q.x}, w: {value: u.x}}
"""
HELD = ([0.0, 0.1], [[3.0], [30.0]], "hold")
"""The speed changes by 9 m/s^2 before the knot, and by 36 m/s^2 after it."""


def beside_knot(solver: Any, later: float) -> dict[str, float]:
    """A threshold of the speed that is passed the given time after the knot at 0.1 s."""
    speed = solver.simulate([0.0, 0.1], p={"c": 100.0}, inputs=HELD, rtol=1e-13, atol=1e-13).u[-1, 0]
    return {"c": speed + later * (9 if later < 0 else 36)}


@pytest.mark.parametrize("wrt", [(), ("f",)])
def test_a_long_step_after_a_short_one(made: Callable[..., Made], wrt: tuple[str, ...]) -> None:
    """After a step of 6e-9 s to a switch, Newton's method of radau ended too early: an error of 2e-4 at a tolerance of 1e-6."""
    solver: Any = made(parsed, KNOTS).solver
    for later in (5e-9, -1e-7, 2e-8, 1e-6):
        p = beside_knot(solver, later)
        options: dict[str, Any] = {"p": p, "inputs": HELD, "sensitivities": wrt}
        exact = solver.simulate([0.0, 0.2], rtol=1e-13, atol=1e-13, **options)
        found = solver.simulate([0.0, 0.2], rtol=1e-6, atol=1e-6, method="radau", **options)
        np.testing.assert_allclose(found.u, exact.u, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_a_switch_just_before_a_knot(made: Callable[..., Made], integrator: str) -> None:
    """The rates after the switch had the input of the next interval, which looked like a jump without a switch."""
    solver: Any = made(parsed, KNOTS).solver
    exact = solver.judge(0.4, Final("w"), p=beside_knot(solver, -1e-3), inputs=HELD, wrt=["f"], rtol=1e-13, atol=1e-13)
    for sooner in (1e-10, 1e-11):
        with warnings.catch_warnings():
            warnings.filterwarnings("error", message=".*known switch")
            found = solver.judge(
                0.4, Final("w"), p=beside_knot(solver, -sooner), inputs=HELD, wrt=["f"], integrator=integrator
            )
        np.testing.assert_allclose(found.gradients, exact.gradients, rtol=5e-3)


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("way", ["forward", "adjoint"])
@pytest.mark.parametrize(
    "force", ["push - 20*sin(q.x) + if(u.x > c, f, 0)", "f - 20*sin(q.x) + push*if(q.x > c, 1, 0)"]
)
def test_a_switch_and_a_knot_within_the_errors(
    made: Callable[..., Made], force: str, way: str, integrator: str
) -> None:
    """The time of the switch, or the jump there, depends on the input, and so on whether the knot precedes the switch."""
    solver: Any = made(parsed, KNOTS.replace("push - 20*sin(q.x) + if(u.x > c, f, 0)", force)).solver
    at = solver.simulate([0.0, 0.1], p={"c": 100.0}, inputs=HELD, rtol=1e-13, atol=1e-13)
    start = float(at.u[-1, 0] if "u.x" in force else at.q[-1, 0])
    options: dict[str, Any] = {"inputs": HELD, "wrt": ["c", "f", "u0.x"], "method": way, "integrator": integrator}
    for later in (0.0, 1e-12, -1e-12, 1e-10, -1e-10):
        with pytest.warns(
            RuntimeWarning, match=r"with respect to c, .*u0\.x do not exist and are NaN: the motion reaches"
        ):
            found = solver.judge(0.4, Final("w"), p={"c": start + later}, **options).gradients
        assert np.isnan(found[0, [0, 2]]).all()
    for later in (1e-5, -1e-5):
        exact = solver.judge(0.4, Final("w"), p={"c": start + later}, **options | {"rtol": 1e-13, "atol": 1e-13})
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = solver.judge(0.4, Final("w"), p={"c": start + later}, **options).gradients
        np.testing.assert_allclose(found, exact.gradients, rtol=1e-6, atol=1e-6)
