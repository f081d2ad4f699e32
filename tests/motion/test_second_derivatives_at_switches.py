"""Hessians of motions across forces that jump or have a kink: closed forms, symmetry, differences of gradients."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from motion.models import driven
from motion.test_random_switches import END, MOST, drawn
from motion.test_second_derivatives import same_as_differences
from motion.test_switches import JUMPS, METHODS, NAMES
from motions import crank_driven_by_its_piston

import codegen
from codegen.runtime import At, AtEvent, Event, Final, Integral, LeastSquares, PackageError, SimulationError

FUNCTIONS = "motion,hessian_products,output_hessian_products"
TIGHT = {"rtol": 1e-13, "atol": 1e-13}


def solver_of(text: str, folder: Path, functions: str = FUNCTIONS) -> codegen.Solver:
    codegen.generate(codegen.parse_model(text), folder, functions=functions, check=False)
    return codegen.load(folder)


@pytest.fixture(scope="module")
def jumping(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return solver_of(JUMPS, tmp_path_factory.mktemp("jumping") / "package")


def closed_forms() -> tuple[dict[str, Any], dict[Any, float]]:
    """Results of `JUMPS` at t = 1 s by `NAMES`, and the values of these."""
    t0, x0, s, v0, mu, w, h, k = x = sympy.symbols(NAMES)
    t1, t2, r = sympy.sqrt((x0 - s) / 6), v0 / (w + mu), sympy.sqrt(k)
    onto = sympy.sqrt((x0 - h) / 5)
    off = onto + 2 * (sympy.pi - sympy.atan2(10 * onto / r, 10 / k)) / r
    found = {
        "timed": t0**2 / 2 + t0 * (1 - t0),
        "band": s - 12 * t1 * (1 - t1) - 3 * (1 - t1) ** 2,
        "slope": v0 * t2 / 2 - (w - mu) / 2 * (1 - t2) ** 2,
        "kink": h + 10 * onto * (1 - off) - 5 * (1 - off) ** 2,
        "high": t1 + 3 * (1 - t1),
    }
    return found, dict(zip(x, (0.7, 1.0, 0.5, 3.0, 2.0, 5.0, 0.4, 200.0), strict=True))


@pytest.mark.parametrize("options", METHODS, ids=["dop853", "dop853 loose", "radau", "radau loose", "rk4"])
def test_closed_forms(jumping: codegen.Solver, options: dict[str, Any]) -> None:
    formulas, at = closed_forms()
    names, x = list(formulas), list(at)
    wanted = [Final(n) if n != "high" else Integral(n) for n in names]
    found = jumping.judge(1.0, wanted, inputs=[0.0], wrt=NAMES, hessian=True, **options)
    of_rk4 = options.get("integrator") == "rk4"
    tolerance = 1e-6 if of_rk4 else 1000 * options.get("rtol", 1e-9)
    for name, hessian in zip(names, found.hessian_products, strict=True):
        exact = np.array(sympy.hessian(formulas[name], x).subs(at).evalf(20), float)
        size = np.abs(exact).max(axis=1)  # of each parameter
        np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-13 * size.max(), err_msg=name)
        scale = np.sqrt(np.outer(size, size)) + 1e-3 * size.max()
        assert (np.abs(hessian - exact) < tolerance * scale).all(), (name, hessian - exact)


def test_repeated_steps_give_the_same(jumping: codegen.Solver) -> None:
    """With little memory, steps and the states before switches are computed again for each functional."""
    wanted = [Final("kink"), Integral("high"), Final("band")]
    plain, short = (
        jumping.judge(1.0, wanted, inputs=[0.0], wrt=NAMES, hessian=True, memory=memory).hessian_products
        for memory in (2**28, 20000)
    )
    np.testing.assert_allclose(short, plain, rtol=0, atol=1e-12 * np.abs(plain).max())


FOLLOWED = """
model: followed
parameters: {k: 40.0, ks: 300.0, gain: 1.3, m: 1.5}
inputs: [level]
gravity: [0, 0, -2]
bodies:
  slider: {parent: ground, joint: {type: prismatic, axis: x}, mass: m}
  bob: {parent: slider, joint: {type: revolute, axis: y}, mass: 0.7, com: [0, 0, -0.4], inertia: {yy: 0.02}}
