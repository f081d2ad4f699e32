"""Newton's method with exact Hessian products beside methods that need gradients only: motions, wall time, and optima.

    python benchmarks/newton.py [--problems swing_up,path_synthesis,excavator_lift] [--folder FOLDER]

The problems are those of examples/ with the same name. With their bounds and constraints, SLSQP or L-BFGS-B compete with
trust-constr, whose Hessians are SciPy's approximations or exact. Without bounds, and with the constraints as penalties,
L-BFGS-B competes with trust-krylov, which is Newton's method. All contestants of a group start at the same point. A motion with
its gradient counts as one motion, and so does a motion with its Hessian, which takes longer.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ordernm
from ordernm.runtime import LeastSquares

EXAMPLES = Path(__file__).parents[1] / "examples"
sys.path.insert(0, str(EXAMPLES))

FUNCTIONS = "motion,hessian_products,output_hessian_products,jacobians,accelerations"
MODELS = {"swing_up": "swing_up", "path_synthesis": "coupler", "excavator_lift": "excavator"}
Problem = Callable[[Any], tuple[ordernm.Objective, list[Any]]]
Search = tuple[str, str, Problem, dict[str, Any]]


def without_bounds(f: ordernm.Objective, functionals: list[Any], weights: list[float]) -> ordernm.Objective:
    """The objective of other functionals, with the motion and the scales of f and without its bounds."""
    v = f.variables
    start = v.motion(f.x0, derivatives=False)
    free = {name: ordernm.Variable(scale=scale) for name, scale in zip(v.names, v.scale.tolist(), strict=True)}
    options = {name: value for name, value in f._options.items() if name != "method"}
    return ordernm.objective(
        f.solver, (f.start, f.end), functionals, free, weights=weights, q=v._q or None, u=v._u or None, p=start["p"],
        inputs=v._inputs, **options,
    )  # fmt: skip


def swing_up() -> list[Search]:
    from swing_up import AIM, SECONDS, swing_up_problem

    def constrained(s: Any) -> tuple[ordernm.Objective, list[Any]]:
        f, there = swing_up_problem(s)
        return f, [there]

    def penalty(s: Any) -> tuple[ordernm.Objective, list[Any]]:
        f, _ = swing_up_problem(s)
        aim = LeastSquares([SECONDS], {name: [value] for name, value in AIM.items()}, sigma=0.01)
        return without_bounds(f, [f._functionals[0], aim], [0.02, 1.0]), []

    return searches(constrained, penalty, "SLSQP")


def path_synthesis() -> list[Search]:
    from path_synthesis import path_objective

    def bounded(s: Any) -> tuple[ordernm.Objective, list[Any]]:
        return path_objective(s), []

    def free(s: Any) -> tuple[ordernm.Objective, list[Any]]:
        f = path_objective(s)
        return without_bounds(f, f._functionals, [1.0]), []

    return searches(bounded, free, "L-BFGS-B")


def excavator_lift() -> list[Search]:
    from excavator_lift import PLACE, SECONDS, lift_problem

    def penalty(s: Any) -> tuple[ordernm.Objective, list[Any]]:
        f, _ = lift_problem(s)
        place = LeastSquares([SECONDS], {n: [x] for n, x in PLACE.items()} | {"kinetic": [0.0]},
                             sigma=dict.fromkeys(PLACE, 0.05) | {"kinetic": 500.0})  # fmt: skip
        return without_bounds(f, [f._functionals[0], place], [1e-4, 1.0]), []

    return searches(lift_problem, penalty, "SLSQP")


def searches(bounded: Problem, free: Problem, today: str) -> list[Search]:
    """Contestants: group, method, problem, options."""
    return [
        ("bounds", today, bounded, {"maxiter": 400}),
        ("bounds", "trust-constr", bounded, {"maxiter": 400}),
        ("bounds", "trust-constr", bounded, {"maxiter": 400, "hessian": True}),
        ("free", "L-BFGS-B", free, {"maxiter": 1000, "ftol": 1e-13, "gtol": 1e-6}),
        ("free", "trust-krylov", free, {"maxiter": 400, "gtol": 1e-6}),
    ]


SEARCHES = {"swing_up": swing_up, "path_synthesis": path_synthesis, "excavator_lift": excavator_lift}


def compete(solver: Any, search: Search) -> str:
    """A row of the table."""
    group, method, problem, options = search
    f, constraints = problem(solver)
    name = f"{method}, exact" if options.get("hessian") or method == "trust-krylov" else method
    began = time.perf_counter()
    try:
        found = ordernm.optimize(f, method, constraints=constraints, **options)
    except ValueError as error:
        return f"| {group} | {name} | refused: {error} | | | | |"
    seconds = time.perf_counter() - began
    curved = f.motions - len(f.history)
    slope = f"{np.abs(f.gradient(found.x)).max():.1e}" if not constraints else ""
    missed = max(
        (float(np.maximum(c.lb - c.fun(found.x), c.fun(found.x) - c.ub).max()) for c in constraints), default=0.0
    )
    miss = f"{max(missed, 0.0):.1e}" if constraints else ""
    return f"| {group} | {name} | {f.motions} | {curved} | {seconds:.1f} | {found.fun:.8g} | {slope}{miss} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", default=",".join(MODELS))
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    folder = given.folder or Path(tempfile.mkdtemp())
    for name in given.problems.split(","):
        if name not in MODELS:
            parser.error(f"problem {name!r}; allowed are {', '.join(MODELS)}")
        place = folder / MODELS[name]
        if not place.is_dir():
            ordernm.generate(EXAMPLES / f"{MODELS[name]}.yaml", place, functions=FUNCTIONS)
        solver = ordernm.load(place)
        print(
            f"\n{name}\n\n| problem | method | motions | with Hessian | s | value | gradient, or miss of constraints |"
        )
        print("| --- | --- | --- | --- | --- | --- | --- |", flush=True)
        for search in SEARCHES[name]():
            print(compete(solver, search), flush=True)


if __name__ == "__main__":
    main()
