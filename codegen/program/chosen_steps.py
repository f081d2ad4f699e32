"""Procedures reduced to the steps that a target (C or NumPy) executes and that have an effect; and their routines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from .procedure import (
    AllColumns,
    Columns,
    Formulas,
    IfAsked,
    Perform,
    Prepare,
    Procedure,
    Routine,
    Run,
    Single,
    Step,
    Together,
    walk,
)


def for_target(procedure: Procedure, together: bool) -> Procedure:
    """The procedure in the form for targets that compute all columns of matrices at once, or one at a time.

    In the second form all results are computed, requested or not.
    """

    def chosen(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        found: list[Step] = []
        for step in steps:
            if isinstance(step, Together):
                found += chosen(step.steps if together else step.otherwise)
            elif isinstance(step, IfAsked):
                inner = chosen(step.steps)
                found += [replace(step, steps=inner)] if together else inner
            else:
                found.append(step)
        return tuple(found)

    return replace(procedure, steps=chosen(procedure.steps))


def routines(procedures: tuple[Procedure, ...]) -> list[Routine]:
    """Every routine that procedures run, each after the routines that it runs itself."""
    found: dict[Routine, None] = {}

    def add(steps: tuple[Step, ...]) -> None:
        for step in walk(steps):
            if isinstance(step, Perform) and step.routine not in found:
                add(step.routine.steps)
                found[step.routine] = None

    for p in procedures:
        add(p.steps)
    return list(found)


def pruned(procedure: Procedure, lives: Callable[[Run | Formulas | Prepare], bool]) -> Procedure:
    """A procedure without steps that have no effect, and without routines of such steps only."""

    def kept(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        found: list[Step] = []
        for step in steps:
            if isinstance(step, (Run, Formulas, Prepare)):
                if lives(step):
                    found.append(step)
            elif isinstance(step, Perform):
                inner = kept(step.routine.steps)
                if inner:
                    found.append(Perform(replace(step.routine, steps=inner)))
            elif isinstance(step, Single):
                found.append(replace(step, steps=tuple(s for s in step.steps if lives(s))))
            elif isinstance(step, (Columns, IfAsked)):
                found.append(replace(step, steps=kept(step.steps)))
            elif isinstance(step, AllColumns):
                found.append(replace(step, steps=tuple(s for s in step.steps if lives(s))))
            else:
                found.append(step)
        return tuple(found)

    return replace(procedure, steps=kept(procedure.steps))
