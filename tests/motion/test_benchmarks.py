"""Problems with known answers: the pendulum A01 and the N-four-bar A02 of the IFToMM library, both in closed form.

Numbers are those of Jacobi's functions in 40 digits (period of the pendulum 2.3678419475762374 s, of the four-bar
1.9425149226070837 s); the library gives drifts of energy only.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import EXAMPLES, PENDULUM, Made, example, parsed

from codegen.bench.problems import four_bars

TIGHT = {"rtol": 1e-12, "atol": 1e-12}

A01 = {  # t: x, y; starts at x = -1 at rest
    0.5: (-0.39104879155054638, -0.92036994878519220),
    1.0: (0.98629175113187531, -0.16501085312554116),
    2.0: (-0.79356619534332174, -0.60848393044379151),
    5.0: (-0.94230543504375733, -0.33475433841400058),
    9.99: (-0.31643646991303229, -0.94861370457577651),
    10.0: (-0.27508746257611686, -0.96141920509912506),
}
A01_ALONG = {  # t: dx/dg, dy/dg, dx/dL, dy/dL
    1.0: (
        0.01513279897636675,
        0.09045074623408030,
        0.83783899317371740,
        -1.05233267368186898,
    ),
    10.0: (
        2.12823552545959675,
        -0.60894447225304550,
        -21.15307796733476104,
        5.01232606770325129,
    ),
}

A02 = {  # N = 2, t: x, y, vx, vy of B0
    1.0: (
        -0.19502030194943509,
        -0.98079920566217383,
        -6.67667803688115806,
        1.32757832516048721,
    ),
    2.0: (
        0.05781579576801143,
        0.99832726786345548,
        1.01726013662043651,
        -0.05891224871344564,
    ),
    10.0: (
        0.32845811154081537,
        0.94451853817860096,
        1.42305147020694412,
        -0.49486884548704295,
    ),
}
A02_ALONG = {  # t = 1: of x, y, vx, vy by g, length, mass of first crank, of first coupler, v0
    "g": (-0.23757424003880485, 0.04723882295203836, 0.06651264024570201, 1.66797507932765928),
    "length": (4.15105444015104733, -1.84496467766316467, -10.57399913759718162, -28.65259724961396448),
    "mass_crank": (-0.07398740618351351, 0.01471151914792051, 0.02071393653366138, 0.51945509613347103),
    "mass_coupler": (0.11098110927527026, -0.02206727872188077, -0.03107090480049208, -0.77918264420020654),
    "v0": (-2.01547144731980679, 0.40075261884149446, 3.24483209990568987, 13.61734004657011415),
}  # fmt: skip
FLAT = 0.71435552929296047
"""When A02 is flat first, s: then its cranks could go on one by one."""

CONSERVING = ("andrews", "bricard", "closed_chain", "hooke_ladder", "ladder", "n_four_bar", "pinned_chain")
"""Examples with loops without anything that drives or damps."""

ON_THE_WAY = ("closed_chain", "pinned_chain", "planar_3rrr")
"""Examples whose choice of dependents loses rank within a second; they go on with a second one."""


def test_a01_pendulum(made: Callable[..., Made]) -> None:
    solver = made(parsed, PENDULUM).solver
    t = np.array([0.0, *A01])
    found = solver.simulate(t, sensitivities=("g", "L"), **TIGHT)
    expected = np.array(list(A01.values()))
    np.testing.assert_allclose(found.outputs[1:, :2], expected, rtol=0, atol=1e-10)
    for time, (*by_g, dx, dy) in A01_ALONG.items():
        row = int(np.flatnonzero(t == time)[0])
        np.testing.assert_allclose(found.doutputs[:, row, :2], [by_g, [dx, dy]], rtol=1e-9, atol=1e-9)
    assert solver.simulate(10.0).energy_drift < 1e-8


@pytest.mark.campaign
def test_a01_pendulum_for_2000_seconds(made: Callable[..., Made]) -> None:
    solver = made(parsed, PENDULUM).solver
    found = solver.simulate([0.0, 100.0, 1000.0, 2000.0], **TIGHT)
    expected = [-0.18151335142703138, 0.68323018855231485, 0.81460306858903215]
    np.testing.assert_allclose(found["x"][1:], expected, rtol=0, atol=1e-7)


def test_a02_until_it_is_flat(made: Callable[..., Made]) -> None:
    """Up to 0.7 s, 14 ms before the flat pose, against the single pendulum that it is, in the same equation."""
    solver = made(example, "n_four_bar").solver
    found = solver.simulate(0.7, **TIGHT)
    # phi'' = c sin phi with c = (g/L)((N + 1)/2 + N)/((N + 1)/3 + N), phi from the upright
    angle, speed = found["q.crank_0"][-1], found["u.crank_0"][-1]
    c = 9.81 * 3.5 / 3
    assert speed**2 == pytest.approx(1 + 2 * c * (1 - np.cos(angle)), rel=1e-11)
    np.testing.assert_allclose(found["x"], np.sin(found["q.crank_0"]), atol=1e-12)
    np.testing.assert_allclose(found["q.crank_2"], found["q.crank_0"], atol=1e-9)
    assert found.energy_drift < 1e-10 and found.closure_drift < 1e-12


def test_a02_through_the_flat_pose(made: Callable[..., Made]) -> None:
    """State and exact sensitivities at 1 s; at 0.714 s the loops have lost rank."""
    solver = made(example, "n_four_bar").solver
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = solver.simulate([0.0, 1.0], sensitivities=tuple(A02_ALONG), **TIGHT)
    assert found.t[-1] == 1.0
    np.testing.assert_allclose(found.outputs[-1, :4], A02[1.0], rtol=0, atol=1e-8)
    for i, by in enumerate(A02_ALONG.values()):
        np.testing.assert_allclose(found.doutputs[i, -1, :4], by, rtol=1e-6, atol=1e-6)


@pytest.mark.campaign
def test_a02_for_ten_seconds(made: Callable[..., Made]) -> None:
    solver = made(example, "n_four_bar").solver
    found = solver.simulate([0.0, *A02], **TIGHT)
    np.testing.assert_allclose(found.outputs[1:, :4], list(A02.values()), rtol=0, atol=1e-7)


@pytest.mark.campaign
@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_forty_four_bars_for_twenty_seconds(made: Callable[..., Made], method: str) -> None:
    """Rounding of angles of several turns leaves 1.4e-13 of the conditions of 40 loops, next to flat poses."""
    text = (EXAMPLES / "n_four_bar.yaml").read_text().replace("{N: 2}", "{N: 40}")
    found = made(parsed, text).solver.simulate(20.0, method=method, **TIGHT)
    assert found.ended == "finished"
    exact = four_bars.PROBLEMS[-1].exact()
    np.testing.assert_allclose(found.outputs[-1, :2], exact, rtol=0, atol=1e-7)


@pytest.mark.campaign
@pytest.mark.parametrize("name", sorted(f.stem for f in EXAMPLES.glob("*.yaml")))
def test_examples_for_a_second(made: Callable[..., Made], name: str) -> None:
    options = {"partitions": 2} if name in ON_THE_WAY else {}
    found = made(example, name, **options).solver.simulate(1.0)
    assert found.ended == "finished"
    assert all(np.isfinite(x).all() for x in (found.q, found.u, found.outputs))
    if found.closure is not None:
        assert found.closure_drift < 1e-10


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "partitions"),
    [
        ("andrews", 1), ("bricard", 1), ("closed_chain", 4), ("coupler", 1), ("double_wishbone", 1), ("excavator", 1),
        ("four_bar", 1), ("hooke_ladder", 2), ("ladder", 1), ("n_four_bar", 1), ("pinned_chain", 4), ("planar_3rrr", 2),
        ("screw_jack", 1), ("slider_crank", 1), ("stewart", 1), ("valve_train", 1),
    ],
)  # fmt: skip
def test_loops_stay_closed_for_a_minute(made: Callable[..., Made], name: str, partitions: int) -> None:
    """Andrews' without its motor, which drives it to 120 000 turns a second in a minute, 30 steps each."""
    solver = made(example, name, partitions=partitions).solver
    p = solver.parameters.copy()
    if name == "andrews":
        p[solver.parameter_names.index("motor")] = 0.0
    found = solver.simulate(60.0, p=p, on_failure="return")
    assert found.closure_drift < 1e-10
    assert found.ended == "finished"
    if name in CONSERVING:
        assert found.energy_drift < 1e-6


