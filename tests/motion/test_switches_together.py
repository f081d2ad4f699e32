"""Events at switches, and several switches at one time: derivatives against differences of motions, or NaN if none exist."""

from __future__ import annotations

import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard.one_condition import Body, Mechanism
from motion.models import Made, parsed
from motion.test_switches import derivative

import codegen
from codegen.runtime import AtEvent, Event, Final, Integral

BLOCK = """
model: block
parameters: {{a: 1.0, b: 0.3, s: 0.5, r: 0.5, v: -3.4641016151377544}}
inputs: [push]
bodies: {{block: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}}}
forces: {{f: {{type: joint, joint: block, value: "{force}"}}}}
initial: {{q: {{block: 1.0}}}}
outputs:
  x: {{value: q.block}}
  w: {{value: u.block}}
  step: {{value: "if(q.block > s, 1, 3)"}}
  mixed: {{value: "if(q.block > s, q.block**2, 3*q.block + u.block)"}}
  pushed: {{value: push*q.block}}
"""
"""From 1 m with -12*a m/s^2, so that 0.5 m are passed at sqrt(1/12) s with v."""

FALLS = "if(q.block > s, -12*a, -6*b)"
PUSH = ([0.0, 0.2, 1.0], [[0.0], [5.0], [5.0]], "hold")
NAMES = ["a", "b", "s", "r", "v"]
END = 0.6
EXACT: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-12}


