"""Events of a falling stone, against closed forms, and of a linkage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, example

from codegen.runtime import AtEvent, Event

G, H = 9.81, 2.0
LANDS = np.sqrt(2 * H / G)
RK4 = {"method": "rk4", "step": 0.3}  # exact for a parabola


def passed(level: float, stop: bool = False, direction: str = "both") -> Event:
    return Event("z", level, direction, stop)


@pytest.mark.parametrize("options", [{}, RK4], ids=["dop853", "rk4"])
def test_a_stone_lands(falling: Any, options: dict[str, Any]) -> None:
    found = falling.simulate(3.0, sensitivities=("g", "h", "v", "q0.stone", "inputs.push"), events="z", **options)
    (landed,) = found.events
    assert found.ended == "event" and found.t[-1] == landed.t
    assert landed.t == pytest.approx(LANDS, rel=1e-14)
    # t* = sqrt(2 h/g); v and push at zero: h + v t - (g - push/m) t^2/2 = 0
    by_g, by_h, by_v, by_push = -LANDS / (2 * G), 1 / (G * LANDS), 1 / G, LANDS / (2 * G)
    np.testing.assert_allclose(landed.dt, [by_g, by_h, by_v, by_h, by_push], rtol=1e-12)
    assert np.abs(landed.dq).max() < 1e-13
    # w* = -sqrt(2 g h)
    np.testing.assert_allclose(landed.u, [-np.sqrt(2 * G * H)], rtol=1e-14)
    np.testing.assert_allclose(landed.du[:2, 0], [-np.sqrt(H / (2 * G)), -np.sqrt(G / (2 * H))], rtol=1e-12)
    np.testing.assert_allclose(landed.outputs[:2], [0.0, landed.u[0]], atol=1e-14)
    np.testing.assert_allclose(landed.rates[:2], [landed.u[0], -G], rtol=1e-14)
    assert repr(landed).startswith("<z = 0 at t = 0.638550857 s>")


def test_directions(falling: Any) -> None:
    """Thrown up with 5 m/s it passes 2.5 m twice."""
    a, b = (5 - np.sqrt(25 - G)) / G, (5 + np.sqrt(25 - G)) / G
    for direction, times in {"up": [a], "down": [b], "both": [a, b]}.items():
        found = falling.simulate(1.2, u=[5.0], events=passed(2.5, direction=direction), largest_step=0.2)
        assert found.ended == "finished"
        np.testing.assert_allclose([e.t for e in found.events], times, rtol=1e-13)
        found = falling.simulate(1.2, u=[5.0], events=passed(2.5, True, direction), largest_step=0.2)
        assert found.events[0].t == pytest.approx(times[0], rel=1e-13)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 5.0}], ids=["dop853", "rk4"])
def test_several_in_one_step(falling: Any, options: dict[str, Any]) -> None:
    levels = np.linspace(1.9, -40, 23)
    found = falling.simulate(3.0, sensitivities="h", events=[passed(x) for x in levels[::-1]], **options)
    times = np.sqrt(2 * (H - levels) / G)
    np.testing.assert_allclose([e.t for e in found.events], times, rtol=1e-12)
    assert [e.event.level for e in found.events] == list(levels)
    np.testing.assert_allclose([e.dt[0] for e in found.events], 1 / (G * times), rtol=1e-10)
    np.testing.assert_allclose(found["z"][-1], H - G * 9 / 2, rtol=1e-12)


def test_events_at_the_same_time_are_all_seen(falling: Any) -> None:
    events = [
        passed(1.0),
        passed(1.0, direction="down"),
        passed(1.0 + 1e-16),
        passed(np.nextafter(1.0, 2)),
        Event("cube"),
    ]
    found = falling.simulate(1.0, events=[*events[:4], Event("cube", stop=False)])
    assert sorted(str(e.event) for e in found.events) == sorted(map(str, [*events[:4], Event("cube", stop=False)]))
    assert np.ptp([e.t for e in found.events]) < 1e-5  # cube is flat there, (z - 1)^3 is rounding within 1e-5
    stopped = falling.simulate(1.0, events=[passed(1.0), passed(1.0, True)])
    assert len(stopped.events) == 2 and stopped.ended == "event"


def test_more_events_than_there_is_room_for_at_once(falling: Any) -> None:
    found = falling.simulate(1.0, events=[passed(1.5)] * 300)
    assert len(found.events) == 300
    levels = np.linspace(1.9, -2, 400)
    found = falling.simulate(1.0, events=[passed(x) for x in levels])
    assert [e.event.level for e in found.events] == list(levels)


def test_at_the_very_start(falling: Any) -> None:
    """An output that begins on its level does not cross it; it does when it comes back."""
    away = falling.simulate(0.5, q=[0.0], u=[-1.0], events=passed(0.0))
    assert away.ended == "finished" and not away.events
    back = falling.simulate(5.0, q=[0.0], u=[1.0], events="z")
    np.testing.assert_allclose([e.t for e in back.events], [2 / G], rtol=1e-12)


@pytest.mark.parametrize("ulps", range(-4, 5))
@pytest.mark.parametrize("options", [{}, RK4], ids=["dop853", "rk4"])
def test_at_the_very_end(falling: Any, ulps: int, options: dict[str, Any]) -> None:
    """Whether it is seen is a matter of rounding; that the motion comes to its end is not."""
    end = LANDS + ulps * np.spacing(LANDS)
    found = falling.simulate(end, events=passed(0.0), **options)
    assert found.ended == "finished" and found.t[-1] == end
    for e in found.events:
        assert e.t == pytest.approx(end, rel=1e-14)
    found = falling.simulate([0.0, 0.1, end], events=passed(0.0), **options)
    assert len(found) == 3


def test_inputs_that_change_where_an_event_is(falling: Any) -> None:
    """The push begins as the stone passes a level, to rounding: the rates there are those behind the change."""
    for ulps in range(-3, 4):
        changes = LANDS + ulps * np.spacing(LANDS)
        inputs = ([0.0, changes], [0.0, 20.0], "hold")
        found = falling.simulate([0.0, 1.0], inputs=inputs, events=passed(0.0))
        rest = 1.0 - LANDS
        expected = -np.sqrt(2 * G * H) * rest + (20 - G) * rest**2 / 2
        assert found["z"][-1] == pytest.approx(expected, abs=1e-12)


def test_an_output_that_only_touches_its_level_has_no_derivative(falling: Any) -> None:
    (touched,) = falling.simulate(1.0, sensitivities=("g", "h"), events="cube").events
    assert touched.t == pytest.approx(np.sqrt(2 / G), abs=1e-4)
    assert np.isnan(touched.dt).all() and np.isnan(touched.dq).all()
    for method in ("forward", "adjoint"):
        judged = falling.judge(1.0, AtEvent("t", Event("cube")), wrt=("g", "h"), method=method)
        assert np.isnan(judged.gradients).all(), method
        assert np.isfinite(judged.values).all()


def test_what_grazing_is_has_no_unit(falling: Any) -> None:
    """An output of tiny numbers among large ones crosses its level all the same."""
    (crossed,) = falling.simulate(1.0, sensitivities=("h",), events=Event("tiny", 1e-12)).events
    assert crossed.t == pytest.approx(np.sqrt(2 / G), rel=1e-12)
    assert crossed.dt[0] == pytest.approx(1 / (G * crossed.t), rel=1e-10)
    assert crossed.pace == pytest.approx(1e-12 * np.ptp([H, crossed.outputs[0]]), rel=10)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 1.5}], ids=["dop853", "rk4"])
@pytest.mark.parametrize("below", [0.5, 0.2, 1e-2, 1e-4, 1e-6, 1e-8])
def test_two_crossings_within_a_step(falling: Any, below: float, options: dict[str, Any]) -> None:
    """A stone thrown up passes a level near its highest point twice; the whole flight is a step or two."""
    top, at = H + 25 / (2 * G), 5 / G
    apart = np.sqrt(2 * below / G)
    events = [passed(top - below), passed(top - below, direction="up"), passed(top - below, direction="down")]
    found = falling.simulate(1.5, u=[5.0], events=events, **options)
    times = {e: [x.t for x in found.events if x.event == e] for e in events}
    tolerance = 1e-13 + 1e-15 / apart
    np.testing.assert_allclose(times[events[0]], [at - apart, at + apart], rtol=0, atol=tolerance)
    np.testing.assert_allclose(times[events[1]], [at - apart], rtol=0, atol=tolerance)
    np.testing.assert_allclose(times[events[2]], [at + apart], rtol=0, atol=tolerance)
    assert not falling.simulate(1.5, u=[5.0], events=passed(top + below), **options).events
    assert found.stats["steps"] < 30


def test_two_crossings_that_only_the_interpolant_shows(four_bar: Any) -> None:
    """Levels just within the range of a curve: each turn of it passes them twice, within a step."""
    t = np.linspace(0, 4, 40001)
    z = four_bar.simulate(t, inputs=[0.2])["trace_z"]
    turns = [i for i in range(1, len(z) - 1) if (z[i] - z[i - 1]) * (z[i + 1] - z[i]) < 0]
    assert len(turns) > 4
    seen = there = 0
    for i in turns:
        top = z[i] > z[i - 1]
        for depth in (1e-3, 1e-5, 1e-7):
            level = float(z[i] - depth if top else z[i] + depth)
            found = four_bar.simulate(4.0, inputs=[0.2], events=Event("trace_z", level, stop=False))
            seen += len(found.events)
            there += len(np.flatnonzero(np.diff(np.sign(z - level))))
    assert seen == there


def test_an_event_that_does_not_come(falling: Any) -> None:
    with pytest.warns(RuntimeWarning, match=r"the event z = -5 did not occur by t = 1 s; the motion was not stopped"):
        found = falling.simulate(1.0, events=passed(-5.0, True))
    assert found.ended == "finished"


def test_input_that_depends_on_time_is_part_of_the_rate(falling: Any) -> None:
    """The push itself crosses a level: it rises with 4 N/s, times[1] moves the crossing."""
    inputs = ([0.0, 1.0], [0.0, 4.0], "linear")
    names = ("inputs.push[0]", "inputs.push[1]", "inputs.push")
    (crossed,) = falling.simulate(1.0, inputs=inputs, sensitivities=names, events=Event("force", 1.0)).events
    assert crossed.t == pytest.approx(0.25, rel=1e-13)
    np.testing.assert_allclose(crossed.dt, [-0.75 / 4, -0.25 / 4, -1 / 4], rtol=1e-12)


def test_a_linkage_passes_levels(four_bar: Any) -> None:
    """Times and their derivatives against motions of other parameters, at tight tolerances."""
    event = Event("trace_z", 0.35, stop=False)
    tight = {"rtol": 1e-12, "atol": 1e-12}
    wrt = ("crank_length", "base", "coupler_mass", "u0.crank", "inputs.motor")
    found = four_bar.simulate(4.0, inputs=[0.3], sensitivities=wrt, events=event, **tight)
    assert len(found.events) > 4
    for e in found.events:
        assert e.outputs[four_bar.output_names.index("trace_z")] == pytest.approx(0.35, abs=1e-13)
        assert np.abs(four_bar.closure(e.q, e.u)[0]).max() < 1e-12
    step = 1e-5
    for i, name in enumerate(wrt):
        times = []
        for sign in (1, -1):
            p, u, inputs = four_bar.parameters.copy(), {"crank": 3.0}, [0.3]
            if name in four_bar.parameter_names:
                p[four_bar.parameter_names.index(name)] += sign * step
            elif name == "inputs.motor":
                inputs = [0.3 + sign * step]
            else:
                u = {"crank": 3.0 + sign * step}
            times.append([e.t for e in four_bar.simulate(4.0, None, u, p, inputs, events=event, **tight).events])
        expected = (np.array(times[0]) - times[1]) / (2 * step)
        np.testing.assert_allclose([e.dt[i] for e in found.events], expected, rtol=1e-4, atol=1e-6)


def test_levels_of_a_motion_are_those_of_its_samples(made: Callable[..., Made], four_bar: Any) -> None:
    """As many crossings as sign changes between dense samples."""
    t = np.linspace(0, 6, 4001)
    z = four_bar.simulate(t, inputs=[0.2])["trace_x"]
    events = [Event("trace_x", x, stop=False) for x in (0.1, 0.3, 0.5, 0.7)]
    found = four_bar.simulate(6.0, inputs=[0.2], events=events)
    for event in events:
        times = np.array([e.t for e in found.events if e.event == event])
        i = np.flatnonzero(np.diff(np.sign(z - event.level)))
        assert len(times) == len(i)
        assert ((t[i] <= times) & (times <= t[i + 1])).all()
    assert (np.diff([e.t for e in found.events]) >= 0).all()


def test_an_event_where_independents_change_is_seen_once(made: Callable[..., Made]) -> None:
    """The motion goes on with other independents right behind it, from a state that is on the level to rounding."""
    solver = made(example, "n_four_bar", partitions=2).solver
    y = solver.simulate(np.linspace(0, 3, 3001))["y"]
    for level in (0.01, 0.05, 0.1):
        found = solver.simulate(
            3.0, events=Event("y", level, stop=False), largest_step=0.01
        )  # some end near flat poses
        assert found.stats["partitions_changed"] >= 1
        assert len(found.events) == len(np.flatnonzero(np.diff(np.sign(y - level))))
        assert (np.diff([e.t for e in found.events]) > 0.1).all()


HELD = ([0.0, 0.5, 1.0], [[0.0], [5.0], [5.0]], "hold")


@pytest.mark.parametrize("options", [{}, RK4, {"method": "radau"}], ids=["dop853", "rk4", "radau"])
def test_an_event_with_the_jump_of_an_input_comes_at_its_knot(falling: Any, options: dict[str, Any]) -> None:
    found = falling.simulate(1.0, inputs=HELD, sensitivities=("g", "h", "v"), events=Event("force", 2.0), **options)
    (met,) = found.events
    assert found.ended == "event" and met.t == 0.5 and not met.dt.any()
    np.testing.assert_allclose(met.q, [H - G / 8], rtol=1e-12)
    np.testing.assert_allclose(met.dq[:, 0], [-1 / 8, 1.0, 0.5], rtol=1e-12)
    np.testing.assert_allclose(met.du[:, 0], [-0.5, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("way", ["forward", "adjoint"])
def test_what_is_measured_at_the_jump_of_an_input(falling: Any, way: str) -> None:
    event = Event("force", 2.0, stop=False)
    wanted = [AtEvent("t", event), AtEvent("z", event), AtEvent("w", event)]
    found = falling.judge(1.0, wanted, inputs=HELD, wrt=("g", "h", "v"), method=way)
    np.testing.assert_allclose(found.values, [0.5, H - G / 8, -G / 2], rtol=1e-12)
    np.testing.assert_allclose(found.gradients, [[0, 0, 0], [-1 / 8, 1.0, 0.5], [-0.5, 0.0, 1.0]], atol=1e-12)


def test_the_last_state_is_that_of_the_event(falling: Any) -> None:
    found = falling.simulate([0.0, 0.2, 0.4, 1.0], events="z")
    assert found.ended == "event" and found.t[-1] == 0.4
    q, u = found.final
    assert found.events[-1].t == pytest.approx(LANDS, rel=1e-14) and found.stats["t"] == found.events[-1].t
    np.testing.assert_allclose([q[0], u[0]], [0.0, -np.sqrt(2 * G * H)], atol=1e-12)
