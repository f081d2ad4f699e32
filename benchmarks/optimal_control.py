"""Optimal control by `ordernm.casadi.collocation`: exact and quasi-Newton Hessians, one more design parameter, native CasADi.

    python benchmarks/optimal_control.py [--turns 7] [--folder FOLDER]

Problems: the swing-up of a cart-pole, a four-bar and a five-bar leg from rest to rest, with least integral of squared inputs.
Native CasADi gets equations of motion in closed form: for loops the dependent points by intersection of circles, and
Lagrange's equations from energies, differentiated by CasADi; interpreted, and as C code that CasADi writes, compiled with the
options of ordernm. All contestants have the same nonlinear program and IPOPT, and
take turns. Optima are compared, and printed with their differences. An iteration is the least CPU time of a solution by its
number of iterations, as other work on the machine disturbs it least.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import numpy as np

import codegen
from codegen.casadi.functions import OPTIONS
from codegen.casadi.optimal_control import Collocation
from codegen.casadi.optimum import NotSolvedError, Optimum
from codegen.runtime.standalone.files.build import Build

ROOT = Path(__file__).parents[1]
FUNCTIONS = "accelerations,sensitivities,gradients,hessian_products"
GRAVITY = 9.81


def lagrange(
    points: Callable[[Any, Any], list[Any]],
    energies: Callable[[list[Any], list[Any], Any], tuple[Any, Any]],
    n: int,
    n_p: int,
    forces: Callable[[Any, Any, Any], Any],
) -> casadi.Function:
    """``y' = f(y, p, inputs)`` from energies of points, which are functions of n coordinates."""
    q, u, p, inputs = (casadi.SX.sym(*x) for x in (("q", n), ("u", n), ("p", n_p), ("inputs", n)))
    at = points(q, p)
    kinetic, potential = energies(at, [casadi.jtimes(x, q, u) for x in at], p)
    momentum = casadi.gradient(kinetic, u)
    M = casadi.jacobian(momentum, u)
    right = forces(u, p, inputs) + casadi.gradient(kinetic - potential, q) - casadi.jtimes(momentum, q, u)
    udot = right / M if n == 1 else casadi.inv(M) @ right
    y = casadi.vertcat(u, udot)
    return casadi.Function("native", [casadi.vertcat(q, u), p, inputs], casadi.cse([y]))


def bar(ends: tuple[Any, Any], speeds: tuple[Any, Any], mass: Any, more: Any = 0.0) -> tuple[Any, Any]:
    """Energies of a slender bar from its ends; `more` is a further moment of inertia, divided by the squared length."""
    (a, b), (v, w) = ends, speeds
    d = w - v
    kinetic = mass / 6 * (casadi.dot(v, v) + casadi.dot(v, w) + casadi.dot(w, w)) + more / 2 * casadi.dot(d, d)
    return kinetic, mass * GRAVITY * (a[1] + b[1]) / 2


def meeting(a: Any, ra: Any, b: Any, rb: Any, side: float) -> Any:
    """Intersection of two circles."""
    d = b - a
    square = casadi.dot(d, d)
    along = (ra**2 - rb**2 + square) / (2 * square)
    across = casadi.sqrt(ra**2 / square - along**2)
    return a + along * d + side * across * casadi.vertcat(-d[1], d[0])


def arm(length: Any, angle: Any) -> Any:
    return length * casadi.vertcat(casadi.cos(angle), casadi.sin(angle))


