"""Remainders and periodic tables: values and slopes in all engines, over many periods and across the seam; errors."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import codegen
from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.reference import DenseEngine
from codegen.runtime import At, Integral

MODEL = """\
model: cam
parameters: {m: 0.7, top: 2.0}
tables:
  lift: {x: [0.5, 1, 2.5, 4], y: [1, 3, -1, 1], kind: cubic, outside: periodic}
  gas: {x: [0, 1, 2], y: [0, top, 1], outside: periodic, period: 2*pi}
bodies:
  repeat k in 1..3:
    arm(k): {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
forces:
  f: {type: joint, joint: arm(1), value: lift(q.arm(1))}
  g: {type: joint, joint: arm(2), value: gas(q.arm(2))}
  h: {type: joint, joint: arm(3), value: "mod(q.arm(3), m)**2"}
"""
PLACES = [-13.2, -3.0, 0.3, 0.5, 0.9, 3.999, 4.0, 4.3, 7.5, 100.1]


def expected(x: float, m: float = 0.7, top: float = 2.0) -> tuple[list[float], list[float], list[float]]:
    """Forces, their slopes, and their derivatives with respect to m and top; slopes at points are those on the left."""
    spline = CubicSpline([0.5, 1, 2.5, 4], [1, 3, -1, 1], bc_type="periodic")
    s = np.mod(x, 2 * np.pi)
    xs, ys = np.array([0, 1, 2, 2 * np.pi]), np.array([0, top, 1, 0])
    i = max(0, int(np.searchsorted(xs, s, side="left")) - 1)
    by_top = np.interp(s, xs, [0, 1, 0, 0])
    rest = np.mod(x, m)
    by_m = 2 * rest * -np.floor(x / m)
    return (
        [float(spline(x)), float(np.interp(s, xs, ys)), rest**2],
        [float(spline(x, 1)), float((ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i])), 2 * rest],
        [float(by_m), float(by_top)],
    )


@pytest.fixture(scope="module")
def solvers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    model = parse_model(MODEL)
    found: dict[str, object] = {"dense": DenseEngine(model)}
    for target in ("c", "numpy"):
        folder: Path = tmp_path_factory.mktemp("cam") / target
        codegen.generate(model, folder, target=target, functions=("accelerations", "jacobians", "gradients"))
        found[target] = codegen.load(folder)
    return found


@pytest.mark.parametrize("target", ["c", "numpy", "dense"])
def test_values_and_derivatives_over_many_periods(solvers, target: str) -> None:
    solver = solvers[target]
    for x in PLACES:
        q, p = [x] * 3, [0.7, 2.0]
        value, slope, by = expected(x)
        np.testing.assert_allclose(solver.accelerations(q, [0.0] * 3, p), value, rtol=1e-11, atol=1e-11)
        J = solver.jacobians(q, [0.0] * 3, p)
        np.testing.assert_allclose(np.diag(J.q), slope, rtol=1e-10, atol=1e-10)
        assert J.p[2, 0] == pytest.approx(by[0], rel=1e-11) and J.p[1, 1] == pytest.approx(by[1], rel=1e-11, abs=1e-12)


def test_batches_and_gradients(solvers) -> None:
    q = np.repeat(np.array(PLACES)[:, None], 3, axis=1)
    expected_rows = np.array([expected(x)[0] for x in PLACES])
    for target in ("c", "numpy"):
        solver = solvers[target]
        np.testing.assert_allclose(solver.accelerations(q, 0 * q), expected_rows, rtol=1e-11, atol=1e-11)
        found = solver.gradients(q, 0 * q, weights=np.eye(3)[:, None])
        np.testing.assert_allclose(np.einsum("knk->nk", found.q), [expected(x)[1] for x in PLACES], atol=1e-9)


def test_more_digits(solvers) -> None:
    exact = solvers["c"].in_precision(40)
    x = mpmath.mpf("13.3")
    found = exact.accelerations([0, 0, "13.3"], [0] * 3, ["0.7", 2])
    assert abs(found[2] - mpmath.fmod(x, exact.mp.mpf("0.7")) ** 2) < 1e-14
    assert abs(found[2] - mpmath.mpf("0.0")) < 1e-30  # 13.3 is 19 times 0.7


def test_the_builder_and_a_seam_that_is_smooth() -> None:
    b = ModelBuilder("cam")
    b.table("wave", [0, 1, 2], [0, 1, 0], "periodic", kind="cubic", period=3)
    b.body("arm", joint="revolute", axis="y", mass=1, inertia={"yy": 1, "xx": 1, "zz": 1})
    b.force("f", "joint", joint="arm", value="wave(q.arm)")
    engine = DenseEngine(b.build())
    spline = CubicSpline([0, 1, 2, 3], [0, 1, 0, 0], bc_type="periodic")
    for x in (0.0, 3.0, 1e-9, -1e-9, 3 - 1e-9):
        assert engine.jacobians([x], [0.0]).q[0, 0] == pytest.approx(float(spline(x, 1)), abs=1e-7)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("{x: [0, 1], y: [1, 2], outside: periodic}", "2 at the end, 1 at the beginning"),
        ("{x: [0, 1, 3], y: [1, 2, 1], outside: periodic, period: 2}", "is shorter than the distance"),
        ("{x: [0, 1], y: [1, 1], outside: linear, period: 2}", "a table with a period needs outside: periodic"),
        ("{x: [0, 1], y: [1, 1], outside: around}", "constant, linear or periodic"),
    ],
)
def test_mistakes(table: str, message: str) -> None:
    with pytest.raises(ModelError) as error:
        parse_model(f"model: m\nbodies: {{}}\ntables: {{wave: {table}}}\n")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("call", "slopes"), [("wave(k)(q.arm(k))", [1, 2]), ("wave_2(q.arm(k))", [2, 2]), ("wave(2)(3*q.arm(k))", [6, 6])]
)
def test_tables_of_a_repeat_are_called_with_their_index_or_by_their_whole_name(call: str, slopes: list[float]) -> None:
    engine = DenseEngine(parse_model(REPEATED.format(call)))
    np.testing.assert_allclose(np.diag(engine.jacobians([0.5, 0.5], [0.0, 0.0]).q), slopes)


def test_a_table_of_a_repeat_without_its_index() -> None:
    with pytest.raises(ModelError, match=r"tables are wave_1, wave_2, called wave\(k\)\(x\) or wave_1\(x\)"):
        parse_model(REPEATED.format("wave(q.arm(k))"))


REPEATED = """\
model: waves
tables:
  repeat k in 1..2:
    wave(k): {{x: [0, 1], y: [0, k], outside: linear}}
bodies:
  repeat k in 1..2:
    arm(k): {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
forces:
  repeat k in 1..2:
    f(k): {{type: joint, joint: arm(k), value: {}}}
"""


AWKWARD = np.array([0.1, 0.3, 0.7, 1.1, 1.9, 2.3])
"""Points whose differences are rounded."""


def test_a_motion_by_a_cubic_table_is_right_exactly_at_its_points(tmp_path):
    """Place, velocity and driving force at the points and at the seam, where neighbouring segments meet."""
    y = np.array([0.2, 1.0, -0.5, 0.3, 0.9, 0.2])
    b = ModelBuilder("driven")
    b.table("way", AWKWARD.tolist(), y.tolist(), kind="cubic", outside="periodic")
    b.body("slide", joint="prismatic", axis="x", mass=1.0)
    b.motion("slide", "way(t)")
    b.output("place", value="q.slide")
    b.output("speed", value="u.slide")
    b.output("force", driving_force="slide")
    model = b.build()
    codegen.generate(model, tmp_path / "driven", functions=("outputs",))
    spline = CubicSpline(AWKWARD, y, bc_type="periodic")
    for t in (*AWKWARD.tolist(), 0.7 + 2.2, 0.1 - 2.2, 0.5):
        of_t = [float(spline(t, order)) for order in range(3)]
        for engine in (codegen.load(tmp_path / "driven"), DenseEngine(model)):
            assert engine.outputs(np.zeros(0), np.zeros(0), t=t) == pytest.approx(of_t, rel=1e-11, abs=1e-11)


def test_slopes_are_those_on_the_left_exactly_at_points_whose_differences_are_rounded(tmp_path):
    b = ModelBuilder("held")
    y = [0.2, 1.0, -0.5, 0.3, 0.9, 0.2]
    for kind in ("linear", "cubic"):
        b.table(kind, AWKWARD.tolist(), y, kind=kind, outside="constant")
        b.body(f"of_{kind}", joint="prismatic", axis="x", mass=1.0)
        b.joint_force(f"by_{kind}", f"of_{kind}", f"{kind}(q.of_{kind})")
    model = b.build()
    codegen.generate(model, tmp_path / "held", functions=("accelerations", "jacobians"))
    spline, lines = CubicSpline(AWKWARD, y, bc_type="natural"), np.diff(y) / np.diff(AWKWARD)
    for i, x in enumerate(AWKWARD[1:].tolist()):
        found = codegen.load(tmp_path / "held").jacobians([x, x], [0.0, 0.0]).q
        assert np.diag(found) == pytest.approx([lines[i], float(spline(x, 1))], rel=1e-11, abs=1e-11)


def test_a_motion_over_the_seam_of_a_cubic_table_is_right_at_the_seam(tmp_path):
    """Results at times that are exactly on the seam: within a motion, and at its end."""
    x, y = np.array([-1.0, -0.5, 0.25, 1.0]), np.array([0.2, 1.0, -0.5, 0.2])
    b = ModelBuilder("driven")
    b.table("way", x.tolist(), y.tolist(), kind="cubic", outside="periodic")
    b.body("slide", joint="prismatic", axis="x", mass=1.0)
    b.motion("slide", "way(t)")
    b.output("place", value="q.slide")
    b.output("speed", value="u.slide")
    b.output("force", driving_force="slide")
    codegen.generate(b.build(), tmp_path / "driven", functions=("outputs", "motion"))
    spline, times = CubicSpline(x, y, bc_type="periodic"), np.linspace(-0.75, 3.0, 16)
    found = codegen.load(tmp_path / "driven").simulate(times).outputs
    assert found == pytest.approx(np.column_stack([spline(times, order) for order in range(3)]), rel=1e-9, abs=1e-9)


SEAM_X, SEAM_Y = np.array([-1.0, -0.5, 0.25, 1.0]), np.array([0.2, 1.0, -0.5, 0.2])


@pytest.fixture(scope="module")
def late_slide(tmp_path_factory: pytest.TempPathFactory):
    """A slide moved by a periodic cubic table, later by a parameter."""
    b = ModelBuilder("late")
    b.parameter("m", 2.0)
    b.parameter("late", 0.0)
    b.table("way", SEAM_X.tolist(), SEAM_Y.tolist(), kind="cubic", outside="periodic")
    b.body("slide", joint="prismatic", axis="x", mass="m")
    b.motion("slide", "way(t - late)")
    b.output("speed", value="u.slide")
    b.output("force", driving_force="slide")
    folder = tmp_path_factory.mktemp("late") / "late"
    codegen.generate(b.build(), folder)
    return codegen.load(folder)


@pytest.mark.parametrize("start", [-3.0, -1.0, 1.0, 3.0, -0.5, 0.25])
def test_a_motion_that_starts_at_a_point_of_a_cubic_table(late_slide, start: float) -> None:
    """At the seam, all switches of the table jump; derivatives are those of the motion after the start."""
    spline = CubicSpline(SEAM_X, SEAM_Y, bc_type="periodic")
    end = start + 0.4
    s, e = ([float(spline(t, order)) for order in range(3)] for t in (start, end))
    jerk = float(spline(start + 1e-9, 3))
    run = late_slide.simulate(np.linspace(start, end, 3), sensitivities=("m", "late"))
    assert run.outputs[[0, -1]] == pytest.approx(np.array([[s[1], 2 * s[2]], [e[1], 2 * e[2]]]), rel=1e-11, abs=1e-11)
    assert run.doutputs[:, 0] == pytest.approx(np.array([[0, s[2]], [-s[2], -2 * jerk]]), rel=1e-11, abs=1e-11)
    for method in ("forward", "adjoint"):
        found = late_slide.judge(
            (start, end), [At("force", start), Integral("force")], wrt=("m", "late"), method=method
        )
        assert found.values == pytest.approx([2 * s[2], 2 * (e[1] - s[1])], rel=1e-11, abs=1e-11)
        gradients = np.array([[s[2], -2 * jerk], [e[1] - s[1], 2 * (s[2] - e[2])]])
        assert found.gradients == pytest.approx(gradients, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("speed", [1.0, -1.0, 0.0])
@pytest.mark.parametrize("start", [-1.0, 1.0, -0.5])
def test_a_motion_under_a_linear_table_that_starts_at_a_point(slide_by_lines, start: float, speed: float) -> None:
    """Near the start the force is a line of the position, so the motion is a known oscillation or exponential."""
    h = 1e-3 * (speed or 1.0)  # from rest, the force is positive at these points
    at = np.mod(start + 1.0, 2.0) - 1.0
    force = float(np.interp(at, SEAM_X, SEAM_Y))
    slope = (float(np.interp(np.mod(start + h + 1.0, 2.0) - 1.0, SEAM_X, SEAM_Y)) - force) / h
    rate, t = np.sqrt(complex(slope)), np.linspace(0.0, 0.2, 5)
    moved = (speed * np.sinh(rate * t) / rate + force / slope * (np.cosh(rate * t) - 1)).real
    run = slide_by_lines.simulate(t, [start], [speed], rtol=1e-12, atol=1e-12)
    assert run.q[:, 0] == pytest.approx(start + moved, rel=1e-11, abs=1e-11)
    assert run.outputs[:, 0] == pytest.approx(force + slope * moved, rel=1e-10, abs=1e-10)


@pytest.fixture(scope="module")
def slide_by_lines(tmp_path_factory: pytest.TempPathFactory):
    b = ModelBuilder("lines")
    b.table("push", SEAM_X.tolist(), SEAM_Y.tolist(), outside="periodic")
    b.body("slide", joint="prismatic", axis="x", mass=1.0)
    b.joint_force("by_lines", "slide", "push(q.slide)")
    b.output("push", value="push(q.slide)")
    folder = tmp_path_factory.mktemp("lines") / "lines"
    codegen.generate(b.build(), folder, functions=("outputs", "simulate"))
    return codegen.load(folder)
