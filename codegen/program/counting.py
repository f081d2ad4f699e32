"""The sweeps, formulas and preparations that a procedure runs, in their order, for the operation counts of functions."""

from __future__ import annotations

from .procedure import (
    AllColumns,
    Columns,
    Formulas,
    Prepare,
    Primitives,
    Procedure,
    Run,
    Single,
    Step,
    flat,
    walk,
    within,
)


def sweeps(procedures: tuple[Procedure, ...]) -> set[str]:
    """Names of the sweeps that some procedures run."""
    return {s.sweep for p in procedures for s in walk(p.steps) if isinstance(s, Run)}


def counted(procedure: Procedure, outside: str) -> list[str]:
    """Names of the sweeps, formulas and preparations (`outside`) that a procedure runs, in order of first use.

    A sweep that runs twice is listed twice. Sweeps over the columns of matrices are listed once, since each column is a
    direction. A sweep of a `Single` step, over one direction, gets the suffix ``_1``, as in ``solve_in_1``. Values and
    tangents of formulas share a name; so do values and tangents of preparations.
    """
    steps = tuple(within(procedure.steps))
    found = _names(steps, outside)
    shared = {outside, *(s.name for s in walk(procedure.steps) if isinstance(s, Formulas))}
    of_columns: list[str] = []
    for step in steps:
        if isinstance(step, (Columns, AllColumns)):
            names = _names(step.steps, outside)
            for name in dict.fromkeys(names):
                known = of_columns.count(name) + (found.count(name) if name in shared else 0)
                of_columns += [name] * (names.count(name) - known)
    return found + of_columns


def _names(steps: tuple[Step, ...], outside: str) -> list[str]:
    """Names of the sweeps, formulas and preparations that some steps run, in order of first use. Steps that run once
    for each column are excluded."""
    found: list[str] = []
    shared: dict[tuple[str, bool], int] = {}
    for step in flat(steps, lambda step: True):
        match step:
            case Run():
                found.append(step.sweep)
            case Formulas():
                times = shared[step.name, step.lanes] = shared.get((step.name, step.lanes), 0) + 1
                if times > found.count(step.name):
                    found.append(step.name)
            case Prepare(lanes=False) if outside not in found:  # preparations over directions are not counted
                found.append(outside)
            case Single():
                found += [f"{s.sweep}_1" for s in step.steps if isinstance(s, Run)]
            case Primitives() if step.formulas.name not in found:
                found.append(step.formulas.name)
            case _:
                pass
    return found
