"""Sweeps, formulas and routines that functions call, by name, with the numbers of directions."""

from __future__ import annotations

from collections.abc import Sequence

from ..program.procedure import (
    WIDTHS,
    AllColumns,
    Columns,
    Formulas,
    IfAsked,
    Perform,
    Primitives,
    Procedure,
    Run,
    Single,
    Step,
    over_directions,
    walk,
)


def part_of(step: Formulas) -> str:
    """Prefix of the name of a formula's function, for values, tangents, transposed tangents, adjoints or adjoints' tangents."""
    if step.twice:
        return "twice_"
    if step.backwards:
        return "back_" if step.lanes else "adjoint_"
    return "lane_" if step.lanes else ""


def name_of(step: Run | Formulas) -> str:
    """Name of the function that a step calls."""
    if isinstance(step, Run):
        return step.sweep
    return step.called


def widest_first(procedure: Procedure) -> tuple[int, ...]:
    """Numbers of directions for which a function is written, largest first."""
    return tuple(sorted((*procedure.widths, *procedure.apart), reverse=True))


def called_for(procedure: Procedure) -> dict[tuple[str, int], set[int]]:
    """Sweeps, formulas and routines that a procedure runs over directions: for each name and width, the widths of the
    functions that run it."""
    found: dict[tuple[str, int], set[int]] = {}
    own = (*procedure.widths, *procedure.apart)

    def call(name: str, width: int, within: int | None) -> None:
        found.setdefault((name, width), set()).update(own if within is None else (within,))

    def add(steps: tuple[Step, ...], widths: Sequence[int], anyhow: bool) -> None:
        """Record the calls of steps that run with the given widths. If `anyhow`, functions of all widths run them; otherwise
        only the function of the same width."""
        for step in steps:
            match step:
                case Run() | Formulas() if over_directions(step):
                    for w in widths:
                        call(name_of(step), w, None if anyhow else w)
                case Single():
                    for s in step.steps:
                        call(name_of(s), 1, None)
                case Perform():
                    for w in widths if over_directions(step) else ():
                        call(step.routine.name, w, None if anyhow else w)
                    add(step.routine.steps, widths, anyhow)
                case Columns() | IfAsked():
                    add(step.steps, widths or (max(WIDTHS),), anyhow or not widths)
                case AllColumns():
                    for s in step.steps:
                        if s.lanes:
                            call(s.sweep, step.width, None)
                case Primitives():
                    call(name_of(step.formulas), max(WIDTHS), None)
                case _:
                    pass

    add(procedure.steps, own, False)
    return found


def called_once(procedure: Procedure) -> set[str]:
    """Names of the sweeps, formulas and routines that a procedure calls without directions."""
    return {
        step.routine.name if isinstance(step, Perform) else name_of(step)
        for step in walk(procedure.steps)
        if isinstance(step, (Run, Formulas, Perform)) and not over_directions(step)
    }
