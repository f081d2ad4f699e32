"""Poses where loops lose rank: the N-four-bar A02 of the IFToMM library through the pose where all its links are in line.

Its motion is that of one pendulum, phi'' = c sin phi from the upright, so everything is known in closed form; numbers are
those of Jacobi's functions in 40 digits.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import EXAMPLES, Made, example, parsed

from codegen.runtime import At, Event, Final, Integral, LeastSquares, SimulationError

FLAT = (0.714355529292960472, 1.228159393314123211, 2.656870451900044156, 3.170674315921206895)
"""When A02 of N = 2 is flat, s."""

C = 9.81 * 3.5 / 3
SPEED = np.sqrt(1 + 2 * C)
"""Of all cranks when it is flat first, rad/s."""

AT_TEN = 0.32845811154081538
"""x of B0 at 10 s, N = 2."""

AT_TWENTY = 0.41090115376294522
"""x of B0 at 20 s, N = 40."""


def turned(count: int, angles: tuple[float, float, float]) -> str:
    """A02 with the given number of loops; its plane is rotated about z, x and z by angles, rad."""
    text = (EXAMPLES / "n_four_bar.yaml").read_text(encoding="utf-8").replace("{N: 2}", f"{{N: {count}}}")
    (ca, cb, cc), (sa, sb, sc) = np.cos(angles), np.sin(angles)
    about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]])
    R = about_z @ about_x @ np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    x, y = (", ".join(repr(float(e)) for e in R[:, i]) for i in (0, 1))
    a, b, c = angles
    rotate = f"rotate: [{{axis: z, angle: {a!r}}}, {{axis: x, angle: {b!r}}}, {{axis: z, angle: {c!r}}}]"
    along = ", ".join(f"{float(e)!r}*k*length" for e in R[:, 0])
    for old, new in (
        ("joint: {type: revolute, axis: -z}\n    shape: {type: rod, axis: y, length: length, mass: mass_crank",
         f"joint: {{type: revolute, axis: -z, {rotate}}}\n    shape: {{type: rod, axis: y, length: length, mass: mass_crank"),
        ("at: [k*length, 0, 0]}", f"at: [{along}], {rotate}}}"),
        ("gravity: [0, -g, 0]", f"gravity: [{', '.join(f'{-float(e)!r}*g' for e in R[:, 1])}]"),
    ):  # fmt: skip
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text.replace("axis: x}\n  y", f"axis: [{x}]}}\n  y").replace("axis: y}\n  vx", f"axis: [{y}]}}\n  vx")


def cranks(found: Any, row: int) -> np.ndarray:
    """Speeds of cranks and, with the other sign, of couplers."""
    return np.array(
        [found[f"u.{n}"][row] for n in ("crank_0", "crank_1", "crank_2")]
        + [-found[f"u.coupler_{k}"][row] for k in (1, 2)]
    )


@pytest.fixture(scope="module")
def flat(made: Callable[..., Made]) -> Any:
    return made(example, "n_four_bar").solver


def test_no_tolerance_ends_on_another_branch(flat: Any) -> None:
    """Errors at 10 s, after ten passages, follow the tolerance down to 1e-13."""
    for tolerance in np.logspace(-5, -13, 33):
        found = flat.simulate([0.0, 10.0], rtol=tolerance, atol=tolerance)
        # a step of more than a radian may be off by a hundred times what it is allowed, here or in any pendulum
        assert abs(found["x"][-1] - AT_TEN) < 1e4 * tolerance, tolerance
        np.testing.assert_allclose(cranks(found, -1), found["u.crank_0"][-1], rtol=0, atol=1e-9)
        assert found.stats["evaluations"] < 6000, tolerance
    assert abs(flat.simulate([0.0, 10.0], rtol=1e-12, atol=1e-12)["x"][-1] - AT_TEN) < 1e-9


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
def test_an_event_at_the_pose(flat: Any, tolerance: float) -> None:
    """The tip passes the height of the pivots as all links are in one line."""
    found = flat.simulate(3.3, events=Event("y", 0.0, stop=False), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose([e.t for e in found.events], FLAT, rtol=0, atol=100 * tolerance)
    first = found.events[0]
    np.testing.assert_allclose(np.abs(first.u), SPEED, rtol=0, atol=50 * tolerance)
    assert first.rates[flat.output_names.index("y")] == pytest.approx(-SPEED, abs=2e-8 + 50 * tolerance)
    assert first.outputs[0] == pytest.approx(1.0, abs=1e-10)
    (last,) = flat.simulate(3.3, events="y", sensitivities=("g", "v0"), rtol=tolerance, atol=tolerance).events
    assert last.t == pytest.approx(FLAT[0], abs=50 * tolerance)
    # speed^2 = v0^2 + 2 c cos, at the pose for any g and v0
    np.testing.assert_allclose(last.du[:, 0], [C / 9.81 / SPEED, 1 / SPEED], rtol=0, atol=1e-7 + 3e3 * tolerance)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
def test_results_at_the_pose(flat: Any, tolerance: float) -> None:
    """As a time among others, and as the last one."""
    for times in ([0.0, FLAT[0], 1.0], [0.0, FLAT[0]], FLAT[0]):
        found = flat.simulate(times, rtol=tolerance, atol=tolerance)
        at = int(np.flatnonzero(found.t == FLAT[0])[0])
        np.testing.assert_allclose(cranks(found, at), SPEED, rtol=0, atol=50 * tolerance)
        np.testing.assert_allclose(np.abs(found.q[at]), np.pi / 2, rtol=0, atol=50 * tolerance)
        assert found.ended == "finished"
    assert found.t[-1] == FLAT[0]


def test_results_at_the_pose_and_beside_it_follow_every_tolerance(flat: Any) -> None:
    """Where rounding times the square of the condition is more than what is allowed, they are those of the steps beside."""
    for tolerance in np.logspace(-5.5, -12.5, 57):
        for times in ([0.0, FLAT[0], 1.0], [0.0, FLAT[0]]):
            found = flat.simulate(times, rtol=tolerance, atol=tolerance)
            np.testing.assert_allclose(cranks(found, 1), SPEED, rtol=0, atol=50 * tolerance, err_msg=f"{tolerance:.2g}")
        for apart in (-1e-4, -1e-6, -1e-7, -1e-9, 1e-10, 1e-8, 1e-5):
            for times in ([0.0, FLAT[0] + apart, 1.0], [0.0, FLAT[0] + apart]):
                found = flat.simulate(times, rtol=tolerance, atol=tolerance)
                assert np.ptp(cranks(found, 1)) < 50 * tolerance, (tolerance, apart)


@pytest.mark.parametrize("parts", [50, 100, 150])
def test_constant_steps_that_meet_the_pose(flat: Any, parts: int) -> None:
    """One step is shorter, so that no stage is at the pose."""
    at_one = -0.19502030194943509
    h = FLAT[0] / parts
    found = flat.simulate(1.0, method="rk4", step=h, events=Event("y", stop=False))
    assert found["x"][-1] == pytest.approx(at_one, abs=6 * h**4)
    assert [e.t for e in found.events] == pytest.approx(FLAT[:1], abs=h**4)
    sizes = np.diff(found.t[:-1])
    assert np.sum(np.abs(sizes - h) > 1e-9) <= 3


@pytest.mark.parametrize("names", [("g",), ("g", "length", "v0"), ("g", "length", "v0", "mass", "mass_crank")])
def test_derivatives_of_any_number_pass(flat: Any, names: tuple[str, ...]) -> None:
    """In one, four and eight lanes: by g, length and v0, of x at 1 s."""
    by = {"g": -0.23757424003880486, "length": 4.15105444015104734, "v0": -2.01547144731980680}
    found = flat.simulate([0.0, 1.0], sensitivities=names, rtol=1e-12, atol=1e-12)
    assert found.stats["condition"] > 20
    for n in set(names) & set(by):
        assert found.doutputs[names.index(n), -1, 0] == pytest.approx(by[n], rel=1e-7)


def test_radau_passes_too(flat: Any) -> None:
    found = flat.simulate([0.0, 10.0], method="radau", rtol=1e-10, atol=1e-10)
    assert abs(found["x"][-1] - AT_TEN) < 1e-6


@pytest.fixture(scope="module", params=["bearings", "off by rounding"])
def inexact(made: Callable[..., Made], request: pytest.FixtureRequest) -> Any:
    """A02 askew in the world by the angles of seed 1 below; A02 whose bearings are off by two last places."""
    if request.param == "bearings":
        angles = tuple(float(a) for a in np.random.default_rng(1).uniform(-3, 3, 3))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return made(parsed, turned(2, angles)).solver
    text = (EXAMPLES / "n_four_bar.yaml").read_text(encoding="utf-8")
    assert text.count("at: [k*length, 0, 0]") == 1
    return made(parsed, text.replace("at: [k*length, 0, 0]", "at: [1.0000000000000004*k*length, 0, 0]")).solver


def test_no_tolerance_collapses_askew_or_off_by_rounding(inexact: Any) -> None:
    """Through ten poses, on the right branch, with errors that follow the tolerance as far as the lengths do."""
    for tolerance in np.logspace(-5, -13, 17):
        found = inexact.simulate([0.0, 10.0], rtol=tolerance, atol=tolerance)
        assert abs(found["x"][-1] - AT_TEN) < 1e-7 + 1e4 * tolerance, tolerance
        np.testing.assert_allclose(cranks(found, -1), found["u.crank_0"][-1], rtol=0, atol=1e-8)
        assert found.stats["evaluations"] < 6000, tolerance
    found = inexact.simulate([0.0, 10.0], rtol=1e-12, atol=1e-12)
    assert abs(found["x"][-1] - AT_TEN) < 1e-8


def test_a_motion_that_stands_still_ends(made: Callable[..., Made]) -> None:
    """At a force that would jump back and forth; a million small steps, which are allowed, would not come far."""
    text = """