def total(parts: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    return sum(k for k, _ in parts), sum(v for _, v in parts)


def native_cart_pole() -> casadi.Function:
    y, p, f = casadi.SX.sym("y", 4), casadi.SX.sym("p", 4), casadi.SX.sym("f")
    m, mp, length, g = casadi.vertsplit(p)
    s, c, w = casadi.sin(y[1]), casadi.cos(y[1]), y[3]
    cart = (f + mp * s * (length * w**2 + g * c)) / (m + mp * s**2)
    pole = -(f * c + mp * length * w**2 * c * s + (m + mp) * g * s) / (length * (m + mp * s**2))
    return casadi.Function("native", [y, p, f], [casadi.vertcat(y[2:], cart, pole)])


def native_four_bar() -> casadi.Function:
    """Parameters: crank, coupler, rocker and base lengths, mass of the coupler, friction."""
    density, radius = 2.4, 0.02

    def points(q: Any, p: Any) -> list[Any]:
        pin = arm(p[0], q)
        return [pin, meeting(pin, p[1], casadi.vertcat(p[3], 0.0), p[2], 1.0)]

    def energies(x: list[Any], v: list[Any], p: Any) -> tuple[Any, Any]:
        still = casadi.SX.zeros(2)
        base, masses = casadi.vertcat(p[3], 0.0), (density * p[0], p[4], density * p[2])
        more = [m * radius**2 / 4 / p[i] ** 2 for i, m in enumerate(masses)]
        ends = ((still, x[0]), (x[0], x[1]), (x[1], base)), ((still, v[0]), (v[0], v[1]), (v[1], still))
        return total([bar(e, s, m, i) for e, s, m, i in zip(*ends, masses, more, strict=True)])

    return lagrange(points, energies, 1, 6, lambda u, p, inputs: inputs - p[5] * u)


def native_leg() -> casadi.Function:
    """Parameters: thigh, shank, width, mass of the foot."""
    density = 1.5

    def points(q: Any, p: Any) -> list[Any]:
        left, right = (casadi.vertcat(side * p[2] / 2, 0.0) + arm(p[0], q[i]) for i, side in enumerate((-1, 1)))
        return [left, right, meeting(left, p[1], right, p[1], -1.0)]

    def energies(x: list[Any], v: list[Any], p: Any) -> tuple[Any, Any]:
        still = casadi.SX.zeros(2)
        hips = [casadi.vertcat(side * p[2] / 2, 0.0) for side in (-1, 1)]
        parts = [bar((hips[i], x[i]), (still, v[i]), density * p[0]) for i in range(2)]
        parts += [bar((x[i], x[2]), (v[i], v[2]), density * p[1]) for i in range(2)]
        return total([*parts, (p[3] / 2 * casadi.dot(v[2], v[2]), p[3] * GRAVITY * x[2][1])])

    return lagrange(points, energies, 2, 4, lambda u, p, inputs: inputs)


def effort(x: Any) -> Any:
    return casadi.sumsqr(x["inputs"])


STILL = {"u.left_thigh": 0.0, "u.right_thigh": 0.0}
PROBLEMS: dict[str, dict[str, Any]] = {
    "cart-pole": {
        "model": "casadi/cart_pole.yaml", "native": native_cart_pole, "duration": 2.0, "segments": 20, "degree": 5,
        "start": {"q.cart": 0.0, "q.pole": 0.0, "u.cart": 0.0, "u.pole": 0.0},
        "end": {"q.cart": 1.0, "q.pole": math.pi, "u.cart": 0.0, "u.pole": 0.0},
        "bounds": {"q.cart": (-2.0, 2.0), "inputs.push": (-20.0, 20.0)},
        "price": 3000.0, "design": {"length": (0.4, 0.6), "pole_mass": (0.25, 0.35), "cart_mass": (0.9, 1.1), "g": (9.7, 9.9)},
    },
    "four-bar": {
        "model": "four_bar.yaml", "native": native_four_bar, "duration": 0.6, "segments": 20, "degree": 4,
        "start": {"q.crank": 0.8, "u.crank": 0.0}, "end": {"q.crank": 3.5, "u.crank": 0.0},
        "design": {"coupler_length": (1.1, 1.3), "rocker_length": (0.85, 0.95), "crank_length": (0.38, 0.42),
                   "base": (1.05, 1.15)},
    },
    "five-bar leg": {
        "model": "casadi/five_bar_leg.yaml", "native": native_leg, "duration": 0.4, "segments": 20, "degree": 4,
        "start": {"q.left_thigh": -2.9, "q.right_thigh": -0.9, **STILL},
        "end": {"q.left_thigh": -2.2, "q.right_thigh": -0.2, **STILL},
        "design": {"thigh": (0.18, 0.22), "shank": (0.33, 0.37), "width": (0.08, 0.12), "foot_mass": (0.25, 0.35)},
    },
}  # fmt: skip


class Native(Collocation):
    """The same nonlinear program with equations of motion written by hand."""

    equations: Callable[[], casadi.Function]

    def _motion(self) -> Any:
        f, names = type(self).equations(), ["y", "p", "inputs"]
        symbols = [casadi.MX.sym(n, f.size1_in(i)) for i, n in enumerate(names)]
        return casadi.Function("native", symbols, [f(*symbols)], names, ["ydot"])


def compiled(f: casadi.Function, folder: Path) -> casadi.Function:
    """The function and its derivatives as C code of CasADi, compiled as ordernm compiles packages."""
    back = f.reverse(1)
    code = casadi.CodeGenerator("native.c")
    for g in (f, f.jacobian(), back, back.jacobian()):
        code.add(g)
    folder.mkdir(parents=True, exist_ok=True)
    code.generate(f"{folder}/")
    build = Build(folder, "native", ["native.c"])
    build.places = [folder]
    return casadi.external("native", str(build.library()), OPTIONS)


def stated(kind: type[Collocation], solver: Any, problem: dict[str, Any], designs: int) -> Collocation:
    """A problem with the first design parameters as variables; a price of their changes keeps the cart-pole near its optimum."""
    design = dict(list(problem["design"].items())[:designs])
    default = dict(zip(solver.parameter_names, solver.parameters, strict=True))

    def price(x: Any) -> Any:
        return problem["price"] * sum((x[f"p.{n}"] / default[n] - 1.0) ** 2 for n in design)

    end_cost = price if "price" in problem else None
    return kind(
        solver, problem["duration"], problem["segments"], problem["degree"], effort, end_cost, None, problem["start"],
        problem["end"], problem.get("bounds", {}), design, None,
    )  # fmt: skip


def outcome(solve: Callable[[], Optimum]) -> Optimum:
    """The optimum, or the last point of a search that found none; its status says so."""
    try:
        return solve()
    except NotSolvedError as error:
        return error.last


def measured(name: str, folder: Path, turns: int) -> list[str]:
    """Rows of one problem."""
    problem = PROBLEMS[name]
    codegen.generate(ROOT / "examples" / problem["model"], folder, compile=False, functions=FUNCTIONS)
    solver = codegen.load(folder)
    native = type("ByHand", (Native,), {"equations": staticmethod(problem["native"])})
    in_c = compiled(problem["native"](), folder.with_name(f"{folder.name}_native"))
    native_in_c = type("ByHandInC", (Native,), {"equations": staticmethod(lambda: in_c)})
    contestants = {
        f"exact, {n} design parameters": (stated(Collocation, solver, problem, n), "exact") for n in (0, 1, 2, 3, 4)
    }
    contestants["quasi-Newton, 2 design parameters"] = stated(Collocation, solver, problem, 2), "limited-memory"
    contestants["native CasADi, exact, 2 design parameters"] = stated(native, solver, problem, 2), "exact"
    contestants["native CasADi compiled, exact, 2 design parameters"] = stated(native_in_c, solver, problem, 2), "exact"
    first = {n: p.prepared(hessian=h) for n, (p, h) in contestants.items()}
    found: dict[str, list[Any]] = {n: [] for n in contestants}
    cpu: dict[str, list[float]] = {n: [] for n in contestants}
    for _ in range(turns):
        for n, solve in first.items():
            began = time.thread_time()
            found[n].append(outcome(solve))
            cpu[n].append(time.thread_time() - began)
    reference = found["exact, 2 design parameters"][0].value
    for n in (n for n in contestants if not n.startswith("exact")):
        off = abs(found[n][0].value - reference) / abs(reference)
        print(f"{name}: {n}: optimum {found[n][0].value:.10g}, {off:.1e} from the exact one", flush=True)
    rows = []
    for n, optima in found.items():
        seconds = np.array([o.seconds for o in optima])
        each = 1e3 * min(cpu[n]) / max(optima[0].iterations, 1)
        rows.append(
            f"| {name} | {n} | {optima[0].value:.8g} | {optima[0].iterations} | {1e3 * seconds.min():.1f} | "
            f"{1e3 * np.median(seconds):.1f} | {each:.2f} | {optima[0].status} |"
        )
    return rows


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--turns", type=int, default=7)
    options.add_argument("--folder", type=Path)
    options.add_argument("--problem", choices=tuple(PROBLEMS), action="append")
    given = options.parse_args()
    lines = [
        "| problem | Hessian | optimum | iterations | least ms | median ms | CPU ms an iteration | status |",
        f"|{' --- |' * 8}",
    ]
    with tempfile.TemporaryDirectory() as temporary:
        for name in given.problem or PROBLEMS:
            lines += measured(name, (given.folder or Path(temporary)) / name.replace(" ", "_"), given.turns)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