def test_no_step_is_taken_because_its_estimated_error_is_small_by_chance(made: Callable[..., Made]) -> None:
    """Before, single steps of twice the usual size changed the energy by 1.6e-6; usual steps change it by 3e-8."""
    solver = made(example, "andrews").solver
    found = solver.simulate(6.0, p={"motor": 0.0}, rtol=1e-8, atol=1e-8)
    assert np.abs(np.diff(found.energy.sum(axis=1))).max() < 1e-7


@pytest.mark.campaign
def test_a_hooke_ladder_through_the_pose_where_its_rungs_lie_along_the_rails(made: Callable[..., Made]) -> None:
    """At 12.773 s: lean and tilt of the first rung, which begin as independents, are no coordinates there; those of a rail are.

    The rungs point along x, and any roll of the rails would fit. The motion is compared with itself run backwards from behind
    the pose, which stops at another state if the branch, or anything else, was another one.
    """
    solver = made(example, "hooke_ladder", partitions=2).solver
    tight = {"rtol": 1e-11, "atol": 1e-11}
    there = solver.simulate([0.0, 12.5, 12.75, 12.8, 13.0], **tight)
    assert there.stats["partitions_changed"] >= 1
    back = solver.simulate([0.0, 0.2, 0.25, 0.5], q=there.q[-1], u=-there.u[-1], **tight)
    assert back.stats["partitions_changed"] >= 1
    np.testing.assert_allclose(back.q[[3, 2, 1]], there.q[1:4], rtol=0, atol=1e-6)
    near = solver.simulate(np.linspace(12.6, 12.9, 3001), *(x[-1] for x in _until(solver, 12.6, tight)), **tight)
    assert near["top_x"].max() > 1 - 1e-7  # m, of the tip of a rung of 1 m
    assert near.energy_drift < 1e-9 and near.closure_drift < 1e-12


def _until(solver: Any, t: float, options: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    found = solver.simulate([0.0, t], **options)
    return found.q, found.u


def test_loops_stay_closed(four_bar: Any) -> None:
    found = four_bar.simulate(20.0)
    assert found.closure_drift < 1e-12
    free = four_bar.parameters.copy()
    free[four_bar.parameter_names.index("friction")] = 0.0
    assert four_bar.simulate(20.0, p=free).energy_drift < 1e-7
