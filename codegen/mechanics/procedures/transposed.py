"""Transposes of functions over directions: their steps in reverse order."""

from __future__ import annotations

from itertools import pairwise

from ...program.procedure import (
    ADJOINTS,
    GROUND_TANGENT,
    GROUND_TANGENT_TRANSPOSED,
    PASSING_ADJOINTS,
    AddEntry,
    Array,
    Check,
    Combine,
    Copy,
    CopyEntry,
    Formulas,
    Hold,
    Own,
    Perform,
    Prepare,
    Procedure,
    Routine,
    Run,
    Step,
    Zero,
    ZeroEntries,
    flat,
    over_directions,
)
from ..sweeps import GRADIENT_IN, GRADIENT_IN_CLOSED, GRADIENT_OUT, transpose_name, values_name
from .shared import Shared
from .words import OTHER_WIDTHS, OUTPUTS

TRANSPOSED = {
    "accelerations": ("sensitivities", "gradients"),
    "coordinate_rates": ("coordinate_rate_sensitivities", "coordinate_rate_gradients"),
    "energies": ("energy_sensitivities", "energy_gradients"),
    "outputs": ("output_sensitivities", "output_gradients"),
    "completion": ("completion_sensitivities", "assemble_gradients"),
    "switches": ("switch_sensitivities", "switch_gradients"),
}
"""Functions that have a transpose. For each: the function that computes its derivatives, and the name of the transpose
in the solver."""

ALONE = {transpose_name("balance_back"), GRADIENT_OUT, GRADIENT_IN, GRADIENT_IN_CLOSED}
"""The sweeps of the balance's transpose. If they are the last, their memory need not be cleared."""


def backwards(w: Shared, found: list[Procedure]) -> list[Procedure]:
    """The transposes of the functions in `TRANSPOSED`."""
    by_name = {p.name: p for p in found}
    pairs = [(by_name.get(values), by_name.get(along)) for values, (along, _) in TRANSPOSED.items()]
    both = [(values, along) for values, along in pairs if values and along]
    # the adjoints of outputs that read accelerations are added before the transposed balance runs
    once = sum(Run("balance_in", True) in flat(along.steps) for _, along in both) == 1
    return [transposed(w, values, along, once) for values, along in both]


def transposed(w: Shared, values: Procedure, along: Procedure, once: bool) -> Procedure:
    """The transpose of a function: it takes weights of the results, and computes gradients of the weighted sum.

    In its steps, weights have the names of the derivatives, and gradients those of the seeds, because adjoints use the memory
    of directions. `once`: no other function transposes the balance, so its sweeps may be merged into two.
    """
    steps = [s for s in flat(along.steps) if over_directions(s)]
    swept = [s.sweep for s in steps if isinstance(s, Run)]
    assert len(set(swept)) == len(swept), "a function must not run a sweep twice: its adjoints would be wrong"
    together = run_together(w, steps) if once and values.name == "accelerations" else {}
    scalars = tuple(Run(values_name(s)) for s in swept if values_name(s) not in together)
    weights = tuple(r for r in along.results if r.lanes)
    own = [s.array for s in steps if isinstance(s, Own)]
    stored = {"dq", "du"} if together else set()
    back: list[Step] = [Zero(s) for s in along.seeds if s.name not in stored]
    back += [step for a in own if a not in along.seeds for step in (Own(a), Zero(a))]
    for step in reversed(steps):
        match step:
            case Run():
                name = transpose_name(step.sweep)
                back += [Run(s, True) for s in (together.get(name, name),) if s]
            case Formulas():
                back.append(step.transpose())
            case Prepare():
                back.append(Prepare(GROUND_TANGENT_TRANSPOSED, True))
            case Copy():
                back.append(Combine(step.of, (step.of, step.to)))
            case CopyEntry():
                back.append(AddEntry(step.of, step.entry, step.to, step.index))
            case Own() | Zero() | Hold() | Check():  # adjoints are zero when the transposed steps begin
                pass
            case _:
                raise TypeError(f"{along.name}: the step {type(step).__name__} has no transpose")
    runs = {s.sweep for s in back if isinstance(s, Run)}
    if all(link.joint.quaternion is None for link in w.system.links):
        runs.discard(transpose_name("turns"))  # without quaternions this sweep has nothing to do
    back.insert(0, Prepare(PASSING_ADJOINTS if together and runs <= ALONE else ADJOINTS, True))
    left = [s for s in along.seeds if GRADIENT_IN_CLOSED not in runs or s.name not in stored]
    back += [ZeroEntries(s, entries) for s in left if (entries := _dependent(w, s))]
    name = along.name.removesuffix("_sensitivities")
    return Procedure(
        f"{along.name}_transposed",
        f"{values.doc.rstrip('.')}, and gradients of their weighted sums (transpose of {along.name}).",
        along.arguments,
        (*(r for r in along.results if not r.lanes), *along.seeds),
        (
            *values.steps,
            Perform(
                Routine(f"{name}_scalars", "Scalars that sweeps over directions propagate between links.", scalars)
            ),
            *([Check()] if any(isinstance(s, Check) for s in steps) else []),
            Perform(Routine(f"{name}_backwards", f"Transposed steps of {along.name}, in reverse order.", tuple(back))),
            *([Check(True)] if w.formula_pivots and OUTPUTS.tangents() in steps else []),
        ),
        weights,
        OTHER_WIDTHS,
        TRANSPOSED[values.name][1],
    )


def _dependent(w: Shared, seed: Array) -> tuple[int, ...]:
    """Entries of a seed that belong to dependent coordinates or speeds."""
    free = dict(zip(("dq", "du"), w.system.independent, strict=True)) if w.loops else {}
    return tuple(sorted(set(range(seed.size)).difference(free[seed.name]))) if seed.name in free else ()


def run_together(w: Shared, steps: list[Step]) -> dict[str, str]:
    """Maps each replaced sweep to its merged sweep (`sweeps.GRADIENT_OUT`), or to "" if nothing runs in its place.

    The completion of seeds is included if only gravity comes between it and the balance.
    """
    runs = [s.sweep if isinstance(s, Run) else "" for s in steps if s != Prepare(GROUND_TANGENT, True)]
    closed = ("complete", "balance_out") in pairwise(runs)
    found = {
        values_name("balance_out"): "",
        values_name("balance_in"): "",
        transpose_name("balance_in"): GRADIENT_OUT,
        transpose_name("balance_out"): GRADIENT_IN_CLOSED if closed else GRADIENT_IN,
    }
    return found | ({transpose_name("complete"): ""} if closed else {})
