"""A chain of n rods on hinges: from a `System` of `sympy.physics.mechanics` to accelerations, by sympy and by ordernm.

Sympy forms the equations of motion by Kane's method and turns them into a function, by `lambdify` with common subexpressions
or by `autowrap` (C, needs Cython); NumPy solves for the accelerations. ordernm reads the same object and generates C. For each
the seconds from the finished `System` to the first accelerations, and the time of one more evaluation from Python, the fastest
of many; for ordernm also that of the accelerations with their derivatives by all parameters. Every contestant runs alone in a
process of its own, and is stopped after `--limit` seconds; both are compared at a random state.

    python benchmarks/against_sympy.py [--sizes 2 3 5 8 12 16 20] [--limit 300]
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import codegen
from codegen.measure.clock import calibrated, one_core
from codegen.measure.tables import markdown, seconds

CONTESTANTS = ("lambdify", "autowrap", "ordernm")
TURNS = 20
Result = dict[str, Any]


def rods(n: int) -> tuple[Any, dict[Any, float]]:
    """n rods in a plane, each with its length and mass."""
    import sympy
    from sympy.physics.mechanics import PinJoint, RigidBody, System, inertia

    g = sympy.Symbol("g")
    lengths, masses = sympy.symbols(f"l:{n}"), sympy.symbols(f"m:{n}")
    last = RigidBody("ceiling")
    system, at = System.from_newtonian(last), last.masscenter
    for k, (l, m) in enumerate(zip(lengths, masses, strict=True)):
        rod = RigidBody(f"rod{k}", mass=m)
        rod.central_inertia = inertia(rod.frame, 0, 0, m * l**2 / 12)
        joint = PinJoint(f"hinge{k}", last, rod, joint_axis=last.z, parent_point=at, child_point=l / 2 * rod.y)
        system.add_joints(joint)
        last, at = rod, rod.masscenter.locatenew(f"end{k}", -l / 2 * rod.y)
    system.apply_uniform_gravity(-g * system.y)
    values = {l: 1 + k / 100 for k, l in enumerate(lengths)} | {m: 2 - k / 50 for k, m in enumerate(masses)}
    return system, {**values, g: 9.81}


def state(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and speeds."""
    rng = np.random.default_rng(n)
    return rng.normal(size=n), rng.normal(size=n)


def fastest(run: Callable[[], object]) -> float:
    """Seconds of one call, the least of several turns."""
    timed = calibrated(run, 5e-3)
    return min(timed() for _ in range(TURNS))


def by_sympy(n: int, how: str) -> Result:
    """Kane's equations as a function."""
    import sympy
    from sympy.utilities.autowrap import autowrap

    system, values = rods(n)
    q, u = state(n)
    start = time.perf_counter()
    system.form_eoms()
    arguments = [*system.q, *system.u, *values]
    numbers = [*map(float, (*q, *u, *values.values()))]
    if how == "lambdify":
        function = sympy.lambdify(arguments, [system.mass_matrix, system.forcing], cse=True)
    else:
        plain = sympy.symbols(f"x:{len(arguments)}", real=True)
        both = system.mass_matrix.row_join(system.forcing).xreplace(dict(zip(arguments, plain, strict=True)))
        whole = autowrap(both, backend="cython", args=plain)

        def function(*x: float) -> tuple[np.ndarray, np.ndarray]:
            found = np.asarray(whole(*x))
            return found[:, :-1], found[:, -1:]

    def accelerations() -> np.ndarray:
        mass, forcing = function(*numbers)
        return np.linalg.solve(mass, forcing)[:, 0]

    found = accelerations()
    return {"first": time.perf_counter() - start, "udot": found, "each": fastest(accelerations)}


def by_ordernm(n: int, how: str) -> Result:
    """The same object, read and generated."""
    del how
    system, values = rods(n)
    q, u = state(n)
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        codegen.generate(codegen.from_sympy(system, values).model, Path(folder) / "rods")
        solver = codegen.load(Path(folder) / "rods")
        found = solver.accelerations(q, u)
        first = time.perf_counter() - start
        each = fastest(lambda: solver.accelerations(q, u))
        seeds = np.eye(2 * n + 1)
        with_derivatives = fastest(lambda: solver.sensitivities(q, u, dp=seeds))
    return {"first": first, "udot": found, "each": each, "derivatives": with_derivatives}


def _run(name: str, n: int, results: Any) -> None:
    with one_core():
        results.put(by_ordernm(n, name) if name == "ordernm" else by_sympy(n, name))


def measured(name: str, n: int, limit: float) -> Result | None:
    """The result of a process of its own; None after the limit, or where it fails."""
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    process = context.Process(target=_run, args=(name, n, results))
    process.start()
    end = time.monotonic() + limit
    found: Result | None = None
    while found is None and process.is_alive() and time.monotonic() < end:
        process.join(0.2)
        found = None if results.empty() else results.get()
    found = results.get() if found is None and not results.empty() else found
    if process.is_alive():
        process.terminate()
    process.join()
    return found


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[2, 3, 5, 8, 12, 16, 20])
    parser.add_argument("--limit", type=float, default=300.0, help="seconds after which a contestant is stopped")
    chosen = parser.parse_args()
    rows, stopped = [], set()
    for n in chosen.sizes:
        row: list[Any] = [n]
        found = {name: None if name in stopped else measured(name, n, chosen.limit) for name in CONTESTANTS}
        stopped |= {name for name, result in found.items() if result is None}
        for name in CONTESTANTS:
            result = found[name]
            row += ["-", "-"] if result is None else [f"{result['first']:.3g} s", seconds(result["each"])]
        ours = found["ordernm"]
        if ours is not None:
            row.append(seconds(ours["derivatives"]))
            known = [f["udot"] for f in found.values() if f is not None]
            worst = max(float(np.abs(x - ours["udot"]).max() / np.abs(ours["udot"]).max()) for x in known)
            row.append(f"{worst:.1e}")
        rows.append(row)
        print(markdown(HEAD, [row]) if n == chosen.sizes[0] else "| " + " | ".join(map(str, row)) + " |", flush=True)


HEAD = [
    "n", *(f"{name}, {what}" for name in CONTESTANTS for what in ("first", "each")), "with all derivatives", "difference",
]  # fmt: skip

if __name__ == "__main__":
    main()