forces:
  spring: {type: joint, joint: slider, value: "-k*q.slider - if(q.slider > gain*level, ks*(q.slider - level) + 4, 0)"}
  brake: {type: joint, joint: bob, value: "-0.3*abs(u.bob)*u.bob - 0.05*sign(u.bob - level)"}
outputs:
  x: {value: q.slider}
  tip: {value: q.slider - 0.4*sin(q.bob)}
  power: {value: "level*u.slider*max(0, q.slider)"}
  pull: {acceleration: bob, axis: x}
"""
WRT = ("k", "ks", "gain", "m", "q0.slider", "u0.slider", "u0.bob", *(f"inputs.level[{i}]" for i in range(4)))


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_switches_that_follow_an_input(tmp_path: Path, method: str) -> None:
    """The level of a switch is a spline of time: its rate and second derivative count, too."""
    solver = solver_of(FOLLOWED, tmp_path / "package")
    samples = LeastSquares([0.31, 0.63, 0.9], {"x": [0.1, 0.2, 0.1], "tip": [0.3, 0.1, 0.2]}, sigma=0.1)
    wanted = [Final("x"), At("tip", 0.8), Integral("power"), Integral("pull"), samples]

    def judge(x: np.ndarray, **more: Any) -> Any:
        inputs = (np.linspace(0.0, 1.0, 4), x[7:], "cubic")
        p = dict(zip(WRT[:4], x[:4], strict=True))
        return solver.judge(
            1.0, wanted, [x[4], 0.2], x[5:7], p, inputs, wrt=WRT, integrator=method, rtol=1e-12, atol=1e-12, **more
        )

    x = np.array([40.0, 300.0, 1.3, 1.5, 0.02, 2.0, 1.2, 0.1, 0.25, 0.05, 0.2])
    same_as_differences(judge, x, 1e-3 * np.maximum(x, 0.1), 2e-8, 1e-11)


TURNING = """
model: turning
parameters: {k: 5.0, c: 0.2, rest: 0.3, m: 1.4}
gravity: [0, -2, -1]
bodies:
  wheel: {parent: ground, joint: {type: revolute, axis: z}, mass: m, com: [0.1, 0, 0.1], inertia: {xx: 1, yy: 1, zz: 1}}
  vane: {parent: wheel, joint: {type: revolute, axis: x, at: [0.2, 0, 0]}, mass: 0.5, com: [0, 0.1, 0.2], inertia: {xx: 0.1}}
forces:
  spring: {type: torsion, from: ground, to: wheel, axis: z, stiffness: k, damping: c, free_angle: rest}
  slanted: {type: torsion, from: ground, to: {body: vane, rpy: [0, 0, 0.4]}, axis: [1, 0, 3], stiffness: 0.3*k}
  hinge: {type: joint, joint: vane, value: -2*q.vane}
outputs:
  wheel: {value: q.wheel}
  vane: {value: q.vane}
  angle: {value: q.wheel*u.vane}
initial: {q: {wheel: 2.0}, u: {wheel: 10.0, vane: 0.5}}
"""


def test_torsion_springs_beyond_half_a_turn(tmp_path: Path) -> None:
    """Their torques jump there; the second one passes half a turn about an axis that tilts."""
    solver = solver_of(TURNING, tmp_path / "package")
    wanted = [Final("wheel"), Final("vane"), At("angle", 0.35), Integral("vane")]
    wrt = (*solver.parameter_names, "q0.wheel", "u0.wheel", "u0.vane")

    def judge(x: np.ndarray, **more: Any) -> Any:
        p = dict(zip(wrt[:4], x[:4], strict=True))
        return solver.judge(0.6, wanted, [x[4], 0.0], x[5:], p, wrt=wrt, rtol=1e-12, atol=1e-12, **more)

    x = np.array([5.0, 0.2, 0.3, 1.4, 2.0, 10.0, 0.5])
    hessians = same_as_differences(judge, x, 1e-3 * np.maximum(x, 0.1), 1e-9, 1e-11)
    of_radau = judge(x, hessian=True, integrator="radau").hessian_products
    assert (np.abs(of_radau - hessians).max(axis=(1, 2)) < 1e-8 * np.abs(hessians).max(axis=(1, 2))).all()


BALL = """
model: ball
parameters: {k: 900.0, c: 2.0, r: 0.05, push: 3.0}
gravity: [0, 0, -9.81]
bodies:
  ball: {parent: ground, joint: {type: free}, mass: 0.4, com: [0.01, 0, 0.02], inertia: {xx: 2e-3, yy: 3e-3, zz: 1e-3}}
