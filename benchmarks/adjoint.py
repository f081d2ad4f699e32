"""Gradients of one functional by many parameters: the discrete adjoint against the motion without derivatives.

    python benchmarks/adjoint.py [--rods 25] [--loops 25] [--rounds 5] [--only chain,ladder,flyball,stiff]

A chain of rods hinged alternately about y and x, every rod with its own length, density, radius and damping of its joint; and
a flat ladder of loops (examples/ladder.yaml) with a density and a radius of each bar. By the implicit method, Radau IIA: the
stiff flyball governor (examples/flyball.yaml) for 10 s, by all its parameters; and the chain with stiff springs and dampers in
all joints but the first two, every rod with its own length, density, stiffness and damping. A round runs the motion, the motion
with nothing but its functional, and the gradient forward and backwards, one after the other; least times count, those of the
processor. C is what the integrators take, Python is the whole call. The claim is a gradient for at most 5 motions.
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
FLYBALL = Path(__file__).parents[1] / "examples" / "flyball.yaml"


def chain_text(n: int, stiff: bool = False) -> str:
    """A chain whose rods have parameters of their own."""
    parameters, bodies, forces, q, u = [], [], [], [], []
    for k in range(1, n + 1):
        parameters += [
            f"  length_{k}: {{value: {1 - 0.01 * k!r}, unit: m}}", f"  density_{k}: {{value: {1 + 0.02 * k!r}, unit: kg/m}}",
            f"  damping_{k}: {{value: {2e3 if stiff and k > 2 else 0.05!r}, unit: N m s/rad}}",
            f"  stiffness_{k}: {{value: {2e4 if k > 2 else 1.0!r}, unit: N m/rad}}" if stiff
            else f"  radius_{k}: {{value: {0.05 + 0.001 * k!r}, unit: m}}",
        ]  # fmt: skip
        parent, at = ("ground", "0") if k == 1 else (f"link_{k - 1}", f"-length_{k - 1}")
        bodies.append(
            f"  link_{k}:\n    parent: {parent}\n"
            f"    joint: {{type: revolute, axis: {[1 - k % 2, k % 2, 0]}, at: [0, 0, {at}]}}\n"
            f"    shape: {{type: cylinder, axis: z, length: length_{k}, radius: {0.05 if stiff else f'radius_{k}'}, "
            f"mass: density_{k}*length_{k}, "
            f"center: [0, 0, -length_{k}/2]}}"
        )
        spring = f" - stiffness_{k}*q.link_{k}" if stiff else ""
        forces.append(f"  bearing_{k}: {{type: joint, joint: link_{k}, value: -damping_{k}*u.link_{k}{spring}}}")
        q.append(f"link_{k}: {(1e-3 if stiff and k > 2 else 0.3) * math.sin(k)!r}")
        u.append(f"link_{k}: {0.0 if stiff else 0.2 * math.cos(k)!r}")
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
        begins = time.process_time()
        found = run()
        best = min(best, time.process_time() - begins)
    return best, found


def measure(
    name: str, text: str, output: str, folder: Path, rounds: int,
    end: float = END, integrator: str = "dop853", tolerance: float = 1e-9,
) -> None:  # fmt: skip
    model = codegen.parse_model(text, name)
    begins = time.perf_counter()
    codegen.generate(model, folder / name, check=False, functions=("motion",))
    solver: Any = codegen.load(folder / name)
    print(
        f"{name}: {len(model.bodies)} bodies, {len(model.loops)} loops, {solver.np} parameters, {integrator}", end="; "
    )
    print(f"generated and compiled in {time.perf_counter() - begins:.0f} s")
    wanted, accuracy = Final(output), {"rtol": tolerance, "atol": tolerance}
    judged = {"integrator": integrator, **accuracy}
    gradient = {"wrt": solver.parameter_names, **judged}
    in_c: dict[str, list[float]] = {"_segment": [], "_backwards": []}
    own = {of: getattr(type(solver), of) for of in in_c}

    def timed(of: str) -> Callable[..., Any]:
        def call(self: Any, *arguments: Any) -> Any:
            begins = time.process_time()
            found = own[of](self, *arguments)
            in_c[of].append(time.process_time() - begins)
            return found

        return call

    for of in in_c:
        setattr(type(solver), of, timed(of))
    # one after the other in every round, so that a busy machine is so for all of them
    runs: dict[str, Callable[[], Any]] = {
        "motion": lambda: solver.simulate([0.0, end], method=integrator, **accuracy),
        "functional": lambda: solver.judge(end, wanted, **judged),
        "adjoint": lambda: solver.judge(end, wanted, method="adjoint", **gradient),
        "forward": lambda: solver.judge(end, wanted, method="forward", **gradient),
    }
    times: dict[str, list[float]] = {n: [] for n in (*runs, "motion in C", "kept in C")}
    for _ in range(rounds):
        for n, run in runs.items():
            before = len(in_c["_segment"])
            seconds, found = least(run, 1)
            times[n].append(seconds)
            if n == "motion":
                times["motion in C"].append(sum(in_c["_segment"][before:]))
                steps = found.stats["steps"]
            elif n == "adjoint":
                # whose motion keeps its steps
                times["kept in C"].append(sum(in_c["_segment"][before:]))
                adjoint = found
    forward = found
    for of, method in own.items():
        setattr(type(solver), of, method)
    least_of = {n: min(x) for n, x in times.items()} | {"backwards": min(in_c["_backwards"])}
    state = solver.nq + len(solver.independent_speed_names)
    stages = 3 * state if integrator == "radau" else 11 * (state + (solver.nq if solver.closure_names else 0)) + state
    error = np.abs(adjoint.gradients - forward.gradients).max() / np.abs(forward.gradients).max()
    back = (least_of["kept in C"] + least_of["backwards"]) / least_of["motion in C"]
    called = least_of["adjoint"] / least_of["motion"]
    for n, x in least_of.items():
        print(f"  {n:12} {1e3 * x:9.2f} ms")
    print(f"  gradient by the adjoint: {back:.2f} motions in C, {called:.2f} from Python; claimed at most {CLAIM:g}")
    print(f"  forward: {least_of['forward'] / least_of['motion']:.1f} motions; both agree to {error:.1e}")
    counts = adjoint.counts
    print(f"  {steps} steps, {counts['evaluations']} evaluations; back {counts['adjoint_evaluations']}", end=" and ")
    print(
        f"{counts['adjoint_transposes']} transposes; {counts['steps'] * 8 * (4 + state + stages) / 2**10:.0f} KiB for steps"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rods", type=int, default=25)
    parser.add_argument("--loops", type=int, default=25)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="chain,ladder,flyball,stiff")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        os.environ["XDG_CACHE_HOME"] = made
        folder, rounds, only = Path(made), given.rounds, given.only.split(",")
        if "chain" in only:
            measure("chain", chain_text(given.rods), "tip_x", folder, rounds)
        if "ladder" in only:
            measure("ladder", ladder_of_parameters(given.loops), "top_x", folder, rounds)
        if "flyball" in only:
            measure("flyball", FLYBALL.read_text(), "height", folder, rounds, 10.0, "radau", 1e-8)
        if "stiff" in only:
            measure("stiff", chain_text(given.rods, stiff=True), "tip_x", folder, rounds, END, "radau", 1e-7)


if __name__ == "__main__":
    main()
