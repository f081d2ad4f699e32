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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import codegen
from codegen.measure.accuracy import relative
from codegen.measure.clock import elapsed, in_rounds
from codegen.measure.models import example, text_of
from codegen.runtime import Final
from codegen.runtime.standalone.motion.functional_gradients import FunctionalGradients
from codegen.runtime.standalone.motion.run import MotionRun

END = 2.0
CLAIM = 5.0


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
    text = text_of("LADDER", loops)
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


@contextmanager
def watched(kind: type, name: str) -> Iterator[list[float]]:
    """CPU seconds of each call of a method, meanwhile."""
    seconds: list[float] = []
    own = getattr(kind, name)

    def call(*arguments: Any) -> Any:
        begins = time.process_time()
        found = own(*arguments)
        seconds.append(time.process_time() - begins)
        return found

    with patch.object(kind, name, call):
        yield seconds


def runs_of(solver: Any, output: str, end: float, integrator: str, tolerance: float) -> dict[str, Callable[[], Any]]:
    """The motion, the motion with its functional, and its gradient by both ways."""
    wanted, accuracy = Final(output), {"rtol": tolerance, "atol": tolerance}
    judge = partial(solver.judge, end, wanted, integrator=integrator, **accuracy)
    return {
        "motion": lambda: solver.simulate([0.0, end], method=integrator, **accuracy), "functional": judge,
        "adjoint": partial(judge, method="adjoint", wrt=solver.parameter_names),
        "forward": partial(judge, method="forward", wrt=solver.parameter_names),
    }  # fmt: skip


def measure(name: str, text: str, output: str, folder: Path, rounds: int, end: float = END, integrator: str = "dop853",
            tolerance: float = 1e-9) -> None:  # fmt: skip
    model = codegen.parse_model(text, name)
    begins = time.perf_counter()
    codegen.generate(model, folder / name, check=False, functions=("motion",))
    solver: Any = codegen.load(folder / name)
    took = f"generated and compiled in {time.perf_counter() - begins:.0f} s"
    print(f"{name}: {len(model.bodies)} bodies, {len(model.loops)} loops, {solver.np} parameters, {integrator}; {took}")
    found: dict[str, Any] = {}
    in_c: dict[str, list[float]] = {"motion": [], "adjoint": []}
    with watched(MotionRun, "_segment") as ahead, watched(FunctionalGradients, "_backwards") as backwards:

        def timed(what: str, run: Callable[[], Any]) -> float:
            before = len(ahead)
            seconds = elapsed(lambda: found.update({what: run()}), clock=time.process_time)()
            in_c.setdefault(what, []).append(sum(ahead[before:]))
            return seconds

        runs = runs_of(solver, output, end, integrator, tolerance)
        # one after the other in every round, so that a busy machine is so for all of them
        times = in_rounds({what: partial(timed, what, run) for what, run in runs.items()}, rounds)
    least = {what: x.least for what, x in times.items()}
    # the motion of the adjoint keeps its steps
    least |= {
        "motion in C": min(in_c["motion"]),
        "kept in C": min(in_c["adjoint"]),
        "backwards": min(backwards),
    }
    state = solver.nq + len(solver.independent_speed_names)
    stages = 3 * state if integrator == "radau" else 11 * (state + (solver.nq if solver.closure_names else 0)) + state
    error = relative(found["adjoint"].gradients, found["forward"].gradients)
    back = (least["kept in C"] + least["backwards"]) / least["motion in C"]
    for what, x in least.items():
        print(f"  {what:12} {1e3 * x:9.2f} ms")
    called, forward = (least[way] / least["motion"] for way in ("adjoint", "forward"))
    print(f"  gradient by the adjoint: {back:.2f} motions in C, {called:.2f} from Python; claimed at most {CLAIM:g}")
    print(f"  forward: {forward:.1f} motions; both agree to {error:.1e}")
    counts, steps = found["adjoint"].counts, found["motion"].stats["steps"]
    kept = f"{counts['steps'] * 8 * (4 + state + stages) / 2**10:.0f} KiB for steps"
    print(f"  {steps} steps, {counts['evaluations']} evaluations; back {counts['adjoint_evaluations']} and "
          f"{counts['adjoint_transposes']} transposes; {kept}")  # fmt: skip


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
            measure("flyball", example("flyball"), "height", folder, rounds, 10.0, "radau", 1e-8)
        if "stiff" in only:
            measure("stiff", chain_text(given.rods, stiff=True), "tip_x", folder, rounds, END, "radau", 1e-7)


if __name__ == "__main__":
    main()
