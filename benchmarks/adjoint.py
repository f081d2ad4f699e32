"""Gradients of one functional by 100 parameters: the discrete adjoint against the motion without derivatives.

    python benchmarks/adjoint.py [--rods 25] [--loops 25] [--rounds 5]

A chain of rods hinged alternately about y and x, every rod with its own length, density, radius and damping of its joint; and
a flat ladder of loops (examples/ladder.yaml) with a density and a radius of each bar. A round runs the motion, the motion with
nothing but its functional, and the gradient forward and backwards, one after the other; least times count. C is what the
integrators take, Python is the whole call. The claim is a gradient for at most 5 motions.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from ladders import ladder_text

import codegen
from codegen.runtime import Final

END = 2.0
CLAIM = 5.0


def chain_text(n: int) -> str:
    """A chain whose rods have parameters of their own."""
    parameters, bodies, forces, q, u = [], [], [], [], []
    for k in range(1, n + 1):
        parameters += [
            f"  length_{k}: {{value: {1 - 0.01 * k!r}, unit: m}}", f"  density_{k}: {{value: {1 + 0.02 * k!r}, unit: kg/m}}",
            f"  radius_{k}: {{value: {0.05 + 0.001 * k!r}, unit: m}}", f"  damping_{k}: {{value: 0.05, unit: N m s/rad}}",
        ]  # fmt: skip
        parent, at = ("ground", "0") if k == 1 else (f"link_{k - 1}", f"-length_{k - 1}")
        bodies.append(
            f"  link_{k}:\n    parent: {parent}\n"
            f"    joint: {{type: revolute, axis: {[1 - k % 2, k % 2, 0]}, at: [0, 0, {at}]}}\n"
            f"    shape: {{type: cylinder, axis: z, length: length_{k}, radius: radius_{k}, mass: density_{k}*length_{k}, "
            f"center: [0, 0, -length_{k}/2]}}"
        )
        forces.append(f"  bearing_{k}: {{type: joint, joint: link_{k}, value: -damping_{k}*u.link_{k}}}")
        q.append(f"link_{k}: {0.3 * math.sin(k)!r}")
        u.append(f"link_{k}: {0.2 * math.cos(k)!r}")
    return (
        "model: chain\ngravity: [0, 0, -9.81]\nparameters:\n" + "\n".join(parameters) + "\nbodies:\n" + "\n".join(bodies)
        + "\nforces:\n" + "\n".join(forces) + f"\npoints:\n  tip: {{body: link_{n}, at: [0, 0, -length_{n}]}}\n"
        f"initial: {{q: {{{', '.join(q)}}}, u: {{{', '.join(u)}}}}}\n"
        "outputs:\n  tip_x: {position: tip, axis: x}\n"
    )  # fmt: skip


def ladder_of_parameters(loops: int) -> str:
    """LADDER(loops) whose bars have densities and radii of their own."""
    text = ladder_text(loops)
    bars = ["rung_0", *(f"{bar}_{k}" for k in range(1, loops + 1) for bar in ("rail", "rung"))]
    more = "".join(
        f"  density_{b}: {{value: {1 + 0.01 * i!r}}}\n  radius_{b}: {{value: 0.05}}\n" for i, b in enumerate(bars)
    )
    text = text.replace("max: 5.0}\n", "max: 5.0}\n" + more, 1)
    text = text.replace("density: 1.0, radius: 0.05, ", "")
    first, rest = text.split("  repeat k in 1..L:\n    rail(k):", 1)
    first = first.replace("radius: radius", "radius: radius_rung_0").replace("density*len", "density_rung_0*len")
    bodies, loop = rest.split("\nloops:", 1)
    rail, rung = bodies.split("    rung(k):", 1)
    rail = rail.replace("radius: radius", "radius: radius_rail(k)").replace("density*len", "density_rail(k)*len")
    rung = rung.replace("radius: radius", "radius: radius_rung(k)").replace("density*len", "density_rung(k)*len")
    return f"{first}  repeat k in 1..L:\n    rail(k):{rail}    rung(k):{rung}\nloops:{loop}"


def least(run: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """The least seconds of a call, and what it gave."""
    best, found = np.inf, None
    for _ in range(rounds):
        begins = time.perf_counter()
        found = run()
        best = min(best, time.perf_counter() - begins)
    return best, found


def measure(name: str, text: str, output: str, folder: Path, rounds: int) -> None:
    model = codegen.parse_model(text, name)
    begins = time.perf_counter()
    codegen.generate(model, folder / name, check=False, functions=("motion",))
    solver: Any = codegen.load(folder / name)
    print(f"{name}: {len(model.bodies)} bodies, {len(model.loops)} loops, {solver.np} parameters", end="; ")
    print(f"generated and compiled in {time.perf_counter() - begins:.0f} s")
    wanted, wrt = Final(output), solver.parameter_names
    backwards: list[float] = []
    own = type(solver)._backwards

    def timed(self: Any, *arguments: Any) -> Any:
        begins = time.perf_counter()
        found = own(self, *arguments)
        backwards.append(time.perf_counter() - begins)
        return found

    type(solver)._backwards = timed
    # one after the other in every round, so that a busy machine is so for all of them
    times: dict[str, list[float]] = {n: [] for n in ("motion", "motion in C", "functional", "adjoint", "forward")}
    for _ in range(rounds):
        seconds, found = least(lambda: solver.simulate([0.0, END]), 1)
        times["motion"].append(seconds)
        times["motion in C"].append(found.stats["seconds"])
        times["functional"].append(least(lambda: solver.judge(END, wanted), 1)[0])
        seconds, adjoint = least(lambda: solver.judge(END, wanted, wrt=wrt, method="adjoint"), 1)
        times["adjoint"].append(seconds)
        seconds, forward = least(lambda: solver.judge(END, wanted, wrt=wrt, method="forward"), 1)
        times["forward"].append(seconds)
    type(solver)._backwards = own
    least_of = {n: min(x) for n, x in times.items()} | {"backwards": min(backwards)}
    steps = found.stats["steps"]
    state = solver.nq + len(solver.independent_speed_names)
    size = 8 * (2 + state + 11 * (state + (solver.nq if solver.closure_names else 0)))  # with the states of stages
    error = np.abs(adjoint.gradients - forward.gradients).max() / np.abs(forward.gradients).max()
    in_c = (least_of["motion in C"] + least_of["backwards"]) / least_of["motion in C"]
    called = least_of["adjoint"] / least_of["motion"]
    for n, x in least_of.items():
        print(f"  {n:12} {1e3 * x:9.2f} ms")
    print(f"  gradient by the adjoint: {in_c:.2f} motions in C, {called:.2f} from Python; claimed at most {CLAIM:g}")
    print(f"  forward: {least_of['forward'] / least_of['motion']:.1f} motions; both agree to {error:.1e}")
    counts = adjoint.counts
    print(f"  {steps} steps, {counts['evaluations']} evaluations; back {counts['adjoint_evaluations']}", end=" and ")
    print(f"{counts['adjoint_transposes']} transposes; {steps * size / 2**10:.0f} KiB for steps")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rods", type=int, default=25)
    parser.add_argument("--loops", type=int, default=25)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        measure("chain", chain_text(given.rods), "tip_x", Path(folder), given.rounds)
        measure("ladder", ladder_of_parameters(given.loops), "top_x", Path(folder), given.rounds)


if __name__ == "__main__":
    main()
