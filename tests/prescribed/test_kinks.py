"""Prescribed motion whose velocity jumps: an error in the model file, or at other parameters the end of the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.jumps import from_to, jumps
from codegen.model import parse_model
from codegen.model.binding import bind
from codegen.model.errors import ModelError
from codegen.model.expressions import Expression
from codegen.model.kinks import find_kink
from codegen.model.parsing import parse
from codegen.model.tables import Table
from codegen.runtime.standalone.errors import SimulationError
from codegen.runtime.standalone.motion.functionals import Final

PARAMETERS = {"a": 1.3, "t0": 0.7, "w": 3.0}

KINKS = [
    ("max(0, t - 0.5)", 0.5, 1, 0.0, 1.0), ("abs(t - t0)", 0.7, 1, -1.0, 1.0), ("min(t, 2)", 2.0, 1, 1.0, 0.0),
    ("sign(t - 1)", 1.0, 0, -1.0, 1.0), ("if(t > 1, t - 1, 0)", 1.0, 1, 0.0, 1.0), ("if(t < t0, 0.1, 0.2*a)", 0.7, 0, 0.1, 0.26),
    ("abs(sin(w*t))", 0.0, 1, -3.0, 3.0), ("a*max(0, cos(w*t))", np.pi / 6, 1, -3.9, 0.0), ("max(0, t)", 0.0, 1, 0.0, 1.0),
    ("sqrt((t - 1)**2)", 1.0, 1, -1.0, 1.0), ("((t - t0)**2)**0.5", 0.7, 1, -1.0, 1.0),
    ("acos(cos(t + 1))", np.pi - 1, 1, 1.0, -1.0),
    ("atan2(sin(t), cos(t))", np.pi, 0, np.pi, -np.pi), ("exp(-abs(t - 1))", 1.0, 1, 1.0, -1.0),
    ("min(max(t - 1, 0), 1)", 1.0, 1, 0.0, 1.0), ("1e-9*max(0, t - 1)", 1.0, 1, 0.0, 1e-9),
    ("t*max(0, 3 - t)", 3.0, 1, -3.0, 0.0),
    ("max(0, t - 1) - max(0, t - 1.0000001)", 1.0, 1, 0.0, 1.0), ("if((t - 1)**3 > 0, 1, 0)", 1.0, 0, 0.0, 1.0),
    ("mod(t + 1, 2)", 1.0, 0, 2.0, 0.0),
    ("abs(mod(t + 0.5, 2) - 1)", 0.5, 1, -1.0, 1.0), ("max(0, sin(t) - 0.9999)", np.arcsin(0.9999), 1, 0.0, 0.0141418),
]  # fmt: skip
SMOOTH = [
    "max(0, t - 0.5)**2", "abs(t - t0)**3", "abs(t - 1)*(t - 1)", "if(t > 1, (t - 1)**2, 0)", "step(t, 0, 1)", "max(0, a)*t",
    "step(t, 0.3, 0.3 + 1e-6)", "abs(t + 1)", "sqrt(t + 1)", "max(0, sin(w*t))**2", "max(0, sin(w*t))**3", "(t - 1)**3",
    "(t - 3)**2*sign(t - 3)", "cos(max(0, t - 1))", "log(1 + max(0, t - 1)**2)", "max(0, sin(t) - 1)", "a*sin(w*t)",
    "max(0, t - 1e5)**2", "max(0, x)**2 + x*t", "step(x, 0, 1)", "if(x > 1, x**2, 2*x - 1)", "atan2(x, 2)", "abs(w - a)*t",
    "sin(pi*mod(t, 2))", "mod(a, 1)*t",
]  # fmt: skip
BY_INPUTS = [
    "max(0, x)",
    "abs(x - t)",
    "if(x > 1, x, 1)",
    "sign(x)*t",
    "sqrt(x**2)",
    "min(x, 2)*sin(t)",
    "atan2(x, -1)",
]


def bound(text: str) -> Expression:
    return bind(parse(text), {})


@pytest.mark.parametrize(("text", "t", "order", "before", "after"), KINKS)
def test_kinks_are_found_with_both_velocities(text: str, t: float, order: int, before: float, after: float) -> None:
    found = find_kink(bound(text), PARAMETERS, frozenset({"x"}))
    assert found is not None and found.order == order
    assert found.t == pytest.approx(t, abs=1e-7)
    assert (found.before, found.after) == pytest.approx((before, after), rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("text", BY_INPUTS)
def test_kinks_by_inputs_are_found_at_no_time(text: str) -> None:
    found = find_kink(bound(text), PARAMETERS, frozenset({"x"}))
    assert found is not None and found.t is None


@pytest.mark.parametrize("text", SMOOTH)
def test_motion_whose_velocity_is_continuous_has_none(text: str) -> None:
    assert find_kink(bound(text), PARAMETERS, frozenset({"x"})) is None


@pytest.mark.filterwarnings("error")
def test_rates_that_are_infinite_beside_a_time_warn_of_nothing() -> None:
    find_kink(bound("sqrt((exp(-(t)**2))**2) + atan2(exp(-(t)**2), t)"), {}, frozenset())


def test_a_jump_is_told_with_as_many_digits_as_it_needs() -> None:
    assert from_to(1.0, 2.5) == "from 1 to 2.5"
    assert from_to(1.0, 1.0 + 2e-7) == "from 1 to 1.0000002"
    assert from_to(-0.0, 1e-30) == "from -0 to 1e-30"


@pytest.mark.parametrize("w", [60.0, 6000.0])
@pytest.mark.parametrize("turns", [1.0, 1e5, 6e6])
def test_the_segments_of_a_fast_cam_have_none_at_late_times(w: float, turns: float) -> None:
    """A cubic table of 200 points, turned at w rad/s, at its points after some turns."""
    x = np.linspace(0.0, 2.0 * np.pi, 201)
    y = np.append(np.sin(x[:-1]) ** 3, 0.0)
    table = Table(tuple(x.tolist()), tuple(map(Expression.number, y.tolist())), "cubic", "periodic")
    tree = table.at(bound("w*t").tree)
    assert jumps(tree, lambda t: {"w": (np.float64(w), 0.0), "t": (t, 1.0)}, (x[1:-1] + 2.0 * np.pi * turns) / w) == []


@pytest.mark.parametrize("seed", range(6))
def test_random_pieces_that_meet_with_equal_velocity_have_none_and_others_have_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c, t = rng.uniform(0.3, 2.0, 4).round(3).tolist()
    first = f"{a}*sin({b}*t)"
    meets = f"{a}*sin({b}*{t}) + {a}*{b}*cos({b}*{t})*(t - {t}) + {c}*(t - {t})**2"
    jumps = f"{meets} + 1e-4*(t - {t})"
    assert find_kink(bound(f"if(t < {t}, {first}, {meets})"), {}, frozenset()) is None
    found = find_kink(bound(f"if(t < {t}, {first}, {jumps})"), {}, frozenset())
    assert found is not None and found.after - found.before == pytest.approx(1e-4) and found.t == pytest.approx(t)


CART = """
model: kinked_cart
gravity: [0, 0, -9.81]
parameters: {l: 1.0, t0: 5.0, rise: 0.3}
inputs: [x]
tables:
  straight: {x: [0, 0.5, 1.0, 2.0], y: [0, 0.1, 0.1, 0.0], outside: constant}
  held: {x: [0, 0.5, 1.0, 2.0], y: [0, 0.1, 0.1, 0.0], kind: cubic, outside: constant}
  smooth: {x: [0, 0.5, 1.0, 2.0], y: [0, 0.1, 0.1, 0.0], kind: cubic, outside: linear}
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  rod: {parent: cart, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -l], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
motion: {cart: "MOTION"}
outputs: {motor: {driving_force: cart}, v: {velocity: cart, axis: x}, angle: {value: q.rod}}
"""


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        ("rise*max(0, t - 0.5)", r"jumps from 0 to 0\.3 at t = 0\.5 s.*by max\(0, t - 0\.5\).*step\(t, from, to\)"),
        ("straight(t)", r"jumps from 0 to 0\.2 at t = 0 s.*kind: cubic"),
        ("0.1 + straight(t + 0.1)", r"at t = 0\.4 s.*kind: cubic"),
        ("held(t)", r"jumps from 0 to 0\.2\d* at t = 0 s.*slope is not zero.*outside: linear"),
        ("held(t + 0.5)", r"at t = 1\.5 s.*outside: linear"),
        ("abs(x)", r"jumps from .* where inputs change the branch of abs\(x\)"),
    ],
)
def test_a_model_with_a_kink_is_refused_with_its_place(motion: str, says: str) -> None:
    with pytest.raises(ModelError, match=says) as caught:
        parse_model(CART.replace("MOTION", motion))
    errors = [p for p in caught.value.problems if p.severity == "error"]
    assert len(errors) == 1 and errors[0].line == 13 and errors[0].path == "motion.cart"


@pytest.mark.parametrize("motion", ["if(t < 1, t**3, 3*t - 2 + 3*(t - 1)**2)", "if(t > 1, rise*(t - 1)**2, 0)"])
def test_pieces_that_meet_with_equal_velocity_are_read_without_a_warning(motion: str) -> None:
    warned = parse_model(CART.replace("MOTION", motion)).warnings
    assert not [w for w in warned if "motion" in w], warned


def test_a_cubic_table_that_goes_on_as_it_ends_is_allowed(tmp_path: Path) -> None:
    codegen.generate(
        parse_model(CART.replace("MOTION", "smooth(t)")), tmp_path / "smooth", functions="motion", compile="all"
    )
    run = codegen.load(tmp_path / "smooth").simulate(np.linspace(0, 2.5, 26), rtol=1e-11, atol=1e-11)
    from scipy.interpolate import CubicSpline

    table = CubicSpline([0, 0.5, 1, 2], [0, 0.1, 0.1, 0], bc_type="natural")
    assert np.abs(run["v"] - table(np.minimum(run.t, 2.0), 1)).max() < 1e-13


MOVED = [
    ("if(t < t0, 0.1*t, rise + 0.1*(t - 2))", {"rise": 0.2, "t0": 2.0}, {"rise": 0.2, "t0": 1.0}, None),
    ("if(t < 2, rise*t, 0.6 + 0.3*(t - 2))", {}, {"rise": 0.25}, 2.0),
    ("max(0, rise*sin(t) - 0.5)", {}, {"rise": 0.6}, float(np.arcsin(5 / 6))),
    ("max(0, sin(t) - 1 - rise)", {}, {"rise": -1e-6}, float(np.arcsin(1 - 1e-6))),
    ("step(t, 1, 2)*t0 + abs(t - t0 - 20)*rise", {"rise": 0.0}, {"rise": 0.1, "t0": -17.5}, 2.5),
]


@pytest.mark.parametrize(("motion", "first", "moved", "t"), MOVED)
def test_a_parameter_that_makes_a_kink_ends_the_motion(tmp_path: Path, motion: str, first, moved, t) -> None:
    text = CART.replace("MOTION", motion)
    for name, value in first.items():
        text = text.replace(f"{name}: {'5.0' if name == 't0' else '0.3'}", f"{name}: {value}")
    codegen.generate(parse_model(text), tmp_path / "moved", functions="motion", compile="all")
    solver = codegen.load(tmp_path / "moved")
    assert solver.simulate(4.0).ended == "finished"
    if t is None:
        assert solver.simulate(4.0, p=moved).ended == "finished"
        return
    with pytest.raises(
        SimulationError, match=r"the prescribed motion of 'cart' jumps from .* impulse on other bodies would be ignored"
    ) as caught:
        solver.simulate(4.0, p=moved)
    assert caught.value.trajectory.t[-1] == pytest.approx(t, abs=1e-9)
    with pytest.warns(match="prescribed motion of 'cart' jumps"):
        run = solver.simulate(np.linspace(0, 4, 41), p=moved, on_failure="return")
    assert run.t[-1] <= t and "jumps" in run.ended
    for method in ("forward", "adjoint"):
        with pytest.raises(SimulationError, match="prescribed motion of 'cart' jumps"):
            solver.judge(4.0, [Final("angle")], wrt="l", p=moved, method=method)
    assert solver.simulate(0.9 * t, p=moved).ended == "finished"
    with pytest.raises(SimulationError, match="prescribed motion of 'cart' jumps"):
        solver.simulate([t, t + 1], p=moved)


def test_an_input_that_reaches_a_kink_ends_the_motion(tmp_path: Path) -> None:
    """The branch of a square is none; that of a linear one at a threshold beyond what is looked at when the file is read is."""
    codegen.generate(
        parse_model(CART.replace("MOTION", "max(0, x - 1e4)")), tmp_path / "far", functions="motion", compile="all"
    )
    solver = codegen.load(tmp_path / "far")
    assert solver.simulate(1.0, inputs={"x": np.sin}).ended == "finished"
    with pytest.raises(SimulationError, match=r"ends at t = 0\.5.* 'cart' jumps from 0 to 20000"):
        solver.simulate(1.0, inputs={"x": lambda t: 2e4 * t})


def test_models_without_branches_carry_none_of_it(tmp_path: Path) -> None:
    codegen.generate(parse_model(CART.replace("MOTION", "rise*sin(t)")), tmp_path / "plain", functions="simulate")
    assert "branching_motion" not in codegen.load(tmp_path / "plain")._manifest


JUMPS = [
    "rise*max(0, t - t0)**2", "if(t < t0, 0, rise*(t - t0)**2)", "step(t, t0, 2*t0)*rise", "smooth(t - t0)",
    "rise*abs(t - t0)*(t - t0)", "rise*max(0, sin(t/t0) - 0.5)**2",
]  # fmt: skip


@pytest.mark.parametrize("motion", JUMPS)
def test_derivatives_know_when_accelerations_jump(tmp_path: Path, motion: str) -> None:
    """The time of the jump moves with a parameter; the motion is integrated in one smooth piece after the other."""
    text = CART.replace("MOTION", motion).replace("t0: 5.0", "t0: 0.7")
    codegen.generate(parse_model(text), tmp_path / "jumps", functions="motion", compile="all")
    solver = codegen.load(tmp_path / "jumps")
    tight = {"rtol": 1e-12, "atol": 1e-12}
    names = [n for n in solver.parameter_names if n in text.split("motion:")[1] or n == "l"]
    run = solver.simulate([0.0, 1.9], sensitivities=names, **tight)
    for k, name in enumerate(names):
        h, x = 1e-4, float(solver.parameters[solver.parameter_names.index(name)])
        ends = [solver.simulate([0.0, 1.9], p={name: x + s * h}, **tight).outputs[-1] for s in (1, -1, 2, -2)]
        by = (8 * (ends[0] - ends[1]) - ends[2] + ends[3]) / (12 * h)
        assert np.abs(run.doutputs[k, -1] - by).max() < 1e-8
    wanted = [Final("angle"), Final("motor")]
    forward, adjoint = (solver.judge(1.9, wanted, wrt=names, method=m, **tight) for m in ("forward", "adjoint"))
    assert np.abs(forward.gradients - adjoint.gradients).max() < 1e-11
    assert np.abs(forward.gradients[0] - run.doutputs[:, -1, 2]).max() < 1e-10
