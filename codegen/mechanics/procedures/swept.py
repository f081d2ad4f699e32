"""The sweeps that the procedures run."""

from __future__ import annotations

from ...program.counting import sweeps
from ...program.procedure import (
    PASSING_ADJOINTS,
    Check,
    Perform,
    Prepare,
    Procedure,
    Run,
    walk,
)
from ..sweeps import GRADIENT_IN_CLOSED, GRADIENT_OUT, SWEEP, SWEEPS, transpose_name
from .transposed import ALONE


def check_names(found: tuple[Procedure, ...]) -> None:
    """Check that no routine has the name of a sweep, since both become functions of generated code.

    Raises
    ------
    AssertionError
        Names the routines.
    """
    taken = SWEEP.keys() & {s.routine.name for p in found for s in walk(p.steps) if isinstance(s, Perform)}
    assert not taken, f"routines have the names of sweeps: {', '.join(sorted(taken))}"


def checked_backwards(found: tuple[Procedure, ...]) -> set[str]:
    """Sweeps over directions of the procedures that check pivots over directions."""
    checking = [p for p in found if any(isinstance(s, Check) and s.lanes for s in p.steps)]
    return {s.sweep for p in checking for s in walk(p.steps) if isinstance(s, Run) and s.lanes}


def swept_backwards(found: tuple[Procedure, ...]) -> list[str]:
    """Sweeps whose transposes are run."""
    run = sweeps(found)
    if GRADIENT_OUT in run:
        run |= {transpose_name(s) for s in ("balance_out", "balance_in")}
    if GRADIENT_IN_CLOSED in run:
        run.add(transpose_name("complete"))
    return [s.name for s in SWEEPS if s.lanes and transpose_name(s.name) in run]


def swept_together(found: tuple[Procedure, ...]) -> tuple[set[str], bool]:
    """Merged sweeps of the balance's transpose that run, and whether they are the last transposes."""
    run = sweeps(found)
    assert not {GRADIENT_OUT, transpose_name("balance_in")} <= run, "merged sweeps must not run separately"
    alone = any(s == Prepare(PASSING_ADJOINTS, True) for p in found for s in walk(p.steps))
    return run & ALONE if GRADIENT_OUT in run else set(), alone
