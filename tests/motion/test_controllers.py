"""Sampled controllers in motions: against the closed form for a constant force, and against inputs given in advance."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, mechanism, parsed

from codegen.runtime import Event, Sample

TIGHT = {"rtol": 1e-12, "atol": 1e-12}

CART = """
model: cart
parameters: {m: 1.5, c: 0.7, unused: {value: 1.0, unit: N/m}}
inputs: [force, wind]
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: m, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  drive: {type: joint, joint: cart, value: force + wind - unused*q.cart}
outputs:
  force: {value: force}
  total: {value: force + 0.1*wind}
"""


@pytest.fixture(scope="module")
def cart(made: Callable[..., Made]) -> Any:
    return made(parsed, CART).solver


def recorded(law: Callable[[Sample], Any], log: list[Any]) -> Callable[[Sample], Any]:
    """The control law, which also appends times and values to a list."""

    def command(sample: Sample) -> Any:
        found = law(sample)
        log.append((sample.t, np.array(found, float).ravel().copy()))
        return found

    return command


def as_inputs(log: list[Any]) -> Any:
    return np.array([t for t, _ in log]), np.array([x for _, x in log]), "hold"


def test_a_held_force_in_closed_form(cart: Any) -> None:
    """x'' = f/m with f = -k x - d v + r f_before held for T: a linear map from sample to sample, differentiated by m, x0, v0."""
    k, d, r, period, n, m = 3.0, 1.1, 0.2, 0.05, 40, 1.5
    gains = {"q": [[-k]], "u": [[-d]], "inputs": [[r]]}
    law = (lambda s: -k * s.q[0] - d * s.u[0] + r * s.inputs[0], lambda s: gains)
    times = period * np.arange(n + 1)
    run = cart.simulate(
        times, {"cart": 1.0}, {"cart": -0.3}, {"unused": 0.0}, {"wind": 0.0}, controller=law, period=period,
        sensitivities=("m", "q0.cart", "u0.cart"),
    )  # fmt: skip
    x, dx = np.array([1.0, -0.3, 0.0]), np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    of_state = np.array([[1, period, 0], [0, 1, 0], [0, 0, 0]])
    of_force = np.array([period**2 / (2 * m), period / m, 1.0])
    by_mass = np.array([-(period**2) / (2 * m**2), -period / m**2, 0.0])
    row = np.array([-k, -d, r])
    for i in range(n + 1):
        np.testing.assert_allclose([run.q[i, 0], run.u[i, 0]], x[:2], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(
            np.stack([run.dq[:, i, 0], run.du[:, i, 0]], axis=1), dx[:, :2], rtol=1e-11, atol=1e-12
        )
        force, dforce = row @ x, dx @ row
        dx = dx @ of_state.T + dforce[:, None] * of_force + np.array([[1.0], [0], [0]]) * (force * by_mass)
        x = of_state @ x + force * of_force


@pytest.mark.parametrize("options", [{}, {"method": "radau"}, {"method": "rk4", "step": 0.004}], ids=str)
def test_equal_to_inputs_held_between_samples(four_bar: Any, options: dict[str, Any]) -> None:
    log: list[Any] = []
    law = recorded(lambda s: -3 * s.q[0] - 0.4 * s.u[0] + 0.05 * s.outputs[0], log)
    times = np.linspace(0.0, 1.0, 37)
    found = four_bar.simulate(times, controller=law, period=0.02, **options)
    assert len(log) == 50 and log[-1][0] == pytest.approx(0.98)
    given = four_bar.simulate(times, inputs=as_inputs(log), **options)
    for name in ("q", "u", "outputs", "energy"):
        assert np.array_equal(getattr(found, name), getattr(given, name))


def test_derivatives_of_a_controlled_loop(four_bar: Any) -> None:
    """Against differences of motions of order 4; a law with a memory of its own gives the same by directions."""
    names = ("crank_length", "coupler_mass", "friction", "q0.crank")
    k, d, o = -3.0, -0.4, 0.05
    times, by = np.linspace(0.0, 0.6, 13), np.zeros(four_bar.noutputs)
    by[0] = o

    def law(s: Sample) -> Any:
        return k * s.q[0] + d * s.u[0] + o * s.outputs[0] + 0.1 * s.inputs[0]

    def jacobian(s: Sample) -> Any:
        return {"q": [k, 0, 0], "u": [d, 0, 0], "outputs": by, "inputs": [0.1]}

    def along(s: Sample) -> Any:
        return (k * s.dq[:, 0] + d * s.du[:, 0] + o * s.doutputs[:, 0])[:, None] + 0.1 * s.dinputs

    options = {"controller": (law, jacobian), "period": 0.01, **TIGHT}
    found = four_bar.simulate(times, sensitivities=names, **options)
    same = four_bar.simulate(times, sensitivities=names, **options | {"controller": (law, along)})
    np.testing.assert_allclose(same.dq, found.dq, rtol=1e-12, atol=1e-13)
    options["controller"] = law
    for i, name in enumerate(names):
        h, moved = 2e-4, []
        for factor in (-2, -1, 1, 2):
            if name == "q0.crank":
                q = found.q[0] + [factor * h, 0, 0]
                q, u = four_bar.assemble(q, found.u[0])
                moved.append(four_bar.simulate(times, q, u, **options))
            else:
                p = {name: found.p[four_bar.parameter_names.index(name)] + factor * h}
                moved.append(four_bar.simulate(times, p=p, **options))
        for part in ("q", "u", "outputs"):
            a, b, c, e = (getattr(run, part) for run in moved)
            expected = (8 * (c - b) - (e - a)) / (12 * h)
            np.testing.assert_allclose(
                getattr(found, "d" + part)[i], expected, atol=1e-8 * max(np.abs(expected).max(), 1)
            )


def test_other_signals_follow_inputs(cart: Any) -> None:
    """With a spline for the other signal, held values are written with the spline's degree."""
    t = np.linspace(0.0, 1.0, 6)
    wind = (t, np.sin(5 * t), "cubic")
    law = (lambda s: {"force": 1.0 - s.u[0]}, lambda s: {"u": [-1.0]})
    log: list[Any] = []
    times = np.linspace(0.0, 1.0, 23)
    found = cart.simulate(times, inputs={"wind": wind}, controller=law, period=0.13, sensitivities="m", **TIGHT)
    cart.simulate(times, inputs={"wind": wind}, controller=recorded(lambda s: 1.0 - s.u[0], log), period=0.13, **TIGHT)
    at, values, _ = as_inputs(log)
    given = cart.simulate(times, inputs={"wind": wind, "force": (at, values[:, 0], "hold")}, **TIGHT)
    np.testing.assert_allclose(found.q, given.q, rtol=1e-11, atol=1e-13)
    more, less = (
        cart.simulate(times, p={"m": m}, inputs={"wind": wind}, controller=law[0], period=0.13, **TIGHT)
        for m in (1.5 + 1e-5, 1.5 - 1e-5)
    )
    np.testing.assert_allclose(found.dq[0], (more.q - less.q) / 2e-5, atol=1e-8)


