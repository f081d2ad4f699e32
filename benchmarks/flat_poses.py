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
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import codegen
from codegen.measure.accuracy import by_direction
from codegen.measure.clock import elapsed, in_rounds
from codegen.measure.models import example, text_of
from codegen.measure.tables import markdown
from codegen.own_files import refuse_foreign_file
from codegen.runtime import At, Final, Integral
from codegen.runtime.standalone.files.whole_file import MARK

CLAIM = 1e-11

INTEGRATORS: tuple[tuple[str, dict[str, float]], ...] = (
    *(("dop853", {"rtol": x, "atol": x}) for x in (1e-8, 1e-10, 1e-12)),
    *(("radau", {"rtol": x, "atol": x}) for x in (1e-8, 1e-10, 1e-12)),
    *(("rk4", {"step": x}) for x in (0.01, 0.005)),
)
WAYS = ("forward", "adjoint")
HEAD = ("model", "s", "integrator", "tolerance or step", "steps", "largest c", "before", "difference", "forward, motions",
        "adjoint, motions")  # fmt: skip


def difference(solver: Any, end: float, options: dict[str, Any]) -> tuple[Any, float]:
    """A motion's figures, and how much gradients of both ways differ, relative to the largest entry of each."""
    first, second = solver.output_names[:2]
    wanted = [Final(first), Final(second), Integral("kinetic"), At(first, 0.37 * end)]
    wrt = [*solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names)]
    wrt += [f"u0.{n}" for n in solver.independent_speed_names]
    forward, adjoint = (solver.judge(end, wanted, wrt=wrt, method=m, **options) for m in WAYS)
    if forward.counts["steps"] != adjoint.counts["steps"]:
        raise AssertionError("both ways are to make the same steps")
    return forward.counts, max(by_direction(adjoint.gradients, forward.gradients))


def times(solver: Any, end: float, options: dict[str, Any], runs: int) -> dict[str, float]:
    """Times of gradients of one functional forward and by the adjoint, over that of the motion alone."""
    judge = partial(solver.judge, end, Final(solver.output_names[0]), **options)
    calls = {"motion": judge} | {m: partial(judge, wrt=list(solver.parameter_names), method=m) for m in WAYS}
    found = in_rounds({name: elapsed(call, clock=time.process_time) for name, call in calls.items()}, runs)
    return {m: found[m].least / found["motion"].least for m in WAYS}


def measured(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    models = {"four-bars 2": example("n_four_bar")}
    models |= {f"ladder {n}": text_of("LADDER", int(n)) for n in options.loops.split(",")}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in models.items():
            place = Path(folder) / name.replace(" ", "_").replace("-", "_")
            codegen.generate(codegen.parse_model(text), place, check=False)
            solver = codegen.load(place)
            for end in map(float, options.ends.split(",")):
                for integrator, accuracy in INTEGRATORS:
                    given = {"integrator": integrator, **accuracy}
                    counts, found = difference(solver, end, given)
                    yield {
                        "model": name, "end": end, "integrator": integrator, "of": next(iter(accuracy.values())),
                        "steps": counts["steps"], "condition": counts["condition"], "difference": found,
                        **times(solver, end, given, options.runs),
                    }  # fmt: skip


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    """What identifies a motion."""
    return row["model"], row["end"], row["integrator"], row["of"]


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
    rows = json.loads(options.compare.read_text(encoding="utf-8"))["rows"] if options.compare else []
    before = {key(r): f"{r['difference']:.1e}" for r in rows}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = list(measured(options))
    if options.output:
        options.output.write_text(json.dumps({"written": MARK, "rows": found}, indent=1) + "\n", encoding="utf-8")
    cells = [
        [r["model"], f"{r['end']:g}", r["integrator"], f"{r['of']:g}", r["steps"], f"{r['condition']:.0f}",
         before.get(key(r), ""), f"{r['difference']:.1e}", f"{r['forward']:.1f}", f"{r['adjoint']:.1f}"]
        for r in found
    ]  # fmt: skip
    print(markdown(HEAD, cells))
    differences = [r["difference"] for r in found]
    good = sum(x <= CLAIM for x in differences)
    print(f"\n{good} of {len(found)} differ by at most {CLAIM:g}; the largest difference is {max(differences):.1e}")


if __name__ == "__main__":
    main()
