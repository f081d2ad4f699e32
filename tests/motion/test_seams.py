"""Motions across the seams and the ends of tables, and across jumps inside `step` and inside tables: values and derivatives
against closed forms, which follow from the energy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import codegen
from codegen.runtime import AtEvent, Event, Final

X, Y, PERIOD = np.array([0.0, 1.0, 2.0, 4.5]), np.array([0.2, 1.3, -0.7, 0.4]), 5.0

MODEL = """
model: slide
parameters: {{late: 0.0}}
tables:
  push: {{x: {x}, y: {y}, {table}}}
bodies:
  slide: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}
forces:
  by_table: {{type: joint, joint: slide, value: "{force}"}}
outputs:
  place: {{value: q.slide}}
  speed: {{value: u.slide}}
"""


def solver(folder: Path, table: str, force: str):
    text = MODEL.format(x=X.tolist(), y=Y.tolist(), table=table, force=force)
    codegen.generate(codegen.parse_model(text), folder, functions=("motion",), check=False)
    return codegen.load(folder)


def by_table(x):
    return np.interp(np.mod(x, PERIOD), [*X, PERIOD], [*Y, Y[0]])


def work(f, start: float, end: float, points) -> float:
    """The integral of a force, by Gauss's rule on the intervals between its points."""
    low, high = sorted((start, end))
    edges = np.array([low, *(p for p in sorted(points) if low < p < high), high])
    at, weights = np.polynomial.legendre.leggauss(4)
    h = np.diff(edges)[:, None]
    places = edges[:-1, None] + h * (at + 1) / 2
    return float(np.sign(end - start) * np.sum(h / 2 * weights * f(places)))


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
@pytest.mark.parametrize("speed", [9.0, -9.0])
def test_a_linear_table_passes_the_seam_in_both_directions(tmp_path: Path, speed: float, integrator: str) -> None:
    """Where x passes the seam, `mod` jumps and takes the functions of all other switches of the table away from zero."""
    slide = solver(tmp_path / "slide", f"outside: periodic, period: {PERIOD}", "3*push(q.slide - late)")
    start, end = -0.17, -0.17 + np.sign(speed) * 11.3
    points = [k * PERIOD + x for k in range(-4, 4) for x in X]
    final = np.sign(speed) * np.sqrt(speed**2 + 6 * work(by_table, start, end, points))
    by_late = 3 * float(by_table(start) - by_table(end)) / final
    stop = AtEvent("speed", Event("place", level=end))
    for method in ("forward", "adjoint"):
        found = slide.judge(
            3.0, [stop], {"slide": start}, {"slide": speed}, wrt=["late"], method=method, integrator=integrator,
            rtol=1e-11, atol=1e-11,
        )  # fmt: skip
        assert found.values == pytest.approx([final], rel=1e-9)
        assert found.gradients == pytest.approx(np.array([[by_late]]), rel=1e-7)


def test_every_step_passes_the_seam_with_its_derivatives(tmp_path: Path) -> None:
    """Rounding may pass `max(0, x)` of the reduced argument x before `mod`; the modes of later switches depend on both."""
    slide = solver(tmp_path / "slide", f"outside: periodic, period: {PERIOD}", "3*push(q.slide - late - 0.1)")
    for start in 0.502 + np.arange(40) / 1000:
        shift, end = 0.47, 0.47 - 0.4
        final = -np.sqrt(81 + 6 * work(by_table, start - shift, end - shift, [-0.5, 0.0]))
        found = slide.judge(
            0.3, [AtEvent("speed", Event("place", level=end))], {"slide": start}, {"slide": -9.0}, {"late": 0.37},
            wrt=["late"], method="forward", integrator="rk4", step=3e-4,
        )  # fmt: skip
        assert found.values == pytest.approx([final], rel=1e-9)
        exact = 3 * float(by_table(start - shift) - by_table(end - shift)) / final
        assert found.gradients == pytest.approx(np.array([[exact]]), rel=1e-7)


@pytest.mark.parametrize(
    ("force", "jump"),
    [
        ("3*step(if(q.slide > 1 + late, 0.5, 0.2), 0, 1)", 3 * (0.5 - (10 - 3 + 0.24) * 0.008)),
        ("push(if(q.slide > 1 + late, 2, 1))", -2.0),
        ("push(mod(q.slide - late, 1) + 1)", 2.0),
    ],
)
def test_jumps_inside_steps_and_cubic_tables(tmp_path: Path, force: str, jump: float) -> None:
    """The force jumps at 1; the derivative of the final place follows from the time of the jump."""
    slide = solver(tmp_path / "slide", "kind: cubic, outside: linear", force)
    end = 0.4
    runs = [
        slide.simulate(end, {"slide": 0.5}, {"slide": 3.0}, p={"late": late}, rtol=1e-13, atol=1e-13).final[0][0]
        for late in np.array([-2, -1, 1, 2]) * 1e-3
    ]
    difference = (runs[0] - 8 * runs[1] + 8 * runs[2] - runs[3]) / 12e-3
    assert abs(difference) > 1e-3 * abs(jump)
    for method in ("forward", "adjoint"):
        found = slide.judge(
            end, [Final("place")], {"slide": 0.5}, {"slide": 3.0}, wrt=["late"], method=method, rtol=1e-11, atol=1e-11
        )
        assert found.gradients == pytest.approx(np.array([[difference]]), rel=1e-7)