def test_an_output_jumps_over_its_level_at_a_sample(cart: Any) -> None:
    law = (lambda s: 0.0 if s.t < 0.45 else 5.0, lambda s: {})
    event = Event("total", 1.0, stop=False)
    found = cart.simulate(1.0, inputs={"wind": 0.0}, controller=law, period=0.1, events=event, sensitivities="m")
    assert [e.t for e in found.events] == pytest.approx([0.5]) and found.events[0].dt[0] == 0.0


def test_other_independent_coordinates_during_the_motion(made: Callable[..., Made]) -> None:
    """A random mechanism that changes its independent coordinates takes each sample once."""
    solver = made(mechanism, 50, partitions=3).solver
    log: list[Any] = []
    law = recorded(lambda s: np.cos(3 * s.t + np.arange(len(s.inputs))) + 0.1 * s.u[0], log)
    times = np.linspace(0.0, 1.0, 11)
    found = solver.simulate(times, controller=law, period=0.05)
    assert found.stats["partitions_changed"] > 0
    assert [t for t, _ in log] == pytest.approx(0.05 * np.arange(20))
    given = solver.simulate(times, inputs=as_inputs(log))
    assert np.array_equal(found.q, given.q) and np.array_equal(found.u, given.u)


def test_without_a_jacobian_values_are_fixed(cart: Any) -> None:
    log: list[Any] = []
    law = recorded(lambda s: -s.q[0], log)
    with pytest.warns(RuntimeWarning, match="controller has no Jacobian"):
        found = cart.simulate(
            [0.0, 1.0], {"cart": 1.0}, inputs={"wind": 0.0}, controller=law, period=0.1, sensitivities="m"
        )
    at, values, _ = as_inputs(log)
    given = cart.simulate([0.0, 1.0], {"cart": 1.0}, inputs={"force": (at, values[:, 0], "hold")}, sensitivities="m")
    np.testing.assert_allclose(found.dq, given.dq, rtol=1e-13)


