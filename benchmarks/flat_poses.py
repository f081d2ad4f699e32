"""Gradients of motions that pass poses where loops lose rank: sensitivities along the motion against the discrete adjoint.

    python benchmarks/flat_poses.py [--loops 2,5] [--ends 3,10] [--compare OLD.json] [--output NEW.json]

The N-four-bar of N = 2 (examples/n_four_bar.yaml) and flat ladders of one, two and five loops (examples/ladder.yaml), which lie
in one line about once a second, by every integrator. Both ways make the same steps, so their gradients differ by rounding only,
which near such a pose grows with the condition c of the loops as c^3. The table has, for each motion, its steps; the largest c
that was met anywhere, also between stages and in steps that were refused; the largest difference of both ways relative to the
largest entry of a functional's gradient, of four functionals by all parameters and initial values; and the time of gradients of
one functional over that of the motion alone, of the processor, least of several. The claim is 1e-11. With --compare, the
differences of a run before stand beside them.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from ctiming import table

import codegen
from codegen.measure.models import changed, example
from codegen.own_files import refuse_foreign_file
from codegen.runtime import At, Final, Integral
from codegen.runtime.standalone.whole_file import MARK

CLAIM = 1e-11

INTEGRATORS: tuple[tuple[str, dict[str, float]], ...] = (
    *(("dop853", {"rtol": x, "atol": x}) for x in (1e-8, 1e-10, 1e-12)),
    *(("radau", {"rtol": x, "atol": x}) for x in (1e-8, 1e-10, 1e-12)),
    *(("rk4", {"step": x}) for x in (0.01, 0.005)),
)


def models(loops: list[int]) -> dict[str, str]:
    """Texts by name: the N-four-bar, and ladders of so many loops."""
    return {"four-bars 2": example("n_four_bar")} | {
        f"ladder {n}": changed("ladder", "L: 3,", f"L: {n},") for n in loops
    }


def difference(solver: Any, end: float, integrator: str, options: dict[str, float]) -> tuple[Any, float]:
    """A motion's figures, and how much gradients of both ways differ, relative to the largest entry of each."""
    first, second = solver.output_names[:2]
    wanted = [Final(first), Final(second), Integral("kinetic"), At(first, 0.37 * end)]
    wrt = [*solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names)]
    wrt += [f"u0.{n}" for n in solver.independent_speed_names]
    forward, adjoint = (
        solver.judge(end, wanted, wrt=wrt, method=m, integrator=integrator, **options) for m in ("forward", "adjoint")
    )
    if forward.counts["steps"] != adjoint.counts["steps"]:
        raise AssertionError("both ways are to make the same steps")
    size = np.abs(forward.gradients).max(axis=1)
    return forward.counts, float((np.abs(forward.gradients - adjoint.gradients).max(axis=1) / size).max())


def least(call: Callable[[], Any], runs: int) -> float:
    """Seconds of the processor."""
    best = np.inf
    for _ in range(runs):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def times(solver: Any, end: float, integrator: str, options: dict[str, float], runs: int) -> tuple[float, float]:
    """Times of gradients of one functional forward and by the adjoint, over that of the motion alone."""
    wanted, names = Final(solver.output_names[0]), list(solver.parameter_names)
    plain = least(lambda: solver.judge(end, wanted, integrator=integrator, **options), runs)
    ways = (
        least(lambda m=m: solver.judge(end, wanted, wrt=names, method=m, integrator=integrator, **options), runs)
        for m in ("forward", "adjoint")
    )
    forward, adjoint = (x / plain for x in ways)
    return forward, adjoint


def measured(loops: list[int], ends: list[float], runs: int) -> Iterator[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        for name, text in models(loops).items():
            place = Path(folder) / name.replace(" ", "_").replace("-", "_")
            codegen.generate(codegen.parse_model(text), place, check=False)
            solver = codegen.load(place)
            for end in ends:
                for integrator, options in INTEGRATORS:
                    counts, found = difference(solver, end, integrator, options)
                    forward, adjoint = times(solver, end, integrator, options, runs)
                    yield {
                        "model": name, "end": end, "integrator": integrator, "of": next(iter(options.values())),
                        "steps": counts["steps"], "condition": counts["condition"], "difference": found,
                        "forward": forward, "adjoint": adjoint,
                    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loops", default="1,2,5", help="of ladders")
    parser.add_argument("--ends", default="3,10", help="s")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--compare", type=Path)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    if options.output:
        refuse_foreign_file(options.output)
    before = {}
    if options.compare:
        rows = json.loads(options.compare.read_text(encoding="utf-8"))["rows"]
        before = {(r["model"], r["end"], r["integrator"], r["of"]): r["difference"] for r in rows}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loops, ends = ([of(x) for x in given.split(",")] for of, given in ((int, options.loops), (float, options.ends)))
        found = list(measured(loops, ends, options.runs))
    if options.output:
        options.output.write_text(json.dumps({"written": MARK, "rows": found}, indent=1) + "\n", encoding="utf-8")
    rows = []
    for r in found:
        old = before.get((r["model"], r["end"], r["integrator"], r["of"]))
        rows.append(
            [
                r["model"], f"{r['end']:g}", r["integrator"], f"{r['of']:g}", str(r["steps"]), f"{r['condition']:.0f}",
                *([f"{old:.1e}" if old else ""] if before else []), f"{r['difference']:.1e}", f"{r['forward']:.1f}",
                f"{r['adjoint']:.1f}",
            ]
        )  # fmt: skip
    heads = ["model", "s", "integrator", "tolerance or step", "steps", "largest c", *(["before"] if before else [])]
    print(table([*heads, "difference", "forward, motions", "adjoint, motions"], rows))
    differences = [r["difference"] for r in found]
    good = sum(x <= CLAIM for x in differences)
    print(f"\n{good} of {len(found)} differ by at most {CLAIM:g}; the largest difference is {max(differences):.1e}")


if __name__ == "__main__":
    main()