points: {side: {body: ball, at: [0.03, 0.01, -0.02]}}
forces:
  floor: {type: force, on: side, value: ["-c*velocity.side.x*if(position.side.z < r, 1, 0)", 0, "k*max(0, r - position.side.z)"]}
  wind: {type: force, on: side, value: ["if(position.side.x > 0.1, push, 0)", 0, 0]}
initial: {q: {ball.qw: 1, ball.pz: 0.12}, u: {ball.vx: 1.0, ball.wx: 3.0, ball.wy: -2.0}}
outputs:
  side: {position: side, axis: z}
  away: {position: side, axis: x}
"""


def test_a_body_with_a_quaternion(tmp_path: Path) -> None:
    solver = solver_of(BALL, tmp_path / "package", "motion,hessian_products,coordinate_rate_hessian_products")
    wrt = (*solver.parameter_names, "u0.ball.vx", "u0.ball.wx")

    def judge(x: np.ndarray, **more: Any) -> Any:
        u = {wrt[4][3:]: x[4], wrt[5][3:]: x[5]}
        p = dict(zip(wrt[:4], x[:4], strict=True))
        wanted = [Final("side"), Final("away"), At("side", 0.21)]
        return solver.judge(0.3, wanted, u=u, p=p, wrt=wrt, **TIGHT, **more)

    x = np.array([900.0, 2.0, 0.05, 3.0, 1.0, 3.0])
    same_as_differences(judge, x, np.array([1.0, 1e-3, 5e-5, 1e-3, 1e-3, 3e-3]), 1e-7, 1e-11)


def test_loops_whose_independents_change(tmp_path: Path) -> None:
    """The pressure on a piston has a kink and jumps, before and after the dead point of the crank."""
    solver = crank_driven_by_its_piston(tmp_path, FUNCTIONS, "(max(q.piston - 0.5, 0) + 0.1*if(q.piston > 0.45, 1, 0))")
    wanted = [Final("stroke"), At("speed", 0.11), Integral("kinetic"), At("stroke", 0.333)]
    wrt = ("crank_length", "rod_length", "offset", "q0.piston", "u0.piston", "inputs.load")
    q0, u0 = solver.initial_state()
    place = solver.coordinate_names.index("piston")

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip(wrt[:3], x[:3], strict=True)), q0.copy(), u0.copy()
        q[place], u[place] = x[3:5]
        q, u = solver.assemble(q, u, p)
        found = solver.judge(0.4, wanted, q, u, p, [x[5]], wrt=wrt, rtol=1e-12, atol=1e-12, **more)
        assert found.counts["partitions_changed"] == 1
        return found

    x = np.array([*solver.parameters[:3], q0[place], u0[place], 20.0])
    same_as_differences(judge, x, 2e-4 * np.maximum(np.abs(x), 0.1), 1e-6, 1e-9)


def test_an_event_after_a_switch(jumping: codegen.Solver) -> None:
    e = Event("band", 0.1)
    _, x0, s, *_ = x = sympy.symbols(NAMES)
    t1 = sympy.sqrt((x0 - s) / 6)
    v, d = 12 * t1, s - sympy.Rational(1, 10)  # then d = v t + 3 t^2
    time = t1 + (sympy.sqrt(v**2 + 12 * d) - v) / 6
    found = jumping.judge(1.0, AtEvent("t", e), inputs=[0.0], wrt=NAMES, hessian=True, **TIGHT).hessian_products[0]
    exact = np.array(sympy.hessian(time, x).subs(closed_forms()[1]).evalf(20), float)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def falling(law: str, folder: Path, start: str = "q: {stone: 1.0}", functions: str = FUNCTIONS) -> codegen.Solver:
    codegen.generate(driven("1.0", law, start)[0], folder, functions=functions, check=False)
    return codegen.load(folder)


BEGIN = r"hessian: at t = 0\.\d+ s"


@pytest.mark.parametrize(
    ("law", "wanted", "message"),
    [
        ("-9.81*a + 100*max(0, 0.5 - q.stone)**1.5", Final("z"), f"{BEGIN} the base of a root or power"),
        ("-9.81*a + 100*max(0, 0.5 - q.stone)", At("z", (1.0 / 9.81) ** 0.5), f"{BEGIN}, where an output is requested"),
        ("-9.81*a + 5*sign(0.5 - q.stone) + sign(u.stone + 13.81**0.5)", Final("z"), "the same time as another switch"),
        (
            "-9.81*a + 100*max(0, 1 - q.stone)",
            Final("z"),
            "hessian: the motion begins where .* second derivatives jump",
        ),
    ],
    ids=["power", "sample", "together", "begin"],
)
def test_refusals(tmp_path: Path, law: str, wanted: Any, message: str) -> None:
    solver = falling(law, tmp_path / "package")
    with pytest.raises(ValueError, match=message):
        solver.judge(0.6, wanted, wrt=("a", "q0.stone"), hessian=True)


def test_two_switches_with_one_function(tmp_path: Path) -> None:
    """They are passed at the same time in every motion, so their order does not matter."""
    laws = ("10*sign(0.5 - q.stone)", "4*sign(0.5 - q.stone) + 6*sign(2 - 4*q.stone)")
    one, two = (
        falling(f"-9.81*a + {law}", tmp_path / str(n)).judge(0.6, Final("z"), wrt=("a", "u0.stone"), hessian=True)
        for n, law in enumerate(laws)
    )
    assert np.abs(one.hessian_products).max() > 0.01
    np.testing.assert_allclose(two.hessian_products, one.hessian_products, rtol=1e-9)


def test_integrals_need_products_of_outputs(tmp_path: Path) -> None:
    solver = falling("-9.81*a + 100*max(0, 0.5 - q.stone)", tmp_path / "package", functions="motion,hessian_products")
    with pytest.raises(PackageError, match=r"generate the package with --functions '.*output_hessian_products'"):
        solver.judge(0.6, Integral("z"), wrt="a", hessian=True)
    assert np.isfinite(solver.judge(0.6, Final("z"), wrt="a", hessian=True).hessian_products).all()


REASONS = (
    "hessian: ", "the motion ends at t = ", "a switch comes or goes in between", "after 3000 steps", "is not finite"
)  # fmt: skip
"""Why a drawn motion has nothing to compare; messages of refusals and of motions that end."""


def compare(seed: int, folder: Path) -> str:
    """Compares a Hessian product with differences of gradients; returns why there is none."""
    try:
        solver, q, p, names = drawn(seed, folder, f"{FUNCTIONS},coordinate_rate_hessian_products")
        wanted = [*(Final(o) for o in solver.output_names), *(Integral(o) for o in solver.output_names[:1])]

        def judge(p: np.ndarray, **more: Any) -> Any:
            return solver.judge(
                END,
                wanted,
                q,
                p=p,
                inputs=[0.0] * solver.ninputs,
                most_steps=MOST,
                wrt=names,
                method="adjoint",
                **TIGHT,
                **more,
            )

        rng = np.random.default_rng(seed)
        v = rng.normal(size=len(names))
        places = [solver.parameter_names.index(n) for n in names]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = judge(p, hessian=v)
    except (SimulationError, ValueError) as error:
        assert isinstance(error, SimulationError) or str(error).startswith("hessian: ")
        return str(error)
    product = found.hessian_products[:, 0]
    scale = 1.0 + np.abs(product)

    def differences(size: float) -> np.ndarray:
        sides = []
        for n in (1, -1, 2, -2):
            moved = p.copy()
            moved[places] += n * size * v
            sides.append(judge(moved).gradients)
        return (8 * (sides[0] - sides[1]) - (sides[2] - sides[3])) / (12 * size)

    try:
        coarse, fine = differences(2e-5), differences(5e-6)
    except SimulationError as error:
        return str(error)
    if not (np.abs(coarse - fine) / scale < 1e-5).all():
        return "a switch comes or goes in between"
    error = (np.abs(fine - product) / scale).max()
    assert error < 1e-5, (seed, error)
    return ""


@pytest.mark.parametrize("seed", [2, 3])
def test_random_switches(tmp_path: Path, seed: int) -> None:
    assert compare(seed, tmp_path) == ""


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(2000, 2100))
def test_campaign_of_switches(tmp_path: Path, seed: int) -> None:
    reason = compare(seed, tmp_path)
    assert not reason or any(words in reason for words in REASONS), reason