model: sliding
bodies:
  mass: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
forces:
  rub: {type: joint, joint: mass, value: -1000*sign(u.mass) + 1e-3*sin(1e9*q.mass)}
initial: {u: {mass: 1.0}}
"""
    solver = made(parsed, text).solver
    with pytest.raises(
        SimulationError,
        match=r"t = 0\.001 s: where sign\(u.mass\) in forces.rub.value changes its branch, .* it sticks or slides",
    ) as caught:
        solver.simulate(1e3, rtol=1e-12, atol=1e-12)
    assert caught.value.trajectory.stats["steps"] < 100_000


@pytest.mark.parametrize(
    ("integrator", "tolerance"),
    [("dop853", 1e-6), ("dop853", 1e-12), ("radau", 1e-8), ("radau", 1e-12), ("rk4", None)],
)
def test_gradients_do_not_depend_on_memory(flat: Any, integrator: str, tolerance: float | None) -> None:
    """Steps near poses are made again digit by digit: rounding there is larger than what gradients are allowed to be off."""
    wanted = [Final("x"), LeastSquares([0.5, 1.1, 2.3], {"y": [0.1, 0.2, 0.3]})]
    options: dict[str, Any] = {"step": 0.004} if tolerance is None else {"rtol": tolerance, "atol": tolerance}
    options |= {"wrt": flat.parameter_names, "method": "adjoint", "integrator": integrator}
    kept = flat.judge(3.0, wanted, **options)
    again = flat.judge(3.0, wanted, memory=20_000, **options)
    np.testing.assert_array_equal(again.gradients, kept.gradients)


def ways_differ(solver: Any, end: float, **options: Any) -> float:
    """Differences of gradients forward and by the adjoint on the same steps, relative to the largest entry of each."""
    first, second = solver.output_names[:2]
    wanted = [Final(first), Final(second), Integral("kinetic"), At(first, 0.37 * end)]
    wrt = [*solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names)]
    wrt += [f"u0.{n}" for n in solver.independent_speed_names]
    forward, adjoint = (solver.judge(end, wanted, wrt=wrt, method=m, **options) for m in ("forward", "adjoint"))
    assert forward.counts["steps"] == adjoint.counts["steps"]
    assert forward.counts["condition"] > 50  # so it has been near a pose: stages that are nearer are made again
    np.testing.assert_array_equal(forward.values, adjoint.values)
    size = np.abs(forward.gradients).max(axis=1)
    return float((np.abs(forward.gradients - adjoint.gradients).max(axis=1) / size).max())


def ladder(made: Callable[..., Made], count: int) -> Any:
    """A flat ladder with the given number of loops."""
    text = (EXAMPLES / "ladder.yaml").read_text(encoding="utf-8")
    assert text.count("L: 3,") == 1
    return made(parsed, text.replace("L: 3,", f"L: {count},")).solver


WAYS: list[dict[str, Any]] = [
    *({"integrator": "dop853", "rtol": x, "atol": x} for x in (1e-8, 1e-9, 1e-10, 1e-11, 1e-12)),
    *({"integrator": "radau", "rtol": x, "atol": x} for x in (1e-8, 1e-10, 1e-12)),
    *({"integrator": "rk4", "step": x} for x in (0.01, 0.005)),
]


@pytest.mark.parametrize("options", [WAYS[0], WAYS[4], WAYS[5], WAYS[6], WAYS[8]], ids=str)
def test_forward_is_adjoint(made: Callable[..., Made], flat: Any, options: dict[str, Any]) -> None:
    """To 1e-11 on the same steps; in double both ways were off by up to 3e-4 of each other here."""
    for solver in (flat, ladder(made, 2)):
        assert ways_differ(solver, 3.0, **options) < 1e-11


@pytest.mark.parametrize("options", [{"integrator": "rk4", "step": 0.004}, {"rtol": 1e-8, "atol": 1e-8}], ids=str)
def test_gradients_of_one_functional_and_of_nine(flat: Any, options: dict[str, Any]) -> None:
    """In single lanes, in eight, and with times between the steps, whose stages are made again."""
    wanted = [LeastSquares([0.5, 1.1, t], {"y": [0.1, 0.2, 0.3]}) for t in np.linspace(1.2, 2.8, 9)]
    both = [flat.judge(3.0, wanted, wrt=flat.parameter_names, method=m, **options) for m in ("forward", "adjoint")]
    size = np.abs(both[0].gradients).max(axis=1, keepdims=True)
    assert (np.abs(both[0].gradients - both[1].gradients) < 1e-11 * size).all()
    alone = flat.judge(3.0, wanted[4], wrt=flat.parameter_names, method="adjoint", **options)
    assert (np.abs(alone.gradients[0] - both[0].gradients[4]) < 1e-11 * size[4]).all()


@pytest.mark.campaign
@pytest.mark.parametrize("end", [3.0, 10.0])
@pytest.mark.parametrize("loops", [0, 1, 2, 5])
def test_forward_is_adjoint_by_every_integrator(made: Callable[..., Made], flat: Any, loops: int, end: float) -> None:
    """The N-four-bar of N = 2 and ladders."""
    solver = ladder(made, loops) if loops else flat
    found = {str(options): ways_differ(solver, end, **options) for options in WAYS}
    assert max(found.values()) < 1e-11, found


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("count", "end", "expected"), [(2, 10.0, AT_TEN), (40, 20.0, AT_TWENTY)])
def test_in_random_orientations(made: Callable[..., Made], count: int, end: float, expected: float, seed: int) -> None:
    """1e-8 in x at a tolerance of 1e-12; at others no branch but the right one."""
    angles = tuple(float(a) for a in np.random.default_rng(seed).uniform(-3, 3, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solver = made(parsed, turned(count, angles)).solver
    assert abs(solver.simulate([0.0, end], rtol=1e-12, atol=1e-12)["x"][-1] - expected) < 1e-8
    for tolerance in np.logspace(-5, -13, 17):
        found = solver.simulate([0.0, end], rtol=tolerance, atol=tolerance)
        assert abs(found["x"][-1] - expected) < 1e-8 + (1e4 if count == 2 else 5e4) * tolerance, tolerance