def differences(solver: Any, wanted: Any, inputs: Any) -> np.ndarray:
    """Derivatives with respect to `NAMES` by differences of motions at 1e-13."""
    p = np.array([1.0, 0.3, 0.5, 0.5, -(12**0.5)])

    def values(x: float, i: int) -> np.ndarray:
        at = np.where(np.arange(len(p)) == i, x, p)
        return np.array(solver.judge(END, wanted, p=at, inputs=inputs, rtol=1e-13, atol=1e-13).values)

    return np.array([derivative(lambda x, i=i: values(x, i), p[i]) for i in range(len(p))]).T


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize(
    ("force", "output", "level", "inputs"),
    [
        (FALLS, "step", 2.0, [0.0]),  # the force jumps with it
        (FALLS, "mixed", 0.0, [0.0]),
        ("-12*a", "step", 2.0, [0.0]),  # no force does
        ("if(u.block > -1 - b, -12*a, -6*b)", "step", 2.0, [0.0]),  # another force has jumped before
        (FALLS, "pushed", 1.0, PUSH),  # with the input, whose time depends on nothing
    ],
)  # fmt: skip
def test_events_of_outputs_that_jump(
    made: Callable[..., Made], force: str, output: str, level: float, inputs: Any, stop: bool, integrator: str
) -> None:
    solver = made(parsed, BLOCK.format(force=force)).solver
    event = Event(output, level, stop=stop)
    wanted = [AtEvent(o, event) for o in ("t", *solver.output_names)]
    options: dict[str, Any] = {"wrt": NAMES, "inputs": inputs, "integrator": integrator, **EXACT}
    forward = solver.judge(END, wanted, method="forward", **options)
    np.testing.assert_allclose(forward.gradients, differences(solver, wanted, inputs), rtol=1e-8, atol=1e-8)
    adjoint = solver.judge(END, wanted, method="adjoint", memory=2**14, **options)
    assert adjoint.method == "adjoint"
    np.testing.assert_allclose(adjoint.gradients, forward.gradients, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("stop", [False, True])
def test_an_event_at_the_very_switch_of_a_force(made: Callable[..., Made], stop: bool) -> None:
    """The event x = 0.5 and the jump at s = 0.5: with a larger s another force precedes the event, else none does."""
    solver = made(parsed, BLOCK.format(force=FALLS)).solver
    wanted = [AtEvent(o, Event("x", 0.5, stop=stop)) for o in ("t", "x", "w")]
    for way in ("forward", "adjoint"):
        with pytest.warns(RuntimeWarning, match=r"event x = 0\.5 occurs where s >= q\.block .* depend on the order"):
            found = solver.judge(END, wanted, wrt=NAMES, inputs=[0.0], method=way, **EXACT).gradients
        t = np.sqrt(1 / 12)
        expected = np.zeros((3, 5))
        expected[:, 0] = -t / 2, 0.0, -12 * t / 2
        expected[2, 2] = np.nan
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


TOGETHER = {
    # force, columns of `NAMES` whose derivatives do not exist
    "-12*a + if(q.block > s, 0, 5) + if(r > q.block, 3, 0)": [],  # jumps add up, whichever comes first
    "-12*a + if(q.block > s and q.block > r, 0, 9*b)": ["s", "r"],  # the larger one counts
    "-12*a + if(q.block < s, 9*b, 0)*if(q.block < r, 2, 1)": ["s", "r"],
    "-12*a + if(q.block < s, 9, 0) + if(u.block < v, -4, 0)": ["s", "v"],  # the speed depends on the first force
    "-12*a + if(q.block < s, 9*b, 0) + if(2*q.block < 2*s, 9*b, 0)": [],  # one place, written twice
}


@pytest.mark.parametrize("force", TOGETHER)
@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_switches_at_one_time(made: Callable[..., Made], force: str, way: str) -> None:
    solver, lost = made(parsed, BLOCK.format(force=force)).solver, TOGETHER[force]
    wanted = [Final("x"), Final("w"), Integral("x")]
    options: dict[str, Any] = {"wrt": NAMES, "inputs": [0.0], "method": way, **EXACT}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = solver.judge(END, wanted, **options).gradients
    said = [str(w.message) for w in said]
    assert any("at the same time; derivatives that depend on the order" in w for w in said) == bool(lost), said
    gone = np.isnan(found).all(axis=0)
    if "u.block < v" in force:  # along a and s the speed comes before or behind the place, too
        assert gone[[2, 4]].all() and not gone[[1, 3]].any()
        return
    assert [n for n, no in zip(NAMES, gone, strict=True) if no] == lost
    np.testing.assert_allclose(found[:, ~gone], differences(solver, wanted, [0.0])[:, ~gone], rtol=1e-7, atol=1e-7)


LATE = """
forces: {f: {type: joint, joint: b0, value: "if(q.b0 > 0, 1, 3)"}}
"""


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_a_switch_at_a_pose_without_rank_is_reported(made: Callable[..., Made], method: str) -> None:
    """A parallelogram that is flat where the force changes: no step can end there."""
    cranks = [Body(True, (x, 0.0), 0.0, 1.0, 0.5, 0.08, 1.0) for x in (0.0, 2.0)]
    m = Mechanism(cranks, np.array([1.0, 1.0]), u=np.array([1.0, 1.0]))
    m.distance(0, 1)
    solver = made(parsed, m.text([0]) + LATE).solver
    with pytest.warns(RuntimeWarning, match=r"passes where 0 >= q\.b0 in forces\.f\.value .* while a loop loses rank"):
        solver.simulate(5.0, method=method)


KINKED = """
model: kinked
parameters: {a: 0.0, t0: 0.7}
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  bob: {parent: cart, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -1], inertia: {xx: 1, yy: 1, zz: 1}}
motion: {cart: "a*max(0, t - t0)"}
"""

PROGRAM = r"""
#include "kinked.h"
#include "motion/motion.h"
#include <stdio.h>
#include <stdlib.h>
extern const ordernm_system kinked_system;
int main(void)
{
    double q[] = {0.1}, u[] = {0.0}, p[] = {1.0, 0.7}, atol[] = {1e-9, 1e-9}, times[] = {1.0};
    ordernm_problem problem = {.system = &kinked_system, .method = ORDERNM_DOP853, .p = p, .q = q, .u = u, .end = 1.0,
        .ntimes = 1, .times = times, .rtol = 1e-9, .atol = atol, .inputs = {.count = 1}};
    ordernm_results r = {.rows = malloc(ordernm_row_size(&problem)*sizeof(double)), .capacity = 1};
    ordernm_motion *m = ordernm_begin(&problem, malloc(ordernm_room(&problem)*sizeof(double)));
    printf("%d ", ordernm_go(m, &r, 0.0));
    printf("%d %.12g\n", r.moved, r.moved_at);
    return 0;
}
"""


def test_c_reports_switches_of_prescribed_motion(tmp_path: Path) -> None:
    """Python ends the motion before the jump of the velocity."""
    folder = tmp_path / "kinked"
    codegen.generate(codegen.parse_model(KINKED), folder, check=False, functions=("motion",), compile="all")
    (tmp_path / "own.c").write_text(PROGRAM)
    sources = [
        tmp_path / "own.c",
        folder / "kinked.c",
        folder / "kinked_motion.c",
        *sorted((folder / "motion").glob("*.c")),
    ]
    command = ["gcc", "-O0", "-I", str(folder), *map(str, sources), "-o", str(tmp_path / "own"), "-lm"]
    subprocess.run(command, check=True)
    said = subprocess.run([str(tmp_path / "own")], capture_output=True, text=True, check=True).stdout
    assert said == "0 1 0.7\n"


PAIR = """
model: pair
parameters: {a: 100.0, c: 100.0, f: 2.0}
bodies:
  x: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  x: {type: joint, joint: x, value: "3*sin(9*t) - 20*q.x + f*if(q.x > a and u.x > c, 1, 0)"}
initial: {u: {x: 0.05}, q: {x: -0.1}}
outputs: {x: {value: q.x}}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_switches_that_are_nearly_at_one_time(made: Callable[..., Made], integrator: str) -> None:
    """Where the interpolant took them in the other order, the first one changed its mode without a warning."""
    solver: Any = made(parsed, PAIR).solver
    at = solver.simulate([0.0, 0.1, 0.2], rtol=1e-13, atol=1e-13)
    place, speed = at.q[-1, 0], at.u[-1, 0]
    for apart in (1.4677992676220676e-12, 2.154434690031878e-12, 3.1622776601683794e-12, 3e-11, 1e-10):
        for d in (apart, -apart):
            with pytest.warns(RuntimeWarning, match="change their branches at the same time"):
                found = solver.judge(
                    0.5, Final("x"), p={"a": place + d * speed, "c": speed}, wrt=["a", "c", "f"], integrator=integrator
                ).gradients
            assert np.isnan(found[0, :2]).all() and np.isfinite(found[0, 2])