def test_errors_of_the_controller_end_the_motion(cart: Any) -> None:
    def fails(s: Sample) -> Any:
        return 1.0 if s.t < 0.25 else 1.0 / 0.0

    with pytest.raises(ZeroDivisionError):
        cart.simulate(1.0, inputs={"wind": 0.0}, controller=fails, period=0.1)

    def stopped(s: Sample) -> Any:
        if s.t > 0.25:
            raise KeyboardInterrupt
        return 1.0

    run = cart.simulate(1.0, inputs={"wind": 0.0}, controller=stopped, period=0.1)
    assert run.ended == "interrupted" and run.t[-1] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (lambda s: [1.0, 2.0, 3.0], r"returned an array of shape \(3,\), expected \(1,\): values of force"),
        (lambda s: np.nan, "expected finite values of force"),
        (lambda s: "full", "expected values of force"),
        (lambda s: {"wind": 1.0}, "returned wind; expected values of force"),
        ((lambda s: 1.0, lambda s: {"x": 1}), "contains 'x'; allowed are q, u, outputs, p, inputs"),
        ((lambda s: 1.0, lambda s: {"q": [1.0, 2.0]}), r"'q' has shape \(1, 2\), expected \(1, 1\)"),
        ((lambda s: 1.0, lambda s: [1.0, 2.0]), r"has shape \(2,\); expected a mapping"),
    ],
)
def test_wrong_values(cart: Any, law: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cart.simulate(1.0, inputs={"wind": 0.0}, controller=law, period=0.1, sensitivities="m")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.1}, "there is no controller"),
        ({"controller": 3, "period": 0.1}, "expected a function of a sample"),
        ({"controller": len}, "period is None, expected the time between two samples"),
        ({"controller": len, "period": -1.0}, "period is -1.0"),
        ({"controller": len, "period": 1e-9}, "at least .* is allowed"),
        ({"controller": len, "period": 0.1, "inputs": [0.0, 1.0]}, "with a controller, give a mapping"),
        ({"controller": len, "period": 0.1, "inputs": {"wind": 0.0, "force": 1.0}}, "no signal is left"),
        (
            {"controller": (len, len), "period": 0.1, "inputs": {"wind": 0.0}, "sensitivities": "inputs.force"},
            "there is no derivative with respect to an input",
        ),
    ],
)  # fmt: skip
def test_wrong_arguments(cart: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cart.simulate(1.0, **options)


def test_prescribed_motion_cannot_be_held(made: Callable[..., Made]) -> None:
    driven = CART.replace("forces:", "motion: {cart: wind}\nforces:").replace("\n    cart", "")
    solver = made(parsed, driven + "  x: {value: wind}\n").solver
    with pytest.raises(ValueError, match="prescribed motion follows 'wind'"):
        solver.simulate(1.0, controller=lambda s: [0.0, 0.0], period=0.1)


def test_many_samples_take_linear_time(cart: Any) -> None:
    """Evaluations, not seconds: each sample costs the same number, also among very many."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runs = [
            cart.simulate([0.0, 1.0], inputs={"wind": 0.0}, controller=lambda s: -s.q[0], period=1 / n)
            for n in (500, 5000)
        ]
    few, many = (run.stats["evaluations"] for run in runs)
    assert many == pytest.approx(10 * few, rel=0.05)


def test_without_the_function_of_outputs_samples_have_none(made: Callable[..., Made]) -> None:
    solver = made(parsed, CART, functions=("state_rates",)).solver
    seen: list[int] = []
    solver.simulate(
        0.1, inputs={"wind": 0.0}, controller=lambda s: float(seen.append(len(s.outputs)) or 0), period=0.05
    )
    assert seen == [0, 0] and solver.noutputs == 2


def test_what_a_controller_writes_into_its_sample_changes_nothing(cart: Any) -> None:
    def careless(s: Sample) -> Any:
        found = np.array([1.0 - s.u[0] + 0.1 * s.inputs[0]])
        for part in ("q", "u", "outputs", "p", "inputs", "dq", "du", "doutputs", "dp", "dinputs"):
            getattr(s, part)[...] = 7.0
        return found

    def slopes(s: Sample) -> Any:
        return {"u": [-1.0], "inputs": [0.1]}

    law = (lambda s: 1.0 - s.u[0] + 0.1 * s.inputs[0], slopes)
    options = {"inputs": {"wind": 0.2}, "period": 0.1}
    given = cart.simulate([0.0, 1.0], controller=law, sensitivities=("m", "q0.cart"), **options)
    alone = cart.simulate([0.0, 1.0], controller=careless, **options)
    assert np.array_equal(alone.q, given.q) and np.array_equal(alone.u, given.u)
    both = cart.simulate(
        [0.0, 1.0], controller=(law[0], _overwriting(slopes)), sensitivities=("m", "q0.cart"), **options
    )
    np.testing.assert_array_equal(both.q, given.q)
    np.testing.assert_array_equal(both.dq, given.dq)


def _overwriting(slopes: Callable[[Sample], Any]) -> Callable[[Sample], Any]:
    """The directions' derivatives by a Jacobian, after which the sample is overwritten."""

    def jacobian(s: Sample) -> Any:
        found = s.du @ np.array(slopes(s)["u"])[:, None] + s.dinputs @ np.array(slopes(s)["inputs"])[:, None]
        for part in ("q", "u", "p", "inputs", "dq", "du", "dp", "dinputs"):
            getattr(s, part)[...] = 7.0
        return found

    return jacobian