def test_pulses_of_steps(tmp_path: Path) -> None:
    """`step(mod(t, ..), ..)` jumps at each whole period. Each pulse lasts the period without half the rise."""
    slide = solver(tmp_path / "slide", "outside: linear", "3*step(mod(t, 0.31 + late), 0, 0.2)")
    for method in ("forward", "adjoint"):
        found = slide.judge(0.9, [Final("speed")], wrt=["late"], method=method, rtol=1e-11, atol=1e-11)
        # three rises of 0.2 s; at the end, the third pulse is at its top
        assert found.values == pytest.approx([3 * (0.9 - 3 * 0.1)], rel=1e-9)
        assert found.gradients == pytest.approx(np.array([[0.0]]), abs=1e-8)


def test_a_cubic_table_with_a_slope_at_its_end(tmp_path: Path) -> None:
    """Beyond the last point the force is constant, so its slope jumps there. The spline passes 4.5 with a slope."""
    slide = solver(tmp_path / "slide", "kind: cubic, outside: constant", "3*push(q.slide - late)")
    spline = CubicSpline(X, Y, bc_type="natural")
    end = 6.0
    final = np.sqrt(9.0**2 + 6 * (0.17 * Y[0] + spline.integrate(0.0, 4.5) + 1.5 * Y[-1]))
    exact = 3 * (Y[0] - Y[-1]) / final
    for rtol in (1e-10, 1e-12):
        found = slide.judge(
            3.0, [AtEvent("speed", Event("place", level=end))], {"slide": -0.17}, {"slide": 9.0}, wrt=["late"],
            method="forward", rtol=rtol, atol=rtol,
        )  # fmt: skip
        assert found.gradients == pytest.approx(np.array([[exact]]), abs=3e-7)


SHAKEN = """
model: shaken
parameters: {T: 0.37, s: 0.2, k: 20.0}
tables:
  way: {x: [0, 0.5, 0.6, 1.0], y: [0, 1, 0.3, 0], kind: cubic, outside: periodic}
bodies:
  base: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  rider: {parent: base, joint: {type: prismatic, axis: x}, mass: 1}
motion: {base: s*way(t/T)*way(t/T)}
forces:
  spring: {type: joint, joint: rider, value: -k*q.rider}
outputs: {place: {value: q.rider}}
"""


@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_switches_passed_just_before_the_seam(tmp_path: Path, integrator: str) -> None:
    """Rounding may pass the last point of a table before `mod` at the seam; a third of such motions lost their derivatives.

    The rider is an oscillator under the acceleration of its base, so its motion is Duhamel's integral.
    """
    codegen.generate(codegen.parse_model(SHAKEN), tmp_path / "shaken", functions=("motion",), check=False)
    shaken = codegen.load(tmp_path / "shaken")
    way = CubicSpline([0, 0.5, 0.6, 1.0], [0, 1, 0.3, 0], bc_type="periodic")
    end, w = 1.5, np.sqrt(20.0)
    at, weights = np.polynomial.legendre.leggauss(30)

    def place(period: float) -> float:
        points = sorted(k * period + x * period for k in range(7) for x in (0.0, 0.5, 0.6))
        edges = np.array([*(x for x in points if x < end), end])
        h = np.diff(edges)[:, None]
        t = edges[:-1, None] + h * (at + 1) / 2
        j, first, second = (way(np.mod(t / period, 1.0), n) for n in range(3))
        base = 0.2 * 2 * (first**2 + j * second) / period**2
        return float(np.sum(h / 2 * weights * -base * np.sin(w * (end - t)) / w))

    for period in np.linspace(0.253, 0.447, 11):
        d = 1e-5
        exact = (place(period - 2 * d) - 8 * place(period - d) + 8 * place(period + d) - place(period + 2 * d)) / (
            12 * d
        )
        for method in ("forward", "adjoint"):
            found = shaken.judge(
                end, [Final("place")], p={"T": period}, wrt=["T"], method=method, integrator=integrator, rtol=1e-11,
                atol=1e-11,
            )  # fmt: skip
            assert found.values == pytest.approx([place(period)], abs=1e-8)
            assert found.gradients == pytest.approx(np.array([[exact]]), rel=1e-6, abs=1e-6), period
