"""Results at requested times: within steps and at their ends, few and many, from any initial time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import Made, tree

WRT = ("crank_length", "u0.crank", "inputs.motor")


def same(a: Any, b: Any, rows: Any = slice(None), **close: float) -> None:
    for name in ("q", "u", "outputs"):
        np.testing.assert_allclose(getattr(a, name)[rows], getattr(b, name), **close)
        np.testing.assert_allclose(getattr(a, f"d{name}")[:, rows], getattr(b, f"d{name}"), **close)


def test_times_do_not_change_steps(four_bar: Any) -> None:
    own = four_bar.simulate(2.0, inputs=[0.3], sensitivities=WRT)
    at_ends = four_bar.simulate(own.t, inputs=[0.3], sensitivities=WRT)
    assert at_ends.stats["steps"] == own.stats["steps"] == len(own) - 1
    for name in ("q", "u", "outputs", "dq", "du", "doutputs"):  # polynomials of steps, at their ends: to rounding
        a, b = getattr(own, name), getattr(at_ends, name)
        assert np.abs(a - b).max() < 1e-14 * np.abs(b).max(), name
    first_and_last = four_bar.simulate([0.0, 2.0], inputs=[0.3], sensitivities=WRT)
    same(own, first_and_last, [0, -1], rtol=1e-13, atol=1e-14)


def test_ten_thousand_times(four_bar: Any) -> None:
    t = np.linspace(0, 2, 10_000)
    many = four_bar.simulate(t, inputs=[0.3], sensitivities=WRT)
    np.testing.assert_array_equal(many.t, t)
    few = four_bar.simulate(t[::1111], inputs=[0.3], sensitivities=WRT)
    assert many.stats["steps"] == few.stats["steps"] < 300
    same(many, few, slice(None, None, 1111), rtol=1e-12, atol=1e-13)
    assert many.closure_drift < 1e-13
    # u is the derivative of q, and dq moves with du: interpolants of one and the same motion
    np.testing.assert_allclose(np.gradient(many.q[:, 0], t, edge_order=2), many.u[:, 0], atol=1e-4)
    np.testing.assert_allclose(np.gradient(many.dq[0, :, 0], t, edge_order=2), many.du[0, :, 0], atol=1e-2)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 1e-3}], ids=["dop853", "rk4"])
def test_between_steps_as_exact_as_at_their_ends(four_bar: Any, options: dict[str, Any]) -> None:
    t = np.sort(np.random.default_rng(1).uniform(0, 1, 60))
    t[0] = 0.0
    found = four_bar.simulate(t, inputs=[0.3], sensitivities=WRT, **options)
    exact = four_bar.simulate(t, inputs=[0.3], sensitivities=WRT, rtol=1e-13, atol=1e-13, largest_step=0.01)
    for name in ("q", "u", "outputs", "dq", "du", "doutputs"):
        a, b = getattr(exact, name), getattr(found, name)
        assert np.abs(a - b).max() < 1e-7 * np.abs(a).max(), name  # rk4: h^4 = 1e-12, times derivatives of order 5


def test_any_beginning(four_bar: Any, made: Callable[..., Made]) -> None:
    zero = four_bar.simulate(np.linspace(0, 1, 11), inputs=[0.3], sensitivities=WRT)
    for start in (5.0, -7.3, 1e4):
        later = four_bar.simulate(start + np.linspace(0, 1, 11), inputs=[0.3], sensitivities=WRT)
        same(zero, later, rtol=1e-8, atol=1e-8)
    of = made(tree, 7)  # whose forces depend on t: a motion in two parts, the second from where the first has come to
    t = np.linspace(0.0, 0.4, 5)
    tight = {"rtol": 1e-12, "atol": 1e-12}
    whole = of.solver.simulate(t, of.q, p=of.p, inputs=[0.4, -0.3], **tight)
    q, u = of.solver.simulate(t[:3], of.q, p=of.p, inputs=[0.4, -0.3], **tight).final
    rest = of.solver.simulate(t[2:], q, u, p=of.p, inputs=[0.4, -0.3], **tight)
    np.testing.assert_allclose(whole.outputs[2:], rest.outputs, rtol=1e-9, atol=1e-10)
    wrong = of.solver.simulate(t[:3], q, u, p=of.p, inputs=[0.4, -0.3], **tight)
    assert np.abs(wrong.outputs[-1] - rest.outputs[-1]).max() > 1e-6


def test_the_last_time_is_never_left_out(falling: Any) -> None:
    """t + (end - t) is not always end."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        end = rng.uniform(1.75, 2)
        start = rng.uniform(0.5, end - 1)
        assert falling.simulate([start, end], method="rk4", step=10.0).t.tolist() == [start, end]


def test_constant_steps_that_do_not_add_up(falling: Any) -> None:
    for n in (3, 7, 10, 49, 1000, 4093, 9999):
        found = falling.simulate([0.0, 1.0], method="rk4", step=1 / n)
        assert found.t[-1] == 1.0 and n <= found.stats["steps"] <= n + 1
        np.testing.assert_allclose(found["z"][-1], 2 - 9.81 / 2, rtol=1e-11)


def test_times_that_nearly_coincide(falling: Any) -> None:
    t = [0.0, 0.5, np.nextafter(0.5, 1), np.nextafter(1.0, 0), 1.0]
    for options in ({}, {"method": "rk4", "step": 0.25}):
        found = falling.simulate(t, **options)
        np.testing.assert_array_equal(found.t, t)
        np.testing.assert_allclose(found["z"], 2 - 9.81 * np.square(t) / 2, rtol=1e-14)
